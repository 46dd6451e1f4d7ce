r"""Several revolute arms as one: their poses, derivatives and errors at the same number of postures each.

All arms have seven joints here, the third of which rolls the elbow; an arm of six axes has a joint there that does not
move. Lengths are in units of the arm's reach, the largest distance of its tip from its second joint. With the axes of
the joints along z (`forward`)

    T(q) = B_1 Z(q_1) B_2 Z(q_2) .. B_7 Z(q_7) B_tip

Arrays are (A, n, ...): arm, posture. Errors e (m = 77) of each arm in the order

| numbers | effect |
|---|---|
| 21: joint offsets and tilts | a_k, rotation about x, y, z of joint k |
| 21: link lengths | l_k, shift along x, y, z of joint k |
| 28: transmission | ``sin q_k, cos q_k, sin 2 q_k, cos 2 q_k`` |
| 7: sag | load of gravity on joint k over its largest (`gravity`), base z up |

of which those of the joint that does not move are zero columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...geometry.se3 import Array
from ..errors import harmonics
from ..forward import fixed_transforms
from ..gravity import spread_postures
from .known_arms import KnownArm

AXES, ROLL, ERRORS = 7, 2, 77
# Columns of e by what they are.
TURNS, SHIFTS, WAVES, SAGS = slice(0, 21), slice(21, 42), slice(42, 70), slice(70, 77)
# Postures over which the largest load and the reach are taken.
LOADED_AT = 1024


class Frames(NamedTuple):
    """The joint frames before they move, and the tip, of n postures of each arm."""

    R: Array  # (A, n, 7, 3, 3), z along the axis
    p: Array  # (A, n, 7, 3)
    tip: Array  # (A, n, 3, 4)


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
        """Return the stack of arms of six or seven revolute joints."""
        fixed, moves = np.zeros((len(arms), AXES + 1, 3, 4)), np.ones((len(arms), AXES), dtype=bool)
        limits, usual = np.zeros((2, len(arms), AXES, 2))
        for a, arm in enumerate(arms):
            B = fixed_transforms(arm.parts.joints, arm.parts.end)[:, :3]
            bounds = np.array([(joint.lower, joint.upper) for joint in arm.parts.joints])
            if len(bounds) < AXES:  # the elbow does not roll
                B = np.insert(B, ROLL, np.eye(3, 4), axis=0)
                bounds, ranges = (np.insert(x, ROLL, 0.0, axis=0) for x in (bounds, arm.usual))
                moves[a, ROLL] = False
            else:
                ranges = arm.usual
            fixed[a], limits[a], usual[a] = B, bounds, ranges
        stack = cls(fixed, moves, limits, usual, np.ones(len(arms)), np.full((len(arms), AXES), np.inf))
        frames = stack.frames(stack.workspace(LOADED_AT))
        reach = np.linalg.norm(frames.tip[..., 3] - frames.p[:, :, 1], axis=-1).max(axis=1)
        largest = np.abs(stack._raw_loads(frames)).max(axis=1)
        fixed[..., 3] /= reach[:, None, None]
        largest = np.where(largest > 1e-9 * reach[:, None], largest / reach[:, None], np.inf)
        return cls(fixed, moves, limits, usual, reach, largest)

    def workspace(self, n: int) -> Array:
        """(A, n, 7) postures that fill the limits of the joints evenly."""
        return np.stack([self._spread(limits, n) for limits in self.limits])

    def at_work(self, n: int) -> Array:
        """(A, n, 7) postures that fill the usual ranges evenly, with joints 1 and 7 at zero and the elbow's roll in
        the middle of its range.
        """
        out = np.zeros((len(self.usual), n, AXES))
        for a, usual in enumerate(self.usual):
            ranges = np.array(usual)
            ranges[[0, ROLL, AXES - 1]] = 0.0
            out[a] = self._spread(ranges, n)
        out[..., ROLL] = self.usual[:, None, ROLL].mean(axis=-1)
        return out

    @staticmethod
    def _spread(limits: Array, n: int) -> Array:
        """(n, 7); joints whose two limits are equal stay there."""
        free = limits[:, 0] < limits[:, 1]
        q = np.repeat(limits[None, :, 0], n, axis=0)
        q[:, free] = spread_postures(limits[free], np.ones(free.sum(), dtype=bool), n)
        return q

    def frames(self, q: Array) -> Frames:
        """Return the frames at postures q (A, n, 7)."""
        A, n, _ = q.shape
        cosine, sine = np.cos(q)[..., None, None], np.sin(q)[..., None, None]
        B = self.fixed[:, None, 1:]  # (A, 1, 7, 3, 4)
        step = np.empty((A, n, AXES, 3, 4))  # Z(q_k) B_(k+1)
        step[..., :1, :] = cosine * B[..., :1, :] - sine * B[..., 1:2, :]
        step[..., 1:2, :] = sine * B[..., :1, :] + cosine * B[..., 1:2, :]
        step[..., 2:, :] = B[..., 2:, :]
        R, p = np.empty((A, n, AXES, 3, 3)), np.empty((A, n, AXES, 3))
        state = np.broadcast_to(self.fixed[:, None, 0], (A, n, 3, 4))
        for k in range(AXES):
            R[:, :, k], p[:, :, k] = state[..., :3], state[..., 3]
            moved = state[..., :3] @ step[:, :, k]
            moved[..., 3] += state[..., 3]
            state = moved
        return Frames(R, p, state)

    def twists(self, frames: Frames) -> Array:
        """Return J (A, n, 7, 6), the twist of the tip per rad of each joint: left rotation, additive translation."""
        z = frames.R[..., 2]
        out = np.empty((*z.shape[:-1], 6))
        out[..., :3] = z
        out[..., 3:] = _cross(z, frames.tip[:, :, None, :, 3] - frames.p)
        return out * self.moves[:, None, :, None]

    def columns(self, q: Array, frames: Frames) -> Array:
        """Return F (A, n, 6, 77), the twist of the tip per unit of each error, rad or reach."""
        A, n, _ = q.shape
        J = self.twists(frames)
        axes = np.swapaxes(frames.R, -1, -2) * self.moves[:, None, :, None, None]  # (A, n, 7, axis, 3)
        lever = (frames.tip[:, :, None, :, 3] - frames.p)[..., None, :]
        out = np.zeros((A, n, ERRORS, 6))
        out[:, :, TURNS, :3] = axes.reshape(A, n, 21, 3)
        out[:, :, TURNS, 3:] = _cross(axes, lever).reshape(A, n, 21, 3)
        out[:, :, SHIFTS, 3:] = axes.reshape(A, n, 21, 3)
        out[:, :, WAVES] = (J[..., None, :] * harmonics(q)[..., None]).reshape(A, n, 28, 6)
        out[:, :, SAGS] = J * (self._raw_loads(frames) / self.largest_loads[:, None])[..., None]
        return np.swapaxes(out, -1, -2)

    def _raw_loads(self, frames: Frames) -> Array:
        """(A, n, 7) torque of unit weights at the following joints and the tip, base z up; see `gravity`."""
        weights = np.concatenate([self.moves[:, 1:], np.ones((len(self.moves), 1))], axis=1)[:, None, :, None]
        position = np.concatenate([frames.p[:, :, 1:], frames.tip[:, :, None, :, 3]], axis=2) * weights
        following = np.cumsum(position[:, :, ::-1], axis=2)[:, :, ::-1]
        count = np.cumsum(weights[:, :, ::-1], axis=2)[:, :, ::-1]
        lever, z = following - count * frames.p, frames.R[..., 2]
        return (lever[..., 0] * z[..., 1] - lever[..., 1] * z[..., 0]) * self.moves[:, None]


def _cross(a: Array, b: Array) -> Array:
    """``a x b`` along the last axis."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out
