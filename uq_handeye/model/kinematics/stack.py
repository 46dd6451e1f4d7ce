r"""Several revolute arms computed at once: poses, derivatives and errors at the same number of postures each.

All arms have seven joints here, the third of which rolls the elbow; an arm of six axes has a joint there that does not
move. Lengths are in units of the arm's reach, the largest distance of its tip from its second joint. With the axes of
the joints along z (`forward`)

    T(q) = B_1 Z(q_1) B_2 Z(q_2) .. B_7 Z(q_7) B_tip

Arrays are (A, ..., n): arm, posture. Errors e (m = 77) of each arm in the order

| numbers | effect |
|---|---|
| 21: joint offsets and tilts | a_k, rotation about x, y, z of joint k |
| 21: link lengths | l_k, shift along x, y, z of joint k |
| 28: transmission | ``sin q_k, cos q_k, sin 2 q_k, cos 2 q_k`` |
| 7: sag | load of gravity on joint k over its largest (`forward`), base z up |

of which those of the joint that does not move are zero columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.rounding import CHAIN_ROUNDING
from .chain import POSTURES_PER_BLOCK
from .forward import Frames, fixed_transforms, spread_postures
from .known_arms import KnownArm

# Number of joints of every arm here, and the place of the joint that rolls the elbow.
N_AXES, ROLL = 7, 2
# Places of the errors in e, and their number.
TURNS, SHIFTS, WAVES, SAGS = slice(0, 21), slice(21, 42), slice(42, 70), slice(70, 77)
ERRORS = SAGS.stop
# Share of the reach of an arm over which lengths count as angles (rad) do.
LEVER_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class ArmStack:
    """Nominal chains of several arms, reach 1."""

    fixed: Array  # (A, 8, 3, 4) B_1 .. B_7, B_tip
    moves: NDArray[np.bool_]  # (A, 7)
    limits: Array  # (A, 7, 2) rad; those of the joint that does not move are 0
    usual: Array  # (A, 7, 2) rad, ranges of ordinary work
    reach: Array  # (A,) m
    largest_loads: Array  # (A, 7); infinite where gravity does not load the joint

    @classmethod
    def of(cls, arms: Sequence[KnownArm]) -> ArmStack:
        """Return the stack of arms of six or seven revolute joints.

        Reach and largest loads are those over a number of postures of the workspace.
        """
        fixed, moves = np.zeros((len(arms), N_AXES + 1, 3, 4)), np.ones((len(arms), N_AXES), dtype=bool)
        limits, usual = np.zeros((2, len(arms), N_AXES, 2))
        for a, arm in enumerate(arms):
            B = fixed_transforms(arm.parts.joints, arm.parts.end)[:, :3]
            bounds = np.array([(joint.lower, joint.upper) for joint in arm.parts.joints])
            ranges = arm.usual
            if len(bounds) < N_AXES:  # the elbow does not roll
                B = np.insert(B, ROLL, np.eye(3, 4), axis=0)
                bounds, ranges = (np.insert(x, ROLL, 0.0, axis=0) for x in (bounds, ranges))
                moves[a, ROLL] = False
            fixed[a], limits[a], usual[a] = B, bounds, ranges
        stack = cls(fixed, moves, limits, usual, np.ones(len(arms)), np.full((len(arms), N_AXES), np.inf))
        frames = stack.frames(stack.workspace(512))
        reach = np.linalg.norm(frames.tip[:, :, 3] - frames.p[:, 1], axis=1).max(axis=-1)
        largest = np.abs(stack._raw_loads(frames)).max(axis=-1)
        fixed[..., 3] /= reach[:, None, None]
        largest = np.where(largest > CHAIN_ROUNDING * reach[:, None], largest / reach[:, None], np.inf)
        return cls(fixed, moves, limits, usual, reach, largest)

    def workspace(self, n: int) -> Array:
        """(A, 7, n) postures that fill the limits of the joints evenly, the flange above the floor of the base."""
        q = np.stack([spread(limits, 4 * n) for limits in self.limits])
        below = self._heights(q) <= 0.0
        order = np.argsort(below, axis=-1, kind="stable")[:, :n]
        return np.asarray(np.take_along_axis(q, order[:, None], axis=-1))

    def at_work(self, n: int) -> Array:
        """(A, 7, n) postures that fill the usual ranges evenly, with joints 1 and 7 at zero and the elbow's roll in
        the middle of its range.
        """
        ranges = self.usual.copy()
        ranges[:, [0, N_AXES - 1]] = 0.0
        ranges[:, ROLL] = ranges[:, ROLL].mean(axis=-1, keepdims=True)
        return np.stack([spread(usual, n) for usual in ranges])

    def frames(self, q: Array) -> Frames:
        """Return the frames at postures q (A, 7, n)."""
        A, _, n = q.shape
        R, p = np.empty((A, N_AXES, 3, 3, n)), np.empty((A, N_AXES, 3, n))
        cosine, sine = np.cos(q)[:, :, None], np.sin(q)[:, :, None]
        state = np.repeat(self.fixed[:, 0, ..., None], n, axis=-1)  # (A, 3, 4, n)
        moved = np.empty((A, 3, 3, n))
        for k in range(N_AXES):
            R[:, k], p[:, k] = state[:, :, :3], state[:, :, 3]
            moved[:, :, 0] = cosine[:, k] * state[:, :, 0] + sine[:, k] * state[:, :, 1]
            moved[:, :, 1] = cosine[:, k] * state[:, :, 1] - sine[:, k] * state[:, :, 0]
            moved[:, :, 2] = state[:, :, 2]
            position = state[:, :, 3]
            state = self.fixed[:, None, k + 1].mT @ moved  # (4, 3) times (3, n)
            state[:, :, 3] += position
        return Frames(R, p, state)

    def _heights(self, q: Array) -> Array:
        """Return the heights of the tips (A, n) at postures: the last row of each product of `frames`."""
        cosine, sine = np.cos(q), np.sin(q)
        state = np.repeat(self.fixed[:, 0, 2, :, None], q.shape[-1], axis=-1)  # (A, 4, n)
        for k in range(N_AXES):
            x, y = state[:, 0], state[:, 1]
            moved = np.stack(
                [cosine[:, k] * x + sine[:, k] * y, cosine[:, k] * y - sine[:, k] * x, state[:, 2]], axis=1
            )
            height = state[:, 3]
            state = self.fixed[:, k + 1].mT @ moved
            state[:, 3] += height
        return np.asarray(state[:, 3])

    def tips(self, q: Array) -> Array:
        """Return the tips (A, 3, 4, n) at many postures."""
        parts = range(0, q.shape[-1], POSTURES_PER_BLOCK)
        return np.concatenate([self.frames(q[..., start : start + POSTURES_PER_BLOCK]).tip for start in parts], axis=-1)

    def twists(self, frames: Frames) -> Array:
        """Return J (A, 7, 6, n), the twist of the tip per rad of each joint: left rotation, additive translation."""
        z = frames.R[:, :, :, 2] * self.moves[..., None, None]
        return np.concatenate([z, _cross(z, frames.levers())], axis=2)

    def columns(self, q: Array, frames: Frames) -> Array:
        """Return F (A, 77, 6, n), the twist of the tip per unit of each error, rad or reach."""
        A, _, n = q.shape
        J = self.twists(frames)
        axes = np.swapaxes(frames.R, 2, 3) * self.moves[..., None, None, None]  # (A, 7, axis, 3, n)
        out = np.empty((A, ERRORS, 6, n))
        out[:, TURNS, :3] = axes.reshape(A, 21, 3, n)
        out[:, TURNS, 3:] = _cross(axes, frames.levers()[:, :, None]).reshape(A, 21, 3, n)
        out[:, SHIFTS, :3] = 0.0
        out[:, SHIFTS, 3:] = axes.reshape(A, 21, 3, n)
        sine, cosine = np.sin(q), np.cos(q)
        waves = np.stack([sine, cosine, 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine], axis=2)  # `harmonics`
        np.multiply(J[:, :, None], waves[:, :, :, None], out=out[:, WAVES].reshape(A, N_AXES, 4, 6, n))
        np.multiply(J, (self._raw_loads(frames) / self.largest_loads[..., None])[:, :, None], out=out[:, SAGS])
        return out

    def _raw_loads(self, frames: Frames) -> Array:
        """(A, 7, n) torque of unit weights at the following joints and the tip, base z up; see `gravity`."""
        ones = np.ones((len(self.moves), 1))
        weights = np.concatenate([self.moves[:, 1:], ones], axis=1)[..., None, None]  # of what follows joint k
        position = np.concatenate([frames.p[:, 1:], frames.tip[:, None, :, 3]], axis=1) * weights
        following = np.cumsum(position[:, ::-1], axis=1)[:, ::-1]
        count = np.cumsum(weights[:, ::-1], axis=1)[:, ::-1]
        lever, z = following - count * frames.p, frames.R[:, :, :, 2]
        return np.asarray((lever[:, :, 0] * z[:, :, 1] - lever[:, :, 1] * z[:, :, 0]) * self.moves[..., None])


def spread(limits: Array, n: int) -> Array:
    """(7, n) joint values that fill the limits (7, 2) evenly; joints whose two limits are equal stay there."""
    free = limits[:, 0] < limits[:, 1]
    q = np.repeat(limits[:, :1], n, axis=1)
    q[free] = spread_postures(limits[free], np.ones(int(free.sum()), dtype=bool), n).T
    return q


def _cross(a: Array, b: Array) -> Array:
    """``a x b`` along the last axis but one."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[..., j, :] * b[..., k, :], a[..., k, :] * b[..., j, :], out=out[..., i, :])
    return out
