r"""The density that `sample_posterior` samples: the likelihood of T5 as a function of X, with a flat prior on X.

Model (`constraint`, `gauss_helmert`): measured poses or motions are true ones with Gaussian errors ``xi = (theta,
tau)``, and the true ones satisfy ``G X C = W`` or ``A X = X B``. X is ``exp([theta]x) R_hat, t_hat + tau`` about the
maximum of the likelihood (R_hat, t_hat); the prior is flat in ``(theta, tau)``. The latent true poses (motions) are
integrated out to first order in their errors, which leaves

    -2 log p(X, W) = sum_i rho_i^T S_i^-1 rho_i,   rho_i = r_i(X, W; corrected) + D_i v_i                (T5)

Some parts of this density are exact, others hold to first order:

- r is the full residual of X, not linearised in X; its data are those that maximum likelihood corrected, and v are the
  errors that it removed. So the density has its maximum at the estimate of `ml`, whose derivatives are not biased by
  noise.
- S and D are held at the estimate. Against the posterior with every latent motion integrated by importance sampling,
  the mean is off by less than 0.02 standard deviations for 1 mrad + 0.1 mm and 10 mrad + 0.1 mm, by less than 0.1 for
  10 mrad + 10 mm, the standard deviations by less than 3 % (12 motions, tests/validation/posterior/test_density.py). To
  let S and D follow X at the measured data would move it by several standard deviations for 10 mrad + 0.1 mm, where
  the noise sits in the lever arms. Where S changes within the posterior, this density is no check.
- On poses W, with a flat prior, is integrated out about its best value for each X, to first order in the remaining
  residual. As S is held, ``dr/dW = -I`` makes the determinant of that integral the same for every X.

*Noise scales* (optional): ``S_i = s_1^2 S_1i + s_2^2 S_2i`` with the sides robot (A) and camera (B), and log s_j
Gaussian about 0. ``S_1i`` and ``S_2i`` are diagonalised together once, with eigenvalues ``lambda`` and ``1 - lambda``,
so that every component has the variance ``s_1^2 lambda + s_2^2 (1 - lambda)``; the log-determinants of S and of the
integral over W follow the scales.

*Student-t* (optional): rho_i has the multivariate t density with nu degrees of freedom and the *scale* matrix S_i,

    log p_i = -(nu + 6)/2 log(1 + rho_i^T S_i^-1 rho_i / nu) - log det(S_i)/2

one heavy-tailed factor for each pose or motion. W has then no closed integral and is sampled: 12 coordinates.

Coordinates are whitened by the covariance of `ml` (by the expected information for log s), so that a Gaussian posterior
is about N(0, I). Units: rad and m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from ....core.geometry.checks import is_number
from ....core.geometry.se3 import Array
from ....core.rounding import TINY
from ....errors import DegenerateMotionError, InputError
from ....fit.graph.constraint import Constraint, block_diagonal, constraint_of, covariances_of, residual_covariance
from ....fit.graph.gauss_helmert import Fit, corrected, maximum_likelihood
from ....model.errors.models import Noise, PairNoise, PoseNoise, is_joint
from ....model.errors.square_roots import Covariance, cholesky_of, gram, whiten
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from ...simulation.run import BLOCK_POSES

AXES = ("theta_x", "theta_y", "theta_z", "tau_x", "tau_y", "tau_z")
# The logarithm of a scale beyond this has no probability: far outside of any data, and short of overflow.
MAX_LOG_SCALE = np.log(1e6)


@dataclass(frozen=True)
class ScalePrior:
    """Uncertainty of the noise given: one unknown factor on the standard deviations of each side.

    Parameters
    ----------
    robot, camera : float or None
        The factor is 1 within this factor: ``log(factor)`` is the standard deviation of its logarithm, which is
        Gaussian. None holds it at 1. For motions with noise of their own ``robot`` is A and ``camera`` is B.

    Raises
    ------
    InputError
        A factor that is not above 1, or None for both.
    """

    robot: float | None = 3.0
    camera: float | None = 3.0

    def __post_init__(self) -> None:
        for name, value in (("robot", self.robot), ("camera", self.camera)):
            if value is not None and not (is_number(value) and 1 < value <= 1e3):
                raise InputError(
                    f"Expected `{name}` of ScalePrior to be None or a factor above 1 and at most 1000, got {value!r}."
                )
        if self.robot is None and self.camera is None:
            raise InputError("Expected ScalePrior to leave a scale free; scales=False holds both at 1.")


class Scales(NamedTuple):
    """The sides whose noise has an unknown scale."""

    sides: tuple[int, ...]  # 0: robot or A, 1: camera or B
    deviations: Array  # of log s, by the prior

    def names(self, pairs: bool) -> tuple[str, ...]:
        """Return the names of the factors in results."""
        both = ("A", "B") if pairs else ("robot", "camera")
        return tuple(f"log_scale_{both[side]}" for side in self.sides)


@dataclass(frozen=True, eq=False)
class Density:
    """The posterior density in whitened coordinates y (K, d); see the module.

    `coordinates` turns y into errors of X (rad, m), then of W if it is sampled, then log-scales.
    """

    constraint: Constraint
    fit: Fit
    first: Array  # poses (motions) as maximum likelihood corrected them
    second: Array
    whitening: Array  # (n, 6, 6), or (6n, 6n): V with V S V^T = I, and V S_1 V^T = diag(share)
    share: Array  # (n, 6): lambda, the part of side 1 in each variance
    by_W: Array | None  # (n, 6, 6) whitened derivatives by W, where W is integrated out
    factor: Array  # (d, d), lower triangular: coordinates = factor @ y
    follow: Array | None  # (6, 6): the best W moves by follow @ xi
    scales: Scales
    student_t: float | None
    names: tuple[str, ...]

    @property
    def d(self) -> int:
        """Number of coordinates."""
        return len(self.names)

    def coordinates(self, y: Array) -> Array:
        """Errors and log-scales (..., d) of whitened coordinates (..., d)."""
        x = np.asarray(y @ self.factor.T)
        if len(self.scales.sides) == 2:
            x[..., -2:] = self._log_scales(x[..., -2], x[..., -1])
        return x

    def _log_scales(self, total: Array, ratio: Array) -> Array:
        """Log-scales (..., 2) from half the log of their mean square (by mean shares) and their difference.

        Data may tell the total and not how it is split, which in the log-scales would be a bent ridge. The map keeps
        volumes: its Jacobian [[1, 1 + a], [1, a]] has the determinant -1 for every a.
        """
        w = float(self.share.mean())
        second = total - 0.5 * np.logaddexp(np.log(max(w, TINY)) + 2.0 * ratio, np.log(max(1.0 - w, TINY)))
        return np.stack([second + ratio, second], axis=-1)

    def __call__(self, y: Array) -> Array:
        """Log-density (K,) of coordinates (K, d), up to a constant."""
        y = np.atleast_2d(y)
        rows = max(1, BLOCK_POSES // len(self.share))
        return np.concatenate([self._block(y[k : k + rows]) for k in range(0, len(y), rows)])

    def _block(self, y: Array) -> Array:
        x = self.coordinates(y)
        z = self._whitened(x)  # (n, 6, K)
        k = len(self.scales.sides)
        known = self._of_prior(x)
        if k == 0:
            return self._at_scale_1(z) + known
        log_s = x[:, -k:]
        prior = -0.5 * ((log_s / self.scales.deviations) ** 2).sum(axis=1)
        outside = (np.abs(log_s) > MAX_LOG_SCALE).any(axis=1)
        squares = np.ones((2, len(y)))
        squares[list(self.scales.sides)] = np.exp(2.0 * np.where(outside[:, None], 0.0, log_s)).T
        variances = self.share[..., None] * squares[0] + (1.0 - self.share[..., None]) * squares[1]
        return np.where(outside, -np.inf, prior + known + self._at_scales(z, variances))

    def _of_prior(self, x: Array) -> Array:
        """Log-density (K,) of what is known of X and W beforehand, but for a constant."""
        if self.fit.prior is None:
            return np.zeros(len(x))
        at = self.fit.unknowns.moved(self._step(x))
        return np.asarray(-0.5 * self.fit.prior.normal_equations(at.X, at.W)[2])

    def _step(self, x: Array) -> Array:
        """Errors (K, p) of X, and of W, with W at its best where it is integrated out."""
        p = 6 if self.follow is not None or self.fit.W is None else 12
        step = x[:, :p]
        return step if self.follow is None else np.concatenate([step, step @ self.follow.T], axis=1)

    def _whitened(self, x: Array) -> Array:
        """``V rho`` (n, 6, K) at errors x (K, ...) of X and W."""
        r = self.constraint.residual(self.fit.unknowns.moved(self._step(x)), self.first, self.second)
        # r is 0 at the maximum (but for the last step of `ml`), so what is added is D v
        rho = np.ascontiguousarray(np.moveaxis(r, 0, -1)) + self.fit.residual[..., None]
        if self.whitening.ndim == 3:
            return np.asarray(self.whitening @ rho)
        return np.asarray((self.whitening @ rho.reshape(-1, rho.shape[-1])).reshape(rho.shape))

    def _at_scale_1(self, z: Array) -> Array:
        if self.student_t is not None:
            return self._heavy((z * z).sum(axis=1))
        square = np.einsum("nik,nik->k", z, z)
        if self.by_W is not None:  # the whitened derivatives by W are orthonormal at scale 1
            fitted = self.by_W.reshape(-1, 6).T @ z.reshape(-1, z.shape[-1])
            square = square - np.einsum("jk,jk->k", fitted, fitted)
        return np.asarray(-0.5 * square)

    def _at_scales(self, z: Array, variances: Array) -> Array:
        result = -0.5 * np.log(variances).sum(axis=(0, 1))
        if self.student_t is not None:
            return np.asarray(result + self._heavy((z * z / variances).sum(axis=1)))
        weighted = z / variances
        result -= 0.5 * np.einsum("nik,nik->k", z, weighted)
        if self.by_W is not None:
            B = self.by_W.reshape(-1, 6)
            products = (B[:, :, None] * B[:, None, :]).reshape(-1, 36)
            information = ((1.0 / variances).reshape(len(B), -1).T @ products).reshape(-1, 6, 6)
            pull = (B.T @ weighted.reshape(len(B), -1)).T[..., None]
            L = np.asarray(np.linalg.cholesky(information))
            half = whiten(L, pull)
            result += 0.5 * (half * half).sum(axis=(1, 2)) - np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
        return np.asarray(result)

    def _heavy(self, squares: Array) -> Array:
        """Student-t of squared distances (n, K)."""
        assert self.student_t is not None
        nu = self.student_t
        return np.asarray(-0.5 * (nu + 6.0) * np.log1p(squares / nu).sum(axis=0))


def density_of(
    data: PosePairs | Motions, noise: Noise, scales: ScalePrior | None = None, student_t: float | None = None
) -> Density:
    """The density of one data set; ``student_t`` are the degrees of freedom nu, None is Gaussian.

    Raises what `maximum_likelihood` raises, and `InputError` for a Student-t with noise that is joint over poses.
    """
    noise = noise.dense()
    fit = maximum_likelihood(data, noise)
    if fit.open is not None:
        raise DegenerateMotionError(
            "The motions leave a part of X open, along which its posterior has no end. Close it by a prior of X or W "
            "(--known, --prior-x; `prior_X`, `prior_W` of calibrate()).",
            fit.open_directions[:, :6],
        )
    constraint = constraint_of(data, noise)
    covariances = covariances_of(noise)
    if student_t is not None and any(S is not None and is_joint(S) for S in covariances):
        raise InputError(
            "A Student-t likelihood has one heavy-tailed factor for each pose, which noise that is joint over poses "
            "does not have. Give covariances (6, 6) or (n, 6, 6), or leave out student_t."
        )
    first, second = corrected(fit, noise, constraint.first, constraint.second)
    at_best = constraint.linearise(fit.unknowns, first, second)
    fit = replace(fit, residual=fit.residual - at_best.r)  # D v: what r of the corrected poses leaves of it
    sampled = _scales_of(scales, covariances)
    whitening, share = _together(fit, noise, bool(sampled.sides))
    by_W: Array | None = None
    follow: Array | None = None
    size = 6 if fit.W is None else 12
    prior_of_W = noise.prior is not None and noise.prior.W is not None  # W has then no closed integral
    if fit.W is not None and student_t is None and not prior_of_W:
        by_W = (
            whitening @ -np.broadcast_to(np.eye(6), (len(share), 6, 6))
            if whitening.ndim == 3
            else (whitening @ -np.tile(np.eye(6), (len(share), 1))).reshape(-1, 6, 6)
        )
        by_W = whiten(np.asarray(np.linalg.cholesky(gram(by_W))), by_W.mT).mT  # a basis of W in which gram = I
        follow = fit.covariance[6:, :6] @ np.linalg.inv(fit.covariance_X)
        size = 6
    factor = np.zeros((size + len(sampled.sides),) * 2)
    factor[:size, :size] = np.linalg.cholesky(fit.covariance[:size, :size])
    if sampled.sides:
        shares = np.stack([share, 1.0 - share])[list(sampled.sides)].reshape(len(sampled.sides), -1)
        information = 2.0 * shares @ shares.T + np.diag(sampled.deviations**-2)
        if len(sampled.sides) == 2:  # total and ratio: `_log_scales` at a ratio of 1
            w = float(share.mean())
            to_log_scales = np.array([[1.0, 1.0 - w], [1.0, -w]])
            information = to_log_scales.T @ information @ to_log_scales
        factor[size:, size:] = np.linalg.cholesky(np.linalg.inv(information))
    names = AXES + (tuple(f"W_{axis}" for axis in AXES) if size == 12 else ())
    names += sampled.names(noise.ITEM == "motion")
    return Density(constraint, fit, first, second, whitening, share, by_W, factor, follow, sampled, student_t, names)


def _scales_of(prior: ScalePrior | None, covariances: tuple[Covariance | None, Covariance | None]) -> Scales:
    """The scales of sides that have noise and a prior."""
    if prior is None:
        return Scales((), np.empty(0))
    factors = (prior.robot, prior.camera)
    sides = tuple(k for k in (0, 1) if factors[k] is not None and covariances[k] is not None and covariances[k].any())  # type: ignore[union-attr]
    if not sides:
        raise InputError("Expected ScalePrior to leave the scale of a side free that has noise; that side is exact.")
    return Scales(sides, np.log([float(factors[k]) for k in sides]))  # type: ignore[arg-type]


def _together(fit: Fit, noise: Noise, split: bool) -> tuple[Array, Array]:
    """V and lambda of the module; without a split V is any whitening and lambda 1."""
    L = np.asarray(cholesky_of(fit.S))
    n = len(fit.residual)
    unit = np.broadcast_to(np.eye(6), (n, 6, 6))
    inverse = whiten(L, unit) if L.ndim == 3 else np.asarray(solve_triangular(L, np.eye(len(L)), lower=True))
    if not split:
        return inverse, np.ones((n, 6))
    first = covariances_of(noise)[0]
    if first is None:
        return inverse, np.zeros((n, 6))
    alone = PoseNoise(first) if isinstance(noise, PoseNoise) else PairNoise(np.asarray(first))
    S_1 = np.asarray(residual_covariance(fit.linear.sides, alone))
    if S_1.shape != fit.S.shape:  # only the other side is joint
        S_1 = block_diagonal(S_1)
    part = inverse @ S_1 @ inverse.mT
    values, vectors = np.linalg.eigh(0.5 * (part + part.mT))
    return vectors.mT @ inverse, np.clip(values, 0.0, 1.0).reshape(n, 6)
