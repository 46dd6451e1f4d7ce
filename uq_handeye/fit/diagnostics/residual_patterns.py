r"""Tests of the residuals of a fit: autocorrelation, normality, dependence on the poses.

Model: whitened residuals, each of the six components first brought to its own scale and fitted once more, are
``M eps``, ``M = I - U U^T``, with nu = 6n - p degrees of freedom. For eps Gaussian, independent and of one variance a
quotient ``q = r^T A r / r^T r`` has (P. A. P. Moran 1950; A. D. Cliff and J. K. Ord 1972)

    E q = tr(AM) / nu,    Var q = 2 (tr(AMAM) - tr(AM)^2 / nu) / (nu (nu + 2))

which is what makes the test of autocorrelation (A: the pairs of rows k apart) right for few poses. A regression of the
residuals on the poses is an F test of the columns that the fit has not used up already. Skewness and kurtosis
are brought to normal scores by D'Agostino (1970) and by Anscombe and Glynn (1983).

Where poses have errors in common the residuals are those of each pose itself, with the shared errors as unknowns
(`graph.own_residuals`). With a covariance (6n, 6n), row i is the part of pose i that the poses before i do not
predict, which is independent as well where the noise is right. A test that was not run has a ``reason``, and no
numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, chdtrc, ndtr

from ...core.files.records import Record
from ...core.geometry.rotations import matrices_of_quaternions, quaternions, vectors
from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED
from ...core.rounding import SOLUTION_ROUNDING
from ...findings import Finding
from ...model.errors.joint_covariance import joint_of
from ...model.errors.square_roots import gram, is_joint, whiten
from ...model.poses.pose_pairs import PosePairs
from ..graph.gauss_helmert import Fit
from ..graph.own_residuals import own_errors, own_residuals

# Fewest rows that are tested.
MIN_ROWS = 8
# The fit must leave this many degrees of freedom: six of each pose minus one for each unknown.
MIN_FREEDOM = 6.0


@dataclass(frozen=True, eq=False)
class Autocorrelation(Record):
    """Autocorrelation of whitened residuals in the order of the rows (of the timestamps), pooled over the six
    components.
    """

    reason: Finding | None  # why there is no test
    correlation: Annotated[Array, "lags"]  # (lags,) of lag 1, 2, ..., less its expectation for independent rows
    standard_error: Annotated[Array, "lags"]  # (lags,) for independent rows
    p_value: float | None
    factor: float | None  # 1 + 2 sum of correlations, initial positive sequence
    effective_number: float | None  # n / factor
    growth: float | None  # factor on the standard deviations of X, pooled over its six directions
    untimed: bool = False  # no timestamps: with them a drift would be estimated beside the noise

    _if_any: ClassVar[str] = "untimed"


@dataclass(frozen=True, eq=False)
class Normality(Record):
    """Skewness and kurtosis of whitened residuals."""

    reason: Finding | None
    skewness: Annotated[Array, "six"]  # (6,)
    excess_kurtosis: float | None  # mean of the six components
    p_skewness: float | None
    p_kurtosis: float | None
    p_value: float | None


@dataclass(frozen=True, eq=False)
class Regression:
    """Whitened residuals as a linear function of camera translation and rotation vector."""

    reason: Finding | None
    r_squared: float | None
    chance: float | None  # its expectation without any pattern
    p_value: float | None


def residual_tests(
    fit: Fit, poses: PosePairs | None, second: Array, correlation_estimated: bool = False
) -> tuple[Autocorrelation, Normality, Regression]:
    """Test the residuals of one fit; ``second`` are the poses (motions) of the camera, corrected by the fit.

    The autocorrelation is not tested on the residuals that it was estimated from.
    """
    known: Array | float = 0.0
    of_all = joint_of(fit.S) is not None
    if of_all:
        white = own_errors(fit)
    elif is_joint(fit.S):  # a joint S would carry a rejected pose into the rows behind it: weights in the factor
        stacked = whiten(fit.weighted_factor, np.concatenate([fit.linear.J, fit.residual[..., None]], axis=-1))
        white, J = stacked[..., -1], stacked[..., :-1]
    else:
        white, J = fit.white
    n = len(white)
    rows = np.arange(n) if fit.weights is None else np.flatnonzero(fit.weights > 0.5)
    exact = len(rows) > 0 and np.sqrt(np.mean(white[rows] ** 2)) < 1e-6
    distinct = np.unique(np.round(white[rows], 9), axis=0, return_index=True)[1]
    rows = rows[np.sort(distinct)]  # copies of a row repeat its residual
    if poses is not None and poses.timestamps is not None:
        rows = rows[np.argsort(poses.timestamps[rows], kind="stable")]
    if of_all:
        rows = in_runs(rows)
        _, J, _, known = own_residuals(fit, rows)
    else:
        J = J[rows]

    needed = max(MIN_ROWS, J.shape[-1] // 6 + 3)  # J has the shared errors, too: they may take most of the residuals

    def untested(test: str, why: str) -> Finding:
        item = "motion" if fit.W is None else "pose"
        values = {"test": test, "item": item, "why": why, "rows": len(rows), "needed": needed}
        return Finding("diagnostics.not_tested", "note", values)

    why = None
    if exact:
        why = "exact"
    elif len(rows) < needed:
        why = "too few"
    elif 6 * len(rows) - np.sum(_orthonormal(J) ** 2) < MIN_FREEDOM:
        why = "unknowns"
    unknown = np.zeros(0), np.zeros(0), None, None, None, None
    if why is not None:
        return (
            Autocorrelation(untested("autocorrelation", why), *unknown),
            Normality(untested("normality", why), np.zeros(0), None, None, None, None),
            Regression(untested("pattern", why), None, None, None),
        )
    r, U = standardised(white[rows], J)
    skewness, kurtosis, p = normality_of(r)
    normality = Normality(None, skewness, float(kurtosis), *(float(value) for value in p))
    found = regression_of(r, U, _regressors(second[rows]))
    if found is None:
        regression = Regression(untested("pattern", "coefficients"), None, None, None)
    else:
        regression = Regression(None, *(float(value) for value in found))
    if correlation_estimated:
        return Autocorrelation(untested("autocorrelation", "estimated"), *unknown), normality, regression
    return _autocorrelation(r, U, J, known), normality, regression


def in_runs(rows: NDArray[np.intp], most: int = 5_000, runs: int = 10) -> NDArray[np.intp]:
    """Return at most so many of the rows, in runs of neighbours that are evenly spread over all of them.

    Patterns beside the columns of shared errors are looked for in these.
    """
    if len(rows) <= most:
        return rows
    length = most // runs
    starts = np.linspace(0, len(rows) - length, runs).round().astype(np.intp)
    return np.asarray(rows[(starts[:, None] + np.arange(length)).ravel()])


def standardised(r: Array, J: Array) -> tuple[Array, Array]:
    """Whitened residuals at one scale per component, fitted again, and U, for (..., n, 6) and (..., n, 6, p).

    The tests judge patterns, not sizes: noise that is wrong by a factor in rotation or translation changes nothing.
    """
    kept = r.shape[-2] - np.sum(_orthonormal(J) ** 2, axis=(-3, -1))
    scale = np.sqrt(np.sum(r**2, axis=-2) / np.maximum(kept, 0.5))[..., None, :]
    scale = np.maximum(scale, 1e-3 * scale.max(axis=-1, keepdims=True))  # of components without any noise
    U = _orthonormal(J / scale[..., None])
    r = r / scale
    flat = U.reshape(*U.shape[:-3], -1, U.shape[-1])
    used = flat @ (flat.mT @ r.reshape(*r.shape[:-2], -1, 1))
    return r - used.reshape(r.shape), U


def _orthonormal(J: Array) -> Array:
    information, scale = _unit(gram(J))
    values, vectors = np.linalg.eigh(information)
    known = values > SOLUTION_ROUNDING
    root = vectors * np.where(known, 1.0 / np.sqrt(np.where(known, values, 1.0)), 0.0)[..., None, :]
    return np.asarray(J @ (scale[..., :, None] * root)[..., None, :, :])


def _freedom(U: Array) -> Array:
    """Numbers (...) that are left beside the columns U (..., n, 6, p), those of them that differ."""
    return np.asarray(6.0 * U.shape[-3] - np.round(np.sum(U**2, axis=(-3, -2, -1))))


def _unit(information: Array) -> tuple[Array, Array]:
    """The information scaled to a unit diagonal, and the scale of each unknown."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), 1e-300))
    return information * scale[..., :, None] * scale[..., None, :], scale


def _autocorrelation(r: Array, U: Array, J: Array, known: Array | float) -> Autocorrelation:
    """``known`` is the information of priors of the unknowns."""
    n = len(r)
    rho, se, p = autocorrelation_of(r, U)
    factor = _integrated(r, U, r.size, p)
    # What each row adds to X, in units where X has the covariance I: how these add up is what X feels.
    unit, scale = _unit(gram(J) + known)
    C = np.linalg.pinv(unit, rcond=SOLUTION_ROUNDING, hermitian=True) * np.outer(scale, scale)
    A = J @ C[:, :6] @ np.linalg.inv(np.linalg.cholesky(C[:6, :6])).T  # (n, 6, 6)
    growth = _integrated((A.mT @ r[..., None])[..., 0], A.mT @ U, 6.0, p)
    return Autocorrelation(None, rho, se, float(p), factor, n / factor, float(np.sqrt(growth)))


def _integrated(x: Array, V: Array, total: float, p: Array, rounds: int = 4) -> float:
    """``1 + 2 sum of rho_k``, initial positive sequence (C. J. Geyer 1992), of a series x (n, 6).

    The fit has taken from the sum of products at lag k what V (n, 6, p) has at that lag, of a ``total`` at lag 0, and
    the more, the larger the factor itself is: this is corrected in ``rounds``.
    """
    n = len(x)
    left, taken = (_products_at_lags(y.reshape(n, -1)) for y in (x, V))
    taken = taken / total
    factor = 1.0
    for _ in range(rounds if p < CONTRADICTED.probability else 1):
        rho = left / left[0] * (1 - factor * taken[0]) + factor * taken
        pairs = rho[: n // 2 * 2].reshape(-1, 2).sum(axis=1)
        last = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
        factor = min(max(float(2 * pairs[: max(last, 1)].sum() - 1), 0.1), 0.5 / float(taken[0]))
    return factor


def _products_at_lags(y: Array, together: int = 50) -> Array:
    """(n,) sums of ``y_i y_i+k`` over the rows and columns of y (n, m), so many columns at once."""
    n = len(y)
    size, power = 1 << (2 * n - 1).bit_length(), 0.0
    for start in range(0, y.shape[1], together):
        power = power + np.sum(np.abs(np.fft.rfft(y[:, start : start + together], size, axis=0)) ** 2, axis=1)
    return np.asarray(np.fft.irfft(power, size)[:n])


def autocorrelation_of(r: Array, U: Array, max_lags: int = 5, rows_together: int = 500) -> tuple[Array, Array, Array]:
    """Correlations (..., lags) and standard errors of `standardised` residuals, and the p-value (...) of the test.

    The test looks for positive correlation, at lag 1 and over some lags with falling weights; p is twice the smaller.
    """
    n, freedom = r.shape[-2], _freedom(U)
    lags = min(max_lags, n // 4)
    weights = 1.0 - np.arange(1, lags + 1) / (lags + 1)
    traces = 3.0 * (n - np.arange(1, lags + 1))
    sums = [_PulledSums() for _ in range(lags + 1)]
    for start in range(0, n, rows_together):
        end, first = min(start + rows_together, n), max(start - lags, 0)
        rows = slice(first, end + lags)  # with their neighbours
        near = np.concatenate([U[..., rows, :, :], r[..., rows, :, None]], axis=-1)
        own = slice(start - first, end - first)
        over_lags = np.zeros_like(near[..., own, :, :])
        for k in range(1, lags + 1):
            shifted = np.zeros_like(near)
            shifted[..., k:, :, :] += 0.5 * near[..., :-k, :, :]
            shifted[..., :-k, :, :] += 0.5 * near[..., k:, :, :]
            over_lags += weights[k - 1] * shifted[..., own, :, :]
            sums[k - 1].add(near[..., own, :, :], shifted[..., own, :, :])
        sums[-1].add(near[..., own, :, :], over_lags)
    size = np.sum(r**2, axis=(-2, -1))
    found = [one.excess(size, float(trace), freedom) for one, trace in zip(sums[:-1], traces, strict=True)]
    excess, error = sums[-1].excess(size, float(traces @ weights**2), freedom)
    p = 2 * ndtr(-np.maximum(found[0][0] / found[0][1], excess / error))
    correlation, errors = (np.stack(values, axis=-1) for values in zip(*found, strict=True))
    return correlation, errors, np.minimum(p, 1.0)


@dataclass
class _PulledSums:
    """Sums over rows of ``(U, r)^T A (U, r)`` and of the squares of A U, for A without a diagonal."""

    inner: Array | float = 0.0  # (..., p + 1, p + 1)
    squares: Array | float = 0.0  # (...)

    def add(self, both: Array, pulled: Array) -> None:
        """Add rows (..., b, 6, p + 1) of (U, r) and of A (U, r)."""
        shape = (*both.shape[:-3], -1, both.shape[-1])
        self.inner = self.inner + both.reshape(shape).mT @ pulled.reshape(shape)
        self.squares = self.squares + np.sum(pulled[..., :-1] ** 2, axis=(-3, -2, -1))

    def excess(self, size: Array, trace_AA: float, freedom: Array) -> tuple[Array, Array]:
        """``r^T A r / r^T r`` less its mean, and its standard deviation; ``size`` (...) is ``r^T r``."""
        inner = np.asarray(self.inner)
        used = inner[..., :-1, :-1]
        mean = -np.trace(used, axis1=-2, axis2=-1) / freedom
        squares = trace_AA - 2 * self.squares + np.sum(used**2, axis=(-2, -1))
        deviation = np.sqrt(2 * (squares - freedom * mean**2) / (freedom * (freedom + 2)))
        return inner[..., -1, -1] / size - mean, deviation


def normality_of(r: Array) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Skewness (..., 6), mean excess kurtosis (...), and p-values of skewness, of kurtosis and of both, (..., n, 6)."""
    n = r.shape[-2]
    r = r - r.mean(axis=-2, keepdims=True)
    m2, m3, m4 = (np.mean(r**k, axis=-2) for k in (2, 3, 4))
    skewness, kurtosis = m3 / m2**1.5, m4 / m2**2
    b = 3.0 * (n**2 + 27 * n - 70) * (n + 1) * (n + 3) / ((n - 2.0) * (n + 5) * (n + 7) * (n + 9))
    w2 = np.sqrt(2 * (b - 1)) - 1
    y = skewness * np.sqrt((n + 1) * (n + 3) / (6.0 * (n - 2)))
    z_skewness = np.arcsinh(y / np.sqrt(2 / (w2 - 1))) / np.sqrt(0.5 * np.log(w2))

    mean = 3.0 * (n - 1) / (n + 1)
    variance = 24.0 * n * (n - 2) * (n - 3) / ((n + 1) ** 2 * (n + 3) * (n + 5))
    b = 6.0 * (n**2 - 5 * n + 2) / ((n + 7) * (n + 9)) * np.sqrt(6.0 * (n + 3) * (n + 5) / (n * (n - 2) * (n - 3)))
    a = 6 + 8 / b * (2 / b + np.sqrt(1 + 4 / b**2))
    x = (kurtosis - mean) / np.sqrt(variance)
    inner = np.maximum((1 - 2 / a) / (1 + x * np.sqrt(2 / (a - 4))), 0.0)
    z_kurtosis = ((1 - 2 / (9 * a)) - np.cbrt(inner)) / np.sqrt(2 / (9 * a))
    z = z_kurtosis.sum(axis=-1) / np.sqrt(6.0)
    chi = np.sum(z_skewness**2, axis=-1)
    p = (chdtrc(6, chi), 2 * ndtr(-np.abs(z)), chdtrc(7, chi + z**2))
    return skewness, (kurtosis - mean).mean(axis=-1), p


def _regressors(pose: Array) -> Array:
    """Orthonormal columns (n, q), q <= 7, that span 1, translation and rotation vector about the mean view.

    Directions with less than 3 % of the spread of the widest are left out: noise would make up much of them.
    """
    R = pose[:, :3, :3]
    q = quaternions(R)
    mean = matrices_of_quaternions(np.linalg.eigh(q.T @ q)[1][:, -1])
    parts = []
    for values in (pose[:, :3, 3], vectors(mean.T @ R)):
        values = values - values.mean(axis=0)
        parts.append(values / max(float(np.linalg.norm(values)), 1e-12))
    left, singular, _ = np.linalg.svd(np.concatenate(parts, axis=1), full_matrices=False)
    constant = np.full((len(pose), 1), 1 / np.sqrt(len(pose)))
    return np.concatenate([constant, left[:, singular > 0.03 * singular[0]]], axis=1)


def regression_of(r: Array, U: Array, Z: Array) -> tuple[Array, Array, Array] | None:
    """R^2 of `standardised` residuals (..., n, 6) on the orthonormal columns Z (n, q), its chance level and p-value.

    Each of the six components has coefficients of its own. None where fewer than 6 degrees of freedom are left, or no
    coefficient.
    """
    q = 6 * Z.shape[-1]
    VU = np.einsum("tz,...tcp->...czp", Z, U).reshape(*U.shape[:-3], q, U.shape[-1])
    values, vectors = np.linalg.eigh(np.eye(q) - VU @ VU.mT)
    free = values > 1e-6
    by_column = (vectors.mT @ np.einsum("tz,...tc->...cz", Z, r).reshape(*r.shape[:-2], q, 1))[..., 0]
    square = np.sum(r**2, axis=(-2, -1))
    explained = np.sum(np.where(free, by_column**2 / np.where(free, values, 1.0), 0.0), axis=-1) / square
    columns = free.sum(axis=-1)
    freedom = _freedom(U)
    left = freedom - columns
    if (left < 6).any() or (columns == 0).any():
        return None
    explained = np.minimum(explained, 1.0)  # copies of poses leave residuals that are explained altogether
    p_value = betainc(left / 2, columns / 2, 1.0 - explained)  # that of F
    return explained, np.asarray(columns / freedom), np.asarray(p_value)
