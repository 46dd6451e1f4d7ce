"""Poses in NumPy's files: ``.npy`` with one array (n, 4, 4), ``.npz`` with arrays by name.

Names in ``.npz``: ``robot`` and ``camera``, or a frame (`pose_name`), each (n, 4, 4); or rotations and translations by
the names of OpenCV's arguments (`opencv_storage.PAIRS`); ``timestamps`` for both, or ``robot_timestamps`` and
``camera_timestamps``; ``setup``. A file with a single array (n, 4, 4) of another name, or with ``R`` and ``t`` or
``rvecs`` and ``tvecs`` only, holds one side. Matrices may lack their last row, (n, 3, 4), be flat, (n, 16), or stand
column by column (`matrices.arrays`). Nothing is unpickled, and the sizes that a file declares are checked before
anything is read. Source of the rules: numpy/numpy, ``numpy/lib/_format_impl.py``.
"""

from __future__ import annotations

import io
import math
import zipfile
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..core.files.lines import refused, short
from ..core.files.trees import pose_name
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array
from ..errors import InputError
from .contents import Contents, Side
from .matrices.arrays import is_poses, side_of_array
from .not_poses import conversion
from .opencv_storage import joined_pairs

MAX_BYTES = 500_000_000  # of all arrays of a file, unpacked
MAX_ARRAYS = 100
FRANKA = "O_T_EE"
TIMES = ("timestamps", "timestamp", "times", "t")

# Other names of rotations and translations.
_ALIASES = {"rvec": "rvecs", "tvec": "tvecs", "rotations": "R", "translations": "t", "Rs": "R", "ts": "t"}


def read_npy(data: bytes, name: str) -> Contents:
    """One array (n, 4, 4)."""
    side, notes = _side(_array(io.BytesIO(data), len(data), name), name, None, None)
    return Contents(only=side, notes=tuple(notes))


def read_one_array(data: bytes, name: str) -> Array:
    """The numbers of a ``.npy``, or of a ``.npz`` that holds a single array."""
    if not data.startswith(b"PK"):
        return _numbers(_array(io.BytesIO(data), len(data), name), name)
    arrays = unpacked(data, name)
    if len(arrays) != 1:
        raise InputError(f"{name}: expected one array, got {short(', '.join(arrays))}.")
    (only,) = arrays.values()
    return _numbers(only, name)


def unpacked(data: bytes, name: str) -> dict[str, NDArray[Any]]:
    """All arrays of an archive, by name; raises `InputError`, also for a damaged one."""
    with refused(f"{name}: the archive is damaged"):
        found = members(data, name)
    return found


def read_npz(data: bytes, name: str) -> Contents:
    """Arrays by name."""
    arrays = unpacked(data, name)
    if not arrays.keys() & _ALIASES.values():
        arrays = {_ALIASES.get(key, key): array for key, array in arrays.items()}
    keys = short(", ".join(arrays))
    setup, notes = None, []
    if "setup" in arrays:
        setup = str(arrays["setup"])
        if setup not in SETUPS:
            raise InputError(f"{name}, setup: expected {' or '.join(SETUPS)}, got {short(setup)}.")
        notes.append(f"{setup}, as the file says")
    common = next((key for key in TIMES if key in arrays), None)
    if common == "t" and "R" in arrays:  # translations
        common = None
    sides: dict[str, Side] = {}
    found = [(key, *known, array) for key, array in arrays.items() if (known := pose_name(key)) is not None]
    numbers = {key: array.astype(float) for key, array in arrays.items() if array.dtype.kind in "fiu"}
    pairs, either = joined_pairs(numbers, name)
    found += pairs
    if either is not None and found:
        found.append((either[0], "camera", "camera_T_target", either[1]))
    for key, role, frame, array in found:
        if role in sides:
            raise InputError(f"{name}: expected the {role} poses once, got the arrays {keys}.")
        if key != role:
            notes.append(f"{role} poses from {key}")
        times = next((k for k in (f"{role}_timestamps", f"{role}_times") if k in arrays), common)
        stamps = _times(arrays, times, name)
        sides[role], said = _side(array, f"{name}, {key}", None if key == role else frame, stamps)
        notes += said
    if sides:
        return Contents(sides.get("robot"), sides.get("camera"), setup=setup, notes=tuple(notes))
    if either is not None:
        side, said = _side(either[1], f"{name}, {either[0]}", None, _times(arrays, common, name))
        return Contents(only=side, setup=setup, notes=(*notes, f"poses from {either[0]}", *said))
    stacks = [key for key, array in arrays.items() if is_poses(array.shape) and array.dtype.kind in "fiu"]
    if FRANKA in stacks:
        stacks = [FRANKA]
    if len(stacks) != 1:
        raise InputError(
            f"{name}: expected the arrays robot and camera, each (n, 4, 4), or a single one of that shape, or "
            f"rotations and translations as R_gripper2base and t_gripper2base, got the arrays {keys}."
        )
    notes.append(f"poses from {short(stacks[0])}")
    side, said = _side(arrays[stacks[0]], f"{name}, {short(stacks[0])}", None, _times(arrays, common, name))
    return Contents(only=side, setup=setup, notes=(*notes, *said))


def _times(arrays: dict[str, NDArray[Any]], key: str | None, name: str) -> Array | None:
    if key is None:
        return None
    times = arrays[key]
    if times.ndim != 1 or times.dtype.kind not in "fiu":
        raise InputError(f"{name}, {key}: expected times (n,) in seconds, got {times.dtype} of shape {times.shape}.")
    return times.astype(float)


def _side(array: NDArray[Any], where: str, frame: str | None, times: Array | None) -> tuple[Side, list[str]]:
    return side_of_array(_numbers(array, where), where, frame, times)


def _numbers(array: NDArray[Any], where: str) -> Array:
    if array.dtype.kind not in "fiu":
        raise InputError(f"{where}: expected numbers, got {array.dtype}.")
    numbers: Array = array.astype(float)
    return numbers


def members(data: bytes, name: str) -> dict[str, NDArray[Any]]:
    """All arrays of an archive, by name; raises `InputError`, and whatever zipfile raises of a damaged one."""
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
    with refused(f"{where}: not an array of NumPy"):
        shape, dtype, start = _header(file)
        if dtype.hasobject:
            raise InputError(
                f"{where}: expected an array of numbers, got Python objects, which are never unpickled: they "
                f"can run any code. {conversion(where, 'list(np.load(FILE, allow_pickle=True))')}"
            )
        if math.prod(shape) * dtype.itemsize > size - file.tell() or any(length < 0 for length in shape):
            raise InputError(f"{where}: the file is cut off: its header declares more numbers than it holds.")
        file.seek(start)
        found = np.asarray(npy.read_array(file, allow_pickle=False))
    return found


def _header(file: BinaryIO) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    start = file.tell()
    version = npy.read_magic(file)
    reader = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = reader(file)
    return shape, dtype, start
