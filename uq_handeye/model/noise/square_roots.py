r"""Square roots of the covariance S of residuals, ``S = L L^T``, and what is done with them.

S has one of three forms: blocks (..., n, 6, 6), independent from pose to pose; an array (..., 6n, 6n), joint; or a
`JointCovariance`, joint by a few errors that all share. Values are (..., n, 6, p) always.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular

from ...core.geometry.se3 import Array
from .joint_covariance import JointCovariance, JointFactor, checked_cholesky, substitute, substitute_transposed

Covariance = Array | JointCovariance
Factor = Array | JointFactor
# It replaces a robust weight of 0.
LEAST_WEIGHT = 1e-12


def joint_residuals(S: Covariance) -> bool:
    """Return whether the residuals of different poses are correlated."""
    return isinstance(S, JointCovariance) or S.shape[-1] != 6


def cholesky_of(S: Covariance) -> Factor:
    """L with ``S = L L^T``; raises where the noise leaves a part of the residuals exact."""
    return S.factor if isinstance(S, JointCovariance) else checked_cholesky(S)


def whiten(factor: Factor, values: Array) -> Array:
    """``L^-1 values``."""
    if isinstance(factor, JointFactor):
        return factor.whiten(values)
    if factor.shape[-1] == 6:
        return substitute(factor, values)
    n, q = values.shape[-3], values.shape[-1]
    flat = values.reshape(*values.shape[:-3], 6 * n, q)
    white = np.asarray(solve_triangular(factor, flat, lower=True))
    return white.reshape(*white.shape[:-2], n, 6, q)


def pulled(factor: Factor, white: Array) -> Array:
    """``L^-T white``; of whitened values, ``S^-1 values``."""
    if isinstance(factor, JointFactor):
        return factor.pull(white)
    if factor.shape[-1] == 6:
        return substitute_transposed(factor, white)
    n, q = white.shape[-3], white.shape[-1]
    flat = white.reshape(*white.shape[:-3], 6 * n, q)
    return np.asarray(solve_triangular(factor, flat, lower=True, trans="T")).reshape(white.shape)


def inverse_blocks(factor: Factor) -> Array:
    """(..., n, 6, 6) diagonal blocks of ``S^-1``: what the other poses leave open of each."""
    if isinstance(factor, JointFactor):
        return factor.inverse_blocks()
    if factor.shape[-1] == 6:
        half = np.linalg.inv(factor)
        return np.asarray(half.mT @ half)
    size = factor.shape[-1]
    inverse = np.asarray(cho_solve((factor, True), np.broadcast_to(np.eye(size), factor.shape)))
    return own_blocks(inverse)


def log_determinant(factor: Factor) -> Array:
    """``log|S|`` (...); of independent poses the sum over them."""
    if isinstance(factor, JointFactor):
        return factor.log_determinant()
    logs = 2.0 * np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    return np.asarray(logs.sum(axis=-1) if factor.shape[-1] == 6 and factor.ndim > 2 else logs)


def own_blocks(S: Covariance) -> Array:
    """(..., n, 6, 6) the covariance of each pose by itself."""
    if isinstance(S, JointCovariance):
        return S.blocks
    if S.shape[-1] == 6:
        return S
    n = S.shape[-1] // 6
    index = np.arange(n)
    return np.moveaxis(S.reshape(*S.shape[:-2], n, 6, n, 6)[..., index, :, index, :], 0, -3)


def select_rows(S: Covariance, rows: NDArray[np.intp]) -> Covariance:
    """S of some of the poses."""
    if isinstance(S, JointCovariance):
        return S.rows(rows)
    if S.shape[-1] == 6:
        return np.asarray(S[..., rows, :, :])
    index = (6 * rows[:, None] + np.arange(6)).ravel()
    return np.asarray(S[..., index[:, None], index])


def weighed_blocks(S: Covariance) -> Array:
    """(..., n, 6, 6) what the weight of a pose divides: its own part of a `JointCovariance`, else its whole block."""
    return S.own if isinstance(S, JointCovariance) else own_blocks(S)


def weighted(S: Covariance, weights: Array) -> Covariance:
    """S with `weighed_blocks` divided by the weights; a weight of 0 becomes `LEAST_WEIGHT`."""
    scale = 1.0 / np.maximum(weights, LEAST_WEIGHT)
    if isinstance(S, JointCovariance):
        return S.weighted(scale)
    if S.shape[-1] == 6:
        return S * scale[..., None, None]
    n = S.shape[-1] // 6
    result = np.array(np.broadcast_to(S, (*np.broadcast_shapes(S.shape[:-2], weights.shape[:-1]), 6 * n, 6 * n)))
    for k in range(n):
        own = slice(6 * k, 6 * k + 6)
        result[..., own, own] *= scale[..., k, None, None]
    return result


def gram(white: Array) -> Array:
    """``sum over poses of white^T white``: (..., n, 6, q) -> (..., q, q)."""
    flat = white.reshape(*white.shape[:-3], -1, white.shape[-1])
    return np.asarray(flat.mT @ flat)
