"""Pose files in CSV: one pose per line under the header ``timestamp,x,y,z,qx,qy,qz,qw``.

A line is a timestamp (seconds, or a row number), a position (metres) and a unit quaternion; the columns may come in any
order. Other common names of them are taken as well (`columns`), with units behind them; the timestamp may be left out,
and further columns are not used. Fields are separated by commas, or, where the header has none, by semicolons (numbers
then may have decimal commas) or tabs. Blank lines, comment lines that start with ``#``, spaces and quotes around
fields, a byte order mark and Windows line ends are tolerated, and so is a header that is a comment. Any other deviation
is an error that names the file, the line as an editor numbers it, and the column.
"""

from __future__ import annotations

import re
import warnings
from contextlib import suppress
from dataclasses import replace
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.files.atomic import write_atomically
from ..core.files.folders import numbers_in
from ..core.files.one_line import short
from ..core.files.open import StrPath, as_path, opened, shown
from ..core.files.table import MARKS, Places, Schema, in_order, numbers_only, read_table, split_names
from ..core.geometry.checks import as_transforms, first_duplicate
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array
from ..core.limits import MAX_TABLE_BYTES
from ..errors import InputError, InputWarning
from .columns import counts_poses, covariance_columns, in_seconds, meaning_and_unit
from .contents import COLUMNS, Contents, Side, finished, require_units, without_repeats

HEADER = ",".join(COLUMNS)
# Columns of points in place of poses.
_POINTS = ("point", "point_id", "marker", "marker_id", "feature", "feature_id")
OF_POINTS = "of points, uq-handeye points -o DIR makes camera poses (docs/how-to/points.md)"


def read_csv(file: BinaryIO, name: str) -> Contents:
    """The poses of a CSV file, as they stand there."""
    table = read_table(file, name, SCHEMA)
    names = list(table.headings)
    covariances = covariance_columns(table.names)
    if covariances is not None:  # they come behind the columns of the poses
        names = names[: -len(set(covariances[0]))]
    meant, units = map(list, zip(*map(meaning_and_unit, names), strict=True))
    unit_of = dict(zip(meant, units, strict=True))
    notes = []
    if meant != names:
        notes.append(f"columns {', '.join(names)} read as {', '.join(meant)}")
    numbers = numbers_in(text for (text,) in table.texts)
    used = {*table.places.numbers, *(table.places.texts if numbers else ())}  # names with a number match rows
    if left := [one for k, one in enumerate(table.names) if k not in used]:
        notes.append(f"not used: the columns {short(', '.join(left))}")
    if table.mark != ",":
        marks = "semicolons, numbers with decimal commas" if table.decimal_commas else MARKS[table.mark]
        notes.append(f"fields separated by {marks}")
    # The quaternion as it stands in the file, and the order in which its columns are named.
    quaternion = [k for k, column in enumerate(meant) if column.startswith("q")]
    order = "".join(meant[k][1] for k in quaternion)
    if order not in ("xyzw", "wxyz"):
        quaternion, order = [meant.index(column) for column in COLUMNS[4:]], "xyzw"
    elif order == "wxyz":
        notes.append("quaternions with the scalar first, as the columns are named")
    times = None
    if "timestamp" in meant:
        column = meant.index("timestamp")
        times, note = table.values[:, column], ""
        if names[column] != "timestamp":  # which is in seconds, as the table of poses is defined
            times, note = in_seconds(times, unit_of["timestamp"] or "s")
        notes += [note] if note else []
    else:
        by = f"by the column {short(table.names[table.places.texts[0]])}" if numbers else "0, 1, 2, ..."
        notes.append(f"no timestamp column: rows are numbered {by}")
    translation = [meant.index(axis) for axis in "xyz" if axis in meant]
    if (length := unit_of.get("x")) is not None:
        notes.append(f"translations in {length}, as the columns are named")
    positions = table.values[:, translation]
    if not translation:
        notes.append("no positions: orientations only")
        positions = np.zeros((len(table.values), 3))
    columns = (
        names[meant.index("timestamp")] if times is not None else "timestamp",
        *([names[k] for k in translation] or "xyz"),
        *(names[k] for k in quaternion),
    )
    side = Side(
        name, positions, table.values[:, quaternion], times, table.lines, "line", order, columns,
        units=length, numbers=numbers,
    )  # fmt: skip
    if covariances is not None:
        places = [table.places.numbers.index(k) for k in covariances[0]]
        side = replace(side, covariance=table.values[:, places].reshape(-1, 6, 6), convention=covariances[1])
    return Contents(only=side, notes=tuple(notes))


def read_pose_file(path: StrPath, units: str = "m") -> tuple[NDArray[np.float64], Array]:
    """Timestamps (n,) and poses (n, 4, 4) of a CSV pose file.

    Parameters
    ----------
    path : path of the file
        At most 1 GB, 10,000,000 rows, 10,000 characters per line.
    units : str
        Length unit of ``x, y, z``: m, mm, ... (`uq_handeye.core.presentation.units.LENGTH_UNITS`).
        The poses are in metres.

    Raises
    ------
    InputError
        One line that names the file, the line and the column: a file that cannot be read or is not such a
        table, numbers that are not finite, quaternions whose norm is not 1 within 1e-3 (the others are
        normalised), repeated timestamps with other numbers, no rows.
    """
    require_units(units)
    path = as_path(path)
    with opened(path, MAX_TABLE_BYTES) as file:
        contents = without_repeats(read_csv(file, shown(path)))
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
    """Return the text that `write_pose_file` writes.

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


# Columns of a file: with or without timestamps, and of a sensor that gives orientations only without positions.
ACCEPTED = [sorted(columns) for columns in (COLUMNS, COLUMNS[1:], (COLUMNS[0], *COLUMNS[4:]), COLUMNS[4:])]


def _places(names: list[str], line: str, where: str) -> Places:
    """Find the columns; raises `InputError` unless the names mean those of `COLUMNS`, in any order, and others."""
    meant, units = map(list, zip(*map(meaning_and_unit, names), strict=True))
    used = [k for k, column in enumerate(meant) if column in COLUMNS]
    if sorted(meant[k] for k in used) in ACCEPTED:
        if len(lengths := {units[k] for k in used if meant[k] in "xyz"}) > 1:
            got = ", ".join(sorted(unit or "none" for unit in lengths))
            raise InputError(f"{where}: expected one unit for x, y and z, got {got}.")
        counting = (k for k, name in enumerate(names) if k not in used and counts_poses(name))
        found = covariance_columns(names)
        covariance = [] if found is None else sorted(set(found[0]))
        return Places([*used, *covariance], list(counting)[:1])
    if words := list(numbers_only(line)):
        what = f"got numbers: the header line is missing, {_missing_line(len(words))}"
        raise InputError(f"{where}: expected the header {HEADER}, {what}.")
    missing, repeated = in_order(meant, COLUMNS)
    missing = [column for column in missing if column != "timestamp"]
    unknown = [name for name, column in zip(names, meant, strict=True) if column not in COLUMNS]
    parts = (("missing", missing), ("unknown", unknown), ("repeated", sorted(repeated)))
    details = "; ".join(f"{what}: {short(', '.join(which))}" for what, which in parts if which)
    hint = "; end each line with a line feed" if "\r" in line else ""
    if not {"x", "y", "z"} & set(missing) and set(COLUMNS[4:]) <= set(missing):
        hint = "; rotations must be quaternions here; for others see --rotation and docs/how-to/controller.md"
    elif missing:
        hint += "; docs/how-to/controller.md"
        if any(name.lower() in _POINTS for name in unknown):
            hint = f"; {OF_POINTS}"
    raise InputError(f"{where}: expected the header {HEADER}, got {short(line)} ({details}){hint}.")


def _is_header(names: list[str]) -> bool:
    with suppress(InputError):
        return bool(_places(names, "", "").numbers)
    return False


SCHEMA = Schema(f"the header {HEADER}", "pose", _places, named=_is_header, quotes=True)


def is_csv_header(line: str) -> bool:
    """Return whether a line names the columns of `COLUMNS`, and perhaps others."""
    return _is_header(split_names(line)[0])


def is_points_header(line: str) -> bool:
    """Return whether a line names points in 3-D: x, y, z and a point, no rotation."""
    names = [name.strip(" \t\"'#\ufeff").lower() for name in re.split(r"[,;\t]", line)]
    meant = {meaning_and_unit(name)[0] for name in names}
    return {"x", "y", "z"} <= meant and "qw" not in meant and any(name in _POINTS for name in names)


def _missing_line(n: int) -> str:
    """Describe what to do with n numbers in a line without names."""
    if n in (12, 16):
        return f"or, if the {n} numbers are a matrix, it is read as --format matrix, or by its content"
    names = f"{HEADER} or {','.join(COLUMNS[1:])}"
    return (
        f"add it as the first line, as the columns stand in the file: {names}, or with qw first; for other numbers see "
        "docs/how-to/controller.md"
    )
