"""Pairing of poses by rows, and checks of the names, file numbers and timestamps that may contradict it."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from ..core.files.open import shown
from ..core.geometry.se3 import Array
from ..core.limits import MAX_LISTED, MAX_ROWS, MIN_POSES_TO_DECIDE
from ..errors import InputError, InputWarning
from ..formats.contents import Side
from ..formats.rotations import RotationForm, rotation_form
from ..model.poses.residuals import rotation_angles
from .pairing_by_time import SYNCHRONOUS_S

# Rows belong together by time if they differ by less than this share of the interval between rows.
SAME_TIME_SHARE = 0.3
# Differences of angles count up to this (rad), and a row is the one that lacks a partner if the next best fits worse by
# the inverse of this ratio.
LARGE_RAD, CLEAR_RATIO = np.radians(10.0), 0.5


def check_rows(robot: Side, camera: Side, by_request: bool) -> tuple[str, ...]:
    """Raise or warn unless row k of both sides may be of the same moment; return what was found out.

    Timestamps say nothing of it where one side numbers its rows 0, 1, 2, ... and the other has times, and where two
    clocks have no time in common and differ by the same in all rows. Rows that are paired
    ``by_request`` belong together whatever the timestamps say, which is then a warning.
    """
    if not by_request:
        _check_numbers(robot, camera)
    require_as_many(robot, camera)
    n = len(robot)
    if robot.timestamps is None or camera.timestamps is None:
        return ()
    ours, theirs = robot.timestamps, camera.timestamps
    late = ours - theirs
    row = int(np.argmax(np.abs(late)))
    if abs(late[row]) <= SYNCHRONOUS_S:
        return ()
    apart = ours.max() < theirs.min() or theirs.max() < ours.min()
    if apart and _numbered(ours) != _numbered(theirs):
        return ()
    interval = float(np.median(np.abs(np.diff(ours)))) if n > 1 else 0.0
    offset = float(np.median(late))
    if apart and n > 1 and not _numbered(ours) and np.abs(late - offset).max() < interval / 2:
        return (f"rows paired by their order; the clocks differ by {offset:.6g} s (robot minus camera)",)
    where = (
        f"the timestamps of {robot.name} and {camera.name} differ by up to {abs(late[row]):.6g} s, in pose "
        f"{row} ({ours[row].item()!r} and {theirs[row].item()!r})"
    )
    if abs(late[row]) >= interval / 2 and not by_request:
        raise InputError(
            f'The rows do not belong to the same moments: {where}. Pair them by time (pair="time", --pair time); for '
            'clocks that differ or a rig that moves, --pair async; or, if the rows do belong together, pair="rows" '
            "(--pair rows)."
        )
    warnings.warn(
        f"Rows are paired by their order although {where}. That is right if the robot stood still.",
        InputWarning,
        stacklevel=4,
    )
    return ()


def require_as_many(robot: Side, camera: Side) -> None:
    """Raise `InputError` for different numbers of rows, with the rows that lack a partner where they can be told."""
    n, m = len(robot), len(camera)
    if n == m:
        return
    timed = robot.timestamps is not None and camera.timestamps is not None
    by_time = (
        'pair them by their timestamps (pair="time", --pair time); for streams whose clocks differ or of a rig '
        "that moves, use --pair async"
    )
    raise InputError(
        f"{robot.name} has {n} poses and {camera.name} has {m}: expected one row in each file per moment."
        f"{_without_partner(robot, camera)} Leave out poses that the other file lacks, or "
        f"{by_time if timed else 'add timestamps and use --pair time or --pair async'}."
    )


def _without_partner(robot: Side, camera: Side) -> str:
    """Return a sentence that names the rows of the longer side which the other lacks, or nothing."""
    longer, other = (robot, camera) if len(robot) > len(camera) else (camera, robot)
    rows = _by_time(longer, other)
    if rows is None:
        rows = _by_angles(longer, other)
    if not rows:
        return ""
    role = "robot" if longer is robot else "camera"
    named = []
    for row in rows[:MAX_LISTED]:
        at = longer.at(row).removeprefix(f"{longer.name}, ")
        time = "" if longer.timestamps is None else f", t = {longer.timestamps[row]:.10g}"
        named.append(f"row {row} ({at}{time})")
    more = f" and {len(rows) - MAX_LISTED} more" if len(rows) > MAX_LISTED else ""
    has = "has" if len(rows) == 1 else "have"
    return f" Of the {role}, {', '.join(named)}{more} {has} no partner."


def _by_time(longer: Side, other: Side) -> list[int] | None:
    """Return the rows of one side that are nobody's nearest in time, if the others are near; None: cannot be told."""
    if longer.timestamps is None or other.timestamps is None or len(other) < 3:
        return None
    times, theirs = longer.timestamps, other.timestamps
    if _numbered(times) or _numbered(theirs):
        return None
    nearest = np.abs(times[:, None] - theirs[None]).argmin(axis=0) if len(times) * len(theirs) < MAX_ROWS else None
    if nearest is None:
        return None
    interval = float(np.median(np.abs(np.diff(times))))
    if np.abs(times[nearest] - theirs).max() > SAME_TIME_SHARE * interval or len(set(nearest.tolist())) < len(theirs):
        return None
    return sorted(set(range(len(times))) - set(nearest.tolist()))


def _by_angles(longer: Side, other: Side) -> list[int] | None:
    """Return the one row of a side without which both rotate by the same angles from row to row; None: none does."""
    if len(longer) != len(other) + 1 or len(other) < MIN_POSES_TO_DECIDE:
        return None
    try:
        R, S = (_form_of(side).decode(side.rotation) for side in (longer, other))
    except InputError:
        return None
    theirs = rotation_angles(S[:-1].mT @ S[1:])
    costs = []
    for k in range(len(R)):
        T = np.delete(R, k, axis=0)
        costs.append(float(np.mean(np.minimum(np.abs(rotation_angles(T[:-1].mT @ T[1:]) - theirs), LARGE_RAD))))
    order = np.argsort(costs)
    clear = costs[order[0]] < CLEAR_RATIO * costs[order[1]] and costs[order[0]] < 0.2 * LARGE_RAD
    return [int(order[0])] if clear else None


def _form_of(side: Side) -> RotationForm:
    """Return the form of rotations that leave no doubt; raises `InputError` for others."""
    k = 9 if side.rotation.ndim == 3 else side.rotation.shape[1]
    if len(side.readings) > 1 or (not side.readings and k == 3):
        raise InputError("Several readings.")
    return rotation_form(side.readings[0].rotation if side.readings else {9: "matrix", 4: side.order}[k])


def _check_numbers(robot: Side, camera: Side) -> None:
    """Raise `InputError` where the numbers that both sides count their poses by say that pose k is not the same."""
    ours, theirs = set(robot.numbers), set(camera.numbers)
    if not ours or not theirs or robot.numbers == camera.numbers:
        return
    if ours == theirs:
        raise InputError(
            f"Poses are paired by their order, and {robot.name} and {camera.name} number theirs in different orders. "
            'Sort the rows of both by number; or, if they belong together in this order, pair="rows" (--pair rows).'
        )
    whole = [max(numbers) - min(numbers) == len(numbers) - 1 for numbers in (ours, theirs)]
    if (len(ours) == len(theirs) and all(whole)) or len(ours & theirs) <= min(len(ours), len(theirs)) / 2:
        return  # counted from 0 and from 1, or by something else
    lacks = [
        f"{side.name} lacks {', '.join(map(str, missing[:8]))}{', ...' * (len(missing) > 8)}"
        for side, missing in ((robot, sorted(theirs - ours)), (camera, sorted(ours - theirs)))
        if missing
    ]
    raise InputError(
        f"Poses are paired by their order, and the numbers of their files or rows differ: {'; '.join(lacks)}. Leave "
        'out the poses without a partner; or, if they belong together in this order, pair="rows" (--pair rows).'
    )


def warn_if_swapped(robot: Path, camera: Path) -> None:
    """Warn of a camera's file in the place of the robot's, by both names: data of eye-to-hand rigs cannot tell."""
    names = [path.name.lower() for path in (robot, camera)]
    if ["cam" in name for name in names] == [True, False] and ["robot" in name for name in names] == [False, True]:
        warnings.warn(
            f"{shown(robot)} is taken as the robot's poses and {shown(camera)} as the camera's. The robot's file goes "
            "first: are they swapped?",
            InputWarning,
            stacklevel=4,
        )


def _numbered(times: Array) -> bool:
    """Return whether times are the numbers of rows, from 0 or 1."""
    return bool(times[0] in (0.0, 1.0) and np.array_equal(times - times[0], np.arange(len(times))))
