"""Choice of the elbow angle of an arm of seven axes, which poses do not determine, within the joint limits."""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array
from .chain import Kinematics
from .newton import Postures, postures_at

# Largest change of a joint from one pose to its neighbour in the same branch of the inverse kinematics.
MAX_JOINT_CHANGE_RAD = 1.5


def relaxed(
    kinematics: Kinematics,
    poses: Array,
    found: Postures,
    *,
    share: float = 0.7,
    longest_rad: float = 0.4,
    shortest_rad: float = 0.05,
) -> Postures:
    """Move the elbow of seven axes along the motion that leaves the pose as it is, towards the middle of the limits.

    The sum of squares of the joints about the middle of their limits, in half ranges, falls by a few steps, each a
    ``share`` of a full one. Joints far from their median over the poses are solved from the medians first.
    """
    low, high = kinematics.limits.T
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    if not np.isfinite(half).all():
        return found
    q, reached = found.q.copy(), found.reached.copy()
    usual = np.median(q[reached], axis=0) if reached.any() else middle
    folded = np.flatnonzero(
        np.abs(q - usual).max(axis=1) > MAX_JOINT_CHANGE_RAD
    )  # perhaps the other way than the others
    if folded.size:
        again = postures_at(kinematics, poses[folded], np.tile(usual, (folded.size, 1)))
        nearer = again.reached & (np.abs(again.q - usual).max(axis=1) < np.abs(q[folded] - usual).max(axis=1))
        q[folded[nearer]], reached[folded[nearer]] = again.q[nearer], True
    far = (((q - middle) / half) ** 2).sum(axis=-1)
    for _ in range(6):
        along = np.linalg.svd(kinematics.jacobian(q))[2][..., -1, :]
        slope = ((q - middle) / half**2 * along).sum(axis=-1) / (along**2 / half**2).sum(axis=-1)
        step = np.clip(-share * slope, -longest_rad, longest_rad)
        again = postures_at(kinematics, poses, q + step[:, None] * along)
        farther = (((again.q - middle) / half) ** 2).sum(axis=-1)
        good = reached & again.reached & (farther < far)  # a step may end at a posture on another side
        q[good], far[good] = again.q[good], farther[good]
        if not good.any() or np.abs(step[good]).max() < shortest_rad:
            break
    return Postures(q, reached)


def elbow_moved(kinematics: Kinematics, poses: Array, q: Array, angle: float, steps: int = 3) -> tuple[Array, Array]:
    """Return joint values (n, L) at the same poses (n, 4, 4) with the elbow of seven axes turned either way.

    ``angle`` (rad) along the joints, in several steps; less where limits or reach allow no more.
    """
    ways = []
    for step in (angle / steps, -angle / steps):
        at, along = q, np.linalg.svd(kinematics.jacobian(q))[2][..., -1, :]
        for _ in range(steps):
            found = postures_at(kinematics, poses, at + step * along)
            at = np.where(found.reached[:, None], found.q, at)
            now = np.linalg.svd(kinematics.jacobian(at))[2][..., -1, :]
            along = now * np.where((now * along).sum(axis=-1) < 0, -1.0, 1.0)[:, None]  # the same way round
        ways.append(at)
    return ways[0], ways[1]
