r"""Errors of what a camera measures: a length, a plane and a point, by the calibration and by the measurement itself.

The target of the measurement is a square of the side L, at the distance d ahead of the camera and across its view. Its
corners have the pixel noise s, the focal length is f (pixels).

- *Point* of a plane whose place the robot knows, in the base: the calibration moves it as `predict` says, at the
  calibrated poses; the measurement by ``s d / f`` along each of the two axes across the view.
- *Length* L of that plane between two such points: relative errors of the focal length, of the scale of the target, and
  of the distance, which is off by the error of X along the view; the measurement adds ``sqrt(2) s d / f``.
- *Plane* of a board of that side: its normal is off by the rotation of X across the view, its place along the view by
  the error of a point there; the measurement by the pose that the four corners determine, ``(B^T B)^-1 (s / f)^2``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.files.records import Record
from ...core.geometry.se3 import skew
from ...core.presentation.document import Document, Heading, Paragraph, Table, document_of
from ...core.presentation.numbers import digits
from ...core.presentation.shown import Shown
from ...core.presentation.units import parse_length, parse_pixels
from ...errors import InputError
from ...model.errors.keys import CAMERA_SCALE, FOCAL_LENGTH, TARGET_SCALE
from .predict import posterior_of, predict_points

if TYPE_CHECKING:
    from ..estimated import Estimated


@dataclass(frozen=True)
class TaskPart(Record):
    """One measured quantity: its standard deviations by the calibration and by the measurement, m or rad."""

    quantity: str
    unit: str  # "m" or "rad"
    calibration: float
    measurement: float

    @property
    def total(self) -> float:
        """Standard deviation of both together."""
        return float(np.hypot(self.calibration, self.measurement))


@dataclass(frozen=True, repr=False)
class TaskErrors(Record, Shown):
    """Errors of a length, a plane and a point that the camera measures; see the module."""

    length: float  # m
    distance: float  # m
    pixel_noise: float  # px
    focal_length: float  # px
    parts: tuple[TaskPart, ...]

    def __getitem__(self, quantity: str) -> TaskPart:
        """Return the part of a quantity: "point", "length", "plane angle" or "plane distance"."""
        return next(part for part in self.parts if part.quantity == quantity)

    def __repr__(self) -> str:
        said = ", ".join(f"{part.quantity} {_shown(part, part.total)}" for part in self.parts)
        return f"TaskErrors({said}; 1 sigma)"


def predict_task(
    result: Estimated,
    length: float | str,
    at: float | str,
    pixel_noise: float | str,
    focal_length: float | str | None = None,
) -> TaskErrors:
    """See `Calibration.predict_task`."""
    side, distance = parse_length(length, "`length`"), parse_length(at, "`at`")
    noise, f = parse_pixels(pixel_noise, "`pixel_noise`"), _focal_length(result, focal_length)
    for name, value in (("length", side), ("at", distance), ("focal_length", f)):
        if not 0 < value < np.inf:
            raise InputError(f"Expected `{name}` to be above 0 and finite, got {value:g}.")
    if not 0 <= noise < np.inf:
        raise InputError(f"Expected `pixel_noise` to be 0 or above and finite, got {noise:g}.")
    posterior_of(result)
    poses = None if result.counted is None else result.counted.poses
    if result.setup == "eye-in-hand" and poses is None:
        raise InputError("Expected a result with its poses: the error of a point depends on them. Calibrate again.")
    robot = None if poses is None or result.setup != "eye-in-hand" else poses.robot
    found = predict_points(result, [0.0, 0.0, distance], robot=robot)
    view = result.X[:3, 2] if robot is None else robot[:, :3, :3] @ result.X[:3, 2]
    along = float(np.mean(np.einsum("...i,...ij,...j->...", view, found.covariance, view)))
    point = float(np.mean(np.trace(found.covariance, axis1=-2, axis2=-1)))
    assert result.covariance is not None
    across = np.eye(3) - np.outer(result.X[:3, 2], result.X[:3, 2])
    angle = float(np.trace(across @ result.covariance[:3, :3] @ across))
    relative = _relative_variance(result, focal_length is None)
    ray = noise / f
    by_corners = _square_pose(side, distance) * ray**2
    parts = (
        TaskPart("point", "m", float(np.sqrt(point)), float(np.sqrt(2.0)) * ray * distance),
        TaskPart(
            "length", "m", side * float(np.sqrt(relative + along / distance**2)), float(np.sqrt(2.0)) * ray * distance
        ),
        TaskPart("plane angle", "rad", float(np.sqrt(angle)), float(np.sqrt(by_corners[0, 0] + by_corners[1, 1]))),
        TaskPart("plane distance", "m", float(np.sqrt(along)), float(np.sqrt(by_corners[5, 5]))),
    )
    return TaskErrors(side, distance, noise, f, parts)


def _focal_length(result: Estimated, given: float | str | None) -> float:
    if given is not None:
        return parse_pixels(given, "`focal_length`")
    poses = None if result.data is None else result.data.poses
    seen = None if poses is None else poses.camera_calibration
    if seen is None:
        raise InputError(
            "The focal length of the camera is not in this result, whose camera poses come from another program. Give "
            "it in pixels: --focal-length 1000px (`focal_length`)."
        )
    return 0.5 * (seen.intrinsics["fx"] + seen.intrinsics["fy"])


def _relative_variance(result: Estimated, of_corners: bool) -> float:
    """Variance of the logarithm of a length by focal length and scale."""
    known = {FOCAL_LENGTH, TARGET_SCALE, CAMERA_SCALE}
    variance = sum(float(error.sd) ** 2 for error in result.shared if error.key in known)
    poses = None if result.data is None else result.data.poses
    if of_corners and poses is not None and (seen := poses.camera_calibration) is not None:
        f = 0.5 * (seen.intrinsics["fx"] + seen.intrinsics["fy"])
        variance += (seen.std.get("fx", 0.0) / f) ** 2
    return variance


def _square_pose(side: float, distance: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """(6, 6) covariance of the pose of a square across the view, per square of the noise of its directions (rad)."""
    half = 0.5 * side
    corners = np.array([[x, y, 0.0] for x in (-half, half) for y in (-half, half)])
    by_point = np.zeros((4, 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = 1.0 / distance
    by_point[:, :, 2] = -corners[:, :2] / distance**2
    B = np.concatenate([-by_point @ skew(corners), by_point], axis=-1).reshape(8, 6)
    return np.asarray(np.linalg.inv(B.T @ B))


def _shown(part: TaskPart, value: float) -> str:
    return f"{digits(1e3 * value, 2)} mm" if part.unit == "m" else f"{digits(np.degrees(value), 2)} deg"


@document_of.register(TaskErrors)
def task_document(task: TaskErrors) -> Document:
    """Return a table of the quantities, split into calibration and measurement."""
    about = (
        f"A square of {digits(1e3 * task.length, 4)} mm across the view, {digits(task.distance, 4)} m ahead, "
        f"corners to {digits(task.pixel_noise, 2)} px at a focal length of "
        f"{digits(task.focal_length, 4)} px. Standard deviations "
        "(1 sigma): point and plane in the base frame, length on a plane whose place the robot knows."
    )
    rows = [[part.quantity, *(_shown(part, x) for x in (part.calibration, part.measurement, part.total))]
            for part in task.parts]  # fmt: skip
    head = ["measured", "by the calibration", "by the measurement", "total"]
    return [[Heading("Error of the task"), Paragraph(about)], [Table("", head, rows, named=False)]]
