"""Linear least squares in the entries of a pose, and rotations from 3x3 matrices, for `andreff`, `gwak`, `li`, `shah`.

The normal equations ``G x = g`` are linear in the moments m of the data,

    G = N G_0 + sum_k m_k G_k,    g = sum_k m_k g_k,    hence exactly    dx/dm_k = G^-1 (g_k - G_k x)

A 3x3 block M of x is replaced by the nearest rotation R; with
``M = R S``, S symmetric, and ``dM``

    theta = R (tr(S) I - S)^-1 vee(R^T dM),    vee(W) = (W32 - W23, W13 - W31, W21 - W12)

is the left rotation by which R moves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..core.geometry.nearest_rotation import orthonormalise
from ..core.geometry.se3 import Array, vee
from ..core.rounding import SOLUTION_ROUNDING
from .degeneracy import MIN_SPREAD_RATIO
from .method import require

# Largest deviation of the singular values of a matrix that should be a rotation from their mean, relative to it, and
# of its scale from 1.
MAX_DEFORMATION = 0.5


class Normal(NamedTuple):
    """Normal equations scaled to a unit diagonal: columns of translations to the size of those of rotations."""

    scaled: Array  # (T, n, n): diag(d) G diag(d)
    d: Array  # (T, n)

    def solve(self, rhs: Array) -> Array:
        """``G^-1 rhs``, (T, n) or (T, n, k)."""
        if rhs.ndim == 2:
            return self.solve(rhs[..., None])[..., 0]
        return np.asarray(np.linalg.solve(self.scaled, rhs * self.d[..., None]) * self.d[..., None])


def normal(G: Array) -> Normal:
    """Raise `Singular` where G (T, n, n) has no inverse."""
    diagonal = np.diagonal(G, axis1=-2, axis2=-1)
    require(diagonal.min(axis=-1) > 0, "its linear equations are singular.")
    d = 1.0 / np.sqrt(diagonal)
    scaled = G * d[:, :, None] * d[:, None, :]
    values = np.linalg.eigvalsh(scaled)
    require(values[:, 0] > SOLUTION_ROUNDING * values[:, -1], "its linear equations are singular.")
    return Normal(scaled, d)


def require_axes(M: Array, N: int) -> None:
    """Raise `Singular` unless ``sum (I - R_A)^T (I - R_A)`` (T, 3, 3) of N pairs sees all directions.

    This comes before any scaling, which would lift a sum that is nothing but rounding.
    """
    values = np.linalg.eigvalsh(M)
    require(values[:, 0] > MIN_SPREAD_RATIO * np.maximum(values[:, 2], 1e-4 * N), "the rotation axes are parallel.")


def require_rotation(M: Array) -> None:
    """Raise `Singular` where M (T, 3, 3) is no multiple of a rotation, hardly deformed."""
    s = np.linalg.svd(M, compute_uv=False)
    mean = s.mean(axis=1)
    require(
        (s[:, 2] > (1.0 - MAX_DEFORMATION) * mean) & (mean > 0),
        "noise deforms its unconstrained matrix too far from any rotation.",
    )


def require_scale(M: Array) -> None:
    """Raise `Singular` where M (T, 3, 3), not scaled, has shrunk: translations too small to fix its size."""
    require_rotation(M)
    size = np.cbrt(np.abs(np.linalg.det(M)))
    require(
        np.abs(size - 1.0) < MAX_DEFORMATION,
        "the translations are too small against the noise to fix the scale of its unconstrained matrix.",
    )


def slopes(
    assemble: Callable[[Array], tuple[Array, Array]], shape: tuple[int, ...], equations: Normal, x: Array
) -> Array:
    """``dx/dm`` (T, n, p q) at the solution x (T, n), for moments of ``shape`` (p, q).

    ``assemble`` gives what of G and g is linear in the moments.
    """
    unit = np.eye(shape[0] * shape[1]).reshape(-1, *shape)
    G, g = assemble(unit)
    return equations.solve(g.T - np.einsum("kij,tj->tik", G, x))


def turn_of(M: Array, R: Array, dM: Array) -> Array:
    """theta (T, 3, k) of the rotation R (T, 3, 3) nearest to M, for changes dM (T, 9, k) of M."""
    S = R.mT @ M
    S = 0.5 * (S + S.mT)
    W = np.einsum("tji,tjck->tkic", R, dM.reshape(len(M), 3, 3, -1))
    Z = np.trace(S, axis1=-2, axis2=-1)[:, None, None] * np.eye(3) - S
    return np.asarray(R @ np.linalg.solve(Z, vee(W).mT))


def right_handed(x: Array) -> Array:
    """The rotation (T, 3, 3) nearest to a 3x3 matrix given up to its sign, row by row (T, 9)."""
    M = x.reshape(-1, 3, 3)
    return orthonormalise(np.where(np.linalg.det(M) < 0, -1.0, 1.0)[:, None, None] * M)
