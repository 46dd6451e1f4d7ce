"""Report of the estimated noise: each standard deviation with its 95 % interval, and whether the data resolve it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...findings import Finding
from ...model.errors.camera_noise import CameraNoise
from ...model.errors.error_estimate import ErrorEstimate
from ...model.errors.key import ErrorKey, Kind, Owner
from ...model.errors.keys import CAMERA_EXCESS, JOINT_NOISE, PICTURE_SHIFT, PIXELS, SCENE_EXCESS
from ...model.errors.noise_estimate import NoiseEstimate, together
from ...model.errors.sizes import SIZES
from ...model.errors.term import SIDES
from ...model.kinematics.kinematic_errors import DECLARED_AS
from .estimation import INTERVAL_SD, KINDS, MAX_RESOLVED_SPREAD, FoundSizes
from .findings import beside_camera_findings, noise_findings, size_findings

# Whose poses a noise moves.
_SIDES = {Owner.ROBOT: "robot", Owner.CAMERA: "camera", Owner.A: "robot", Owner.B: "camera"}
UNITS = {Kind.ROTATION: "rad", Kind.TRANSLATION: "m"}


class _Spread(NamedTuple):
    """A standard deviation over the posterior of the sizes: its logarithm has this mean and deviation."""

    mean: float
    sd: float
    logs: Array  # (d,)

    def component(self, key: ErrorKey, unit: str, status: str) -> ErrorEstimate:
        """Build the component, with the interval of a log-normal."""
        low, high = (float(np.exp(self.mean + sign * INTERVAL_SD * self.sd)) for sign in (-1, 1))
        return ErrorEstimate(key, _side(key), unit, float(np.exp(self.mean)), low, high, status)


def noise_estimate_of(found: FoundSizes) -> NoiseEstimate:
    """Return the estimate of the noise with the sizes that were found."""
    source = found.source
    if found.exact.any():
        return _exact(found)
    mixture, sides = found.mixture, _owners(found)
    sizes = np.array([found.model.sizes(theta) for theta in mixture.theta])  # (d, components)
    own = {ErrorKey(side, what): np.zeros(len(sizes)) for side in sides for what in KINDS}
    for c, part in enumerate(source.components):
        if part.block is None or part.key == JOINT_NOISE or part.key.kind in DECLARED_AS:
            continue
        side = sides[("robot", "camera").index(part.side)]
        variance = np.einsum("...ik,...ik->...i", part.block, part.block).reshape(-1, 2, 3).mean(axis=(0, 2))
        for what, each in zip(KINDS, variance.tolist(), strict=True):
            own[ErrorKey(side, what)] += each * sizes[:, c] ** 2
    for known, owner in zip(("robot", "camera"), sides, strict=True):
        if known in source.known:
            variance = np.diagonal(source.known[known], axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
            for what, each in zip(KINDS, variance.tolist(), strict=True):
                own[ErrorKey(owner, what)] += each
    spreads = {key: _spread(mixture.weights, v) for key, v in own.items() if (v > 0).all()}
    parts = {
        key: spread.component(key, UNITS[key.kind], _status(found, key, spread)) for key, spread in spreads.items()
    }
    for what in KINDS:
        keys = [ErrorKey(side, what) for side in sides]
        if all(key in own for key in keys) and (total := own[keys[0]] + own[keys[1]]).all():
            spread = _spread(mixture.weights, total)
            both = [parts[key].status for key in keys if key in parts]
            status = both[0] if len(set(both)) == 1 and both[0] in ("fixed", "prior") else "estimated"
            both_sides = spread.component(together(what, sides), UNITS[what], status)
            fixed = sum(float(own[key][0]) for key in keys if key in parts and parts[key].status == "fixed")
            parts[both_sides.key] = replace(both_sides, low=max(both_sides.low, float(np.sqrt(fixed))))
    order = [key for what in KINDS for key in (together(what, sides), *(ErrorKey(side, what) for side in sides))]
    components = [parts[key] for key in order if key in parts]
    components += _sized(found)
    parts |= {part.key: part for part in components}
    told = tuple(key for key in spreads if spreads[key].sd > 0)
    logs = np.array([spreads[key].logs for key in told]).reshape(len(told), len(sizes))
    centred = logs - (logs @ mixture.weights)[:, None]
    v = np.exp([2.0 * spreads[key].mean for key in told])
    covariance = 4.0 * (centred * mixture.weights) @ centred.T * np.outer(v, v)
    findings = (*_findings(found, parts), *size_findings(found))
    dof = 6.0 * len(found.kept) - found.model.p
    return NoiseEstimate(
        found.integrated_noise, tuple(components), findings, v, covariance, dof, keys=told,
        shape=mixture.shape if np.isfinite(mixture.shape) else None, of_model=_of_model(found),
    )  # fmt: skip


def _spread(weights: Array, variance: Array) -> _Spread:
    logs = 0.5 * np.log(variance)
    mean = float(weights @ logs)
    return _Spread(mean, float(np.sqrt(np.maximum(weights @ (logs - mean) ** 2, 0.0))), logs)


def _status(found: FoundSizes, key: ErrorKey, spread: _Spread) -> str:
    """Status of a noise: fixed, by its data sheet, estimated, or not separable from the others."""
    source = found.source
    index = source.sides.index(key.owner)
    known = (source.robot, source.camera)[index]
    if known is not None:
        if index == 1 and source.how:
            return source.how
        return "by geometry" if isinstance(known, CameraNoise) else "given" if index else "fixed"
    if (sheet := source.prior.get(ErrorKey(Owner(SIDES[index]), key.kind))) is not None:
        return "fixed" if sheet.is_known else "prior"
    part = next(one for one in source.components if one.key == key)
    return "estimated" if spread.sd < MAX_RESOLVED_SPREAD * np.log(part.size.factor) else "not told apart"


def _sized(found: FoundSizes) -> list[ErrorEstimate]:
    """Return the components with a size that are no noise of a side: pixels, joints, groups of an arm."""
    mixture, listed = found.mixture, []
    free = {found.source.components[k].key: j for j, k in enumerate(found.model.free.tolist())}
    for part in found.source.components:
        is_group = part.key.kind in DECLARED_AS
        if part.key not in (PIXELS, JOINT_NOISE, CAMERA_EXCESS, SCENE_EXCESS, PICTURE_SHIFT) and not is_group:
            continue
        unit = part.size.unit or ("rad" if is_group else "")
        if part.key not in free:
            s = part.size.median
            listed.append(ErrorEstimate(part.key, part.side, unit, s, s, s, "given" if part.key == PIXELS else "fixed"))
            continue
        j = free[part.key]
        sd = float(np.sqrt(mixture.covariance_theta[j, j]))
        spread = _Spread(float(mixture.mean_theta[j]), float(found.spreads[j]), mixture.theta[:, j])
        status = (
            "population"
            if is_group
            else "estimated"
            if sd < MAX_RESOLVED_SPREAD * np.log(part.size.factor)
            else "not told apart"
        )
        listed.append(spread.component(part.key, unit, status))
    return listed


def _of_model(found: FoundSizes) -> tuple[ErrorEstimate, ...]:
    """Return all components with their sizes, in rad and m, and what they do to X."""
    mixture, model, source = found.mixture, found.model, found.source
    free = {k: j for j, k in enumerate(model.free.tolist())}
    shares = model.shares(mixture.mean_theta)
    listed = []
    for k, part in enumerate(source.components):
        log, sd = float(np.log(max(part.size.median, 1e-300))), 0.0
        if k in free:
            j = free[k]
            log, sd = float(mixture.mean_theta[j]), float(found.spreads[j])
        size, low, high = (float(np.exp(log + z * sd)) for z in (0.0, -INTERVAL_SD, INTERVAL_SD))
        unit = SIZES[part.key].unit if part.key in SIZES else part.size.unit
        resolved, share = float(found.mode.state.determined[k]) / max(part.count, 1), float(shares[k])
        listed.append(
            ErrorEstimate(part.key, part.side, unit, size, low, high, count=part.count, resolved=resolved, share=share)
        )
    return tuple(listed)


def _owners(found: FoundSizes) -> tuple[Owner, Owner]:
    first, second = map(Owner, found.source.sides)
    return first, second


def _side(key: ErrorKey) -> str:
    """Return whose poses a noise moves; of a sum of both nothing."""
    return _SIDES.get(key.owner, "")


def _findings(found: FoundSizes, parts: dict[ErrorKey, ErrorEstimate]) -> tuple[Finding, ...]:
    sides = _owners(found)
    if found.source.camera is not None:
        return beside_camera_findings(parts, 6.0 * len(found.kept) - found.model.p)
    if len(parts) < 6 or any(
        part.status not in ("fixed", "prior", "estimated", "not told apart") for part in parts.values()
    ):
        return ()
    told = not any(parts[ErrorKey(side, Kind.ROTATION)].status == "not told apart" for side in sides)
    width = MAX_RESOLVED_SPREAD * float(np.log(max((s.factor for s in found.source.prior.values()), default=1.0)))
    sheet = frozenset(key for key, part in parts.items() if _by_sheet(part, width))
    return noise_findings(parts, sides, told, sheet)


def _by_sheet(part: ErrorEstimate, width: float) -> bool:
    """Return whether the data sheet decides: the noise is as uncertain as it says (``width`` of the logarithm)."""
    if part.status == "fixed":
        return True
    if part.status != "prior" or part.high is None:
        return False
    return part.low == part.high or float(np.log(part.high / part.low)) / (2.0 * INTERVAL_SD) > width


def _exact(found: FoundSizes) -> NoiseEstimate:
    sides = _owners(found)
    names = [what for what, is_exact in zip(KINDS, found.exact, strict=True) if is_exact]
    components = tuple(
        ErrorEstimate(
            together(what, sides), "", UNITS[what], 0.0, 0.0, None, "exact" if what in names else "not estimated"
        )
        for what in KINDS
    )
    findings = (Finding("noise_estimation.exact", "note", {"parts": names}),)
    dof = 6.0 * len(found.kept) - found.model.p
    return NoiseEstimate(None, components, findings, np.zeros(3), np.zeros((3, 3)), dof)
