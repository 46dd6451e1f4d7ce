"""Input quantities of an uncertainty budget: what each source is, its distribution, its standard uncertainty."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...calibration.result import Calibration
from ...calibration.statement.included import shared_groups, sizes_of
from ...core.formatting.numbers import digits
from ...core.geometry.se3 import Array
from ...fit.diagnostics.budget import EACH
from ...fit.diagnostics.budget import SHARED as SHARED_SOURCE
from ...model.kinematics.kinematic_errors import JOINT_NOISE
from ...model.noise.estimate import SHOWN, Component, NoiseEstimate
from ...model.noise.joint_covariance import JointCovariance, group_of
from ...model.noise.models import INTRINSICS, TARGET_SHAPE, marginals
from ...model.shared_errors.shared_error import CLOCK_OFFSET
from ...model.shared_errors.sizes import ROBOT_ACCURACY

KINDS = ("rotation", "translation")
SIDES = ("robot", "camera", "A", "B")
NORMAL = "normal"


@dataclass(frozen=True)
class Input:
    """One input of a budget: its standard uncertainty in words, its distribution, and where both come from."""

    uncertainty: str
    distribution: str
    origin: str


def input_of(source: str, result: Calibration) -> Input:
    """Return the input behind a source of the budget; sources that were merged have their names joined by `` + ``."""
    names = source.split(" + ")
    estimate = result.noise_estimate
    if estimate is not None and (found := _estimated(names, estimate)) is not None:
        return found
    if all(name.partition(" ")[0] in SIDES for name in names):
        kind = names[0].partition(" ")[2]
        if kind.startswith((*KINDS, EACH, SHARED_SOURCE, "coupling", "(rotation")):
            return _of_noise(names, result)
    name = names[0]
    if name == CLOCK_OFFSET and result.time_offset is not None:
        return Input(f"{digits(1e3 * result.time_offset.std, 2)} ms", NORMAL, "the two streams")
    for group in shared_groups(result):
        if name in (group.name, group_of(group.name), group.parts[0].error):
            return _shared(group.parts[0].error, sizes_of(group), group.default)
    if name == JOINT_NOISE and result.kinematics is not None:
        return Input(_sizes([(result.kinematics.joint_noise, "rad")]), NORMAL, "declared")
    if name.startswith("noise of the poses"):
        return Input("covariance", NORMAL, "declared" if estimate is None else _ESTIMATED)
    if group_of(name) == INTRINSICS:
        return Input("covariance", NORMAL, "camera calibration")
    if group_of(name) == TARGET_SHAPE:
        return Input("covariance", NORMAL, "points of the target")
    if name.startswith("prior of "):
        return Input("covariance", NORMAL, "declared")
    return Input("covariance", NORMAL, "as given with the noise")


def _shared(error: str, size: str, default: bool) -> Input:
    origin = "assumed" if default else "declared"
    if error == ROBOT_ACCURACY:
        return Input(f"{size} (RMS)", "normal, smooth over the pose", origin)
    return Input(size, NORMAL, origin)


def _estimated(names: list[str], estimate: NoiseEstimate) -> Input | None:
    """Return the input of noise components that belong to these sources; None where none does."""
    parts = [part for part in estimate.components if any(_belongs(part, name) for name in names)]
    if len(names) > 1:  # what cannot be separated is known as a sum
        kind = names[0].partition(" ")[2]
        parts = [part for part in estimate.components if part.name.startswith(f"{kind}, ")] or parts
    if not parts:
        return None
    parts = parts[:2]
    return Input(_sizes((part.value, part.unit) for part in parts), NORMAL, _ORIGIN.get(parts[0].status, _ESTIMATED))


_ESTIMATED = "residuals (REML)"
_ORIGIN = {
    "prior": "data sheet, residuals",
    "population": "arms of the kind, residuals",
    "fixed": "declared",
    "given": "declared",
    "from corners": "corners of the target",
    "from points": "points of the target",
    "by geometry": "residuals, views",
}


def _belongs(part: Component, source: str) -> bool:
    """Return whether a component is that of a source: of the same name, or one of its two kinds."""
    side, _, kind = source.partition(" ")
    of_both = kind.startswith((EACH, "(rotation")) and part.name in (f"{side} {KINDS[0]}", f"{side} {KINDS[1]}")
    of_pixels = part.unit == "px" and (group_of(source) == INTRINSICS or side == "camera")
    return part.name == source or part.name.startswith(f"{source}, ") or of_both or of_pixels


def _of_noise(names: list[str], result: Calibration) -> Input:
    """Return the noise of one side as given: standard deviations per axis, on average over axes and poses."""
    squares = np.zeros(2)
    for name in dict.fromkeys(name.partition(" ")[0] for name in names):
        S = getattr(result.noise, name, None)
        if S is not None:
            squares += np.square(noise_per_axis(S))
    sizes = [(float(size), unit) for size, unit in zip(np.sqrt(squares), ("rad", "m"), strict=True)]
    kind = names[0].partition(" ")[2]
    corners = getattr(result.data, "camera_calibration", None) is not None and names[0].startswith("camera")
    points = getattr(result.data, "camera_covariance", None) is not None and names[0].startswith("camera")
    if kind.startswith(SHARED_SOURCE):
        return Input("covariance", NORMAL, "camera calibration" if corners else "as given with the noise")
    shown = [sizes[KINDS.index(kind)]] if kind in KINDS else sizes
    return Input(
        _sizes(shown), NORMAL, "corners of the target" if corners else "points of the target" if points else "declared"
    )


def noise_per_axis(S: Array | JointCovariance) -> Array:
    """Return the standard deviations (2,) of rotation (rad) and translation (m) of what each pose has by itself, on
    average over axes and poses.
    """
    blocks = S.own if isinstance(S, JointCovariance) else marginals(S)
    variances = np.diagonal(blocks, axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
    return np.asarray(np.sqrt(variances))


def _sizes(sizes: Iterable[tuple[float, str]]) -> str:
    return ", ".join(f"{digits(SHOWN[unit][0] * size, 2)} {SHOWN[unit][1]}" for size, unit in sizes)
