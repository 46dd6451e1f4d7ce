r"""Integration over the sizes: a design of points about each mode, and the mixture of the posteriors at these points.

With f about a mode theta* like ``(theta - theta*)^T I (theta - theta*) / 2``, points ``theta = theta* + I^-1/2 v``
with v from a standard normal distribution have the weights ``exp(f* - f + |v|^2 / 2)``, all alike where f is that
parabola. The v are few and always the same: normal numbers whose mean is 0 and whose second moments are exactly 1, v
and -v in pairs.
(The central composite design of Rue, Martino and Chopin 2009 puts its points ``sqrt(k)`` away, where the square of a
size that the data leave open, ``exp(2 theta)``, is far above its mean.) Each of several modes has its evidence as
weight. The posterior of the unknown poses has the mean and the covariance of the mixture,

    mean = sum w mean_i,      C = sum w (C_i + (mean_i - mean) (mean_i - mean)^T)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from .engine import Conditional, LatentModel
from .mode import REACH_SD, Mode

# The weight of a point is at most this many times that which it would have if the posterior were Gaussian.
MAX_WEIGHT_RATIO = 20.0


@dataclass(frozen=True, eq=False)
class Mixture(ReadOnlyArrays):
    """Posterior of the unknown poses and of the sizes: Gaussians at given sizes, with weights."""

    weights: Array  # (d,), of sum 1
    theta: Array  # (d, k) logarithms of the free sizes
    means: Array  # (d, q) of the unknown poses
    covariances: Array  # (d, q, q)
    odds: Array  # (modes,) probability of each mode
    mode_of: Array  # (d,) number of the mode of each point

    @cached_property
    def mean(self) -> Array:
        """(q,)"""
        return np.asarray(self.weights @ self.means)

    @cached_property
    def covariance(self) -> Array:
        """(q, q)"""
        return self.about(self.mean)

    def about(self, centre: Array) -> Array:
        """(q, q) mean square of the error about another estimate than the mean."""
        off = self.means - centre
        inside = np.tensordot(self.weights, self.covariances, axes=1)
        return np.asarray(inside + (self.weights * off.T) @ off)

    @cached_property
    def mean_theta(self) -> Array:
        """(k,)"""
        return np.asarray(self.weights @ self.theta)

    @cached_property
    def covariance_theta(self) -> Array:
        """(k, k)"""
        off = self.theta - self.mean_theta
        return np.asarray((self.weights * off.T) @ off)

    @cached_property
    def shape(self) -> float:
        """Degrees of freedom nu of the multivariate t with the kurtosis of the first 6 unknowns, X; infinite: Gaussian.

        With M_i the covariances relative to that of the mixture and mu_i the means,
        ``E d^4 = sum w ((tr M_i + |mu_i|^2)^2 + 2 tr M_i^2 + 4 mu_i^T M_i mu_i)``, which is ``q (q + 2) (nu - 2) /
        (nu - 4)`` for a t.
        """
        q = min(6, len(self.mean))
        C = self.covariance[:q, :q]
        unit = 1.0 / np.sqrt(np.diag(C))
        half = np.linalg.inv(np.linalg.cholesky(C * np.outer(unit, unit) + 1e-12 * np.eye(q))) * unit
        M = half @ self.covariances[:, :q, :q] @ half.T
        mu = (self.means[:, :q] - self.mean[:q]) @ half.T
        square = np.einsum("dij,dji->d", M, M)
        fourth = (np.einsum("dii->d", M) + (mu * mu).sum(axis=1)) ** 2 + 2 * square
        fourth = fourth + 4 * np.einsum("di,dij,dj->d", mu, M, mu)
        ratio = float(self.weights @ fourth) / (q * (q + 2))
        return 4.0 + 2.0 / (ratio - 1.0) if ratio > 1.001 else float("inf")


def integrate(model: LatentModel, modes: Sequence[Mode], least: float = 0.01) -> Mixture:
    """Integrate over the sizes about the modes; one of a share below ``least`` is a single point."""
    evidence = np.array([mode.log_evidence for mode in modes])
    odds = np.exp(evidence - evidence.max())
    odds /= odds.sum()
    weights, points, which = [], [], []
    for number, (mode, share) in enumerate(zip(modes, odds.tolist(), strict=True)):
        found, w = _about(model, mode, 0 if share < least else len(mode.theta))
        points += found
        weights.append(share * w)
        which += [number] * len(found)
    w = np.concatenate(weights)
    return Mixture(
        w / w.sum(),
        np.array([point.theta for point in points]).reshape(len(points), -1),
        np.array([point.mean for point in points]),
        np.array([point.covariance for point in points]),
        odds,
        np.array(which),
    )


def _about(model: LatentModel, mode: Mode, k: int) -> tuple[list[Conditional], Array]:
    """Return points in k dimensions about a mode, and their weights; 0: the mode itself."""
    if k == 0:
        return [model.of_poses(mode.theta)], np.ones(1)
    v = design(k)
    L = np.linalg.cholesky(mode.state.information)
    low, high = model.medians - (REACH_SD + 2) * model.spreads, model.medians + (REACH_SD + 2) * model.spreads
    found = model.of_poses_at(np.clip(mode.theta + np.linalg.solve(L.T, v.T).T, low, high))
    logs = mode.state.value - np.array([point.value for point in found]) + 0.5 * (v * v).sum(axis=1)
    w = np.exp(np.minimum(logs, np.log(MAX_WEIGHT_RATIO)))
    return found, w / w.sum()


@cache
def design(k: int, pairs: int = 16) -> Array:
    """Return points (m, k) of a standard normal distribution, mean 0 and second moments 1, each with its opposite.

    There are ``pairs`` of them, or k if that is more.

    >>> v = design(9)
    >>> v.shape, bool(np.allclose(v.T @ v, len(v) * np.eye(9)))
    ((32, 9), True)
    """
    half = max(pairs, k)
    Q = np.linalg.qr(np.random.default_rng(0).normal(size=(half, k)))[0] * np.sqrt(half)
    return np.concatenate([Q, -Q])
