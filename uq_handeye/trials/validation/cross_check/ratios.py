"""Ratios of the standard deviations of two covariances over all directions, and their distribution by chance.

Model: S sampled from T errors ``xi = (theta, tau)`` (rad and m) of covariance P; with ``r^2`` the eigenvalues of
``P^-1 S``, r are the ratios of standard deviations; they need no unit.

Sampling alone lets the ratios of a consistent P range over an interval (extreme eigenvalues of a Wishart matrix,
`consistency`; widened for heavy tails), and the root of the mean of their squares over a narrower one. Both are taken
at the level of a contradiction, so that about ten comparisons together err in at most one of 100 runs, and widened by
`HARMLESS_SD_ERROR`, below which second-order effects of the noise are not reported. S and P are not equal where a
ratio or that mean is outside.

Where tails are heavy and widen that interval beyond four such tolerances, almost any covariance would lie in it: then
equality is broken if the ratio over all directions is off by more than two and a test of `consistency` rejects, and
cannot be judged otherwise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....core.geometry.se3 import Array
from ....core.levels import CONTRADICTED
from ....core.rounding import TINY
from ..monte_carlo.consistency import HARMLESS_SD_ERROR, extreme_eigenvalues, heavy_from, in_words
from ..monte_carlo.sums import COMPONENTS

# An interval by chance that is wider than this ratio, for heavy tails, cannot confirm a covariance.
WIDE_RATIO = 1 + 4 * HARMLESS_SD_ERROR


class Ratios(NamedTuple):
    """Standard deviations of one covariance over those of another, over all directions."""

    least: float
    largest: float
    low: float  # what chance explains
    high: float
    overall: float  # root of the mean of the squared ratios
    spread: float  # by how much chance moves that, either way
    where_least: str
    where_largest: str
    kurtosis: float | None = None  # of the samples, where their tails are heavy
    rejected: bool = False  # by a test of the samples against the covariance below

    @property
    def not_below(self) -> bool:
        return self.least >= self.low * (1 - HARMLESS_SD_ERROR)

    @property
    def not_above(self) -> bool:
        return self.largest <= self.high * (1 + HARMLESS_SD_ERROR)

    @property
    def shapeless(self) -> bool:
        """True if tails are so heavy that a ratio inside of what chance explains proves nothing."""
        return self.kurtosis is not None and (self.high > WIDE_RATIO or self.low < 1 / WIDE_RATIO)

    @property
    def equal(self) -> bool | None:
        """True if chance explains the ratios; None where heavy tails leave it undecided."""
        whole = abs(self.overall - 1) <= self.spread + HARMLESS_SD_ERROR
        if not (self.not_below and self.not_above and whole):
            return False
        if not self.shapeless:
            return True
        return False if self.overall > 1 + 2 * HARMLESS_SD_ERROR and self.rejected else None

    @property
    def farthest(self) -> tuple[float, str]:
        """The ratio that is farthest off, and the direction."""
        if self.largest * self.least >= 1:
            return self.largest, self.where_largest
        return self.least, self.where_least

    @property
    def text(self) -> str:
        over = f"{number(self.least)} to {number(self.largest)} times"
        return f"{over} (overall {number(self.overall)} times)"

    @property
    def margin(self) -> str:
        """Description of what counts as equal."""
        if self.shapeless:
            assert self.kurtosis is not None
            told = "cannot be told: " if self.equal is None else ""
            return (
                f"{told}the errors have heavy tails, which no covariance describes (fourth moment "
                f"{number(1 + self.kurtosis)} times that of Gaussian errors)"
            )
        return (
            f"chance explains {self.low:.3f} to {self.high:.3f} over all directions ({1 - self.spread:.3f} to "
            f"{1 + self.spread:.3f} overall), and {100 * HARMLESS_SD_ERROR:g} % more are tolerated"
        )


def ratios(
    S: Array,
    P: Array,
    samples: int | None = None,
    kurtosis: float | None = None,
    part: slice = slice(0, 6),
    *,
    rejected: bool = False,
) -> Ratios:
    """Standard deviations of S, drawn from ``samples`` trials, over those of P.

    Parameters
    ----------
    S, P : (6, 6)
    samples : int or None
        Trials; None where both are from formulas.
    kurtosis : float or None
        Of the trials, relative to Gaussian ones: heavier tails widen what chance explains.
    part : slice
        Components that are compared.
    rejected : bool
        Whether a test of `consistency` rejects P for these trials.
    """
    from scipy.linalg import eigh

    S, P = S[part, part], P[part, part]
    unit = np.sqrt(np.diag(P))
    values, vectors = eigh(S / np.outer(unit, unit), P / np.outer(unit, unit))
    r = np.sqrt(np.maximum(values, TINY))
    low = high = 1.0
    spread = 0.0
    if samples is not None:
        low, high = chance(samples, kurtosis)
        # the mean of d^2 has the variance (E d^4 - k^2) / T; its root half of that deviation, relative to k
        spread = float(
            np.sqrt(CONTRADICTED.chi_square(1)) * np.sqrt((1 + 4 * max(kurtosis or 0.0, 0.0)) / (2 * len(r) * samples))
        )
    names = COMPONENTS[part]
    overall = float(np.sqrt(np.mean(r * r)))
    where = [in_words(vectors[:, k], names) for k in (0, -1)]
    heavy = kurtosis if samples is not None and kurtosis is not None and kurtosis > heavy_from(samples) else None
    return Ratios(float(r[0]), float(r[-1]), low, high, overall, spread, where[0], where[1], heavy, rejected)


def chance(samples: int, kurtosis: float | None = None) -> tuple[float, float]:
    """Between what all ratios of standard deviations lie with 99.9 % where the covariance is consistent."""
    widened = np.sqrt(1 + 1.5 * max(kurtosis or 0.0, 0.0))
    low, high = np.exp(0.5 * widened * np.log(extreme_eigenvalues(samples - 1, 1 - CONTRADICTED.probability)))
    return float(low), float(high)


def number(value: float | np.float64) -> str:
    """Three digits around 1, fewer decimals for larger numbers."""
    decimals = 3 if value < 2 else 2 if value < 10 else 1 if value < 100 else 0
    return f"{value:,.{decimals}f}"
