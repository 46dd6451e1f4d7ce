"""Checks of two time-stamped streams: units, time in common, coarse clocks, and poses that have no partner."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.files.json_values import JsonObject
from ...core.geometry.se3 import Array
from ...errors import InputError
from ...findings import Finding
from .interpolation import AFTER, BEFORE, GAP, Interpolated
from .sentences import left_out_words

# Median intervals of the denser stream outside these are no seconds; the sparser one may be ten times as sparse.
MIN_INTERVAL_S, MAX_INTERVAL_S = 2e-5, 1.0
# Poses that are taken one by one follow each other within some minutes.
MAX_SINGLE_POSE_INTERVAL_S = 600.0


class LeftOut(NamedTuple):
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

    def to_dict(self) -> JsonObject:
        """Plain values; the finding as its own."""
        return {"side": self.side, "times": list(self.times), "why": self.why.to_dict()}


def check_units(robot: float, camera: float) -> None:
    """Raise `InputError` unless the median intervals look like seconds."""
    intervals = {"robot": robot, "camera": camera}
    dense, sparse = sorted(intervals, key=lambda name: intervals[name])
    for name, most in ((dense, MAX_INTERVAL_S), (sparse, 10 * MAX_INTERVAL_S)):
        interval = intervals[name]
        if MIN_INTERVAL_S <= interval <= most:
            continue
        units = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
        unit = next((unit for unit, length in units.items() if interval * length <= MAX_INTERVAL_S), None)
        guess = f" They look like {unit}: multiply them by {units[unit]:g}." if unit and interval > most else ""
        if most < interval <= MAX_SINGLE_POSE_INTERVAL_S and min(intervals.values()) > MAX_INTERVAL_S:
            guess = (
                " Poses that were taken one by one are paired, not interpolated: by their times (--pair time) or by "
                f"their rows (--pair rows).{guess.replace('They look like', 'Or they are in')}"
            )
        raise InputError(
            f"Expected the timestamps of both streams in seconds, with poses {MIN_INTERVAL_S:g} to {most:g} s apart, "
            f"got a median interval of {interval:.4g} for the {name}.{guess}"
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
    """Return the resolution (s) of a clock that is coarse for its intervals and does not tick evenly; else None."""
    intervals = np.diff(times)
    if len(intervals) < 3 or np.ptp(intervals) < 1e-6:
        return None
    for q in (0.1, 0.01, 0.001):
        multiples = times / q
        if np.abs(multiples - np.round(multiples)).max() < 1e-3:
            return q if q > 0.02 * float(np.median(intervals)) else None
    return None


def left_out(
    found: Interpolated, base: str, base_times: Array, side: str, side_times: Array, max_gap: float
) -> tuple[LeftOut, ...]:
    """Report the poses of the ``base`` stream at whose times the other ``side`` has no pose."""
    parts: list[LeftOut] = []

    def part(rows: NDArray[np.intp], what: str, gap: bool = True, **values: float) -> None:
        why = Finding(f"synchronisation.{what}", "note", {"other": side, **values})
        parts.append(LeftOut(base, tuple(base_times[rows].tolist()), why, gap))

    for code, what in ((BEFORE, "before_other"), (AFTER, "after_other")):
        if (rows := np.flatnonzero(found.problem == code)).size:
            part(rows, what, gap=False)
    rows = np.flatnonzero(found.problem >= GAP)
    for left in np.unique(found.left[rows]):
        inside = rows[found.left[rows] == left]
        ends = {"begin": side_times[left], "end": side_times[left + 1]}
        if found.problem[inside[0]] == GAP:
            part(inside, "in_gap", **ends, max_gap=max_gap)
        else:
            part(inside, "in_half_turn", **ends)
    return tuple(parts)
