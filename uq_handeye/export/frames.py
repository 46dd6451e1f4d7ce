"""Frames by name, quaternion and angles about fixed axes of a pose, for every export."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from ..formats.opencv_storage import yaml_number
from ..geometry.conventions import to_convention
from ..geometry.se3 import Array, inverse_jacobian
from ..runtime.read_only import ReadOnlyArrays

# The frames of X for motions that came without poses: those in which A and B are given.
OF_MOTIONS = ("frame_of_A", "frame_of_B")

# Standard deviation (m) along open directions in formats that have no infinity.
OPEN_DEVIATION = 1e3

NOT_DETERMINED = "The covariance is not determined, so it is left out."


class Opened(Protocol):
    """Interface of `OpenDirections`, as far as it is read."""

    @property
    def of_X(self) -> Array: ...
    @property
    def basis(self) -> Array: ...
    @property
    def lever(self) -> float: ...


class Exportable(Protocol):
    """Interface of a `Calibration`, as far as it is read."""

    @property
    def setup(self) -> str | None: ...
    @property
    def frame(self) -> str: ...
    @property
    def frame_W(self) -> str: ...
    @property
    def X(self) -> Array: ...
    @property
    def covariance(self) -> Array | None: ...
    @property
    def inverse(self) -> Array: ...
    @property
    def covariance_inverse(self) -> Array | None: ...
    @property
    def W(self) -> Array | None: ...
    @property
    def covariance_W(self) -> Array | None: ...
    @property
    def opened(self) -> Opened | None: ...
    @property
    def open_words(self) -> tuple[str, ...]: ...
    def to_json(self) -> str: ...


@dataclass(frozen=True, eq=False)
class Transform(ReadOnlyArrays):
    """``T = parent_T_child`` (4, 4), metres, with the covariance (6, 6) of (theta, tau) in the parent frame."""

    T: Array
    covariance: Array | None
    parent: str
    child: str

    @property
    def name(self) -> str:
        """``parent_T_child``."""
        return f"{self.parent}_T_{self.child}"

    @property
    def R(self) -> Array:
        return np.asarray(self.T[:3, :3])

    @property
    def t(self) -> Array:
        return np.asarray(self.T[:3, 3] + 0.0)

    @property
    def quaternion(self) -> Array:
        """Unit quaternion (x, y, z, w), w >= 0."""
        return np.asarray(Rotation.from_matrix(self.R).as_quat(canonical=True) + 0.0)

    def covariance_in(self, convention: str) -> Array | None:
        """The covariance in the convention of another library (`conventions`)."""
        return None if self.covariance is None else to_convention(self.covariance, self.T, convention) + 0.0


def transforms_of(result: Exportable) -> tuple[Transform, Transform]:
    """X and its inverse."""
    parent, child = OF_MOTIONS if result.setup is None else result.frame.split("_T_")
    covariance, of_inverse = result.covariance, result.covariance_inverse
    if covariance is not None and result.opened is not None:
        U = result.opened.of_X
        covariance = covariance + OPEN_DEVIATION**2 * (U.T @ U)
        J = inverse_jacobian(result.X)
        of_inverse = J @ covariance @ J.T
    return (
        Transform(result.X + 0.0, covariance, parent, child),
        Transform(result.inverse + 0.0, of_inverse, child, parent),
    )


def open_comments(result: Exportable) -> list[str]:
    """Return the comments of an export about open directions; none where there are none."""
    if result.opened is None:
        return []
    return [
        f"Open, not determined by the motions: {'; '.join(result.open_words)}.",
        f"Along these the covariance has a standard deviation of {OPEN_DEVIATION:g} m (angles: times "
        f"{result.opened.lever:.3g} m), which stands for infinity.",
    ]


def fixed_axis_angles(R: Array) -> Array:
    """Roll, pitch, yaw (rad) about the fixed axes x, y, z: ``R = Rz(yaw) Ry(pitch) Rx(roll)``, the ``rpy`` of URDF.

    Roll is taken from ``Rz(yaw)^T R`` and so makes up for a yaw that is not determined: at a pitch of 90 degrees, and
    arbitrarily near to it, the three angles give R back to rounding.

    >>> fixed_axis_angles(np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])).round(3).tolist()
    [0.0, 1.571, 0.0]
    """
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    yaw = np.arctan2(R[1, 0], R[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw]) + 0.0


def yaml_fields(axes: str, values: Array, digits: int = 17) -> str:
    """``{x: 1.0, y: 2.0, z: 3.0}``."""
    fields = (f"{axis}: {yaml_number(value, digits)}" for axis, value in zip(axes, values, strict=True))
    return f"{{{', '.join(fields)}}}"
