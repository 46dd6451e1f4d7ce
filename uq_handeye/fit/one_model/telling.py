"""Report of the estimated noise: each standard deviation with its 95 % interval, and whether the data resolve it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.geometry.se3 import Array
from ...findings import Finding
from ...model.kinematics.kinematic_errors import DECLARED_AS, JOINT_NOISE
from ...model.noise.camera_noise import CameraNoise
from ...model.noise.estimate import CAMERA_EXCESS, PICTURE_SHIFT, Component, FoundComponent, NoiseEstimate, together
from ...model.shared_errors.sizes import SIZES
from .estimation import INTERVAL_SD, KINDS, MAX_RESOLVED_SPREAD, PIXELS, FoundSizes
from .findings import beside_camera_findings, noise_findings, size_findings

UNITS = {"rotation": "rad", "translation": "m"}


@dataclass(frozen=True, eq=False)
class _Spread:
    """A standard deviation over the posterior of the sizes: its logarithm has this mean and deviation."""

    mean: float
    sd: float
    logs: Array  # (d,)

    def component(self, name: str, unit: str, status: str) -> Component:
        """Build the component, with the interval of a log-normal."""
        low, high = (float(np.exp(self.mean + sign * INTERVAL_SD * self.sd)) for sign in (-1, 1))
        return Component(name, unit, float(np.exp(self.mean)), low, high, status)


def tell(found: FoundSizes) -> NoiseEstimate:
    """Describe the noise of `FoundSizes`."""
    source = found.source
    if found.exact.any():
        return _exact(found)
    mixture, sides = found.mixture, source.sides
    sizes = np.array([found.model.sizes(theta) for theta in mixture.theta])  # (d, components)
    own = {name: np.zeros(len(sizes)) for side in sides for name in (f"{side} {what}" for what in KINDS)}
    for c, part in enumerate(source.components):
        if part.block is None or part.name == JOINT_NOISE or part.name in DECLARED_AS:
            continue
        side = sides[("robot", "camera").index(part.side)]
        variance = np.einsum("...ik,...ik->...i", part.block, part.block).reshape(-1, 2, 3).mean(axis=(0, 2))
        for what, each in zip(KINDS, variance.tolist(), strict=True):
            own[f"{side} {what}"] += each * sizes[:, c] ** 2
    for side, name in zip(("robot", "camera"), sides, strict=True):
        if side in source.known:
            variance = np.diagonal(source.known[side], axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
            for what, each in zip(KINDS, variance.tolist(), strict=True):
                own[f"{name} {what}"] += each
    spreads = {name: _spread(mixture.weights, v) for name, v in own.items() if (v > 0).all()}
    parts = {
        name: spread.component(name, UNITS[name.split()[-1]], _status(found, name, spread))
        for name, spread in spreads.items()
    }
    for what in KINDS:
        names = [f"{side} {what}" for side in sides]
        if all(name in own for name in names) and (total := own[names[0]] + own[names[1]]).all():
            spread = _spread(mixture.weights, total)
            both = [parts[name].status for name in names if name in parts]
            status = both[0] if len(set(both)) == 1 and both[0] in ("fixed", "prior") else "estimated"
            both_sides = spread.component(together(what, sides), UNITS[what], status)
            fixed = sum(float(own[name][0]) for name in names if name in parts and parts[name].status == "fixed")
            parts[both_sides.name] = replace(both_sides, low=max(both_sides.low, float(np.sqrt(fixed))))
    order = [name for what in KINDS for name in (together(what, sides), *(f"{side} {what}" for side in sides))]
    components = [parts[name] for name in order if name in parts]
    components += _sized(found)
    parts |= {part.name: part for part in components}
    told = tuple(name for name in spreads if spreads[name].sd > 0)
    logs = np.array([spreads[name].logs for name in told]).reshape(len(told), len(sizes))
    centred = logs - (logs @ mixture.weights)[:, None]
    v = np.exp([2.0 * spreads[name].mean for name in told])
    covariance = 4.0 * (centred * mixture.weights) @ centred.T * np.outer(v, v)
    findings = (*_findings(found, parts), *size_findings(found))
    dof = 6.0 * len(found.kept) - found.model.p
    return NoiseEstimate(
        found.integrated_noise, tuple(components), findings, v, covariance, dof, names=told,
        shape=mixture.shape if np.isfinite(mixture.shape) else None, of_model=_of_model(found),
    )  # fmt: skip


def _spread(weights: Array, variance: Array) -> _Spread:
    logs = 0.5 * np.log(variance)
    mean = float(weights @ logs)
    return _Spread(mean, float(np.sqrt(np.maximum(weights @ (logs - mean) ** 2, 0.0))), logs)


def _status(found: FoundSizes, name: str, spread: _Spread) -> str:
    """Status of a noise: fixed, by its data sheet, estimated, or not separable from the others."""
    source = found.source
    side = name.split()[0]
    index = source.sides.index(side)
    known = (source.robot, source.camera)[index]
    if known is not None:
        if index == 1 and source.how:
            return source.how
        return "by geometry" if isinstance(known, CameraNoise) else "given" if index else "fixed"
    value = source.prior.values.reshape(2, 2)[index, KINDS.index(name.split()[-1])]
    if not np.isnan(value):
        return "fixed" if source.prior.factor == 1 else "prior"
    part = next(one for one in source.components if one.name == name)
    return "estimated" if spread.sd < MAX_RESOLVED_SPREAD * np.log(part.size.factor) else "not told apart"


def _sized(found: FoundSizes) -> list[Component]:
    """Return the components with a size that are no noise of a side: pixels, joints, groups of an arm."""
    mixture, listed = found.mixture, []
    free = {found.source.components[k].name: j for j, k in enumerate(found.model.free.tolist())}
    for part in found.source.components:
        is_group = part.name in DECLARED_AS
        if part.name not in (PIXELS, JOINT_NOISE, CAMERA_EXCESS, PICTURE_SHIFT) and not is_group:
            continue
        unit = part.size.unit or "rad"
        if part.name not in free:
            s = part.size.median
            listed.append(Component(part.name, unit, s, s, s, "given" if part.name == PIXELS else "fixed"))
            continue
        j = free[part.name]
        sd = float(np.sqrt(mixture.covariance_theta[j, j]))
        spread = _Spread(float(mixture.mean_theta[j]), float(found.spreads[j]), mixture.theta[:, j])
        status = (
            "population"
            if is_group
            else "estimated"
            if sd < MAX_RESOLVED_SPREAD * np.log(part.size.factor)
            else "not told apart"
        )
        listed.append(spread.component(part.name, unit, status))
    return listed


def _of_model(found: FoundSizes) -> tuple[FoundComponent, ...]:
    """Return all components with their sizes, in rad and m, and what they do to X."""
    mixture, model, source = found.mixture, found.model, found.source
    free = {k: j for j, k in enumerate(model.free.tolist())}
    shares, units = model.shares(mixture.mean_theta), {error.name: float(error.sd[0]) for error in source.errors}
    listed = []
    for k, part in enumerate(source.components):
        log, sd = float(np.log(max(part.size.median, 1e-300))), 0.0
        if k in free:
            j = free[k]
            log, sd = float(mixture.mean_theta[j]), float(found.spreads[j])
        size, low, high = (
            units.get(part.name, 1.0) * float(np.exp(log + z * sd)) for z in (0.0, -INTERVAL_SD, INTERVAL_SD)
        )
        unit = SIZES[part.name].unit if part.name in SIZES else part.size.unit
        determined, share = float(found.mode.state.determined[k]), float(shares[k])
        listed.append(
            FoundComponent(part.name, part.side, unit, size, low, high, k not in free, part.count, determined, share)
        )
    return tuple(listed)


def _findings(found: FoundSizes, parts: dict[str, Component]) -> tuple[Finding, ...]:
    sides = found.source.sides
    if found.source.camera is not None:
        return beside_camera_findings(parts, 6.0 * len(found.kept) - found.model.p)
    if len(parts) < 6 or any(
        part.status not in ("fixed", "prior", "estimated", "not told apart") for part in parts.values()
    ):
        return ()
    told = not any(parts[f"{side} rotation"].status == "not told apart" for side in sides)
    width = MAX_RESOLVED_SPREAD * float(np.log(found.source.prior.factor))
    sheet = frozenset(name for name, part in parts.items() if _by_sheet(part, width))
    return noise_findings(parts, sides, told, sheet)


def _by_sheet(part: Component, width: float) -> bool:
    """Return whether the data sheet decides: the noise is as uncertain as it says (``width`` of the logarithm)."""
    if part.status == "fixed":
        return True
    if part.status != "prior" or part.high is None:
        return False
    return part.low == part.high or float(np.log(part.high / part.low)) / (2.0 * INTERVAL_SD) > width


def _exact(found: FoundSizes) -> NoiseEstimate:
    sides = found.source.sides
    names = [what for what, is_exact in zip(KINDS, found.exact, strict=True) if is_exact]
    components = tuple(
        Component(together(what, sides), UNITS[what], 0.0, 0.0, None, "exact" if what in names else "not estimated")
        for what in KINDS
    )
    findings = (Finding("noise_estimation.exact", "note", {"parts": names}),)
    dof = 6.0 * len(found.kept) - found.model.p
    return NoiseEstimate(None, components, findings, np.zeros(3), np.zeros((3, 3)), dof)
