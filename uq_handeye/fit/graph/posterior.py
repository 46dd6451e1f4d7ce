r"""The joint posterior of unknown poses and of every error that measurements share.

The errors of the estimates are ``s = (xi_1, ..., xi_b, e - estimate)``: xi of each unknown pose (6 numbers ``(theta,
tau)``, left rotation in rad, additive translation in m, estimate minus truth), e the errors in their units (rad, m, or
relative). For given sizes of the errors s is Gaussian; sizes that the data leave open are points theta_d with weights
w_d (`graph.integration`), and s is a mixture,

    s | theta_d  ~  N(m_d, C_d),        P = sum_d w_d (C_d + m_d m_d^T) = L L^T

P is `covariance`, the mean square about the estimate. m_d and C_d are kept relative to it, ``L^-1 m_d`` and
``L^-1 C_d L^-T``, so that they stay with the posterior when it is refined. Where sizes are known there is one point.

Noise of new measurements is independent: the covariance of its block at a pose times the square of its size, at each
point of the sizes where that is open. Errors whose columns belong to poses (an unknown arm, the view) are computed at
other poses from the poses that they were bound to, which are kept as well (`bound`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.files.json_values import Json, JsonObject
from ...core.files.records import array_of
from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError
from ...model.errors.key import ErrorKey
from ...model.errors.sizes import Size
from ...model.errors.term import ErrorTerm
from .rows import NewRows, Test, factor_of
from .selection import Selection, covariance_of, select


class SizePoints(NamedTuple):
    """Points of the open sizes, with the Gaussian of each relative to the posterior; see the module."""

    keys: tuple[ErrorKey, ...]  # (k,) of the errors whose sizes are open
    theta: Array  # (d, k) their logarithms
    weights: Array  # (d,), of sum 1
    means: Array  # (d, N) L^-1 m_d
    covariances: Array  # (d, N, N) L^-1 C_d L^-T

    def sizes_of(self, key: ErrorKey) -> Array:
        """(d,) sizes at the points of an error whose size is open."""
        return np.asarray(np.exp(self.theta[:, self.keys.index(key)]))


class OpenSource(Protocol):
    """Interface of the rows of a posterior with open sizes (`graph.points.OpenSizes`)."""

    @property
    def posterior(self) -> Posterior: ...
    @property
    def without_beside(self) -> Posterior: ...
    def absorbed(self, new: NewRows) -> Absorbed: ...
    def at(self, theta: Array, weights: Array) -> OpenSource: ...
    def to_dict(self) -> JsonObject: ...


@dataclass(frozen=True, eq=False)
class Posterior(ReadOnlyArrays):
    """Unknown poses and the q errors that measurements share, together; see the module."""

    keys: tuple[ErrorKey, ...]  # (q,) of the errors
    estimate: Array  # (q,)
    covariance: Array  # (N, N), N = 6 b + q
    blocks: tuple[str, ...] = ("X", "W")
    points: SizePoints | None = None
    noise: tuple[ErrorTerm, ...] = ()  # drawn anew at each new pose, at a usual one, with the sizes found
    bound: tuple[Array, Array] | None = None  # robot and camera poses (n, 4, 4) that errors of poses were bound to
    times: Array | None = None  # (n,) s, of these poses
    source: OpenSource | None = field(default=None, repr=False)  # the rows that it is made of, where sizes are open

    @property
    def names(self) -> tuple[str, ...]:
        """(q,) the errors in words."""
        return tuple(map(str, self.keys))

    @property
    def p(self) -> int:
        """Number of unknowns of the poses."""
        return 6 * len(self.blocks)

    @cached_property
    def A(self) -> Array:
        """(N, N) L with ``covariance = L L^T``."""
        return factor_of(self.covariance)

    @cached_property
    def mean(self) -> Array:
        """(N,) of the errors s over the sizes: what the estimate differs by from the mean of the mixture."""
        return np.zeros(len(self.covariance)) if self.points is None else self.A @ (
            self.points.weights @ self.points.means
        )  # fmt: skip

    def block(self, name: str) -> slice:
        """Return the place of an unknown pose in s; raises `InputError` for one that is none."""
        if name not in self.blocks:
            raise InputError(f"Expected an unknown pose out of {', '.join(self.blocks)}, got {name!r}.")
        k = 6 * self.blocks.index(name)
        return slice(k, k + 6)

    def covariance_of(self, name: str) -> Array:
        """(6, 6) of one unknown pose."""
        return self.covariance[self.block(name), self.block(name)]

    def mixture_of(self, *names: str) -> tuple[Array, Array, Array]:
        """Weights (d,), means (d, p) and covariances (d, p, p) of the errors of unknown poses at each point."""
        A = np.concatenate([self.A[self.block(name)] for name in names])
        if self.points is None:
            return np.ones(1), np.zeros((1, len(A))), (A @ A.T)[None]
        return self.points.weights, self.points.means @ A.T, A @ self.points.covariances @ A.T

    @cached_property
    def numbers(self) -> dict[ErrorKey, tuple[int, ...]]:
        """Numbers (among the q, counted from 0) of each error (`ErrorKey.source`), in the order of the first ones."""
        found: dict[ErrorKey, list[int]] = {}
        for k, key in enumerate(self.keys):
            found.setdefault(key.source, []).append(k)
        return {key: tuple(of) for key, of in found.items()}

    @cached_property
    def place(self) -> dict[ErrorKey, int]:
        """Number (among the q) of each number of an error."""
        return {key: k for k, key in enumerate(self.keys)}

    def owned_by(self, owners: Collection[str]) -> NDArray[np.intp]:
        """Numbers (among the q) of the errors of some owners."""
        return np.array([k for k, key in enumerate(self.keys) if key.owner in owners], dtype=np.intp)

    # ------------------------------------------------------------------------------------------- predictions and tests

    def predict(self, functions: ArrayLike, noise: Array | None = None) -> Array:
        """Covariance (..., k, k) of linear functions (..., k, N) of s, with noise (..., k, k) of their own."""
        F = np.asarray(functions, dtype=float)
        if F.ndim < 2 or F.shape[-1] != len(self.covariance):
            raise InputError(f"Expected functions (..., k, {len(self.covariance)}) of the posterior, got {F.shape}.")
        S = F @ self.covariance @ F.mT
        S = S if noise is None else S + noise
        return np.asarray(0.5 * (S + S.mT))

    def test(self, rows: NewRows) -> Test:
        """Test new measurements against the posterior, as a whole."""
        return rows.test

    def absorb(self, rows: NewRows) -> Absorbed:
        """Take measurements in: the posterior after them, and the move of the estimates."""
        if rows.posterior is not self:
            raise InputError("Expected measurements that were held against this posterior.")
        if self.source is not None:
            return self.source.absorbed(rows)
        move, covariance = rows.absorbed()
        return Absorbed(replace(self, estimate=self.estimate + move[self.p :], covariance=covariance), move)

    def choose(self, candidates: Array, k: int, Q: Array | None = None, *, repeat: bool = False) -> Selection:
        """The k of m measurements that tell most, by their rows (m, 6, N) whitened by their noise.

        ``Q`` (r, r) weighs the first r unknowns, ``tr(Q P)``; None: the volume of the first pose.
        """
        some = np.flatnonzero(np.diag(self.covariance) > 0)
        Q = Q if Q is None else Q[np.ix_(*[some[some < len(Q)]] * 2)]
        found = select(covariance_of(self.covariance[np.ix_(some, some)]), candidates[..., some], k, Q, repeat)
        whole = np.zeros((len(found.covariances), *self.covariance.shape))
        whole[:, some[:, None], some] = found.covariances
        return found._replace(covariances=whole)

    # ------------------------------------------------------------------------------------------- file

    def to_dict(self) -> JsonObject:
        """Plain numbers and text."""
        if self.source is not None:
            return self.source.to_dict()
        more: JsonObject = {} if self.blocks == ("X", "W") else {"blocks": list(self.blocks)}
        if self.noise:
            more["noise"] = list(map(_noise_to_dict, self.noise))
        if self.bound is not None:
            more["bound"] = [poses[:, :3].tolist() for poses in self.bound]
        if self.times is not None:
            more["times"] = self.times.tolist()
        covariance = self.covariance.tolist()
        return {
            "keys": [key.to_dict() for key in self.keys],
            "estimate": self.estimate.tolist(),
            "covariance": covariance,
        } | more

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Posterior:
        """Read what `to_dict` wrote; raises KeyError and ValueError where it is damaged."""
        q, blocks = len(data["keys"]), tuple(map(str, data.get("blocks", ("X", "W"))))
        N = 6 * len(blocks) + q
        covariance = array_of(data["covariance"], (N, N), "posterior.covariance")
        if (np.diag(covariance) < 0).any():
            raise ValueError("the posterior has a variance below 0")
        noise = tuple(map(_noise_from_dict, data.get("noise", ())))
        bound, times = None, None
        if data.get("bound") is not None:
            robot, camera = (_poses(part) for part in data["bound"])
            if len(robot) != len(camera):
                raise ValueError("the poses of the posterior are not pairs")
            bound = robot, camera
            if data.get("times") is not None:
                times = array_of(data["times"], (len(robot),), "posterior.times")
        estimate = array_of(data["estimate"], (q,), "posterior.estimate")
        return cls(
            tuple(map(ErrorKey.from_dict, data["keys"])),
            estimate,
            covariance,
            blocks,
            noise=noise,
            bound=bound,
            times=times,
        )


class Absorbed(NamedTuple):
    """A posterior that has taken measurements in."""

    posterior: Posterior
    move: Array  # (N,) of s: the new estimate of a pose is the old one less its move, of an error the old one plus it


def _noise_to_dict(noise: ErrorTerm) -> JsonObject:
    assert noise.block is not None
    size = {"size": noise.size.median, "unit": noise.size.unit}
    return {"key": noise.key.to_dict(), "side": noise.side, **size, "block": noise.block.tolist()}


def _noise_from_dict(data: dict[str, Any]) -> ErrorTerm:
    block = array_of(data["block"], (6, len(data["block"][0])), "posterior.noise.block")
    size = Size(float(data["size"]), unit=str(data["unit"]))
    return ErrorTerm(ErrorKey.from_dict(data["key"]), data["side"], size, block=block)


def _poses(rows: Sequence[Json]) -> Array:
    given = array_of(rows, (len(rows), 3, 4), "posterior.bound")
    return np.concatenate([given, np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(given), 1, 4))], axis=1)
