r"""Postures of a chain at given poses, by damped Newton steps of many postures at once inside the joint limits.

Each step solves ``min |r - J d|^2 + damping^2 |d|^2`` for the twist r from the pose of the tip to the one wanted, with
lengths over `LEVER_SHARE` of the arm's reach so that they count as angles do. No joint moves by more than a largest
step, and a step is cut off at the joint limits. There is no further search: a posture that does not reach its pose is
marked as such, and of several postures that do, the result is one near the start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...core.rounding import HALF_DIGITS, PRODUCT_ROUNDING
from .chain import Kinematics
from .stack import LEVER_SHARE


class Postures(NamedTuple):
    """Joint values found."""

    q: Array  # (m, L) rad, m; inside the limits
    reached: NDArray[np.bool_]  # (m,) whether the tip is at the pose that was wanted


def postures_at(
    chain: Kinematics,
    poses: Array,
    start: Array,
    e: Array | None = None,
    *,
    max_steps: int = 40,
    longest: float = 0.5,
    damping: float = 1e-2,
) -> Postures:
    """Return postures (m, L) near ``start`` (m, L) whose tip is at ``poses`` (m, 4, 4) base_T_tip, errors e (m,).

    ``longest`` (rad, m) is the largest change of a joint in one step, ``damping`` that of the first step; it follows
    the size of the twist.
    """
    low, high = chain.limits.T
    q, scale = np.clip(start, low, high), LEVER_SHARE * max(chain.reach, 1e-3)
    weights = np.array([1.0, 1.0, 1.0, *[1.0 / scale] * 3])
    reached = np.zeros(len(q), dtype=bool)
    moving = np.arange(len(q))
    for _ in range(max_steps):
        T = chain.poses(q[moving], e)
        left = twist_between(T, poses[moving]) * weights
        size = np.linalg.norm(left, axis=-1)
        near = size < HALF_DIGITS
        reached[moving[near]] = True
        moving, left, size = moving[~near], left[~near], size[~near]
        if not len(moving):
            break
        J = chain.jacobian(q[moving], e) * weights[:, None]
        ridge = (damping * np.minimum(size, 1.0)) ** 2 + PRODUCT_ROUNDING
        step = J.mT @ np.linalg.solve(J @ J.mT + ridge[:, None, None] * np.eye(6), left[..., None])
        size = np.abs(step[..., 0]).max(axis=-1, keepdims=True)
        q[moving] = np.clip(q[moving] + step[..., 0] * (longest / np.maximum(size, longest)), low, high)
    return Postures(q, reached)


def twist_between(T: Array, wanted: Array) -> Array:
    """(m, 6) from T to the poses wanted: left rotation, additive translation."""
    turn = Rotation.from_matrix(wanted[:, :3, :3] @ T[:, :3, :3].mT).as_rotvec()
    return np.concatenate([turn, wanted[:, :3, 3] - T[:, :3, 3]], axis=-1)
