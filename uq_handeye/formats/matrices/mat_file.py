"""Poses in MAT-files of MATLAB, versions 5 to 7: arrays of numbers by name, and cells of matrices.

Arrays are 4 x 4 x n as MATLAB counts poses, or in any shape that arrays of NumPy may have (`arrays`). Names are
those of `pose_name`; a single array of another name is one side. Objects and functions are not made, and what
a compressed file unpacks to is counted before it is read. Source: MathWorks, "MAT-File Format"; read by
``scipy.io.loadmat``.
"""

from __future__ import annotations

import io
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.files.lines import refused, short
from ...core.files.trees import pose_name
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..contents import Contents, Side
from ..controllers.records import records_side
from ..opencv_storage import joined_pairs
from .arrays import is_poses, side_of_array

MAX_BYTES = 500_000_000  # unpacked
MAX_CELLS = 100_000
START = b"MATLAB 5.0 MAT-file"
TIMES = ("timestamps", "timestamp", "times", "t")
HELP = "docs/formats.md, MATLAB"

_HEADER, _COMPRESSED, _PIECE = 128, 15, 1 << 20


def read_mat(data: bytes, name: str) -> Contents:
    """Return the poses of a file."""
    arrays = _arrays(data, name)
    pairs, either = joined_pairs({key: _by_first_axis(values) for key, values in arrays.items()}, name)
    named = TIMES[:-1] if either is not None else TIMES  # t: translations
    times = next((arrays[key].reshape(-1) for key in named if key in arrays), None)
    arrays |= {key: T for key, _, _, T in pairs}
    of = {key: (role, frame) for key, role, frame, _ in pairs}
    sides: dict[str, Side] = {}
    notes: list[str] = []
    for key, values in arrays.items():
        if (known := of.get(key) or pose_name(key)) is None:
            continue
        role, frame = known
        if role in sides:
            raise InputError(f"{name}: expected the {role} poses once, got the arrays {short(', '.join(arrays))}.")
        sides[role], said = side_of_array(values, f"{name}, {key}", None if key == role else frame, times)
        notes += said
    if sides:
        return Contents(sides.get("robot"), sides.get("camera"), notes=tuple(notes))
    if either is not None:
        side, said = side_of_array(either[1], f"{name}, {either[0]}", None, times)
        return Contents(only=side, notes=(f"poses from {either[0]}", *said))
    found = [key for key, values in arrays.items() if key not in TIMES and is_poses(values.shape)]
    if len(found) != 1 and (vectors := _of_vectors(arrays, name)) is not None:
        return Contents(only=vectors)
    if len(found) != 1:
        raise InputError(
            f"{name}: expected the arrays robot and camera, each 4 x 4 x n, or a single one, got "
            f"{short(', '.join(f'{key} {values.shape}' for key, values in arrays.items()) or 'none')} ({HELP})."
        )
    side, said = side_of_array(arrays[found[0]], f"{name}, {short(found[0])}", None, times)
    return Contents(only=side, notes=(f"poses from {short(found[0])}", *said))


def _by_first_axis(values: Array) -> Array:
    """Return rotations and translations that MATLAB counts by the last axis, counted by the first."""
    if values.ndim == 3 and values.shape[:2] in ((3, 3), (3, 1), (1, 3)):
        return np.moveaxis(values, -1, 0)
    return values.T if values.ndim == 2 and values.shape[0] == 3 != values.shape[1] else values


def _of_vectors(arrays: dict[str, Array], name: str) -> Side | None:
    """Return poses of one vector per column of a table, by the names of the columns; None where they are none."""
    columns = {key: values.reshape(-1) for key, values in arrays.items() if max(values.shape, default=0) == values.size}
    if len({len(values) for values in columns.values()}) != 1:
        return None
    rows = np.column_stack(list(columns.values())).tolist()
    return records_side([dict(zip(columns, row, strict=True)) for row in rows], name)


def _arrays(data: bytes, name: str) -> dict[str, Array]:
    """The arrays of numbers of a file, and cells of matrices as one array."""
    from scipy.io import loadmat, whosmat

    def file() -> Any:
        return io.BytesIO(data)

    with refused(f"{name}: the MAT-file is damaged"):
        _check_size(data, name)
        wanted = [
            key
            for key, shape, kind in whosmat(file())
            if kind in ("double", "single", "cell") and int(np.prod(shape)) <= MAX_BYTES // 8
        ]
        loaded: dict[str, Any] = loadmat(file(), variable_names=wanted) if wanted else {}
    arrays: dict[str, Array] = {}
    for key in wanted:
        values = _numbers(loaded.get(key))
        if values is not None:
            arrays[key] = values
    return arrays


def _numbers(values: Any) -> Array | None:
    """An array of numbers, or the matrices of a cell; None for anything else."""
    if not isinstance(values, np.ndarray):
        return None
    if values.dtype.kind in "fiu":
        return np.asarray(values, dtype=float)
    if values.dtype != object or not 0 < values.size <= MAX_CELLS:
        return None
    cells: list[NDArray[Any]] = list(values.reshape(-1, order="F"))
    alike = all(isinstance(cell, np.ndarray) and cell.dtype.kind in "fiu" and cell.shape == (4, 4) for cell in cells)
    return np.stack(cells).astype(float) if alike else None


def _check_size(data: bytes, name: str) -> None:
    """Raise `InputError` for a file that unpacks to more than `MAX_BYTES`, or is cut off."""
    order = "little" if data[126:128] == b"IM" else "big"
    at, total = _HEADER, 0
    while at + 8 <= len(data):
        kind, size = (int.from_bytes(data[at + k : at + k + 4], order) for k in (0, 4))  # type: ignore[arg-type]
        if at + 8 + size > len(data):
            raise InputError(f"{name}: the file is cut off: it declares more than it holds.")
        if kind == _COMPRESSED:
            unpacker = zlib.decompressobj()
            piece = data[at + 8 : at + 8 + size]
            while piece and total <= MAX_BYTES:
                total += len(unpacker.decompress(piece, _PIECE))
                piece = unpacker.unconsumed_tail
        if total > MAX_BYTES:
            raise InputError(f"{name}: expected at most {MAX_BYTES / 1e6:g} MB unpacked, got more.")
        at += 8 + size
