"""The accuracy of a robot, as its data sheet states it: the errors that a population of arms has (`population`).

A data sheet's accuracy is read as the root mean square, over the workspace, of the distance (and of the angle) between
the pose commanded and the one attained, once the frames of base and tool are aligned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.formatting.units import parse_angle, parse_length
from ...core.geometry.se3 import Array
from ...errors import InputError

ROBOT_ACCURACY = "robot accuracy"


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


def reach_of(poses: Array) -> float:
    """Largest distance (m) of the flange from the base among the poses."""
    return float(np.linalg.norm(poses[:, :3, 3], axis=-1).max())


def stated_accuracy(translation: float | str, rotation: float | str | None) -> tuple[float, float]:
    """Accuracy of position and orientation (m, rad) of two values, or of a text with both; raises `InputError`."""
    if rotation is None:
        parts = [part.strip() for part in translation.split(",")] if isinstance(translation, str) else []
        if len(parts) != 2:
            raise InputError(
                f"Expected the {ROBOT_ACCURACY} to be a length and an angle, such as '0.5mm,0.05deg', got "
                f"{translation!r}."
            )
        translation, rotation = parts
        if any(part.endswith(("deg", "rad")) for part in [translation]):  # the other way round
            translation, rotation = rotation, translation
    move = parse_length(translation, f"the translation of the {ROBOT_ACCURACY}")
    turn = parse_angle(rotation, f"the rotation of the {ROBOT_ACCURACY}")
    if not (0 <= move < np.inf and 0 <= turn < np.inf):
        raise InputError(f"Expected the {ROBOT_ACCURACY} to be finite and >= 0, got {translation!r}, {rotation!r}.")
    return move, turn
