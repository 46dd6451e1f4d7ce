r"""Wrong points: a test of each against all others.

A point of residual r that was used has ``r^T (V - Q)^-1 r``, Q the covariance of its prediction, and one that was left
out ``r^T (V + Q)^-1 r``; both are chi-square distributed with 3 degrees of freedom if it is as the others. A share
`ALPHA` of data sets without a wrong point loses one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ..geometry.se3 import Array
from .least_squares import Sight
from .start import placed
from .variances import Fit

ALPHA = 1e-3
MOST_ROUNDS = 40
# A residual that has less than this share of its variance left cannot be tested.
TESTABLE = 1e-3


def limit_of(k: int) -> float:
    """Limit of the test of each of k points."""
    return float(chi2.isf(ALPHA / k, 3))


def distances(found: Fit, sight: Sight, used: NDArray[np.bool_]) -> Array:
    """(k,) test values of all points of ``sight``, those used in the fit and the others."""
    T, p = found.normal.T, found.normal.p
    at = placed(T, p[sight.point], sight.pose)
    r, V, Q = sight.y - at, found.covariance_of(at), found.normal.predicted_covariance(sight)
    S = V + np.where(used, -1.0, 1.0)[:, None, None] * Q
    half = np.linalg.inv(np.linalg.cholesky(V))
    values, vectors = np.linalg.eigh(half @ S @ half.mT)
    white = np.einsum("kba,kbc,kc->ka", vectors, half, r)
    return np.asarray(np.where(values > TESTABLE, white**2 / np.maximum(values, TESTABLE), 0.0).sum(axis=-1))


def next_used(d2: Array, sight: Sight, used: NDArray[np.bool_], limit: float, again: bool) -> NDArray[np.bool_]:
    """Points to use in the next round: the worst of each pose leaves, as it spoils the others; good ones return."""
    bad = np.flatnonzero(used & (d2 > limit))
    order = bad[np.lexsort((-d2[bad], sight.pose[bad]))]
    first = np.ones(len(order), dtype=bool)
    first[1:] = sight.pose[order][1:] != sight.pose[order][:-1]
    result = used.copy()
    result[order[first]] = False
    if again:
        result |= ~used & (d2 < limit)
    return result
