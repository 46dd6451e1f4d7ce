"""Poses in arrays of numbers: matrices in any shape and order, or rows of translation and rotation.

Places of rotation and translation among the numbers of a pose that is written as a matrix.

Of 16 numbers the row 0, 0, 0, 1 tells the order: at the end, row by row; as every fourth number, column by column, as
libfranka, Eigen, MATLAB, OpenGL and three.js store it. Of 12 numbers the place of the 3x3 that is a rotation tells
whether they are the first three rows (KITTI), a rotation before a translation, or after it; the latter do not say
whether the rotation stands row by row.

Matrices in JSON and YAML under names of their own: one per file, a list, an entry per pose.

Taken is what leaves no doubt: a matrix or a list of them alone; a map with one entry that is one; entries that are
matrices by numbered names (``pose_0``, ``pose_1``); a list of maps that each hold one under the same name, also below a
single name (``frames`` of NeRF). The order of the 16 numbers is told by their places (`layout`).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.files.folders import natural
from ...core.files.tree_values import got, is_list, is_map, is_plain_number, items_of
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..contents import NORM_TOLERANCE, Contents, Reading, Side, matrices_side
from ..controllers.forms import interpret

# max |R^T R - I| of numbers that are meant as a rotation, and max deviation of a last row that is meant.
MEANT, LAST_ROW = 0.05, 1e-3
LAST = np.array([0.0, 0.0, 0.0, 1.0])
# Numbers of a pose that are read as one matrix.
COUNTS = (16, 12)
# Numbers that may stand before them: row numbers, times.
MOST_BEFORE = 2

BOTH = (Reading("matrix", "matrix"), Reading("matrix", "transposed"))


@dataclass(frozen=True, eq=False)
class Found:
    """Matrices (n, 4, 4) and how they stood.

    Parameters
    ----------
    T : (n, 4, 4)
    others : (n, k) numbers in front of each and behind it
    note : where the numbers stood, in words
    may : whether the rotations may be transposed
    """

    T: Array
    others: Array
    note: str
    may: bool = False

    @property
    def readings(self) -> tuple[Reading, ...]:
        """Readings of the rotations; none: matrices."""
        return BOTH if self.may else ()


def found_in(table: Array) -> Found | None:
    """Return the matrices of numbers (n, k), or None where no place of a matrix fits more than half of the rows."""
    best: tuple[float, int, str] | None = None
    for count in COUNTS:
        others = table.shape[1] - count
        if not 0 <= others <= MOST_BEFORE:
            continue
        for before in range(others, -1, -1):
            for layout, fits in _FITS[count].items():
                share = float(np.mean(fits(table[:, before : before + count])))
                if share > 0.5 and (best is None or share > best[0]):
                    best = (share, before, layout)
    if best is None:
        return None
    _, before, layout = best
    after = before + (16 if layout in _FITS[16] else 12)
    rest = np.concatenate([table[:, :before], table[:, after:]], axis=1)
    return Found(_matrices(table[:, before:after], layout), rest, _NOTES[layout], layout in ("R t", "t R"))


def fitting(numbers: Array) -> bool:
    """Return whether numbers (n, 16) or (n, 12) are matrices in some layout."""
    return found_in(numbers) is not None


def _last(rows: Array) -> NDArray[np.bool_]:
    with np.errstate(all="ignore"):
        return np.asarray(np.abs(rows - LAST).max(axis=1) < LAST_ROW)


def _rotations(R: Array) -> NDArray[np.bool_]:
    """Return whether matrices (n, 3, 3) are meant as rotations, also mirrored ones."""
    with np.errstate(all="ignore"):
        return np.asarray(np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2)) < MEANT)


_FITS: dict[int, dict[str, Callable[[Array], NDArray[np.bool_]]]] = {
    16: {"rows": lambda v: _last(v[:, 12:]), "columns": lambda v: _last(v[:, 3::4])},
    12: {
        "3x4": lambda v: _rotations(v.reshape(-1, 3, 4)[:, :, :3]),
        "R t": lambda v: _rotations(v[:, :9].reshape(-1, 3, 3)),
        "t R": lambda v: _rotations(v[:, 3:].reshape(-1, 3, 3)),
    },
}
_NOTES = {
    "rows": "matrices 4x4 row by row",
    "columns": "matrices 4x4 column by column: every fourth number is 0, 0, 0, 1",
    "3x4": "the first three rows of each matrix, row by row",
    "R t": "nine numbers of a rotation before the translation",
    "t R": "nine numbers of a rotation after the translation",
}


def _matrices(numbers: Array, layout: str) -> Array:
    n = len(numbers)
    if layout == "rows":
        return numbers.reshape(n, 4, 4)
    if layout == "columns":
        return np.swapaxes(numbers.reshape(n, 4, 4), 1, 2)
    if layout == "3x4":
        return with_last_row(numbers.reshape(n, 3, 4))
    R, t = (numbers[:, :9], numbers[:, 9:]) if layout == "R t" else (numbers[:, 3:], numbers[:, :3])
    return with_last_row(np.concatenate([R.reshape(n, 3, 3), t[:, :, None]], axis=2))


def with_last_row(rows: Array) -> Array:
    """Matrices (n, 4, 4) of their first three rows (n, 3, 4)."""
    return np.concatenate([rows, np.broadcast_to(LAST, (len(rows), 1, 4))], axis=1)


HELP = "docs/formats.md, NPZ and NPY"
_ONE = ((4, 4), (3, 4), (16,), (12,), (7,), (6,))  # shapes of one pose
_PER_ROW = tuple(count + before for count in COUNTS for before in range(MOST_BEFORE + 1))
# Shapes that people give in place of poses, and what they are.
_OTHERS = {(3, 3): "; rotations alone hold no poses: add the translations", (3,): "; rotations are missing"}
QUATERNIONS = ("xyzw", "wxyz")


def is_poses(shape: tuple[int, ...]) -> bool:
    """Return whether an array of this shape may hold poses."""
    return shape in _ONE or shape[1:] in ((4, 4), (3, 4), *((k,) for k in (*_PER_ROW, 6, 7, 8))) or _last_axis(shape)


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
        readings, said = interpret("unsaid", flat[:, :3], flat[:, 3:], None, None, None)
        side = Side(name, flat[:, :3], flat[:, 3:], readings=readings, **options)
        notes += said
    elif flat.shape[1] in (7, 8):
        side = _quaternions(flat, name, options)
    else:
        found = found_in(flat)
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


# Numbers that are looked at.
MOST = 10_000_000
_NUMBERED = re.compile(r"(.*?)[\[(_ -]*(\d+)[\])]*(\.[A-Za-z]\w*)?")


def numbers_of(value: Any) -> Array | None:
    """Lists of numbers as an array, or None for anything else."""
    shape: list[int] = []
    level = [value]
    while all(map(is_list, level)) and len(shape) < 4:
        lengths = {len(entry) for entry in level}
        if len(lengths) != 1 or lengths == {0}:
            return None
        shape.append(lengths.pop())
        level = [inner for entry in level for inner in entry]
        if len(level) > MOST:
            return None
    if not shape or not all(map(is_plain_number, level)):
        return None
    return np.array(level, dtype=float).reshape(shape)


def matrices_of(tree: Any) -> tuple[Array, str] | None:
    """Return the matrices of a tree, and under which names they stood; None if they are not told without doubt."""
    values = numbers_of(tree)
    if values is not None:
        rows_of_poses = values.shape[-1] in (6, 7, 8)
        return (values, "") if is_poses(values.shape) and not rows_of_poses else None
    if is_map(tree):
        found = {str(key): one for key, value in tree.items() if (one := matrices_of(value)) is not None}
        if len(found) == 1:
            ((key, (values, below)),) = found.items()
            return values, f"{key}{f'.{below}' if below else ''}"
        stems = {match[1] if (match := _NUMBERED.fullmatch(key)) else key for key in found}
        if len(found) > 1 and len(stems) == 1:
            keys = sorted(found, key=natural)
            return _stacked([found[key][0] for key in keys], f"{keys[0]} to {keys[-1]}")
        return None
    if items_of(tree) and all(map(is_map, tree)):
        each = [matrices_of(entry) for entry in tree]
        names = {None if one is None else one[1] for one in each}
        if len(names) == 1 and None not in names:
            return _stacked([one[0] for one in each if one is not None], str(names.pop()))
    return None


def listed(tree: Any) -> Any:
    """Return maps with an entry per pose by numbered names (``"0"``, ``pose_1``) as lists, also below other names.

    The pose vector of ViSP (``vpPoseVector::saveYAML``: six rows, metres and rotation vector) becomes one by names.
    """
    if not is_map(tree):
        return tree
    vector = numbers_of(tree["data"]) if set(tree) == {"rows", "cols", "data"} else None
    if vector is not None and vector.shape == (6, 1):
        values = vector.ravel().tolist()
        return [{"translation": values[:3], "rotvec": values[3:]}]
    stems: dict[str, list[str]] = {}
    for key, value in tree.items():
        if is_map(value) and (match := _NUMBERED.fullmatch(str(key))) is not None:
            stems.setdefault(match[1].rstrip("_- [("), []).append(key)
    lists = {
        stem: [tree[key] for key in sorted(keys, key=natural)]
        for stem, keys in stems.items()
        if len(keys) > 1 and stem not in tree
    }
    every = next(iter(lists.values()), [])
    if len(lists) == 1 and len(tree) == len(every) and not {"rows", "cols", "data"} <= set(every[0]):  # of OpenCV
        return every
    taken = {key for stem in lists for key in stems[stem]}
    return {**{key: listed(value) for key, value in tree.items() if key not in taken}, **lists}


def _stacked(parts: list[Array], name: str) -> tuple[Array, str] | None:
    """Poses of entries that hold one each."""
    shapes = {part.shape for part in parts}
    if len(shapes) != 1 or shapes.pop() not in ((4, 4), (3, 4), (16,), (12,)):
        return None
    return np.stack(parts), name


def read_matrix_tree(tree: Any, name: str) -> Contents:
    """Return the poses of a tree."""
    found = matrices_of(tree)
    if found is None:
        raise InputError(
            f"{name}: expected matrices as a list, or each under one name, got {got(tree)} (docs/formats.md, JSON)."
        )
    values, where = found
    side, notes = side_of_array(values, name)
    return Contents(only=side, notes=(*([f"matrices from {where}"] if where else []), *notes))
