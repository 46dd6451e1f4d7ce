r"""Several revolute arms as one: their poses, derivatives and errors at the same number of postures each.

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

*Postures* of several arms at the same poses are each in its usual branch: elbow up, wrist bent to one side.

The start is the nearest of `STORED` postures of the usual ranges. A pose (R, t) can be had from another one by turning
joint 1, whose axis is the base's z, and joint 7, whose axis is the tip's z: they are nearest in the distance of the tip
from the axis of joint 1, its height, and the direction of its z against that of t. Then `STEPS` damped Newton steps,

    d = J^T (J J^T + damping^2)^-1 r,    r the twist from the tip to the pose, lengths over `LENGTH` of the reach

which stay inside the usual ranges (`MARGIN` beyond them), and so in the branch. Seven axes keep the roll of the elbow
at which they start but for the least change that the steps need. A pose that is out of reach gets a posture near it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array
from ..forward import fixed_transforms, spread_postures
from .known_arms import KnownArm

AXES, ROLL, ERRORS = 7, 2, 77
# Places of the errors in e.
TURNS, SHIFTS, WAVES, SAGS = slice(0, 21), slice(21, 42), slice(42, 70), slice(70, 77)
# Postures over which the largest load and the reach are taken.
LOADED_AT = 512


class Frames(NamedTuple):
    """The joint frames before they move, and the tip, of n postures of each arm."""

    R: Array  # (A, 7, 3, 3, n), z along the axis
    p: Array  # (A, 7, 3, n)
    tip: Array  # (A, 3, 4, n)

    def levers(self) -> Array:
        """(A, 7, 3, n) from the joints to the tip."""
        return np.asarray(self.tip[:, None, :, 3] - self.p)


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
            ranges = arm.usual
            if len(bounds) < AXES:  # the elbow does not roll
                B = np.insert(B, ROLL, np.eye(3, 4), axis=0)
                bounds, ranges = (np.insert(x, ROLL, 0.0, axis=0) for x in (bounds, ranges))
                moves[a, ROLL] = False
            fixed[a], limits[a], usual[a] = B, bounds, ranges
        stack = cls(fixed, moves, limits, usual, np.ones(len(arms)), np.full((len(arms), AXES), np.inf))
        frames = stack.frames(stack.workspace(LOADED_AT))
        reach = np.linalg.norm(frames.tip[:, :, 3] - frames.p[:, 1], axis=1).max(axis=-1)
        largest = np.abs(stack._raw_loads(frames)).max(axis=-1)
        fixed[..., 3] /= reach[:, None, None]
        largest = np.where(largest > 1e-9 * reach[:, None], largest / reach[:, None], np.inf)
        return cls(fixed, moves, limits, usual, reach, largest)

    def workspace(self, n: int) -> Array:
        """(A, 7, n) postures that fill the limits of the joints evenly, the flange above the floor of the base."""
        q = np.stack([spread(limits, 4 * n) for limits in self.limits])
        below = self.frames(q).tip[:, 2, 3] <= 0.0
        order = np.argsort(below, axis=-1, kind="stable")[:, :n]
        return np.asarray(np.take_along_axis(q, order[:, None], axis=-1))

    def at_work(self, n: int) -> Array:
        """(A, 7, n) postures that fill the usual ranges evenly, with joints 1 and 7 at zero and the elbow's roll in
        the middle of its range.
        """
        ranges = self.usual.copy()
        ranges[:, [0, AXES - 1]] = 0.0
        ranges[:, ROLL] = ranges[:, ROLL].mean(axis=-1, keepdims=True)
        return np.stack([spread(usual, n) for usual in ranges])

    def frames(self, q: Array) -> Frames:
        """Return the frames at postures q (A, 7, n)."""
        A, _, n = q.shape
        R, p = np.empty((A, AXES, 3, 3, n)), np.empty((A, AXES, 3, n))
        cosine, sine = np.cos(q)[:, :, None], np.sin(q)[:, :, None]
        state = np.repeat(self.fixed[:, 0, ..., None], n, axis=-1)  # (A, 3, 4, n)
        moved = np.empty((A, 3, 3, n))
        for k in range(AXES):
            R[:, k], p[:, k] = state[:, :, :3], state[:, :, 3]
            moved[:, :, 0] = cosine[:, k] * state[:, :, 0] + sine[:, k] * state[:, :, 1]
            moved[:, :, 1] = cosine[:, k] * state[:, :, 1] - sine[:, k] * state[:, :, 0]
            moved[:, :, 2] = state[:, :, 2]
            position = state[:, :, 3]
            state = self.fixed[:, None, k + 1].mT @ moved  # (4, 3) times (3, n)
            state[:, :, 3] += position
        return Frames(R, p, state)

    def tips(self, q: Array, block: int = 128) -> Array:
        """Return the tips (A, 3, 4, n) at many postures."""
        parts = range(0, q.shape[-1], block)
        return np.concatenate([self.frames(q[..., start : start + block]).tip for start in parts], axis=-1)

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
        np.multiply(J[:, :, None], waves[:, :, :, None], out=out[:, WAVES].reshape(A, AXES, 4, 6, n))
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


STORED = 1500
STEPS = 4
LENGTH = 0.5
DAMPING = 0.02
LONGEST = 0.6  # rad, of one joint in one step
MARGIN = 0.2  # rad
# Twist that is left at a posture of an arm that reaches the pose, rad and lengths over `LENGTH` of the reach.
REACHED = 0.05
# Poses that are solved together.
BLOCK = 64


@dataclass(frozen=True, eq=False)
class WorkPostures:
    """Stored postures of the arms of a stack, and those of other poses found from them."""

    stack: ArmStack
    q: Array  # (A, S, 7)
    tips: Array  # (A, S, 3, 3) rotations of the tips
    features: NDArray[np.float32]  # (A, 6, S)
    low: Array  # (A, 7, 1) rad
    high: Array

    @classmethod
    def of(cls, stack: ArmStack) -> WorkPostures:
        """Return the stored postures of a stack: spread over its usual ranges."""
        return cls.at(stack, stack.at_work(STORED))

    @classmethod
    def at(cls, stack: ArmStack, q: Array) -> WorkPostures:
        """Return postures q (A, 7, S), joints 1 and 7 at 0, as the stored ones."""
        tip = np.moveaxis(stack.tips(q), -1, 1)
        features, azimuth = _features(tip)
        q = q.swapaxes(1, 2).copy()
        q[..., 0] = -azimuth * stack.fixed[:, None, 0, 2, 2]
        tips = _about_z(-azimuth) @ tip[..., :3]
        squares = (features**2).sum(axis=-1, keepdims=True)
        table = np.concatenate([-2.0 * features, squares], axis=-1).swapaxes(1, 2).astype(np.float32)
        free = np.isin(np.arange(AXES), (0, AXES - 1)) | (np.diff(stack.usual)[..., 0] > 2 * np.pi - 1e-6)
        low = np.where(free, -np.inf, stack.usual[..., 0] - MARGIN)
        high = np.where(free, np.inf, stack.usual[..., 1] + MARGIN)
        held = ~stack.moves
        low, high = np.where(held, 0.0, low)[..., None], np.where(held, 0.0, high)[..., None]
        return cls(stack, q, tips, table, low, high)

    def find(self, poses: Array, steps: int = STEPS) -> tuple[Array, Frames, NDArray[np.bool_]]:
        """Return postures (A, 7, n), their frames and whether they reach ``poses`` (n, 3, 4), lengths over the
        reach.
        """
        return descend(self.stack, self._start(poses), poses, self.low, self.high, steps)

    def _start(self, poses: Array) -> Array:
        features, azimuth = _features(poses)
        query = np.concatenate([features, np.ones((len(poses), 1))], axis=-1).astype(np.float32)
        nearest = np.stack([np.argmin(query @ table, axis=-1) for table in self.features])
        arm = np.arange(len(nearest))[:, None]
        q = self.q[arm, nearest]
        q[..., 0] += azimuth * self.stack.fixed[:, None, 0, 2, 2]
        left = self.tips[arm, nearest].mT @ (_about_z(-azimuth) @ poses[..., :3])
        turn = np.arctan2(left[..., 1, 0] - left[..., 0, 1], left[..., 0, 0] + left[..., 1, 1])
        q[..., AXES - 1] += turn * self.stack.fixed[:, None, AXES, 2, 2]
        return np.ascontiguousarray(q.swapaxes(1, 2))


def descend(
    stack: ArmStack, q: Array, poses: Array, low: Array, high: Array, steps: int
) -> tuple[Array, Frames, NDArray[np.bool_]]:
    """Return postures after damped Newton steps from q (A, 7, n), their frames and whether they reach ``poses``."""
    wanted = np.moveaxis(poses, 0, -1)
    weight = np.array([1.0, 1.0, 1.0, *[1.0 / LENGTH] * 3])[:, None]
    diagonal = np.arange(6)
    frames = stack.frames(q)
    for _ in range(steps):
        left = _twist(frames.tip, wanted) * weight
        J = np.ascontiguousarray(np.moveaxis(stack.twists(frames) * weight, -1, 1))  # (A, n, 7, 6)
        M = J.mT @ J
        M[..., diagonal, diagonal] += DAMPING**2
        step = (J @ np.linalg.solve(M, left.swapaxes(-1, -2)[..., None]))[..., 0].swapaxes(-1, -2)
        longest = np.abs(step).max(axis=1, keepdims=True)
        q = np.clip(q + step * (LONGEST / np.maximum(longest, LONGEST)), low, high)
        frames = stack.frames(q)
    return q, frames, np.linalg.norm(_twist(frames.tip, wanted) * weight, axis=1) < REACHED


def _features(poses: Array) -> tuple[Array, Array]:
    """Distance from the axis of joint 1, height and direction of z, (..., 5); azimuth (...) of the tip."""
    x, y, z = np.moveaxis(poses[..., 3], -1, 0)
    distance = np.hypot(x, y)
    cosine, sine = x / np.maximum(distance, 1e-12), y / np.maximum(distance, 1e-12)
    u, v, w = np.moveaxis(poses[..., 2], -1, 0)
    features = [distance / LENGTH, z / LENGTH, cosine * u + sine * v, cosine * v - sine * u, w]
    return np.stack(features, axis=-1), np.arctan2(y, x)


def _about_z(angle: Array) -> Array:
    """(..., 3, 3) rotations about z."""
    out = np.zeros((*angle.shape, 3, 3))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(angle)
    out[..., 1, 0] = np.sin(angle)
    out[..., 0, 1] = -out[..., 1, 0]
    out[..., 2, 2] = 1.0
    return out


def _twist(tip: Array, wanted: Array) -> Array:
    """(A, 6, n) from tips (A, 3, 4, n) to poses (3, 4, n): rotation ``2 tan(angle / 2)`` about its axis, translation.

    Near half a turn the rotation is cut off.
    """
    M = (tip[:, None, :, :3] * wanted[:, None, :3]).sum(axis=3)  # R_wanted R_tip^T (A, 3, 3, n)
    out = np.empty((len(tip), 6, tip.shape[-1]))
    out[:, 0] = M[:, 2, 1] - M[:, 1, 2]
    out[:, 1] = M[:, 0, 2] - M[:, 2, 0]
    out[:, 2] = M[:, 1, 0] - M[:, 0, 1]
    # 2 sin(angle) / (1 + cos(angle)) and the trace 1 + 2 cos(angle)
    out[:, :3] *= 2.0 / np.maximum(1.0 + M[:, 0, 0] + M[:, 1, 1] + M[:, 2, 2], 0.1)[:, None]
    out[:, 3:] = wanted[:, 3] - tip[:, :, 3]
    return out
