r"""Noise and kinematic errors of an arm whose joints are known: standard deviations from the residuals (theory T13).

Model: the error of robot pose i is ``J_i n_i + eta_i - F_i e``: noise n of the joints and eta of the pose, drawn for
each pose, and the errors e of the kinematics, drawn once (`kinematics.kinematic_errors`). The standard deviations of n
and eta, of the camera poses where they are not known, and of each group of e maximise the restricted likelihood
(`scale_rows`) times what is known of them beforehand:

- groups of e: that of the population is the least; above it the logarithm is Gaussian with ``log(factor)``, one side
  of it. A set of poses from one region sees next to nothing of e, and the likelihood alone would have it near 0.
- joint noise: log-normal about that of the population; or given.
- pose noise of robot and camera: as in `estimate` and `beside_camera`.

What remains open of the standard deviation s of a group is integrated: its errors count with ``E(s^2)`` over its
posterior, with the other standard deviations at their best values.

Beside camera poses whose own covariance is known, eta is isotropic with one standard deviation for rotation and one for
translation; where the camera's noise is estimated, eta has a standard deviation of its own only if a data sheet gives
one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..errors import InputError, NotConvergedError
from ..findings import Finding
from ..geometry.se3 import Array
from ..kinematics.errors import LENGTHS
from ..kinematics.kinematic_errors import (
    DECLARED,
    DECLARED_AS,
    JOINT_NOISE,
    JOINT_NOISE_FACTOR,
    USUAL,
    KinematicColumns,
)
from ..likelihood.constraint import Constraint, Unknowns
from ..likelihood.reduced_rows import Reduced, reduce_rows
from ..noise.camera_noise import CameraNoise
from ..noise.estimate import Component, NoiseEstimate, NoisePrior
from ..noise.joint_covariance import JointCovariance
from ..noise.models import PoseNoise, is_joint, marginals, rows_of
from ..noise.pose_prior import PosePrior
from ..shared_errors.kinematic_errors import errors_of_arm, kinematic_covariance
from ..shared_errors.shared_error import SharedError, add_columns, with_shared
from .beside_camera import MOST_ROUNDS, PIXEL, PIXEL_FACTOR, STILL
from .components_beside_camera import PIXEL_KIND
from .scale_rows import OwnPart, ScaleRows

PIXELS = PIXEL_KIND[0]
# Deviations are looked for from this share of the residuals, below which they are 0, to this multiple.
LEAST, MOST = 1e-3, 30.0
# Of groups, in units of the least: no arm that was measured has more than 6.
MOST_OF_GROUP = 10.0
# Nodes of the integral over the deviation of a group, and how many deviations of its prior it reaches.
NODES, REACH = 16, 3.5
# Of differences of the gradient.
STEP = 1e-4


class Deviation(NamedTuple):
    """One unknown standard deviation s: log s is Gaussian about ``mean``, or ``mean`` is the least (``floor``)."""

    name: str
    unit: str
    mean: float  # log of rad, m or pixels; NaN where nothing is known
    sd: float  # of log s; infinite where nothing is known, 0 where s is given
    floor: bool = False


@dataclass(frozen=True, eq=False)
class BesideKinematics:
    """The standard deviations of one data set; see the module."""

    constraint: Constraint
    kinematics: KinematicColumns
    camera: Any  # covariance, CameraNoise, or None: to be estimated
    robot: Any  # covariance beside joint noise and kinematic errors, where it is known
    prior: NoisePrior
    columns: Mapping[str, JointCovariance] = field(default_factory=dict)  # other errors that poses of a side share
    pose_prior: PosePrior | None = None

    def __post_init__(self) -> None:
        for name in ("camera", "robot"):
            if (
                not isinstance(S := getattr(self, name), CameraNoise | JointCovariance)
                and S is not None
                and is_joint(S)
            ):
                raise InputError(
                    f"Expected the covariance `{name}` beside kinematic errors to be (6, 6), (n, 6, 6) or a "
                    "JointCovariance, got a joint array."
                )

    @cached_property
    def deviations(self) -> tuple[Deviation, ...]:
        """Standard deviations that the model has, in the order of the parameters: own noise, then groups."""
        given, found = self.kinematics.given, []
        population, values, factor = given.population, self.prior.values, self.prior.factor
        if isinstance(self.camera, CameraNoise) and self.camera.pixel_sd is None:
            found.append(Deviation(PIXELS, "px", np.log(PIXEL), np.log(PIXEL_FACTOR)))
        for side, known, start in (("robot", self.robot, 0), ("camera", self.camera, 2)):
            of_side = values[start : start + 2]
            if known is not None or (side == "robot" and self.camera is None and np.isnan(of_side).all()):
                continue
            for what, unit, value in zip(("rotation", "translation"), ("rad", "m"), of_side.tolist(), strict=True):
                if not np.isnan(value) and not value > 0:
                    continue
                sd = np.inf if np.isnan(value) else float(np.log(factor))
                found.append(Deviation(f"{side} {what}", unit, float(np.log(value)), sd))
        joint_sd = given.joint_sd
        if joint_sd is None:
            found.append(Deviation(JOINT_NOISE, "rad", np.log(population.joint_sd), np.log(JOINT_NOISE_FACTOR)))
        elif float(joint_sd) > 0:
            found.append(Deviation(JOINT_NOISE, "rad", float(np.log(float(joint_sd))), 0.0))
        spread = 0.0 if given.how == DECLARED else float(np.log(population.factor))
        for group, sd in given.standard_deviations.items():
            if group in self.kinematics.groups:
                found.append(Deviation(group, "m" if group == LENGTHS else "rad", float(np.log(sd)), spread, True))
        return tuple(found)

    def find(self, at: Unknowns, weights: Array | None = None) -> FoundKinematics:
        """The standard deviations near the unknowns; ``weights`` (n,) of 0 leave poses out.

        Raises `InputError`, `DegenerateMotionError` and `NotConvergedError` as `estimate_noise`.
        """
        kept = np.arange(self.constraint.n) if weights is None else np.flatnonzero(weights)
        if weights is not None and (weights[kept] < 1).any():
            raise InputError("Expected `weights` of 0 or 1 beside kinematic errors, got others.")
        if 6 * len(kept) - 12 <= 0:
            raise InputError(f"Expected residuals to estimate the noise from, got {len(kept)} poses. Give more poses.")
        constraint = self.constraint if len(kept) == self.constraint.n else self.constraint.rows(kept)
        x: Array | None = None
        for done in range(MOST_ROUNDS):
            rows, reduced = self._rows(constraint, at, kept)
            search = Search.of(rows, self.deviations)
            x = search.minimum(search.start if x is None else x)
            found = rows.at(x)
            step = found.unknowns
            moved = float(step @ np.linalg.solve(found.covariance[: rows.p, : rows.p], step))
            if moved < STILL**2 and done > 0:
                return FoundKinematics(self, search, x, len(kept))
            at = at.moved(reduced.unreduced(-step))
        raise NotConvergedError(
            "Noise estimation did not converge: the residuals are too large for a linear model. Look at the setup, at "
            "the pairing of the poses, at the order and units of the joints and for outliers.",
            found,
        )

    def _rows(self, constraint: Constraint, at: Unknowns, kept: NDArray[np.intp]) -> tuple[ScaleRows, Reduced]:
        linear = constraint.linearise(at, constraint.first, constraint.second)
        reduced = reduce_rows(constraint, linear, at, None, self.pose_prior)
        robot, camera = linear.sides
        index = {deviation.name: k for k, deviation in enumerate(self.deviations)}
        kinematics = self.kinematics.rows(kept)
        own = [
            OwnPart(index[f"{side} {what}"], D[..., part])
            for side, D in (("robot", robot), ("camera", camera))
            for what, part in (("rotation", slice(0, 3)), ("translation", slice(3, 6)))
            if f"{side} {what}" in index
        ]
        if JOINT_NOISE in index:
            own.append(OwnPart(index[JOINT_NOISE], robot @ kinematics.J))
        B, group = [robot @ kinematics.F], [np.array([index[name] for name in kinematics.groups], dtype=np.intp)]
        known: Array | None = None
        for side, D in (("robot", robot), ("camera", camera)):
            S = getattr(self, side)
            if isinstance(S, CameraNoise):
                S = S.rows(kept)
                if S.pixel_sd is None:
                    each, scaled = S.scaled()
                    own.append(OwnPart(index[PIXELS], D @ np.linalg.cholesky(each)))
                    B += [D @ scaled, D @ S.fixed()]
                    group += [np.full(scaled.shape[-1], index[PIXELS]), np.full(S.fixed().shape[-1], -1)]
                    S = None
                else:
                    S = S.covariance()
            elif S is not None:
                S = rows_of(S, kept)
            S = add_columns(S, self.columns[side].rows(kept)) if side in self.columns else S
            if isinstance(S, JointCovariance):
                B.append(D @ S.shared)
                group.append(np.full(S.shared.shape[-1], -1))
                S = S.own if S.own.any() else None
            if S is not None:
                part = D @ S @ D.mT
                known = part if known is None else known + part
        return ScaleRows(
            reduced.J, linear.r, own, known, np.concatenate(B, axis=-1), np.concatenate(group), reduced.known
        ), reduced


@dataclass(frozen=True, eq=False)
class Search:
    """The logarithms x (k,) of the standard deviations between their ends, with what is known of them beforehand."""

    rows: ScaleRows
    deviations: tuple[Deviation, ...]
    start: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, rows: ScaleRows, deviations: tuple[Deviation, ...]) -> Search:
        """Build a search whose start is made of the residuals where nothing is known."""
        n = len(rows.y)
        J = rows.J.reshape(6 * n, -1)
        left = (rows.y.ravel() - J @ np.linalg.lstsq(J, rows.y.ravel(), rcond=None)[0]).reshape(n, 6)
        size = {"rad": _rms(left[:, :3]), "m": _rms(left[:, 3:]), "px": 1.0}
        start, low, high = (np.empty(len(deviations)) for _ in range(3))
        for k, of in enumerate(deviations):
            usual = np.log(0.3 * size[of.unit]) if np.isnan(of.mean) else of.mean
            start[k] = usual
            low[k], high[k] = usual + np.log(LEAST), usual + np.log(MOST)
            if of.floor:
                low[k], high[k] = of.mean, of.mean + np.log(MOST_OF_GROUP)
            if of.sd == 0:
                low[k] = high[k] = of.mean
        return cls(rows, deviations, start, low, high)

    @property
    def free(self) -> NDArray[np.bool_]:
        """(k,) those that are not given."""
        return self.high > self.low

    def objective(self, x: Array) -> tuple[float, Array]:
        """d less twice the logarithm of the prior, and its derivative (k,)."""
        at = self.rows.at(x)
        more, by = self.of_prior(x)
        return at.deviance + more, at.gradient + by

    def of_prior(self, x: Array) -> tuple[float, Array]:
        """Minus twice the logarithm of the density of x, and its derivative.

        The camera's translation, of which nothing is known, has a density proportional to the standard deviation: with
        few poses joint noise could take the place of all of it (`restricted_likelihood`).
        """
        total, by = 0.0, np.zeros(len(x))
        for k, of in enumerate(self.deviations):
            if np.isinf(of.sd):
                if of.name == "camera translation":
                    total, by[k] = total - 2.0 * float(x[k]), -2.0
            elif of.sd > 0:
                off = float(x[k] - of.mean) / of.sd
                total, by[k] = total + off * off, 2.0 * off / of.sd
        return total, by

    def minimum(self, x: Array) -> Array:
        """x where the objective is least."""
        from scipy.optimize import minimize  # slow to import

        found = minimize(
            self.objective, np.clip(x, self.low, self.high), jac=True, method="L-BFGS-B",
            bounds=list(zip(self.low, self.high, strict=True)), options={"maxiter": 200, "ftol": 1e-10, "gtol": 1e-4},
        )  # fmt: skip
        return np.asarray(found.x)

    def information(self, x: Array) -> Array:
        """(k, k): half of the second derivatives of the objective, by differences; of those that are free."""
        free = np.flatnonzero(self.free)
        found = np.eye(len(x))
        for k in free:
            h = STEP * np.eye(len(x))[k]
            ends = [self.objective(x + sign * h)[1] for sign in (1, -1)]
            found[k, free] = 0.25 * (ends[0] - ends[1])[free] / STEP
        return 0.5 * (found + found.T)

    def integrated(self, x: Array) -> tuple[Array, Array]:
        """x with ``log(E(s^2)) / 2`` for each group, and the logarithm of the upper end of its 95 % interval (k,)."""
        sums = self.rows.sums(x)
        result, upper = x.copy(), np.full(len(x), np.nan)
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        for k, of in enumerate(self.deviations):
            if not of.floor or of.sd == 0:
                continue
            begin = max(of.mean, float(x[k]) - REACH * of.sd)
            ends = begin, max(float(x[k]), of.mean) + REACH * of.sd
            at = 0.5 * (ends[1] - ends[0]) * (nodes + 1) + ends[0]
            d = np.empty(NODES)
            for j, value in enumerate(at.tolist()):
                moved = np.where(np.arange(len(x)) == k, value, x)
                d[j] = self.rows.at(moved, sums).deviance + self.of_prior(moved)[0]
            density = weights * np.exp(-0.5 * (d - d.min()))
            density /= density.sum()
            result[k] = 0.5 * float(np.log(density @ np.exp(2 * at)))
            upper[k] = float(np.interp(0.975, np.cumsum(density), at))
        return result, upper


def _rms(values: Array) -> float:
    return max(float(np.sqrt(np.mean(values**2))), 1e-12)


@dataclass(frozen=True, eq=False)
class FoundKinematics:
    """Standard deviations of one problem; `describe` adds intervals and words."""

    source: BesideKinematics
    search: Search
    x: Array
    n: int

    @cached_property
    def _integrated(self) -> tuple[Array, Array]:
        return self.search.integrated(self.x)

    @cached_property
    def zero(self) -> NDArray[np.bool_]:
        """(k,) standard deviations that are 0: at the least that is looked at."""
        groups = np.array([of.floor for of in self.search.deviations])
        return np.asarray(self.search.free & ~groups & (self.x < self.search.low + 0.5))

    @cached_property
    def deviations(self) -> dict[str, float]:
        """Standard deviations by name, rad, m or pixels; of groups those that their errors count with."""
        values = np.where(self.zero, 0.0, np.exp(self._integrated[0]))
        return {of.name: float(value) for of, value in zip(self.search.deviations, values, strict=True)}

    @cached_property
    def errors(self) -> tuple[SharedError, ...]:
        """The groups of kinematic errors, with their standard deviations."""
        return errors_of_arm(self.source.kinematics, self.deviations)

    @cached_property
    def noise(self) -> PoseNoise:
        """Noise of all poses."""
        source, s = self.source, self.deviations
        camera, robot = source.camera, source.robot
        if isinstance(camera, CameraNoise):
            camera = camera.covariance(s.get(PIXELS))
        sides = {"robot": robot, "camera": camera}
        for side, S in sides.items():
            own = [s.get(f"{side} {what}", 0.0) for what in ("rotation", "translation")]
            if S is None and any(own):
                sides[side] = np.diag(np.repeat(own, 3) ** 2)
        sides["robot"] = add_columns(sides["robot"], kinematic_covariance(source.kinematics, s))
        return with_shared(PoseNoise(**sides), source.columns)

    def describe(self) -> NoiseEstimate:
        """Components with intervals and what can be said of them."""
        search, x = self.search, self.x
        upper = self._integrated[1]
        H = search.information(x)
        values, vectors = np.linalg.eigh(H)
        C = (vectors / np.maximum(values, 1e-3)) @ vectors.T  # of the logarithms
        spread = np.where(search.free, np.sqrt(np.maximum(np.diag(C), 0.0)), 0.0)
        reach = float(ndtri(0.975))
        components = []
        for k, of in enumerate(search.deviations):
            value = self.deviations[of.name]
            low, high = float(np.exp(x[k] - reach * spread[k])), float(np.exp(x[k] + reach * spread[k]))
            if not search.free[k]:
                components.append(Component(of.name, of.unit, value, value, value, "fixed"))
                continue
            if of.floor:
                low, high = max(low, float(np.exp(of.mean))), max(float(np.exp(upper[k])), value)
                low = min(low, value)
            of_sheet = np.isfinite(of.sd) and of.name not in (JOINT_NOISE, PIXELS)
            status = "population" if of.floor else "zero" if self.zero[k] else "prior" if of_sheet else "estimated"
            components.append(Component(of.name, of.unit, value, 0.0 if self.zero[k] else low, high, status))
        camera, how = self.source.camera, ""
        if isinstance(camera, CameraNoise):
            how = "by geometry"
            if camera.pixel_sd is not None:
                s = camera.pixel_sd
                components.append(Component(PIXELS, "px", s, s, s, "given"))
        elif camera is not None:
            how = "from corners" if isinstance(camera, JointCovariance) else "given"
        if how:
            S = self.noise.camera
            variances = np.diagonal(marginals(S), axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
            for what, unit, variance in zip(("rotation", "translation"), ("rad", "m"), variances, strict=True):
                sd = float(np.sqrt(variance))
                components.append(Component(f"camera {what}", unit, sd, sd, sd, how))
        own = np.array([not of.floor for of in search.deviations], dtype=bool)
        v = np.where(self.zero, 0.0, np.exp(2 * x))[own]
        log_covariance = np.where(search.free[:, None] & search.free, C, 0.0)[np.ix_(own, own)]
        covariance = 4.0 * log_covariance * np.outer(v, v)
        names = tuple(of.name for of, is_own in zip(search.deviations, own, strict=True) if is_own)
        finding = Finding("noise_estimation.kinematics", "note", self._said)
        dof = 6.0 * self.n - 12
        return NoiseEstimate(
            self.noise, tuple(components), (finding,), v, covariance, dof, None,
            self._spread_of_X(own, log_covariance), names=names,
        )  # fmt: skip

    @property
    def _said(self) -> dict[str, Any]:
        """Values of the sentence: whose standard deviations are the least, and of which groups they were given."""
        given = self.source.kinematics.given
        groups = dict.fromkeys(self.source.kinematics.groups)
        return {
            "of": given.robot_class or USUAL,
            "declared": given.how == DECLARED,
            "given": [group for group in groups if getattr(given, DECLARED_AS[group]) is not None],
            "groups": len(groups),
        }

    def _spread_of_X(self, own: NDArray[np.bool_], log_covariance: Array) -> float:
        """A of `goodness_of_fit`: how uncertain Sigma_X is, by the standard deviations of noise."""
        rows, x = self.search.rows, self._integrated[0]
        p = rows.p

        def of_X(x: Array) -> Array:
            return rows.at(x).covariance[:p, :p]

        middle = np.linalg.pinv(of_X(x), hermitian=True)
        relative = [
            middle @ (of_X(x + STEP * np.eye(len(x))[k]) - of_X(x - STEP * np.eye(len(x))[k])) / (2 * STEP)
            if self.search.free[k] and not self.zero[k]
            else np.zeros((p, p))
            for k in np.flatnonzero(own)
        ]
        stacked = np.array(relative).reshape(-1, p, p)
        return float(np.einsum("kl,kij,lji->", log_covariance, stacked, stacked)) * 6.0 / p
