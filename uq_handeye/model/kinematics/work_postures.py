r"""Postures of several arms at the same poses, each in its usual branch: elbow up, wrist bent to one side.

The start is the nearest of stored postures of the usual ranges. A pose (R, t) can be had from another one by turning
joint 1, whose axis is the base's z, and joint 7, whose axis is the tip's z: they are nearest in the distance of the tip
from the axis of joint 1, its height, and the direction of its z against that of t. Then a few damped Newton steps,

    d = J^T (J J^T + damping^2)^-1 r,    r the twist from the tip to the pose, lengths over `LEVER_SHARE` of the reach

which stay inside the usual ranges or a margin beyond them, and so in the branch. Seven axes keep the roll of the elbow
at which they start but for the least change that the steps need. A pose that is out of reach gets a posture near it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from .forward import Frames
from .stack import LEVER_SHARE, N_AXES, ArmStack


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
        return cls.at(stack, stack.at_work(1500))

    @classmethod
    def at(cls, stack: ArmStack, q: Array, margin_rad: float = 0.2) -> WorkPostures:
        """Return postures q (A, 7, S), joints 1 and 7 at 0, as the stored ones.

        Joints may leave their usual ranges by a margin.
        """
        tip = np.moveaxis(stack.tips(q), -1, 1)
        features, azimuth = _features(tip)
        q = q.swapaxes(1, 2).copy()
        q[..., 0] = -azimuth * stack.fixed[:, None, 0, 2, 2]
        tips = _about_z(-azimuth) @ tip[..., :3]
        squares = (features**2).sum(axis=-1, keepdims=True)
        table = np.concatenate([-2.0 * features, squares], axis=-1).swapaxes(1, 2).astype(np.float32)
        free = np.isin(np.arange(N_AXES), (0, N_AXES - 1)) | (np.diff(stack.usual)[..., 0] > 2 * np.pi - 1e-6)
        low = np.where(free, -np.inf, stack.usual[..., 0] - margin_rad)
        high = np.where(free, np.inf, stack.usual[..., 1] + margin_rad)
        held = ~stack.moves
        low, high = np.where(held, 0.0, low)[..., None], np.where(held, 0.0, high)[..., None]
        return cls(stack, q, tips, table, low, high)

    def find(self, poses: Array, steps: int = 4) -> tuple[Array, Frames, NDArray[np.bool_]]:
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
        q[..., N_AXES - 1] += turn * self.stack.fixed[:, None, N_AXES, 2, 2]
        return np.ascontiguousarray(q.swapaxes(1, 2))


def descend(
    stack: ArmStack,
    q: Array,
    poses: Array,
    low: Array,
    high: Array,
    steps: int,
    *,
    damping: float = 0.02,
    longest_rad: float = 0.6,
    reached: float = 0.05,
) -> tuple[Array, Frames, NDArray[np.bool_]]:
    """Return postures after damped Newton steps from q (A, 7, n), their frames and whether they reach ``poses``.

    No joint moves by more than ``longest_rad`` in a step. A pose is reached where the twist that remains, rad and
    lengths over `LEVER_SHARE` of the reach, is below ``reached``.
    """
    wanted = np.moveaxis(poses, 0, -1)
    weight = np.array([1.0, 1.0, 1.0, *[1.0 / LEVER_SHARE] * 3])[:, None]
    diagonal = np.arange(6)
    frames = stack.frames(q)
    for _ in range(steps):
        left = _twist(frames.tip, wanted) * weight
        J = np.ascontiguousarray(np.moveaxis(stack.twists(frames) * weight, -1, 1))  # (A, n, 7, 6)
        M = J.mT @ J
        M[..., diagonal, diagonal] += damping**2
        step = (J @ np.linalg.solve(M, left.swapaxes(-1, -2)[..., None]))[..., 0].swapaxes(-1, -2)
        longest = np.abs(step).max(axis=1, keepdims=True)
        q = np.clip(q + step * (longest_rad / np.maximum(longest, longest_rad)), low, high)
        frames = stack.frames(q)
    return q, frames, np.linalg.norm(_twist(frames.tip, wanted) * weight, axis=1) < reached


def _features(poses: Array) -> tuple[Array, Array]:
    """Distance from the axis of joint 1, height and direction of z, (..., 5); azimuth (...) of the tip."""
    x, y, z = np.moveaxis(poses[..., 3], -1, 0)
    distance = np.hypot(x, y)
    cosine, sine = x / np.maximum(distance, 1e-12), y / np.maximum(distance, 1e-12)
    u, v, w = np.moveaxis(poses[..., 2], -1, 0)
    features = [distance / LEVER_SHARE, z / LEVER_SHARE, cosine * u + sine * v, cosine * v - sine * u, w]
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
