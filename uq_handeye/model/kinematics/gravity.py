r"""The load that gravity puts on each joint, relative to the largest, and postures spread over the joint limits.

    raw_k(q) = -u . (z_k x sum_i (p_i - p_k))  revolute,     -u . z_k (number of i)  prismatic,     i = k + 1 .. L, tip
    g_k(q) = raw_k(q) / max |raw_k|

u is up, z_k the axis of joint k, p_i the origin of joint frame i: torque (force) of unit weights at the following
joint frames and at the tip, in the direction in which they move the joint. The divisor is that of the arm: the largest
value at `POSTURES` postures spread evenly over the joint limits. A joint that gravity cannot load has g = 0.

raw is minus the derivative of ``V = u . sum p_i`` by the joints, so that its derivative is symmetric:
``d raw_k / d q_j = -u . (z_j x s_k)`` for a revolute joint j <= k, 0 for a prismatic one, where s_k is the derivative
of ``sum p_i`` by q_k.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from .forward import Motion

POSTURES = 2048
# Half the range of joints without limits: rad, m.
HALF_TURN, HALF_RANGE = np.pi, 1.0


def spread_postures(limits: Array, revolute: NDArray[np.bool_], n: int = POSTURES) -> Array:
    """(n, L) joint values that fill the limits (L, 2) evenly, always the same ones.

    Additive recurrence with the generalised golden ratio: fractional parts of ``1/2 + i / r^j``, ``r^(L+1) = r + 1``.
    Joints without limits range over half a turn (1 m) to either side; with one limit, over a turn (2 m) from there.
    """
    L = len(limits)
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (L + 1))
    unit = (0.5 + np.arange(1, n + 1)[:, None] * ratio ** -np.arange(1.0, L + 1)) % 1.0
    half = np.where(revolute, HALF_TURN, HALF_RANGE)
    lower, upper = limits.T
    low = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2 * half, -half))
    high = np.where(np.isfinite(upper), upper, low + 2 * half)
    return np.asarray(low + unit * (high - low))


def shift_rates(motion: Motion, revolute: NDArray[np.bool_]) -> Array:
    """(L, 3, n) s_k, derivative by joint k of the sum of the positions of what follows it."""
    L = len(motion.p)
    count = np.arange(L, 0, -1.0)[:, None, None]
    position = np.concatenate([motion.p[1:], motion.tip[None, :, 3]])
    following = np.cumsum(position[::-1], axis=0)[::-1]
    lever, z = following - count * motion.p, motion.R[:, :, 2]
    turn = np.stack(
        [
            z[:, 1] * lever[:, 2] - z[:, 2] * lever[:, 1],
            z[:, 2] * lever[:, 0] - z[:, 0] * lever[:, 2],
            z[:, 0] * lever[:, 1] - z[:, 1] * lever[:, 0],
        ],
        axis=1,
    )
    return np.where(revolute[:, None, None], turn, count * z)


def loads(motion: Motion, revolute: NDArray[np.bool_], up: Array) -> Array:
    """(L, n) raw_k."""
    return np.asarray(-np.einsum("i,kin->kn", up, shift_rates(motion, revolute)))


def load_rates(motion: Motion, revolute: NDArray[np.bool_], up: Array) -> Array:
    """(L, L, n) ``d raw_k / d q_j``."""
    rates = shift_rates(motion, revolute)
    level = np.where(revolute[:, None, None], np.cross(up, motion.R[:, :, 2], axisb=1, axisc=1), 0.0)  # u x z_j
    below = -np.einsum("jin,kin->kjn", level, rates)  # for j <= k
    later = np.triu(np.ones((len(rates), len(rates)), dtype=bool), 1)[..., None]
    return np.asarray(np.where(later, below.swapaxes(0, 1), below))
