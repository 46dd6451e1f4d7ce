"""Poses in arrays of numbers: matrices in any shape and order, or rows of translation and rotation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...errors import InputError
from ..contents import NORM_TOLERANCE, Reading, Side, matrices_side
from ..controllers.readings import interpret
from .layout import COUNTS, MAX_NUMBERS_BEFORE, matrices_in, with_last_row

HELP = "docs/formats.md, NPZ and NPY"
_ONE = ((4, 4), (3, 4), (16,), (12,), (7,), (6,))  # shapes of one pose
_PER_ROW = tuple(count + before for count in COUNTS for before in range(MAX_NUMBERS_BEFORE + 1))
# Shapes that people give in place of poses, and what they are.
_OTHERS = {(3, 3): "; rotations alone hold no poses: add the translations", (3,): "; rotations are missing"}
QUATERNIONS = ("xyzw", "wxyz")


def is_poses(shape: tuple[int, ...]) -> bool:
    """Return whether an array of this shape may hold poses."""
    return shape in _ONE or shape[1:] in ((4, 4), (3, 4), *((k,) for k in (*_PER_ROW, 6, 7, 8))) or _last_axis(shape)


def is_one_pose(shape: tuple[int, ...]) -> bool:
    """Return whether an array of this shape is one pose, not several."""
    return shape in _ONE


def _last_axis(shape: tuple[int, ...]) -> bool:
    """Return whether the poses are counted by the last axis, as MATLAB does."""
    return len(shape) == 3 and shape[:2] in ((4, 4), (3, 4))


def side_of_array(
    values: Array, name: str, frame: str | None = None, times: Array | None = None
) -> tuple[Side, list[str]]:
    """Return the poses of an array, and what was found out; ``times`` (n,) in s.

    Raises `InputError` for other shapes, and for matrices that are no poses.
    """
    options: dict[str, Any] = {"frame": frame}
    shape = values.shape
    if not is_poses(shape) or not values.size:
        raise InputError(
            f"{name}: expected poses of shape (n, 4, 4), (n, 16), (n, 3, 4), (n, 12), (n, 7) or (n, 6), got {shape}"
            f"{_OTHERS.get(shape[1:], '')} ({HELP})."
        )
    notes = [f"an array of shape {shape}"] if shape[1:] not in ((4, 4), (3, 4)) or shape in _ONE else []
    if shape in _ONE:
        values = values[None]
    elif shape[1:] not in ((4, 4), (3, 4)) and len(shape) == 3:
        values = np.moveaxis(values, -1, 0)
    flat = values.reshape(len(values), -1)
    if flat.shape[1] == 7 and _ends_with_a_code(flat):
        flat = flat[:, :6]
        notes.append("the last number of each pose is a code, and not used")
    if flat.shape[1] == 6:
        readings, said, others = interpret("unsaid", flat[:, :3], flat[:, 3:], None, None, None)
        side = Side(name, flat[:, :3], flat[:, 3:], readings=readings, others=others, **options)
        notes += said
    elif flat.shape[1] in (7, 8):
        side = _quaternions(flat, name, options)
    else:
        found = matrices_in(flat)
        if found is None and flat.shape[1] == 12 and values.ndim == 3:
            T, layout = with_last_row(values), ""
        elif found is None and flat.shape[1] == 16:
            T, layout = flat.reshape(-1, 4, 4), ""
        elif found is None:
            raise InputError(f"{name}: expected matrices in the rows of {shape}, got no rotations ({HELP}).")
        else:
            T, layout = found.T, found.note
            if values.ndim < 3 or "column" in layout:
                notes.append(layout)
            options["readings"] = found.readings
        side = matrices_side(name, T, timestamps=_times(times, len(T), name), **options)
        return side, notes
    if times is not None:
        side = replace(side, timestamps=_times(times, len(side), name))
    return side, notes


def _ends_with_a_code(rows: Array) -> bool:
    """Return whether rows of seven numbers hold no quaternion but six numbers and a code, as poses of HALCON do."""
    code = rows[:, 6]
    with np.errstate(all="ignore"):
        unit = min(np.abs(np.linalg.norm(q, axis=1) - 1.0).max() for q in (rows[:, :4], rows[:, 3:]))
    return bool(unit > 0.1 and (code == code[0]).all() and code[0] in range(14))


def _times(times: Array | None, n: int, name: str) -> NDArray[np.float64] | None:
    if times is not None and len(times) != n:
        raise InputError(f"{name}: expected a time for each of the {n} poses, got {len(times)}.")
    return times


def _quaternions(rows: Array, name: str, options: dict[str, Any]) -> Side:
    """Rows of x, y, z and a quaternion, or the quaternion first; of 8 numbers the first is a time."""
    times, rows = (rows[:, 0], rows[:, 1:]) if rows.shape[1] == 8 else (None, rows)
    with np.errstate(all="ignore"):
        first, last = (np.abs(np.linalg.norm(q, axis=1) - 1.0).max() for q in (rows[:, :4], rows[:, 3:]))
    t, q = (rows[:, 4:], rows[:, :4]) if first < NORM_TOLERANCE < last else (rows[:, :3], rows[:, 3:])
    readings = tuple(Reading("npy", order) for order in QUATERNIONS)
    return Side(name, t, q, times, readings=readings, **options)
