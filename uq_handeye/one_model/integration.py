r"""Sizes integrated over: a composite design about each mode, and the mixture of its posteriors.

With f about a mode theta* like ``(theta - theta*)^T I (theta - theta*) / 2``, ``theta = theta* + I^-1/2 v``, the design
(Rue, Martino and Chopin 2009, section 6.5) has the centre and points v at the distance ``f_0 sqrt(k)``, f_0 = 1.1: two
along each axis of I, which suffices for an integrand that is nearly a sum over the axes. The centre has the weight
``1 - 1 / f_0^2``, each of the m others ``exp(k f_0^2 / 2 - (f - f*)) / (m f_0^2)``: mean and variance of a Gaussian
exactly, and of others by their own density. Of several modes each has its evidence as weight. Posterior of poses and
errors: mean and covariance of the mixture,

    mean = sum w mean_i,      C = sum w (C_i + (mean_i - mean) (mean_i - mean)^T)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..geometry.se3 import Array
from ..runtime.read_only import ReadOnlyArrays
from .engine import Conditional, LatentModel
from .mode import REACH, Mode

RADIUS = 1.1
# No point counts more than so many times what it would count under a Gaussian.
MOST = 20.0


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


def integrate(model: LatentModel, modes: Sequence[Mode]) -> Mixture:
    """Integrate over the sizes about the modes."""
    evidence = np.array([mode.log_evidence for mode in modes])
    odds = np.exp(evidence - evidence.max())
    odds /= odds.sum()
    weights, points, which = [], [], []
    for number, (mode, share) in enumerate(zip(modes, odds.tolist(), strict=True)):
        found, w = _about(model, mode)
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


def _about(model: LatentModel, mode: Mode) -> tuple[list[Conditional], Array]:
    k = len(mode.theta)
    centre = model.of_poses(mode.theta)
    if k == 0:
        return [centre], np.ones(1)
    values, vectors = np.linalg.eigh(mode.state.information)
    moves = RADIUS * np.sqrt(k) * design(k) @ (vectors / np.sqrt(values)).T
    low, high = model.medians - (REACH + 2) * model.spreads, model.medians + (REACH + 2) * model.spreads
    found = [model.of_poses(np.clip(mode.theta + move, low, high)) for move in moves]
    logs = 0.5 * k * RADIUS**2 - (np.array([point.value for point in found]) - mode.state.value)
    each = np.exp(np.minimum(logs, np.log(MOST))) / (len(found) * RADIUS**2)
    w = np.concatenate([[1.0 - 1.0 / RADIUS**2], each])
    return [centre, *found], w / w.sum()


def design(k: int) -> Array:
    """(2k, k) unit vectors: both ends of each axis.

    >>> design(2).shape
    (4, 2)
    """
    return np.concatenate([np.eye(k), -np.eye(k)])
