"""A pose as six numbers for people (translation in mm, rotation vector in deg), and principal axes of a covariance."""

from __future__ import annotations

import numpy as np

from .rotations import vectors
from .se3 import Array, left_jacobian, skew

# What the six numbers are.
POSE_NUMBERS = [f"{name} {axis}" for name in ("translation", "rotation vector") for axis in "xyz"]


# Part of the largest move of an open direction (mm, deg) below which a number does not move.
_STILL = 0.02


def pose_numbers(
    T: Array, covariance: Array | None, near: Array | None = None, opened: Array | None = None
) -> tuple[Array, Array | None]:
    """Translation (mm) and rotation vector (deg) of T (4, 4), both (6,): values, and standard deviations.

    ``covariance`` (6, 6) is that of (theta, tau), rad and m; the rotation vector changes by ``J_l(r)^-1 theta``. None
    gives no standard deviations. Of the two vectors of a rotation the one nearer to that of ``near`` (4, 4) is taken.
    Numbers that move along errors that are ``opened`` (k, 6) have infinite standard deviations.
    """
    vector = rotation_vector(T, near)
    values = np.concatenate([1e3 * T[:3, 3], np.degrees(vector)])
    if covariance is None:
        return values, None
    J = np.linalg.inv(left_jacobian(vector))
    rotation = np.sqrt(np.clip(np.diag(J @ covariance[:3, :3] @ J.T), 0.0, None))
    deviations = np.concatenate([1e3 * np.sqrt(np.diag(covariance)[3:]), np.degrees(rotation)])
    if opened is not None:
        moves = np.abs(np.concatenate([1e3 * opened[:, 3:], np.degrees(opened[:, :3] @ J.T)], axis=1)).reshape(-1, 2, 3)
        some = moves > _STILL * np.maximum(moves.max(axis=2, keepdims=True), 1.0)
        deviations = np.where(some.reshape(-1, 6).any(axis=0), np.inf, deviations)
    return values, deviations


def rotation_vector(X: Array, base: Array | None) -> Array:
    """The rotation vector (3,) of X nearest to that of ``base``: near 180 degrees a vector and its opposite are one."""
    vector = vectors(X[:3, :3])
    angle = float(np.linalg.norm(vector))
    if base is None or angle == 0:
        return vector
    target = vectors(base[:3, :3])
    other = vector * (1 - 2 * np.pi / angle)
    return other if np.linalg.norm(other - target) < np.linalg.norm(vector - target) else vector


def quaternion_deviations(quaternion: Array, covariance: Array) -> Array:
    """Standard deviations (4,) of a unit quaternion (x, y, z, w): ``dq = (theta, 0) q / 2``, theta of the (6, 6)."""
    J = 0.5 * np.vstack([quaternion[3] * np.eye(3) - skew(quaternion[:3]), -quaternion[:3]])
    return np.asarray(np.sqrt(np.clip(np.diag(J @ covariance[:3, :3] @ J.T), 0.0, None)))


def principal_axes(covariance: Array) -> tuple[Array, Array]:
    """Standard deviations (..., k), the largest first, and their axes as rows (..., k, k), the largest entry positive.

    ``covariance = axes^T diag(deviations^2) axes``; eigenvalues below 0, which are rounding, count as 0.
    """
    values, vectors = np.linalg.eigh(covariance)
    axes = vectors.mT[..., ::-1, :]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=-1)[..., None], axis=-1)
    return np.sqrt(np.maximum(values[..., ::-1], 0.0)), axes * np.where(largest < 0, -1.0, 1.0)
