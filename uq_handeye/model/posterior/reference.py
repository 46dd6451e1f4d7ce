r"""The distribution of d^2 of new measurements if nothing has changed, with sizes that are known or open.

``d^2 = r^T Sigma^-1 r`` with the covariance Sigma of the posterior as a whole. At known sizes d^2 is chi-square. Where
sizes are open, r is a mixture of ``N(mu_d, Sigma_d)`` (`posterior`), and at each point d^2 has the cumulants

    E d^2 = tr T_d + mu_d^T Sigma^-1 mu_d,      Var d^2 = 2 tr T_d^2 + 4 mu_d^T Sigma^-1 Sigma_d Sigma^-1 mu_d,
    T_d = Sigma^-1 Sigma_d

and is taken as a scaled chi-square of these (Satterthwaite). A change delta adds ``delta^T I delta`` to d^2 and is a
noncentrality of each of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, chdtri, chndtr

from ...core.geometry.se3 import Array
from ...core.runtime.read_only import ReadOnlyArrays


@dataclass(frozen=True, eq=False)
class PredictiveReference(ReadOnlyArrays):
    """d^2 of ``size`` numbers as a mixture of scaled chi-square distributions, ``scale_t chi^2(dof_t)``."""

    size: int
    weight: Array  # (t,)
    scale: Array  # (t,)
    dof: Array  # (t,)

    @classmethod
    def given(cls, size: int) -> PredictiveReference:
        """Chi-square: all sizes are known."""
        return cls(size, np.ones(1), np.ones(1), np.full(1, float(size)))

    @classmethod
    def by_cumulants(cls, size: int, weight: Array, mean: Array, variance: Array) -> PredictiveReference:
        """Build it from mean and variance (t,) of d^2 at each point."""
        return cls(size, weight, variance / (2.0 * mean), 2.0 * mean**2 / variance)

    @property
    def noise_given(self) -> bool:
        """True for chi-square."""
        return len(self.weight) == 1

    @property
    def noise_dof(self) -> float:
        """Degrees of freedom of the common size of the noise; infinite if it is given."""
        mean = self.scale * self.dof / self.size
        logs = np.log(mean)
        variance = float(self.weight @ (logs - self.weight @ logs) ** 2)
        return 2.0 / variance if variance > 1e-9 else float("inf")

    def p_value(self, d2: float, size: int | None = None) -> float:
        """Probability of a d^2 at least as large; ``size``: of so many of the numbers."""
        share = 1.0 if size is None else size / self.size
        return float(np.clip(self.weight @ chdtrc(share * self.dof, max(d2, 0.0) / self.scale), 0.0, 1.0))

    def quantile(self, level: float) -> float:
        """The d^2 below which the share ``level`` lies."""
        if self.noise_given:
            return float(self.scale[0] * chdtri(self.dof[0], 1.0 - level))
        ends = self.scale * chdtri(self.dof, 1.0 - level)
        return float(brentq(lambda x: self.p_value(x) - (1.0 - level), ends.min(), ends.max(), rtol=1e-6))

    def power(self, noncentrality: float, level: float = 0.05) -> float:
        """Probability that a change of this noncentrality ``delta^T I delta`` shows at the level."""
        return self._power(noncentrality, self.quantile(1.0 - level))

    def _power(self, noncentrality: float, limit: float) -> float:
        below = chndtr(limit / self.scale, self.dof, noncentrality / self.scale)
        return float(np.clip(1.0 - self.weight @ below, 0.0, 1.0))

    def noncentrality(self, power: float = 0.95, level: float = 0.05) -> float:
        """Return the noncentrality that shows with the probability ``power``."""
        limit = self.quantile(1.0 - level)
        high = limit
        while self._power(high, limit) < power:
            high *= 2.0
        return float(brentq(lambda x: self._power(x, limit) - power, 0.0, high, rtol=1e-6))

    def deviance(self, d2: float) -> float:
        """Minus twice the log-likelihood of d^2, up to a constant: Gaussian, or Student's t with noise estimated."""
        nu = self.noise_dof
        return d2 if np.isinf(nu) else (nu + self.size) * float(np.log1p(d2 / nu))
