r"""Noise from the data: how large are the errors of robot and camera, and which of them this data set separates.

Model: the errors ``xi = (theta, tau)`` of the poses (or of motions that come without poses) are independent, Gaussian
and isotropic, with one standard deviation (rad, m) for each of robot rotation, robot translation, camera rotation and
camera translation. They are estimated by restricted maximum likelihood on the linearised constraint
(`restricted_likelihood`), which counts the degrees of freedom that X and W take.

What data can tell. All that an estimate of X sees of the errors is, to first order, the residual r of ``G X C = W`` (or
``A X = X B``), and

- *translation*: robot and camera enter r as an error rotated by a rotation; both covariances are ``sigma^2 I`` in r.
  Only the sum of the two variances can be told. A data sheet for one of them gives the other.
- *rotation*: a rotation error of the robot also moves the target, by the lever arm from gripper to target; one of the
  camera does not. So the two can be separated where ``lever times rotation error`` shows beside the translation noise,
  and not otherwise. Their sum is always told.

What cannot be separated has no effect on X: r has the same covariance S however the sum is split, and X, its
covariance, the bound and every test of the fit depend on the noise only through S (to first order in the errors). The
`noise` that is returned holds one split: the half on each side where nothing is known, what the prior says where it is.

A prior says that log of a standard deviation is Gaussian about that of the data sheet, with ``log(factor)`` as its
standard deviation; the estimate is then the maximum of the restricted likelihood times the prior.

Camera poses that come from corners (`calibrate_camera`) bring their joint covariance with them: nothing of it is
estimated, and the robot's noise is found beside it (`beside_camera`), rotation and translation separated from the
camera's. The same holds for a `CameraNoise`, the covariance of finished camera poses by the geometry of what they saw,
whose pixel noise is estimated with it.

Intervals are 95 % profile intervals of the restricted likelihood; those of sums of two of them are chi-square
intervals with Satterthwaite's degrees of freedom ``2 sigma^4 / Var(sigma^2)``. Where the data cannot tell a component
from 0 its interval starts at 0 and is conservative: it covers at least 95 %, up to 97.5 % where the true value is 0,
and nearly always where rotations are not separated.

Units: rad and m, standard deviations per axis; text is in degrees and mm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, NotConvergedError
from ..findings import Finding
from ..geometry.checks import as_transforms
from ..geometry.se3 import Array
from ..likelihood.constraint import Constraint, Linearised, Unknowns, constraint_of
from ..likelihood.reduced_rows import reduce_rows
from ..likelihood.starts import sound_start, start_of
from ..noise.camera_noise import CameraNoise
from ..noise.estimate import Component, NoiseEstimate, NoisePrior, together
from ..noise.joint_covariance import JointCovariance
from ..noise.models import Noise, PairNoise, PoseNoise
from ..noise.pose_prior import PosePrior
from ..poses.motions import Motions
from ..poses.pose_pairs import PosePairs
from ..shared_errors.shared_error import SharedError, add_columns, checked_errors, shared_columns
from .beside_camera import FROM_POINTS, BesideCamera
from .findings import noise_findings
from .restricted_likelihood import (
    GAIN,
    Model,
    Rows,
    State,
    chi_square_interval,
    covariance_of,
    intervals,
    maximise,
    paired_rows,
)

# Residuals below this, in rad and relative to the longest translation, are rounding: no noise to estimate.
ROUNDING = 1e-11
# The components stand still when they change by less than this, in their own standard deviations.
_STILL = 1e-3
_ROUNDS = 8
KINDS = ("rotation", "translation")


@dataclass(frozen=True, eq=False)
class Components:
    """Result of the iteration; leading axes are independent problems."""

    state: State | None  # None where there is nothing to estimate
    rows: Rows
    at: Unknowns  # where the last estimate was linearised; `state.data.step` leads on to the efficient estimate
    exact: NDArray[np.bool_]  # (..., 2): rotation, translation residuals at rounding level
    converged: NDArray[np.bool_]  # (...)
    p: int  # unknowns of X and W that are not open


class NoiseSource(Protocol):
    """Source of the noise of one data set."""

    def find(self, at: Unknowns, weights: Array | None = None) -> FoundNoise:
        """Linearised near the unknowns, with poses that count with ``weights`` (n,)."""
        ...


class FoundNoise(Protocol):
    """Numbers; `describe` makes intervals and words of them."""

    @property
    def noise(self) -> Noise | None:
        """None: the data are exact."""
        ...

    def describe(self) -> NoiseEstimate:
        """Components with intervals and what can be said of them."""
        ...


def estimate_noise(
    data: PosePairs | Motions,
    prior: NoisePrior | None = None,
    *,
    start: Array | None = None,
    weights: Array | None = None,
    camera: CameraNoise | None = None,
    robot: Any = None,
    shared: Sequence[SharedError] = (),
) -> NoiseEstimate:
    """Variance components of robot and camera from the residuals of the data themselves.

    Linearised at 4DPA (or ``start``); after each estimate X takes the efficient step with that noise, until the
    components stand still.

    Parameters
    ----------
    data : PosePairs or Motions
        One data set (no leading axes); on poses where there are any. With camera poses from corners
        (``camera_calibration``) or points (``camera_covariance``) the robot's noise is estimated beside their joint
        covariance.
    prior : NoisePrior or None
    start : (4, 4) or None
        A consistent estimate of X.
    weights : (n,) or None
        In [0, 1]; a pose of weight w counts as w poses in the likelihood and in the degrees of freedom, 0 leaves it
        out; 0 or 1 beside a joint covariance. Weights that were made from the residuals make the noise look smaller:
        correct for it where they were made.
    camera : CameraNoise or None
        The covariance of the camera poses but for their pixel noise (`camera_noise`).
    robot : covariance or None
        Of the robot poses beside `camera`; None: estimated too.
    shared : sequence of SharedError
        Errors that all poses share, unknowns with a prior beside X and W; the noise that is returned contains them,
        but for the accuracy of a robot, which is none (`SharedError.learned`).

    Raises
    ------
    InputError
        Weights that do not fit, or that leave no degrees of freedom.
    DegenerateMotionError
        The data do not determine X (or W).
    NotConvergedError
        The components do not converge.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> estimate = estimate_noise(uq.simulate(n_poses=30, noise=noise, seed=1))
    >>> estimate["translation, robot and camera together"].status
    'estimated'
    """
    constraint = constraint_of(data, None)
    if constraint.first.ndim != 3:
        raise InputError(f"Expected one data set, got leading axes {constraint.first.shape[:-3]}.")
    n = constraint.n
    if weights is not None:
        weights = np.asarray(weights, dtype=float)
        if weights.shape != (n,) or not ((weights >= 0) & (weights <= 1)).all():
            raise InputError(f"Expected `weights` to be {n} numbers in [0, 1], got shape {weights.shape}.")
    poses = data if isinstance(data, PosePairs) else data.poses
    if shared and poses is None:
        raise InputError(
            "Expected poses beside `shared`: the effect of an error on motions without poses is not known."
        )
    columns = {} if poses is None else shared_columns(checked_errors(shared, poses), poses)
    source = choose_source(data, constraint, prior, camera, robot, columns=columns)
    _require_freedom(constraint, weights)
    if start is None:
        return source.find(sound_start(data, constraint, None), weights).describe()
    return source.find(start_of(data, constraint, as_transforms(start, "start", stack=False)), weights).describe()


def choose_source(
    data: PosePairs | Motions,
    constraint: Constraint,
    prior: NoisePrior | None,
    camera: CameraNoise | None = None,
    robot: Any = None,
    *,
    columns: dict[str, JointCovariance] | None = None,
    pose_prior: PosePrior | None = None,
) -> NoiseSource:
    """The residuals; beside the covariance of camera poses by geometry, or that which those from corners come with.

    ``columns`` by side are the errors that all poses share (`shared_columns`).
    """
    columns = columns or {}
    prior = NoisePrior() if prior is None else prior
    poses = data if isinstance(data, PosePairs) else data.poses
    if camera is not None:
        if camera.n != constraint.n or poses is None:
            raise InputError(f"Expected `camera` noise of these {constraint.n} poses, got that of {camera.n}.")
        return BesideCamera(constraint, camera, prior, robot, columns, pose_prior)
    if poses is not None and poses.camera_calibration is not None:
        seen = poses.camera_calibration
        return BesideCamera(constraint, seen.covariance, prior, None, columns, pose_prior, excess=seen.per_pixel)
    if poses is not None and poses.camera_covariance is not None:
        S = poses.camera_covariance
        return BesideCamera(constraint, S, prior, None, columns, pose_prior, how=FROM_POINTS)
    return FromResiduals(constraint, prior, columns, pose_prior)


def _require_freedom(
    constraint: Constraint, weights: Array | None, p: int | None = None, prior: PosePrior | None = None
) -> float:
    """Residual degrees of freedom beside p unknowns (all); raises `InputError` where there are none."""
    dof = 6.0 * (constraint.n if weights is None else float(weights.sum())) - (constraint.p if p is None else p)
    dof += 0 if prior is None else prior.rank
    if dof <= 0:
        raise InputError(
            f"Expected residuals to estimate the noise from, got {dof:g} degrees of freedom. Give more poses, or "
            "the noise."
        )
    return dof


@dataclass(frozen=True, eq=False)
class FromResiduals:
    """The variance components of one data set; see the module."""

    constraint: Constraint
    prior: NoisePrior
    columns: dict[str, JointCovariance] = field(default_factory=dict)  # errors that all rows share, by side
    pose_prior: PosePrior | None = None

    @cached_property
    def model(self) -> tuple[Model, tuple[str, ...]]:
        """Model of the noise, and the names of its unknown variances."""
        return model_of(self.prior, self.constraint.sides)

    def find(self, at: Unknowns, weights: Array | None = None) -> FoundComponents:
        """The components near the unknowns; raises as `estimate_noise`."""
        _require_freedom(self.constraint, weights, prior=self.pose_prior)
        model, _ = self.model
        found = variance_components(self.constraint, at, model, weights, self.columns, self.pose_prior)
        dof = _require_freedom(self.constraint, weights, found.p, self.pose_prior)
        if not found.converged.all():
            turn, shift = np.sqrt(found.rows.size)
            raise NotConvergedError(
                f"Noise estimation did not converge; the residuals are {np.rad2deg(turn):.2g} deg and "
                f"{shift * 1e3:.2g} mm (root mean square). If that is too much, look at the setup, at the pairing of "
                "the poses and for outliers; or give the noise.",
                found,
            )
        return FoundComponents(self, found, dof)


@dataclass(frozen=True, eq=False)
class FoundComponents:
    """Variances of one problem; `describe` adds intervals and words."""

    source: FromResiduals
    components: Components
    dof: float

    @property
    def exact(self) -> bool:
        """True if residuals at rounding level leave nothing to estimate."""
        return bool(self.source.model[1]) and bool(self.components.exact.any())

    @cached_property
    def deviations(self) -> dict[str, float]:
        """Standard deviation by side and kind: fixed, estimated, or half of a variance that is known as a sum only."""
        model, names = self.source.model
        state = self.components.state
        v = np.zeros(0) if state is None else state.v
        found: dict[str, float] = dict(zip(names, np.sqrt(v).tolist(), strict=True))
        known: Iterator[float] = iter(self.source.prior.values.tolist())
        parts = [(f"{side} {what}", next(known)) for side in self.source.constraint.sides for what in KINDS]
        half = np.sqrt(0.5 * float((model.mixing @ v + model.offset)[2]))
        return {name: found.get(name, half if np.isnan(value) else value) for name, value in parts}

    @cached_property
    def noise(self) -> Noise | None:
        """Isotropic; None: the data are exact."""
        if self.exact:
            return None
        sides = self.source.constraint.sides
        kind = PoseNoise if self.source.constraint.item == "pose" else PairNoise
        columns = self.source.columns
        return kind(**{
            side: add_columns(
                np.diag(np.repeat([self.deviations[f"{side} {what}"] for what in KINDS], 3) ** 2), columns.get(side)
            )
            for side in sides
        })  # fmt: skip

    def describe(self) -> NoiseEstimate:
        """Components with intervals and what can be said of them."""
        return _exact(self) if self.exact else _report(self)


def model_of(prior: NoisePrior, sides: tuple[str, str]) -> tuple[Model, tuple[str, ...]]:
    """The model of the prior and the names of its unknown variances; one for both translations if none is known."""
    values = prior.values.reshape(2, 2)
    fixed = prior.factor == 1
    names, columns, means, deviations = [], [], [], []
    offset = np.zeros(3)
    for part, what in enumerate(("rotation", "translation")):
        for k, side in enumerate(sides):
            row = 2 if part else k
            value = values[k, part]
            known = not np.isnan(value)
            if known and fixed:
                offset[row] += value**2
                continue
            name = f"{side} {what}"
            if part and np.isnan(values[:, 1]).all():
                if k == 1:
                    continue
                name = together(what, sides)
            names.append(name)
            columns.append(np.eye(3)[row])
            means.append(np.log(value) if known else 0.0)
            deviations.append(np.log(prior.factor) if known else np.inf)
    mixing = np.array(columns).reshape(-1, 3).T
    return Model(mixing, offset, np.array(means), np.array(deviations)), tuple(names)


def variance_components(
    constraint: Constraint,
    at: Unknowns,
    model: Model,
    weights: Array | None = None,
    columns: dict[str, JointCovariance] | None = None,
    prior: PosePrior | None = None,
) -> Components:
    """The estimates of `estimate_noise`, linearised near the unknowns; leading axes are independent problems."""
    longest = [np.abs(T[..., :3, 3]).max() for T in (constraint.first, constraint.second)]
    least = ROUNDING * np.array([1.0, max(1e-300, *longest)])
    v: Array | None = None
    for done in range(_ROUNDS):
        linear = constraint.linearise(at, constraint.first, constraint.second)
        reduced = reduce_rows(constraint, linear, at, weights, prior)
        p = reduced.J.shape[-1]
        effects = _effects(linear, constraint, columns or {})
        rows = paired_rows(linear._replace(J=reduced.J), weights, effects, reduced.known)
        exact = rows.size < least**2
        if v is None:
            v = _first_guess(rows, model)
        if model.size == 0 or exact.any():
            return Components(None, rows, at, exact, np.ones(exact.shape[:-1], dtype=bool), p)
        state, reached = maximise(rows, model, v, gain=1e-4 if done == 0 else GAIN)
        known = np.where(model.known, np.maximum(v, 1e-300), 1.0)
        change = np.abs(state.v - v) / known / np.sqrt(np.diagonal(covariance_of(state), axis1=-2, axis2=-1))
        converged = reached & (change < _STILL).all(axis=-1)
        v = state.v
        if (done > 0 and converged.all()) or done == _ROUNDS - 1:
            break
        at = at.moved(reduced.unreduced(state.data.step[..., :p]))
    return Components(state, rows, at, exact, converged, p)


def _effects(linear: Linearised, constraint: Constraint, columns: dict[str, JointCovariance]) -> Array | None:
    """(..., n, 6, k) of shared errors on the residuals, per standard deviation; None where there are none."""
    found = [
        D @ columns[side].shared for side, D in zip(constraint.sides, linear.sides, strict=True) if side in columns
    ]
    return np.concatenate(found, axis=-1) if found else None


def _first_guess(rows: Rows, model: Model) -> Array:
    """Half of the mean square on each rotation and all of it on the translations, data sheets where there are any."""
    size = np.stack([0.5 * rows.size[..., 0], 0.5 * rows.size[..., 0], rows.size[..., 1]], axis=-1)
    return np.asarray(np.where(model.known, np.exp(2.0 * model.log_mean), size @ model.mixing))


def _exact(found: FoundComponents) -> NoiseEstimate:
    sides = found.source.constraint.sides
    parts = [what for what, is_exact in zip(KINDS, found.components.exact, strict=True) if is_exact]
    components = tuple(
        Component(together(what, sides), unit, 0.0, 0.0, None, "exact" if what in parts else "not estimated")
        for what, unit in (("rotation", "rad"), ("translation", "m"))
    )
    findings = (Finding("noise_estimation.exact", "note", {"parts": parts}),)
    return NoiseEstimate(None, components, findings, np.zeros(3), np.zeros((3, 3)), found.dof)


def _report(found: FoundComponents) -> NoiseEstimate:
    """Components, noise and findings of one problem."""
    prior, sides, (model, names) = found.source.prior, found.source.constraint.sides, found.source.model
    state = found.components.state
    known = dict(zip([f"{side} {what}" for side in sides for what in KINDS], prior.values, strict=True))
    unfinished: list[str] = []
    if state is None:
        v, covariance, low, high = np.zeros(0), np.zeros((0, 0)), np.zeros(0), np.zeros(0)
    else:
        v = state.v
        by = np.where(model.known, v, 1.0)
        covariance = by[:, None] * covariance_of(state) * by
        low, high, reached = intervals(found.components.rows, model, state, np.arange(len(names)))
        unfinished = [name for name, done in zip(names, reached.tolist(), strict=True) if not done]
    variances = model.mixing @ v + model.offset
    full = model.mixing @ covariance @ model.mixing.T
    parts: dict[str, Component] = {}
    for k, name in enumerate(names):
        status = "prior" if model.known[k] else "estimated" if v[k] > 0 else "zero"
        parts[name] = _component(name, (v[k], low[k], high[k]), status)
    for name, value in known.items():
        if name not in parts and not np.isnan(value):
            parts[name] = _component(name, [value**2] * 3, "fixed")
    rotations, translations = ([f"{side} {what}" for side in sides] for what in ("rotation", "translation"))
    for what, total, variance, own in (
        ("rotation", variances[0] + variances[1], full[:2, :2].sum(), rotations),
        ("translation", variances[2], full[2, 2], translations),
    ):
        name = together(what, sides)
        if name in parts:
            continue
        ends = chi_square_interval(total, variance)
        if all(parts[part].status == "fixed" for part in own if part in parts) and own[0] in parts:
            parts[name] = _component(name, [total] * 3, "fixed")
        else:
            known_of_all = all(part in parts and parts[part].status in ("prior", "fixed") for part in own)
            fixed = sum(parts[part].value ** 2 for part in own if part in parts and parts[part].status == "fixed")
            status = "prior" if known_of_all or fixed > 0.5 * total else "estimated"
            parts[name] = _component(name, (total, max(ends[0], fixed), ends[1]), status)
    rotation_told = all(parts[name].status == "prior" for name in rotations) or any(
        parts[name].low > 0 or parts[name].status == "fixed" for name in rotations
    )
    if not rotation_told:
        for name in rotations:
            parts[name] = replace(parts[name], status="not told apart")
    whole = parts[together("translation", sides)]
    for name in translations:
        if name not in parts:
            parts[name] = Component(name, "m", float(np.sqrt(0.5)) * whole.value, 0.0, whole.high, "not told apart")
    order = [name for what in ("rotation", "translation")
             for name in (together(what, sides), *(f"{side} {what}" for side in sides))]  # fmt: skip
    components = tuple(parts[name] for name in order)
    sheet = _from_data_sheet(parts, sides, covariance, dict(zip(names, range(len(names)), strict=True)), prior)
    findings = noise_findings(parts, sides, rotation_told, sheet)
    if unfinished:
        findings += (Finding("noise_estimation.interval_too_wide", "caution", {"names": unfinished}),)
    return NoiseEstimate(found.noise, components, findings, variances, full, found.dof)


def _from_data_sheet(
    parts: dict[str, Component], sides: tuple[str, str], covariance: Array, column: dict[str, int], prior: NoisePrior
) -> frozenset[str]:
    """Components and sums that the data sheet decides: half or more of its own spread is left, in variances."""
    found = set()
    for what in ("rotation", "translation"):
        own = [f"{side} {what}" for side in sides]
        statuses = [parts[name].status for name in own]
        for names in (own[:1], own[1:], own):
            name = names[0] if len(names) == 1 else together(what, sides)
            if all(parts[one].status in ("fixed", "prior") for one in names):
                columns = [column[one] for one in names if one in column]
                before = sum((2 * np.log(prior.factor) * parts[one].value ** 2) ** 2 for one in names if one in column)
                decided = covariance[np.ix_(columns, columns)].sum() >= 0.5 * before
            else:  # a fixed part that makes up most of a sum
                decided = len(names) == 2 and "fixed" in statuses and parts[name].status == "prior"
            if decided:
                found.add(name)
    return frozenset(found)


def _component(name: str, variances: Sequence[float | Array], status: str) -> Component:
    """Build a component from estimate, lower and upper end of a variance."""
    value, low, high = (float(np.sqrt(x)) for x in variances)
    return Component(
        name, "rad" if "rotation" in name else "m", value, low, high if np.isfinite(high) else None, status
    )
