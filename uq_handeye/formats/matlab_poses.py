"""Poses in MAT-files of MATLAB, versions 5 to 7: arrays of numbers by name, and cells of matrices.

Arrays are 4 x 4 x n as MATLAB counts poses, or in any shape that arrays of NumPy may have (`arrays`). Names are
those of `pose_name`; a single array of another name is one side. Objects and functions are not made, and what
a compressed file unpacks to is counted before it is read. Source: MathWorks, "MAT-File Format"; read by
``scipy.io.loadmat``.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.files.one_line import refused, short
from ..core.geometry.se3 import Array
from ..core.limits import MAX_ROWS, MAX_TABLE_BYTES
from ..errors import InputError
from .contents import Contents, Side
from .controllers.records import records_side
from .numpy_poses import _of_arrays
from .opencv_storage import joined_pairs

START = b"MATLAB 5.0 MAT-file"
HELP = "docs/formats.md, MATLAB"
# Header of a file: text, place of further data, version, order of bytes.
_HEADER = struct.Struct("116s8s2s2s")


def read_mat(data: bytes, name: str) -> Contents:
    """Return the poses of a file."""
    arrays = _arrays(data, name)
    joined = joined_pairs({key: _by_first_axis(values) for key, values in arrays.items()}, name)

    def times_of(key: str) -> Array | None:
        return arrays[key].reshape(-1) if key in arrays else None

    if (contents := _of_arrays(arrays, joined, times_of, name)) is not None:
        return contents
    if (vectors := _of_vectors(arrays, name)) is not None:
        return Contents(only=vectors)
    found = short(", ".join(f"{key} {values.shape}" for key, values in arrays.items()) or "none")
    raise InputError(
        f"{name}: expected the arrays robot and camera, each 4 x 4 x n, or a single one, got {found} ({HELP})."
    )


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
            if kind in ("double", "single", "cell") and int(np.prod(shape)) <= MAX_TABLE_BYTES // 8
        ]
        loaded: dict[str, Any] = loadmat(file(), variable_names=wanted) if wanted else {}
    arrays: dict[str, Array] = {}
    for key in wanted:
        values = _numbers_of(loaded.get(key))
        if values is not None:
            arrays[key] = values
    return arrays


def _numbers_of(values: Any) -> Array | None:
    """An array of numbers, or the matrices of a cell; None for anything else."""
    if values is None:
        return None
    if values.dtype.kind in "fiu":
        return np.asarray(values, dtype=float)
    if values.dtype != object or not 0 < values.size <= MAX_ROWS:
        return None
    cells: list[NDArray[Any]] = list(values.reshape(-1, order="F"))
    alike = all(cell.dtype.kind in "fiu" and cell.shape == (4, 4) for cell in map(np.asarray, cells))
    return np.stack(cells).astype(float) if alike else None


def _check_size(data: bytes, name: str) -> None:
    """Raise `InputError` for a file that unpacks to more than `MAX_TABLE_BYTES`, or is cut off."""
    order = "little" if data[126:128] == b"IM" else "big"
    at, total = _HEADER.size, 0
    while at + 8 <= len(data):
        kind, size = (int.from_bytes(data[at + k : at + k + 4], order) for k in (0, 4))  # type: ignore[arg-type]
        if at + 8 + size > len(data):
            raise InputError(f"{name}: the file is cut off: it declares more than it holds.")
        if kind == 15:  # a compressed element
            unpacker = zlib.decompressobj()
            piece = data[at + 8 : at + 8 + size]
            while piece and total <= MAX_TABLE_BYTES:
                total += len(unpacker.decompress(piece, 1 << 20))
                piece = unpacker.unconsumed_tail
        if total > MAX_TABLE_BYTES:
            raise InputError(f"{name}: expected at most {MAX_TABLE_BYTES / 1e6:g} MB unpacked, got more.")
        at += 8 + size
