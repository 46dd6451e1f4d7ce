"""Poses in NumPy's files: ``.npy`` with one array (n, 4, 4), ``.npz`` with arrays by name.

Names in ``.npz``: ``robot`` and ``camera``, or a frame (`pose_name`), each (n, 4, 4); or rotations and translations by
the names of OpenCV's arguments (`opencv_storage.PAIRS`); ``timestamps`` for both, or ``robot_timestamps`` and
``camera_timestamps``; ``setup``. A file with a single array (n, 4, 4) of another name, or with ``R`` and ``t`` or
``rvecs`` and ``tvecs`` only, holds one side. Matrices may lack their last row, (n, 3, 4), be flat, (n, 16), or be
stored column by column (`matrices.arrays`). Nothing is unpickled, and the sizes that a file declares are checked before
anything is read. Source of the rules: numpy/numpy, ``numpy/lib/_format_impl.py``.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable
from dataclasses import replace
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..core.files.one_line import refused, short
from ..core.files.pose_names import pose_name, poses_named
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array
from ..core.limits import MAX_TABLE_BYTES
from ..errors import InputError
from .contents import Contents, Side, conversion
from .matrices.arrays import is_one_pose, is_poses, side_of_array
from .opencv_storage import Joined, joined_pairs

MAX_ARRAYS = 100
FRANKA = "O_T_EE"
TIMES = ("timestamps", "timestamp", "times", "t")
# Other names of rotations and translations.
_ALIASES = {"rvec": "rvecs", "tvec": "tvecs", "rotations": "R", "translations": "t", "Rs": "R", "ts": "t"}


def read_npy(data: bytes, name: str) -> Contents:
    """One array (n, 4, 4)."""
    side, notes = side_of_array(_numbers(_array(io.BytesIO(data), len(data), name), name), name)
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
    setup = str(arrays["setup"]) if "setup" in arrays else None
    if setup is not None and setup not in SETUPS:
        raise InputError(f"{name}, setup: expected {' or '.join(SETUPS)}, got {short(setup)}.")
    numbers = {key: array.astype(float) for key, array in arrays.items() if array.dtype.kind in "fiu"}

    def times_of(key: str) -> Array | None:
        if (times := arrays.get(key)) is None:
            return None
        if times.ndim != 1 or times.dtype.kind not in "fiu":
            raise InputError(
                f"{name}, {key}: expected times (n,) in seconds, got {times.dtype} of shape {times.shape}."
            )
        return times.astype(float)

    for key, array in arrays.items():
        if key not in numbers and "time" in key:
            times_of(key)
        elif key not in numbers and pose_name(key) is not None:
            _numbers(array, f"{name}, {key}")
    if FRANKA in numbers and not any(map(pose_name, numbers)):
        numbers = {key: array for key, array in numbers.items() if key == FRANKA or not is_poses(array.shape)}
    contents = _of_arrays(numbers, joined_pairs(numbers, name), times_of, name)
    if contents is None:
        raise InputError(
            f"{name}: expected the arrays robot and camera, each (n, 4, 4), or a single one of that shape, or "
            "rotations and translations as R_gripper2base and t_gripper2base, got the arrays "
            f"{short(', '.join(arrays))}."
        )
    said = () if setup is None else (f"{setup}, as the file says",)
    return replace(contents, setup=setup, notes=(*said, *contents.notes))


def _of_arrays(
    arrays: dict[str, Array], joined: Joined, times_of: Callable[[str], Array | None], name: str
) -> Contents | None:
    """Return both sides of arrays by name, or the only poses that there are; None for none, or several.

    ``joined`` are poses of rotations and translations, which stand apart, and those that may be of either side.
    """
    pairs, either = joined
    common = next((key for key in TIMES if key in arrays and not (key == "t" and (pairs or either))), "")
    stacked = [key for key, values in arrays.items() if is_poses(values.shape) and key not in TIMES]
    named = poses_named(stacked) | {key: known for key in arrays if (known := pose_name(key)) is not None}
    found = [(key, *named[key], values) for key, values in arrays.items() if key in named]
    found += pairs
    if either is not None and found:
        found.append((either[0], "camera", "camera_T_target", either[1]))
    sides: dict[str, Side] = {}
    notes: list[str] = []
    for key, role, frame, values in found:
        if role in sides:
            raise InputError(f"{name}: expected the {role} poses once, got the arrays {short(', '.join(arrays))}.")
        if key != role:
            notes.append(f"{role} poses from {key}")
        own = next((k for k in (f"{role}_timestamps", f"{role}_times") if k in arrays), common)
        frame_said = None if key == role else frame
        sides[role], said = side_of_array(values, f"{name}, {key}", frame_said, times_of(own))
        notes += said
    if sides:
        return Contents(sides.get("robot"), sides.get("camera"), notes=tuple(notes))
    stacks = [either] if either else [one for one in arrays.items() if one[0] not in TIMES and is_poses(one[1].shape)]
    if len(stacks) > 1:  # beside a single pose, such as one at which the robot waits
        stacks = [(key, values) for key, values in stacks if not is_one_pose(values.shape)] or stacks
        matrices = [(key, values) for key, values in stacks if values.size >= 12 * len(values)]
        stacks = matrices if len(matrices) == 1 else stacks  # beside joint values
    if len(stacks) != 1:
        return None
    ((key, values),) = stacks
    side, said = side_of_array(values, f"{name}, {short(key)}", None, times_of(common))
    left = short(", ".join(one for one in arrays if one not in (key, common)))
    notes = [f"poses from {short(key)}", *said, *([f"not used: the arrays {left}"] if left and not either else [])]
    return Contents(only=side, notes=tuple(notes))


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
        if len(members) > MAX_ARRAYS or size > MAX_TABLE_BYTES:
            raise InputError(
                f"{name}: expected at most {MAX_ARRAYS} arrays of {MAX_TABLE_BYTES / 1e6:g} MB together, got "
                f"{len(members)} of {size / 1e6:g} MB."
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
