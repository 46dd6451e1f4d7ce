"""Proposals of `sample_posterior`: an independence sampler and ensemble moves.

The posterior is nearly Gaussian with a covariance that is known before the first step. A proposal that forgets where
the walker is, drawn from a multivariate Student-t near that Gaussian, is then accepted most of the time, and the chain
forgets in one or two steps what an affine-invariant ensemble move takes 50 steps for. Its Hastings factor is

    log q(y) - log q(y'),   q(y) ~ sum_k w_k / det(L_k) (1 + |L_k^-1 (y - m_k)|^2 / nu)^(-(nu + d)/2)

with m, L L^T and w fixed before the chain that is kept begins. There is one component for each maximum of the density
that was found and has a share in it: heavy tails can leave data that contradict each other with several. A share of the
steps stays with differential evolution and its snooker form (ter Braak and Vrugt 2008), which need no such knowledge: a
posterior that the Student-t misses is then sampled too, only more slowly. `studies.posterior_moves` has the
measurements behind the mix; kernel density moves in place of some of these steps lost more where W is sampled than they
gained elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from emcee.moves import DEMove, DESnookerMove, MHMove, Move
from scipy.linalg import solve_triangular

from ....core.geometry.se3 import Array
from ....core.levels import RARE

LogDensity = Callable[[Array], Array]
# Degrees of freedom of the proposal: heavier tails than the posterior, or a walker far out would stay there.
PROPOSAL_DOF = 8.0


class Proposal(NamedTuple):
    """The mixture of multivariate Student-t of the independence move, one for each of k maxima."""

    location: Array  # (k, d)
    factor: Array  # (k, d, d), lower triangular
    weight: Array  # (k,), of sum 1

    def draw(self, random: np.random.RandomState, count: int) -> Array:
        """(count, d) by a NumPy ``RandomState``."""
        z = random.standard_normal((count, self.location.shape[1]))
        z /= np.sqrt(random.chisquare(PROPOSAL_DOF, count) / PROPOSAL_DOF)[:, None]
        k = np.zeros(count, dtype=int)
        if len(self.weight) > 1:
            k = random.choice(len(self.weight), size=count, p=self.weight)
        return np.asarray(self.location[k] + (self.factor[k] @ z[..., None])[..., 0])

    def log_density(self, y: Array) -> Array:
        """Up to a constant, of (count, d)."""
        parts = [
            np.log(w) - np.log(np.diag(L)).sum() - 0.5 * (PROPOSAL_DOF + len(m)) * np.log1p(squares / PROPOSAL_DOF)
            for m, L, w, squares in zip(self.location, self.factor, self.weight, self.squares(y), strict=True)
        ]
        return parts[0] if len(parts) == 1 else np.asarray(np.logaddexp.reduce(parts, axis=0))

    def squares(self, y: Array) -> list[Array]:
        """Squared distances of (count, d) from each maximum."""
        whitened = (solve_triangular(L, (y - m).T, lower=True) for m, L in zip(self.location, self.factor, strict=True))
        return [np.asarray((z * z).sum(axis=0)) for z in whitened]


def single(location: Array, factor: Array) -> Proposal:
    """A proposal with one maximum (d,), and L (d, d)."""
    return Proposal(location[None], factor[None], np.ones(1))


def moves_of(proposal: Proposal, shares: tuple[float, float, float] = (0.8, 0.16, 0.04)) -> list[tuple[Move, float]]:
    """Return emcee's moves with their shares of the steps: independence, differential evolution, snooker."""

    def propose(y: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        new = proposal.draw(random, len(y))
        return new, proposal.log_density(y) - proposal.log_density(new)

    available = (MHMove(propose, ndim=proposal.location.shape[1]), DEMove(), DESnookerMove())
    return [(move, share) for move, share in zip(available, shares, strict=True) if share > 0]


class Peak(NamedTuple):
    """A maximum (d,) of a density, L of the Gaussian there, and the logarithm of its integral."""

    location: Array
    factor: Array
    log_weight: float


def maximum_of(density: LogDensity, start: Array, *, spacing: float = 0.05, gain: float = 1e-3) -> Peak:
    """Laplace's approximation: the maximum near ``start`` (d,) and the Gaussian there.

    Newton with derivatives by central differences, one batched call per step; where the density is not concave the
    curvature is taken by its size. It need not be exact: a chain corrects what it misses. In whitened coordinates:
    ``spacing`` of the differences, and the smallest gain that is worth another step.
    """
    at, d = start, len(start)
    unit = spacing * np.eye(d)
    i, j = np.triu_indices(d, 1)
    stencil = np.concatenate([np.zeros((1, d)), unit, -unit, unit[i] + unit[j], -unit[i] - unit[j]])
    lengths = 0.5 ** np.arange(8)
    factor, value = np.eye(d), -np.inf
    for _ in range(50):
        value, *rest = density(at + stencil)
        plus, minus = np.array(rest[:d]), np.array(rest[d : 2 * d])
        both, neither = np.array(rest[2 * d : 2 * d + len(i)]), np.array(rest[2 * d + len(i) :])
        gradient = (plus - minus) / (2 * spacing)
        H = np.diag((plus - 2 * value + minus) / spacing**2)
        mixed = (both + neither - plus[i] - minus[i] - plus[j] - minus[j] + 2 * value) / (2 * spacing**2)
        H[i, j] = H[j, i] = mixed
        curvature, axes = np.linalg.eigh(-H)
        curvature = np.clip(np.abs(curvature), 1e-2, None)
        factor = np.asarray(np.linalg.cholesky((axes / curvature) @ axes.T))
        step = axes @ (axes.T @ gradient / curvature)
        tries = density(at + lengths[:, None] * step)
        best = int(np.argmax(tries))
        if not tries[best] > value + gain:
            break
        at = at + lengths[best] * step
    return Peak(at, factor, float(value + np.log(np.diag(factor)).sum()))


def around_maxima(density: LogDensity, starts: Array) -> Proposal:
    """The first proposal, around the maxima that are found from ``starts`` (k, d).

    A maximum is the same as a better one unless it is rare in the Gaussian of that one; those whose share is rare
    against that of the best one are left out.
    """
    peaks = sorted((maximum_of(density, start) for start in starts), key=lambda peak: -peak.log_weight)
    found: list[Peak] = []
    limit = RARE.chi_square(starts.shape[1])
    for peak in peaks:
        apart = all(single(p.location, p.factor).squares(peak.location[None])[0][0] > limit for p in found)
        if apart and peak.log_weight > peaks[0].log_weight + np.log(RARE.probability):
            found.append(peak)
    weight = np.exp([peak.log_weight - peaks[0].log_weight for peak in found])
    location, factor = (np.stack([getattr(peak, name) for peak in found]) for name in ("location", "factor"))
    return Proposal(location, factor, weight / weight.sum())


def fitted(y: Array, before: Proposal) -> Proposal:
    """The proposal with means and covariances of samples (count, d), each counted to the nearest maximum of ``before``.

    A component stays as it was where it has fewer than d (d + 1) samples, twice the numbers of its covariance.
    """
    nearest = np.argmin(before.squares(y), axis=0)
    location, factor = before.location.copy(), before.factor.copy()
    for k in range(len(before.weight)):
        own = y[nearest == k]
        if len(own) < y.shape[1] * (y.shape[1] + 1):
            continue
        try:
            factor[k] = np.linalg.cholesky(np.atleast_2d(np.cov(own.T)))
        except np.linalg.LinAlgError:
            continue
        location[k] = own.mean(axis=0)
    counts = np.bincount(nearest, minlength=len(before.weight)) + 1.0
    return Proposal(location, factor, counts / counts.sum())
