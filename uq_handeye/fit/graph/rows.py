r"""New measurements against a posterior: their test, the part that a cause explains, and the update of the errors.

A measurement of k numbers differs from its prediction by the estimates by r. If nothing has changed,

    r = V u + own noise,      s = L u  (`posterior`),      Sigma = blkdiag(own) + V V^T

V holds the errors of the unknown poses, the errors that all measurements share, and errors that only the new
measurements share (a tool that is not known). ``d^2 = r^T Sigma^-1 r`` is tested (`PredictiveReference`). A cause with
the columns C, ``E r = C a``, is estimated by generalised least squares,

    a = (C^T Sigma^-1 C)^-1 C^T Sigma^-1 r,      Cov a = (C^T Sigma^-1 C)^-1

and takes ``a^T Cov(a)^-1 a`` away from d^2. The errors s given r are

    E s = L V^T Sigma^-1 r,      Cov s = L (1 - V^T Sigma^-1 V) L^T

the update of a Kalman filter, and the fit of all data together to first order, for known sizes.

*Distribution of d^2 if nothing has changed.* At known sizes d^2 is chi-square. Where sizes are open, r is a mixture of
``N(mu_d, Sigma_d)`` (`posterior`), and at each point d^2 has the cumulants

    E d^2 = tr T_d + mu_d^T Sigma^-1 mu_d,      Var d^2 = 2 tr T_d^2 + 4 mu_d^T Sigma^-1 Sigma_d Sigma^-1 mu_d,
    T_d = Sigma^-1 Sigma_d

and is taken as a scaled chi-square of these (Satterthwaite). A change delta adds ``delta^T I delta`` to d^2 and is a
noncentrality of each of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import chdtrc, chdtri, chndtr

from ...core.geometry.se3 import Array
from ...core.levels import POWER, UNUSUAL
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import CHAIN_ROUNDING, SOLUTION_ROUNDING, TINY
from ...model.errors.cholesky import checked_cholesky, substitute
from ...model.errors.joint_covariance import JointFactor
from ...model.errors.key import ErrorKey
from ...model.errors.term import ErrorTerm

# Added to the diagonal of a covariance scaled to ones before its Cholesky factor is computed, and the least eigenvalue
# where even so it has none.
RIDGE_OF_COVARIANCE = 1e-13


class Joint(Protocol):
    """Interface of a posterior."""

    @property
    def A(self) -> Array: ...
    @property
    def covariance(self) -> Array: ...
    @property
    def points(self) -> Any: ...  # `SizePoints`, or None
    @property
    def noise(self) -> tuple[ErrorTerm, ...]: ...


class Test(NamedTuple):
    """Test of measurements as a whole: squared distance, its degrees of freedom and distribution."""

    d2: float
    dof: int
    reference: PredictiveReference

    @property
    def p_value(self) -> float:
        """Probability of measurements at least as far away, if nothing has changed."""
        return self.reference.p_value(self.d2)


class Explained(NamedTuple):
    """A cause of given columns, by generalised least squares."""

    estimate: Array  # (c,)
    covariance: Array  # (c, c)
    gain: float  # by how much d^2 falls


class ErrorsGiven(NamedTuple):
    """The errors of the estimates once the measurements are known."""

    mean: Array  # (12 + q,) of s: estimates less truth, so that the new estimate is the old one less it
    covariance: Array  # (12 + q, 12 + q)


@dataclass(frozen=True, eq=False)
class NewRows(ReadOnlyArrays):
    """m measurements of k numbers each against a posterior; see the module."""

    _each: ClassVar[tuple[str, ...]] = ("r", "by_unit", "own")  # what has a row for each

    r: Array  # (m, k) measured less stated; rad, m
    by_unit: Array  # (m, k, p + z) V: by the u of the posterior, then by errors of these measurements only
    own: Array  # (m, k, k) covariance of each measurement's own noise
    posterior: Joint
    own_at: Array = field(default_factory=lambda: np.zeros(0), kw_only=True)  # (d, m, k, k) own at each point, or none
    # of `own`: noise of open sizes, (m, k, k) where the size is 1
    parts: tuple[tuple[ErrorKey, Array], ...] = field(default=(), kw_only=True)

    @property
    def dof(self) -> int:
        """Number of numbers."""
        return int(self.r.size)

    @cached_property
    def factor(self) -> JointFactor:
        """L with ``Sigma = L L^T``; raises `SingularNoiseError` where a measurement has no noise of its own."""
        return JointFactor.of(self.own, self.by_unit)

    @property
    def by_errors(self) -> Array:
        """(m, k, N) by the errors s of the posterior."""
        A = self.posterior.A
        flat = self.by_unit[..., : len(A)].reshape(-1, len(A))
        return np.asarray(solve_triangular(A, flat.T, lower=True, trans="T").T.reshape(*self.r.shape, -1))

    def own_of(self, sizes: Mapping[ErrorKey, float]) -> Array:
        """(m, k, k) own, with `parts` of other sizes."""
        stated = {one.key: one.size.median for one in self.posterior.noise} if self.parts else {}
        more = ((sizes.get(key, stated[key]) ** 2 - stated[key] ** 2) * S for key, S in self.parts)
        return np.asarray(sum(more, np.asarray(self.own)))

    def whitened(self, columns: Array) -> Array:
        """``L^-1 C`` (mk, c) of columns (m, k, c)."""
        white = self.factor.whiten(columns)
        return np.asarray(white.reshape(-1, white.shape[-1]))

    @cached_property
    def white(self) -> Array:
        """``L^-1 r`` (mk,)."""
        return self.whitened(self.r[..., None])[:, 0]

    @property
    def d2(self) -> float:
        """``r^T Sigma^-1 r``."""
        return float(self.white @ self.white)

    @property
    def covariance(self) -> Array:
        """(mk, mk) of r."""
        V = self.by_unit.reshape(self.dof, -1)
        result = V @ V.T
        m, k = self.r.shape
        for i in range(m):
            result[i * k : i * k + k, i * k : i * k + k] += self.own[i]
        return result

    def information(self, columns: Array) -> Array:
        """``C^T Sigma^-1 C`` (c, c) of the columns (m, k, c) of a cause: of its noncentrality by its size."""
        white = self.whitened(columns)
        return np.asarray(white.T @ white)

    def explained_by(self, columns: Array) -> Explained:
        """Estimate a cause by its columns (m, k, c); combinations of them without effect get the estimate 0.

        The covariance is then that of the others.
        """
        white = self.whitened(columns)
        size = np.linalg.norm(white, axis=0)
        size = np.where(size > 0, size, 1.0)
        U, s, Vt = np.linalg.svd(white / size, full_matrices=False)
        determined = s > s.max(initial=0.0) * CHAIN_ROUNDING
        along = U.T[determined] @ self.white
        back = (Vt[determined].T / s[determined]) / size[:, None]
        return Explained(back @ along, back @ back.T, float(along @ along))

    def absorbed(self) -> ErrorsGiven:
        """Return the errors of the estimates, given these measurements."""
        own = replace(self, by_unit=self.by_unit[..., :0])
        V, r = own.whitened(self.by_unit), own.whitened(self.r[..., None])[:, 0]
        p = self.posterior.A.shape[1]
        inner = cho_factor(np.eye(V.shape[1]) + V.T @ V)  # u given r has the covariance (1 + V^T V)^-1
        A = np.zeros((len(self.posterior.A), V.shape[1]))
        A[:, :p] = self.posterior.A
        covariance = A @ cho_solve(inner, A.T)
        return ErrorsGiven(A @ cho_solve(inner, V.T @ r), 0.5 * (covariance + covariance.T))

    @cached_property
    def test(self) -> Test:
        """Test of all of them as a whole."""
        return Test(self.d2, self.dof, self._reference())

    def _reference(self) -> PredictiveReference:
        points = self.posterior.points
        if points is None:
            return PredictiveReference.given(self.dof)
        N, B = len(self.posterior.A), checked_cholesky(self.own)
        V = substitute(B, self.by_unit)
        m, k, K = V.shape
        flat = V.reshape(m * k, K)
        G = flat.T @ flat
        W = np.linalg.inv(np.eye(K) + G)
        S = W @ G  # V^T Sigma^-1 V
        mean, variance = np.empty(len(points.weights)), np.empty(len(points.weights))
        for d in range(len(mean)):
            own = np.broadcast_to(np.eye(k), (m, k, k)) if not len(self.own_at) else _whitened(B, self.own_at[d])
            first = (own @ V).reshape(m * k, K)
            M1, M2 = flat.T @ first, first.T @ first
            R = np.eye(K)
            R[:N, :N] = points.covariances[d]
            mu = np.zeros(K)
            mu[:N] = points.means[d]
            WM, RS = W @ M1, R @ S
            trace = np.einsum("mii->", own) - np.trace(WM) + np.trace(RS)
            square = float(np.sum(own * own)) - 2.0 * np.sum(W * M2) + np.sum(WM * WM.T)
            square += 2.0 * np.sum((W @ M1 @ W) * R) + np.sum(RS * RS.T)
            mean[d] = trace + mu @ S @ mu
            variance[d] = 2.0 * square + 4.0 * (mu @ (W @ M1 @ W + S @ R @ S) @ mu)
        return PredictiveReference.by_cumulants(self.dof, np.asarray(points.weights), mean, variance)

    def reference_along(self, U: Array) -> PredictiveReference:
        """Return the distribution of ``|U^T L^-1 r|^2`` for t orthonormal directions U (mk, t) of whitened numbers."""
        points, t = self.posterior.points, U.shape[1]
        if points is None:
            return PredictiveReference.given(t)
        m, k = self.r.shape
        P = U.T @ self.whitened(np.eye(m * k).reshape(m, k, m * k))
        own = self.own_at if len(self.own_at) else np.broadcast_to(self.own, (len(points.weights), *self.own.shape))
        by_block = P.reshape(t, m, k)
        V = P @ self.by_unit.reshape(m * k, -1)
        N = len(self.posterior.A)
        T = np.einsum("tmi,dmij,smj->dts", by_block, own, by_block, optimize=True)
        T = T + V[:, :N] @ points.covariances @ V[:, :N].T + self._own_units_at(V[:, N:])
        mu = points.means @ V[:, :N].T
        mean = np.trace(T, axis1=1, axis2=2) + np.sum(mu * mu, axis=1)
        variance = 2.0 * np.sum(T * T, axis=(1, 2)) + 4.0 * np.einsum("dt,dts,ds->d", mu, T, mu)
        return PredictiveReference.by_cumulants(t, np.asarray(points.weights), mean, variance)

    def _own_units_at(self, V: Array) -> Array:
        """(d or 1, t, t) covariance by the errors that these measurements share by themselves, at each point."""
        return np.asarray((V @ V.T)[None])

    def rows(self, index: Any) -> Self:
        """Some of the measurements, by their numbers or a mask."""
        own_at = self.own_at[:, index] if len(self.own_at) else self.own_at
        parts = tuple((key, S[index]) for key, S in self.parts)
        return replace(self, own_at=own_at, parts=parts, **{name: getattr(self, name)[index] for name in self._each})


def _whitened(B: Array, S: Array) -> Array:
    """``B^-1 S B^-T`` (m, k, k)."""
    half = substitute(B, S)
    return np.asarray(substitute(B, half.mT))


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
        return 2.0 / variance if variance > CHAIN_ROUNDING else float("inf")

    def p_value(self, d2: float, size: int | None = None) -> float:
        """Probability of a d^2 at least as large; ``size``: of only some of the numbers."""
        share = 1.0 if size is None else size / self.size
        return float(np.clip(self.weight @ chdtrc(share * self.dof, max(d2, 0.0) / self.scale), 0.0, 1.0))

    def quantile(self, level: float) -> float:
        """The d^2 below which the share ``level`` lies."""
        if self.noise_given:
            return float(self.scale[0] * chdtri(self.dof[0], 1.0 - level))
        ends = self.scale * chdtri(self.dof, 1.0 - level)
        from scipy.optimize import brentq  # slow to import

        return float(brentq(lambda x: self.p_value(x) - (1.0 - level), ends.min(), ends.max(), rtol=1e-6))

    def power(self, noncentrality: float, level: float = UNUSUAL.probability) -> float:
        """Probability that a change of this noncentrality ``delta^T I delta`` shows at the level."""
        return self._power(noncentrality, self.quantile(1.0 - level))

    def _power(self, noncentrality: float, limit: float) -> float:
        below = chndtr(limit / self.scale, self.dof, noncentrality / self.scale)
        return float(np.clip(1.0 - self.weight @ below, 0.0, 1.0))

    def noncentrality(self, power: float = POWER.probability, level: float = UNUSUAL.probability) -> float:
        """Return the noncentrality that shows with the probability ``power``."""
        limit = self.quantile(1.0 - level)
        high = limit
        while self._power(high, limit) < power:
            high *= 2.0
        from scipy.optimize import brentq  # slow to import

        return float(brentq(lambda x: self._power(x, limit) - power, 0.0, high, rtol=1e-6))

    def deviance(self, d2: float) -> float:
        """Minus twice the log-likelihood of d^2, up to a constant: Gaussian, or Student's t with noise estimated."""
        nu = self.noise_dof
        return d2 if np.isinf(nu) else (nu + self.size) * float(np.log1p(d2 / nu))


def smallest_change(information: Array, noncentrality: float) -> tuple[float, float]:
    """Return the shift (m) and the rotation (rad) of a pose, of the information (6, 6) of (theta, tau), that show."""
    return _worst(information[3:, 3:], noncentrality), _worst(information[:3, :3], noncentrality)


def _worst(information: Array, noncentrality: float) -> float:
    values = np.linalg.eigvalsh(information)
    return float(np.sqrt(noncentrality / values[0])) if values[0] > SOLUTION_ROUNDING * values[-1] else float("inf")


def factor_of(P: Array) -> Array:
    """L, lower triangular, with ``P = L L^T``; what is negative by rounding counts as `RIDGE_OF_COVARIANCE`."""
    scale = np.sqrt(np.maximum(np.diag(P), TINY))
    scaled = P / np.outer(scale, scale)
    try:
        return np.asarray(scale[:, None] * np.linalg.cholesky(scaled + RIDGE_OF_COVARIANCE * np.eye(len(P))))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(scaled)
        R = np.linalg.qr((vectors * np.sqrt(np.maximum(values, RIDGE_OF_COVARIANCE))).T)[1]
        return np.asarray(scale[:, None] * (R.T * np.where(np.diag(R) < 0, -1.0, 1.0)))


def at_points(posterior: Joint, own: Array, parts: Sequence[tuple[ErrorKey, Array]]) -> Array:
    """(d, m, k, k) own noise at each point of open sizes, of `NewRows` with these parts; none where all are known."""
    if posterior.points is None:
        return np.zeros(0)
    points, stated = posterior.points, {one.key: one.size.median for one in posterior.noise}
    found = np.repeat(own[None], len(posterior.points.weights), axis=0)
    for key, S in parts:
        found += (points.sizes_of(key) ** 2 - stated[key] ** 2)[:, None, None, None] * S
    return found
