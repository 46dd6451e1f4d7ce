"""Pose files in CSV: one pose per line under the header ``timestamp,x,y,z,qx,qy,qz,qw``.

A line is a timestamp (seconds, or a row number), a position (metres) and a unit quaternion, scalar last. The
columns may come in any order. Blank lines, comment lines that start with ``#``, spaces around fields, a byte
order mark and Windows line ends are tolerated; everything else that is not such a table is an error that
names the file, the line as an editor numbers it, and the column.
"""

from __future__ import annotations

import re
import warnings
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ..errors import InputError, InputWarning
from ..poses import first_duplicate
from ..se3 import Array, as_transforms
from ..units import LENGTH_UNITS
from ._files import StrPath, as_path, opened, require_size, shown
from .atomic import write_atomically

COLUMNS = ("timestamp", "x", "y", "z", "qx", "qy", "qz", "qw")
HEADER = ",".join(COLUMNS)

# What a hostile or mistaken file may cost: the file is read line by line, so memory grows with its rows only.
MAX_BYTES = 1_000_000_000
MAX_ROWS = 10_000_000
MAX_LINE = 10_000

# | |q| - 1 | of an accepted quaternion: four decimals pass, Euler angles and shifted columns do not.
NORM_TOLERANCE = 1e-3


def read_pose_file(path: StrPath, units: str = "m") -> tuple[NDArray[np.float64], Array]:
    """Timestamps (n,) and poses (n, 4, 4) of a pose file.

    Parameters
    ----------
    path : path of the file
        At most 1 GB, 10,000,000 rows, 10,000 characters per line.
    units : str
        Length unit of ``x, y, z``: m, mm, ... (`uq_handeye.units.LENGTH_UNITS`). The poses are in metres.

    Raises
    ------
    InputError
        One line that names the file, the line and the column: a file that cannot be read or is not such a
        table, numbers that are not finite, quaternions whose norm is not 1 within 1e-3 (the others are
        normalised), repeated timestamps, no rows.
    """
    if units not in LENGTH_UNITS:
        raise InputError(f"Expected `units` to be one of {', '.join(LENGTH_UNITS)}, got {units!r}.")
    path = as_path(path)
    table, lines = _read_table(path)
    _check_table(table, lines, shown(path))
    poses = np.zeros((len(table), 4, 4))
    poses[:, :3, :3] = Rotation.from_quat(table[:, 4:]).as_matrix()
    poses[:, :3, 3] = table[:, 1:4] * LENGTH_UNITS[units]
    poses[:, 3, 3] = 1.0
    return table[:, 0].copy(), poses


def write_pose_file(path: StrPath, poses: Any, timestamps: ArrayLike | None = None) -> None:
    """Write poses (n, 4, 4) (array or SciPy ``RigidTransform``, metres) as a pose file, atomically.

    Numbers carry full precision: reading the file back loses at most rounding (1e-15 in the rotation). A
    rotation that is orthogonal only within the tolerance of the toolkit becomes the nearest rotation.
    ``timestamps`` (n,) must differ; left out, they are row numbers 0, 1, 2, ...

    Raises `InputError` for poses or timestamps that `read_pose_file` would refuse, and for a file that cannot
    be written.
    """
    write_atomically(path, pose_text(poses, timestamps))


def pose_text(poses: Any, timestamps: ArrayLike | None = None) -> str:
    """What `write_pose_file` writes.

    >>> print(pose_text(np.eye(4)[None]), end="")
    timestamp,x,y,z,qx,qy,qz,qw
    0.0,0.0,0.0,0.0,0.0,0.0,0.0,1.0
    """
    T = as_transforms(poses, "poses")
    if T.ndim != 3 or len(T) == 0:
        raise InputError(f"Expected `poses` to have shape (n, 4, 4) with n >= 1, got {T.shape}.")
    try:
        times = np.asarray(np.arange(len(T)) if timestamps is None else timestamps, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"Expected `timestamps` to be numbers, got {type(timestamps).__name__}.") from error
    if times.shape != (len(T),) or not np.isfinite(times).all():
        raise InputError(f"Expected `timestamps` to be {len(T)} finite numbers, got shape {times.shape}.")
    if (twins := first_duplicate(times)) is not None:
        raise InputError(f"Expected `timestamps` to differ, got {times[twins[0]]} for poses {twins[0]} and {twins[1]}.")
    quaternions = Rotation.from_matrix(T[:, :3, :3]).as_quat(canonical=True)
    table = np.column_stack([times, T[:, :3, 3], quaternions]) + 0.0  # + 0.0 turns -0.0 into 0.0
    rows = (",".join(map(repr, row.tolist())) for row in table)
    return "\n".join([HEADER, *rows, ""])


def _read_table(path: Path) -> tuple[Array, NDArray[np.int64]]:
    """The numbers (n, 8) in the order of `COLUMNS`, finite or not, and the line number of each row."""
    name = shown(path)
    values, lines = array("d"), array("q")
    names: list[str] = []
    with opened(path, MAX_BYTES) as file:
        for number, line in enumerate(_lines(file, path), start=1):
            text = line.strip()
            if not text or text.startswith(b"#"):
                continue
            if not names:
                names = _column_names(text, f"{name}, line {number}")
                continue
            fields = text.split(b",")
            try:
                row = list(map(float, fields))
            except ValueError:
                _explain_row(fields, names, f"{name}, line {number}")
            if len(fields) != len(names) or b"_" in text:  # float() takes 1_000 for a number
                _explain_row(fields, names, f"{name}, line {number}")
            if len(lines) == MAX_ROWS:
                raise InputError(f"{name}, line {number}: expected at most {MAX_ROWS} rows; split the file.")
            values.extend(row)
            lines.append(number)
    if not names:
        raise InputError(f"{name}: the file is empty; expected the header {HEADER} and one line per pose.")
    if not lines:
        raise InputError(f"{name}: no rows after the header; expected one line per pose.")
    table = np.frombuffer(values).reshape(-1, len(names))
    return table[:, [names.index(column) for column in COLUMNS]], np.frombuffer(lines, dtype=np.int64)


def _lines(file: BinaryIO, path: Path) -> Iterator[bytes]:
    """The lines of a file, none of them longer than `MAX_LINE`, without a byte order mark."""
    total = 0
    while line := file.readline(MAX_LINE + 2):  # + 2: the line end may be CR LF
        if not total:
            line = line.removeprefix(b"\xef\xbb\xbf") or b"\n"
        if len(line) > MAX_LINE and len(line.rstrip(b"\r\n")) > MAX_LINE:
            raise InputError(
                f"{shown(path)}: expected lines of at most {MAX_LINE} characters, got a longer one after "
                f"{total} bytes; is it a CSV file?"
            )
        total += len(line)
        if total > MAX_BYTES:  # what is not a regular file tells its size only by ending
            require_size(total, MAX_BYTES, path)
        yield line


def _column_names(line: bytes, where: str) -> list[str]:
    """The names in the header line; raises `InputError` unless they are those of `COLUMNS`, in any order."""
    text = _decoded(line, f"{where}: expected the header {HEADER}")
    names = [name.strip(" \t\"'") for name in text.split(",")]
    if sorted(names) == sorted(COLUMNS):
        return names
    words = re.split(r"[,;\s]+", text)
    if len(words) > 1 and all(_is_number(word.encode()) for word in words):
        problem = "got numbers: the header line is missing, add it as the first line"
    elif set(words) >= set(COLUMNS) and not set(names) >= set(COLUMNS):
        problem = f"got {_short(text)}: separate the fields by commas and end each line with a line feed"
    else:
        missing = [column for column in COLUMNS if column not in names]
        unknown = [name for name in names if name not in COLUMNS]
        repeated = sorted({name for name in names if names.count(name) > 1} - set(unknown))
        parts = (("missing", missing), ("unknown", unknown), ("repeated", repeated))
        details = "; ".join(f"{what}: {_short(', '.join(which))}" for what, which in parts if which)
        problem = f"got {_short(text)} ({details})"
    raise InputError(f"{where}: expected the header {HEADER}, {problem}.")


def _explain_row(fields: list[bytes], names: list[str], where: str) -> NoReturn:
    """Raise the `InputError` that says what is wrong with a line of data."""
    if len(fields) != len(names):
        _decoded(b",".join(fields), f"{where}: expected {len(names)} fields")
        raise InputError(f"{where}: expected {len(names)} fields separated by commas, got {len(fields)}.")
    for name, field in zip(names, fields, strict=True):
        if not _is_number(field):
            text = _decoded(field, f"{where}, column {name}: expected a number").strip(" \t")
            got = _short(text) if text else "an empty field"
            raise InputError(f"{where}, column {name}: expected a number, got {got}.")
    raise AssertionError(where)  # every caller has found something wrong


def _decoded(text: bytes, what: str) -> str:
    try:
        result = text.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{what}, got bytes that are not UTF-8 text; is it a CSV file?") from error
    if "\0" in result:
        raise InputError(f"{what}, got NUL bytes; is it a binary file, or text in UTF-16?")
    return result


def _is_number(text: bytes) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return b"_" not in text


def _short(text: str) -> str:
    """Quoted on one line, and cut where it would flood the message."""
    return ascii(text if len(text) <= 80 else f"{text[:77]}...")


def _check_table(table: Array, lines: NDArray[np.int64], name: str) -> None:
    """Raise `InputError` for numbers that are not finite, repeated timestamps, bad norms."""
    finite = np.isfinite(table)
    if not finite.all():
        row, column = divmod(int(np.argmin(finite)), len(COLUMNS))
        raise InputError(
            f"{name}, line {lines[row]}, column {COLUMNS[column]}: expected a finite number, "
            f"got {table[row, column]}; leave out poses that were not measured, in both files."
        )
    times = table[:, 0]
    if (twins := first_duplicate(times)) is not None:
        raise InputError(
            f"{name}, line {lines[twins[1]]}, column timestamp: {times[twins[1]].item()!r} repeats the one of line "
            f"{lines[twins[0]]}; every pose needs its own (without times, number the rows 0, 1, 2, ...)."
        )
    back = np.flatnonzero(times[1:] < times[:-1])
    if back.size:
        warnings.warn(
            f"{name}: the timestamps go back in {back.size} of {len(times)} rows, first in line {lines[back[0] + 1]}. "
            "Rows are paired by their order in the file, so this matters only if it is not what you expect.",
            InputWarning,
            stacklevel=4,
        )
    quaternions = table[:, 4:]
    with np.errstate(over="ignore"):  # an infinite norm is as wrong as a large one
        norms = np.sqrt(np.einsum("ij,ij->i", quaternions, quaternions))
    wrong = np.abs(norms - 1.0) > NORM_TOLERANCE
    if wrong.any():
        row = int(np.argmax(wrong))
        where = f"{name}, line {lines[row]}, columns qx,qy,qz,qw"
        if norms[row] < NORM_TOLERANCE:
            hint = "the orientation is missing; leave out poses that were not measured, in both files."
        else:
            hint = "are the columns shifted, or are these Euler angles, a rotation vector or rounded numbers?"
        raise InputError(f"{where}: expected a unit quaternion, got the norm {norms[row]:.6g}: {hint}")
