"""Files of joint values, one row per pose: CSV under a header with the names of the joints, or arrays of NumPy.

    timestamp,shoulder [deg],elbow [deg],wrist_deg

Columns are taken by name, in any order; further ones are ignored. A unit may follow the name. Names may have
parts around them, as PlotJuggler, LeRobot and others write them (``/joint_states/elbow/position``, ``elbow.pos``);
columns of velocities and efforts are none. Rows of ``rostopic echo -p``, with the names of a ``JointState`` in columns
``name0``, ``name1`` and its values in ``position0``, ..., are sorted by those names, row by row.

Arrays: ``.npy`` (n, L) in the order of the arm, or ``.npz`` with the array ``q``, ``joints``, ``joint_positions`` or
``position`` (n, L), ``names`` (L) of its columns, and ``timestamps`` (n).

Values are in rad and m unless the header or the caller says otherwise. Degrees that are read as radians lie far outside
the limits of the joints, and are refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.files.one_line import short
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.table import Places, Schema, Table, name_and_unit, read_table, rows_are_numbers
from ...core.formatting.units import ANGLE_UNITS, LENGTH_UNITS
from ...core.geometry.checks import first_duplicate
from ...core.geometry.se3 import Array
from ...core.numbers.limits import MAX_TABLE_BYTES
from ...errors import InputError
from ...formats.columns import SECONDS, meaning_and_unit
from ...formats.numpy_poses import TIMES, read_one_array, unpacked
from .chain import Kinematics
from .descriptions.urdf import nearest
from .joint import PRISMATIC, REVOLUTE, require_within_limits

# Lists of names in rows that name their joints.
MAX_ORDERS = 1000
DEGREE, MILLIMETRE = ANGLE_UNITS["deg"], LENGTH_UNITS["mm"]

_NUMBERED = re.compile(r"(?:.*[./])?(name|position)[_.]?\[?(\d{1,6})\]?")
_OTHERS = {"velocity", "velocities", "vel", "effort", "efforts", "eff", "torque", "current", "acceleration", "acc"}
_ARRAYS = ("q", "joints", "joint_positions", "positions", "position")


class NamedJoints(NamedTuple):
    """Joint values that are no file, such as those of a bag."""

    name: str  # for messages
    names: tuple[str, ...]  # of the columns
    times: Array  # (n,) s
    values: Array  # (n, L)

    def __str__(self) -> str:
        return self.name


class JointTable(NamedTuple):
    """The rows of a joint file."""

    timestamps: Array | None  # (n,) s
    q: Array  # (n, L) rad, m, in the order of the arm
    notes: tuple[str, ...]  # what was found out, in words


@dataclass
class _Wanted:
    """The joints of the arm, and the units in which somebody says that the file has them."""

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    limits: Array | None
    units: dict[str, str]  # by kind
    notes: list[str] = field(default_factory=list)


@dataclass
class _Columns:
    """Meaning of a header."""

    time: tuple[int, float] | None = None  # column, seconds per unit
    joints: list[int] = field(default_factory=list)  # columns of the joints, in the order of the arm
    units: list[str | None] = field(default_factory=list)  # of each joint, as its column says
    by_row: list[tuple[int, int]] = field(default_factory=list)  # columns of name and value, where rows name the joints


def read_joints(path: StrPath | NamedJoints, arm: Kinematics | Sequence[str], units: str | None = None) -> JointTable:
    """Read joint values (n, L) in the order of the arm, with timestamps (n,) or None.

    Parameters
    ----------
    path : path of a CSV, ``.npy`` or ``.npz`` file, or NamedJoints
    arm : Kinematics, or names of revolute joints
        Its joint limits tell degrees from radians.
    units : str or None
        Unit of columns that say none, such as ``"deg"``, ``"mm"`` or ``"deg,mm"``; left out, rad and m.

    Raises
    ------
    InputError
        One line that names the file, the line and the joint: missing joints (with the nearest names), two columns of
        one joint, units that contradict each other or are those of some columns only, numbers that are not finite,
        values far outside the limits of the joints (in degrees?), repeated timestamps, no rows.

    Warns
    -----
    InputWarning
        Values a little outside the limits; values in degrees that are as small as radians.
    """
    wanted = _wanted(arm, units)
    times: Array | None
    lines: NDArray[np.int64] | None = None
    if isinstance(path, NamedJoints):
        name = path.name
        times, (values, named) = path.times, _by_name(path.values, list(path.names), wanted, name, name)
    else:
        path = as_path(path)
        name = shown(path)
        with opened(path, MAX_TABLE_BYTES) as file:
            start = file.peek(8)[:8] if hasattr(file, "peek") else b""
            if start.startswith((b"PK\3\4", b"\x93NUMPY")):
                data = file.read(MAX_TABLE_BYTES + 1)
                if len(data) > MAX_TABLE_BYTES:
                    raise InputError(f"{name}: expected at most {MAX_TABLE_BYTES / 1e6:g} MB, got more.")
                times, values, named = _from_arrays(data, name, wanted)
            else:
                times, values, named, lines = _from_csv(file, name, wanted)
    at = _row_names(name, lines)
    _check_finite(values, wanted, at)
    q = _in_units(values, named, wanted, at, name)
    if times is not None:
        if not np.isfinite(times).all():
            raise InputError(f"{at(int(np.argmin(np.isfinite(times))))}: expected a finite timestamp.")
        if (twins := first_duplicate(times)) is not None:
            raise InputError(f"{at(twins[1])}: the timestamp repeats that of {at(twins[0]).removeprefix(f'{name}, ')}.")
    return JointTable(times, q, tuple(wanted.notes))


def _wanted(arm: Kinematics | Sequence[str], units: str | None) -> _Wanted:
    if isinstance(arm, Kinematics):
        names, kinds, limits = arm.names, tuple(joint.kind for joint in arm.joints), arm.limits
    elif isinstance(arm, str) or not isinstance(arm, Sequence) or not arm or not all(isinstance(n, str) for n in arm):
        raise InputError(f"Expected `arm` to be Kinematics or names of joints, got {type(arm).__name__}.")
    else:
        names, kinds, limits = tuple(arm), (REVOLUTE,) * len(arm), None
    said: dict[str, str] = {}
    if units is not None:
        for word in units.split(",") if isinstance(units, str) else [repr(units)]:
            kind = _kind_of_unit(word.strip())
            if kind is None or kind in said:
                known = ", ".join((*ANGLE_UNITS, *LENGTH_UNITS))
                raise InputError(
                    f"Expected `units` (--joint-units) such as deg, mm or 'deg,mm' of {known}, got {units!r}."
                )
            said[kind] = word.strip()
    return _Wanted(names, kinds, limits, said)


def _kind_of_unit(unit: str) -> str | None:
    return REVOLUTE if unit in ANGLE_UNITS else PRISMATIC if unit in LENGTH_UNITS else None


def _row_names(name: str, lines: NDArray[np.int64] | None) -> Callable[[int], str]:
    return lambda row: f"{name}, row {row}" if lines is None else f"{name}, line {lines[row]}"


def _check_finite(values: Array, wanted: _Wanted, at: Callable[[int], str]) -> None:
    if not np.isfinite(values).all():
        row, k = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
        raise InputError(
            f"{at(row)}, joint {wanted.names[k]}: expected a finite number, got {values[row, k]}; leave out rows that "
            "were not measured, in all files."
        )


# Units and limits


def _in_units(values: Array, named: list[str | None], wanted: _Wanted, at: Callable[[int], str], name: str) -> Array:
    """Values in rad and m, checked against the limits of the joints."""
    q = np.empty_like(values)
    with_unit = np.zeros(len(named), dtype=bool)
    for kind in (REVOLUTE, PRISMATIC):
        of_kind = [k for k, other in enumerate(wanted.kinds) if other == kind]
        units = {named[k] for k in of_kind}
        said = wanted.units.get(kind)
        if of_kind and None in units and len(units) > 1 and said is None:
            without = next(wanted.names[k] for k in of_kind if named[k] is None)
            raise InputError(
                f"{name}: the columns of some {kind} joints name a unit, that of {without} does not; name it, or give "
                "--joint-units."
            )
        for k in of_kind:
            unit = named[k]
            if unit is not None and said not in (None, unit):
                column = f"the column of joint {wanted.names[k]}"
                raise InputError(f"{name}: {column} is in {unit}, and `units` (--joint-units) says {said}.")
            factor = {**ANGLE_UNITS, **LENGTH_UNITS}[unit or said or ("rad" if kind == REVOLUTE else "m")]
            q[:, k] = factor * values[:, k]
            with_unit[k] = unit is not None or said is not None
        if of_kind and (known := (units - {None}) or ({said} if said else set())):
            wanted.notes.append(f"{kind} joints in {', '.join(sorted(map(str, known)))}")
    require_within_limits(q, wanted.names, wanted.kinds, wanted.limits, with_unit, at)
    return q


# CSV


def _from_csv(
    file: BinaryIO, name: str, wanted: _Wanted
) -> tuple[Array | None, Array, list[str | None], NDArray[np.int64]]:
    columns = _Columns()

    def places(names: list[str], line: str, where: str) -> Places:
        nonlocal columns
        columns = _header(names, where, wanted)
        time = [] if columns.time is None else [columns.time[0]]
        return Places([*time, *(columns.joints or [k for _, k in columns.by_row])], [k for k, _ in columns.by_row])

    def named(names: list[str]) -> bool:
        return any(joint in name for joint in wanted.names for name in names)

    table = read_table(file, name, Schema("a header with the names of the joints", "pose", places, named))
    values = table.values
    times = None if columns.time is None else values[:, 0] * columns.time[1]
    values = values if columns.time is None else values[:, 1:]
    if columns.by_row:
        values = _sorted_rows(table, values, wanted)
    if times is None:
        wanted.notes.append("no timestamp column")
    return times, values, columns.units, table.lines


def _header(names: list[str], where: str, wanted: _Wanted) -> _Columns:
    if rows_are_numbers(names):
        raise InputError(
            f"{where}: expected a header with the names of the joints, got numbers; add it as the first line: "
            f"{short(', '.join(wanted.names))}, in the order of the columns."
        )
    found = _Columns()
    for k, name in enumerate(names):
        meaning, unit = meaning_and_unit(name)
        if meaning == "timestamp" and name not in wanted.names and found.time is None:
            found.time = k, SECONDS[unit or "s"]
            if unit not in (None, "s", "sec"):
                wanted.notes.append(f"timestamps in {unit}, as the column is named")
    numbered = [(k, match) for k, name in enumerate(names) if (match := _NUMBERED.fullmatch(name)) is not None]
    at = {(match[1], int(match[2])): k for k, match in numbered}
    pairs = [(at["name", i], at["position", i]) for part, i in at if part == "name" and ("position", i) in at]
    if pairs and not set(wanted.names) & set(names):
        found.by_row, found.units = pairs, [None] * len(wanted.names)
        wanted.notes.append("joints sorted by the names in each row")
        return found
    matches = [_matches(joint, kind, names) for joint, kind in zip(wanted.names, wanted.kinds, strict=True)]
    if not any(matches):
        matches = _by_number(names, wanted)
    for joint, columns in zip(wanted.names, matches, strict=True):
        if len(columns) > 1:
            which = short(", ".join(names[k] for k, _ in columns))
            raise InputError(f"{where}: expected one column of joint {joint}, got {which}.")
    _require_all([joint for joint, columns in zip(wanted.names, matches, strict=True) if not columns], names, where)
    found.joints, found.units = [columns[0][0] for columns in matches], [columns[0][1] for columns in matches]
    if twice := [k for k in found.joints if found.joints.count(k) > 1]:
        raise InputError(f"{where}: the column {short(names[twice[0]])} fits several joints.")
    _note_columns(found, names, wanted)
    return found


def _note_columns(found: _Columns, names: list[str], wanted: _Wanted) -> None:
    if found.joints != sorted(found.joints):
        wanted.notes.append("columns sorted by the names of the joints")
    used = {*found.joints, *(() if found.time is None else (found.time[0],))}
    if left := [name for k, name in enumerate(names) if k not in used]:
        wanted.notes.append(f"not used: the columns {short(', '.join(left))}")


def _require_all(missing: list[str], names: Sequence[str], where: str) -> None:
    if missing:
        some = ", ".join(missing[:8]) + (f" and {len(missing) - 8} more" if len(missing) > 8 else "")
        raise InputError(f"{where}: no column of joint {some}{nearest(missing[0], [name for name in names if name])}.")


def _matches(joint: str, kind: str, names: Sequence[str]) -> list[tuple[int, str | None]]:
    """Columns that are values of a joint, with the unit that each says; those of exactly its name before all others."""
    exact: list[tuple[int, str | None]] = [(k, None) for k, name in enumerate(names) if name == joint]
    if exact:
        return exact
    found = []
    known = ANGLE_UNITS if kind == REVOLUTE else LENGTH_UNITS
    for k, name in enumerate(names):
        bare, unit = name_and_unit(name, known)
        if unit not in known:
            bare, unit = name, None
        parts = re.split(r"[/\\]", bare)
        for ending in (".position", ".positions", ".pos"):
            parts = [part.removesuffix(ending) for part in parts]
        if joint in parts and not _OTHERS & {part.lower() for part in parts}:
            found.append((k, unit))
    return found


def _by_number(names: list[str], wanted: _Wanted) -> list[list[tuple[int, str | None]]]:
    """Columns of the joints of an arm without names of its own (``joint_1``, ...), by the number that ends each name.

    One series counts from the base, as ``fr3_joint1``, ``fr3_joint2`` does: with two, such as ``q1`` and ``dq1``, it is
    not known which holds the angles.
    """
    L = len(wanted.names)
    if tuple(wanted.names) != tuple(f"joint_{k + 1}" for k in range(L)):
        return [[] for _ in range(L)]
    series: dict[str, dict[int, list[tuple[int, str | None]]]] = {}
    for k, name in enumerate(names):
        bare, unit = name_and_unit(name, ANGLE_UNITS)
        bare, unit = (bare, unit) if unit in ANGLE_UNITS else (name, None)
        if (match := re.fullmatch(r"(.*?)(\d{1,3})", bare)) is not None:
            series.setdefault(match[1], {}).setdefault(int(match[2]), []).append((k, unit))
    whole = [of for of in series.values() if set(range(1, L + 1)) <= set(of)]
    if len(whole) != 1:
        return [[] for _ in range(L)]
    wanted.notes.append("columns by the numbers of the joints")
    return [whole[0][k + 1] for k in range(L)]


def _sorted_rows(table: Table, values: Array, wanted: _Wanted) -> Array:
    """Values in the order of the arm, by the names that stand in each row."""
    rows: dict[tuple[str, ...], list[int]] = {}
    for k, names in enumerate(table.texts):
        rows.setdefault(names, []).append(k)
        if len(rows) > MAX_ORDERS:
            raise InputError(
                f"{table.at(k)}: expected rows of one robot, got more than {MAX_ORDERS} lists of joint names."
            )
    q = np.empty((len(values), len(wanted.names)))
    for names, of_names in rows.items():
        where = table.at(of_names[0])
        if twice := [joint for joint in wanted.names if names.count(joint) > 1]:
            raise InputError(f"{where}: joint {twice[0]} is named twice.")
        _require_all([joint for joint in wanted.names if joint not in names], names, where)
        q[of_names] = values[of_names][:, [names.index(joint) for joint in wanted.names]]
    return q


# NumPy


def _from_arrays(data: bytes, name: str, wanted: _Wanted) -> tuple[Array | None, Array, list[str | None]]:
    none: list[str | None] = [None] * len(wanted.names)
    if data.startswith(b"\x93"):
        wanted.notes.append("columns in the order of the arm")
        return None, _shaped(read_one_array(data, name), len(wanted.names), name), none
    arrays = unpacked(data, name)
    key = next((key for key in _ARRAYS if key in arrays), None)
    if key is None:
        raise InputError(f"{name}: expected an array q (n, L) of joint values, got {short(', '.join(arrays))}.")
    values, where = arrays[key], f"{name}, {key}"
    if values.dtype.kind not in "fiu":
        raise InputError(f"{where}: expected numbers, got {values.dtype}.")
    times = next(
        (arrays[key].astype(float) for key in TIMES if key in arrays and arrays[key].dtype.kind in "fiu"), None
    )
    if times is not None and times.shape != values.shape[:1]:
        raise InputError(f"{where}: expected a time for each of {len(values)} rows, got shape {times.shape}.")
    label = next((key for key in ("names", "name", "joint_names") if key in arrays), None)
    if label is None:
        wanted.notes.append("columns in the order of the arm")
        return times, _shaped(values.astype(float), len(wanted.names), where), none
    names = [str(part) for part in arrays[label].ravel()[:1000]]
    return times, *_by_name(values.astype(float), names, wanted, name, where)


def _by_name(values: Array, names: list[str], wanted: _Wanted, name: str, where: str) -> tuple[Array, list[str | None]]:
    """Columns in the order of the arm, and the unit that the name of each says."""
    q = _shaped(values, len(names), where)
    matches = [_matches(joint, kind, names) for joint, kind in zip(wanted.names, wanted.kinds, strict=True)]
    _require_all([joint for joint, found in zip(wanted.names, matches, strict=True) if not found], names, name)
    if several := [joint for joint, found in zip(wanted.names, matches, strict=True) if len(found) > 1]:
        raise InputError(f"{name}: expected one column of joint {several[0]}, got several.")
    columns = _Columns(None, [found[0][0] for found in matches], [found[0][1] for found in matches])
    _note_columns(columns, names, wanted)
    return q[:, columns.joints], columns.units


def _shaped(values: Array, n_columns: int, where: str) -> Array:
    if values.ndim != 2 or values.shape[1] != n_columns or not len(values):
        raise InputError(f"{where}: expected joint values of shape (n, {n_columns}), got {values.shape}.")
    return values
