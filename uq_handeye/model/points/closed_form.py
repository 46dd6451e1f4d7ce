"""Poses of a target in closed form, as starts of the fit, also where some points are outliers.

`kabsch` minimises the weighted squares of the residuals of each pose in closed form (Kabsch, Acta Cryst. A32, 1976).
`robust_kabsch` repeats it with weights that fall with the residual. `consensus` solves a pose that still has points far
off again from many triples of its points, and keeps the triple that most of the others agree with (RANSAC).
"""

from __future__ import annotations

from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median

from ...core.geometry.nearest_rotation import nearest_rotation
from ...core.geometry.se3 import Array
from ...core.limits import MIN_POSES_FOR_ROBUST, OUTLIER_MEDIANS
from ...core.rounding import TINY


def sums(values: Array, index: NDArray[np.intp], n: int) -> Array:
    """Sums (n, ...) of values (k, ...) by index (k,)."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    total = np.stack([np.bincount(index, flat[:, c], n) for c in range(flat.shape[1])], axis=-1)
    return np.asarray(total.reshape(n, *values.shape[1:]))


def placed(T: Array, p: Array, pose: NDArray[np.intp]) -> Array:
    """``R p + t`` (k, 3) of points p (k, 3), each by its pose."""
    return np.asarray((T[pose, :3, :3] @ p[..., None])[..., 0] + T[pose, :3, 3])


def kabsch(y: Array, p: Array, pose: NDArray[np.intp], n: int, weight: Array) -> Array:
    """Poses (n, 4, 4) that carry p (k, 3) to y (k, 3) by weighted least squares, all at once."""
    total = np.maximum(sums(weight, pose, n), TINY)[:, None]
    y_mean, p_mean = (sums(weight[:, None] * x, pose, n) / total for x in (y, p))
    cross = sums(weight[:, None, None] * (y - y_mean[pose])[:, :, None] * (p - p_mean[pose])[:, None], pose, n)
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3], _ = nearest_rotation(cross)
    T[:, :3, 3] = y_mean - (T[:, :3, :3] @ p_mean[..., None])[..., 0]
    return T


def robust_kabsch(y: Array, p: Array, pose: NDArray[np.intp], n: int, rounds: int = 12) -> Array:
    """`kabsch` with Geman-McClure weights about twice the median residual of each pose."""
    T = kabsch(y, p, pose, n, np.ones(len(y)))
    for _ in range(rounds):
        r = np.linalg.norm(y - placed(T, p, pose), axis=-1)
        scale = np.maximum(2.0 * np.asarray(median(r, pose, np.arange(n))), TINY)
        T = kabsch(y, p, pose, n, (1.0 + (r / scale[pose]) ** 2) ** -2.0)
    return T


def consensus(y: Array, p: Array, pose: NDArray[np.intp], n: int, triples: int = 100) -> Array:
    """`robust_kabsch`; poses with points far off are solved again from up to ``triples`` triples of their points."""
    T = robust_kabsch(y, p, pose, n)
    r = np.linalg.norm(y - placed(T, p, pose), axis=-1)
    far = OUTLIER_MEDIANS * max(float(np.median(r)), TINY)
    largest = np.zeros(n)
    np.maximum.at(largest, pose, r)
    rng = np.random.default_rng(0)
    for i in np.flatnonzero(largest > far):
        mine = np.flatnonzero(pose == i)
        if len(mine) < MIN_POSES_FOR_ROBUST:  # of four, no triple alone agrees with another
            continue
        three = np.array(list(islice(combinations(range(len(mine)), 3), triples + 1)))
        if len(three) > triples:
            three = np.argsort(rng.random((triples, len(mine))), axis=1)[:, :3]
        index = mine[three].ravel()
        tried = kabsch(y[index], p[index], np.repeat(np.arange(len(three)), 3), len(three), np.ones(len(index)))
        at = np.einsum("tab,kb->tka", tried[:, :3, :3], p[mine]) + tried[:, None, :3, 3]
        away = np.linalg.norm(y[mine] - at, axis=-1)
        best = int(np.argmin(np.minimum(away, far).sum(axis=1)))
        near = mine[away[best] < far]
        if len(near) > 3:
            T[i] = kabsch(y[near], p[near], np.zeros(len(near), dtype=np.intp), 1, np.ones(len(near)))[0]
    return T
