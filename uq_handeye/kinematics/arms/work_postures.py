r"""Postures of several arms at the same poses, each in its usual branch: elbow up, wrist bent to one side.

The start is the nearest of `STORED` postures of the usual ranges. A pose (R, t) can be had from another one by turning
joint 1, whose axis is the base's z, and joint 7, whose axis is the tip's z: they are nearest in the distance of the tip
from the axis of joint 1, its height, and the direction of its z against that of t. Then `STEPS` damped Newton steps,

    d = J^T (J J^T + damping^2)^-1 r,    r the twist from the tip to the pose, lengths over `LENGTH` of the reach

which stay inside the usual ranges (`MARGIN` beyond them), and so in the branch. Seven axes keep the roll of the elbow
at which they start but for the least change that the steps need. A pose that is out of reach gets a posture near it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...geometry.se3 import Array
from .stack import AXES, ArmStack, Frames

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
    low: Array  # (A, 1, 7)
    high: Array

    @classmethod
    def of(cls, stack: ArmStack) -> WorkPostures:
        """Return the stored postures of a stack."""
        q = stack.at_work(STORED)
        tip = stack.frames(q).tip
        features, azimuth = _features(tip)
        q[..., 0] = -azimuth * stack.fixed[:, None, 0, 2, 2]
        tips = _about_z(-azimuth) @ tip[..., :3]
        squares = (features**2).sum(axis=-1, keepdims=True)
        table = np.concatenate([-2.0 * features, squares], axis=-1).swapaxes(1, 2).astype(np.float32)
        free = np.isin(np.arange(AXES), (0, AXES - 1)) | (np.diff(stack.usual)[..., 0] > 2 * np.pi - 1e-6)
        low = np.where(free, -np.inf, stack.usual[..., 0] - MARGIN)
        high = np.where(free, np.inf, stack.usual[..., 1] + MARGIN)
        held = ~stack.moves
        low, high = np.where(held, 0.0, low), np.where(held, 0.0, high)
        return cls(stack, q, tips, table, low[:, None], high[:, None])

    def find(self, poses: Array) -> tuple[Array, Frames, NDArray[np.bool_]]:
        """Return postures (A, n, 7), their frames and whether they reach ``poses`` (A, n, 3, 4), lengths over the
        reach.
        """
        q = self._start(poses)
        weight = np.array([1.0, 1.0, 1.0, *[1.0 / LENGTH] * 3])
        diagonal = np.arange(6)
        for _ in range(STEPS):
            frames = self.stack.frames(q)
            left = _twist(frames.tip, poses) * weight
            J = self.stack.twists(frames) * weight  # (A, n, 7, 6)
            M = np.swapaxes(J, -1, -2) @ J
            M[..., diagonal, diagonal] += DAMPING**2
            step = (J @ np.linalg.solve(M, left[..., None]))[..., 0]
            longest = np.abs(step).max(axis=-1, keepdims=True)
            q = np.clip(q + step * (LONGEST / np.maximum(longest, LONGEST)), self.low, self.high)
        frames = self.stack.frames(q)
        size = np.linalg.norm(_twist(frames.tip, poses) * weight, axis=-1)
        return q, frames, size < REACHED

    def _start(self, poses: Array) -> Array:
        features, azimuth = _features(poses)
        A, n = azimuth.shape
        nearest = np.empty((A, n), dtype=np.intp)
        query = np.concatenate([features, np.ones((A, n, 1))], axis=-1).astype(np.float32)
        for a in range(A):
            np.argmin(query[a] @ self.features[a], axis=-1, out=nearest[a])
        arm = np.arange(A)[:, None]
        q = self.q[arm, nearest]
        q[..., 0] += azimuth * self.stack.fixed[:, None, 0, 2, 2]
        left = np.swapaxes(self.tips[arm, nearest], -1, -2) @ _about_z(-azimuth) @ poses[..., :3]
        turn = np.arctan2(left[..., 1, 0] - left[..., 0, 1], left[..., 0, 0] + left[..., 1, 1])
        q[..., AXES - 1] += turn * self.stack.fixed[:, None, AXES, 2, 2]
        return q


def _features(poses: Array) -> tuple[Array, Array]:
    """Distance from the axis of joint 1, height and direction of z, (A, n, 5); azimuth (A, n) of the tip."""
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
    """(..., 6) from the tip to the poses wanted: left rotation, additive translation.

    The rotation is that of the unit quaternion ``2 v / w`` without its higher orders, at most `LARGEST` or so.
    """
    M = wanted[..., :3] @ np.swapaxes(tip[..., :3], -1, -2)
    out = np.empty((*M.shape[:-2], 6))
    out[..., 0] = M[..., 2, 1] - M[..., 1, 2]
    out[..., 1] = M[..., 0, 2] - M[..., 2, 0]
    out[..., 2] = M[..., 1, 0] - M[..., 0, 1]
    trace = M[..., 0, 0] + M[..., 1, 1] + M[..., 2, 2]
    # 4 tan(angle / 4) is near the angle up to a half turn; sin a / (1 + cos a) = tan(a / 2)
    out[..., :3] *= 2.0 / np.maximum(1.0 + trace, 0.1)[..., None]
    out[..., 3:] = wanted[..., 3] - tip[..., 3]
    return out
