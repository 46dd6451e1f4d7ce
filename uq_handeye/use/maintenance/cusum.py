r"""CUSUM charts with a stated false-alarm rate, of what each check says that the earlier ones did not.

*Scores.* All checks share the errors u of the calibration (`posterior`), so their d^2 are correlated. With V_k the
columns of check k by u, R_k the covariance of its own noise and C_k the columns of a cause,

    r_k = V_k u + eta_k,      u ~ N(0, I),      v_k = r_k - V_k E(u | earlier),
    S_k = V_k Cov(u | earlier) V_k^T + R_k = L_k L_k^T,      e_k = L_k^-1 v_k

(Kalman filter). While nothing changes, all e_k are N(0, I) and independent, on average over calibrations and checks:

- ``d2 = |e_k|^2`` is chi-square of all residuals;
- ``u = (T^-T A^T A T^-1)^(-1/2) T^-T A^T e_k``, ``A = L_k^-1 C_k``, is N(0, I_6): the shift that e_k asks for, in
  units in which the first check knows it equally well in all directions (``T = (A_1^T A_1)^(1/2)``). A slow drift
  has about the same direction in each u.

*Noise that was estimated* with nu degrees of freedom has one error of its size in all checks. In units of the size as
estimated by the calibration and the earlier checks, ``s_k^2 = (nu + sum |e_j|^2) / (nu + sum dof_j)``, ``|e_k|^2`` over
its dof is F, independent of the earlier ones (Quesenberry 1991); u keeps its direction, and its length becomes the
quantile of chi-square that has the same p-value.

*Of a number* z ~ N(0, 1), upwards (Page 1954): ``S_k = max(0, S_{k-1} + z_k - K)``; alarm where ``S_k > H``.

*Of a vector* u ~ N(0, I_p) (Crosier 1988): with ``c = |S_{k-1} + u_k|``,

    S_k = (S_{k-1} + u_k) (1 - K / c)  where c > K, else 0;    alarm where |S_k| > H

It adds up small shifts of one direction, which no single u shows. K is half the shift that is to be found fastest.

*Run length.* ``|S_k|`` alone is a Markov chain, also for vectors: ``c^2`` is non-central chi-square with p degrees of
freedom and non-centrality ``|S_{k-1}|^2``. The interval from 0 to H is divided into n cells (Brook and Evans 1972);
with Q the probabilities to stay below H, the average run length from each cell is ``(I - Q)^-1 1``. Its error falls
with n^-2, which is extrapolated. For numbers Siegmund's formula (1985) is a check:

    ARL ~ (exp(2 K b) - 2 K b - 1) / (2 K^2),    b = H + 1.166

Both agree to a few per cent (tests).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import brentq
from scipy.special import chdtrc, chdtri, chndtr, fdtrc, gammainc, ndtr, ndtri

from ...core.geometry.se3 import Array
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import InputError
from ...model.noise.cholesky import checked_cholesky
from ...model.posterior.rows import NewRows

K = 0.5  # finds a shift of one standard deviation fastest
CELLS = 40


def cusum(scores: Array) -> Array:
    """(n,) ``S_k`` after each score: numbers (n,), upwards."""
    return np.array([*accumulate(map(float, scores), lambda S, z: max(0.0, S + z - K), initial=0.0)])[1:]


def vector_cusum(scores: Array) -> Array:
    """(n,) ``|S_k|`` after each score: vectors (n, p)."""

    def step(S: Array, u: Array) -> Array:
        S = S + u
        return S * max(0.0, 1.0 - K / max(float(np.linalg.norm(S)), 1e-300))

    path = [*accumulate(np.asarray(scores, dtype=float), step, initial=np.zeros(np.shape(scores)[1:]))]
    return np.asarray(np.linalg.norm(path, axis=-1))[1:]


def run_length(limit: float, components: int | None = None) -> float:
    """Average number of checks until the alarm at H = ``limit``, from ``S = 0``, while nothing changes.

    Of vectors of p ``components``, or of numbers.
    """
    coarse, fine = (_by_cells(limit, components, n) for n in (CELLS, 2 * CELLS))
    return fine + (fine - coarse) / 3.0


@lru_cache(maxsize=64)
def limit_for(length: float, components: int | None = None) -> float:
    """H with the average run length ``length`` (checks) while nothing changes."""
    if not 10.0 <= length <= 1e5:
        raise InputError(f"Expected one false alarm in 10 to 100,000 checks, got one in {length!r}.")
    highest = next(H for H in 1.5 ** np.arange(20) if run_length(H, components) > length)
    return float(brentq(lambda H: np.log(run_length(H, components) / length), 0.01, highest, xtol=1e-3))


def _by_cells(limit: float, p: int | None, n: int) -> float:
    """(I - Q)^-1 1 at S = 0: state 0 is S = 0 itself, state i >= 1 the i-th of n cells, all of it at its middle."""
    edges = np.linspace(0.0, limit, n + 1)
    at = np.concatenate([[0.0], (edges[1:] + edges[:-1]) / 2])[:, None]  # (n + 1, 1)
    # below[i, j]: the probability to go from state i to the j-th edge or below it; the edge 0 is S = 0
    reach = edges + K
    if p is None:
        below = ndtr(reach - at)
    else:  # |S + u| <= reach
        below = np.where(at > 0, chndtr(reach**2, p, at**2), gammainc(p / 2, reach**2 / 2))
    Q = np.concatenate([below[:, :1], np.diff(below, axis=1)], axis=1)  # (n + 1, n + 1)
    return float(np.linalg.solve(np.eye(n + 1) - Q, np.ones(n + 1))[0])


# Smaller p-values are not told from each other.
LEAST_P = 1e-300


@dataclass(frozen=True, eq=False)
class Scores(ReadOnlyArrays):
    """Independent scores of n checks, each N(0, 1) while nothing changes."""

    by_cause: dict[str, Array]  # (n, p) vectors, N(0, I_p)
    p_values: Array  # (n,) of all residuals of a check, given the earlier ones

    @property
    def total(self) -> Array:
        """(n,) the p-values as N(0, 1), large where residuals are."""
        return np.asarray(-ndtri(np.clip(self.p_values, LEAST_P, 1.0 - 1e-16)))


class Innovations:
    """The filter of the checks, kept for residuals and for columns of causes.

    Parameters
    ----------
    checks : sequence of NewRows
        In the order of time, against one `Posterior`.
    """

    def __init__(self, checks: Sequence[NewRows]) -> None:
        p = checks[0].posterior.A.shape[1]
        P = np.eye(p)
        self._steps: list[tuple[Array, Array, Array]] = []
        for of in checks:
            V = of.by_unit.reshape(of.dof, -1)
            V, more = V[:, :p], V[:, p:]
            S = V @ P @ V.T + more @ more.T
            m, k = of.r.shape
            for i in range(m):
                S[i * k : i * k + k, i * k : i * k + k] += of.own[i]
            L = checked_cholesky(S)
            W = solve_triangular(L, V @ P, lower=True)
            P = P - W.T @ W
            P = 0.5 * (P + P.T)
            self._steps.append((V, L, W))

    def whitened(self, columns: Sequence[Array]) -> list[Array]:
        """``L_k^-1`` of what earlier checks do not predict of columns (dof_k, c), which add up over the checks."""
        found: list[Array] = []
        mean = np.zeros((self._steps[0][0].shape[1], columns[0].shape[1]))
        for (V, L, W), C in zip(self._steps, columns, strict=True):
            e = solve_triangular(L, C - V @ mean, lower=True)
            mean = mean + W.T @ e
            found.append(e)
        return found

    def alone(self, columns: Sequence[Array]) -> list[Array]:
        """``L_k^-1 C_k``: of a change at check k."""
        return [solve_triangular(L, C, lower=True) for (_, L, _), C in zip(self._steps, columns, strict=True)]


def scores_of(
    checks: Sequence[NewRows], columns: Mapping[str, Sequence[Array]], noise_dof: float = float("inf")
) -> Scores:
    """Return the scores of checks.

    Parameters
    ----------
    checks : n of NewRows
    columns : mapping
        By cause, for each check (m, k, p).
    noise_dof : float
        Degrees of freedom of the size of the noise; infinite where it was given.
    """
    filter_ = Innovations(checks)
    e = [part[:, 0] for part in filter_.whitened([of.r.reshape(-1, 1) for of in checks])]
    d2, dof = np.array([part @ part for part in e]), np.array([len(part) for part in e], dtype=float)
    before = noise_dof + np.concatenate([[0.0], np.cumsum(dof)[:-1]])
    given = np.isinf(noise_dof)
    size = np.ones(len(e)) if given else (noise_dof + np.concatenate([[0.0], np.cumsum(d2)[:-1]])) / before
    by_cause = {}
    for name, C in columns.items():
        A = filter_.alone([part.reshape(-1, part.shape[-1]) for part in C])
        u = _in_common_axes(e, A)
        if not given:
            u = _as_normal(u, size, before)
        by_cause[name] = u
    p = chdtrc(dof, d2) if given else fdtrc(dof, before, d2 / (dof * size))
    return Scores(by_cause, np.asarray(p))


def _in_common_axes(e: Sequence[Array], A: Sequence[Array]) -> Array:
    """u (n, p) of the module; 0 of checks that say nothing of the cause."""
    told = [bool(part.any()) for part in A]
    found = np.zeros((len(A), A[0].shape[1]))
    if not any(told):
        return found
    start = A[told.index(True)]
    first = np.linalg.inv(_power(start.T @ start, 0.5))
    for k, (of, part) in enumerate(zip(e, A, strict=True)):
        if told[k]:
            C = part @ first
            found[k] = _power(C.T @ C, -0.5) @ (C.T @ of)
    return found


def _as_normal(u: Array, size: Array, dof: Array) -> Array:
    p = u.shape[1]
    squares = np.sum(u**2, axis=-1)
    tail = np.maximum(fdtrc(p, dof, squares / (p * size)), LEAST_P)
    return np.asarray(u * np.sqrt(chdtri(p, tail) / np.maximum(squares, 1e-300))[:, None])


def _power(S: Array, exponent: float) -> Array:
    """Power of a symmetric positive matrix; directions of which nothing is known count as least known."""
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    return np.asarray((vectors * np.maximum(values, 1e-12 * values.max()) ** exponent) @ vectors.T)
