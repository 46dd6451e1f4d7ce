"""Checks of two time-stamped streams before anything is computed: units, common time, coarse clocks, gaps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...errors import InputError
from ...findings import Finding
from .interpolation import AFTER, BEFORE, GAP, Interpolated
from .sentences import left_out_words

# Median intervals (s) of the denser and of the sparser stream beyond which the times are not in seconds.
DENSE, SPARSE, TOO_DENSE = 1.0, 10.0, 2e-5
# Units that timestamps come in, by their length in seconds.
UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
# Intervals (s) that such a unit should make of the times.
USUAL = (5e-4, 1.0)
# Resolutions of clocks that are looked for (s).
RESOLUTIONS = (0.1, 0.01, 0.001)


@dataclass(frozen=True)
class LeftOut:
    """Poses of one stream that have no partner in the other."""

    side: str  # "robot" or "camera"
    times: tuple[float, ...]  # s, on the clock of their stream
    why: Finding
    gap: bool  # within the time that both streams share

    @property
    def reason(self) -> str:
        """Reason in words."""
        return str(self.why)

    def __str__(self) -> str:
        return left_out_words(self.side, self.times, self.why)

    def to_dict(self) -> dict[str, Any]:
        """Plain values; the finding as its own."""
        return {"side": self.side, "times": list(self.times), "why": self.why.to_dict()}


def check_units(robot: float, camera: float) -> None:
    """Raise `InputError` unless the median intervals look like seconds."""
    intervals = {"robot": robot, "camera": camera}
    dense, sparse = sorted(intervals, key=lambda name: intervals[name])
    for name, most in ((dense, DENSE), (sparse, SPARSE)):
        interval = intervals[name]
        if TOO_DENSE <= interval <= most:
            continue
        unit = next((unit for unit, s in UNITS.items() if USUAL[0] <= interval * s <= USUAL[1]), None)
        guess = f" They look like {unit}: multiply them by {UNITS[unit]:g}." if unit and interval > most else ""
        raise InputError(
            f"Expected the timestamps of both streams in seconds, with poses {TOO_DENSE:g} to {most:g} s apart, got a "
            f"median interval of {interval:.4g} for the {name}.{guess}"
        )


def common_time(robot: Array, camera: Array, reach: float, shift: float) -> float:
    """Return the longest time (s) that the streams share with offsets of ``shift`` +- ``reach``; raises if they do
    not.
    """
    begin = max(float(robot[0]), float(camera[0]) + shift)
    end = min(float(robot[-1]), float(camera[-1]) + shift)
    ranges = (
        f"the robot is from {robot[0]:.3f} to {robot[-1]:.3f} s, the camera from {camera[0]:.3f} to {camera[-1]:.3f} s"
    )
    if end <= begin - reach:
        on = f" at an offset of {shift:g} s" if shift else ""
        raise InputError(
            f"Expected streams that have some time in common, got none{on}: {ranges}. If their clocks differ, give "
            "`offset` (--offset; robot_time = camera_time + offset), or look for any by max_offset=math.inf "
            "(uq-handeye sync --max-offset inf)."
        )
    return max(end - begin, 0.0)


def coarse_clock(times: Array) -> float | None:
    """The resolution (s) of a clock that is coarse beside the intervals and does not tick evenly; else None."""
    intervals = np.diff(times)
    if len(intervals) < 3 or np.ptp(intervals) < 1e-6:
        return None
    for q in RESOLUTIONS:
        multiples = times / q
        if np.abs(multiples - np.round(multiples)).max() < 1e-3:
            return q if q > 0.02 * float(np.median(intervals)) else None
    return None


def left_out(
    found: Interpolated, base: str, base_times: Array, side: str, side_times: Array, max_gap: float
) -> tuple[LeftOut, ...]:
    """Report the poses of the ``base`` stream at whose times the other ``side`` has no pose."""
    parts: list[LeftOut] = []
    for code, what in ((BEFORE, "before_other"), (AFTER, "after_other")):
        rows = np.flatnonzero(found.problem == code)
        if rows.size:
            why = Finding(f"synchronisation.{what}", "note", {"other": side})
            parts.append(_part(base, base_times, rows, why, gap=False))
    rows = np.flatnonzero(found.problem >= GAP)
    for left in np.unique(found.left[rows]):
        inside = rows[found.left[rows] == left]
        values = {"other": side, "begin": side_times[left], "end": side_times[left + 1]}
        if found.problem[inside[0]] == GAP:
            why = Finding("synchronisation.in_gap", "note", values | {"max_gap": max_gap})
        else:
            why = Finding("synchronisation.in_half_turn", "note", values)
        parts.append(_part(base, base_times, inside, why, gap=True))
    return tuple(parts)


def _part(side: str, times: Array, rows: NDArray[np.intp], why: Finding, gap: bool) -> LeftOut:
    return LeftOut(side, tuple(float(t) for t in times[rows]), why, gap)
