"""Linear least squares in the entries of X, and rotations from 3x3 matrices, for `andreff`, `gwak`, `li` and `shah`.

The normal equations ``G x = g`` are linear in the moments m of the data,

    G = N G_0 + sum_k m_k G_k,    g = sum_k m_k g_k,    hence exactly    dx/dm_k = G^-1 (g_k - G_k x)

A 3x3 block M of x is replaced by the nearest rotation R; with
``M = R S``, S symmetric, and ``dM``

    theta = R (tr(S) I - S)^-1 vee(R^T dM),    vee(W) = (W32 - W23, W13 - W31, W21 - W12)

is the left rotation by which R moves.

``A X = X B`` as linear equations in the twelve entries of X: what `andreff` and `gwak` sum over the pairs.

With r the entries of R_X row by row, a pair gives

    (R_A kron R_B - I) r = 0,     (I kron t_B^T) r + (I - R_A) t = t_A

whose sum of squares ``sum |R_A R R_B^T - R|^2 + |R t_B + (I - R_A) t - t_A|^2 = x^T G x - 2 g^T x + const``, x = (r,
t), is that of ``|A X - X B|^2``, and needs only products of entries of A with entries of B, summed. They are summed for
``D = R - I``, so that small rotations do not drown in the rounding of large sums.

The second stage of the separated methods: the translation of X by linear least squares, given its rotation.

Minimises ``sum_i |(R_A - I) t_X - (R_X t_B - t_A)|^2``, the translation part of ``A X = X B``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ....core.geometry.nearest_rotation import orthonormalise
from ....core.geometry.se3 import Array, vee
from ...procrustes.degeneracy import DEGENERATE
from .axes import Signs
from .method import Estimate, closed_form, require
from .moments import Factors

# Ratio of the eigenvalues of the normal equations, scaled to equal diagonals, below which the least is rounding.
SINGULAR = 1e-13
# How far the singular values of a matrix that ought to be a rotation may be from their mean, relative to it.
DEFORMED = 0.5

_EYE = np.eye(3)


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
    require(values[:, 0] > SINGULAR * values[:, -1], "its linear equations are singular.")
    return Normal(scaled, d)


def require_axes(M: Array, N: int) -> None:
    """Raise `Singular` unless ``sum (I - R_A)^T (I - R_A)`` (T, 3, 3) of N pairs sees all directions.

    This comes before any scaling, which would lift a sum that is nothing but rounding.
    """
    values = np.linalg.eigvalsh(M)
    require(values[:, 0] > DEGENERATE * np.maximum(values[:, 2], 1e-4 * N), "the rotation axes are parallel.")


def require_rotation(M: Array) -> None:
    """Raise `Singular` where M (T, 3, 3) is no multiple of a rotation, hardly deformed."""
    s = np.linalg.svd(M, compute_uv=False)
    mean = s.mean(axis=1)
    require(
        (s[:, 2] > (1.0 - DEFORMED) * mean) & (mean > 0),
        "noise deforms its unconstrained matrix too far from any rotation.",
    )


def require_scale(M: Array) -> None:
    """Raise `Singular` where M (T, 3, 3), not scaled, has shrunk: translations too small to fix its size."""
    require_rotation(M)
    size = np.cbrt(np.abs(np.linalg.det(M)))
    require(
        np.abs(size - 1.0) < DEFORMED,
        "the translations are too small against the noise to fix the scale of its unconstrained matrix.",
    )


def slopes(
    assemble: Callable[[Array], tuple[Array, Array]], shape: tuple[int, int], equations: Normal, x: Array
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
    Z = np.trace(S, axis1=-2, axis2=-1)[:, None, None] * _EYE - S
    return np.asarray(R @ np.linalg.solve(Z, vee(W).mT))


def right_handed(x: Array) -> Array:
    """The rotation (T, 3, 3) nearest to a 3x3 matrix given up to its sign, row by row (T, 9)."""
    M = x.reshape(-1, 3, 3)
    return orthonormalise(np.where(np.linalg.det(M) < 0, -1.0, 1.0)[:, None, None] * M)


SHAPE = (16, 16)  # of the moments


def kronecker_factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    """``(D_A, t_A, 1, t_B)`` and ``(D_B, t_B, 1, D_A^T t_A)``, each (..., 16)."""
    D_A, D_B, t_A, t_B = A[..., :3, :3] - _EYE, B[..., :3, :3] - _EYE, A[..., :3, 3], B[..., :3, 3]
    one = np.ones((*t_A.shape[:-1], 1))
    turned = (D_A.mT @ t_A[..., None])[..., 0]
    left = np.concatenate([D_A.reshape(*one.shape[:-1], 9), t_A, one, t_B], axis=-1)
    right = np.concatenate([D_B.reshape(*one.shape[:-1], 9), t_B, one, turned], axis=-1)
    return ((left, right),)


def normal_equations(moments: Array) -> tuple[Array, Array]:
    """G (T, 12, 12) and g (T, 12) from the moments (T, 16, 16)."""
    T = len(moments)
    D_A, t_A, one, t_B = moments[:, :9], moments[:, 9:12], moments[:, 12], moments[:, 13:]
    sum_A = D_A[:, :, 12].reshape(T, 3, 3)
    G = np.zeros((T, 12, 12))
    G[:, :9, :9] = rotation_equations(moments)
    G[:, :9, :9] += (_EYE[:, None, :, None] * t_B[:, None, :, None, 9:12]).reshape(T, 9, 9)
    # (I kron t_B)(I - R_A): rows (a, c), columns b
    G[:, :9, 9:] = -D_A[:, :, 9:12].reshape(T, 3, 3, 3).swapaxes(2, 3).reshape(T, 9, 3)
    G[:, 9:, :9] = G[:, :9, 9:].mT
    G[:, 9:, 9:] = -sum_A - sum_A.mT  # sum (I - R_A)^T (I - R_A)
    g = np.concatenate([t_A[:, :, 9:12].reshape(T, 9), -one[:, 13:]], axis=1)
    return G, g


def rotation_equations(moments: Array) -> Array:
    """The part (T, 9, 9) of G by the rotations only, ``sum |R_A R R_B^T - R|^2``."""
    T = len(moments)
    sum_A, sum_B = moments[:, :9, 12].reshape(T, 3, 3), moments[:, 12, :9].reshape(T, 3, 3)
    kron = moments[:, :9, :9].reshape(T, 3, 3, 3, 3).transpose(0, 1, 3, 2, 4)  # rows (a, c), columns (b, d)
    kron = kron + sum_A[:, :, None, :, None] * _EYE[:, None, :] + _EYE[:, None, :, None] * sum_B[:, None, :, None, :]
    kron = kron.reshape(T, 9, 9)  # sum (R_A kron R_B - I)
    return np.asarray(-kron - kron.mT)


def residual_gradient(A: Array, B: Array, x: Array) -> Array:
    """Half the gradient (T, 12) of the sum of squares at x, from the residuals of motions (T, m, 4, 4) themselves."""
    R, t = x[:, None, :9].reshape(-1, 1, 3, 3), x[:, None, 9:, None]
    D_A, R_B, t_B = A[..., :3, :3] - _EYE, B[..., :3, :3], B[..., :3, 3:]
    turned = R @ R_B.mT
    of_R = D_A @ turned + turned - R  # R_A R R_B^T - R
    of_t = R @ t_B - D_A @ t - A[..., :3, 3:]
    by_R = (D_A.mT @ of_R @ R_B + of_R @ R_B - of_R + of_t @ t_B.mT).sum(axis=1)
    return np.concatenate([by_R.reshape(-1, 9), -(D_A.mT @ of_t).sum(axis=1)[..., 0]], axis=1)


def translation_factors(A: Array, B: Array) -> tuple[Array, Array]:
    """``(D, D^T t_A)`` (..., 12) with ``D = R_A - I``, and ``(t_B, 1)`` (..., 4)."""
    D, t = A[..., :3, :3] - _EYE, A[..., :3, 3:]
    left = np.concatenate([D.reshape(*D.shape[:-2], 9), (D.mT @ t)[..., 0]], axis=-1)
    right = np.concatenate([B[..., :3, 3], np.ones((*B.shape[:-2], 1))], axis=-1)
    return left, right


def with_translation(R: Array, moments: Array, N: int) -> Estimate:
    """X (T, 4, 4) from its rotation (T, 3, 3) and the moments (T, 12, 4) of `translation_factors`."""
    D = moments[:, :9, 3].reshape(-1, 3, 3)
    M = -(D + D.mT)  # sum D^T D, as R_A^T R_A = I
    values = np.linalg.eigvalsh(M)
    require(values[:, 0] > DEGENERATE * np.maximum(values[:, 2], 1e-4 * N), "the translation is not determined.")
    D_tB = moments[:, :9, :3].reshape(-1, 3, 3, 3)  # sum D[b, a] t_B[c]
    rhs = np.einsum("tbac,tbc->ta", D_tB, R) - moments[:, 9:, 3]
    X = np.zeros((len(R), 4, 4))
    X[:, :3, :3] = R
    X[:, :3, 3] = np.linalg.solve(M, rhs[..., None])[..., 0]
    X[:, 3, 3] = 1.0
    return closed_form(X)
