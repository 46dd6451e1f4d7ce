"""Facts of a result, each computed once: name, value, uncertainty and unit, in one order for every kind of result.

First screen, long text, report, certificate, notebook, live panel and JSON select from them and compute none. In their
order: the accuracy of each camera, the numbers of each pose with the lengths of its errors, the residuals, the noise,
and the errors that all poses share. Beside them stand the texts about X that more than one output shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ...core.files.json_values import JsonObject
from ...core.files.records import plain
from ...core.geometry.conventions import COMPONENTS
from ...core.geometry.pose_numbers import POSE_NUMBERS, pose_numbers, principal_axes
from ...core.geometry.se3 import Array
from ...core.levels import INTERVAL
from ...core.presentation.numbers import concise, digits, fixed, plus_minus, value_and_sd
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...fit.diagnostics.result import UNKNOWN_FRAME
from ...fit.diagnostics.sentences import direction_words
from ...fit.graph.reference import Reference
from ...model.errors.error_estimate import SHOWN
from ...model.errors.joint_covariance import JointCovariance
from ...model.errors.models import marginals
from ...model.errors.noise_estimate import SIDES
from ...model.poses.estimated_pose import PARTS, EstimatedPose
from ..accuracy import Accuracy, Statement, point_ahead
from ..error_of_X import PointAhead, points_of, radius_95
from ..estimated import Estimated

# Points ahead of the camera, in distances of the target.
STEPS_AHEAD = (0.5, 1.0, 1.5, 2.0)
# Components of an open direction up to this size (rad, m) are rounding errors.
MAX_ROUNDING_OF_OPEN = 1e-9
_SOURCES = {
    "model": "the noise given",
    "sandwich": "the residuals of the poses (sandwich)",
    "bootstrap": "the poses, drawn with replacement (bootstrap)",
}


# Groups of facts, in their order.
Group = Literal["accuracy", "point ahead", "pose", "error of pose", "axis", "residuals", "noise", "shared error"]


class Fact(NamedTuple):
    """A number as people read it, with its standard deviation; its forms are those of every output."""

    name: str  # such as "rotation vector x"
    value: float  # mm, deg, or as the unit says
    sd: float | None  # None: not known; infinite: the motions leave it open
    unit: str
    group: Group = "pose"
    of: str = ""  # frame of the pose, its name where it is one before or after a move; or name of an arm or an error
    within_95: float | None = None  # length or angle that 95 % of the errors are within, of one of their sizes

    def to_dict(self) -> JsonObject:
        """Return plain values; None for what is not known or not determined."""
        found: JsonObject = {"group": self.group, "of": self.of, "name": self.name, "value": plain(self.value)}
        found |= {"uncertainty": plain(self.sd), "unit": self.unit}
        return found if self.within_95 is None else found | {"within_95": plain(self.within_95)}

    def rounded(self, places: int) -> str:
        """Value with so many decimals, for columns."""
        return f"{self.value:.{places}f}"

    @property
    def short(self) -> str:
        """Size of an error with two digits; "open" where it is not determined."""
        return digits(self.value, 2) if np.isfinite(self.value) else "open"

    @property
    def short_95(self) -> str:
        """The length that 95 % of the errors are within, with two digits; "open" where it is not determined."""
        if self.within_95 is None:
            return ""
        return digits(self.within_95, 2) if np.isfinite(self.within_95) else "open"

    @property
    def concise(self) -> str:
        """Value, standard deviation in brackets and unit."""
        return concise(self._shown, self.sd, self.unit)

    @property
    def bare(self) -> str:
        """Value and standard deviation in brackets, for columns with a unit."""
        return concise(self._shown, self.sd)

    @property
    def plus_minus(self) -> str:
        """``12.345 +- 0.067``; the value alone where nothing is known of it."""
        if self.sd is None:
            return digits(self.value, 6)
        return f"{digits(self.value, 6)} (open)" if np.isinf(self.sd) else plus_minus(self.value, self.sd)

    @property
    def parts(self) -> tuple[str, str]:
        """Value and standard deviation of two digits, to the same place."""
        if self.sd is None or not np.isfinite(self.sd) or self.sd <= 0:
            return f"{self.value + 0.0:.4f}", "?" if self.sd is None else "open" if self.sd > 0 else "0"
        return value_and_sd(self.value, self.sd)

    @property
    def _shown(self) -> float:
        return round(self.value, 9) if self.sd is None else self.value  # what is exact ends in rounding errors


@dataclass(frozen=True)
class Facts:
    """All facts of a result in their order, and texts about X that more than one output shows."""

    all: tuple[Fact, ...]
    parent: str = ""  # frame that X and its covariance are in
    subject: str = ""  # "camera in the gripper frame"; empty for motions that came without poses
    directions: tuple[str, ...] = ()  # in which translation and rotation are least certain
    correlations: tuple[tuple[float, str, str], ...] = ()  # of the components of (theta, tau), the strongest first
    ellipsoid: str = ""  # what holds 95 % of all errors
    source: str = ""  # where the standard deviations come from
    frames: tuple[str, str] = ("", "")  # of X and W, where there is one of each

    def select(self, group: Group, of: str | None = None) -> tuple[Fact, ...]:
        """Return the facts of a group, of one pose, arm, camera or error; None: of all."""
        return tuple(one for one in self.all if one.group == group and of in (None, one.of))

    @property
    def X(self) -> tuple[Fact, ...]:
        """The six numbers of X, where there is one camera."""
        return self.select("pose", self.frames[0])

    @property
    def W(self) -> tuple[Fact, ...]:
        """The six numbers of W, where there is one target; empty where it is not known."""
        return self.select("pose", self.frames[1])

    def rows(self, shown: Mapping[str, str]) -> list[list[str]]:
        """Return the position of each pose, and the lengths of its errors; ``shown``: what facts are of, by the frame.

        Position and lengths are in mm, and the last is in deg.
        """
        rows = []
        for frame, of in shown.items():
            position, lengths = self.select("pose", of)[:3], self.select("error of pose", of)
            rows.append([frame, *(fact.rounded(2) for fact in position), *(fact.short for fact in lengths)])
        return rows

    def to_dict(self) -> list[JsonObject]:
        """Return all facts as plain values."""
        return [one.to_dict() for one in self.all]


# What a size of errors is of: in which direction, or of all together.
WHAT: dict[Group, str] = {
    "accuracy": "worst direction", "error of pose": "worst direction", "noise": "of each axis",
}  # fmt: skip


def numbers_of(T: Array, covariance: Array | None, opened: Array | None, of: str = "") -> tuple[Fact, ...]:
    """Return the six numbers of a pose (4, 4), with its covariance (6, 6) and its open directions (k, 6)."""
    values, deviations = pose_numbers(T, covariance, opened=opened)
    known = [None] * 6 if deviations is None else deviations.tolist()
    units = ["mm"] * 3 + ["deg"] * 3
    parts = zip(POSE_NUMBERS, values.tolist(), known, units, strict=True)
    return tuple(Fact(name, value, sd, unit, of=of) for name, value, sd, unit in parts)


def sizes_of_errors(
    turn: float, shift: float, of: str, within: tuple[float, float] | None = None, group: Group = "error of pose"
) -> tuple[Fact, Fact]:
    """Return sizes of the errors of a pose (rad, m) in mm and deg; ``within``: what 95 % of them are within."""
    what = WHAT[group]
    turn_95, shift_95 = (None, None) if within is None else (DEG_PER_RAD * within[0], MM_PER_M * within[1])
    return (
        Fact(f"translation, {what}", MM_PER_M * shift, None, "mm", group, of, shift_95),
        Fact(f"rotation, {what}", DEG_PER_RAD * turn, None, "deg", group, of, turn_95),
    )


def facts_of_poses(poses: Mapping[str, EstimatedPose], reference: Reference) -> Iterator[Fact]:
    """Yield the six numbers of each pose, and the sizes of its errors in the worst direction with those for 95 %.

    ``poses``: by what their facts are said to be of.
    """
    for of, one in poses.items():
        yield from numbers_of(one.pose, one.covariance, one.open, of)
        yield from sizes_of_errors(*one.sizes, of, within_95(one, reference))


def within_95(one: EstimatedPose, reference: Reference) -> tuple[float, float]:
    """Return the angle (rad) and length (m) that 95 % of the errors of a pose are within; infinite where open."""
    xi = points_of(one.covariance, reference, None)
    opened = [len(one.open) > 0 and float(np.abs(one.open[:, part]).max()) > MAX_ROUNDING_OF_OPEN for part in PARTS]
    turn, shift = (np.inf if is_open else radius_95(xi[:, part]) for part, is_open in zip(PARTS, opened, strict=True))
    return turn, shift


def facts_of_residuals(chi_square: float, dof: float, p_value: float | None) -> Iterator[Fact]:
    """Yield the test of the residuals against the noise."""
    for name, value in (("chi-square", chi_square), ("degrees of freedom", dof), ("p-value", p_value)):
        if value is not None:
            yield Fact(name, value, None, "", "residuals")


def fact_of_size(name: str, size: float, unit: str, group: Group, of: str = "") -> Fact:
    """Return the size of a noise or of a shared error, in its unit of display."""
    factor, shown = SHOWN.get(unit, (1.0, unit))
    return Fact(name, factor * size, None, shown, group, of)


def about_axes(std: Array, of: str) -> Iterator[Fact]:
    """Yield the standard deviations of a pose along and about the axes of its parent; ``std`` (6,): rad and m."""
    for names, unit, sizes in (
        ("along", "mm", MM_PER_M * std[3:]),
        ("about", "deg", DEG_PER_RAD * std[:3]),
    ):
        for axis, size in zip("xyz", sizes.tolist(), strict=True):
            yield Fact(f"{names} {axis}", size, None, unit, "axis", of)


def _points_ahead(result: Statement, accuracy: Accuracy) -> Iterator[Fact]:
    """Yield what X adds to points straight ahead of the camera, the second of them at the distance of the target."""
    if result.reasons or result.opened is not None:
        return
    for step in STEPS_AHEAD:
        z = step * accuracy.distance
        one, within = (accuracy.point, accuracy.point_95) if step == 1 else point_ahead(result, z)
        yield fact_of_point(z, one, within)


def fact_of_point(distance: float, sd: float, within: float, whose: str = "") -> Fact:
    """Return the error of a point straight ahead of a camera (m)."""
    of = f"{fixed(distance)} m{whose}"
    return Fact("point, worst direction", MM_PER_M * sd, None, "mm", "point ahead", of, MM_PER_M * within)


def noise_per_axis(S: Array | JointCovariance) -> Array:
    """Return the standard deviations (2,) of rotation (rad) and translation (m) of the noise of single poses, on
    average over axes and poses.
    """
    blocks = S.own if isinstance(S, JointCovariance) else marginals(S)
    variances = np.diagonal(blocks, axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
    return np.asarray(np.sqrt(variances))


def _facts(result: Statement) -> Iterator[Fact]:
    """Yield the facts of one camera in their order."""
    accuracy = result.accuracy
    if accuracy is not None:
        within = accuracy.rotation_95, accuracy.translation_95
        yield from sizes_of_errors(accuracy.rotation, accuracy.translation, result.frame, within, "accuracy")
        yield from _points_ahead(result, accuracy)
    for frame, T, S, opened in (
        (result.frame, result.X, result.covariance, result.open_of_X),
        (result.frame_W, result.W, result.covariance_W, result.open_of_W),
    ):
        if T is not None:
            yield from numbers_of(T, S, opened, frame)
        if T is not None and S is not None:
            of = EstimatedPose("", frame, T, S, np.zeros((0, 6)) if opened is None else opened)
            yield from sizes_of_errors(*of.sizes, frame)
    if result.std is not None:
        yield from about_axes(result.std, result.frame)
    yield from facts_of_poses({one.name: one for one in result.split}, result.reference)
    if (fit := result.fit) is not None:
        yield from facts_of_residuals(fit.chi2, fit.dof, fit.p_value)
    for side in SIDES if result.noise_estimate is None else ():
        if (S := getattr(result.noise, side, None)) is not None:
            turn, shift = noise_per_axis(S).tolist()
            yield from sizes_of_errors(turn, shift, side.value, None, "noise")
    for part in () if result.noise_estimate is None else result.noise_estimate.components:
        yield fact_of_size(part.name, part.size, part.unit, "noise")
    for error in result.shared:
        factor, unit = SHOWN.get(error.unit, (1.0, error.unit))
        yield Fact(error.name, factor * error.estimate, factor * error.sd, unit, "shared error", error.name)


def facts_of_rig(
    cameras: Sequence[EstimatedPose],
    ahead: Mapping[str, PointAhead],
    poses: Mapping[str, EstimatedPose],
    reference: Reference,
    residuals: tuple[float, float, float],
    noise: Mapping[str, tuple[float, float]],
    errors: Sequence[Mapping[str, Any]],
) -> Facts:
    """Return the facts of several cameras, targets and arms.

    ``ahead``: a point ahead of each camera, by its name. ``poses``: all of them by frame, the cameras too, and by name
    those before and after a move. ``residuals``: chi-square, its degrees of freedom, and the p-value. ``noise``:
    standard deviations (rad, m) by arm and camera. ``errors``: sizes that were estimated.
    """
    found: list[Fact] = []
    for one in cameras:
        found += sizes_of_errors(*one.sizes, one.frame, within_95(one, reference), "accuracy")
    for name, point in ahead.items():
        found.append(fact_of_point(point.distance, point.sd, point.within_95, f" of {name}"))
    found += facts_of_poses(poses, reference)
    for one in cameras:
        found += about_axes(one.std, one.frame)
    found += facts_of_residuals(*residuals)
    for name, (turn, shift) in noise.items():
        found += sizes_of_errors(turn, shift, name, None, "noise")
    found += [fact_of_size(one["name"], one["size"], one["unit"], "shared error", one["name"]) for one in errors]
    return Facts(tuple(found))


def facts_of(result: Statement) -> Facts:
    """Return the facts of a calibration of one camera."""
    correlation, limit = result.correlation, result.quantile(INTERVAL.probability)
    parent, _, child = result.frame.partition("_T_") if "_T_" in result.frame else (UNKNOWN_FRAME, "", "")
    pairs = [] if correlation is None else [(i, j) for i in range(6) for j in range(i + 1, 6)]
    found = [(float(correlation[i, j]), COMPONENTS[i], COMPONENTS[j]) for i, j in pairs if correlation is not None]
    source = _SOURCES[result.covariance_kind]
    if result.noise_estimate is not None and result.covariance_kind == "model":
        source = "the noise estimated"
    ellipsoid = f"There is no 95 % ellipsoid from so few poses ({result.reference})."
    if np.isfinite(limit):
        ellipsoid = f"95 % of all errors lie within d^2 = {limit:.1f} ({result.reference})."
    return Facts(
        tuple(_facts(result)),
        parent=f"{parent} frame" if child else parent,
        subject=f"{child} in the {parent} frame" if child else "",
        directions=() if result.opened is not None else _directions(result, parent),
        correlations=tuple(sorted(found, key=lambda pair: -abs(pair[0]))),
        ellipsoid=ellipsoid,
        source=source,
        frames=(result.frame, result.frame_W),
    )


def _directions(result: Estimated, parent: str) -> tuple[str, ...]:
    """The least certain directions of translation and of rotation, in words; nothing without a covariance."""
    if result.covariance is None:
        return ()
    sentences = []
    for name, part, factor in (("translation", slice(3, 6), 1e3), ("rotation", slice(0, 3), 180 / np.pi)):
        sd, axes = principal_axes(result.covariance[part, part])
        text = direction_words(name, factor * sd[0], factor * sd[-1], axes[0], parent)
        sentences.append(f"{text[0].upper()}{text[1:]}.")
    return tuple(sentences)
