r"""Rejection of outlying points: a test of each against all others.

A point of residual r that was used has ``r^T (V - Q)^-1 r``, Q the covariance of its prediction, and one that was left
out ``r^T (V + Q)^-1 r``; both are chi-square distributed with 3 degrees of freedom if it is as the others. In each
round the worst point of each pose is removed, because it affects the residuals of the others, and points that fit again
return. The limit allows for the number of points: one data set in 1000 without an outlier loses a point.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED
from ...core.rounding import TINY
from .closed_form import placed
from .least_squares import Fit, Matches, by_direction, fit, median_variances, sight_lines, split_squares

# A residual that has less than this share of its variance left after the fit (its redundancy number) is not tested.
MIN_REDUNDANCY = 1e-3
# A pose needs three points that are not in a line.
MIN_POINTS_PER_POSE = 3


def squared_distances(found: Fit, points: Matches, used: NDArray[np.bool_]) -> Array:
    """(k,) test values of all ``points``, those used in the fit and the others."""
    at = placed(found.T, points.p, points.pose)
    r, V, Q = points.y - at, by_direction(sight_lines(at), *found.phi), found.predicted_covariance(points)
    S = V + np.where(used, -1.0, 1.0)[:, None, None] * Q
    half = np.linalg.inv(np.linalg.cholesky(V))
    values, vectors = np.linalg.eigh(half @ S @ half.mT)
    white = np.einsum("kba,kbc,kc->ka", vectors, half, r)
    tested = values > MIN_REDUNDANCY
    return np.asarray(np.where(tested, white**2 / np.where(tested, values, 1.0), 0.0).sum(axis=-1))


def next_used(d2: Array, points: Matches, used: NDArray[np.bool_], limit: float, again: bool) -> NDArray[np.bool_]:
    """Points to use in the next round; ``again``: those that fit return."""
    bad = np.flatnonzero(used & (d2 > limit))
    order = bad[np.lexsort((-d2[bad], points.pose[bad]))]
    first = np.ones(len(order), dtype=bool)
    first[1:] = points.pose[order][1:] != points.pose[order][:-1]
    result = used.copy()
    result[order[first]] = False
    if again:
        result |= ~used & (d2 < limit)
    return result


def fit_without_outliers(
    points: Matches, T: Array, phi: Array | None, max_rounds: int = 40
) -> tuple[Fit, NDArray[np.bool_]]:
    """Fit and test in turn, until no point leaves or returns; variances ``phi`` as given, None to estimate them.

    Returns the fit and which points it used (k,). It ends early where a pose has fewer than three points left.
    """
    estimate, used = phi is None, np.ones(len(points.y), dtype=bool)
    limit = float(chi2.isf(CONTRADICTED.probability / len(points.y), 3))
    if phi is None:
        # The first fit leaves out what is far off by the medians: it would make the variances too large.
        at = placed(T, points.p, points.pose)
        r, u = points.y - at, sight_lines(at)
        phi = median_variances(r, u, 1.0 - 2.0 * points.n / len(points.y))
        near = (split_squares(r, u) / np.maximum(phi, TINY)).sum(axis=-1) < 2.0 * limit
        enough = np.bincount(points.pose[near], minlength=points.n) > MIN_POINTS_PER_POSE
        used = np.where(enough[points.pose], near, used)
    found = fit(points.where(used), T, phi, estimate=estimate)
    for step in range(max_rounds):
        d2 = squared_distances(found, points, used)
        new = next_used(d2, points, used, limit, step < max_rounds // 2)
        if (new == used).all():
            break
        used = new
        if (np.bincount(points.pose[used], minlength=points.n) < MIN_POINTS_PER_POSE).any():
            break
        found = fit(points.where(used), found.T, found.phi, estimate=estimate)
    return found, used
