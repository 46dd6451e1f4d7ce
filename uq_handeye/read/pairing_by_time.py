"""Pairing of poses from synchronised clocks by time: the nearest within a tolerance, one to one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.checks import is_number
from ..core.geometry.se3 import Array
from ..core.limits import MIN_POSES
from ..core.rounding import TINY
from ..errors import InputError
from ..formats.contents import Side

# Rows are synchronous within this: rounding of printed times, in which an arm at 1 m/s moves by a micrometre.
SYNCHRONOUS_S = 1e-6


class Match(NamedTuple):
    """Rows (n,) of both sides that belong together, in the order of time, and what was left out, in words."""

    robot: NDArray[np.intp]
    camera: NDArray[np.intp]
    notes: tuple[str, ...]


def match_times(robot: Side, camera: Side, tolerance: float) -> Match:
    """Return the rows of robot and camera that are each other's nearest in time, at most ``tolerance`` seconds apart.

    Both may be in any order. Raises `InputError` if fewer than three remain, which says why: no common time, a
    difference beyond the tolerance, clocks that count in other units.
    """
    check_tolerance(tolerance)
    r, c = robot.timestamps, camera.timestamps
    for side, times in ((robot, r), (camera, c)):
        if times is None:
            raise InputError(f"{side.name} has no timestamps, so its poses cannot be paired by time; use --pair rows.")
    assert r is not None and c is not None
    of_robot, of_camera = nearest(r, c), nearest(c, r)
    mutual = of_camera[of_robot] == np.arange(len(r))
    rows = np.flatnonzero(mutual & (np.abs(r - c[of_robot]) <= tolerance))
    rows = rows[np.argsort(r[rows], kind="stable")]
    partners = of_robot[rows]
    if len(rows) < MIN_POSES:
        raise InputError(_too_few(robot, camera, r, c, tolerance, len(rows)))
    difference = np.abs(r[rows] - c[partners])
    notes = [
        f"{len(rows)} pairs by time: |robot - camera| is {np.median(difference):.3g} s (median), "
        f"{difference.max():.3g} s (largest)"
    ]
    for role, side, used in (("robot", robot, rows), ("camera", camera, partners)):
        left = np.setdiff1d(np.arange(len(side)), used)
        if left.size:
            numbers = [side.at(k).removeprefix(f"{side.name}, {side.counted} ") for k in left[:8]]
            more = f" and {left.size - 8} more" if left.size > 8 else ""
            notes.append(
                f"{left.size} of {len(side)} {role} poses left out, without a partner within {tolerance:g} s: "
                f"{side.counted} {', '.join(numbers)}{more}"
            )
    return Match(rows, partners, tuple(notes))


def check_tolerance(tolerance: float) -> None:
    """Raise `InputError` unless it is a number of seconds."""
    if not is_number(tolerance):
        raise InputError(f"Expected `tolerance` (--time-tolerance) to be a number of seconds, got {tolerance!r}.")
    if not 0 <= tolerance < np.inf:
        raise InputError(f"Expected `tolerance` (--time-tolerance) to be at least 0 s and finite, got {tolerance!r}.")


def nearest(times: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return for each time the index of the nearest among the others."""
    order = np.argsort(others, kind="stable")
    ordered = others[order]
    right = np.clip(np.searchsorted(ordered, times), 1, max(1, len(others) - 1))
    right = np.minimum(right, len(others) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(np.abs(times - ordered[left]) <= np.abs(ordered[right] - times), left, right)
    return np.asarray(order[nearer])


def _too_few(robot: Side, camera: Side, r: Array, c: Array, tolerance: float, n: int) -> str:
    start = (
        f"Pairing by time leaves {n} of {len(r)} robot and {len(c)} camera poses, and at least {MIN_POSES} are needed: "
    )
    if r.min() > c.max() or c.min() > r.max():
        text = (
            f"the times of {robot.name} ({r.min():.10g} to {r.max():.10g} s) and of {camera.name} ({c.min():.10g} to "
            f"{c.max():.10g} s) have nothing in common. "
        )
        if counting := _other_unit(robot, camera, r, c):
            return f"{start}{text}{counting}; timestamps are in seconds."
        return (
            f"{start}{text}If the clocks are apart, use --pair async, which estimates the offset; if the rows belong "
            "together, --pair rows and the same timestamps in both."
        )
    what = f"no others are within {tolerance:g} s of each other"
    if not n:
        closest = float(np.min(np.abs(r - c[nearest(r, c)])))
        what = f"the closest two are {closest:.3g} s apart, and the tolerance is {tolerance:g} s"
    return (
        f"{start}{what}. Raise --time-tolerance if the rig stood still; if it moved, use --pair async, which "
        "interpolates."
    )


def _other_unit(robot: Side, camera: Side, r: Array, c: Array) -> str:
    """Say in which unit one file seems to count, by its times and by the steps between them; or nothing."""

    def size(times: Array) -> float:
        return float(np.log10(max(np.median(np.abs(times)) if len(times) else 0.0, TINY)))

    magnitude, step = size(r) - size(c), size(np.diff(np.sort(r))) - size(np.diff(np.sort(c)))
    for unit, power in (("ms", 3.0), ("us", 6.0), ("ns", 9.0)):
        for sign, name in ((1.0, robot.name), (-1.0, camera.name)):
            if abs(sign * magnitude - power) < 0.3 and abs(sign * step - power) < 1.0:
                return f"{name} seems to count {unit}"
    return ""
