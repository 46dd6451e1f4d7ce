"""Cholesky factors of covariances, and what is solved with many small ones."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ...core.geometry.se3 import Array
from ...errors import SingularNoiseError

# Share of a variance below which what is left of it beside the other components is rounding.
EXACT = 1e-14


def checked_cholesky(S: Array) -> Array:
    """L with ``S = L L^T``; raises `SingularNoiseError` where the noise leaves a part of the residuals exact."""
    factor = None
    with suppress(np.linalg.LinAlgError):
        factor = np.linalg.cholesky(S)
    if factor is not None:  # rounding may hide that it is singular
        pivots, variances = (np.diagonal(M, axis1=-2, axis2=-1) for M in (factor, S))
        if (pivots * pivots > EXACT * variances).all():
            return np.asarray(factor)
    raise SingularNoiseError(
        "The noise given leaves a part of the residuals exact, so that they cannot be weighted by its inverse. Give "
        "the poses of one side standard deviations above 0 in rotation and translation, or use method '4dpa'."
    )


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
