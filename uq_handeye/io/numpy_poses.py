"""Poses in NumPy's files: ``.npy`` with one array (n, 4, 4), ``.npz`` with arrays by name.

Names in ``.npz``: ``robot`` and ``camera``, or a frame (`POSE_NAMES`), each (n, 4, 4); ``timestamps`` for both, or
``robot_timestamps`` and ``camera_timestamps``; ``setup``. A file with a single array (n, 4, 4) of another name holds
one side. Nothing is unpickled, and the sizes that a file declares are checked before anything is read. Source of the
rules: numpy/numpy, ``numpy/lib/_format_impl.py``.
"""

from __future__ import annotations

import io
import math
import zipfile
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..errors import InputError
from ..poses import SETUPS
from ..se3 import Array
from ._fields import POSE_NAMES
from ._lines import one_line, short
from ._side import Contents, Side, matrices_side

MAX_BYTES = 500_000_000  # of all arrays of a file, unpacked
MAX_ARRAYS = 100
TIMES = ("timestamps", "timestamp", "times", "t")


def read_npy(data: bytes, name: str) -> Contents:
    """One array (n, 4, 4)."""
    return Contents(only=_side(_array(io.BytesIO(data), len(data), name), name, name, None, None))


def read_npz(data: bytes, name: str) -> Contents:
    """Arrays by name."""
    try:
        arrays = _members(data, name)
    except InputError:
        raise
    except Exception as error:  # zipfile and zlib raise many kinds for damaged files
        raise InputError(f"{name}: the archive is damaged: {one_line(str(error) or type(error).__name__)}.") from error
    keys = short(", ".join(arrays))
    setup, notes = None, []
    if "setup" in arrays:
        setup = str(arrays["setup"])
        if setup not in SETUPS:
            raise InputError(f"{name}, setup: expected {' or '.join(SETUPS)}, got {short(setup)}.")
        notes.append(f"{setup}, as the file says")
    common = next((key for key in TIMES if key in arrays), None)
    sides: dict[str, Side] = {}
    for key, array in arrays.items():
        if key not in POSE_NAMES:
            continue
        role, frame = POSE_NAMES[key]
        if role in sides:
            raise InputError(f"{name}: expected the {role} poses once, got the arrays {keys}.")
        if key != role:
            notes.append(f"{role} poses from {key}")
        times = next((k for k in (f"{role}_timestamps", f"{role}_times") if k in arrays), common)
        sides[role] = _side(array, name, f"{name}, {key}", None if key == role else frame, _times(arrays, times, name))
    if sides:
        return Contents(sides.get("robot"), sides.get("camera"), setup=setup, notes=tuple(notes))
    stacks = [key for key, array in arrays.items() if array.ndim == 3 and array.shape[1:] == (4, 4)]
    if len(stacks) != 1:
        raise InputError(
            f"{name}: expected the arrays robot and camera, each (n, 4, 4), or a single one of that shape, got the "
            f"arrays {keys}."
        )
    notes.append(f"poses from {short(stacks[0])}")
    side = _side(arrays[stacks[0]], name, f"{name}, {short(stacks[0])}", None, _times(arrays, common, name))
    return Contents(only=side, setup=setup, notes=tuple(notes))


def _times(arrays: dict[str, NDArray[Any]], key: str | None, name: str) -> Array | None:
    if key is None:
        return None
    times = arrays[key]
    if times.ndim != 1 or times.dtype.kind not in "fiu":
        raise InputError(f"{name}, {key}: expected times (n,) in seconds, got {times.dtype} of shape {times.shape}.")
    return times.astype(float)


def _side(array: NDArray[Any], name: str, where: str, frame: str | None, times: Array | None) -> Side:
    if array.dtype.kind not in "fiu":
        raise InputError(f"{where}: expected numbers, got {array.dtype}.")
    if array.ndim != 3 or array.shape[1:] != (4, 4) or not len(array):
        raise InputError(f"{where}: expected poses of shape (n, 4, 4), got {array.shape}.")
    if times is not None and len(times) != len(array):
        raise InputError(f"{where}: expected a time for each of the {len(array)} poses, got {len(times)}.")
    return matrices_side(where, array.astype(float), timestamps=times, frame=frame)


def _members(data: bytes, name: str) -> dict[str, NDArray[Any]]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        size = sum(member.file_size for member in members)
        if len(members) > MAX_ARRAYS or size > MAX_BYTES:
            raise InputError(
                f"{name}: expected at most {MAX_ARRAYS} arrays of {MAX_BYTES / 1e6:g} MB together, got {len(members)} "
                f"of {size / 1e6:g} MB."
            )
        arrays: dict[str, NDArray[Any]] = {}
        for member in members:
            key = member.filename.removesuffix(".npy")
            if key in arrays:
                raise InputError(f"{name}: the array {short(key)} is given twice.")
            if member.filename.endswith(".npy"):
                with archive.open(member) as file:
                    arrays[key] = _array(file, member.file_size, f"{name}, {short(key)}")
    if not arrays:
        raise InputError(f"{name}: expected arrays of NumPy in the archive, got none.")
    return arrays


def _array(file: Any, size: int, where: str) -> NDArray[Any]:
    """One array, read only after its header is seen to fit into the ``size`` bytes that are there."""
    try:
        shape, dtype, start = _header(file)
        if dtype.hasobject:
            raise InputError(f"{where}: expected an array of numbers, got Python objects, which are not unpickled.")
        if math.prod(shape) * dtype.itemsize > size - file.tell() or any(length < 0 for length in shape):
            raise InputError(f"{where}: the file is cut off: its header declares more numbers than it holds.")
        file.seek(start)
        return np.asarray(npy.read_array(file, allow_pickle=False))
    except InputError:
        raise
    except Exception as error:  # headers are Python literals; damaged ones raise many kinds
        raise InputError(f"{where}: not an array of NumPy: {one_line(str(error) or type(error).__name__)}.") from error


def _header(file: BinaryIO) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    start = file.tell()
    version = npy.read_magic(file)
    reader = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = reader(file)
    return shape, dtype, start
