r"""CUSUM charts with a stated false-alarm rate, of scores that are independent while nothing changes.

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

from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import chndtr, gammainc, ndtr

from ....core.geometry.se3 import Array
from ....errors import InputError

K = 0.5  # finds a shift of one standard deviation fastest
CELLS = 40


def cusum(scores: Array, reference: float = K) -> Array:
    """(n,) ``S_k`` after each score: numbers (n,), upwards."""
    path = np.empty(len(scores))
    level = 0.0
    for k, z in enumerate(np.asarray(scores, dtype=float)):
        level = max(0.0, level + z - reference)
        path[k] = level
    return path


def vector_cusum(scores: Array, reference: float = K) -> Array:
    """(n,) ``|S_k|`` after each score: vectors (n, p)."""
    path = np.empty(len(scores))
    at = np.zeros(np.shape(scores)[1:])
    for k, u in enumerate(np.asarray(scores, dtype=float)):
        at = at + u
        size = float(np.linalg.norm(at))
        at = at * max(0.0, 1.0 - reference / size) if size > 0 else at
        path[k] = float(np.linalg.norm(at))
    return path


def siegmund(limit: float, reference: float = K) -> float:
    """Average run length of the chart of numbers by Siegmund's formula."""
    b = 2.0 * reference * (limit + 1.166)
    return float((np.exp(b) - b - 1.0) / (2.0 * reference**2))


def run_length(limit: float, reference: float = K, components: int | None = None, shift: float = 0.0) -> float:
    """Average number of checks until the alarm, from ``S = 0``.

    Parameters
    ----------
    limit : float
        H, above 0.
    reference : float
        K, above 0.
    components : int or None
        p of vectors; None: numbers.
    shift : float
        Mean of the numbers; 0 is without any change. For vectors only 0.
    """
    if not (limit > 0 and reference > 0):
        raise InputError(f"Expected limit and reference value above 0, got {limit!r} and {reference!r}.")
    if components is not None and (components < 1 or shift != 0.0):
        raise InputError(f"Expected 1 or more components and no shift, got {components!r} and {shift!r}.")
    coarse, fine = (_by_cells(limit, reference, components, shift, n) for n in (CELLS, 2 * CELLS))
    return fine + (fine - coarse) / 3.0


@lru_cache(maxsize=64)
def limit_for(length: float, reference: float = K, components: int | None = None) -> float:
    """H with the average run length ``length`` (checks) while nothing changes."""
    if not 10.0 <= length <= 1e5:
        raise InputError(f"Expected one false alarm in 10 to 100,000 checks, got one in {length!r}.")

    def excess(limit: float) -> float:
        return float(np.log(run_length(limit, reference, components) / length))

    highest = 1.0
    while excess(highest) < 0:
        highest *= 1.5
    return float(brentq(excess, 0.01, highest, xtol=1e-3))


def _by_cells(limit: float, reference: float, components: int | None, shift: float, n: int) -> float:
    """(I - Q)^-1 1 at S = 0: state 0 is S = 0 itself, state i >= 1 the i-th of n cells, all of it at its middle."""
    edges = np.linspace(0.0, limit, n + 1)
    at = np.concatenate([[0.0], (edges[1:] + edges[:-1]) / 2])  # (n + 1,)
    # below[i, j]: the probability to go from state i to the j-th edge or below it; the edge 0 is S = 0
    reach = edges + reference
    below = (
        ndtr(reach - at[:, None] - shift) if components is None else _chi_below(reach, at[:, None], float(components))
    )
    Q = np.concatenate([below[:, :1], np.diff(below, axis=1)], axis=1)  # (n + 1, n + 1)
    return float(np.linalg.solve(np.eye(n + 1) - Q, np.ones(n + 1))[0])


def _chi_below(reach: Array, distance: Array, p: float) -> Array:
    """P(|S + u| <= reach) for |S| = distance, u ~ N(0, I_p)."""
    found = chndtr(reach**2, p, distance**2)
    return np.asarray(np.where(distance > 0, found, gammainc(p / 2, reach**2 / 2)))
