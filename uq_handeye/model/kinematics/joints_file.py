"""Files of joint values, one row per pose: CSV under a header with the names of the joints, or arrays of NumPy.

    timestamp,shoulder [deg],elbow [deg],wrist_deg

Columns are taken by name, in any order (`joint_columns`); further ones are ignored. A unit may follow the name. Rows
of ``rostopic echo -p``, with the names of a ``JointState`` in columns ``name0``, ``name1`` and its values in
``position0``, ..., are sorted by those names, row by row.

Arrays: ``.npy`` (n, L) in the order of the arm, or ``.npz`` with the array ``q``, ``joints``, ``joint_positions`` or
``position`` (n, L), ``names`` (L) of its columns, and ``timestamps`` (n).

Data sets of LeRobot and other parquet files: `lerobot`. Messages JointState, as ROS prints them, are read as well.

Values are in rad and m unless the header or the caller says otherwise. Joint 3 of a FANUC arm is the angle between
upper arm and forearm, unless the caller says that it is the pendant's (`joint_readings`). Degrees that are read as
radians lie far outside the limits of the joints, and are refused.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.files.one_line import short
from ...core.files.open import StrPath, as_path, opened, require_size, shown
from ...core.files.table import Places, Schema, Table, read_table, rows_are_numbers
from ...core.files.tree_values import fields_of, items_of
from ...core.geometry.checks import first_duplicate, repeats_note, rows_once
from ...core.geometry.se3 import Array
from ...core.limits import MAX_DESCRIPTION_BYTES, MAX_LINE_CHARACTERS, MAX_LISTED, MAX_TABLE_BYTES
from ...core.presentation.units import ANGLE_UNITS, LENGTH_UNITS
from ...errors import InputError, InputWarning
from ...formats.columns import SECONDS, meaning_and_unit
from ...formats.echoed_messages import messages_of
from ...formats.numpy_poses import TIMES, read_one_array, unpacked
from .chain import Kinematics
from .joint import PRISMATIC, REVOLUTE, require_within_limits
from .joint_columns import Joints, joint_columns
from .joint_readings import JointSeries, is_fanuc, may_be_coupled, uncoupled
from .joint_trees import joint_rows
from .lerobot import MAX_SHARE, STATE, MotorRange, angles_of_shares, read_frames, read_motor_ranges

# Lists of names in rows that name their joints.
MAX_ORDERS = 1000
# Word among the units: joint 3 is as FANUC's pendant shows it.
PENDANT = "pendant"
DEGREE, MILLIMETRE = ANGLE_UNITS["deg"], LENGTH_UNITS["mm"]

_NUMBERED = re.compile(r"(?:.*[./])?(name|position)[_.]?\[?(\d{1,6})\]?")
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
    series: JointSeries | None = None  # columns of which the first were read
    pendant: bool = False  # joint 3 was said to be as FANUC's pendant shows it


@dataclass
class _Wanted:
    """The joints of the arm, and the units in which somebody says that the file has them."""

    joints: Joints
    limits: Array | None
    units: dict[str, str]  # by kind
    fanuc: bool = False  # the pendant would show joint 3 from the horizontal
    pendant: bool = False  # it is said to be so
    motors: dict[str, MotorRange] = field(default_factory=dict)  # ranges of which the values are shares
    notes: list[str] = field(default_factory=list)

    @property
    def names(self) -> tuple[str, ...]:
        return self.joints.names

    @property
    def kinds(self) -> tuple[str, ...]:
        return self.joints.kinds


@dataclass
class _Columns:
    """Meaning of a header."""

    time: tuple[int, float] | None = None  # column, seconds per unit
    joints: list[int] = field(default_factory=list)  # columns of the joints, in the order of the arm
    names: tuple[str, ...] = ()  # of these columns
    series: list[int] = field(default_factory=list)  # columns of a series that is longer than the arm
    series_names: tuple[str, ...] = ()
    units: list[str | None] = field(default_factory=list)  # of each joint, as its column says
    by_row: list[tuple[int, int]] = field(default_factory=list)  # columns of name and value, where rows name the joints

    def take(self, names: Sequence[str], wanted: _Wanted, where: str) -> None:
        """Find the columns of the joints by their names, and note how they were found and which are not used."""
        found = joint_columns(names, wanted.joints, where)
        self.joints, self.units = [of[0][0] for of in found.columns], [of[0][1] for of in found.columns]
        self.names = tuple(names[k] for k in self.joints)
        if found.note:
            wanted.notes.append(found.note)
        if self.joints != sorted(self.joints):
            wanted.notes.append("columns sorted by the names of the joints")
        used = {*self.joints, *(() if self.time is None else (self.time[0],))}
        if left := [name for k, name in enumerate(names) if k not in used]:
            wanted.notes.append(f"not used: the columns {short(', '.join(left))}")
        if found.series:
            self.series = [k for k, _ in found.series]
            self.series_names = tuple(names[k] for k in self.series)
            n, first, last = len(found.series), *(names[found.series[k][0]] for k in (0, -1))
            warnings.warn(
                f"{where}: {short(first)} to {short(last)} are {n} columns, and the arm has {len(self.joints)} joints: "
                f"{short(names[self.joints[0]])} is read as its first, {short(names[self.joints[-1]])} as its last.",
                InputWarning,
                stacklevel=2,
            )


def read_joints(path: StrPath | NamedJoints, arm: Kinematics | Sequence[str], units: str | None = None) -> JointTable:
    """Read joint values (n, L) in the order of the arm, with timestamps (n,) or None.

    Parameters
    ----------
    path : path of a CSV, ``.npy``, ``.npz`` or parquet file, or NamedJoints
    arm : Kinematics, or names of revolute joints
        Its joint limits tell degrees from radians.
    units : str or None
        Unit of columns that say none, such as ``"deg"``, ``"mm"`` or ``"deg,mm"``; left out, rad and m. With
        ``pendant`` among them, as ``"deg,pendant"``, J3 of a FANUC arm counts from the horizontal. The path of a
        calibration of LeRobot (``"my_arm.json"``): the values are shares from -100 to 100 of its ranges.

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
    columns = _Columns()
    if isinstance(path, NamedJoints):
        name = path.name
        times, (values, columns) = path.times, _by_name(path.values, list(path.names), wanted, name, name)
    else:
        path = as_path(path)
        name = shown(path)
        with opened(path, MAX_TABLE_BYTES) as file:
            start = file.peek(8)[:8] if hasattr(file, "peek") else b""
            if start.startswith(b"PAR1"):
                times, values, columns = _from_frames(path, name, wanted)
            elif start.startswith((b"PK\3\4", b"\x93NUMPY")):
                data = file.read(MAX_TABLE_BYTES + 1)
                if len(data) > MAX_TABLE_BYTES:
                    raise InputError(f"{name}: expected at most {MAX_TABLE_BYTES / 1e6:g} MB, got more.")
                times, values, columns = _from_arrays(data, name, wanted)
            elif start.lstrip().startswith((b"[", b"{")):
                times, values, columns = _from_tree(file.read(MAX_DESCRIPTION_BYTES + 1), path, wanted)
            elif start.startswith((b"header:", b"name:")):
                times, values, columns = _from_messages(file.read(MAX_DESCRIPTION_BYTES + 1), path, wanted)
            else:
                times, values, columns, lines = _from_csv(file, name, wanted)
    at, L = _row_names(name, lines), len(wanted.names)
    if times is not None:
        rows = rows_once(np.column_stack([times, values]))
        if len(rows) < len(values):
            wanted.notes.append(repeats_note(len(values) - len(rows)))
            times, values, lines = times[rows], values[rows], None if lines is None else lines[rows]
            at = _row_names(name, lines)
    _check_finite(values[:, :L], wanted, at)
    try:
        q = _in_units(values[:, :L], columns, wanted, at, name)
    except InputError as error:
        if (others := _columns_within(values[:, L:], columns, wanted, at)) is None:
            raise
        raise InputError(
            f"{str(error).rpartition(';')[0]}; the columns {short(', '.join(others))} are within the limits: if these "
            "are the joints, rename them joint_1, joint_2, ..."
        ) from error
    if times is not None:
        if not np.isfinite(times).all():
            raise InputError(f"{at(int(np.argmin(np.isfinite(times))))}: expected a finite timestamp.")
        if (twins := first_duplicate(times)) is not None:
            raise InputError(f"{at(twins[1])}: the timestamp repeats that of {at(twins[0]).removeprefix(f'{name}, ')}.")
    series = None
    if columns.series:
        unit = ANGLE_UNITS[columns.units[0] or wanted.units.get(REVOLUTE) or "rad"]
        series = JointSeries(columns.series_names, unit * values[:, L:])
    return JointTable(times, q, tuple(wanted.notes), series, wanted.pendant)


def _wanted(arm: Kinematics | Sequence[str], units: str | None) -> _Wanted:
    if isinstance(arm, Kinematics):
        joints, limits = Joints(arm.name, arm.names, tuple(joint.kind for joint in arm.joints)), arm.limits
    elif isinstance(arm, str) or not isinstance(arm, Sequence) or not arm or not all(isinstance(n, str) for n in arm):
        raise InputError(f"Expected `arm` to be Kinematics or names of joints, got {type(arm).__name__}.")
    else:
        joints, limits = Joints("", tuple(arm), (REVOLUTE,) * len(arm)), None
    said: dict[str, str] = {}
    chain, pendant = arm if isinstance(arm, Kinematics) else None, False
    motors: dict[str, MotorRange] = {}
    if units is not None:
        for word in units.split(",") if isinstance(units, str) else [repr(units)]:
            if word.strip() == PENDANT and not pendant:
                pendant = True
                if chain is None or not may_be_coupled(chain):
                    raise InputError(
                        f"`units` (--joint-units) {PENDANT}: for the six axes of a FANUC arm, whose J3 counts from the "
                        f"horizontal. The axes of {joints.arm or 'these joints'} are others. Leave it out."
                    )
                continue
            if word.strip().endswith(".json"):
                motors = read_motor_ranges(as_path(word.strip()))
                continue
            kind = _kind_of_unit(word.strip())
            if kind is None or kind in said:
                known = ", ".join((*ANGLE_UNITS, *LENGTH_UNITS))
                raise InputError(
                    f"Expected `units` (--joint-units) such as deg, mm, 'deg,mm' or 'deg,{PENDANT}' of {known}, got "
                    f"{units!r}."
                )
            said[kind] = word.strip()
    if motors and (REVOLUTE in said or PRISMATIC in joints.kinds):
        raise InputError(
            f"`units` (--joint-units) {units}: a calibration of LeRobot is for shares from -100 to 100 of the range of "
            "each motor, without another unit. Give one of them."
        )
    return _Wanted(joints, limits, said, chain is not None and is_fanuc(chain), pendant, motors)


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


def _in_units(values: Array, columns: _Columns, wanted: _Wanted, at: Callable[[int], str], name: str) -> Array:
    """Values in rad and m, checked against the limits of the joints."""
    named = columns.units
    if wanted.motors and not any(named):
        wanted.notes.append("joints from -100 to 100 of the ranges of the motors")
        return angles_of_shares(values, columns.names or wanted.names, wanted.motors, name)
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
    if wanted.pendant:
        q = uncoupled(q)
        wanted.notes.append("joint 3 is J3 + J2 of the pendant")
    of_arm = wanted.names, wanted.kinds, wanted.limits, with_unit, at
    try:
        require_within_limits(q, *of_arm)
    except InputError as error:
        if not with_unit.any() and _may_be_shares(values, columns):
            problem = str(error).rpartition(";")[0]
            raise InputError(
                f"{problem}; degrees of LeRobot, or its shares from -100 to 100? Give --joint-units deg, or the "
                "calibration file of the arm (--joint-units my_arm.json)."
            ) from error
        if not wanted.fanuc or wanted.pendant or not _is_within(uncoupled(q), *of_arm):
            raise
        problem, said = str(error).rpartition(";")[0], ",".join([*wanted.units.values(), PENDANT])
        raise InputError(f"{problem}; is it J3 of FANUC's pendant? Give --joint-units {said}.") from error
    return q


def _may_be_shares(values: Array, columns: _Columns) -> bool:
    """Return whether values from -100 to 100 have names as LeRobot gives them."""
    of_lerobot = all(name.endswith(".pos") or name.startswith(STATE) for name in columns.names)
    return bool(columns.names) and of_lerobot and float(np.abs(values).max()) <= MAX_SHARE


def _columns_within(
    series: Array, columns: _Columns, wanted: _Wanted, at: Callable[[int], str]
) -> tuple[str, ...] | None:
    """Return the names of other columns of a longer series whose values are within the limits."""
    L, unit = len(wanted.names), ANGLE_UNITS[(columns.units or [None])[0] or wanted.units.get(REVOLUTE) or "rad"]
    with_unit = np.full(L, bool(wanted.units))
    for first in range(1, series.shape[1] - L + 1):
        window = slice(first, first + L)
        if _is_within(unit * series[:, window], wanted.names, wanted.kinds, wanted.limits, with_unit, at):
            return columns.series_names[window]
    return None


def _is_within(
    q: Array,
    names: Sequence[str],
    kinds: Sequence[str],
    limits: Array | None,
    with_unit: NDArray[np.bool_],
    at: Callable[[int], str],
) -> bool:
    with warnings.catch_warnings(action="ignore"):
        try:
            require_within_limits(q, names, kinds, limits, with_unit, at)
        except InputError:
            return False
    return True


# CSV


def _from_csv(file: BinaryIO, name: str, wanted: _Wanted) -> tuple[Array | None, Array, _Columns, NDArray[np.int64]]:
    columns = _Columns()

    def places(names: list[str], line: str, where: str) -> Places:
        nonlocal columns
        columns = _header(names, where, wanted)
        time = [] if columns.time is None else [columns.time[0]]
        used = [*columns.joints, *columns.series] or [k for _, k in columns.by_row]
        first_row = list(wanted.names) if rows_are_numbers(names) else None
        return Places([*time, *used], [k for k, _ in columns.by_row], first_row)

    def named(names: list[str]) -> bool:
        return any(joint in name for joint in wanted.names for name in names)

    marks = ",;\t " if _by_blanks(file, wanted) else ",;\t"
    table = read_table(file, name, Schema("a header with the names of the joints", "pose", places, named, marks))
    values = table.values
    times = None if columns.time is None else values[:, 0] * columns.time[1]
    values = values if columns.time is None else values[:, 1:]
    if columns.by_row:
        values = _sorted_rows(table, values, wanted)
    if times is None:
        wanted.notes.append("no timestamp column")
    return times, values, columns, table.lines


def _by_blanks(file: BinaryIO, wanted: _Wanted) -> bool:
    """Return whether the first line separates as many names as there are joints by blanks, as RTDE records do."""
    line = (file.peek(MAX_LINE_CHARACTERS) if hasattr(file, "peek") else b"").lstrip().partition(b"\n")[0]
    return not re.search(rb"[,;\t\[(#]", line) and len(line.split()) >= max(2, len(wanted.names))


def _header(names: list[str], where: str, wanted: _Wanted) -> _Columns:
    nameless = rows_are_numbers(names)
    if nameless and not (wanted.joints.counted and len(names) == len(wanted.names)):
        raise InputError(
            f"{where}: expected a header with the names of the joints, got numbers; add it as the first line: "
            f"{short(', '.join(wanted.names))}, in the order of the columns."
        )
    found = _Columns()
    if nameless:
        wanted.notes.append("no names of joints: columns in the order of the arm")
        found.joints, found.units, found.names = list(range(len(names))), [None] * len(names), wanted.names
        return found
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
    found.take(names, wanted, where)
    return found


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
        q[of_names] = values[of_names][:, [of[0][0] for of in joint_columns(names, wanted.joints, where).columns]]
    return q


# NumPy


def _from_arrays(data: bytes, name: str, wanted: _Wanted) -> tuple[Array | None, Array, _Columns]:
    none = _Columns(units=[None] * len(wanted.names))
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


def _from_frames(path: Path, name: str, wanted: _Wanted) -> tuple[Array | None, Array, _Columns]:
    frames = read_frames(path)
    wanted.notes += frames.notes
    return frames.times, *_by_name(frames.values, frames.names, wanted, name, name)


def _from_tree(data: bytes, path: Path, wanted: _Wanted) -> tuple[Array | None, Array, _Columns]:
    """Joint values of JSON, by their names or in the order of the arm."""
    require_size(len(data), MAX_DESCRIPTION_BYTES, path)
    name = shown(path)
    names, values = joint_rows(data, name)
    if not names:
        wanted.notes.append("columns in the order of the arm")
        return None, _shaped(values, len(wanted.names), name), _Columns(units=[None] * len(wanted.names))
    time = next((k for k, one in enumerate(names) if meaning_and_unit(one)[0] == "timestamp"), None)
    times = None
    if time is not None:
        times = values[:, time] * SECONDS[meaning_and_unit(names[time])[1] or "s"]
        names, values = [one for k, one in enumerate(names) if k != time], np.delete(values, time, axis=1)
    return times, *_by_name(values, names, wanted, name, name)


def _from_messages(data: bytes, path: Path, wanted: _Wanted) -> tuple[Array | None, Array, _Columns]:
    """Joint values of messages JointState, as ``ros2 topic echo`` and ``rostopic echo`` print them."""
    require_size(len(data), MAX_DESCRIPTION_BYTES, path)
    name = shown(path)
    times, rows = list[float](), list[dict[str, float]]()
    for line, message, wrong, ended in messages_of(data.decode("utf-8", "replace")):
        names, stamp = items_of(message.get("name")), fields_of(fields_of(message.get("header")).get("stamp"))
        try:
            rows.append(dict(zip(map(str, names), map(float, items_of(message.get("position"))), strict=True)))
            if wrong is not None or rows[-1].keys() != rows[0].keys() or not names:
                raise ValueError
        except (TypeError, ValueError):
            if not ended and len(rows) > 1:
                wanted.notes.append("the last message is cut off, and left out")
                break
            raise InputError(
                f"{name}, the message at line {line}: expected a JointState with a position of each joint, the same "
                f"joints in all messages, got the fields {', '.join(list(message)[:MAX_LISTED]) or 'none'}."
            ) from None
        seconds, parts = stamp.get("sec", stamp.get("secs")), stamp.get("nanosec", stamp.get("nsecs"))
        times.append(float(seconds or 0) + 1e-9 * float(parts or 0))
    if not rows:
        raise InputError(f"{name}: expected messages JointState, got none.")
    names, rows = list(rows[0]), rows[: len(times)]
    values = np.array([[row[one] for one in names] for row in rows])
    return np.array(times) if any(times) else None, *_by_name(values, names, wanted, name, name)


def _by_name(values: Array, names: list[str], wanted: _Wanted, name: str, where: str) -> tuple[Array, _Columns]:
    """Columns in the order of the arm, then those of a longer series, and what they are."""
    q = _shaped(values, len(names), where)
    columns = _Columns()
    columns.take(names, wanted, name)
    return q[:, [*columns.joints, *columns.series]], columns


def _shaped(values: Array, n_columns: int, where: str) -> Array:
    if values.ndim != 2 or values.shape[1] != n_columns or not len(values):
        raise InputError(f"{where}: expected joint values of shape (n, {n_columns}), got {values.shape}.")
    return values
