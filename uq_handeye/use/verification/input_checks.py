"""Misreadings of touches: millimetres that were taken for metres, and metres for millimetres."""

from __future__ import annotations

import numpy as np

from ...calibration.evidence.state import Calibrated
from ...calibration.evidence.touches import Touches
from ...core.geometry.se3 import Array
from ...errors import InputError
from ...model.poses.pose_pairs import PosePairs

# A length that differs from those of the calibration by more than this factor has another unit.
_ANOTHER_UNIT = 50.0
# Lengths (m) of a camera and of a robot of which nothing is known.
_CAMERA, _ROBOT = 0.7, 0.8


def require_metres(result: Calibrated, touches: Touches) -> None:
    """Raise `InputError` where lengths are some hundred times those of the calibration, or so much smaller."""
    data = result.counted if isinstance(result.counted, PosePairs) else None
    camera = _CAMERA if data is None else _size(data.camera[:, :3, 3])
    robot = _ROBOT if data is None else _size(data.robot[:, :3, 3])
    distances = {
        "points that the camera saw": (touches.seen if touches.board is None else None, camera),
        "poses of the board": (None if touches.board is None else touches.board[:, :3, 3], camera),
        "points touched": (touches.touched, robot),
        "robot poses at which the points were seen": (_translations(touches.robot), robot),
        "robot poses at the touch": (_translations(touches.touched_robot), robot),
    }
    for what, (values, usual) in distances.items():
        if values is None:
            continue
        size = _size(values)
        if size > _ANOTHER_UNIT * usual:
            _refuse(what, size, usual, "mm", "Give --units mm, or divide by 1000.")
        if 0 < size * _ANOTHER_UNIT < usual:
            _refuse(what, size, usual, "m, read as mm", "Give --units m.")


def _refuse(what: str, size: float, usual: float, unit: str, do: str) -> None:
    raise InputError(
        f"The {what} lie {size:.3g} m away (median), those of the calibration {usual:.2g} m: they seem to be in "
        f"{unit}. {do}"
    )


def _size(points: Array) -> float:
    return float(np.median(np.linalg.norm(points, axis=-1)))


def _translations(poses: Array | None) -> Array | None:
    return None if poses is None else poses[:, :3, 3]
