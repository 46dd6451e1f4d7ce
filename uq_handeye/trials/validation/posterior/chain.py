"""Proposals of `sample_posterior`: an independence sampler beside ensemble moves, and the starts.

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

Starts of the search for maxima of a posterior: at the estimate, and at the estimates from parts of the data.

A Gaussian likelihood has one maximum near the estimate of `ml`. With heavy tails data that contradict each other leave
several, each near what those data say that agree.

The HDF5 file of a chain: emcee's own backend, kept as the single piece of a `Run`.

The chain is an ``emcee.backends.HDFBackend`` (group ``mcmc``), which any program that knows emcee reads; it is in the
sampler's whitened coordinates. The group's attributes also hold the proposal and the length of the burn-in that the
chain was begun with. No pickles.

emcee writes at every step, and a process that is killed in the middle of that leaves a file that HDF5 may not open
again. So it writes into an image of the file in memory, which after whole rounds of steps takes the place of the file
in one step of the file system. What is guaranteed: whenever the process ends, also by kill -9, the file is that of the
last writing, complete; the steps since then are lost, and sampled again with the same random numbers.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple, cast

import h5py
import numpy as np
from emcee.backends import Backend, HDFBackend
from scipy.linalg import solve_triangular

from ....core.geometry.se3 import Array, difference
from ....errors import InputError, NotConvergedError
from ....fit.likelihood.gauss_helmert import Fit, efficient
from ....fit.likelihood.robust import robust_fit
from ....model.noise.models import Noise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from .density import Density

LogDensity = Callable[[Array], Array]

# Degrees of freedom of the proposal: heavier tails than the posterior, or a walker far out would stay there.
DOF = 8.0
# Share of steps: independence, differential evolution, snooker.
SHARES = (0.8, 0.16, 0.04)
# Newton steps to the maximum, their longest length and smallest gain worth another, in whitened coordinates.
NEWTON_STEPS, LONGEST, GAIN = 50, 3.0, 1e-3
# Maxima closer than so many deviations are one; what a further one holds beside the best, at least.
SAME, LEAST = 4.0, 1e-4
# Samples per coordinate from which on a component of the proposal is fitted.
FEWEST = 20
# Spacing of the differences that Newton's derivatives are taken by.
SPACING = 0.05


class Proposal(NamedTuple):
    """The mixture of multivariate Student-t of the independence move, one for each of k maxima."""

    location: Array  # (k, d)
    factor: Array  # (k, d, d), lower triangular
    weight: Array  # (k,), of sum 1

    def draw(self, random: Any, count: int) -> Array:
        """(count, d) by a NumPy ``RandomState``."""
        z = random.standard_normal((count, self.location.shape[1]))
        z /= np.sqrt(random.chisquare(DOF, count) / DOF)[:, None]
        k = np.zeros(count, dtype=int)
        if len(self.weight) > 1:
            k = random.choice(len(self.weight), size=count, p=self.weight)
        return np.asarray(self.location[k] + (self.factor[k] @ z[..., None])[..., 0])

    def log_density(self, y: Array) -> Array:
        """Up to a constant, of (count, d)."""
        parts = [
            np.log(w) - np.log(np.diag(L)).sum() - 0.5 * (DOF + len(m)) * np.log1p(squares / DOF)
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


def moves_of(proposal: Proposal, shares: tuple[float, float, float] = SHARES) -> list[tuple[Any, float]]:
    """emcee's moves with their shares of the steps."""
    from emcee import moves

    def propose(y: Array, random: Any) -> tuple[Array, Array]:
        new = proposal.draw(random, len(y))
        return new, proposal.log_density(y) - proposal.log_density(new)

    available = (moves.MHMove(propose, ndim=proposal.location.shape[1]), moves.DEMove(), moves.DESnookerMove())
    return [(move, share) for move, share in zip(available, shares, strict=True) if share > 0]


class Peak(NamedTuple):
    """A maximum (d,) of a density, L of the Gaussian there, and the log of what that Gaussian holds."""

    location: Array
    factor: Array
    log_weight: float


def maximum_of(density: LogDensity, start: Array) -> Peak:
    """Laplace's approximation: the maximum near ``start`` (d,) and the Gaussian there.

    Newton with derivatives by central differences, one batched call per step; where the density is not concave the
    curvature is taken by its size. It need not be exact: a chain corrects what it misses.
    """
    at, d = start, len(start)
    unit = SPACING * np.eye(d)
    i, j = np.triu_indices(d, 1)
    stencil = np.concatenate([np.zeros((1, d)), unit, -unit, unit[i] + unit[j], -unit[i] - unit[j]])
    lengths = 0.5 ** np.arange(8)
    factor, value = np.eye(d), -np.inf
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
    return Peak(at, factor, float(value + np.log(np.diag(factor)).sum()))


def around_maxima(density: LogDensity, starts: Array) -> Proposal:
    """The first proposal, around the maxima that are found from ``starts`` (k, d).

    Those within `SAME` standard deviations of a better one are the same, those with less than `LEAST` of the best one's
    share are left out.
    """
    peaks = sorted((maximum_of(density, start) for start in starts), key=lambda peak: -peak.log_weight)
    found: list[Peak] = []
    for peak in peaks:
        apart = all(single(p.location, p.factor).squares(peak.location[None])[0][0] > SAME**2 for p in found)
        if apart and peak.log_weight > peaks[0].log_weight + np.log(LEAST):
            found.append(peak)
    weight = np.exp([peak.log_weight - peaks[0].log_weight for peak in found])
    location, factor = (np.stack([getattr(peak, name) for peak in found]) for name in ("location", "factor"))
    return Proposal(location, factor, weight / weight.sum())


def fitted(y: Array, before: Proposal) -> Proposal:
    """The proposal with means and covariances of samples (count, d), each counted to the nearest maximum of ``before``.

    A component stays as it was where its samples do not span the space.
    """
    nearest = np.argmin(before.squares(y), axis=0)
    location, factor = before.location.copy(), before.factor.copy()
    for k in range(len(before.weight)):
        own = y[nearest == k]
        if len(own) < FEWEST * y.shape[1]:
            continue
        try:
            factor[k] = np.linalg.cholesky(np.atleast_2d(np.cov(own.T)))
        except np.linalg.LinAlgError:
            continue
        location[k] = own.mean(axis=0)
    counts = np.bincount(nearest, minlength=len(before.weight)) + 1.0
    return Proposal(location, factor, counts / counts.sum())


# Poses or motions that may determine X by themselves.
FEWEST_OF_A_PART = 3


def starts_of(data: PosePairs | Motions, noise: Noise, density: Density) -> Array:
    """Whitened coordinates (k, d): 0, the estimate of `ml`; for heavy tails those of halves and of what agrees too."""
    starts = [np.zeros(density.d)]
    if density.student_t is None:
        return np.stack(starts)
    row, half = np.arange(len(data)), len(data) // 2
    parts = [row[:half], row[half:], row[::2], row[1::2]]
    with suppress(InputError, NotConvergedError):
        robust = robust_fit(data, noise)
        starts.append(_coordinates(robust.fit, density))
        parts.append(np.flatnonzero(robust.weights == 0))  # may agree among themselves
    for part in parts:
        if len(part) >= FEWEST_OF_A_PART:
            with suppress(InputError, NotConvergedError):
                starts.append(_coordinates(efficient(data.rows(part), noise.rows(part)), density))
    at = np.stack(starts)
    return np.asarray(at[np.isfinite(density(at))])


def _coordinates(fit: Fit, density: Density) -> Array:
    """The error of another fit's X and W from the estimate, whitened; scales at 1."""
    both = zip(fit.unknowns, density.fit.unknowns, strict=True)
    errors = [difference(T, origin) for T, origin in both if T is not None and origin is not None]
    size = density.d - len(density.scales.sides)
    y = np.zeros(density.d)
    y[:size] = solve_triangular(density.factor[:size, :size], np.concatenate(errors)[:size], lower=True)
    return y


GROUP = "mcmc"


class Chain(NamedTuple):
    """A chain, and what it was begun with."""

    backend: Backend  # of emcee: steps, walkers, d whitened coordinates; log density; state of the random numbers
    proposal: Proposal
    burn_in: int  # steps before the first one

    @property
    def steps(self) -> int:
        """Length."""
        return int(self.backend.iteration)

    @property
    def y(self) -> Array:
        """(steps, walkers, d) whitened coordinates."""
        return np.asarray(self.backend.get_chain())

    @property
    def log_density(self) -> Array:
        """(steps, walkers)"""
        return np.asarray(self.backend.get_log_prob())


class HeldBackend(HDFBackend):  # type: ignore[misc]
    """emcee's backend, on an image of its file in memory that stays open; `image` is what the file is to hold."""

    def __init__(self, content: bytes = b"") -> None:
        super().__init__(None, name=GROUP)
        self._image = io.BytesIO(content)
        self._file = h5py.File(self._image, "r+" if content else "w")

    @property
    def initialized(self) -> bool:
        return GROUP in self._file

    @contextmanager
    def open(self, mode: str = "r") -> Iterator[Any]:
        yield self._file

    def image(self) -> bytes:
        """The content of the file."""
        self._file.flush()
        return self._image.getvalue()


def content_of(chain: Chain) -> bytes:
    """Return the content of the file of a chain whose backend is a `HeldBackend`."""
    backend: Any = chain.backend
    with backend.open() as file:
        proposal = {f"proposal_{name}": value for name, value in chain.proposal._asdict().items()}
        file[GROUP].attrs.update(proposal | {"burn_in": chain.burn_in})
    return cast(bytes, backend.image())


def chain_of(content: bytes) -> Chain:
    """Return the chain of such a file; raises whatever h5py raises for another."""
    backend = HeldBackend(content)
    with backend.open() as file:
        _require_plain(file[GROUP], len(content))
        attributes = file[GROUP].attrs
        proposal = Proposal(*(np.asarray(attributes[f"proposal_{name}"]) for name in Proposal._fields))
        return Chain(backend, proposal, int(attributes["burn_in"]))


def _require_plain(group: Any, size: int) -> None:
    """Refuse arrays of another type or shape than a chain's, and those that are not all in the file of this size."""
    walkers, d = (int(group.attrs[name]) for name in ("nwalkers", "ndim"))
    shapes = {"chain": (walkers, d), "log_prob": (walkers,), "accepted": ()}
    if sorted(group) != sorted(shapes):
        raise ValueError("unexpected arrays")
    for name, shape in shapes.items():
        array = group[name]
        whole = array.dtype == np.float64 and array.nbytes <= array.id.get_storage_size() <= size
        if not whole or array.shape[1:] != shape or array.id.get_create_plist().get_nfilters():
            raise ValueError(f"unexpected {name}")
    if not len(group["chain"]) == len(group["log_prob"]) >= int(group.attrs["iteration"]) > 0:
        raise ValueError("unexpected number of steps")
