"""Poses of two clocks that agree, paired by their times: the nearest within a tolerance, one to one.

Poses paired by their rows: what names and numbers of files and timestamps say against it.

Poses that arrive in files one by one: the pairs that are complete so far.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.files.open import shown
from ..core.files.source import Source
from ..core.geometry.checks import is_number
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array
from ..errors import InputError, InputWarning
from ..formats.contents import FRAMES, Side, finished
from ..formats.detect import read_contents
from ..model.camera.result import CameraCalibration
from ..model.poses.pose_pairs import PosePairs

# Fewer pairs make less than two motions.
FEWEST = 3
# Rows are synchronous within this (s): rounding of printed times; an arm at 1 m/s moves a micrometre in it.
SYNCHRONOUS = 1e-6


class Match(NamedTuple):
    """Rows (n,) of both sides that belong together, in the order of time, and what was left out, in words."""

    robot: NDArray[np.intp]
    camera: NDArray[np.intp]
    notes: tuple[str, ...]


def match_times(robot: Side, camera: Side, tolerance: float) -> Match:
    """Rows of robot and camera that are each other's nearest in time, at most ``tolerance`` seconds apart.

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
    if len(rows) < FEWEST:
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
    """For each time the index of the nearest among the others."""
    order = np.argsort(others, kind="stable")
    ordered = others[order]
    right = np.clip(np.searchsorted(ordered, times), 1, max(1, len(others) - 1))
    right = np.minimum(right, len(others) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(np.abs(times - ordered[left]) <= np.abs(ordered[right] - times), left, right)
    return np.asarray(order[nearer])


def _too_few(robot: Side, camera: Side, r: Array, c: Array, tolerance: float, n: int) -> str:
    start = (
        f"Pairing by time leaves {n} of {len(r)} robot and {len(c)} camera poses, and at least {FEWEST} are needed: "
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
        return float(np.log10(max(np.median(np.abs(times)) if len(times) else 0.0, 1e-300)))

    magnitude, step = size(r) - size(c), size(np.diff(np.sort(r))) - size(np.diff(np.sort(c)))
    for unit, power in (("ms", 3.0), ("us", 6.0), ("ns", 9.0)):
        for sign, name in ((1.0, robot.name), (-1.0, camera.name)):
            if abs(sign * magnitude - power) < 0.3 and abs(sign * step - power) < 1.0:
                return f"{name} seems to count {unit}"
    return ""


# Timestamps of a row that differ by this share of the interval between rows may be of other moments.
HALF = 0.5


def check_rows(robot: Side, camera: Side, told: bool) -> tuple[str, ...]:
    """Raise or warn unless row k of both sides may be of the same moment; return what was found out.

    Timestamps say nothing of it where one side numbers its rows 0, 1, 2, ... and the other has times, and where two
    clocks have no time in common and differ by the same in all rows. With ``told``, rows belong together whatever the
    timestamps say, which is then a warning.
    """
    if not told:
        _check_numbers(robot, camera)
    n, m = len(robot), len(camera)
    timed = robot.timestamps is not None and camera.timestamps is not None
    if n != m:
        by_time = (
            'pair them by their timestamps (pair="time", --pair time); for streams whose clocks differ or of a rig '
            "that moves, use --pair async"
        )
        raise InputError(
            f"{robot.name} has {n} poses and {camera.name} has {m}: expected one row in each file per moment. "
            "Leave out poses that the other file lacks, or "
            f"{by_time if timed else 'add timestamps and use --pair time or --pair async'}."
        )
    if robot.timestamps is None or camera.timestamps is None:
        return ()
    ours, theirs = robot.timestamps, camera.timestamps
    late = ours - theirs
    row = int(np.argmax(np.abs(late)))
    if abs(late[row]) <= SYNCHRONOUS:
        return ()
    apart = ours.max() < theirs.min() or theirs.max() < ours.min()
    if apart and _numbered(ours) != _numbered(theirs):
        return ()
    interval = float(np.median(np.abs(np.diff(ours)))) if n > 1 else 0.0
    offset = float(np.median(late))
    if apart and n > 1 and not _numbered(ours) and np.abs(late - offset).max() < HALF * interval:
        return (f"rows paired by their order; the clocks differ by {offset:.6g} s (robot minus camera)",)
    where = (
        f"the timestamps of {robot.name} and {camera.name} differ by up to {abs(late[row]):.6g} s, in pose "
        f"{row} ({ours[row].item()!r} and {theirs[row].item()!r})"
    )
    if abs(late[row]) >= HALF * interval and not told:
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
    if (len(ours) == len(theirs) and all(whole)) or len(ours & theirs) <= HALF * min(len(ours), len(theirs)):
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


def read_arrived(
    robot: Sequence[Path],
    camera: Sequence[Path] | CameraCalibration | None,
    *,
    setup: str | None = None,
    units: tuple[str | None, str | None] = (None, None),
    format: tuple[str | None, str | None] = (None, None),
    rotation: tuple[str | None, str | None] = (None, None),
    robot_frame: str = "base_T_gripper",
    camera_frame: str = "camera_T_target",
) -> PosePairs | None:
    """Return pose k of the robot with pose k of the camera, as far as both have arrived; None: no pair yet.

    Parameters
    ----------
    robot, camera : paths
        In the order in which their poses are counted. ``camera=None``: the files of ``robot`` hold both sides.
        A calibrated camera: its pictures belong to the rows of the robot poses.
    setup, units, format, rotation, robot_frame, camera_frame
        As in `read_poses`, of both sides.

    Raises
    ------
    InputError
        A file that cannot be read, or holds the poses of one side where both are expected.
    """
    said = {setup} - {None}
    seen = camera if isinstance(camera, CameraCalibration) else None
    of_camera = camera if seen is None else ()
    sides: list[tuple[list[Array], list[Array | None]]] = []
    sources: list[Source] = []
    for role, paths, form, unit, numbers, frame in zip(
        FRAMES, (robot, of_camera), format, units, rotation, (robot_frame, camera_frame), strict=True
    ):
        poses, times = [], []
        for path in robot if paths is None else paths:
            contents, source = read_contents(path, form)
            said |= {contents.setup} - {None}
            side = getattr(contents, role) or (None if camera is None else contents.only)
            if side is None:
                raise InputError(f"{path.name} holds no {role} poses.")
            frame_of = frame
            if role == "robot" and contents.robot_enters and "eye-to-hand" in said:
                frame_of = FRAMES["robot"][1]
            poses.append(finished(side, role, unit, numbers, frame_of))
            times.append(side.timestamps)
            sources += [source] if paths is not None or role == "robot" else []
        sides.append((poses, times))
    if len(said) > 1:
        raise InputError(f"Expected one setup, got {' and '.join(sorted(map(str, said)))}.")
    chosen = next(iter(said), "eye-in-hand")
    if chosen not in SETUPS:
        raise InputError(f"Expected `setup` (--setup) to be one of {', '.join(SETUPS)}, got {chosen!r}.")
    G = _stacked(sides[0][0])
    if seen is not None:
        if seen.rows[-1] >= len(G):
            raise InputError(f"Picture {seen.rows[-1]} has no robot pose yet: there are {len(G)}.")
        return PosePairs(G[seen.rows], seen.poses, chosen, sources=tuple(sources), camera_calibration=seen)
    C = _stacked(sides[1][0])
    n = min(len(G), len(C))
    if n == 0:
        return None
    stamps = [part for part in sides[0][1] if part is not None]
    times_of = np.concatenate(stamps)[:n] if len(stamps) == len(sides[0][1]) else None
    if times_of is not None and len(np.unique(times_of)) < n:  # each file counts from 0
        times_of = None
    return PosePairs(G[:n], C[:n], chosen, times_of, sources=tuple(sources))


def count_arrived(files: Sequence[Path], format: str | None = None, role: str = "robot") -> int:
    """Return how many poses of one side have arrived."""
    every = (read_contents(path, format)[0] for path in files)
    return sum(len(getattr(contents, role) or contents.only or ()) for contents in every)


def _stacked(parts: list[Array]) -> Array:
    return np.concatenate(parts) if parts else np.zeros((0, 4, 4))
