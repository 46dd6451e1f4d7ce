"""Triangular factors of covariances whose entries differ much in size, some of which may be known exactly."""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array

# Added to the diagonal of a covariance of unit diagonal before its Cholesky factor is taken: rounding.
RIDGE = 1e-13


def factor_of(P: Array) -> Array:
    """L, lower triangular, with ``P = L L^T``; what is negative by rounding counts as `RIDGE`."""
    scale = np.sqrt(np.maximum(np.diag(P), np.finfo(float).tiny))
    scaled = P / np.outer(scale, scale)
    try:
        return np.asarray(scale[:, None] * np.linalg.cholesky(scaled + RIDGE * np.eye(len(P))))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(scaled)
        R = np.linalg.qr((vectors * np.sqrt(np.maximum(values, RIDGE))).T)[1]
        return np.asarray(scale[:, None] * (R.T * np.where(np.diag(R) < 0, -1.0, 1.0)))
