r"""How `sample_posterior` proposes: an independence sampler beside ensemble moves, and where to start.

The posterior is nearly Gaussian with a covariance that is known before the first step. A proposal that forgets where
the walker is, drawn from a multivariate Student-t near that Gaussian, is then accepted most of the time, and the chain
forgets in one or two steps what an affine-invariant ensemble move takes 50 steps for. Its Hastings factor is

    log q(y) - log q(y'),   q(y) ~ (1 + |L^-1 (y - m)|^2 / nu)^(-(nu + d)/2)

with m and L L^T fixed before the chain that is kept begins. A share of the steps stays with differential evolution and
its snooker form (ter Braak and Vrugt 2008), which need no such knowledge: a posterior that the Student-t misses is then
sampled too, only more slowly. `studies.posterior_moves` has the measurements behind the mix; kernel density moves in
place of some of these steps lost more where W is sampled than they gained elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from ..se3 import Array

LogDensity = Callable[[Array], Array]

# Degrees of freedom of the proposal: heavier tails than the posterior, or a walker far out would stay there.
DOF = 8.0
# Share of steps: independence, differential evolution, snooker.
SHARES = (0.8, 0.16, 0.04)
# Newton steps to the maximum, their longest length and smallest gain worth another, in whitened coordinates.
NEWTON_STEPS, LONGEST, GAIN = 50, 3.0, 1e-3
# Spacing of the differences that Newton's derivatives are taken by.
SPACING = 0.05


class Proposal(NamedTuple):
    """The multivariate Student-t of the independence move."""

    location: Array  # (d,)
    factor: Array  # (d, d), lower triangular

    def draw(self, random: Any, count: int) -> Array:
        """(count, d) by a NumPy ``RandomState``."""
        z = random.standard_normal((count, len(self.location)))
        stretch = np.sqrt(random.chisquare(DOF, count) / DOF)
        return np.asarray(self.location + (z / stretch[:, None]) @ self.factor.T)

    def log_density(self, y: Array) -> Array:
        """Up to a constant, of (count, d)."""
        z = solve_triangular(self.factor, (y - self.location).T, lower=True)
        return np.asarray(-0.5 * (DOF + len(z)) * np.log1p((z * z).sum(axis=0) / DOF))


def moves_of(proposal: Proposal, shares: tuple[float, float, float] = SHARES) -> list[tuple[Any, float]]:
    """emcee's moves with their shares of the steps."""
    from emcee import moves

    def propose(y: Array, random: Any) -> tuple[Array, Array]:
        new = proposal.draw(random, len(y))
        return new, proposal.log_density(y) - proposal.log_density(new)

    available = (
        moves.MHMove(propose, ndim=len(proposal.location)),
        moves.DEMove(),
        moves.DESnookerMove(),
    )
    return [(move, share) for move, share in zip(available, shares, strict=True) if share > 0]


def maximum_of(density: LogDensity, d: int) -> Proposal:
    """Laplace's approximation: the maximum near 0 and the Gaussian there, as the first proposal.

    Newton with derivatives by central differences, one batched call per step; where the density is not concave the
    curvature is taken by its size. It need not be exact: a chain corrects what it misses.
    """
    at = np.zeros(d)
    unit = SPACING * np.eye(d)
    i, j = np.triu_indices(d, 1)
    stencil = np.concatenate([np.zeros((1, d)), unit, -unit, unit[i] + unit[j], -unit[i] - unit[j]])
    lengths = 0.5 ** np.arange(8)
    factor = np.eye(d)
    for _ in range(NEWTON_STEPS):
        value, *rest = density(at + stencil)
        plus, minus = np.array(rest[:d]), np.array(rest[d : 2 * d])
        both, neither = np.array(rest[2 * d : 2 * d + len(i)]), np.array(rest[2 * d + len(i) :])
        gradient = (plus - minus) / (2 * SPACING)
        H = np.diag((plus - 2 * value + minus) / SPACING**2)
        mixed = (both + neither - plus[i] - minus[i] - plus[j] - minus[j] + 2 * value) / (2 * SPACING**2)
        H[i, j] = H[j, i] = mixed
        curvature, axes = np.linalg.eigh(-H)
        curvature = np.clip(np.abs(curvature), 1e-2, None)
        factor = np.asarray(np.linalg.cholesky((axes / curvature) @ axes.T))
        step = axes @ (axes.T @ gradient / curvature)
        step *= min(1.0, LONGEST / max(float(np.linalg.norm(step)), 1e-300))
        tries = density(at + lengths[:, None] * step)
        best = int(np.argmax(tries))
        if not tries[best] > value + GAIN:
            break
        at = at + lengths[best] * step
    return Proposal(at, factor)


def fitted(y: Array, least: Proposal) -> Proposal:
    """The proposal with the mean and covariance of samples (count, d); ``least`` where they do not span the space."""
    covariance = np.atleast_2d(np.cov(y.T))
    try:
        return Proposal(y.mean(axis=0), np.asarray(np.linalg.cholesky(covariance)))
    except np.linalg.LinAlgError:
        return least
