"""Poses of printed messages as one side of a pose file: one pair of frames, each time once."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array
from ..core.limits import MAX_LISTED
from ..errors import InputError
from .contents import Contents, Side, without_repeats
from .ros_messages import Stamped

FIELDS = ("stamp", *(f"translation.{a}" for a in "xyz"), *(f"rotation.{a}" for a in "xyzw"))
# Poses that differ by less (m, rad) are those of a robot at rest, measured with noise.
MAX_SHIFT_AT_REST_M, MAX_ROTATION_AT_REST_RAD = 2e-3, 5e-3
# Largest | |q| - 1 | that rounding explains, by the number of decimals; more decimals obey the rule of all formats.
ROUNDED = {1: 0.11, 2: 0.011, 3: 0.0011}


def pairs_text(records: list[Stamped]) -> str:
    """Return the pairs of frames with their counts: ``base:tool0 (12)``."""
    counts = Counter(record.pair for record in records)
    names = [f"{name} ({count})" for name, count in counts.items()]
    return ", ".join(names[:MAX_LISTED]) + (f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else "")


def side_of(records: list[Stamped], lines: list[int], name: str, notes: list[str]) -> Contents:
    """Return the poses of one pair of frames; several pairs are refused by their names."""
    pairs = {record.pair for record in records}
    if len(pairs) > 1:
        raise InputError(
            f"{name} holds the transforms {pairs_text(records)}, and one of them is expected: choose by --bag {name} "
            "--robot PARENT:CHILD --camera PARENT:CHILD, which also follows chains of frames (docs/how-to/ros.md)."
        )
    if "?" not in (pair := pairs.pop()):
        parent, child = records[0].parent, records[0].child
        notes.append(f"poses of {child} in {parent} ({parent}_T_{child})")
    elif pair != "?:?":
        notes.append(f"poses in the frame {records[0].parent or records[0].child}")
    times = [record.time for record in records]
    numbers = np.array([record.numbers for record in records])
    stamps = None if any(time is None for time in times) else np.array(times, dtype=float)
    covariances = [record.covariance for record in records if record.covariance is not None]
    S = np.reshape(covariances, (-1, 6, 6)) if len(covariances) == len(records) else None
    return one_side(name, numbers, stamps, np.array(lines), notes, S)


def one_side(
    name: str,
    numbers: Array,
    stamps: NDArray[np.float64] | None,
    lines: NDArray[np.int64],
    notes: list[str],
    covariance: Array | None = None,
) -> Contents:
    """Return poses (n, 7) as they stand, of a robot that stood still one; with covariances (n, 6, 6) of ROS."""
    if len(numbers) > 1 and (moved := _at_rest(numbers)) is not None:  # of a robot that stood still: a file per pose
        if moved == 0.0:
            notes.append(f"the same pose {len(numbers)} times, taken once")
            numbers = numbers[:1]
        else:
            notes.append(f"a pose at rest (within {1e3 * moved:.2g} mm) {len(numbers)} times, the mean taken")
            R = Rotation.from_quat(numbers[:, 3:]).mean()
            numbers = np.append(numbers[:, :3].mean(axis=0), R.as_quat())[None]
            covariance = None  # that of a mean is another one
        stamps, lines = None if stamps is None else stamps[:1], lines[:1]
        covariance = None if covariance is None else covariance[:1]
    if stamps is not None and len(stamps) > 1 and (stamps == stamps[0]).all() and np.ptp(numbers, axis=0).any():
        notes.append(f"all stamps are {stamps[0]:g}, and not used as times")
        stamps = None
    side = Side(
        name, numbers[:, :3], numbers[:, 3:], stamps, lines, "line", "xyzw", FIELDS, covariance=covariance,
        convention="ros",
    )  # fmt: skip
    return without_repeats(Contents(only=side, notes=tuple(notes)))


def _at_rest(numbers: Array) -> float | None:
    """Return how far poses (n, 7) of a robot that stood still are apart (m); None for one that moved."""
    apart = float(np.linalg.norm(np.ptp(numbers[:, :3], axis=0)))
    if apart == 0.0 and not np.ptp(numbers[:, 3:], axis=0).any():
        return 0.0
    norms = np.linalg.norm(numbers[:, 3:], axis=1)
    if not apart < MAX_SHIFT_AT_REST_M or not np.isfinite(norms).all() or not (norms > 0.5).all():
        return None
    R = Rotation.from_quat(numbers[:, 3:])
    return apart if (R[0].inv() * R).magnitude().max() < MAX_ROTATION_AT_REST_RAD else None


def unit_quaternions(q: Array, decimals: int) -> Array:
    """Return quaternions (n, 4) of few decimals with length 1, where rounding explains their length."""
    limit = ROUNDED.get(decimals, 0.0)
    norm = np.linalg.norm(q, axis=1)
    rounded = (np.abs(norm - 1.0) <= limit) & (norm > 0)
    return np.where(rounded[:, None], q / np.where(norm > 0, norm, 1.0)[:, None], q)
