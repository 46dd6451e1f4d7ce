"""Unit quaternions and rotation axes of motions with consistent signs, and dual quaternions.

A rotation by nearly 180 degrees has two unit quaternions, ``(w, v)`` and ``(-w, -v)`` with w near 0, of which noise
chooses; if it chooses differently for A and B, the pair contradicts all others. The publications do not treat this.
Here the quaternion of A has ``w >= 0``, and so has that of B, except that for motions beyond 170 degrees the sign of
B's is the one for which ``v_A . R v_B > 0``, R the rotation that fits the vectors ``sin(angle) axis``, which have no
such ambiguity. The pair of quaternions then is a smooth function of the data, up to a common sign, which products of
the two do not see.

Quaternions are ``(w, x, y, z)``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.geometry.nearest_rotation import orthonormalise
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array, left_jacobian, pose, skew, vee
from ..core.rounding import CHAIN_ROUNDING, HALF_DIGITS
from .method import require

# Angle beyond which noise may have changed the sign of a rotation axis, so that the other motions choose it.
NEAR_HALF_TURN_RAD = float(np.radians(170.0))
# Scalar part of the quaternion of a rotation by that angle.
NEAR_HALF_TURN_SCALAR = float(np.cos(NEAR_HALF_TURN_RAD / 2.0))


class Signs(NamedTuple):
    """Data that decide the signs of axes near half turns."""

    R: Array  # (T, 3, 3): the rotation that they must fit
    like: tuple[Array, Array] | None = None  # quaternions of A and B to be continuous with, when differentiating

    def of(self, trials: slice) -> Signs:
        return Signs(self.R[trials])


def axis_signs(A: Array, B: Array) -> Signs | None:
    """The `Signs` for motions (T, N, 4, 4), or None if no motion of A is near a half turn."""
    trace = np.trace(A[..., :3, :3], axis1=-2, axis2=-1)
    if trace.min() > 4.0 * NEAR_HALF_TURN_SCALAR**2 - 1.0:  # tr R = 4 w^2 - 1
        return None
    u, v = vee(A[..., :3, :3]), vee(B[..., :3, :3])
    H = u.mT @ v
    s = np.linalg.svd(H, compute_uv=False)
    require(
        s[:, 1] > HALF_DIGITS * A.shape[1],
        "some motions rotate by 180 degrees, where the sign of an axis is open, and the others do not determine it.",
    )
    return Signs(orthonormalise(H))


def quaternions(A: Array, B: Array, signs: Signs | None) -> tuple[Array, Array]:
    """Unit quaternions (..., m, 4) of the rotations of A and B (..., m, 4, 4), with consistent signs."""
    q_A, q_B = (
        Rotation.from_matrix(T[..., :3, :3], assume_valid=True).as_quat(canonical=True, scalar_first=True)
        for T in (A, B)
    )
    if signs is None:
        return q_A, q_B
    if signs.like is not None:
        for q, base in zip((q_A, q_B), signs.like, strict=True):
            q *= np.where(np.einsum("...i,...i->...", q, base) < 0, -1.0, 1.0)[..., None]
        return q_A, q_B
    aligned = np.einsum("...mi,...ij,...mj->...m", q_A[..., 1:], signs.R, q_B[..., 1:])
    q_B *= np.where((q_A[..., 0] < NEAR_HALF_TURN_SCALAR) & (aligned < 0), -1.0, 1.0)[..., None]
    return q_A, q_B


def rotation_vectors(q: Array) -> Array:
    """``angle axis`` (..., 3) of unit quaternions, of an angle beyond 180 degrees where w < 0."""
    sine = np.sqrt(np.einsum("...i,...i->...", q[..., 1:], q[..., 1:]))
    angle = 2.0 * np.arctan2(sine, q[..., 0])
    factor = np.where(sine > CHAIN_ROUNDING, angle / np.where(sine > CHAIN_ROUNDING, sine, 1.0), 2.0)
    return np.asarray(factor[..., None] * q[..., 1:])


def unit_axes(q: Array, name: str) -> Array:
    """``axis`` (..., 3) of unit quaternions; a rotation by less than 1e-9 rad has none."""
    sine = np.sqrt(np.einsum("...i,...i->...", q[..., 1:], q[..., 1:]))
    flat = (sine > CHAIN_ROUNDING).reshape(-1, sine.shape[-1]).all(axis=-1)
    require(flat, f"a motion in `{name}` does not rotate, so that its axis is open; leave such pairs out.")
    return np.asarray(q[..., 1:] / sine[..., None])


def dual_quaternions(T: Array, q: Array) -> Array:
    """``(q, q')`` (..., 8) with the dual part ``q' = t q / 2`` of poses with the rotations q."""
    t, w, v = T[..., :3, 3], q[..., :1], q[..., 1:]
    scalar = -np.einsum("...i,...i->...", t, v)[..., None]
    return np.concatenate([q, 0.5 * scalar, 0.5 * (w * t + np.cross(t, v))], axis=-1)


def pose_of(dual: Array) -> Array:
    """The pose (..., 4, 4) of ``(q, q')`` (..., 8) with |q| = 1: ``t = 2 q' q*``."""
    q, p = dual[..., :4], dual[..., 4:]
    t = 2.0 * (q[..., :1] * p[..., 1:] - p[..., :1] * q[..., 1:] - np.cross(p[..., 1:], q[..., 1:]))
    return pose(Rotation.from_quat(q, scalar_first=True).as_matrix(), t)


def twists(T: Array, rotvec: Array) -> Array:
    """The logarithm (..., 6) of poses: rotation vector alpha, and ``J_l(alpha)^-1 t``."""
    moment = np.linalg.solve(left_jacobian(rotvec), T[..., :3, 3:])[..., 0]
    return np.concatenate([rotvec, moment], axis=-1)


def left_matrix(q: Array) -> Array:
    """``q x = L(q) x``, (..., 4) -> (..., 4, 4)."""
    return _product_matrix(q, 1.0)


def right_matrix(q: Array) -> Array:
    """``x q = R(q) x``, (..., 4) -> (..., 4, 4)."""
    return _product_matrix(q, -1.0)


def _product_matrix(q: Array, sign: float) -> Array:
    M = np.zeros((*q.shape, 4))
    M[..., 0, 0] = q[..., 0]
    M[..., 0, 1:], M[..., 1:, 0] = -q[..., 1:], q[..., 1:]
    M[..., 1:, 1:] = q[..., :1, None] * np.eye(3) + sign * skew(q[..., 1:])
    return M
