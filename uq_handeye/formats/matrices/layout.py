"""Order of rotation and translation among the numbers of a pose that is written as a matrix.

Of 16 numbers the place of the row 0, 0, 0, 1 gives the order: at the end, row by row; as every fourth number, column by
column, as libfranka, Eigen, MATLAB, OpenGL and three.js store it. Of 12 numbers the place of the 3x3 that is a rotation
shows whether they are the first three rows (KITTI), a rotation before a translation, or after it; in the latter two
cases the order of the rotation's entries, by rows or by columns, remains ambiguous.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ..contents import NORM_TOLERANCE, Reading

# max |R^T R - I| of numbers that are meant as a rotation, and max deviation of a last row that is meant.
MAX_ROTATION_DEFECT = 0.05
LAST = np.array([0.0, 0.0, 0.0, 1.0])
# Numbers of a pose that are read as one matrix.
COUNTS = (16, 12)
# Numbers that may stand before them: row numbers, times.
MAX_NUMBERS_BEFORE = 2
BOTH = (Reading("matrix", "matrix"), Reading("matrix", "transposed"))
_NOTES = {
    "rows": "matrices 4x4 row by row",
    "columns": "matrices 4x4 column by column: every fourth number is 0, 0, 0, 1",
    "3x4": "the first three rows of each matrix, row by row",
    "R t": "nine numbers of a rotation before the translation",
    "t R": "nine numbers of a rotation after the translation",
}


class TableMatrices(NamedTuple):
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


def matrices_in(table: Array) -> TableMatrices | None:
    """Return the matrices of numbers (n, k), or None where no place of a matrix fits more than half of the rows."""
    best: tuple[float, int, str] | None = None
    for count in COUNTS:
        others = table.shape[1] - count
        if not 0 <= others <= MAX_NUMBERS_BEFORE:
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
    return TableMatrices(_matrices(table[:, before:after], layout), rest, _NOTES[layout], layout in ("R t", "t R"))


def fitting(numbers: Array) -> bool:
    """Return whether numbers (n, 16) or (n, 12) are matrices in some layout."""
    return matrices_in(numbers) is not None


def _last(rows: Array) -> NDArray[np.bool_]:
    with np.errstate(all="ignore"):
        return np.asarray(np.abs(rows - LAST).max(axis=1) < NORM_TOLERANCE)


def _rotations(R: Array) -> NDArray[np.bool_]:
    """Return whether matrices (n, 3, 3) are meant as rotations, also mirrored ones."""
    with np.errstate(all="ignore"):
        return np.asarray(np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2)) < MAX_ROTATION_DEFECT)


_FITS: dict[int, dict[str, Callable[[Array], NDArray[np.bool_]]]] = {
    16: {"rows": lambda v: _last(v[:, 12:]), "columns": lambda v: _last(v[:, 3::4])},
    12: {
        "3x4": lambda v: _rotations(v.reshape(-1, 3, 4)[:, :, :3]),
        "R t": lambda v: _rotations(v[:, :9].reshape(-1, 3, 3)),
        "t R": lambda v: _rotations(v[:, 3:].reshape(-1, 3, 3)),
    },
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
