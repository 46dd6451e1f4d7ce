r"""A bias that touches share: its estimate, its tests, and the size that would show.

With the whitened differences w and the columns B of a bias (an offset in the base) and T of a tool that is not known,
both whitened, Q the projection that leaves T out,

    b = (B^T Q B)^-1 B^T Q w,    Cov b = (B^T Q B)^-1,    |Q w|^2 = b^T Cov(b)^-1 b + scatter

The two parts are chi-square and independent if nothing has changed, with 3 and with 3 m - 3 - rank T degrees of
freedom. Where noise was estimated with ``nu`` degrees of freedom and makes the share c of the variance, they are
``k F(k, nu / c^2)`` (Satterthwaite).

*Level.* Each of two tests is made at ``1 - sqrt(1 - LEVEL)``, so that both together have the `LEVEL`.

*Power.* A bias beta makes the first part non-central, ``lambda = beta^T Cov(b)^-1 beta``. It shows with the probability
`POWER` where lambda is at least that of the non-central chi-square (or F): in the worst direction from the size
``sqrt(lambda * largest eigenvalue of Cov b)`` on. n times as many touches of the same kind divide the noise of touching
and seeing by n; X, the shared errors and the tool stay, and set the limit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, chdtri, chndtr, fdtrc, fdtri, ncfdtr, ndtri, stdtrit

from ..evidence.touches import TouchEvidence
from ..geometry.se3 import Array
from ..runtime.read_only import ReadOnlyArrays

LEVEL = 0.05
POWER = 0.95
# Most touches that are ever recommended.
MOST = 10_000
# Of the information on a bias, the part that is rounding.
_ROUNDING = 1e-9
# Number by which the noise is divided to stand for any number of touches.
_ANY = 1e8


@dataclass(frozen=True, eq=False)
class Bias(ReadOnlyArrays):
    """Bias of touches and what is left of them."""

    estimate: Array  # (3,), 0 along directions that a tool hides
    covariance: Array  # (3, 3), 0 along these
    hidden: Array  # (h, 3) directions that the tool hides
    d2: float  # of the bias
    rest: float  # of the scatter
    dof: int  # of the bias
    dof_rest: int
    shares: tuple[float, float]  # of estimated noise in the variance of both

    @property
    def worst(self) -> tuple[float, Array]:
        """Largest standard deviation of the bias and its direction; infinite along what is hidden."""
        if len(self.hidden):
            return float("inf"), self.hidden[0]
        values, vectors = np.linalg.eigh(self.covariance)
        direction = vectors[:, -1]
        return float(np.sqrt(values[-1])), direction * np.sign(direction[np.abs(direction).argmax()])


def bias_of(evidence: TouchEvidence, tool_known: bool = True) -> Bias:
    """Estimate the bias and split ``d^2``."""
    m = len(evidence.r)
    k = 0 if tool_known else 3
    n_e = evidence.posterior.A.shape[1]
    bias = np.broadcast_to(np.eye(3), (m, 3, 3))
    together = np.concatenate([bias, evidence.by_tool[..., :k], evidence.by_unit[..., :n_e]], axis=-1)
    white = evidence.whitened(together)
    B, T, by_state, w = white[:, :3], white[:, 3 : 3 + k], white[:, 3 + k :], evidence.white
    rank = 0
    if k:
        U, s, _ = np.linalg.svd(T, full_matrices=False)
        U = U[:, s > s.max() * _ROUNDING]
        rank = U.shape[1]
        B, w, by_state = (x - U @ (U.T @ x) for x in (B, w, by_state))
    U, s, Vt = np.linalg.svd(B, full_matrices=False)
    # In units of what the bias would be known to without the tool.
    whole = np.linalg.norm(white[:, :3], axis=0).max()
    told = s > whole * np.sqrt(_ROUNDING)
    along = U.T[told] @ w
    back = Vt[told].T / s[told]
    rest = w - U[:, told] @ along
    dof = int(told.sum())
    dof_rest = 3 * m - rank - dof
    part = U[:, told].T @ by_state
    share = float(np.clip(np.sum(part**2) / dof, 0.0, 1.0)) if dof else 0.0
    left = float(np.sum(by_state**2) - np.sum(part**2))
    share_rest = float(np.clip(left / dof_rest, 0.0, 1.0)) if dof_rest > 0 else 0.0
    d2_rest = float(rest @ rest) if dof_rest > 0 else 0.0
    return Bias(
        back @ along, back @ back.T, Vt[~told], float(along @ along), d2_rest, dof, dof_rest, (share, share_rest)
    )


@dataclass(frozen=True, eq=False)
class Assessed(ReadOnlyArrays):
    """The tests of touches."""

    bias: Bias
    p_value: float | None  # None: nothing can be tested
    p_bias: float | None
    p_scatter: float | None
    level: float  # of each test


def assess(evidence: TouchEvidence, tool_known: bool = True, noise_dof: float | None = None) -> Assessed:
    """Test bias and scatter; ``noise_dof`` degrees of freedom of estimated noise, None: it is known."""
    bias = bias_of(evidence, tool_known)
    p_bias = tail(bias.d2, bias.dof, noise_dof, bias.shares[0]) if bias.dof else None
    p_scatter = tail(bias.rest, bias.dof_rest, noise_dof, bias.shares[1]) if bias.dof_rest > 0 else None
    found = [p for p in (p_bias, p_scatter) if p is not None]
    p_value = None if not found else -float(np.expm1(len(found) * np.log1p(-min(*found, 1.0 - 1e-16))))
    return Assessed(bias, p_value, p_bias, p_scatter, level_of_each(max(len(found), 1)))


def repeated(evidence: TouchEvidence, times: float) -> TouchEvidence:
    """The touches, each made ``times`` times: what is drawn again has so much less variance."""
    by_unit = np.array(evidence.by_unit)
    if evidence.fresh:
        by_unit[..., -evidence.fresh :] /= np.sqrt(times)
    return replace(evidence, own=evidence.own / times, by_unit=by_unit)


def tail(d2: float, dof: int, noise_dof: float | None, share: float) -> float:
    """Probability of a ``d^2`` at least as large."""
    nu = _of_share(noise_dof, share)
    return float(chdtrc(dof, d2) if nu is None else fdtrc(dof, nu, d2 / dof))


def level_of_each(tests: int) -> float:
    """Level of each of the independent tests that together have `LEVEL`."""
    return float(1.0 - (1.0 - LEVEL) ** (1.0 / tests))


@lru_cache(maxsize=1000)
def noncentrality(dof: int, level: float, noise_dof: float | None = None, share: float = 0.0) -> float:
    """Noncentrality that shows at the level with the probability `POWER`.

    >>> round(noncentrality(3, 0.05), 2)
    17.17
    """
    nu = _of_share(noise_dof, share)

    def missed(size: float) -> float:
        if nu is None:
            return float(chndtr(chdtri(dof, level), dof, size)) - (1.0 - POWER)
        return float(ncfdtr(dof, nu, size, float(fdtri(dof, nu, 1.0 - level)))) - (1.0 - POWER)

    high = 50.0
    while missed(high) > 0 and high < 1e7:
        high *= 2.0
    return float(brentq(missed, 1e-6, high, xtol=1e-6)) if missed(high) <= 0 else float("inf")


def detectable(bias: Bias, level: float, noise_dof: float | None) -> float:
    """Smallest bias, in the worst direction, that shows with `POWER` probability."""
    if bias.dof < 3:
        return float("inf")
    return float(np.sqrt(noncentrality(3, level, noise_dof, bias.shares[0]))) * bias.worst[0]


def limit(evidence: TouchEvidence, tool_known: bool, level: float, noise_dof: float | None) -> float:
    """Smallest bias that any number of touches of the same kind would show."""
    return detectable(bias_of(repeated(evidence, _ANY), tool_known), level, noise_dof)


def touches_needed(
    evidence: TouchEvidence, tool_known: bool, size: float, level: float, noise_dof: float | None
) -> int | None:
    """Number of touches of the same kind until a bias of the size shows; None: no number would, or more than `MOST`."""
    m = len(evidence.r)

    def shows(n: int) -> bool:
        return detectable(bias_of(repeated(evidence, n / m), tool_known), level, noise_dof) <= size

    if not shows(MOST):
        return None
    low, high = 0, MOST
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if shows(middle) else (middle, high)
    return high


def quantile_of_components(probability: float, noise_dof: float | None) -> float:
    """Half width of an interval of one number, in standard deviations."""
    tail_of_each = 0.5 * (1.0 + probability)
    return float(ndtri(tail_of_each) if noise_dof is None else stdtrit(noise_dof, tail_of_each))


def _of_share(noise_dof: float | None, share: float) -> float | None:
    """Degrees of freedom of a variance of which noise that was estimated makes a share; None: known."""
    if noise_dof is None or share <= 0:
        return None
    found = noise_dof / share**2
    return None if found > 1e6 else found
