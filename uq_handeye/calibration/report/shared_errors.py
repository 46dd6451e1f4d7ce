"""Errors that all poses share, as a table, and in words what the total includes of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...diagnostics.scale_errors import ScaleError
from ...diagnostics.sentences import relative
from ...formatting.numbers import concise, digits
from ...kinematics.kinematic_errors import DECLARED_AS
from ...likelihood.shared_estimates import SharedEstimate
from ...likelihood.shared_groups import SharedGroup, grouped
from ...noise.camera_noise import INTRINSICS
from ...noise.joint_covariance import JointCovariance, group_of
from ...noise.models import PoseNoise, is_joint
from ...presentation.document import Block, Cell, Points, Table
from ...shared_errors.accuracy_field import ROBOT_ACCURACY
from ...shared_errors.shared_error import CLOCK_OFFSET, ROBOT_SCALE, TARGET_SCALE
from ..result import Calibration
from .time_offset import offset_sentence

CAPTION = (
    "Errors that all poses share: standard deviation assumed, estimate with its standard deviation in brackets after "
    "the fit, and share of the variance of X in the direction where it counts most. An error is used / true - 1 for "
    "lengths: +1 % says that the true value is 1 % smaller than the one used."
)
OF_MANY = (
    " An error of many numbers is one row: the standard deviation assumed of each, the root mean square (RMS) of the "
    "estimates, how much of the variance assumed the data took away, and the share of all numbers together."
)
# Findings that belong to the table.
SHARED_CODES = ("calibration.shared_confounded", "calibration.shared_opens")


def shared_table(result: Calibration) -> Table | None:
    """One row for each error that was declared or assumed, then those that were not; None where nothing is known."""
    groups = shared_groups(result)
    rows: list[list[Cell]] = [_declared(group, group.parts[0].error in _of_population(result)) for group in groups]
    if (found := result.time_offset) is not None and found.std > 0:
        known = concise(1e3 * found.offset, 1e3 * found.std, "ms")
        rows.append([CLOCK_OFFSET, "estimated from the streams", known, f"{100 * found.share:.1f} %"])
    if result.analysis is not None:
        names = {error.name for error in result.shared}
        rows += [
            [probe.name, (_undeclared(probe), 3)] for probe in result.analysis.diagnostics.probes
            if probe.name not in names
        ]  # fmt: skip
    caption = CAPTION + (OF_MANY if any(group.count > 1 for group in groups) else "")
    return Table(caption, ["error", "assumed", "found", "share"], rows, frozenset({1})) if rows else None


def _of_population(result: Calibration) -> set[str]:
    """The groups of errors of an arm whose deviations were estimated, at least those of such arms."""
    parts = () if result.noise_estimate is None else result.noise_estimate.components
    return {part.name for part in parts if part.status == "population"}


def shared_groups(result: Calibration) -> list[SharedGroup]:
    """The shared errors of a result, those of many numbers as one."""
    carried = any(group_of(error.name) == ROBOT_ACCURACY for error in result.shared)  # no part of the bound
    return grouped(result.shared, result.covariance if carried or result.bound is None else result.bound)


def shared_blocks(result: Calibration) -> list[Block]:
    """The table, and what is to be known beside it."""
    table = shared_table(result)
    notes = [str(found) for found in result.findings if found.code in SHARED_CODES and found.severity == "note"]
    if look_alike(result):
        notes.append("Target scale and robot scale act on the residuals alike: the data cannot tell which is wrong.")
    if text := offset_sentence(result):
        notes.append(text)
    return [*([] if table is None else [table]), *([Points(notes)] if notes else [])]


def look_alike(result: Calibration) -> bool:
    """Whether the residuals ask for a scale, of which they cannot say whether it is the target's or the robot's."""
    asked = {probe.name for probe in _probes(result) if probe.asked_for}
    asked |= {error.name for error in result.shared if error.wide is not None and error.wide > 0.5}
    return bool(asked & {TARGET_SCALE, ROBOT_SCALE})


def _probes(result: Calibration) -> Sequence[ScaleError]:
    return () if result.analysis is None else result.analysis.diagnostics.probes


def _declared(group: SharedGroup, estimated: bool) -> list[Cell]:
    how = "estimated" if estimated else "default" if group.default else "declared"
    share = f"{100 * group.share:.1f} %"
    if group.count > 1:
        return [f"{group.name} ({group.count})", f"{sizes_of(group)} ({how})", found_of(group), share]
    error = group.parts[0]
    factor, unit = error.shown
    found = concise(factor * error.estimate, factor * error.sd, unit)
    return [error.name, f"{amount(error)} ({how})", found, share]


def sizes_of(group: SharedGroup) -> str:
    """The standard deviations assumed of the numbers of a group: one, or from the smallest to the largest."""
    if group.parts[0].stated:
        return group.parts[0].stated
    found = []
    for unit in group.units:
        prior = group.of_unit(unit)[0]
        ends = list(dict.fromkeys(digits(end, 2) for end in (prior.min(), prior.max())))
        found.append(f"{' to '.join(ends)} {unit}".rstrip())
    return ", ".join(found)


def found_of(group: SharedGroup) -> str:
    """RMS of the estimates of a group, and how much the data told of it."""
    sizes = (f"{digits(float(np.sqrt(np.mean(group.of_unit(unit)[1] ** 2))), 2)} {unit}" for unit in group.units)
    if group.parts[0].stated:
        return "not asked of the data"
    rms = ", ".join(size.rstrip() for size in sizes)
    return f"RMS {rms}; told {100 * group.told:.0f} %"


def _undeclared(probe: ScaleError) -> str:
    if probe.covered:
        return "in the covariance of the camera poses, with the other intrinsics"
    if probe.reason is not None:
        return "not declared: the distances from camera to target are not known"
    move = f"0.1 % moves X by {digits(probe.shift_sd, 2)} of its standard deviations"
    if not probe.visible:
        return f"not declared: the residuals do not show it; {move}"
    return f"not declared: the residuals ask for {relative(probe.estimate, probe.sd)}; {move}"


def amount(error: SharedEstimate) -> str:
    """The standard deviation assumed, in the unit that people read."""
    factor, unit = error.shown
    return f"{digits(factor * error.prior_sd, 2)} {unit}".rstrip()


# -------------------------------------------------------------------------------------------- what the total includes


def included_words(result: Calibration) -> str:
    """Which shared errors the covariance of X includes, as a sentence."""
    parts, defaults = _included(result)
    if not parts:
        return "Errors that all poses share are not included."
    said = {0: "", len(parts): " (defaults)" if len(parts) > 1 else " (default)"}.get(defaults)
    named = [part if said is not None or not default else f"{part} (default)" for part, default in parts]
    return f"This total includes what all poses share: {', '.join(named)}{said or ''}."


def _included(result: Calibration) -> tuple[list[tuple[str, bool]], int]:
    """What is included, whether by default; and how many are by default."""
    parts: list[tuple[str, bool]] = []
    if of_camera(result):
        parts.append(("errors of the intrinsics", False))
    elif isinstance(result.noise, PoseNoise) and _unnamed(result.noise):
        parts.append(("the joint covariance of the noise", False))
    groups: dict[str, list[SharedGroup]] = {}  # by error: such as both coordinates of the principal point
    for group in shared_groups(result):
        groups.setdefault(group.parts[0].error, []).append(group)
    of_arm = [name for name in groups if name in DECLARED_AS]
    if of_arm:
        parts.append((f"errors of the arm ({', '.join(of_arm)})", False))
    for name, of_error in groups.items():
        if name in of_arm:
            continue
        sizes = list(dict.fromkeys(map(sizes_of, of_error)))
        parts.append((f"{name} {' and '.join(sizes)}", of_error[0].default))
    parts += [(name, False) for name in dict.fromkeys(map(group_of, column_names(result))) if not groups]
    if result.time_offset is not None and result.time_offset.std > 0:
        parts.append((f"{CLOCK_OFFSET} {digits(1e3 * result.time_offset.std, 2)} ms", False))
    return parts, sum(default for _, default in parts)


def column_names(result: Calibration) -> tuple[str, ...]:
    """The names of the shared errors that the noise holds, without those of the intrinsics."""
    if not isinstance(result.noise, PoseNoise):
        return ()
    joint = [S for S in (result.noise.robot, result.noise.camera) if isinstance(S, JointCovariance)]
    return tuple(name for S in joint for name in S.names if name not in ("", INTRINSICS))


def of_camera(result: Calibration) -> bool:
    """Whether the noise of the camera poses holds the errors of the intrinsics, from corners or by geometry."""
    S = result.noise.camera if isinstance(result.noise, PoseNoise) else None
    return isinstance(S, JointCovariance) and bool({INTRINSICS, ""} & set(S.names))


def _unnamed(noise: PoseNoise) -> bool:
    """Whether a side has a joint covariance that was given as such."""
    joint = [S for S in (noise.robot, noise.camera) if S is not None and is_joint(S)]
    return any(not isinstance(S, JointCovariance) or "" in S.names for S in joint)
