"""Tables of poses from controllers and people: columns by their names, or by their number where there are no names.

Without names, a line holds x, y, z and three numbers of a rotation, or x, y, z and a quaternion, or axis and angle; one
or two columns before them may number or time the rows. The form of the rotation follows from the requested format, from
the names of the columns or, where several are possible, from the other side (`read.readings`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core.files.one_line import short
from ...core.files.table import Places
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..columns import (
    QUATERNIONS,
    ROTATIONS,
    ColumnError,
    Columns,
    in_seconds,
    is_pose_header,
    is_truth,
    measured,
    pose_columns,
)
from ..contents import NORM_TOLERANCE, Contents, Side
from ..matrices.layout import MAX_NUMBERS_BEFORE, matrices_in
from ..number_table import MAX_HEAD_LINES, MIN_NUMBERS, NumberTable, names_of, read_number_table
from .forms import CONTROLLERS, PoseForm
from .readings import interpret

HELP = "see docs/how-to/controller.md"
_POSITION = ("x", "y", "z")
# Words before the columns of one side, in a table of both.
_ROBOTS = ("robot", "gripper", "hand", "tool", "tool0", "tcp", "ee", "eef", "flange", "arm", "base")
_CAMERAS = ("camera", "cam", "marker", "board", "tag", "target", "object", "aruco", "charuco", "checkerboard", "eye")
# Names of joints.
_JOINT = re.compile(r"(?:joint|axis|j|a|q|theta|qpos)[\s_.]*\d+.*|.*_joint(?:_\d+)?", re.IGNORECASE)


def read_pose_table(text: str, name: str, form: PoseForm | None = None) -> Contents:
    """Return the poses of a table, in the convention of ``form``, or of the names of its columns, or in doubt."""
    table = read_number_table(text, name, is_table_header, HELP)
    if table.unknown and all(map(_JOINT.fullmatch, table.unknown)):
        raise InputError(
            f"{name}: expected poses, got joint values ({short(', '.join(table.unknown))}): give them by --joints with "
            "--urdf (docs/how-to/kinematics.md)."
        )
    return _of_table(table, form)


def _of_table(table: NumberTable, form: PoseForm | None) -> Contents:
    """Return the poses of one side, or of both sides that stand beside or below each other."""
    both = _of_sets(table, form) or _of_labels(table, form) or _of_halves(table, form)
    return both or _contents(table, _columns(table, form), form)


def _of_labels(table: NumberTable, form: PoseForm | None) -> Contents | None:
    """Return both sides of a table whose rows name their side (``hand``, ``eye``); None for any other."""
    for texts in zip(*table.texts, strict=True) if len(table.texts) == len(table.values) else ():
        words = [text.strip(" :,").lower() for text in texts]
        roles = {
            word: role for role, known in (("robot", _ROBOTS), ("camera", _CAMERAS)) for word in known if word in words
        }
        if len(roles) == 2 and set(roles) == set(words) and len(set(roles.values())) == 2:
            found = {
                role: _part(table, form, rows=np.array([k for k, one in enumerate(words) if one == word]))
                for word, role in roles.items()
            }
            notes = (*_said(found), *(f"{role} poses from the rows {word}" for word, role in roles.items()))
            return Contents(found["robot"].only, found["camera"].only, notes=notes)
    return None


def _of_halves(table: NumberTable, form: PoseForm | None) -> Contents | None:
    """Return both sides of rows without names that hold two poses of six or seven numbers; None for any other."""
    values = table.values
    first = next((k for k in range(MAX_NUMBERS_BEFORE + 1) if values.shape[1] - k in (12, 14)), None)
    if (
        table.headings
        or table.unknown
        or first is None
        or not all((np.diff(values[:, k]) > 0).all() for k in range(first))
    ):
        return None
    half = (values.shape[1] - first) // 2
    halves = [values[:, first + k * half : first + (k + 1) * half] for k in range(2)]
    if (half == 7 and not all(map(_is_pose, halves))) or (half == 6 and matrices_in(values) is not None):
        return None
    before = list(range(first))
    found = {
        role: _part(table, form, columns=[*before, *range(first + k * half, first + (k + 1) * half)])
        for k, role in enumerate(("robot", "camera"))
    }
    notes = (*_said(found), f"two poses of {half} numbers in each row: the robot's first")
    return Contents(found["robot"].only, found["camera"].only, notes=notes)


def _part(
    table: NumberTable, form: PoseForm | None, rows: NDArray[np.intp] | None = None, columns: list[int] | None = None
) -> Contents:
    """Return the poses of some rows or columns of a table, as those of one side."""
    rows = np.arange(len(table.values)) if rows is None else rows
    columns = list(range(table.values.shape[1])) if columns is None else columns
    part = replace(
        table,
        values=table.values[rows][:, columns],
        lines=table.lines[rows],
        names=[table.headings[k] for k in columns] if table.headings else [],
        places=Places(range(len(columns))),
        units=tuple(table.units[k] for k in columns),
        texts=[],
        notes=(),
        numbers=(),
    )
    return _contents(part, _columns(part, form), form)


def _said(parts: dict[str, Contents]) -> list[str]:
    """Return what is to be said of both sides, each once."""
    return list(dict.fromkeys(note for part in parts.values() for note in part.notes))


def _of_sets(table: NumberTable, form: PoseForm | None) -> Contents | None:
    """Return both sides of a table whose columns name them; None for a table of one set of poses.

    Raises `InputError` for sets of poses that are not those of robot and camera.
    """
    names = table.headings
    if len(twice := [one for one in dict.fromkeys(names) if names.count(one) > 1]) >= MIN_NUMBERS:
        raise InputError(
            f"{table.name}: expected one set of poses, got {short(', '.join(twice))} twice. Keep one of them; {HELP}."
        )
    whole = _sets(names)
    if len(whole) < 2 or any(measured(prefix) for prefix in whole):
        return None
    sides = {"robot": [one for one in whole if one in _ROBOTS], "camera": [one for one in whole if one in _CAMERAS]}
    if len(whole) != 2 or any(len(found) != 1 for found in sides.values()):
        raise InputError(
            f"{table.name}: expected one set of poses, got those of {', '.join(whole)}. Keep the columns of one of "
            f"them, without the word before the names; {HELP}."
        )
    shared = [k for k in range(len(names)) if not any(k in columns for columns in whole.values())]
    parts = {}
    for role, (prefix,) in sides.items():
        columns = shared + whole[prefix]
        part = replace(
            table,
            values=table.values[:, columns],
            names=[names[k][len(prefix) + 1 :] if k in whole[prefix] else names[k] for k in columns],
            places=Places(range(len(columns))),
            units=tuple(table.units[k] for k in columns),
        )
        parts[role] = _contents(part, _columns(part, form), form)
    notes = [f"{role} poses from the columns {prefix}_..." for role, (prefix,) in sides.items()]
    notes += [note for part in parts.values() for note in part.notes if note not in table.notes]
    return Contents(parts["robot"].only, parts["camera"].only, notes=(*table.notes, *notes))


def _sets(names: Sequence[str]) -> dict[str, list[int]]:
    """Return the columns of each set of poses by the word before their names: ``robot_x``, ``cam_x``."""
    sets: dict[str, list[int]] = {}
    for k, one in enumerate(names):
        prefix, separator, rest = re.sub(r"[./ ]", "_", one.strip("\"' ")).partition("_")
        if separator and rest and not is_truth(one):
            sets.setdefault(prefix.lower(), []).append(k)
    return {
        prefix: columns
        for prefix, columns in sets.items()
        if is_pose_header([names[k][len(prefix) + 1 :] for k in columns])
    }


def is_table_header(names: Sequence[str]) -> bool:
    """Return whether names of columns hold a pose, or several."""
    return is_pose_header(names) or len(_sets(names)) > 1


def names_a_pose(head: str) -> bool:
    """Return whether one of the first lines of a text names the columns of poses."""
    return any(is_table_header(names_of(line)) for line in head.split("\n", MAX_HEAD_LINES)[:MAX_HEAD_LINES])


def pose_side(table: NumberTable, counted: str) -> Side:
    """Return the poses of a table that is read already, in the convention of the names of its columns, or in doubt."""
    contents = _contents(table, _columns(table, None), None)
    assert contents.only is not None
    return replace(contents.only, counted=counted)


def table_kind(head: str) -> str | None:
    """Return the format that the beginning of a text is a table of: a maker, "table" where that is open, or None."""
    text = "\n".join(head.splitlines()[:MAX_HEAD_LINES]) if head.count("\n") > MAX_HEAD_LINES else head
    try:
        table = read_number_table(text, "", is_table_header, "", guessed=text is not head or len(head) > 65_000)
        contents = _of_table(table, None)
    except InputError:  # whose reader says what is wrong with a table that names its columns
        return "table" if names_a_pose(text) else None
    if contents.only is None:
        return "table"
    names = {reading.format for reading in contents.only.readings}
    return names.pop() if len(names) == 1 else "table"


def _columns(table: NumberTable, form: PoseForm | None) -> Columns:
    """Return the columns of a table, by their names or by their number."""
    if table.headings:
        try:
            return _in_order(pose_columns(table.headings, table.units), form)
        except ColumnError as error:
            raise InputError(
                f"{table.name}: expected columns of a position and a rotation, got {short(', '.join(table.headings))} "
                f"({error}); {HELP}."
            ) from error
    columns = _by_number(table)
    if columns is None and form is not None and _has_whole_numbers_behind(table.values, len(form.columns)):
        columns = Columns("unsaid", None, (0, 1, 2), tuple(range(3, 3 + len(form.columns))), None, None)
    if columns is None:
        n = table.values.shape[1]
        raise InputError(
            f"{table.at(0)}: expected x, y, z and a rotation of three or four numbers, got {n} "
            f"numbers without names. Name the columns in a first line, e.g. x,y,z,rx,ry,rz; {HELP}."
        )
    if form is not None and columns.kind == "unsaid" and len(columns.rotation) != len(form.columns):
        got = "a quaternion" if len(columns.rotation) == 4 else "six numbers"
        raise InputError(
            f"{table.name}: expected x, y, z, {', '.join(form.columns)} ({form.maker}), got {got} in each line; {HELP}."
        )
    return columns


def _in_order(columns: Columns, form: PoseForm | None) -> Columns:
    """Return the columns of the rotation in the order of a maker that has the same names: Nachi's Rz comes first."""
    known = ROTATIONS.get(columns.kind, ())
    names = () if form is None else tuple(name.lower() for name in form.columns)
    if not known or set(names) != set(known):
        return columns
    return columns._replace(rotation=tuple(columns.rotation[known.index(name)] for name in names))


def _by_number(table: NumberTable) -> Columns | None:
    """Return the columns of a table without names; None where their number fits no pose."""
    values = table.values
    n = values.shape[1]
    first = 0
    while n - first > 6 and first < 2 and not _is_pose(values[:, first:]) and (np.diff(values[:, first]) > 0).all():
        first += 1
    rest = values[:, first:]
    kind, rotation = "unsaid", 3
    if rest.shape[1] == 7 and _unit(rest[:, 3:7]):
        rotation = 4
    elif rest.shape[1] == 7 and _unit(rest[:, 3:6]):
        kind, rotation = "axis-angle", 4
    elif rest.shape[1] == 7 and _unit(rest[:, :4]):
        units = [unit for unit in table.units[first + 4 : first + 7] if unit]
        return Columns(
            kind, _time(values, first), (first + 4, first + 5, first + 6), tuple(range(first, first + 4)),
            units[0] if units else None, None,
        )  # fmt: skip
    elif rest.shape[1] != 6 + _ends_with_codes(rest):
        return None
    lengths, angles = set(table.units[first : first + 3]) - {""}, set(table.units[first + 3 :]) - {""}
    return Columns(
        kind,
        _time(values, first),
        (first, first + 1, first + 2),
        tuple(range(first + 3, first + 3 + rotation)),
        lengths.pop() if len(lengths) == 1 else None,
        {"°": "deg"}.get(angle := angles.pop(), angle) if len(angles) == 1 else None,
    )


def _has_whole_numbers_behind(values: Array, rotation: int) -> bool:
    """Return whether only whole numbers follow a pose: configurations, status and turn, external axes at rest."""
    pose, rest = values[:, : 3 + rotation], values[:, 3 + rotation :]
    return bool(rest.size and (rest == np.round(rest)).all() and (pose[:, :3] != np.round(pose[:, :3])).any())


def _ends_with_codes(rest: Array) -> bool:
    """Return whether a figure follows six numbers: P(x, y, z, rx, ry, rz, fig) of Denso."""
    return rest.shape[1] == 7 and _has_whole_numbers_behind(rest, 3) and not _is_pose(rest)


def _is_pose(rest: Array) -> bool:
    return rest.shape[1] == 7 and (_unit(rest[:, 3:7]) or _unit(rest[:, :4]) or _unit(rest[:, 3:6]))


def _unit(numbers: Array) -> bool:
    with np.errstate(all="ignore"):
        return bool((np.abs(np.linalg.norm(numbers, axis=1) - 1.0) <= NORM_TOLERANCE).all())


def _time(values: Array, first: int) -> int | None:
    """Return the column of times among the first; row numbers are none."""
    for k in range(first):
        if len(values) > 1 and not (np.abs(np.diff(values[:, k]) - 1.0) < 1e-9).all():
            return k
    return None


def _contents(table: NumberTable, columns: Columns, form: PoseForm | None) -> Contents:
    values = table.values
    notes = list(table.notes)
    position, rotation = values[:, columns.position], values[:, columns.rotation]
    names = _names(table, columns, form)
    if table.headings:
        _require_kind(table, columns, form)
        left = [one for k, one in enumerate(table.headings) if k not in columns.used]
        if left:
            notes.append(f"not used: the columns {short(', '.join(left))}")
    kind = columns.kind
    if kind == "axis-angle":
        with np.errstate(all="ignore"):
            rotation = rotation[:, :3] / np.linalg.norm(rotation[:, :3], axis=1)[:, None] * rotation[:, 3:]
        kind, form, names = "rotvec", None, (*names[:4], *(f"{one} times angle" for one in names[4:7]))
        notes.append("axis and angle read as a rotation vector")
    times = None
    if columns.time is not None:
        times, note = in_seconds(values[:, columns.time], columns.time_unit)
        notes += [note] if note else []
    readings, said, others = interpret(kind, position, rotation, form, columns.length, columns.angle)
    notes += said
    if len(readings) == 1:
        reading = readings[0]
        maker = CONTROLLERS.get(reading.format)
        what = "a table" if maker is None else maker.maker
        by = "" if form is not None else ", by the names of the columns"
        notes.append(f"{', '.join(names[4:])} read as {reading.rotation} ({what}{by}), lengths in {reading.units}")
    side = Side(
        table.name, position, rotation, times, table.lines, "line", "xyzw", names,
        units=columns.length, readings=readings, others=others, numbers=table.numbers,
    )  # fmt: skip
    return Contents(only=side, notes=tuple(notes))


def _names(table: NumberTable, columns: Columns, form: PoseForm | None) -> tuple[str, ...]:
    """Return the names of time, position and rotation for messages."""
    used = (*columns.position, *columns.rotation)
    if table.headings:
        time = "timestamp" if columns.time is None else table.headings[columns.time]
        return (time, *(table.headings[k] for k in used))
    if form is not None and len(form.columns) == len(columns.rotation):
        return ("timestamp", *_POSITION, *form.columns)
    return ("1", *(str(k + 1) for k in used))


def _require_kind(table: NumberTable, columns: Columns, form: PoseForm | None) -> None:
    """Raise where the names of the columns say another form than the one asked for."""
    quaternion = columns.kind in QUATERNIONS
    names_alone = columns.kind in ("rxyz", "euler", "axis-angle")  # which say no convention
    if form is None or (names_alone and len(form.columns) == 3):
        return
    own = {name.lower() for name in form.columns} == set(ROTATIONS.get(columns.kind, ()))
    if columns.kind == "rpy" and not (own or form.rotation.startswith("xyz")):
        raise InputError(
            f"{table.name}: expected {', '.join(form.columns)} ({form.maker}), got the columns roll, pitch, yaw. Give "
            f"--format robot=rpy or xarm, or rename the columns; {HELP}."
        )
    if quaternion != (len(form.columns) == 4) or (
        columns.kind in ("abc", "wpr", "oat", "rotvec", "uvw", "aer")
        and (
            tuple(name.lower() for name in form.columns) != ROTATIONS[columns.kind]
            and not (columns.kind == "rotvec" and form.name == "ur")
        )
    ):
        got = ", ".join(table.headings[k] for k in columns.rotation)
        raise InputError(
            f"{table.name}: expected {', '.join(form.columns)} ({form.maker}), got the columns {got}. Leave --format "
            f"out, or rename the columns; {HELP}."
        )
