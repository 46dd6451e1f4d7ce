r"""Robust weights of the poses and sizes of all errors, estimated in turn.

Weights depend on the noise (`robust`), the noise on the weights (`estimation`). Columns of shared errors are first
computed at the measured poses. They then contain the noise of these, and so do the residuals: where X and W absorb the
rest of a column, the residuals would seem to show the error. Once the weights have converged, the columns are computed
at the poses as the fit corrects them, and the sizes are estimated again.

Where many poses are rejected, a start with all weights 1 is tried as well: errors that no model of an arm explains
differ from pose to pose and have heavy tails. Of the two results the more probable one counts, unless its noise is too
large for a model that is linear in it, with rejected rows as
outliers: off by a vector of any size, all orders of magnitude alike (L = `OUTLIER_LOG_RANGE` of them), whose density in
three dimensions is ``1 / (4 pi L |v|^3)``, in units of the noise, for v the rotation residual and for v the translation
residual given that of rotation. Any number k of the n rows may be outliers, all numbers alike and all choices of a
number alike. A density uniform in space is not used: a detection 20 mm off would then cost as much as one a metre off,
and six of twenty would be explained as noise.

An iteration that rejects more and more poses is stopped once the start with all weights 1 has led to a more probable
result: rejecting poses makes the noise of the others smaller, and further ones outliers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from ...core.geometry.se3 import Array
from ...errors import InputError, NotConvergedError
from ...model.errors.models import Noise, with_prior
from ...model.errors.square_roots import marginals
from .constraint import Constraint, Unknowns
from .estimation import FoundSizes, JointModel
from .gauss_helmert import CLOSED_FORM_STEPS, MAX_ML_STEPS, Fit, fit
from .mode import ROUGH_GAIN, Mode
from .robust import NoiseSearch, RobustFit, fit_robustly, is_weak_minority, judged_by

# Share of rejected poses above which all poses are tried as a start as well; and over how many powers of e the size of
# an outlier is spread.
MANY_REJECTED_SHARE, OUTLIER_LOG_RANGE = 0.05, 7.0
# Estimates of the noise after which a weighing that rejects ever more poses may be given up.
MIN_ESTIMATES = 4
# Beside the errors of an arm a pose is wrong from this many times the usual d^2 on. Poses left out for their tails make
# the noise of the others too small for new ones.
TAIL_SLACK = 3.0


class _Overtaken(Exception):
    """The other start has led to a more probable result than a weighing that rejects ever more rows."""


def weigh(
    source: JointModel,
    at: Unknowns,
    method: str = "efficient",
    seed: int | np.random.Generator = 0,
    slack: float = 1.0,
    all_alike: bool = False,
    rival: Callable[[], float] | None = None,
) -> tuple[RobustFit, FoundSizes | None]:
    """Robust weights, and the sizes of the errors that they go with; ``slack``, ``all_alike`` as of `NoiseSearch`.

    ``rival``: the `_cost` of another result, for which this one is given up (`_Overtaken`).
    """
    found: FoundSizes | None = None
    rejected: list[int] = []

    def estimate_noise(constraint: Constraint, at: Unknowns, weights: Array) -> Noise | None:
        nonlocal found
        found = source.find(at, weights, None if found is None else found.mode.theta, ROUGH_GAIN)
        if found.noise is None:
            return None
        noise = with_prior(found.noise, source.pose_prior)
        rejected.append(int((weights == 0).sum()))
        grows = len(rejected) > MIN_ESTIMATES and rejected[-1] > max(rejected[-2], MANY_REJECTED_SHARE * len(weights))
        if rival is not None and grows:
            fitted = fit(constraint, noise, at, CLOSED_FORM_STEPS, weights)
            if cost_of(fitted, found, len(weights)) > rival():
                raise _Overtaken
        return noise

    search = NoiseSearch(estimate_noise, source.pose_prior, slack, all_alike)
    return fit_robustly(source.constraint, None, at, method, search, seed), found


def weigh_from_two_starts(
    source: JointModel, at: Unknowns, method: str, seed: int | np.random.Generator, slack: float, slack_of_all: float
) -> tuple[RobustFit, FoundSizes | None]:
    """`weigh`, and where many rows are rejected the more probable of that and of all rows alike (module).

    ``slack_of_all``: that of all rows alike.
    """

    @cache
    def from_all() -> tuple[RobustFit, FoundSizes | None] | None:
        with suppress(InputError, NotConvergedError):
            return weigh(source, at, method, seed, slack_of_all, all_alike=True)
        return None

    def rival() -> float:
        other = from_all()
        return float("inf") if other is None else _cost(other)

    try:
        robust, found = weigh(source, at, method, seed, slack, rival=rival)
    except _Overtaken:
        other = from_all()
        assert other is not None
        return other
    if found is not None and not found.exact.any() and (robust.weights == 0).mean() > MANY_REJECTED_SHARE:
        other = from_all()
        if other is not None and _is_of_first_order(other[0]) and _cost(other) < _cost((robust, found)):
            return other
    return robust, found


def _is_of_first_order(robust: RobustFit, most: float = 0.1) -> bool:
    """Return whether the rotation noise of most rows is below ``most`` rad, up to which noise adds up as vectors.

    Larger noise explains half turns of half of the rows, whatever the density of outliers.
    """
    variances = marginals(robust.fit.S)[:, :3, :3].trace(axis1=1, axis2=2) / 3.0
    return float(np.median(variances)) < most**2


def settle(
    source: JointModel, noise: Noise, fitted: Fit, robust: RobustFit | None, found: FoundSizes, method: str,
    at_corrected: Callable[[JointModel, Noise, Fit], JointModel],
) -> tuple[FoundSizes, Noise, Fit, RobustFit | None]:  # fmt: skip
    """Sizes with the columns at the poses as the fit corrects them (``at_corrected``), integrated over, and the fit.

    Rows are judged again by that noise: columns at measured poses hold their noise, and with much of it good rows stand
    out. Where other rows count then, the sizes are found again; but not from few rows against most of the others.
    """
    modes: Sequence[Mode] | None = None
    for _ in range(3):  # times at most that rows are judged
        kept = None if robust is None else np.array([flag == "kept" for flag in robust.flags], dtype=float)
        found = at_corrected(source, noise, fitted).find(fitted.unknowns, kept, found.mode.theta, known=modes)
        modes = found.others
        noise = with_prior(found.integrated_noise, source.pose_prior)
        fitted = fitted_again(source.constraint, noise, fitted, method)
        if robust is None:
            break
        again = judged_by(robust, fitted, noise)
        if again.flags == robust.flags or is_weak_minority(again.flags.count("kept"), len(again.flags)):
            break  # the noise of a few rows condemns ever more of the others
        robust = again
        fitted = fitted_again(source.constraint, noise, robust.fit, method)
    return found, noise, fitted, None if robust is None else replace(robust, fit=fitted)


def fitted_again(constraint: Constraint, noise: Noise, found: Fit, method: str) -> Fit:
    """The fit with other noise, from the unknowns and with the weights that were found."""
    return fit(
        constraint, noise, found.unknowns, CLOSED_FORM_STEPS if method == "efficient" else MAX_ML_STEPS, found.weights
    )


def _cost(weighed: tuple[RobustFit, FoundSizes | None]) -> float:
    """Return minus the logarithm of the probability of the rows, those left out as outliers (module)."""
    robust, found = weighed
    if found is None or found.exact.any():
        return float("inf")
    return cost_of(robust.fit, found, len(robust.weights))


def cost_of(fit: Fit, found: FoundSizes, n: int) -> float:
    """`_cost` of a fit to n rows with the sizes found."""
    kept = len(found.kept)
    inside = kept * (found.mode.state.value / len(found.used) + 3.0 * float(np.log(2.0 * np.pi)))
    return inside + _as_outliers(fit, np.setdiff1d(np.arange(n), found.kept))


def _as_outliers(fit: Fit, rows: NDArray[np.intp]) -> float:
    """Minus the logarithm of the density of rows that are outliers (module), predicted by the others."""
    if not len(rows):
        return 0.0
    J = fit.linear.J[rows]
    C = marginals(fit.S)[rows] + J @ fit.covariance @ J.mT
    L = np.linalg.cholesky(C)
    off = np.linalg.solve(L, fit.residual[rows][..., None])[..., 0]
    away = np.linalg.norm(off.reshape(-1, 2, 3), axis=-1)
    n, k = len(fit.residual), len(rows)
    choices = gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1)
    density = np.log(4.0 * np.pi * OUTLIER_LOG_RANGE) + 3.0 * np.log(np.maximum(away, np.sqrt(3.0)))
    return float(np.log(np.einsum("nii->ni", L)).sum() + density.sum() + choices)
