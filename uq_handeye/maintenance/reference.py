r"""The distribution of d^2 of new measurements if nothing has changed, with noise given or estimated.

With noise given, ``d^2 = r^T Sigma^-1 r`` is chi-square. With noise estimated by the calibration, Sigma was made of
estimated variances phi with the covariance V of their estimates (`noise_estimation`), and d^2 is larger whenever they
came out too small. ``Sigma(phi) = Sigma_0 + sum_k phi_k M_k`` is linear also in what X and W bring, as the weights of
their estimate are those that were used. Whitened by the estimate, ``N_k = L^-1 M_k L^-T``, and in axes that nearly
diagonalise all N_k,

    d^2 = sum_j lambda_j z_j^2,      lambda_j = 1 + n_j^T (phi - estimate),      n_j = (N_k,jj)_k

lambda_j is taken as ``nu_j / chi^2(nu_j)``, ``nu_j = 2 / n_j^T V n_j``, the predictive distribution of a variance that
was estimated with nu_j degrees of freedom, with the correlations of ``n_i^T V n_j`` between their logarithms. With one
unknown factor this is the F distribution exactly. The integral over phi is one over the few independent directions of V
(Gauss-Hermite); given phi, d^2 is a scaled chi-square with the same mean and variance (Satterthwaite). The F
distribution by moments (Kenward and Roger 1997) fails here, where new poses have more numbers than the noise has
degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, chdtri, chndtr

from ..geometry.se3 import Array
from ..runtime.read_only import ReadOnlyArrays

# Nodes of the integral along each direction of V, by the number of directions.
NODES = {1: 15, 2: 11, 3: 7}
# Fewer degrees of freedom of a variance have no mean of the predictive distribution.
FEWEST_DOF = 3.0
# Mixing of the directions of V for the common axes: no two alike.
_MIX = (1.0, 0.618, 0.382)


@dataclass(frozen=True, eq=False)
class PredictiveReference(ReadOnlyArrays):
    """d^2 of ``size`` numbers as a mixture of scaled chi-square distributions, ``scale_t chi^2(dof_t)``."""

    size: int
    weight: Array  # (t,)
    scale: Array  # (t,)
    dof: Array  # (t,)

    @classmethod
    def given(cls, size: int) -> PredictiveReference:
        """Chi-square: the noise is known."""
        return cls(size, np.ones(1), np.ones(1), np.full(1, float(size)))

    @classmethod
    def estimated(cls, derivatives: Sequence[Array], covariance: Array) -> PredictiveReference:
        """Build it from the whitened derivatives N_k (size, size) and the covariance V (k, k) of the variances."""
        size = len(derivatives[0])
        N = np.array(derivatives)
        unit = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        told = unit > 0
        if not told.any():
            return cls.given(size)
        N, unit = N[told] * unit[told, None, None], unit[told]
        values, vectors = np.linalg.eigh(covariance[np.ix_(told, told)] / np.outer(unit, unit))
        kept = np.argsort(values)[::-1][: len(_MIX)]
        kept = kept[values[kept] > 1e-9 * values.max()]
        # Directions of V, each of standard deviation 1: (a, size, size).
        along = np.einsum("ka,kij->aij", vectors[:, kept] * np.sqrt(values[kept]), N)
        axes = np.linalg.eigh(np.einsum("a,aij->ij", np.array(_MIX[: len(kept)]), along))[1]
        n = np.einsum("ij,aik,kj->ja", axes, along, axes)  # (size, a)
        # What is off the diagonal in these axes enlarges d^2, too.
        beyond = float(np.sum(along**2) - np.sum(n**2)) / size
        variance = np.sum(n**2, axis=-1)
        nu = np.maximum(2.0 / np.maximum(variance, 1e-12), FEWEST_DOF)
        a = len(kept)
        node, weight = np.polynomial.hermite_e.hermegauss(NODES[a])
        z = np.stack(np.meshgrid(*[node] * a, indexing="ij"), axis=-1).reshape(-1, a)
        w = np.prod(np.stack(np.meshgrid(*[weight / weight.sum()] * a, indexing="ij"), axis=-1).reshape(-1, a), axis=-1)
        by_axis = -z @ (n / np.sqrt(np.maximum(variance, 1e-300))[:, None]).T  # (t, size) standard normal
        spread = 2.0 / (9.0 * nu)
        chi2 = np.maximum(1.0 - spread + by_axis * np.sqrt(spread), 0.1) ** 3  # Wilson and Hilferty, over nu
        factor = (1.0 + beyond) / chi2
        mean, square = factor.sum(axis=-1), (factor**2).sum(axis=-1)
        return cls(size, w, square / mean, mean**2 / square)

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
