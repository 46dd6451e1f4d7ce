"""Conditions under which a propagated covariance is not valid, as findings from quantities already computed.

Two kinds of methods have a covariance that may be off by factors though that of every other is exact to first order:

- One whose X is no smooth function of the data has a covariance in the limit of many data
  (`methods.method.Method.covariance`), and says which share of the information that limit does not cover.
- One that weights by the noise is differentiated with its weights held fixed, as their derivatives multiply residuals.
  These terms count where the error of X is curved, `bend`.
"""

from __future__ import annotations

import numpy as np

from ..core.geometry.se3 import Array, skew
from ..core.rounding import SOLUTION_ROUNDING, TINY
from ..findings import Finding
from . import sentences  # noqa: F401  (registers the words)
from .method import Method

# Number of independent pairs or poses below which the covariance of a method that is not smooth cannot be trusted.
MIN_DATA_FOR_LIMIT = 10
# Largest share of the information from residuals that are known better than X. Measured on 10 to 20 motions: below 0.6
# the sampled variances are within a factor 2 of the covariance, above 0.65 they are up to 200 times as large.
MAX_PRECISE_SHARE = 0.6
# Largest bend, in standard deviations. Measured on 11 poses: 0.005 on data that are well spread; from 0.1 on the
# derivatives are off by factors of two.
MAX_BEND_SD = 0.1


def find_few(method: Method, count: int, item: str) -> list[Finding]:
    """Report pairs or poses that are too few for a covariance in the limit of many data."""
    if count >= MIN_DATA_FOR_LIMIT:
        return []
    return [
        Finding(
            "propagation.few_data",
            "caution",
            {"method": method.name, "count": count, "item": item, "enough": MIN_DATA_FOR_LIMIT},
        )
    ]


def find_precise_residuals(method: Method, share: float) -> list[Finding]:
    """Report residuals known better than X that hold too large a share of the information about it."""
    if share <= MAX_PRECISE_SHARE:
        return []
    return [Finding("propagation.precise_residuals", "caution", {"method": method.name, "share": share})]


def find_curved(method: Method, A: Array, B: Array, X: Array, covariance: Array) -> list[Finding]:
    """Report a method that weights by the noise and bends too much; arrays as for `bend`."""
    if not method.weighted:
        return []
    largest = float(bend(A, B, X, covariance).max())
    return [Finding("propagation.curved", "caution", {"method": method.name, "bend": largest})] * (
        largest > MAX_BEND_SD
    )


def bend(A: Array, B: Array, X: Array, covariance: Array) -> Array:
    r"""Return by how far the translation of X leaves the straight line as its rotation varies, (T,).

    Given the rotation ``R = exp([theta]x) R_hat``, the translation minimises ``sum |R t_B - t_A - (R_A - I) t|^2``. Its
    second order in theta is

        c(theta) = (sum D^T D)^-1 sum D^T [theta]x [theta]x R_hat t_B / 2,     D = R_A - I

    For ``theta ~ N(0, Sigma_R)`` this is the root mean square of c, in standard deviations of t given R by the
    covariance, in the direction where it is largest.

    Parameters
    ----------
    A, B : (T, N, 4, 4)
    X : (T, 4, 4)
    covariance : (T, 6, 6)
        First-order covariance of X.
    """
    D = A[..., :3, :3] - np.eye(3)
    moved = B[..., :3, 3] @ X[:, :3, :3].mT
    values, axes = np.linalg.eigh(covariance[:, :3, :3])
    values = np.maximum(values, 0.0)
    by_axis = skew(np.sqrt(values)[:, :, None] * axes.mT)  # (T, axis, 3, 3)
    right = np.einsum("tmkj,tml->tjkl", D, moved, optimize=True)
    normal = np.einsum("tmkj,tmkl->tjl", D, D, optimize=True)
    second = np.einsum("tjkl,taki,tbil->tabj", right, by_axis, by_axis, optimize=True)
    c = 0.25 * np.linalg.solve(normal[:, None, None], (second + second.swapaxes(1, 2))[..., None])[..., 0]
    mean = np.einsum("taaj->tj", c)
    square = mean[:, :, None] * mean[:, None, :] + 2.0 * np.einsum("tabj,tabk->tjk", c, c)
    # t given R
    to_axes = covariance[:, 3:, :3] @ axes
    known = values > SOLUTION_ROUNDING * values[:, -1:]
    to_axes /= np.sqrt(np.where(known, values, np.inf))[:, None, :]
    given = covariance[:, 3:, 3:] - to_axes @ to_axes.mT
    least, directions = np.linalg.eigh(given)
    floor = SOLUTION_ROUNDING * np.linalg.trace(covariance[:, 3:, 3:])[:, None]
    whitened = directions / np.sqrt(np.maximum(np.maximum(least, floor), TINY))[:, None, :]
    return np.asarray(np.sqrt(np.linalg.eigvalsh(whitened.mT @ square @ whitened)[:, -1].clip(min=0.0)))
