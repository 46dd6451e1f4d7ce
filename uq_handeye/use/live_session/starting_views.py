"""Ten views to start a session with.

They look at the middle of the board from one hemisphere, tilted by up to 30 deg about different axes and turned about
the line of sight, at about twice the board's diagonal: rotations about three axes, of 60 to 180 deg between poses, and
depths that differ. They are views, ``camera_T_target``; a path of the arm to each is left to the user.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array

# Tilt and its direction, turn about the line of sight (deg), distance from the middle of the board (m).
VIEWS = (
    (0, 0, 0, 0.5), (30, 0, 0, 0.5), (30, 90, 60, 0.55), (30, 180, -60, 0.45), (30, 270, 90, 0.5),
    (0, 0, 90, 0.4), (25, 45, -90, 0.6), (25, 135, 30, 0.45), (25, 225, -30, 0.55), (25, 315, 120, 0.5),
)  # fmt: skip


def starting_views() -> Array:
    """Return ten views camera_T_target (10, 4, 4) that see the middle of the board."""
    views = np.tile(np.eye(4), (len(VIEWS), 1, 1))
    for k, (tilt, about, turn, distance) in enumerate(VIEWS):
        axis = np.radians(tilt) * np.array([np.cos(np.radians(about)), np.sin(np.radians(about)), 0.0])
        facing = Rotation.from_rotvec([np.pi, 0.0, 0.0])  # the board's z towards the camera
        views[k, :3, :3] = (
            Rotation.from_euler("z", turn, degrees=True) * Rotation.from_rotvec(axis) * facing
        ).as_matrix()
        views[k, :3, 3] = 0.0, 0.0, distance
    return views
