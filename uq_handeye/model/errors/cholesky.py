"""Cholesky factors of many small covariances at once, and triangular systems solved with them."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike

from ...core.geometry.se3 import Array
from ...core.rounding import PRODUCT_ROUNDING
from ...errors import SingularNoiseError


def checked_cholesky(S: Array) -> Array:
    """L with ``S = L L^T``; raises `SingularNoiseError` where the noise leaves a part of the residuals exact."""
    factor = None
    with suppress(np.linalg.LinAlgError):
        factor = np.linalg.cholesky(S)
    if factor is not None:  # rounding may hide that it is singular
        pivots, variances = (np.diagonal(M, axis1=-2, axis2=-1) for M in (factor, S))
        if (pivots * pivots > PRODUCT_ROUNDING * variances).all():
            return np.asarray(factor)
    raise _singular()


def _singular() -> SingularNoiseError:
    return SingularNoiseError(
        "The noise given leaves a part of the residuals exact, so that they cannot be weighted by its inverse. Give "
        "the poses of one side standard deviations above 0 in rotation and translation, or use method '4dpa'."
    )


def factor(covariance: ArrayLike) -> Array:
    """L with ``covariance = L L^T``, also for singular covariances; (..., k, k) -> (..., k, k)."""
    covariance = np.asarray(covariance)
    try:
        return np.asarray(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:  # only semidefinite
        return symmetric_factor(covariance)


def symmetric_factor(covariance: Array) -> Array:
    """L with ``covariance = L L^T`` by the eigenvectors (..., k, k), without what is negative by rounding."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def inverse_factor(S: Array) -> Array:
    """``L^-1`` of ``S = L L^T`` (d, d, ...), one loop over d for all of them; raises as `checked_cholesky`."""
    d = len(S)
    M = np.zeros((d, 2 * d, *S.shape[2:]))  # eliminates S, and the identity with it
    M[:, :d] = S
    M[range(d), range(d, 2 * d)] = 1.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for j in range(d - 1):
            across = slice(j + 1, d + j + 1)
            M[j + 1 :, across] -= (M[j, j + 1 : d] / M[j, j])[:, None] * M[j, across]
    pivots = np.einsum("jj...->j...", M[:, :d])
    if not (pivots > PRODUCT_ROUNDING * np.einsum("jj...->j...", S)).all():
        raise _singular()
    return np.asarray(M[:, d:] / np.sqrt(pivots)[:, None])


def substitute(lower: Array, values: Array) -> Array:
    """``lower^-1 values``, row by row for all poses at once: NumPy's solver goes from pose to pose."""
    result = np.empty((*np.broadcast_shapes(lower.shape[:-2], values.shape[:-2]), *values.shape[-2:]))
    for i in range(lower.shape[-1]):
        row = values[..., i : i + 1, :]
        if i:
            row = row - lower[..., i : i + 1, :i] @ result[..., :i, :]
        result[..., i : i + 1, :] = row / lower[..., i : i + 1, i : i + 1]
    return result


def substitute_transposed(lower: Array, values: Array) -> Array:
    """``lower^-T values``: the last row first, a lower triangle again."""
    return substitute(lower.mT[..., ::-1, ::-1], values[..., ::-1, :])[..., ::-1, :]
