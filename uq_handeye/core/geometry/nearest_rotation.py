"""The rotation nearest to a matrix (Sub-problem 1), in any dimension."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError
from .checks import as_numbers
from .se3 import Array


def orthonormalise(matrix: ArrayLike) -> Array:
    """Sub-problem 1: the rotation in SO(n) nearest to ``matrix`` (..., n, n) in the Frobenius norm.

    ``U diag(1, .., 1, det(U V^T)) V^T`` of the singular value decomposition ``U S V^T`` of the input.

    >>> orthonormalise([[0.0, -2.0], [1.0, 0.0]])
    array([[ 0., -1.],
           [ 1.,  0.]])
    """
    matrix = as_numbers(matrix, "matrix")
    if matrix.ndim < 2 or matrix.shape[-1] != matrix.shape[-2] or matrix.shape[-1] < 1:
        raise InputError(f"Expected `matrix` to have shape (..., n, n), got {matrix.shape}.")
    if not np.isfinite(matrix).all():
        raise InputError("Expected `matrix` to be finite, got NaN or infinity.")
    return nearest_rotation(matrix)[0]


def nearest_rotation(matrix: Array) -> tuple[Array, Array]:
    """The nearest rotation, and whether it is the only one: ``s_(n-1) +- s_n > 0``, the sign that of det U V^T."""
    U, s, Vt = np.linalg.svd(matrix)
    sign = np.linalg.det(U @ Vt)
    U[..., -1] *= sign[..., None]
    unique = s[..., -2] + sign * s[..., -1] > 1e-12 * s[..., 0] if s.shape[-1] > 1 else s[..., 0] > 0
    return np.asarray(U @ Vt + 0.0), np.asarray(unique)
