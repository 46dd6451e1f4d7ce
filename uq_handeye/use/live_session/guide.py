"""Guidance: ten poses to start with, and when further poses hardly help.

The ten views look at the middle of the board from one hemisphere, tilted by up to 30 deg about different axes and
turned about the line of sight, at about twice the board's diagonal: rotations about three axes, of 60 to 180 deg
between poses, and depths that differ. They are views, ``camera_T_target``: how the arm gets there, the user knows.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.geometry.se3 import Array
from .question import Answer

# Tilt and its direction, turn about the line of sight (deg), distance over the usual one.
VIEWS = (
    (0, 0, 0, 1.0), (30, 0, 0, 1.0), (30, 90, 60, 1.1), (30, 180, -60, 0.9), (30, 270, 90, 1.0),
    (0, 0, 90, 0.8), (25, 45, -90, 1.2), (25, 135, 30, 0.9), (25, 225, -30, 1.1), (25, 315, 120, 1.0),
)  # fmt: skip
# Distance (m) where nothing is known of the board; poses ahead, and the gain below which they hardly help.
DISTANCE, AHEAD, HARDLY = 0.5, 5, 0.10


def starting_views(distance: float = DISTANCE) -> Array:
    """Return ten views camera_T_target (10, 4, 4) from which the camera sees the middle of the board."""
    views = np.tile(np.eye(4), (len(VIEWS), 1, 1))
    for k, (tilt, about, turn, far) in enumerate(VIEWS):
        axis = np.radians(tilt) * np.array([np.cos(np.radians(about)), np.sin(np.radians(about)), 0.0])
        facing = Rotation.from_rotvec([np.pi, 0.0, 0.0])  # the board's z towards the camera
        views[k, :3, :3] = (
            Rotation.from_euler("z", turn, degrees=True) * Rotation.from_rotvec(axis) * facing
        ).as_matrix()
        views[k, :3, 3] = 0.0, 0.0, far * distance
    return views


def words(answer: Answer) -> str:
    """Return what to do next in one sentence; nothing where the answer says it already."""
    if answer.n == 0:
        return (
            f"Start with ten poses like those in the picture: the board in the middle, at about twice its diagonal, "
            f"tilted by up to {max(view[0] for view in VIEWS)} deg to each side, and turned about the line of sight."
        )
    if answer.passed:
        return "The tolerance is shown to be met: you can finish."
    if enough(answer):
        return f"Enough poses: {AHEAD} more would gain less than {100 * HARDLY:.0f} %."
    return ""


def enough(answer: Answer) -> bool:
    """Return whether `AHEAD` more poses would gain less than `HARDLY`.

    None of them gains more than the next one, g, so together at most ``1 - (1 - g)^5``; a lower bound of a
    gain says nothing.
    """
    ahead = answer.ahead
    if ahead is None or ahead.least or not np.isfinite(gain := ahead.gain):
        return False
    return 1.0 - (1.0 - max(gain, 0.0)) ** AHEAD < HARDLY
