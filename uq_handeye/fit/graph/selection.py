r"""Choice of poses by the information that each would add: criteria, greedy choice, exchange.

With the covariance ``Sigma`` (12, 12) of ``(xi_X, xi_W)`` so far, whitened derivatives B (6, 12) of one more pose,
``V = B Sigma`` and ``K = I + V B^T`` (6, 6), the matrix inversion lemma gives, for all candidates at once,

    tr(Q Sigma'_X) = tr(Q Sigma_X) - tr(K^-1 V_X Q V_X^T),
    log det Sigma'_X = log det Sigma_X + log det(K - V_X Sigma_X^-1 V_X^T) - log det K.

Further unknowns follow these. A criterion is Q of X (6, 6) or of the first r unknowns (then V_X is of these), or
None for the determinant. Exchange: V. V. Fedorov, *Theory of optimal experiments*, 1972.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, skew
from ...core.rounding import CHAIN_ROUNDING, rounding
from ...errors import InputError
from ...model.errors.square_roots import gram


def value(covariance: Array, Q: Array | None) -> Array:
    """The criterion (...) at covariances (..., p, p) of all unknowns, X first.

    Q is of the first r unknowns (r, r), 6 of X, or None for logdet of X.
    """
    r = of(Q)
    if Q is None:
        return np.asarray(_log_determinant(covariance[..., :r, :r]))
    return np.asarray(np.einsum("ij,...ji->...", Q, covariance[..., :r, :r]))


def of(Q: Array | None) -> int:
    """Return the number of unknowns of the criterion."""
    return 6 if Q is None else len(Q)


def after(covariance: Array, rows: Array, Q: Array | None) -> Array:
    """The criterion (m,) after one more pose, from the covariance (p, p) before it and B (m, 6, p) of each."""
    V = rows @ covariance
    K = np.eye(6) + V @ rows.mT
    V_X = V[..., : of(Q)]
    if Q is None:
        kept = K - V_X @ np.linalg.solve(covariance[:6, :6], V_X.mT)
        return np.asarray(value(covariance, Q) + _log_determinant(kept) - _log_determinant(K))
    gain = np.einsum("mii->m", np.linalg.solve(K, V_X @ Q @ V_X.mT))
    return np.asarray(value(covariance, Q) - gain)


class Selection(NamedTuple):
    """Poses in the order in which each brings most."""

    chosen: NDArray[np.intp]  # (k,) rows
    covariances: Array  # (k + 1, p, p) of all unknowns before, and after each
    values: Array  # (k + 1,) the criterion


def select(information: Array, rows: Array, k: int, Q: Array | None, repeat: bool) -> Selection:
    """The k rows B (m, 6, p) that make the criterion small: greedy, exchanged, and put in order."""
    chosen = greedy(information, rows, np.arange(len(rows)), k, Q, repeat)
    chosen = exchanged(information, rows, chosen, Q, repeat)
    chosen = greedy(information, rows, chosen, k, Q, repeat=False)
    brought = np.cumsum(rows[chosen].mT @ rows[chosen], axis=0)
    covariances = covariance_of(information + np.concatenate([np.zeros_like(brought[:1]), brought]))
    return Selection(chosen, covariances, value(covariances, Q))


def greedy(
    information: Array, rows: Array, among: NDArray[np.intp], k: int, Q: Array | None, repeat: bool
) -> NDArray[np.intp]:
    """Rows (k,) out of ``among``, each the best after those before it."""
    free, B = np.ones(len(among), dtype=bool), rows[among]
    chosen = []
    for _ in range(k):
        values = np.where(free, after(covariance_of(information), B, Q), np.inf)
        best = int(np.argmin(values))
        chosen.append(among[best])
        free[best] = repeat
        information = information + B[best].T @ B[best]
    return np.array(chosen, dtype=np.intp)


def exchanged(
    information: Array, rows: Array, chosen: NDArray[np.intp], Q: Array | None, repeat: bool
) -> NDArray[np.intp]:
    """Each chosen row replaced by the best one given the others, until no replacement helps."""
    chosen = chosen.copy()
    best = float(value(covariance_of(information + gram(rows[chosen])), Q))
    still = 0
    # two or three rounds are usual; an exchange must improve the criterion by more than rounding
    for place in np.tile(np.arange(len(chosen)), 20):
        others = np.delete(chosen, place)
        values = after(covariance_of(information + gram(rows[others])), rows, Q)
        if not repeat:
            values[others] = np.inf
        found = int(np.argmin(values))
        still += 1
        if best - values[found] > CHAIN_ROUNDING * (1.0 if Q is None else best):
            chosen[place], best, still = found, float(values[found]), 0
        if still == len(chosen):
            break
    return chosen


def covariance_of(information: Array) -> Array:
    """The covariance (..., p, p) of regular information whose entries differ much in size."""
    unit = 1.0 / np.sqrt(np.diagonal(information, axis1=-2, axis2=-1))
    scale = unit[..., :, None] * unit[..., None, :]
    values, vectors = np.linalg.eigh(information * scale)
    if not (values[..., 0] > rounding(4)).all():
        raise InputError(
            "The noise is too small for poses that leave a part of X open: rounding hides what is known. Give noise of "
            "1e-6 rad and m or more, or poses that determine X."
        )
    result = (vectors / values[..., None, :]) @ vectors.mT * scale
    return np.asarray(0.5 * (result + result.mT))


def _log_determinant(S: Array) -> Array:
    return np.asarray(np.linalg.slogdet(S)[1])


def weight_of_X(X: Array, point: Array | None, length: float | None) -> Array:
    """Q (6, 6) of the criterion ``tr(Q Sigma)``."""
    if point is not None:
        M = np.concatenate([-skew(X[:3, :3] @ point), np.eye(3)], axis=1)
        return np.asarray(M.T @ M)
    assert length is not None
    return np.diag([2 / 3 * length**2] * 3 + [1.0] * 3)
