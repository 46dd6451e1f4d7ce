r"""The posterior of a calibration with estimated sizes: a mixture over points of the sizes, computed on first access.

The fit at the mean logarithms of the sizes gives the estimates and P_0, their covariance at these sizes. At each point
theta_d the `LatentModel` has mean and covariance of all unknowns. Those are taken relative to the model's own at the
mean sizes, ``M = L(P_0) L(C_0)^-1``, since the fit weighs poses that the model leaves out or counts whole,

    m_d = M (mean_d - mean_0),      C_d = M Cov_d M^T,      P = sum_d w_d (C_d + m_d m_d^T)

and the block of X and W is brought to the covariance that the calibration states.

New measurements change the posterior of the sizes, and with it the weight of the old rows. With points placed for the
old rows only, X was 0.1 standard deviations off the fit of all data in the median, 0.2 at most. The rows of the model
are therefore kept: new ones, ``r = B s + noise`` with ``s = -(x, e) + (x, e)_0``, are added to them, and sizes and
points are estimated again (`OpenSizes.absorbed`). At the new mean sizes the old posterior is updated by the new rows
with a Kalman update.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from ...core.files.json_values import JsonObject
from ...core.files.records import array_of
from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import CHAIN_ROUNDING
from ...model.errors.cholesky import factor
from ...model.errors.columns import some_rows
from ...model.errors.joint_covariance import JointCovariance, joint_of
from ...model.errors.key import ErrorKey, Kind, Owner
from ...model.errors.keys import INTRINSICS
from ...model.errors.models import Noise
from ...model.errors.sizes import Size
from ...model.errors.term import SIDES, ErrorTerm
from .engine import LatentModel, Rows
from .estimation import FoundSizes
from .integration import integrate
from .mode import find_mode, other_modes
from .posterior import Absorbed, Posterior, SizePoints
from .rows import NewRows, factor_of


@dataclass(frozen=True, eq=False)
class OpenSizes(ReadOnlyArrays):
    """The quantities from which the posterior with estimated sizes is computed; see the module."""

    base: Posterior  # at the mean sizes, its block of X and W as the calibration states it
    of_poses: Array  # (p, p) that block at the mean sizes
    model: LatentModel
    theta: Array  # (d, k)
    weights: Array  # (d,)
    mean_theta: Array  # (k,)
    keys: tuple[ErrorKey, ...]  # (k,) of the errors whose sizes are open
    order: NDArray[np.intp]  # (q,) columns of the model in the order of the errors of `base`
    unit: Array  # (q,) of each, in place of that of the model
    beside: Array  # (p, p) of X and W by errors outside the model, independent of the rest; in `base`
    sides: Array | None = None  # (2, n, 6, 6) by which the errors of robot and of camera were carried to the rows
    used: NDArray[np.intp] | None = None  # (n,) numbers of the poses of the rows

    @cached_property
    def _index(self) -> NDArray[np.intp]:
        """(N,) numbers of the model of the unknowns of the posterior."""
        return np.concatenate([np.arange(self.model.p), self.model.p + self.order])

    @cached_property
    def _sign(self) -> Array:
        """(N,) factors of the numbers of the model, which have the opposite signs, and sizes of 1."""
        return -np.concatenate([np.ones(self.model.p), self.unit])

    def _told(self, theta: Array) -> tuple[Array, Array]:
        of = self.model.conditional(theta)
        index, sign = self._index, self._sign
        return sign * of.mean[index], of.covariance[np.ix_(index, index)] * np.outer(sign, sign)

    @cached_property
    def _carried(self) -> tuple[Array, Array]:
        """The model's own mean at the mean sizes, and M."""
        mean, C = self._told(self.mean_theta)
        P = np.array(self.base.covariance)
        P[: self.model.p, : self.model.p] = self.of_poses
        return mean, _carrying(C, P)

    @cached_property
    def _mixture(self) -> tuple[Array, Array, Array, Array]:
        """Means (d, N), covariances of the model (d, N, N), P, and what brings it to the covariance that is stated."""
        p, (mean, M) = self.model.p, self._carried
        found = [self._told(theta) for theta in self.theta]
        means = np.array([m - mean for m, _ in found]) @ M.T
        covariances = np.array([S for _, S in found])
        P = M @ np.tensordot(self.weights, covariances, axes=1) @ M.T + (self.weights * means.T) @ means
        to_stated = np.eye(len(P))
        to_stated[:p, :p] = _carrying(P[:p, :p], self.base.covariance[:p, :p] - self.beside)
        return means, covariances, P, to_stated

    @cached_property
    def posterior(self) -> Posterior:
        """The mixture."""
        p = self.model.p
        means, covariances, P, to_stated = self._mixture
        P = to_stated @ P @ to_stated.T
        P[:p, :p] = self.base.covariance[:p, :p]
        back = solve_triangular(factor_of(P), np.eye(len(P)), lower=True)
        whole = back @ to_stated @ self._carried[1]
        means, each = means @ to_stated.T, whole @ covariances @ whole.T + back[:, :p] @ self.beside @ back[:, :p].T
        points = SizePoints(self.keys, self.theta, self.weights, means @ back.T, 0.5 * (each + each.mT))
        return replace(self.base, covariance=0.5 * (P + P.T), points=points, source=self)

    @cached_property
    def without_beside(self) -> Posterior:
        """The posterior of what the model holds alone."""
        P = np.array(self.base.covariance)
        P[: self.model.p, : self.model.p] -= self.beside
        base = replace(self.base, covariance=P)
        return replace(self, base=base, beside=np.zeros_like(self.beside)).posterior

    def at(self, theta: Array, weights: Array) -> OpenSizes:
        """The same at other points (d, k) of the sizes."""
        return replace(self, theta=theta, weights=weights)

    def absorbed(self, new: NewRows) -> Absorbed:
        """Take measurements against `posterior` in; see the module."""
        by_state, more = new.by_errors, new.by_unit[..., len(self._index) :]
        model = self._with(new, by_state, more)
        mode = find_mode(model, self.mean_theta)
        mixture = integrate(model, [mode, *other_modes(model, mode)])
        sizes = model.sizes(mixture.mean_theta)
        of = {part.key: sizes[k] for k, part in enumerate(model.components)}
        mean, M = self._carried
        at, C = self._told(mixture.mean_theta)
        at, L = M @ (at - mean), factor_of(M @ C @ M.T)
        told = NewRows(
            new.r - by_state @ at, np.concatenate([by_state @ L, more], axis=-1), new.own_of(of), _Gaussian(L)
        ).absorbed()
        p, move = model.p, at + told.mean
        fresh = tuple(
            replace(one, size=replace(one.size, median=float(of.get(one.key, one.size.median))))
            for one in self.base.noise
        )
        base = replace(self.base, estimate=self.base.estimate + move[p:], covariance=told.covariance, noise=fresh)
        after = replace(
            self, base=base, of_poses=told.covariance[:p, :p], model=model, theta=mixture.theta,
            weights=mixture.weights, mean_theta=mixture.mean_theta,
        )  # fmt: skip
        to_stated = self._mixture[3] @ after._mixture[2] @ self._mixture[3].T
        stated = told.covariance.copy()
        stated[:p, :p] = to_stated[:p, :p] + self.beside
        return Absorbed(replace(after, base=replace(base, covariance=stated)).posterior, move)

    def _number(self, key: ErrorKey) -> int:
        return next(k for k, part in enumerate(self.model.components) if part.key == key)

    def _with(self, new: NewRows, by_state: Array, more: Array) -> LatentModel:
        """The model with new rows; what they share by themselves (m, k, z) is a component of known size."""
        old, (m, k), z, p = self.model, new.r.shape, more.shape[-1], self.model.p
        u = old.conditional(self.mean_theta).mean
        shared = np.zeros((m, k, len(u) - p + z))
        shared[..., self.order], shared[..., len(u) - p :] = by_state[..., p:] * self.unit, more
        J = by_state[..., :p]
        blocks = {self._number(key): S for key, S in new.parts}
        r = new.r - np.concatenate([J, shared[..., : len(u) - p]], axis=-1) @ u
        rows = Rows(J, r, shared, blocks, new.own_of(dict.fromkeys((key for key, _ in new.parts), 0.0)))
        wider = [
            of._replace(shared=np.concatenate([of.shared, np.zeros((*of.shared.shape[:2], z))], axis=-1))
            for of in old.groups
        ]
        of_new = ErrorKey(Owner.ROBOT, Kind.NEW)
        own = (ErrorTerm(of_new, "robot", Size(1.0), np.zeros((0, 6, z))),) if z else ()
        components = (*old.components, *own)
        return replace(old, shared=wider[0].shared, components=components, others=(*wider[1:], rows))

    # ------------------------------------------------------------------------------------------- file

    def to_dict(self) -> JsonObject:
        """Plain numbers and text: the posterior at the mean sizes, and the model whose sizes are open."""
        components = [
            [
                part.key.to_dict(),
                part.side,
                part.size.median,
                part.size.factor,
                part.size.unit,
                part.size.source,
                part.count,
            ]
            for part in self.model.components
        ]
        prior = {} if self.model.prior is None else {"prior": self.model.prior.tolist()}
        rows = [
            {"J": of.J.tolist(), "r": of.r.tolist(), "shared": of.shared.tolist(),
             "noise": [[k, S.tolist()] for k, S in of.blocks.items()],
             "known": None if of.known is None else of.known.tolist()}
            for of in self.model.groups
        ]  # fmt: skip
        arrays = {name: getattr(self, name).tolist() for name in _ARRAYS}
        carried: JsonObject = {}
        if self.sides is not None and self.used is not None:
            carried = {"sides": self.sides.tolist(), "used": self.used.tolist()}
        return self.base.to_dict() | {"open": {"components": components, "rows": rows, **prior, **arrays, **carried}}

    def _carried_from(self, noise: Noise) -> Array | None:
        """Return the columns of the rows (n, 6, m) by those that the noise of the poses holds at the mean sizes.

        None where the noise does not hold them.
        """
        if self.sides is None or self.used is None:
            return None
        at, of_side = 0, dict.fromkeys(SIDES, 0)
        found = np.zeros((*self.sides.shape[1:3], len(self.model.shared[0, 0])))
        for part, size in zip(self.model.components, self.model.sizes(self.mean_theta).tolist(), strict=True):
            if not part.count:
                continue
            S, first = joint_of(noise.sides[part.side]), of_side[part.side]
            last = first + part.count
            if S is None or size == 0 or S.columns.shape[-1] < last or S.n <= self.used.max():
                return None
            D = self.sides[SIDES.index(part.side)]
            columns = some_rows(S.some(range(first, last)), self.used)
            found[..., at : at + part.count] = D @ columns / size
            at, of_side[part.side] = at + part.count, last
        return found

    def with_columns_of(self, noise: Noise) -> OpenSizes:
        """Return it with the columns of its rows made of those of the noise, which a file then holds once."""
        columns, shared = self._carried_from(noise), self.model.shared
        if columns is None or not np.allclose(columns, shared, 0.0, CHAIN_ROUNDING * np.abs(shared).max(initial=0.0)):
            return self
        return replace(self, model=replace(self.model, shared=columns))

    def beside_noise(self, noise: Noise | None) -> JsonObject:
        """Plain numbers and text as `to_dict`, without the columns of rows that ``noise`` in the same file holds."""
        found: dict[str, Any] = {**self.to_dict()}
        columns = None if noise is None else self._carried_from(noise)
        if columns is not None and np.array_equal(columns, self.model.shared):
            del found["open"]["rows"][0]["shared"]
        return found

    @classmethod
    def from_dict(cls, data: dict[str, Any], noise: Noise | None = None) -> OpenSizes:
        """The inverse of `to_dict`; ``noise`` of the poses, from which columns are taken that the rows lack."""
        given, base = data["open"], Posterior.from_dict(data)
        components = tuple(
            ErrorTerm(ErrorKey.from_dict(key), side, Size(median, factor, unit, source), np.zeros((0, 6, count)))
            for key, side, median, factor, unit, source, count in given["components"]
        )
        p, m = base.p, sum(part.count for part in components)
        k, d, q = sum(not part.size.is_known for part in components), len(given["weights"]), len(base.keys)
        rows = [_rows_of(of, p, m, len(components)) for of in given["rows"]]
        lacks = "shared" not in given["rows"][0]
        prior = None if given.get("prior") is None else array_of(given["prior"], (p + 1, p + 1), "posterior.prior")
        first = rows[0]
        model = LatentModel(
            first.J, first.r, components, first.shared, first.blocks, first.known, prior, tuple(rows[1:])
        )
        given.setdefault("beside", np.zeros((p, p)).tolist())
        shapes = {
            "of_poses": (p, p),
            "beside": (p, p),
            "theta": (d, k),
            "weights": (d,),
            "mean_theta": (k,),
            "order": (q,),
            "unit": (q,),
        }
        found: dict[str, Any] = {name: array_of(given[name], shapes[name], f"posterior.{name}") for name in _ARRAYS}
        found["order"] = found["order"].astype(np.intp)
        if not (found["weights"] >= 0).all() or not np.isclose(found["weights"].sum(), 1.0):
            raise ValueError("the weights of the posterior are no probabilities")
        if given.get("sides") is not None:
            n = len(given["used"])
            found["sides"] = array_of(given["sides"], (2, n, 6, 6), "posterior.sides")
            found["used"] = array_of(given["used"], (n,), "posterior.used").astype(np.intp)
        result = cls(base, model=model, keys=tuple(components[k].key for k in model.free), **found)
        if lacks:
            columns = None if noise is None else result._carried_from(noise)
            if columns is None or columns.shape != first.shared.shape:
                raise ValueError("the noise lacks the columns of the posterior")
            result = replace(result, model=replace(model, shared=columns))
        with np.errstate(all="ignore"):
            try:
                parts = result.posterior.covariance, *result._mixture
            except np.linalg.LinAlgError as error:
                raise ValueError("the rows of the posterior leave numbers open") from error
        if not all(np.isfinite(part).all() for part in parts):
            raise ValueError("the rows of the posterior make no covariance")
        return result


_ARRAYS = ("of_poses", "theta", "weights", "mean_theta", "order", "unit", "beside")


class _Gaussian(NamedTuple):
    """A posterior at given sizes, by the factor of its covariance (`graph.rows.Joint`)."""

    A: Array
    points: None = None
    noise: tuple[ErrorTerm, ...] = ()

    @property
    def covariance(self) -> Array:
        return np.asarray(self.A @ self.A.T)


def _rows_of(data: dict[str, Any], p: int, m: int, components: int) -> Rows:
    n, d = len(data["r"]), len(data["r"][0])
    J, r = (array_of(data[name], shape, f"posterior.{name}") for name, shape in (("J", (n, d, p)), ("r", (n, d))))
    shared = array_of(data["shared"], (n, d, m), "posterior.shared") if "shared" in data else np.zeros((n, d, m))
    blocks = {int(k): array_of(S, (n, d, d), "posterior.noise") for k, S in data["noise"]}
    if not blocks.keys() <= set(range(components)):
        raise ValueError("the noise of the posterior is of no component")
    return Rows(J, r, shared, blocks, None if data["known"] is None else array_of(data["known"], (n, d, d), "known"))


def with_open_sizes(
    base: Posterior, of_poses: Array, beside: Array, found: FoundSizes, noise: Noise
) -> Posterior | OpenSizes:
    """Return the posterior over the sizes that were found; ``of_poses`` (12, 12) is the block of X and W at their mean.

    ``noise`` of the poses has these sizes. ``base`` is the posterior at them, with ``beside`` (12, 12), by errors
    outside the model, in that block.
    """
    model, mixture, source = found.model, found.mixture, found.source
    base = replace(base, noise=_noise_of_new_poses(found))
    free = [source.components[k].key for k in model.free]
    if not free or found.reduced.basis is not None or model.p != base.p:
        return base
    settled = model.sizes(mixture.mean_theta)
    sd = {key: float(s) for error in found.errors for key, s in zip(error.keys, error.sd, strict=True)}
    place: dict[ErrorKey, tuple[int, float]] = {}
    column = {"robot": 0, "camera": 0}  # numbers of the columns of a side, by which intrinsics are named
    at = 0
    for k, part in enumerate(source.components):
        for key in part.keys:
            if part.side == "camera" and key == INTRINSICS:
                key = INTRINSICS.number(column[part.side])
            place[key] = at, sd.get(key, 1.0) / float(settled[k])
            column[part.side] += 1
            at += 1
    if not set(base.keys) <= place.keys():
        return base
    order = np.array([place[key][0] for key in base.keys], dtype=np.intp)
    unit = np.array([place[key][1] for key in base.keys])
    constraint = source.constraint.rows(found.used)
    linear = constraint.linearise(found.at, constraint.first, constraint.second)
    sides = np.stack([np.broadcast_to(D, (len(found.used), 6, 6)) for D in linear.sides])
    return OpenSizes(
        base, of_poses, model, mixture.theta, mixture.weights, mixture.mean_theta, tuple(free), order, unit,
        beside, sides, found.used,
    ).with_columns_of(noise)  # fmt: skip


def _noise_of_new_poses(found: FoundSizes) -> tuple[ErrorTerm, ...]:
    """Return what is drawn again at new poses, with the sizes that were found, at the mean over the poses so far."""
    source, sizes = found.source, found.model.sizes(found.mixture.mean_theta).tolist()
    known = {side: S for side in SIDES if (S := source.known.get(side)) is not None and S.any()}
    given = [ErrorTerm.given(side, _mean(S)) for side, S in known.items()]
    drawn = [
        ErrorTerm(part.key, part.side, Size(size, unit=part.size.unit), block=_usual(part.block))
        for part, size in zip(source.components, sizes, strict=True)
        if part.block is not None
    ]
    return (*given, *drawn)


def _usual(block: Array) -> Array:
    """(6, b) block at a usual pose of (6, b) or (n, 6, b): of the mean covariance."""
    return block if block.ndim == 2 else factor(_mean(block @ block.mT))


def _mean(S: Array | JointCovariance) -> Array:
    own = S.own if isinstance(S, JointCovariance) else np.asarray(S)
    return np.asarray(own.reshape(-1, 6, 6).mean(axis=0))


def _carrying(C: Array, P: Array) -> Array:
    """M with ``M C M^T = P``, near 1 where they are alike."""
    L = factor_of(C)
    return np.asarray(solve_triangular(L, factor_of(P).T, lower=True, trans="T").T)
