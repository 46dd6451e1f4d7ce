r"""Forward kinematics of many postures at once: one pass over the joints, all postures in each step.

With A_k the smallest rotation that takes z to the axis of joint k, the chain

    T(q) = O_1 M_1(q_1) O_2 M_2(q_2) .. O_L M_L(q_L) O_tip

is that of motions about or along z between fixed transforms,

    T(q) = B_1 Z_1(q_1) B_2 Z_2(q_2) .. B_L Z_L(q_L) B_tip,
    B_1 = O_1 A_1,   B_k = A_(k-1)^T O_k A_k,   B_tip = A_L^T O_tip

Arrays inside have the postures as their *last* axis.

*Gravity* loads each joint, relative to the largest load, by

    raw_k(q) = -u . (z_k x sum_i (p_i - p_k))  revolute,     -u . z_k (number of i)  prismatic,     i = k + 1 .. L, tip
    g_k(q) = raw_k(q) / max |raw_k|

u is up, z_k the axis of joint k, p_i the origin of joint frame i: torque (force) of unit weights at the following
joint frames and at the tip, in the direction in which they move the joint. The divisor is that of the arm: the largest
value at postures spread evenly over the joint limits. A joint that gravity cannot load has g = 0.

raw is minus the derivative of ``V = u . sum p_i`` by the joints, so that its derivative is symmetric:
``d raw_k / d q_j = -u . (z_j x s_k)`` for a revolute joint j <= k, 0 for a prismatic one, where s_k is the derivative
of ``sum p_i`` by q_k.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from .joint import Joint

# Length at which a shift counts as much as a rotation.
LEVER_M = 0.3


class Frames(NamedTuple):
    """The frames of n postures of one arm, or of several with a leading axis."""

    R: Array  # (..., L, 3, 3, n) axes of the joint frames, z along the joint, with their errors, before they move
    p: Array  # (..., L, 3, n) their origins
    tip: Array  # (..., 3, 4, n) rotation and position of the tip

    def levers(self) -> Array:
        """(..., L, 3, n) from the joints to the tip."""
        return np.asarray(self.tip[..., None, :, 3, :] - self.p)


def align(axis: Array) -> Array:
    """The smallest rotation (4, 4) that takes z to a unit vector; for -z, half a turn about x."""
    x, y, z = axis
    T = np.eye(4)
    if z < -1.0 + 1e-12:
        T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    else:
        w = 1.0 / (1.0 + z)
        T[:3, :3] = [[1.0 - w * x * x, -w * x * y, x], [-w * x * y, 1.0 - w * y * y, y], [-x, -y, z]]
    return T


def fixed_transforms(joints: Sequence[Joint], end: Array) -> Array:
    """(L + 1, 4, 4) B_1 .. B_L and B_tip."""
    found, before = [], np.eye(4)
    for joint in joints:
        A = align(joint.axis)
        found.append(before.T @ joint.origin @ A)
        before = A
    return np.array([*found, before.T @ end])


def forward(
    fixed: Array, revolute: NDArray[np.bool_], q: Array, a: Array | None = None, shift: Array | None = None
) -> Frames:
    """The frames for joint values q (L, n), with errors ``E_k = (exp [a_k]x, l_k)`` before each motion.

    ``a`` and ``shift`` (L, 3, n or 1): all a_k and l_k, rad and m, in the frame of the joint, whose z is its
    axis.
    """
    L, n = q.shape
    R, p = np.empty((L, 3, 3, n)), np.empty((L, 3, n))
    state = np.repeat(fixed[0, :3, :, None], n, axis=2)  # (3, 4, n)
    turns = None if a is None else rotations(a)
    moved = np.empty((3, 3, n))
    for k in range(L):
        if turns is not None and shift is not None:
            state[:, 3] += (state[:, :3] * shift[k]).sum(axis=1)
            state[:, :3] = np.einsum("ijn,jkn->ikn", state[:, :3], np.broadcast_to(turns[k], (3, 3, n)))
        R[k], p[k] = state[:, :3], state[:, 3]
        if revolute[k]:
            cosine, sine = np.cos(q[k]), np.sin(q[k])
            moved[:, 0] = cosine * state[:, 0] + sine * state[:, 1]
            moved[:, 1] = cosine * state[:, 1] - sine * state[:, 0]
            moved[:, 2] = state[:, 2]
            position = state[:, 3]
        else:
            moved[:] = state[:, :3]
            position = state[:, 3] + q[k] * state[:, 2]
        state = np.matmul(fixed[k + 1, :3].T, moved)  # (4, 3) times (3, 3, n)
        state[:, 3] += position
    return Frames(R, p, state)


def rotations(a: Array) -> Array:
    """``exp [a]x`` (L, 3, 3, n) of rotation vectors (L, 3, n)."""
    L, _, n = a.shape
    flat = np.ascontiguousarray(np.moveaxis(a, 1, -1)).reshape(-1, 3)
    return np.moveaxis(Rotation.from_rotvec(flat).as_matrix().reshape(L, n, 3, 3), 1, -1)


def turned(W: Array, lever: Array) -> Array:
    """``w x lever`` of the columns w of W (L, 3, c, n) with levers (L, 3, n)."""
    x, y, z = (lever[:, i, None] for i in range(3))
    out = np.empty_like(W)
    out[:, 0] = W[:, 1] * z - W[:, 2] * y
    out[:, 1] = W[:, 2] * x - W[:, 0] * z
    out[:, 2] = W[:, 0] * y - W[:, 1] * x
    return out


def axis_twists(motion: Frames, revolute: NDArray[np.bool_]) -> Array:
    """(L, 6, n) twist of the tip per unit of each joint: ``(z; z x lever)`` revolute, ``(0; z)`` prismatic."""
    z = motion.R[:, :, 2]
    twists = np.empty((len(z), 6, z.shape[-1]))
    twists[:, :3] = np.where(revolute[:, None, None], z, 0.0)
    twists[:, 3:] = np.where(revolute[:, None, None], turned(z[:, :, None], motion.levers())[:, :, 0], z)
    return twists


def spread_postures(limits: Array, revolute: NDArray[np.bool_], n: int) -> Array:
    """(n, L) joint values that fill the limits (L, 2) evenly, always the same ones.

    Additive recurrence with the generalised golden ratio: fractional parts of ``1/2 + i / r^j``, ``r^(L+1) = r + 1``.
    Joints without limits range over half a turn (1 m) to either side; with one limit, over a turn (2 m) from there.
    """
    L = len(limits)
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (L + 1))
    unit = (0.5 + np.arange(1, n + 1)[:, None] * ratio ** -np.arange(1.0, L + 1)) % 1.0
    half = np.where(revolute, np.pi, 1.0)
    lower, upper = limits.T
    low = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2 * half, -half))
    high = np.where(np.isfinite(upper), upper, low + 2 * half)
    return np.asarray(low + unit * (high - low))


def shift_rates(motion: Frames, revolute: NDArray[np.bool_]) -> Array:
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


def loads(motion: Frames, revolute: NDArray[np.bool_], up: Array) -> Array:
    """(L, n) raw_k."""
    return np.asarray(-np.einsum("i,kin->kn", up, shift_rates(motion, revolute)))


def load_rates(motion: Frames, revolute: NDArray[np.bool_], up: Array) -> Array:
    """(L, L, n) ``d raw_k / d q_j``."""
    rates = shift_rates(motion, revolute)
    level = np.where(revolute[:, None, None], np.cross(up, motion.R[:, :, 2], axisb=1, axisc=1), 0.0)  # u x z_j
    below = -np.einsum("jin,kin->kjn", level, rates)  # for j <= k
    later = np.triu(np.ones((len(rates), len(rates)), dtype=bool), 1)[..., None]
    return np.asarray(np.where(later, below.swapaxes(0, 1), below))
