r"""Weights of pictures, which differ in noise by blur, distance and light.

The residuals r_i of picture i give the variance ``s_i^2 = |r_i|^2 / m_i`` per coordinate, with the degrees of freedom
``m_i = 2 n_i - 6``, minus its share of the intrinsics'. The spread of the variances between pictures follows from all
of them (empirical Bayes): the true variances are spread about a common one as scaled inverse chi-square with nu degrees
of freedom, ``v_0 nu / v_i ~ chi^2(nu)``, so that s_i^2 is distributed as ``v_0 F(m_i, nu)`` and the mean of 1 / v_i
given the data is that of

    v_i = (nu v_0 + m_i s_i^2) / (nu + m_i)

nu and v_0 follow from the mean and the variance of ``e_i = log s_i^2 - psi(m_i / 2) + log(m_i / 2)`` (G. K. Smyth,
Stat. Appl. Genet. Mol. Biol. 3 (2004), doi:10.2202/1544-6115.1027):

    E e = log v_0 - psi(nu / 2) + log(nu / 2),      Var e = psi'(nu / 2) + psi'(m_i / 2)

Pictures that differ no more than by chance all have v_0 (nu infinite), those that differ a lot keep their own.

Residuals that are small within a picture show little of the errors that its corners share: edges that run along the
pixels in a rendered picture, the light, a blur to one side. Hence no picture counts for more than the median one does:
``w_i = s^2 / v_i`` or, where that is less, the median of these.
"""

from __future__ import annotations

import numpy as np

from ....core.geometry.se3 import Array
from ....core.rounding import HALF_DIGITS
from ..corners import Corners
from .bundle import Bundle

# Degrees of freedom nu of pictures that have next to nothing in common.
MIN_COMMON_DOF = 0.1


def picture_weights(bundle: Bundle, corners: Corners) -> Array:
    """(n,) ``w_i`` from the residuals of a bundle in which all pictures count alike, s its pixel noise.

    With them ``s / sqrt(w_i)`` is the noise of picture i.
    """
    part = corners.picture[bundle.used]
    squares = np.bincount(part, np.sum(bundle.residuals[bundle.used] ** 2, axis=1), corners.n)
    freedom = np.maximum(2.0 * np.bincount(part, minlength=corners.n) - 6.0, 0.0)
    known = (freedom > 0) & (squares > 0)
    if known.sum() < 2 or bundle.freedom <= 0:  # exact corners, or too few of them
        return np.ones(corners.n)
    freedom *= bundle.freedom / freedom.sum()
    common, nu = common_variance(squares[known] / freedom[known], freedom[known])
    own = squares / np.where(freedom > 0, freedom, 1.0)
    share = freedom / (freedom + nu)  # of its own variance: 0 where nu is infinite
    weights = bundle.pixel_noise**2 / ((1 - share) * common + share * own)
    return np.asarray(np.minimum(weights, np.median(weights)))


def common_variance(variances: Array, freedom: Array) -> tuple[float, float]:
    """v_0 and nu of variances (n,) that are known with ``freedom`` (n,) degrees of freedom; see the module."""
    from scipy.optimize import brentq  # slow to import
    from scipy.special import digamma, polygamma

    e = np.log(variances) - digamma(freedom / 2) + np.log(freedom / 2)
    spread = float(e.var(ddof=1) - polygamma(1, freedom / 2).mean())
    most = 1.0 / HALF_DIGITS  # so large a nu weighs all pictures alike
    low, high = np.log(MIN_COMMON_DOF), np.log(most)
    if spread <= polygamma(1, most / 2):  # no more than chance
        return float(np.average(variances, weights=freedom)), np.inf
    nu = MIN_COMMON_DOF
    if spread < polygamma(1, MIN_COMMON_DOF / 2):
        nu = float(np.exp(brentq(lambda x: np.log(polygamma(1, np.exp(x) / 2) / spread), low, high)))
    return float(np.exp(e.mean() + digamma(nu / 2) - np.log(nu / 2))), nu
