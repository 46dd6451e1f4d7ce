r"""Consistency of a covariance: statistics of the errors of simulated trials, and a verdict.

Model: the errors ``xi = (theta, tau)`` of T trials (rotation first, left rotation, additive translation, rad and m, in
the frame of X) are independent, Gaussian, with mean ``b`` and covariance ``S``. The hypothesis is ``b = 0, S = P`` with
``P`` the covariance predicted, to first order. Then, exactly, for the parts joint (k = 6), rotation and translation
(k = 3),

    d^2 = xi^T P^-1 xi  ~  chi-square(k)                         NEES of one trial
    sum of d^2          ~  chi-square(k T)                       mean NEES
    inside an ellipsoid of level p  ~  binomial(T, p)            coverage; intervals of Clopper and Pearson (exact)
    (T - 6) / (6 (T - 1)) T b^T S^-1 b  ~  F(6, T - 6)           bias (Hotelling; b, S those of the sample)
    n S  ~  Wishart(n, P),  n = T - 1                            S about the mean of the sample

and, with ``lambda`` the eigenvalues of ``P^-1 S`` (ratios of variances, sampled to predicted), asymptotically

    rho n sum(lambda - log lambda - 1)  ~  chi-square(21),   rho = 1 - (2 k + 1 - 2 / (k + 1)) / (6 n)

the likelihood ratio of ``S = P`` with Bartlett's correction (Muirhead, Aspects of Multivariate Statistical Theory,
1982, 8.4; Anderson, An Introduction to Multivariate Statistical Analysis, 2003, 10.8). The interval of the extreme
eigenvalues comes from simulated Wishart matrices (Bartlett's decomposition, fixed seed).

The covariance is consistent if none of seven tests rejects: mean NEES and coverage of each part, likelihood ratio;
probabilities corrected by Holm, so that a consistent covariance is rejected with at most ``1 - confidence``. Trials
that gave no estimate are in no test: where they are more than 1 %, no covariance is called consistent. The bias is no
test of the covariance: it is of second order in the noise, and counts only through the NEES.

Where each trial has its own covariance, the NEES uses that one, and ``P`` is the mean of all of them: the laws above
then hold to first order only.

NEES: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betainc, betaincinv, chdtrc, fdtrc, gammainc, gammaincc, gammainccinv, gammaincinv

from ....core.geometry.checks import checked_covariance
from ....core.geometry.se3 import Array
from ....core.levels import DOUBTFUL
from ....core.read_only import ReadOnlyArrays
from ....core.rounding import SOLUTION_ROUNDING, TINY
from ....errors import InputError
from .sums import LEVELS, PARTS, SIZES, Sums, in_words, lower_factor

__all__ = ["LEVELS", "PARTS", "Consistency", "Sums", "consistency", "in_words"]

# With fewer trials the sampled covariance is not judged as a matrix, direction by direction.
MIN_TRIALS_FOR_SPREAD = 30
# With fewer trials the verdict begins with a sentence on what they cannot show.
MIN_TRIALS = 100
# A relative error of a standard deviation below this matters to hardly anyone.
HARMLESS_SD_ERROR = 0.05
# Tails are heavy from this excess of the fourth moment over that of Gaussian errors of the same covariance.
HEAVY_KURTOSIS = 0.5
# With a larger share of trials without an estimate no covariance of the others describes what a user gets.
MAX_FAILED_SHARE = 0.01
LIKELIHOOD_RATIO = "likelihood ratio of the covariance"


@dataclass(frozen=True, eq=False)
class Consistency(ReadOnlyArrays):
    """Statistics of the errors of trials against a covariance; parts in the order of `PARTS`, levels of `LEVELS`.

    What so few trials do not determine is None: everything without an estimate, spread with one, matrices below 30.
    """

    sums: Sums
    confidence: float
    own: bool  # whether each trial had its own covariance, and `predicted` is their mean
    predicted: Array | None  # (6, 6)
    bias: Array | None  # (6,) mean error
    bias_error: Array | None  # (6,) its standard error
    bias_p_value: float | None  # of Hotelling's test that it is zero; None also where errors do not vary
    covariance: Array | None  # (6, 6) of the errors, about their mean
    second_moment: Array | None  # (6, 6) of the errors, about the truth
    mean_nees: Array | None  # (3,)
    nees_interval: Array | None  # (3, 2) where the mean lies with probability `confidence` if the covariance is true
    coverage: Array | None  # (3, 5) share of the errors inside the ellipsoid
    coverage_interval: Array | None  # (3, 5, 2) Clopper-Pearson interval of that share
    coverage_p_values: Array | None  # (3, 5)
    eigenvalues: Array | None  # (6,) of sampled against predicted covariance, ascending: ratios of variances
    directions: Array | None  # (6, 6) row k: weights of the errors, in predicted standard deviations, of eigenvalue k
    likelihood_ratio: float | None  # with Bartlett's correction, chi-square with 21 degrees of freedom
    kurtosis: float | None  # E d^4 over that of Gaussian errors of the sampled covariance, minus 1
    kurtosis_error: float | None  # its standard error if the errors are Gaussian
    p_values: dict[str, float]  # of the seven tests
    rejected: tuple[str, ...]  # tests that reject, Holm-corrected

    @property
    def trials(self) -> int:
        """All, with failures."""
        return self.sums.trials

    @property
    def failures(self) -> int:
        """Trials without an estimate; they are in no other number."""
        return self.sums.failures

    @property
    def consistent(self) -> bool | None:
        """True if no test rejects; None where none does and more than 1 % of the trials gave no estimate.

        A covariance that is true of the errors of those that did says nothing about the others.
        """
        if self.rejected:
            return False
        return None if self.sums.count == 0 or self.many_failed else True

    @property
    def many_failed(self) -> bool:
        """True if more than `MAX_FAILED_SHARE` of the trials gave no estimate."""
        return self.failures > MAX_FAILED_SHARE * self.trials

    @property
    def std(self) -> Array | None:
        """Sampled standard deviations (6,)."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance))

    @property
    def predicted_std(self) -> Array | None:
        return None if self.predicted is None else np.sqrt(np.diag(self.predicted))

    @property
    def std_ratio_interval(self) -> Array | None:
        """(6, 2): confidence interval of the ratio of true to predicted standard deviation per axis (chi-square, n = T
        - 1).
        """
        if self.std is None or self.predicted_std is None:
            return None
        n, tail = self.sums.count - 1, (1 - self.confidence) / 2
        limits = np.array([2 * gammainccinv(n / 2, tail), 2 * gammaincinv(n / 2, tail)])
        return np.asarray((self.std / self.predicted_std)[:, None] * np.sqrt(n / limits))

    @property
    def bias_sd(self) -> Array | None:
        """The bias in sampled standard deviations (6,); None where errors do not vary."""
        return None if self.bias is None or self.std is None or not self.std.all() else self.bias / self.std

    @cached_property
    def eigenvalue_interval(self) -> Array | None:
        """(2,) holds all six eigenvalues with probability `confidence` if the covariance is consistent."""
        if self.eigenvalues is None:
            return None
        return np.array(extreme_eigenvalues(self.sums.count - 1, self.confidence))

    @property
    def overall(self) -> float | None:
        """Excess of the standard deviations over the predicted ones, over all directions: sqrt(mean eigenvalue) - 1."""
        return None if self.eigenvalues is None else float(np.sqrt(self.eigenvalues.mean()) - 1)

    @property
    def worst(self) -> int | None:
        """Index of the eigenvalue that is farthest from 1, as a ratio."""
        return None if self.eigenvalues is None else int(np.abs(np.log(self.eigenvalues)).argmax())

    @property
    def size(self) -> float | None:
        """Largest relative error in any direction: standard deviation sampled over predicted, minus 1; signed."""
        if self.eigenvalues is None or self.worst is None:
            return None
        return float(np.sqrt(self.eigenvalues[self.worst]) - 1)

    @property
    def size_error(self) -> float | None:
        """Standard error of `size`, ``(1 + size) sqrt((2 + 3 kurtosis) / n) / 2``, also where tails are heavy."""
        if self.size is None or self.kurtosis is None:
            return None
        return float((1 + self.size) * np.sqrt((2 + 3 * max(self.kurtosis, 0.0)) / (self.sums.count - 1)) / 2)

    @property
    def size_by_chance(self) -> float | None:
        """Bound that `size` stays below with probability `confidence` if the covariance is consistent: the largest of
        six.
        """
        interval = self.eigenvalue_interval
        return None if interval is None else float(np.abs(np.sqrt(interval) - 1).max())

    @cached_property
    def same_spread(self) -> bool | None:
        """True if chance explains all eigenvalues, their interval widened for the tails that the errors have."""
        if self.eigenvalues is None or self.eigenvalue_interval is None or self.kurtosis is None:
            return None
        reach = np.log(self.eigenvalue_interval) * np.sqrt(1 + 1.5 * max(self.kurtosis, 0.0))
        logs = np.log(self.eigenvalues)
        return bool(reach[0] <= logs[0] and logs[-1] <= reach[1])

    @property
    def harmless(self) -> bool:
        """Tests reject, but standard deviations are right to 5 % and shares in ellipsoids to 0.01."""
        if self.consistent is not False or self.size is None or self.size_error is None or self.coverage is None:
            return False
        return abs(self.size) + 2 * self.size_error < HARMLESS_SD_ERROR and np.abs(self.coverage - LEVELS).max() < 0.01


def consistency(
    sums: Sums, predicted: ArrayLike | None, confidence: float = 1.0 - DOUBTFUL.probability, *, own: bool = False
) -> Consistency:
    """Judge a covariance by the errors of trials.

    Parameters
    ----------
    sums : Sums
        Of the errors, with the NEES in the covariance to be judged.
    predicted : (6, 6) or None
        That covariance, the same for all trials; if each had its own, their mean, with ``own=True``. None leaves out
        eigenvalues and likelihood ratio.
    confidence : float
        Of every interval, and of the verdict over all tests together.
    own : bool
        Whether the NEES was taken in each trial's own covariance.

    Raises `InputError` for a predicted covariance that is not (6, 6) and positive definite, and for a confidence that
    does not lie between 0 and 1.
    """
    if not 0 < confidence < 1:
        raise InputError(f"Expected `confidence` to lie between 0 and 1, got {confidence!r}.")
    if predicted is not None:
        predicted = checked_covariance(predicted, "predicted", joint=False)
        if predicted.shape != (6, 6):
            raise InputError(f"Expected the covariance `predicted` to have shape (6, 6), got {predicted.shape}.")
        lower_factor(predicted, "predicted")
    p_values: dict[str, float] = {}
    found: dict[str, Any] = _moments(sums) | _nees(sums, confidence, p_values) | _coverage(sums, confidence, p_values)
    found |= _spread(sums.count, predicted, found["covariance"], p_values)
    found |= _kurtosis(sums, predicted, found)
    return Consistency(
        sums=sums,
        confidence=confidence,
        own=own,
        predicted=predicted,
        p_values=p_values,
        rejected=_holm(p_values, 1 - confidence),
        **found,
    )


def _moments(sums: Sums) -> dict[str, Any]:
    """Mean and spread of the errors."""
    T = sums.count
    names = ("bias", "bias_error", "bias_p_value", "covariance", "second_moment")
    found: dict[str, Any] = dict.fromkeys(names)
    if T >= 1:
        found |= {"bias": sums.error / T, "second_moment": sums.outer / T}
    if T >= 2:
        b = found["bias"]
        S = (sums.outer - T * np.outer(b, b)) / (T - 1)
        np.fill_diagonal(S, np.maximum(np.diag(S), 0.0))  # rounding, where errors do not vary
        unit = np.sqrt(np.diag(S))
        found |= {"covariance": S, "bias_error": unit / np.sqrt(T)}
        if T >= MIN_TRIALS_FOR_SPREAD and unit.all() and is_regular(correlation := S / np.outer(unit, unit)):
            squared = T * float(b / unit @ np.linalg.solve(correlation, b / unit))
            found["bias_p_value"] = float(fdtrc(6, T - 6, (T - 6) / (6 * (T - 1)) * squared))
    return found


def is_regular(correlation: Array) -> bool:
    """Return whether a correlation matrix can be inverted."""
    return bool(np.linalg.cond(correlation) < 1 / SOLUTION_ROUNDING)


def _nees(sums: Sums, confidence: float, p_values: dict[str, float]) -> dict[str, Any]:
    """Mean NEES, where it should lie, and how probable it is."""
    T = sums.count
    if T == 0:
        return {"mean_nees": None, "nees_interval": None}
    half = 0.5 * T * np.array(SIZES)
    for part, a, total in zip(PARTS, half, sums.nees, strict=True):
        p_values[f"mean NEES, {part}"] = min(1.0, 2 * float(min(gammainc(a, total / 2), gammaincc(a, total / 2))))
    return {"mean_nees": sums.nees / T, "nees_interval": nees_interval(T, SIZES, confidence)}


def _coverage(sums: Sums, confidence: float, p_values: dict[str, float]) -> dict[str, Any]:
    """Shares inside the ellipsoids: exact binomial intervals and probabilities."""
    T, tail, k = sums.count, (1 - confidence) / 2, sums.inside
    if T == 0:
        return dict.fromkeys(("coverage", "coverage_interval", "coverage_p_values"))
    low = np.where(k > 0, betaincinv(np.maximum(k, 1), T - k + 1, tail), 0.0)
    high = np.where(k < T, betaincinv(k + 1, np.maximum(T - k, 1), 1 - tail), 1.0)
    levels = np.array(LEVELS)
    p = np.minimum(1.0, 2 * smaller_tail(k, T, levels, 1 - levels))
    for part, values in zip(PARTS, p, strict=True):
        p_values[f"coverage, {part}"] = min(1.0, len(LEVELS) * float(values.min()))
    return {"coverage": k / T, "coverage_interval": np.stack([low, high], axis=-1), "coverage_p_values": p}


def smaller_tail(k: NDArray[np.int64], T: int, below: Array, above: Array) -> Array:
    """The smaller of P(K >= k) and P(K <= k) for K ~ binomial(T, below), with ``above = 1 - below``."""
    at_least = np.where(k > 0, betainc(np.maximum(k, 1), T - k + 1, below), 1.0)
    at_most = np.where(k < T, betainc(np.maximum(T - k, 1), k + 1, above), 1.0)
    return np.asarray(np.minimum(at_least, at_most), dtype=float)


def nees_interval(T: float, sizes: ArrayLike, confidence: float) -> Array:
    """The interval (..., 2) of the mean of T chi-square variables with ``sizes`` (...) degrees of freedom."""
    half, tail = 0.5 * T * np.asarray(sizes), (1 - confidence) / 2
    return np.asarray(2 * np.stack([gammaincinv(half, tail), gammainccinv(half, tail)], axis=-1) / T, dtype=float)


def _spread(T: int, predicted: Array | None, covariance: Array | None, p_values: dict[str, float]) -> dict[str, Any]:
    """Sampled against predicted covariance."""
    names = ("eigenvalues", "directions", "likelihood_ratio")
    if predicted is None or covariance is None or T < MIN_TRIALS_FOR_SPREAD:
        return dict.fromkeys(names)
    from scipy.linalg import eigh

    n, unit = T - 1, np.sqrt(np.diag(predicted))
    S, P = (C / np.outer(unit, unit) for C in (covariance, predicted))
    values, vectors = eigh(S, P)
    values = np.maximum(values, TINY)
    directions = vectors.T / np.linalg.norm(vectors.T, axis=1, keepdims=True)
    rho = 1 - (2 * 6 + 1 - 2 / (6 + 1)) / (6 * n)
    ratio = rho * n * float(np.sum(values - np.log(values) - 1))
    p_values[LIKELIHOOD_RATIO] = float(chdtrc(21, ratio))
    return dict(zip(names, (values, directions, ratio), strict=True))


@lru_cache(maxsize=64)
def extreme_eigenvalues(n: int, confidence: float, draws: int = 20_000) -> tuple[float, float]:
    """Quantiles of the smallest and the largest eigenvalue of W / n, W ~ Wishart(n, I_6), from simulated matrices.

    20,000 draws give the 0.5 % quantile to about 0.02 of the standard deviation of an eigenvalue.
    """
    rng = np.random.default_rng(102)
    L = np.tril(rng.standard_normal((draws, 6, 6)), -1)
    index = np.arange(6)
    L[:, index, index] = np.sqrt(rng.chisquare(n - index, (draws, 6)))
    values = np.linalg.eigvalsh(L @ L.mT / n)
    tail = (1 - confidence) / 2
    return float(np.quantile(values[:, 0], tail)), float(np.quantile(values[:, -1], 1 - tail))


def heavy_from(samples: int) -> float:
    """Return the kurtosis from which tails are heavy, beyond what Gaussian errors show by chance."""
    return max(HEAVY_KURTOSIS, 4 / float(np.sqrt(6 * samples)))


def _kurtosis(sums: Sums, predicted: Array | None, found: dict[str, Any]) -> dict[str, Any]:
    """Test whether the tails are those of Gaussian errors with the sampled bias b and covariance S.

    Then ``E d^4 = (tr A + b^T P^-1 b)^2 + 2 tr A^2 + 4 b^T P^-1 S P^-1 b`` with ``A = P^-1 S``; the mean over trials
    has the variance ``8 k (k + 2) / T`` about ``k (k + 2)`` if ``S = P`` (Mardia, Biometrika 57, 1970).
    """
    values = found["eigenvalues"]
    if predicted is None or values is None:
        return {"kurtosis": None, "kurtosis_error": None}
    unit = np.sqrt(np.diag(predicted))
    b = found["bias"] / unit
    weighted = np.linalg.solve(predicted / np.outer(unit, unit), b)
    shifted = float(weighted @ (found["covariance"] / np.outer(unit, unit)) @ weighted)
    expected = (values.sum() + float(b @ weighted)) ** 2 + 2 * float(values @ values) + 4 * shifted
    value = float(sums.nees_squared[0] / sums.count / max(expected, TINY) - 1)
    return {"kurtosis": value, "kurtosis_error": float(np.sqrt(8 / (6 * 8) / sums.count))}


def _holm(p_values: dict[str, float], error: float) -> tuple[str, ...]:
    """The tests that reject if a true hypothesis is to be rejected by any with at most the probability ``error``."""
    rejected: list[str] = []
    for left, (name, p) in zip(
        range(len(p_values), 0, -1), sorted(p_values.items(), key=lambda item: item[1]), strict=True
    ):
        if p > error / left:
            break
        rejected.append(name)
    return tuple(name for name in p_values if name in rejected)
