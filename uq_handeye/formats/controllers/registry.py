"""Formats of the makers: how each is told by its beginning and read, as a program or as a table.

Poses in JSON and YAML under names of people's own: maps of numbers and short lists, one per pose.

``{"x": 0.1, ..., "rx": ...}`` is a row of a table; ``position`` and ``rpy`` may be lists, ``R`` a 3x3 matrix. What the
numbers of a rotation are, the names say; where they do not, there are several readings, as in tables.

Poses whose position and rotation stand apart, each as a list behind its name.

In lines, ``Position: [0.1, 0.2, 0.3]`` and ``Orientation (quaternion): [0, 0, 0, 1]``, as people print them; or in
cells of a table, ``"[0.1 0.2 0.3]","[1.2 0.1 0.3]"`` below ``rvec,tvec``, as pandas writes arrays. What the numbers of
a rotation are, the names say; where they do not, there are several readings (`records`).
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from ...core.files.lines import floats
from ...core.files.table import Places
from ...core.files.tree_values import fields_of, is_map, is_plain_number, items_of
from ...core.files.trees import is_json
from ...core.geometry.se3 import Array
from ...core.numbers.limits import MAX_LINE_CHARACTERS, MAX_ROWS
from ...errors import InputError
from ..columns import is_pose_header, seconds_of
from ..contents import COLUMNS, Contents, Side, matrices_side
from ..csv_poses import is_csv_header, names_order
from ..matrices.arrays import numbers_of
from ..number_table import NUMBER, NumberTable, number_of
from .forms import CONTROLLERS
from .programs import PROGRAMS, has_lists, read_program
from .tables import HELP, pose_side, read_pose_table, table_kind

# What is looked at to tell a table.
HEAD = 65_536
# The comment above what `export` and `plan` write.
_WRITTEN = re.compile(r"# .{0,100}, as (.{1,40}?) writes (?:it|them)\b")

NAMES = (*CONTROLLERS, "table")
ABOUT = {
    **{name: f"{form.maker}: x, y, z, {', '.join(form.columns)}" for name, form in CONTROLLERS.items()},
    "table": "numbers of poses in columns, with or without names",
}
# What a text of another format begins with.
_OTHERS = ("%YAML", "---", '<?xml version="1.0"?>\n<opencv')


@lru_cache(maxsize=4)
def kind_of(head: str) -> str | None:
    """Return the format of a text by its beginning, or None."""
    for name, program in PROGRAMS.items():
        if program.told(head):
            return name
    first = head.lstrip().partition("\n")[0].rstrip()
    if first.startswith("{") and (not first.endswith("}") or is_json(head)):  # JSON
        return None
    if has_lists(head):
        return "table"
    if "<RIst" in head:  # what the robot sensor interface of KUKA sends
        return "kuka"
    if head.lstrip().startswith(("<", *_OTHERS)):
        return "table" if is_labelled(head) else None
    for line in head.split("\n", 40)[:40]:
        content = line.strip()
        if not content:
            continue
        if is_csv_header(content.lstrip("# \t")):
            if _below(content, head):
                break
            return None
        if content.startswith("#"):
            continue
        words = content.split()
        if len(words) == len(COLUMNS) and (floats(words) is not None or names_order(words)):
            return None  # TUM
        break
    return _own(head) or table_kind(head) or ("table" if is_labelled(head) else None)


def _own(head: str) -> str | None:
    """Return the maker that the first line of an export names."""
    said = _WRITTEN.match(head)
    return None if said is None else next((form.name for form in CONTROLLERS.values() if form.maker == said[1]), None)


def _below(names: str, head: str) -> bool:
    """Return whether the rows below the names are no CSV: dates, of which a table makes seconds; other separators."""
    lines = [line for line in head.split("\n", 60)[:60] if line.strip() and not line.startswith("#")]
    if names.startswith("#") and "," in names and lines and not re.search("[,;\t]", lines[0]):
        return True
    fields = re.split(r"[,;\t]", lines[1] if len(lines) > 1 else "")
    return any(number_of(field) is None and seconds_of(field) is not None for field in fields)


def read_controller(format: str, text: str, name: str) -> Contents:
    """Return the poses of a text in the format of a maker: a program of theirs, or a table of numbers."""
    if format in PROGRAMS and (PROGRAMS[format].told(text) or PROGRAMS[format].loose(text)):
        return read_program(format, text, name)
    if format == "table" and has_lists(text):
        return read_program("abb", text, name, sure=False)
    if table_kind(text[:HEAD]) is None and is_labelled(text[:HEAD]):
        return read_labelled(text, name)
    return read_pose_table(text, name, CONTROLLERS.get(format))


_POSITIONS = ("translation", "position", "pos", "xyz", "t", "tvec", "trans", "p", "translation_vector")
_MATRICES = ("R", "rotation", "rotation_matrix", "rot", "rmat")
# Names of lists of three angles, and the columns that they are.
_LISTS = {
    **dict.fromkeys(("rvec", "rotvec", "rotation_vector", "axis_angle"), ("rotvec_x", "rotvec_y", "rotvec_z")),
    **dict.fromkeys(("rpy", "roll_pitch_yaw"), ("roll", "pitch", "yaw")),
    "abc": ("a", "b", "c"),
    "wpr": ("w", "p", "r"),
}
# Names that leave the form open: three angles, a rotation vector, or a quaternion of either order.
_OPEN = ("rotation", "orientation", "quaternion", "quat", "q", "euler", "angles", "rot")
# Names of six or seven numbers of a whole pose.
_POSES = (
    "pose", "tcp", "tcp_pose", "actual_tcp_pose", "tcp_coords", "coords", "cartesian", "flange", "end_pose", "value",
    "values",
)  # fmt: skip


def entries_of(tree: Any) -> tuple[Any, str]:
    """Return a tree that holds the poses of one side in other ways as a list of maps, and the name of that list.

    A single pose; columns by their names (``{"x": [...], "y": [...]}``, also with numbered rows as pandas writes them);
    one list of poses among other entries, whatever its name. Any other tree is returned as it is.
    """
    if not is_map(tree):
        return tree, ""
    if is_records([tree]):
        return [tree], ""
    whole = {str(key): list(fields_of(value).values()) or value for key, value in tree.items()}
    columns = {key: found.tolist() for key, value in whole.items() if (found := _vector(value)) is not None}
    if is_pose_header(tuple(columns)) and len({len(column) for column in columns.values()}) == 1:
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)], ""
    lists = {str(key): value for key, value in tree.items() if is_records(value)}
    if len(lists) != 1:
        return tree, ""
    ((key, found),) = lists.items()
    return found, key


def _vector(value: Any) -> Array | None:
    found = numbers_of(value)
    return found if found is not None and found.ndim == 1 else None


def is_records(values: Any) -> bool:
    """Return whether a list holds one pose per map."""
    first = next(iter(items_of(values)), None)
    return is_map(first) and _row(first) is not None


def records_side(values: list[Any], name: str) -> Side | None:
    """Return the poses of a list of maps; None where they are no poses by names that are known.

    Raises `InputError` for poses that are wrong.
    """
    rows = [_row(entry) if is_map(entry) else None for entry in values]
    first = rows[0]
    if first is None or any(row is None or row[0] != first[0] or len(row[1]) != len(first[1]) for row in rows):
        return None
    names, numbers = first[0], np.array([row[1] for row in rows if row is not None])
    if names == ("matrix",):
        return matrices_side(name, numbers.reshape(-1, 4, 4))
    lines = np.arange(len(numbers))
    units = ("",) * numbers.shape[1]
    table = NumberTable(name, list(names), Places(range(len(units))), numbers, lines, units=units)
    return pose_side(table, "pose")


def _axis_and_angle(entry: dict[str, Any]) -> list[float] | None:
    """Return ``{"Rotation": {"Angle": a, "Axis": [x, y, z]}}``, as Ensenso writes it, as a rotation vector."""
    for value in entry.values():
        parts = {str(key).lower(): part for key, part in fields_of(value).items()}
        axis, angle = numbers_of(parts.get("axis")), parts.get("angle")
        if axis is not None and axis.shape == (3,) and is_plain_number(angle) and np.linalg.norm(axis) > 0:
            return [float(part) for part in angle * axis / np.linalg.norm(axis)]
    return None


def _row(entry: dict[str, Any]) -> tuple[tuple[str, ...], list[float]] | None:
    """Return names and numbers of one map: of a table, ``("matrix",)`` of a 4x4, no names of a bare pose."""
    lists: dict[str, Any] = {
        str(key): found.tolist() for key, value in entry.items() if (found := numbers_of(value)) is not None
    }
    lists |= {key.lower(): value for key, value in lists.items() if key.lower() not in lists and key not in ("R", "T")}
    turned = _axis_and_angle(entry)
    if turned is not None:
        lists["rotvec"] = turned
    for key in _POSES:
        if np.shape(lists.get(key, [])) in ((6,), (7,)):
            return (), lists[key]
    if set(lists) == {"matrix"} and np.shape(lists["matrix"]) == (4, 4):
        return ("matrix",), np.ravel(lists["matrix"]).tolist()
    position = next((lists[key] for key in _POSITIONS if np.shape(lists.get(key, 0)) in ((3,), (3, 1))), None)
    if position is not None:
        t = np.ravel(position).tolist()
        for key in _MATRICES:
            if np.shape(lists.get(key, 0)) == (3, 3):
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = lists[key], t
                return ("matrix",), T.ravel().tolist()
        for key, columns in _LISTS.items():
            if np.shape(lists.get(key, 0)) in ((3,), (3, 1)):
                return ("x", "y", "z", *columns), [*t, *np.ravel(lists[key]).tolist()]
        for key, value in lists.items():
            if np.shape(value) == (4,) and (order := key.lower()[-4:]) in ("xyzw", "wxyz"):
                return ("x", "y", "z", *(f"q{axis}" for axis in order)), [*t, *value]
        for key in _OPEN:
            if np.shape(lists.get(key, 0)) in ((3,), (4,)):
                return (), [*t, *lists[key]]
    named: dict[str, float] = {} if position is None else dict(zip("xyz", t, strict=True))
    for key, value in entry.items():
        for inner, number in value.items() if is_map(value) else [("", value)]:
            if is_plain_number(number):
                named[f"{key}.{inner}" if inner else str(key)] = float(number)
    return (tuple(named), list(named.values())) if is_pose_header(tuple(named)) else None


_NUMBERS = re.compile(rf"[\[(\s]*{NUMBER}(?:[\s,;]+{NUMBER}){{2,15}}[\])\s]*,?")
_LABEL = r"(?<![\w.])([A-Za-z][\w .-]{0,60}(?:\([^()]{0,60}\))?)"
_PART = re.compile(rf"""{_LABEL}\s*[:=]\s*[\[("]?\s*({NUMBER}(?:[\s,;]+{NUMBER}){{2,8}})\s*[\])"]?""")
_ANY = re.compile(NUMBER)
_LABELLED_POSITIONS = {"position", "pos", "translation", "trans", "tvec", "xyz", "p", "t"}
# Words of a rotation, and the name under which `records` takes its numbers.
_ROTATIONS = {
    **dict.fromkeys(("rvec", "rotvec"), "rotvec"),
    **dict.fromkeys(("rpy", "roll"), "rpy"),
    **dict.fromkeys(("quaternion", "quat", "orientation", "orient", "rotation", "rot", "euler", "q"), "orientation"),
}  # fmt: skip
_LOOKED_AT = 40
# Longest line with parts of a pose.
LONGEST = 2000


def is_labelled(head: str) -> bool:
    """Return whether a text holds positions and rotations as lists behind their names."""
    if head.lstrip().startswith("{") or (head.lstrip().startswith("<") and "<origin" not in head):  # of URDF
        return False
    try:
        first = next(_entries(head, _LOOKED_AT), None)
    except (InputError, csv.Error):
        return False
    return first is not None and len(first) == 2


def read_labelled(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    try:
        values = list(_entries(text, None))
    except csv.Error as error:
        raise InputError(f"{name}: not a table: {error}; {HELP}.") from error
    if values and len(values[-1]) < 2:
        raise InputError(f"{name}: expected a position and a rotation of each pose, the last has one of them; {HELP}.")
    side = records_side(values, name)
    if side is None:
        raise InputError(f"{name}: expected the same names and numbers for each pose, got several; {HELP}.")
    return Contents(only=side)


def _entries(text: str, most: int | None) -> Iterator[dict[str, Any]]:
    """Yield position and rotation of each pose, of the first lines only if ``most`` is given."""
    if most is not None:
        text = "\n".join(text.split("\n", 3 * most)[: 3 * most])
    text = re.sub(r"\]\s*\n\s*\[", " ", text).replace("[[", "[").replace("]]", "]") if '"' not in text else text
    cells = '"' in text.partition("\n")[2][:MAX_LINE_CHARACTERS] and "<origin" not in text
    yield from _of_cells(text) if cells else _of_lines(text)


def _of_lines(text: str) -> Iterator[dict[str, Any]]:
    entry: dict[str, Any] = {}
    for line in text.split("\n"):
        if len(line) > LONGEST:
            continue
        for label, numbers in _PART.findall(line):
            found = _part(label, list(map(float, _ANY.findall(numbers))))
            if found is None:
                continue
            if found[0] in entry or (len(entry) == 2 and found[0] != "position"):
                yield entry
                entry = {}
            entry[found[0]] = found[1]
    if entry:
        yield entry


def _of_cells(text: str) -> Iterator[dict[str, Any]]:
    first = text.partition("\n")[0]
    separator = max(",;\t", key=first.count)
    rows = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    header = next(rows, [])
    for k, row in enumerate(rows):
        if k > MAX_ROWS:
            raise InputError(f"Expected at most {MAX_ROWS} rows.")
        entry: dict[str, Any] = {}
        for label, cell in zip(header, row, strict=False):
            if cell.lstrip().startswith(("[", "(")) and _NUMBERS.fullmatch(bare := _without_inner(cell)):
                found = _part(label, list(map(float, _ANY.findall(bare))))
                if found is not None:
                    entry[found[0]] = found[1]
        if entry:
            yield entry


def _without_inner(cell: str) -> str:
    """Return a list of lists as one list."""
    return re.sub(r"[\[\]()\n]", " ", cell[: 20 * MAX_LINE_CHARACTERS])


def _part(label: str, numbers: list[float]) -> tuple[str, Any] | None:
    """Return name and value of a part of a pose."""
    words = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label).lower())
    if len(numbers) == 16:
        return "matrix", [numbers[k : k + 4] for k in (0, 4, 8, 12)]
    if len(numbers) == 9:
        return ("R", [numbers[k : k + 3] for k in (0, 3, 6)]) if {*words} & {*_ROTATIONS, "r"} else None
    if len(numbers) == 3 and {*words} & _LABELLED_POSITIONS:
        return "position", numbers
    kind = next((_ROTATIONS[word] for word in words if word in _ROTATIONS), None)
    if kind is None or len(numbers) not in ((3, 4) if kind == "orientation" else (3,)):
        return None
    return kind, numbers
