"""Residuals of motions and of poses by X, and their summary."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array


class Residuals(NamedTuple):
    """Residuals of the motions by X: rotation in rad, translation in the unit of the input, over pairs."""

    rotation_rms: float
    rotation_median: float
    rotation_max: float
    translation_rms: float
    translation_median: float
    translation_max: float
    error: float  # (62): sqrt(sum |A X - X B|^2) / N
    pairs: int  # how many pairs were looked at


def rotation_angles(R: Array) -> Array:
    """Rotation angle in [0, pi] of R (..., 3, 3), exact also at 0 and pi: ``atan2(|vee R|, tr R - 1)``."""
    x, y, z = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    return np.asarray(np.arctan2(np.sqrt(x * x + y * y + z * z), np.trace(R, axis1=-2, axis2=-1) - 1.0))


def residuals(A: Array, B: Array, X: Array) -> tuple[Array, Array]:
    """Rotation angle of ``(A X)(X B)^-1`` and length of ``t(A X) - t(X B)`` per pair: two arrays (N,)."""
    difference = A[..., :3, :] @ X - X[..., :3, :] @ B
    squares = np.einsum("...ij,...ij->...", difference[..., :3], difference[..., :3])
    # |R_1 - R_2| = 2 sqrt(2) sin(angle / 2) in the Frobenius norm
    angle = 2.0 * np.arcsin(np.minimum(np.sqrt(squares / 8.0), 1.0))
    offset = difference[..., 3]
    return angle, np.sqrt(np.einsum("...i,...i->...", offset, offset))


def median(values: Array) -> float:
    """``np.median`` of a vector at a fifth of its time, which counts on small data."""
    k = values.size // 2
    if values.size % 2:
        return float(np.partition(values, k)[k])
    low, high = np.partition(values, (k - 1, k))[k - 1 : k + 1]
    return 0.5 * (float(low) + float(high))


def summarise(angle: Array, distance: Array) -> Residuals:
    """`Residuals` from those of each pair."""
    frobenius = 8.0 * np.sin(0.5 * angle) ** 2 + distance**2
    return Residuals(
        float(np.sqrt(np.mean(angle**2))),
        median(angle),
        float(angle.max()),
        float(np.sqrt(np.mean(distance**2))),
        median(distance),
        float(distance.max()),
        float(np.sqrt(frobenius.sum()) / len(angle)),
        len(angle),
    )


def pose_residuals(G: Array, C: Array, X: Array) -> tuple[Array, Array]:
    """Rotation angle and distance (n,) of each ``W_k = G_k X C_k`` from their mean over the better half."""
    W = G @ X @ C
    keep: NDArray[np.bool_] = np.ones(len(W), dtype=bool)
    for _ in range(2):
        R = orthonormalise(W[keep, :3, :3].sum(axis=0))
        angle = rotation_angles(W[:, :3, :3] @ R.T)
        shift = W[:, :3, 3] - W[keep, :3, 3].mean(axis=0)
        distance = np.sqrt(np.einsum("ni,ni->n", shift, shift))
        keep = (angle <= median(angle)) & (distance <= median(distance))
        if keep.sum() < 3:
            keep = distance <= median(distance)
    return angle, distance
