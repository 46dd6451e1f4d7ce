"""Principal axes of a covariance: the directions that are least and most certain."""

from __future__ import annotations

import numpy as np

from .se3 import Array


def principal_axes(covariance: Array) -> tuple[Array, Array]:
    """Standard deviations (..., k), the largest first, and their axes as rows (..., k, k), the largest entry positive.

    ``covariance = axes^T diag(deviations^2) axes``; eigenvalues below 0, which are rounding, count as 0.
    """
    values, vectors = np.linalg.eigh(covariance)
    axes = vectors.mT[..., ::-1, :]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=-1)[..., None], axis=-1)
    return np.sqrt(np.maximum(values[..., ::-1], 0.0)), axes * np.where(largest < 0, -1.0, 1.0)
