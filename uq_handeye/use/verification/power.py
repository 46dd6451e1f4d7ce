"""A bias that all touches share: its estimate, its tests, the size that would show, and the number of touches needed.

With the whitened differences w and the columns B of a bias (an offset in the base) and T of a tool that is not known,
both whitened, and Q the projection that removes T,

    b = (B^T Q B)^-1 B^T Q w,    Cov b = (B^T Q B)^-1,    |Q w|^2 = b^T Cov(b)^-1 b + scatter

The two parts are chi-square and independent if nothing has changed, with 3 and with 3 m - 3 - rank T degrees of
freedom. Where sizes are estimated, each has the distribution that the posterior gives it (`NewRows.reference_along`).

*Level.* Each of two tests is made at ``1 - sqrt(1 - level)``, so that both together have the level of an unusual
result.

*Power.* A bias beta makes the first part non-central, ``lambda = beta^T Cov(b)^-1 beta``. It shows with a probability
of 95 % where lambda is at least that of the reference: in the worst direction from the size
``sqrt(lambda * largest eigenvalue of Cov b)`` on. n times as many touches of the same kind divide the noise of touching
and seeing by n; X, the shared errors and the tool stay, and set the limit.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ...calibration.evidence.touches import TouchEvidence
from ...core.geometry.se3 import Array
from ...core.levels import POWER, UNUSUAL
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import CHAIN_ROUNDING, HALF_DIGITS
from ...fit.graph.rows import PredictiveReference

# Touches at most that are recommended.
MAX_TOUCHES = 10_000


@dataclass(frozen=True, eq=False)
class Bias(ReadOnlyArrays):
    """Bias of touches and the scatter about it, with the tests of both."""

    evidence: TouchEvidence
    estimate: Array  # (3,), 0 along directions that a tool hides
    covariance: Array  # (3, 3), 0 along these
    hidden: Array  # (h, 3) directions that the tool hides
    d2: float  # of the bias
    rest: float  # of the scatter
    along: Array  # (3m, dof) directions of the whitened numbers that the bias is told by
    left: Array  # (3m, dof_rest) those of the scatter

    @property
    def dof(self) -> int:
        """Number of directions in which there can be a bias."""
        return int(self.along.shape[1])

    @property
    def dof_rest(self) -> int:
        """Number of numbers of the scatter."""
        return int(self.left.shape[1])

    @property
    def worst(self) -> tuple[float, Array]:
        """Largest standard deviation of the bias and its direction; infinite along what is hidden."""
        if len(self.hidden):
            return float("inf"), self.hidden[0]
        values, vectors = np.linalg.eigh(self.covariance)
        direction = vectors[:, -1]
        return float(np.sqrt(values[-1])), direction * np.sign(direction[np.abs(direction).argmax()])

    @cached_property
    def reference(self) -> PredictiveReference:
        """Distribution of the part of the bias if there is none."""
        return self.evidence.reference_along(self.along)

    @cached_property
    def p_values(self) -> tuple[float | None, float | None]:
        """Probabilities of the bias and of the scatter; None where there is nothing to test."""
        p_bias = self.reference.p_value(self.d2) if self.dof else None
        p_scatter = self.evidence.reference_along(self.left).p_value(self.rest) if self.dof_rest else None
        return p_bias, p_scatter

    @property
    def p_value(self) -> float | None:
        """Probability of both together; None: nothing can be tested."""
        found = [p for p in self.p_values if p is not None]
        return -float(np.expm1(len(found) * np.log1p(-min(*found, 1.0 - 1e-16)))) if found else None

    @property
    def level(self) -> float:
        """Level of each test."""
        return level_of_each(max(sum(p is not None for p in self.p_values), 1))

    def detectable(self, level: float) -> float:
        """Smallest bias, in the worst direction, that these touches would show with a probability of 95 %."""
        if self.dof < 3:
            return float("inf")
        size = (
            _of_known_noise(level)
            if self.reference.noise_given
            else self.reference.noncentrality(POWER.probability, level)
        )
        return float(np.sqrt(size)) * self.worst[0]


def bias_of(evidence: TouchEvidence, tool_known: bool = True) -> Bias:
    """Estimate the bias and split ``d^2``."""
    m = len(evidence.r)
    bias = np.broadcast_to(np.eye(3), (m, 3, 3))
    white = evidence.whitened(np.concatenate([bias, evidence.by_tool[..., : 0 if tool_known else 3]], axis=-1))
    B, T, w = white[:, :3], white[:, 3:], evidence.white
    of_tool = np.zeros((3 * m, 0))
    if not tool_known:
        U, s, _ = np.linalg.svd(T, full_matrices=False)
        of_tool = U[:, s > s.max() * CHAIN_ROUNDING]
        B, w = (x - of_tool @ (of_tool.T @ x) for x in (B, w))
    U, s, Vt = np.linalg.svd(B, full_matrices=False)
    # In units of what the bias would be known to without the tool.
    whole = np.linalg.norm(white[:, :3], axis=0).max()
    told = s > whole * np.sqrt(CHAIN_ROUNDING)
    U, back = U[:, told], Vt[told].T / s[told]
    along = U.T @ w
    rest = w - U @ along
    found = np.concatenate([of_tool, U], axis=1)
    left = np.linalg.qr(found, mode="complete")[0][:, found.shape[1] :]
    d2_rest = float(rest @ rest) if left.shape[1] else 0.0
    return Bias(evidence, back @ along, back @ back.T, Vt[~told], float(along @ along), d2_rest, U, left)


def level_of_each(tests: int) -> float:
    """Level of each of the independent tests that together have that of an unusual result."""
    return float(1.0 - (1.0 - UNUSUAL.probability) ** (1.0 / tests))


@lru_cache(maxsize=100)
def _of_known_noise(level: float) -> float:
    return PredictiveReference.given(3).noncentrality(POWER.probability, level)


def limit(evidence: TouchEvidence, tool_known: bool, level: float) -> float:
    """Smallest bias that any number of touches of the same kind would show: without their own noise."""
    return bias_of(evidence.repeated(1.0 / HALF_DIGITS), tool_known).detectable(level)


def touches_needed(evidence: TouchEvidence, tool_known: bool, size: float, level: float) -> int | None:
    """Number of touches of the same kind until a bias of the size shows; None: more than `MAX_TOUCHES`, or none."""

    def shows(n: int) -> bool:
        return bias_of(evidence.repeated(n / len(evidence.r)), tool_known).detectable(level) <= size

    return bisect_left(range(MAX_TOUCHES), True, lo=1, key=shows) if shows(MAX_TOUCHES) else None
