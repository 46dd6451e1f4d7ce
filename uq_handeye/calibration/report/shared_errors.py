"""Errors that all poses share, including the time offset, as a table and as text.

For each error the table has the assumed and the estimated value; the text says which errors the total includes.
"""

from __future__ import annotations

import numpy as np

from ...core.presentation.document import (
    Block,
    Cell,
    Points,
    Table,
)
from ...core.presentation.numbers import concise, digits
from ...fit.diagnostics.sentences import relative
from ...model.errors.error_estimate import IN_NOISE, ErrorEstimate
from ...model.errors.keys import CLOCK_OFFSET, ROBOT_SCALE, TARGET_SCALE
from ...model.shared_errors.shared_error import WRONG_SIZE
from ..checks import included, shared_groups, sizes_of
from ..result import Calibration
from .arm import reported_words

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
    parts = () if result.noise_estimate is None else result.noise_estimate.components
    of_population = {part.key for part in parts if part.status == "population"}
    rows: list[list[Cell]] = [_declared(group, group.key.error in of_population) for group in groups]
    if (found := result.time_offset) is not None and found.std > 0:
        known = concise(1e3 * found.offset, 1e3 * found.std, "ms")
        rows.append([str(CLOCK_OFFSET), "estimated from the streams", known, f"{100 * found.share:.1f} %"])
    if result.analysis is not None:
        keys = {error.key for error in result.shared}
        rows += [
            [probe.name, (_undeclared(probe), 3)] for probe in result.analysis.diagnostics.probes
            if probe.key not in keys
        ]  # fmt: skip
    caption = CAPTION + (OF_MANY if any(group.count > 1 for group in groups) else "")
    return Table(caption, ["error", "assumed", "found", "share"], rows, frozenset({1})) if rows else None


def shared_blocks(result: Calibration) -> list[Block]:
    """The table of shared errors, with the explanations that belong to it."""
    table = shared_table(result)
    notes = [str(found) for found in result.findings if found.code in SHARED_CODES and found.severity == "note"]
    if look_alike(result):
        notes.append("Target scale and robot scale have the same effect on the residuals and cannot be separated.")
    notes += [text for text in (offset_sentence(result), reported_words(result)) if text]
    return [*([] if table is None else [table]), *([Points(notes)] if notes else [])]


def look_alike(result: Calibration) -> bool:
    """Return whether the residuals indicate a scale that may be the target's or the robot's."""
    asked = set() if result.analysis is None else {probe.key for probe in result.analysis.diagnostics.asked_for}
    asked |= {error.key for error in result.shared if error.key == TARGET_SCALE and error.beyond(WRONG_SIZE) > 0.5}
    return bool(asked & {TARGET_SCALE, ROBOT_SCALE})


def _declared(group: ErrorEstimate, estimated: bool) -> list[Cell]:
    how = "estimated" if estimated else "default" if group.default else "declared"
    share = f"{100 * group.share:.1f} %"
    if group.count > 1:
        return [f"{group.name} ({group.count})", f"{sizes_of(group)} ({how})", found_of(group), share]
    error = group.parts[0]
    factor, unit = error.shown
    found = concise(factor * error.estimate, factor * error.sd, unit)
    return [error.name, f"{amount(error)} ({how})", found, share]


def found_of(group: ErrorEstimate) -> str:
    """RMS of the estimates of a group, and the share of it that the data resolved."""
    sizes = (f"{digits(float(np.sqrt(np.mean(group.of_unit(unit)[1] ** 2))), 2)} {unit}" for unit in group.units)
    if group.parts[0].stated:
        return f"told {100 * group.resolved:.0f} %"
    rms = ", ".join(size.rstrip() for size in sizes)
    return f"RMS {rms}; told {100 * group.resolved:.0f} %"


def _undeclared(probe: ErrorEstimate) -> str:
    if probe.status == IN_NOISE:
        return "in the covariance of the camera poses, with the other intrinsics"
    if not probe.effect.size:
        return "not declared: the distances from camera to target are not known"
    move = f"0.1 % moves X by {digits(float(np.sqrt(probe.share)), 2)} of its standard deviations"
    if probe.alone is None or probe.alone_sd is None:
        return f"not declared: the residuals do not show it; {move}"
    return f"not declared: the residuals indicate {relative(probe.alone, probe.alone_sd)}; {move}"


def amount(error: ErrorEstimate) -> str:
    """The standard deviation assumed, in the unit that people read."""
    factor, unit = error.shown
    return f"{digits(factor * error.size, 2)} {unit}".rstrip()


def included_words(result: Calibration) -> str:
    """Return a sentence with the shared errors that the covariance of X includes."""
    parts = included(result)
    defaults = sum(default for _, _, default in parts)
    if not parts:
        return "Errors that all poses share are not included."
    said = {0: "", len(parts): " (defaults)" if len(parts) > 1 else " (default)"}.get(defaults)
    named = [part if said is not None or not default else f"{part} (default)" for _, part, default in parts]
    return f"This total includes what all poses share: {', '.join(named)}{said or ''}."


def offset_sentence(result: Calibration) -> str:
    """Return a sentence with the contribution of the time offset to the covariance of X; empty where there is none."""
    found = result.time_offset
    if found is None:
        return ""
    if found.std == 0:
        said = "taken as exact, as given: its uncertainty is not in the covariance of X."
        return f"Time offset: {1e3 * found.offset:.6g} ms, {said}"
    move = found.std * np.array(found.sensitivity)
    if not move.any():
        said = "The robot stands still at these poses: the offset does not matter for X."
        return f"Time offset: {concise(1e3 * found.offset, 1e3 * found.std, 'ms')}. {said}"
    turn, shift = np.degrees(np.linalg.norm(move[:3])), 1e3 * np.linalg.norm(move[3:])
    return (
        f"Time offset: {concise(1e3 * found.offset, 1e3 * found.std, 'ms')} (robot_time = camera_time + offset; the "
        f"{found.side} was interpolated). One standard deviation of it moves X by {digits(turn, 2)} deg and "
        f"{digits(float(shift), 2)} mm; this is in the covariance of X, where it makes up "
        f"{100 * found.share:.2g} % of the variance in the direction in which it counts most."
    )
