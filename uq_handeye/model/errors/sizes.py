"""Priors of the sizes of errors: medians and factors, in one table with their sources.

*Accuracy of a robot*, as its data sheet states it, is that of a population of arms (`population`). A data sheet's
accuracy is read as the root mean square, over the workspace, of the distance (and of the angle) between the pose
commanded and the one attained, once the frames of base and tool are aligned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import chain
from typing import NamedTuple

import numpy as np

from ...core.files.json_values import JsonObject
from ...core.files.tree_values import is_map, is_plain_number
from ...core.presentation.units import parse_angle, parse_length, parse_pixels, parse_ratio
from ...errors import InputError
from .key import ErrorKey, Kind, Owner, by_text
from .keys import (
    BY_VIEW,
    CAMERA_EXCESS,
    CAMERA_ROTATION,
    CAMERA_TRANSLATION,
    DEPTH,
    DRIFTS,
    FOCAL_LENGTH,
    JOINT_NOISE,
    LENS,
    OUTLINE,
    PICTURE_SHIFT,
    PIXELS,
    PRINCIPAL_POINT,
    ROBOT_ACCURACY,
    ROBOT_ROTATION,
    ROBOT_TRANSLATION,
    SCENE_EXCESS,
    TARGET_SCALE,
    VIEW,
    WALKS,
)


@dataclass(frozen=True)
class Size:
    """Standard deviation of an error per unit of its columns: known (factor 1), or log-normal about a median.

    ``factor``: one standard deviation of the logarithm; 2 says between half and twice the median with 68 %.
    """

    median: float
    factor: float = 1.0
    unit: str = ""  # rad, m, px; "" where relative, or one of its columns
    source: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.median < float("inf") or (self.median == 0 and self.factor > 1):
            raise InputError(f"Expected the median of a size to be above 0 and finite, got {self.median!r}.")
        if not 1 <= self.factor < 1e6:
            raise InputError(f"Expected the factor of a size to be a number >= 1 (1: known), got {self.factor!r}.")

    @property
    def is_known(self) -> bool:
        """True if the size is not estimated."""
        return self.factor == 1.0


# What is assumed of each error where nothing is declared, by name: standard deviations per axis, in rad and m.
SIZES: dict[ErrorKey, Size] = {
    ROBOT_ROTATION: Size(1.75e-4, 4.0, "rad", "repeatability by ISO 9283, 0.01 deg"),
    ROBOT_TRANSLATION: Size(0.03e-3, 4.0, "m", "repeatability by ISO 9283, 0.02 to 0.1 mm"),
    CAMERA_ROTATION: Size(8.7e-4, 6.0, "rad", "poses of boards and tags, 0.05 deg"),
    CAMERA_TRANSLATION: Size(0.3e-3, 6.0, "m", "poses of boards and tags"),
    DEPTH: Size(0.2e-3, 6.0, "m", "in addition to that of camera translation: depth of boards, tags and SLAM"),
    BY_VIEW: Size(1.5e-4, 5.0, "rad", "corners to 0.05 to 1 px over a focal length of 500 to 2000 px"),
    FOCAL_LENGTH: Size(1e-3, 2.0, "", "calibrations of the same camera, repeated; a wrong one is its tail"),
    PRINCIPAL_POINT: Size(1e-3, 2.0, "rad", "calibrations of the same camera, repeated; a crop is its tail"),
    TARGET_SCALE: Size(3e-4, 4.0, "", "printed and etched targets; a wrong square is its tail"),
    VIEW: Size(1.5e-4, 3.0, "", "rendered and real sets with lens, board shape and corners left out of the model"),
    LENS: Size(3e-3, 2.0, "", "k1 of repeated calibrations; k2 3 times, p 0.1 times, fx/fy 0.05 times"),
    OUTLINE: Size(0.3, 1.0, "", "sides of common boards 1:1 to 1:1.6; how wide they are at their distance"),
    ROBOT_ACCURACY: Size(0.6e-3, 3.0, "m", "ISO 9283 absolute accuracy of arms with nominal kinematics"),
    JOINT_NOISE: Size(0.2e-3, 3.0, "rad", "laser tracker data of an ABB IRB 120 and a Motoman MA1400"),
    DRIFTS[Owner.CAMERA]: Size(2e-5, 5.0, "", "0.02 mrad and 0.02 mm a step"),
    DRIFTS[Owner.TARGET]: Size(2e-5, 5.0, "", "0.02 mrad and 0.02 mm a step"),
    WALKS[Kind.WALK_IN_ROTATION]: Size(1e-4, 10.0, "", "visual odometry, 0.1 mrad a step"),
    WALKS[Kind.WALK_IN_TRANSLATION]: Size(1e-4, 10.0, "", "visual odometry, 0.1 mm a step"),
    WALKS[Kind.WALK_IN_SCALE]: Size(3e-4, 10.0, "", "monocular odometry, 0.03 % a step"),
    PIXELS: Size(0.2, 3.0, "px", "corner detectors, 0.02 to 2 px"),
    CAMERA_EXCESS: Size(0.05, 3.0, "px", "errors that the corners of one picture share"),
    SCENE_EXCESS: Size(1.0, 2.0, "", "lens, blur, features that move: 0.3 to 5 on rendered and real sets"),
    PICTURE_SHIFT: Size(0.02, 3.0, "px", "all corners of a picture: vibration, exposure while moving"),
}
# The same by what the errors are called, which is how a user names one.
BY_NAME = {str(key): size for key, size in SIZES.items()}
# Absolute accuracy of classes of arms, the size of `robot accuracy`.
CLASSES = {
    "calibrated": Size(0.15e-3, 2.0, "m", "arms calibrated at the factory"),
    "industrial": Size(0.6e-3, 2.0, "m", "industrial arms with nominal kinematics"),
    "cobot": Size(2.0e-3, 2.0, "m", "cobots with nominal kinematics"),
}

PARSERS = {"rad": parse_angle, "m": parse_length, "px": parse_pixels, "": parse_ratio}

SizeLike = Size | tuple[float | str, float] | float | str
PartlyKnown = tuple[str | float | None, str | float | None]
# Noise that data sheets state, by what users call the side.
OF_SHEETS = {"robot": (ROBOT_ROTATION, ROBOT_TRANSLATION), "camera": (CAMERA_ROTATION, CAMERA_TRANSLATION)}


def NoisePrior(  # the prior by data sheets, as users call it
    robot: PartlyKnown | None = None, camera: PartlyKnown | None = None, factor: float = 2.0
) -> dict[ErrorKey, Size]:
    """Return sizes of the noise by data sheets: standard deviations per axis, each known within a factor.

    Parameters
    ----------
    robot, camera : (rotation, translation) or None
        Numbers (rad, m) or text with units, as in `PoseNoise.isotropic`; None where nothing is known. For motions that
        come without poses ``robot`` is A and ``camera`` is B.
    factor : float
        One standard deviation of the logarithm: 2 says that the true value is between half and twice the value given
        with probability 68 %. 1 fixes the values.

    Raises
    ------
    InputError
        A factor below 1, negative values, or a value of 0 that is not fixed.

    Examples
    --------
    >>> prior = NoisePrior(robot=(None, "0.05mm"), factor=1)
    """
    if not is_plain_number(factor) or not 1 <= factor < 1e6:
        raise InputError(
            f"Expected `factor` of the noise prior to be a number >= 1 (1 fixes the values), got {factor!r}."
        )
    found = {}
    for name, given in (("robot", robot), ("camera", camera)):
        value = (None, None) if given is None else given
        if not isinstance(value, tuple | list) or len(value) != 2:
            raise InputError(f"Expected `{name}` to be (rotation, translation), got {value!r}.")
        for key, part in zip(OF_SHEETS[name], value, strict=True):
            if part is None:
                continue
            what = f"{key.kind} standard deviation of {name}"
            size = PARSERS[SIZES[key].unit](part, f"the {what}")
            if not 0 <= size <= 1e9:
                raise InputError(f"Expected the {what} to be in [0, 1e9], got {part!r}.")
            if size == 0 and factor > 1:
                raise InputError(
                    "Expected the standard deviations of the noise prior to be above 0 where they are known within a "
                    "factor, got 0. Use factor=1 for a side that is exact, or None where nothing is known."
                )
            found[key] = Size(size, float(factor), SIZES[key].unit, "declared")
    return found


def require_noise_prior(prior: object) -> None:
    """Raise `InputError` for what is neither None nor a prior of the noise by data sheets."""
    if prior is not None and not (isinstance(prior, Mapping) and set(prior) <= {*chain(*OF_SHEETS.values())}):
        raise InputError(f"Expected `prior` to be a NoisePrior or None, got {type(prior).__name__}.")


def prior_to_dict(prior: Mapping[ErrorKey, Size]) -> JsonObject:
    """Return the prior by names as plain values: median and factor."""
    return {str(key): [size.median, size.factor] for key, size in prior.items()}


def prior_from_dict(data: JsonObject) -> dict[ErrorKey, Size]:
    """Return the inverse of `prior_to_dict`; raises `InputError` for other errors."""
    keys = by_text(chain(*OF_SHEETS.values()))
    if not is_map(data) or not keys.keys() >= set(data):
        raise InputError(f"Expected a prior of the noise of robot and camera, got {data!r:.80}.")
    return {
        keys[name]: Size(float(median), float(factor), SIZES[keys[name]].unit, "declared")
        for name, (median, factor) in data.items()
    }


def checked_sizes(given: Mapping[str, SizeLike] | None) -> dict[str, Size]:
    """Return sizes by name; raises `InputError` for what is none."""
    found = {}
    if given is not None and not (isinstance(given, Mapping) and {*map(type, given)} <= {str}):
        raise InputError(
            f"Expected sizes by the names of errors, such as {{'robot accuracy': '0.3mm'}}, got {given!r}."
        )
    for name, value in (given or {}).items():
        if isinstance(value, Size):
            size = value
        else:
            median, *more = value if isinstance(value, tuple | list) and value else (value,)
            plain = name.rpartition(":")[2]  # of one camera, target or arm of a rig by its name in front
            unit, factor = BY_NAME[plain].unit if plain in BY_NAME else "", more[0] if more else 1.0
            if isinstance(median, str):
                median = PARSERS[unit](median, f"the size of {name!r}")
            if not is_plain_number(median) or len(more) > 1:
                raise InputError(
                    f"Expected the size of {name!r} to be a number, a text with its unit such as '0.3mm', or (median, "
                    f"factor), got {value!r}."
                )
            if not is_plain_number(factor) or not 1 <= factor < 1e6:
                raise InputError(f"Expected the factor of {name!r} to be a number >= 1 (1: known), got {factor!r}.")
            if not 0 < median < float("inf"):
                raise _no_size(name, value)
            size = Size(float(median), float(factor), unit, "declared")
        if size.median == 0:
            raise _no_size(name, 0.0)
        found[name] = size
    return found


def _no_size(name: str, value: object) -> InputError:
    return InputError(
        f"Expected the size of {name!r} to be above 0 and finite, got {value!r}. An error that is not there has a very "
        "small size."
    )


def parse_size(text: str) -> tuple[str, Size]:
    """Return the name and the size of a text such as ``"robot accuracy=0.3mm,2"``: median, and factor if it is not 1.

    Raises `InputError` for a name that the table does not have, with the nearest ones.
    """
    name, equals, value = (part.strip() for part in text.partition("="))
    median, comma, factor = value.partition(",")
    if not equals or not median:
        raise InputError(f"Expected NAME=SIZE or NAME=SIZE,FACTOR such as 'robot accuracy=0.3mm,2', got {text!r}.")
    if (plain := name.rpartition(":")[2]) not in BY_NAME:
        near = get_close_matches(plain, BY_NAME, 3, 0.4) or BY_NAME
        raise InputError(f"No error of the name {name!r:.60} has a size. Near it: {', '.join(near)}.")
    try:
        number = float(factor) if comma else 1.0
    except ValueError:
        raise InputError(f"Expected the factor of {name!r} to be a number >= 1, got {factor!r}.") from None
    return name, checked_sizes({name: (median, number)})[name]


class RobotAccuracy(NamedTuple):
    """Accuracy that was declared or assumed of an arm, as numbers."""

    translation: float  # m
    rotation: float  # rad
    reach: float  # m

    def to_dict(self) -> list[float]:
        """Return the numbers as a list, as files hold them."""
        return list(self)

    def times(self, size: float) -> RobotAccuracy:
        """Another accuracy of the same reach."""
        return self._replace(translation=size * self.translation, rotation=size * self.rotation)


def stated_accuracy(translation: float | str, rotation: float | str | None) -> tuple[float, float]:
    """Accuracy of position and orientation (m, rad) of two values, or of a text with both; raises `InputError`.

    Without one of the orientation it is 0: the errors of arms that are so accurate in position.
    """
    if rotation is None:
        parts = [part.strip() for part in str(translation).split(",")]
        if len(parts) > 2:
            raise InputError(
                f"Expected the {ROBOT_ACCURACY} to be a length, or a length and an angle such as '0.5mm,0.05deg', got "
                f"{translation!r}."
            )
        rotation = 0.0
        if len(parts) == 2:  # in either order
            translation, rotation = sorted(parts, key=lambda part: part.endswith(("deg", "rad")))
    move = parse_length(translation, f"the translation of the {ROBOT_ACCURACY}")
    turn = parse_angle(rotation, f"the rotation of the {ROBOT_ACCURACY}")
    if not (0 <= move < np.inf and 0 <= turn < np.inf):
        raise InputError(f"Expected the {ROBOT_ACCURACY} to be finite and >= 0, got {translation!r}, {rotation!r}.")
    return move, turn
