r"""Corners that were detected in the wrong place: found, left out, and named.

A corner is left out where its residual, the distance in pixels between measured and predicted, exceeds ``FAR`` times
the pixel noise s. For Gaussian noise that happens to one good corner in ``exp(FAR^2 / 2)``, 65 million. s is estimated
from the distances d of the corners that count: their 95 % quantile, as real corners have heavier tails than Gaussian
ones and a part of a few per cent is no mistake; or, where more than that are wrong, three times what their median
says:

    s = min( d_95 / 2.448,  3 d_50 / 1.177 )        both d_95 / 2.448 and d_50 / 1.177 are s for Gaussian noise

One wrong corner drags the pose of its picture, so that good corners beside it look bad too. Hence, of each picture only
those corners are left out at a time that are at least half as far off as the worst, the bundle is adjusted again, and
so on. Corners that the new fit predicts well come back.

A picture without four good corners keeps bad ones, as its pose needs them, and they spoil s: `spoilt` names such
pictures, which are to be left out as a whole.

Weights of the corners by picture: pictures differ in noise, by blur, distance and light.

Of picture i the residuals r_i give the variance ``s_i^2 = |r_i|^2 / m_i`` per coordinate, with the degrees of freedom
``m_i = 2 n_i - 6``, less its part of the intrinsics'. What the pictures have in common says what to make of it
(empirical Bayes): the true variances are spread about a common one as scaled inverse chi-square with nu degrees of
freedom, ``v_0 nu / v_i ~ chi^2(nu)``, so that s_i^2 is distributed as ``v_0 F(m_i, nu)`` and the mean of 1 / v_i given
the data is that of

    v_i = (nu v_0 + m_i s_i^2) / (nu + m_i)

nu and v_0 follow from the mean and the variance of ``e_i = log s_i^2 - psi(m_i / 2) + log(m_i / 2)`` (G. K. Smyth,
Stat. Appl. Genet. Mol. Biol. 3 (2004), doi:10.2202/1544-6115.1027):

    E e = log v_0 - psi(nu / 2) + log(nu / 2),      Var e = psi'(nu / 2) + psi'(m_i / 2)

Pictures that differ no more than chance makes them all have v_0 (nu infinite), those that differ a lot keep their own.

Residuals that are small within a picture say little of the errors that its corners share: edges that run along the
pixels in a rendered picture, the light, a blur to one side. Hence no picture counts for more than the median one does:
``w_i = s^2 / v_i`` or, where that is less, the median of these.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array
from ..corners import FEWEST, Corners
from .bundle import Bundle

FAR = 6.0
MOST_ROUNDS = 20
_Q95, _Q50 = 2.4477, 1.1774  # quantiles of the length of a standard Gaussian in the plane


def tail_deviation(distance: Array) -> float:
    """s of the distances (m,); see the module."""
    return float(min(np.quantile(distance, 0.95) / _Q95, 3.0 * np.median(distance) / _Q50))


def without_outliers(
    corners: Corners, adjust: Callable[[NDArray[np.bool_], Bundle | None], Bundle], before: Bundle | None = None
) -> tuple[Bundle, NDArray[np.bool_]]:
    """The bundle on the good corners, and which corners (m,) are so.

    ``adjust`` gets the corners to use and the bundle to start from. A picture keeps at least four corners. Distances
    are in units of the noise of their picture, times s. ``before``: what to go on from.
    """
    used = np.ones(corners.m, dtype=bool) if before is None else before.used
    found = adjust(used, before)
    for _ in range(MOST_ROUNDS):
        distance = np.linalg.norm(found.residuals, axis=1) * np.sqrt(found.weights)[corners.picture]
        limit = FAR * tail_deviation(distance[used])
        worst = np.maximum.reduceat(np.where(used, distance, 0.0), np.flatnonzero(corners.place == 0))
        out = used & (distance > np.maximum(limit, 0.5 * worst[corners.picture]))
        kept = np.bincount(corners.picture[used & ~out], minlength=corners.n)
        out &= (kept >= FEWEST)[corners.picture]
        back = ~used & (distance <= limit)
        if not (out.any() or back.any()):
            break
        used = (used | back) & ~out
        found = adjust(used, found)
    return found, used


def spoilt(corners: Corners, found: Bundle) -> NDArray[np.bool_]:
    """Pictures (n,) of which less than half of the corners fit, or that count corners beyond the limit."""
    distance = np.linalg.norm(found.residuals, axis=1)
    beyond = distance > FAR * tail_deviation(distance[found.used])
    total, kept, bad = (
        np.bincount(corners.picture[part], minlength=corners.n)
        for part in (np.ones(corners.m, dtype=bool), found.used, found.used & beyond)
    )
    return np.asarray((2 * kept < total) | (bad > 0))


# Between which nu is looked for: from pictures that say nothing of each other to pictures that are all alike.
LEAST, MOST = 0.1, 1e6


def picture_weights(bundle: Bundle, corners: Corners) -> Array:
    """(n,) ``w_i`` from the residuals of a bundle in which all pictures count alike, s its pixel noise.

    With them ``s / sqrt(w_i)`` is the noise of picture i.
    """
    part = corners.picture[bundle.used]
    squares = np.bincount(part, np.sum(bundle.residuals[bundle.used] ** 2, axis=1), corners.n)
    freedom = np.maximum(2.0 * np.bincount(part, minlength=corners.n) - 6.0, 0.0)
    told = (freedom > 0) & (squares > 0)
    if told.sum() < 2 or bundle.freedom <= 0:  # exact corners, or too few of them
        return np.ones(corners.n)
    freedom *= bundle.freedom / freedom.sum()
    common, nu = common_variance(squares[told] / freedom[told], freedom[told])
    own = squares / np.where(freedom > 0, freedom, 1.0)
    share = freedom / (freedom + nu)  # of its own variance: 0 where nu is infinite
    weights = bundle.pixel_noise**2 / ((1 - share) * common + share * own)
    return np.asarray(np.minimum(weights, np.median(weights)))


def common_variance(variances: Array, freedom: Array) -> tuple[float, float]:
    """v_0 and nu of variances (n,) that are known with so many degrees of freedom each; see the module."""
    from scipy.optimize import brentq  # slow to import
    from scipy.special import digamma, polygamma

    e = np.log(variances) - digamma(freedom / 2) + np.log(freedom / 2)
    spread = float(e.var(ddof=1) - polygamma(1, freedom / 2).mean())
    low, high = np.log(LEAST), np.log(MOST)
    if spread <= polygamma(1, MOST / 2):  # no more than chance
        return float(np.average(variances, weights=freedom)), np.inf
    nu = LEAST
    if spread < polygamma(1, LEAST / 2):
        nu = float(np.exp(brentq(lambda x: np.log(polygamma(1, np.exp(x) / 2) / spread), low, high)))
    return float(np.exp(e.mean() + digamma(nu / 2) - np.log(nu / 2))), nu
