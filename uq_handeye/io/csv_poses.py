"""Pose files in CSV: one pose per line under the header ``timestamp,x,y,z,qx,qy,qz,qw``.

A line is a timestamp (seconds, or a row number), a position (metres) and a unit quaternion; the columns may come in any
order. Other common names of them are taken as well (`ALIASES`), and the timestamp may be left out. Blank lines, comment
lines that start with ``#``, spaces around fields, a byte order mark and Windows line ends are tolerated; everything
else that is not such a table is an error that names the file, the line as an editor numbers it, and the column.
"""

from __future__ import annotations

import re
import warnings
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ..errors import InputError, InputWarning
from ..poses import first_duplicate
from ..se3 import Array, as_transforms
from ._files import StrPath, as_path, opened, shown
from ._lines import MAX_BYTES, decoded, is_number, rows_of, short
from ._side import COLUMNS, Contents, Side, finished, require_units
from .atomic import write_atomically

HEADER = ",".join(COLUMNS)

# Other names of the columns, in small letters, that mean one thing only.
ALIASES = {
    **dict.fromkeys(("t", "time", "stamp", "time_s", "timestamp_s"), "timestamp"),
    **{f"{prefix}{axis}": axis for prefix in ("t", "t_", "p", "p_", "pos_") for axis in "xyz"},
    **{f"{prefix}{axis}": f"q{axis}" for prefix in ("q_", "quat_") for axis in "xyzw"},
}


def read_csv(file: BinaryIO, name: str) -> Contents:
    """The poses of a CSV file, as they stand there."""
    names: list[str] = []
    notes: list[str] = []

    def fields_of(text: bytes, where: str) -> list[bytes] | None:
        if not names:
            found = _column_names(text, where)
            names.extend(found)
            return None
        fields = text.split(b",")
        if len(fields) != len(names):
            decoded(text, f"{where}: expected {len(names)} fields")
            raise InputError(f"{where}: expected {len(names)} fields separated by commas, got {len(fields)}.")
        return fields

    def explain(fields: list[bytes], where: str) -> NoReturn:
        for column, field in zip(names, fields, strict=True):
            if not is_number(field):
                text = decoded(field, f"{where}, column {column}: expected a number").strip(" \t")
                got = short(text) if text else "an empty field"
                raise InputError(f"{where}, column {column}: expected a number, got {got}.")
        raise AssertionError(where)  # the caller has found something wrong

    table, lines = rows_of(file, name, fields_of, explain)
    if not names:
        raise InputError(f"{name}: the file is empty; expected the header {HEADER} and one line per pose.")
    if not len(lines):
        raise InputError(f"{name}: no rows after the header; expected one line per pose.")
    meant = [meaning(column) for column in names]
    if meant != names:
        notes.append(f"columns {', '.join(names)} read as {', '.join(meant)}")
    # The quaternion as it stands in the file, and the order in which its columns are named.
    quaternion = [k for k, column in enumerate(meant) if column.startswith("q")]
    order = "".join(meant[k][1] for k in quaternion)
    if order not in ("xyzw", "wxyz"):
        quaternion, order = [meant.index(column) for column in COLUMNS[4:]], "xyzw"
    elif order == "wxyz":
        notes.append("quaternions with the scalar first, as the columns are named")
    times = None
    if "timestamp" in meant:
        times = table[:, meant.index("timestamp")].copy()
    else:
        notes.append("no timestamp column: rows are numbered 0, 1, 2, ...")
    translation = [meant.index(axis) for axis in "xyz"]
    columns = (
        names[meant.index("timestamp")] if times is not None else "timestamp",
        *(names[k] for k in translation + quaternion),
    )
    side = Side(name, table[:, translation], table[:, quaternion], times, lines, "line", order, columns)
    return Contents(only=side, notes=tuple(notes))


def read_pose_file(path: StrPath, units: str = "m") -> tuple[NDArray[np.float64], Array]:
    """Timestamps (n,) and poses (n, 4, 4) of a CSV pose file.

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
    require_units(units)
    path = as_path(path)
    with opened(path, MAX_BYTES) as file:
        contents = read_csv(file, shown(path))
    side = contents.only
    assert side is not None
    poses = finished(side, "robot", units, None, "base_T_gripper")
    warn_if_back(side)
    return (np.arange(len(side), dtype=float) if side.timestamps is None else side.timestamps), poses


def warn_if_back(side: Side) -> None:
    """Warn of timestamps that go back from one row to the next."""
    if side.timestamps is None:
        return
    back = np.flatnonzero(side.timestamps[1:] < side.timestamps[:-1])
    if back.size:
        where = side.at(back[0] + 1).removeprefix(f"{side.name}, ")
        warnings.warn(
            f"{side.name}: the timestamps go back in {back.size} of {len(side)} rows, first in {where}. Rows are "
            "paired by their order in the file, so this matters only if it is not what you expect.",
            InputWarning,
            stacklevel=3,
        )


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


def meaning(column: str) -> str:
    """The column of `COLUMNS` that a name means, or the name itself."""
    small = column.lower()
    return small if small in COLUMNS else ALIASES.get(small, column)


def _column_names(line: bytes, where: str) -> list[str]:
    """The names in the header line; raises `InputError` unless they mean those of `COLUMNS`, in any order."""
    text = decoded(line, f"{where}: expected the header {HEADER}")
    names = [name.strip(" \t\"'") for name in text.split(",")]
    meant = [meaning(name) for name in names]
    if sorted(meant) in (sorted(COLUMNS), sorted(COLUMNS[1:])):
        return names
    words = re.split(r"[,;\s]+", text)
    if len(words) > 1 and all(is_number(word.encode()) for word in words):
        problem = "got numbers: the header line is missing, add it as the first line"
    elif set(words) >= set(COLUMNS) and not set(names) >= set(COLUMNS):
        problem = f"got {short(text)}: separate the fields by commas and end each line with a line feed"
    else:
        missing = [column for column in COLUMNS if column not in meant]
        unknown = [name for name, column in zip(names, meant, strict=True) if column not in COLUMNS]
        repeated = sorted({column for column in meant if meant.count(column) > 1} - set(unknown))
        parts = (("missing", missing), ("unknown", unknown), ("repeated", repeated))
        details = "; ".join(f"{what}: {short(', '.join(which))}" for what, which in parts if which)
        problem = f"got {short(text)} ({details})"
    raise InputError(f"{where}: expected the header {HEADER}, {problem}.")
