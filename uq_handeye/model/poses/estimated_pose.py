"""`EstimatedPose`: an estimated pose of a camera, a target or the base of an arm, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core.files.json_values import JsonObject
from ...core.files.records import array_of, damaged
from ...core.geometry.pose_numbers import principal_axes
from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays

NO_ROWS = np.zeros((0, 6))
# Rotation and translation among the components of an error.
PARTS = (slice(0, 3), slice(3, 6))


@dataclass(frozen=True, eq=False)
class EstimatedPose(ReadOnlyArrays):
    """A pose with its covariance: of ``xi = (theta, tau)``, left rotation, additive translation, rad and m.

    ``open`` (k, 6): directions that the views leave open; the covariance is 0 along them.
    """

    name: str
    frame: str  # such as gripper_T_camera
    pose: Array  # (4, 4)
    covariance: Array  # (6, 6)
    open: Array = field(default_factory=lambda: NO_ROWS)
    count: int = 0  # views

    @property
    def X(self) -> Array:
        """The pose of a camera (4, 4): on its arm or in the world."""
        return self.pose

    @property
    def W(self) -> Array:
        """The pose of a target (4, 4)."""
        return self.pose

    @property
    def base(self) -> Array:
        """The base of an arm (4, 4) in the base of the first."""
        return self.pose

    @property
    def std(self) -> Array:
        """(6,) standard deviations, infinite where a direction is open."""
        found = np.sqrt(np.diag(self.covariance))
        moved = (np.abs(self.open) > 1e-9).any(axis=0) if len(self.open) else np.zeros(6, dtype=bool)
        return np.where(moved, np.inf, found)

    @property
    def sizes(self) -> tuple[float, float]:
        """Standard deviations in the worst direction, of rotation (rad) and translation (m); infinite where open."""
        turn, shift = (principal_axes(self.covariance[part, part])[0][0] for part in PARTS)
        turn_known, shift_known = (bool(np.isfinite(self.std[part]).all()) for part in PARTS)
        return float(turn) if turn_known else np.inf, float(shift) if shift_known else np.inf

    @classmethod
    def from_dict(cls, data: Any) -> EstimatedPose:
        """Read what `to_dict` writes; raises `InputError` on anything else."""
        with damaged("A pose"):
            name, frame, count = str(data["name"]), str(data["frame"]), int(data["views"])
            pose, covariance = (array_of(data[key], (k, k), key) for key, k in (("pose", 4), ("covariance", 6)))
            rows = data.get("open", [])
            return cls(
                name, frame, pose, covariance, array_of(rows, (len(rows), 6), "open") if rows else NO_ROWS, count
            )

    def to_dict(self) -> JsonObject:
        """Plain numbers."""
        return {
            "name": self.name, "frame": self.frame, "pose": self.pose.tolist(), "covariance": self.covariance.tolist(),
            **({"open": self.open.tolist()} if len(self.open) else {}), "views": self.count,
        }  # fmt: skip
