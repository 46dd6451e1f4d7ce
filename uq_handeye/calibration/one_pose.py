"""One pose of several, for the formats of X: the camera or target that is chosen for an export."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.geometry.se3 import Array, inverse, inverse_jacobian
from ..core.read_only import ReadOnlyArrays
from ..formats.snippets import Open, with_open
from ..model.poses.estimated_pose import EstimatedPose


@dataclass(frozen=True, eq=False)
class OnePose(ReadOnlyArrays):
    """A pose with its covariance as `Exportable`; what moved has its own name without the moment."""

    one: EstimatedPose
    setup: str = "eye-in-hand"  # its frame says where it is
    W: Array | None = None
    covariance_W: Array | None = None
    opened: Open | None = None  # in the covariance
    open_words: Sequence[str] = ()
    intrinsics_words: str | None = None
    frame_W: str = ""

    @property
    def X(self) -> Array:
        """The pose (4, 4)."""
        return self.one.pose

    @property
    def inverse(self) -> Array:
        """Its inverse."""
        return np.asarray(inverse(self.one.pose))

    @property
    def covariance(self) -> Array:
        """(6, 6), large along directions that stay open."""
        return with_open(self.one.covariance, self.one.open)

    @property
    def covariance_inverse(self) -> Array:
        """(6, 6) of the inverse."""
        J = inverse_jacobian(self.one.pose)
        return np.asarray(J @ self.covariance @ J.T)

    @property
    def frame(self) -> str:
        """``parent_T_child`` in letters, digits and underscores."""
        return re.sub(r"[^A-Za-z0-9_]", "_", self.one.frame.partition("@")[0])

    def to_json(self) -> str:
        """Plain numbers as JSON."""
        return json.dumps(self.one.to_dict(), indent=2)
