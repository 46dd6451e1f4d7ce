"""``A X = X B`` as linear equations in the twelve entries of X, summed over the pairs, for `andreff` and `gwak`.

With r the entries of R_X row by row, a pair gives

    (R_A kron R_B - I) r = 0,     (I kron t_B^T) r + (I - R_A) t = t_A

whose sum of squares ``sum |R_A R R_B^T - R|^2 + |R t_B + (I - R_A) t - t_A|^2 = x^T G x - 2 g^T x + const``, x = (r,
t), is that of ``|A X - X B|^2``, and needs only products of entries of A with entries of B, summed. They are summed for
``D = R - I``, so that small rotations do not drown in the rounding of large sums.
"""

from __future__ import annotations

import numpy as np

from ..core.geometry.se3 import Array
from .moments import Factors
from .quaternions import Signs

_EYE = np.eye(3)


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
