r"""Rejection of corners that were detected in the wrong place.

A corner is left out where its residual, the distance in pixels between measured and predicted, exceeds
``MAX_DISTANCE_SD`` times the pixel noise s. For Gaussian noise that happens to one good corner in
``exp(MAX_DISTANCE_SD^2 / 2)``, 65 million. s is estimated from the distances d of the corners that are used: from their
95 % quantile, because real corners have heavier tails than Gaussian ones, and a share of a few per cent is no mistake;
or, where more than that are wrong, as three times what their median gives:

    s = min( d_95 / 2.448,  3 d_50 / 1.177 )        both d_95 / 2.448 and d_50 / 1.177 are s for Gaussian noise

One wrong corner drags the pose of its picture, so that the good corners of that picture look bad too. Hence only those
corners of a picture are left out at a time that are at least half as far off as the worst; then the bundle is adjusted
again. Corners that the new fit predicts well return.

A picture without four good corners keeps bad ones, because its pose needs them, and they bias s: `spoilt` returns such
pictures, which are to be left out as a whole.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array
from ..corners import MIN_CORNERS, Corners
from .bundle import Bundle

# Distance of a corner from its predicted place, over the pixel noise, beyond which it is left out.
MAX_DISTANCE_SD = 6.0


def tail_deviation(distance: Array) -> float:
    """s of the distances (m,); see the module."""
    # Quantiles of the length of a standard Gaussian vector in the plane: 1 - exp(-d^2 / 2).
    q95, q50 = np.sqrt(2 * np.log([20.0, 2.0]))
    return float(min(np.quantile(distance, 0.95) / q95, 3.0 * np.median(distance) / q50))


def without_outliers(
    corners: Corners,
    adjust: Callable[[NDArray[np.bool_], Bundle | None], Bundle],
    before: Bundle | None = None,
    max_rounds: int = 20,
) -> tuple[Bundle, NDArray[np.bool_]]:
    """The bundle on the good corners, and which corners (m,) are so.

    ``adjust`` gets the corners to use and the bundle to start from. A picture keeps at least four corners. Distances
    are in units of the noise of their picture, times s. ``before``: what to go on from.
    """
    used = np.ones(corners.m, dtype=bool) if before is None else before.used
    found = adjust(used, before)
    for _ in range(max_rounds):
        distance = np.linalg.norm(found.residuals, axis=1) * np.sqrt(found.weights)[corners.picture]
        limit = MAX_DISTANCE_SD * tail_deviation(distance[used])
        worst = np.maximum.reduceat(np.where(used, distance, 0.0), np.flatnonzero(corners.place == 0))
        out = used & (distance > np.maximum(limit, 0.5 * worst[corners.picture]))
        kept = np.bincount(corners.picture[used & ~out], minlength=corners.n)
        out &= (kept >= MIN_CORNERS)[corners.picture]
        back = ~used & (distance <= limit)
        if not (out.any() or back.any()):
            break
        used = (used | back) & ~out
        found = adjust(used, found)
    return found, used


def spoilt(corners: Corners, found: Bundle) -> NDArray[np.bool_]:
    """Pictures (n,) of which fewer than half of the corners fit, or that use corners beyond the limit."""
    distance = np.linalg.norm(found.residuals, axis=1)
    beyond = distance > MAX_DISTANCE_SD * tail_deviation(distance[found.used])
    total, kept, bad = (
        np.bincount(corners.picture[part], minlength=corners.n)
        for part in (np.ones(corners.m, dtype=bool), found.used, found.used & beyond)
    )
    return np.asarray((2 * kept < total) | (bad > 0))
