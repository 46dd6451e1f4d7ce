"""Ten views to start a session with.

They look at the middle of the board from one hemisphere, tilted by up to 30 deg about different axes and turned about
the line of sight, at about twice the board's diagonal: rotations about three axes, of 60 to 180 deg between poses, and
depths that differ. They are views, ``camera_T_target``; a path of the arm to each is left to the user.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array

# Tilt and its direction, turn about the line of sight (deg), distance over the usual one.
VIEWS = (
    (0, 0, 0, 1.0), (30, 0, 0, 1.0), (30, 90, 60, 1.1), (30, 180, -60, 0.9), (30, 270, 90, 1.0),
    (0, 0, 90, 0.8), (25, 45, -90, 1.2), (25, 135, 30, 0.9), (25, 225, -30, 1.1), (25, 315, 120, 1.0),
)  # fmt: skip


def starting_views(distance: float = 0.5) -> Array:
    """Return ten views camera_T_target (10, 4, 4) that see the middle of the board from a distance (m)."""
    views = np.tile(np.eye(4), (len(VIEWS), 1, 1))
    for k, (tilt, about, turn, far) in enumerate(VIEWS):
        axis = np.radians(tilt) * np.array([np.cos(np.radians(about)), np.sin(np.radians(about)), 0.0])
        facing = Rotation.from_rotvec([np.pi, 0.0, 0.0])  # the board's z towards the camera
        views[k, :3, :3] = (
            Rotation.from_euler("z", turn, degrees=True) * Rotation.from_rotvec(axis) * facing
        ).as_matrix()
        views[k, :3, 3] = 0.0, 0.0, far * distance
    return views
