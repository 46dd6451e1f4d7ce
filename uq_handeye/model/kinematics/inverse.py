r"""Joint values at which the tip of an arm is at given poses: damped Newton, many postures at once, inside the limits.

Each step solves ``min |r - J d|^2 + damping^2 |d|^2`` for the twist r from the pose of the tip to the one wanted, with
lengths over `LENGTH` of the arm's reach so that they count as angles do, at most `LONGEST` rad (m) per joint, and is
cut off at the joint limits. There is no search beyond that: a posture that does not reach its pose is told, and of
several postures that do, it is one near the start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...core.geometry.se3 import Array
from .chain import Kinematics

STEPS = 40
LONGEST = 0.5
LENGTH = 0.5
DAMPING = 1e-2  # in the first step; it follows the size of the twist that is left
REACHED = 1e-8  # rad, and of the reach


class Postures(NamedTuple):
    """Joint values found."""

    q: Array  # (m, L) rad, m; inside the limits
    reached: NDArray[np.bool_]  # (m,) whether the tip is at the pose that was wanted


def postures_at(chain: Kinematics, poses: Array, start: Array, e: Array | None = None) -> Postures:
    """Return postures (m, L) near ``start`` (m, L) whose tip is at ``poses`` (m, 4, 4) base_T_tip, errors e (m,)."""
    low, high = chain.limits.T
    q, scale = np.clip(start, low, high), LENGTH * max(chain.reach, 1e-3)
    weights = np.array([1.0, 1.0, 1.0, *[1.0 / scale] * 3])
    reached = np.zeros(len(q), dtype=bool)
    open_ = np.arange(len(q))
    for _ in range(STEPS):
        T = chain.poses(q[open_], e)
        left = twist_between(T, poses[open_]) * weights
        size = np.linalg.norm(left, axis=-1)
        reached[open_[size < REACHED]] = True
        open_, left, size = open_[size >= REACHED], left[size >= REACHED], size[size >= REACHED]
        if not len(open_):
            break
        J = chain.jacobian(q[open_], e) * weights[:, None]
        damping = (DAMPING * np.minimum(size, 1.0)) ** 2
        step = J.mT @ np.linalg.solve(J @ J.mT + (damping + 1e-14)[:, None, None] * np.eye(6), left[..., None])
        longest = np.abs(step[..., 0]).max(axis=-1, keepdims=True)
        q[open_] = np.clip(q[open_] + step[..., 0] * np.minimum(1.0, LONGEST / np.maximum(longest, LONGEST)), low, high)
    return Postures(q, reached)


def twist_between(T: Array, wanted: Array) -> Array:
    """(m, 6) from T to the poses wanted: left rotation, additive translation."""
    turn = Rotation.from_matrix(wanted[:, :3, :3] @ T[:, :3, :3].mT).as_rotvec()
    return np.concatenate([turn, wanted[:, :3, 3] - T[:, :3, 3]], axis=-1)
