"""Points in CSV: ``pose,point,x,y,z`` with a header line, one point per line; the points of a target ``point,x,y,z``.

``pose`` is the number of the robot pose, from 0; names are numbered in the order of their appearance. ``point`` is a
name or a number. Other names of both columns are taken as well (`POSE`, `POINT`), with units behind x, y and z:
``x_mm``, ``x [mm]``. Fields are separated by commas, semicolons (numbers then may have decimal commas) or tabs. A point
with an empty coordinate or NaN was not seen. Further columns are not used. Without a header five fields a line are
pose, point and coordinates, and four those of a target.

Trackers write tables with one row per pose (``pose,A_x,A_y,A_z,B_x,...``). The axis is behind the name
of the point (``A_x``, ``A x [mm]``, ``A.x_mm``) or before its number (``x1``).
"""

from __future__ import annotations

import logging
import math
import re
import warnings
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core.files.lines import is_number
from ...core.files.one_line import short
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.table import Places, Schema, Table, read_table
from ...core.geometry.se3 import Array
from ...core.limits import MAX_TABLE_BYTES
from ...errors import InputError, InputWarning
from ...formats.columns import meaning_and_unit
from ...formats.contents import require_units
from .measured import PointSet, Target

_UNIT = r"(?P<unit>[ _]?(?:\[\w+\]|\(\w+\)|(?<=[ _])(?:m|mm|cm|in)))?"
_BEHIND = re.compile(rf"(?P<name>.*\w)[ _.:/-](?P<axis>[xyz]){_UNIT}", re.IGNORECASE)
_BEFORE = re.compile(rf"(?P<axis>[xyz])[ _]?(?P<name>\d+){_UNIT}", re.IGNORECASE)
POSE = ("pose", "row", "view", "frame", "shot", "scan", "capture", "image", "picture", "station", "position")
POINT = ("point", "marker", "feature", "sphere", "ball", "corner", "label", "target", "name", "tag", "fiducial")
ENDINGS = ("", "_id", "id", " id", "_no", "_nr", "_number", "_name", "_index", "_idx", "#")
TIMES = ("timestamp", "time", "stamp", "t")
PAGE = "docs/formats.md, points"
# Points of a camera that are farther away (median) look like millimetres.
MAX_MEDIAN_DISTANCE_M = 30.0

_WHOLE = re.compile(r"(\d+)\.0*")  # 3.0 is 3

_log = logging.getLogger("uq_handeye")


def _wide(header: list[str]) -> tuple[dict[str, list[int]], str]:
    """Return the columns x, y, z of each point of a table with a row per pose, and their unit; none: it is another."""
    for pattern in (_BEHIND, _BEFORE):
        places: dict[str, dict[str, int]] = {}
        units = set()
        for k, cell in enumerate(header):
            if match := pattern.fullmatch(cell):
                places.setdefault(match["name"], {})[match["axis"].lower()] = k
                units.add((match["unit"] or "").lower())
        points = {name: [axes[a] for a in "xyz"] for name, axes in places.items() if len(axes) == 3}
        if len(points) > 1 and len(units) == 1:
            return points, units.pop().strip(" _[]()")
    return {}, ""


def _unfolded(table: Table) -> Table:
    """A table with a row per pose as one with a row per point."""
    points, unit = _wide(table.names)
    n, m = len(table.values), len(points)
    poses = [text for (text,) in table.texts] or list(map(str, range(n)))
    first = table.names[table.places.texts[0]] if table.texts else "pose"
    return replace(
        table,
        names=[first, "point", *(f"{axis}_{unit}" if unit else axis for axis in "xyz")],
        places=Places((2, 3, 4), (0, 1)),
        values=table.values.reshape(n * m, 3),
        lines=np.repeat(table.lines, m),
        texts=[(pose, point) for pose in poses for point in points],
    )


def read_points(path: StrPath, units: str | None = None) -> PointSet:
    """Points of a CSV file with the header ``pose,point,x,y,z``, in any order, in the frame of the camera.

    Parameters
    ----------
    path : path of the file
    units : str or None
        Length unit of ``x, y, z``: m, mm, ...; None: that of the header, else m. Those returned are in metres.

    Raises
    ------
    InputError
        One line that names the file and the line: a file that cannot be read or is no such table; see `PointSet`.
    """
    table, seen, xyz, unit = _seen(path, units, POSES)
    poses, *points = _texts(table)
    row = _pose_numbers(table, poses)[seen]
    point = np.array(points[0])[seen] if points else _counted(table.name, row)
    try:
        measured = PointSet(row, point, xyz)
    except InputError as error:
        raise InputError(f"{table.name}: {str(error)[0].lower()}{str(error)[1:]}") from error
    if (
        units is None
        and unit is None
        and (far := float(np.median(np.linalg.norm(xyz, axis=1)))) > MAX_MEDIAN_DISTANCE_M
    ):
        warnings.warn(
            f"{table.name}: the points are {far:.3g} m away (median): they look like millimetres. Read them with "
            'units="mm" (--units mm).',
            InputWarning,
            stacklevel=2,
        )
    return measured


def read_target(path: StrPath, units: str | None = None) -> Target:
    """Points of a target in its own frame, from a CSV file with the header ``point,x,y,z``, in metres.

    Without names the points are numbered from 0. Raises `InputError` as `read_points`.
    """
    table, seen, xyz, _ = _seen(path, units, TARGET)
    texts = _texts(table)
    names = [texts[0][k] for k in seen] if texts else [str(k) for k in range(len(xyz))]
    try:
        return Target(np.array(names), xyz)
    except InputError as error:
        raise InputError(f"{table.name}: {str(error)[0].lower()}{str(error)[1:]}") from error


def _seen(path: StrPath, units: str | None, schema: Schema) -> tuple[Table, NDArray[np.intp], Array, str | None]:
    """A table, the rows (k,) of points that were seen, their coordinates (k, 3) in metres, and the unit it names."""
    location = as_path(path)
    name = shown(location)
    with opened(location, MAX_TABLE_BYTES) as file:
        table = read_table(file, name, schema)
    table = _unfolded(table) if len(table.places.numbers) > 3 else table
    unit = meaning_and_unit(table.column(0).lower())[1]
    if unit is not None and units not in (None, "m", unit):
        raise InputError(f"{name} names its coordinates in {unit}, and `units` is {units}. Leave `units` out.")
    factor = require_units(unit or units or "m")
    if (wrong := np.isinf(table.values).any(axis=1)).any():
        raise InputError(f"{table.at(int(np.argmax(wrong)))}: expected finite coordinates, got infinity.")
    seen = np.flatnonzero(~np.isnan(table.values).any(axis=1))
    if not seen.size:
        raise InputError(f"{name}: expected points with coordinates, got none.")
    if len(seen) < len(table.values):
        _log.info("%s: %d points without coordinates are left out", name, len(table.values) - len(seen))
    return table, seen, table.values[seen] * factor, unit


def _texts(table: Table) -> list[list[str]]:
    """Names in each column of text; whole numbers are one, however they are written."""
    for k, row in enumerate(table.texts):
        if "" in row:
            column = table.names[table.places.texts[row.index("")]]
            raise InputError(f"{table.at(k)}, column {column}: expected a name or a number, got nothing.")
    return [[_whole(row[j]) for row in table.texts] for j in range(len(table.places.texts))]


def _pose_numbers(table: Table, names: list[str]) -> NDArray[np.int64]:
    """Numbers of the poses: those of the file where all are whole numbers, else by first appearance."""
    index = {name: k for k, name in enumerate(dict.fromkeys(names))}
    values = {name: float(name) if is_number(name.encode()) else math.nan for name in index}
    timed = _is_time(table.names[table.places.texts[0]].lower())
    if timed or not all(0 <= value < 1e9 and value == math.floor(value) for value in values.values()):
        finite = [value for value in values.values() if math.isfinite(value)]
        if not timed and finite and min(finite) < 0 and all(value == math.floor(value) for value in finite):
            raise InputError(f"{table.name}: expected numbers of poses from 0, got {min(finite):g}.")
        _log.info("%s: poses are numbered 0 to %d in the order of the file", table.name, len(index) - 1)
        return np.array([index[name] for name in names])
    return np.array([int(values[name]) for name in names])


def _counted(name: str, row: NDArray[np.int64]) -> NDArray[np.str_]:
    """Names of points without any: their place within the pose, where all poses have as many."""
    _, count = np.unique(row, return_counts=True)
    if len(count) > 1 and count.max() > 1 and count.min() != count.max():
        raise InputError(
            f"{name}: expected a column point, as the poses have {count.min()} to {count.max()} points: which "
            f"is which is not known. Name the points ({PAGE})."
        )
    order = np.argsort(row, kind="stable")
    place = np.empty(len(row), dtype=np.intp)
    place[order] = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    _log.info("%s: no column of points: they are numbered within each pose, in the order of the file", name)
    return np.asarray(place.astype(str))


def _places(names: list[str], line: str, where: str, usual: tuple[str, ...]) -> Places:
    """Find the columns, or take those of a line without names in their usual order."""
    numeric = [is_number(name.encode()) for name in names]
    named = len(names) == len(usual) and not numeric[-4]  # the point may have a name
    if all(numeric) or (named and sum(numeric) == len(names) - 1):
        if len(names) != len(usual):
            raise InputError(f"{where}: expected the header {','.join(usual)}, got {short(line)} ({PAGE}).")
        _log.info("%s: no header; the columns are taken as %s", where.rpartition(",")[0], ",".join(usual))
        return Places(range(len(usual) - 3, len(usual)), range(len(usual) - 3), usual)
    small = [name.lower() for name in names]
    point, texts = _place(small, POINT), []
    if "pose" in usual:
        pose = _place(small, POSE)
        pose = next((k for k, name in enumerate(small) if _is_time(name)), None) if pose is None else pose
        texts = [] if pose is None else [pose]
        if point is None and (wide := _wide(names)[0]):
            columns = [k for axes in wide.values() for k in axes]
            if texts or len(columns) == len(names):
                return Places(columns, texts)
    meant = [meaning_and_unit(name) for name in small]
    missing, axes = ["pose"] if "pose" in usual and not texts else [], []
    for axis in "xyz":
        places = [k for k, (column, _) in enumerate(meant) if column == axis]
        if len(places) > 1:
            raise InputError(f"{where}: expected one column {axis}, got {len(places)} in {short(line)}.")
        missing += [] if places else [axis]
        axes += places
    if point is None:
        point = next((k for k, name in enumerate(small) if name in ("id", "no", "nr", "#", "number")), None)
    if missing:
        raise InputError(
            f"{where}: expected the header {','.join(usual)}, got {short(line)} (missing: {', '.join(missing)}). One "
            f"point per line ({PAGE})."
        )
    if len({meant[k][1] for k in axes}) > 1:
        raise InputError(f"{where}: expected one unit for x, y and z, got {short(line)}.")
    return Places(axes, [*texts, *([] if point is None else [point])])


def _is_time(name: str) -> bool:
    """Return whether a column numbers the poses by their time."""
    return _place([name], POSE) is None and (meaning_and_unit(name)[0] == "timestamp" or name in TIMES)


def _schema(*usual: str) -> Schema:
    return Schema(
        f"the header {','.join(usual)}",
        "point",
        lambda names, line, where: _places(names, line, where, usual),
        marks=";\t, ",
        missing=("", "na", "none", "null", "-"),
        quotes=True,
    )


POSES, TARGET = _schema("pose", "point", "x", "y", "z"), _schema("point", "x", "y", "z")


def _place(names: list[str], known: tuple[str, ...]) -> int | None:
    """Return which column bears one of the known names, with or without an ending."""
    meant = {f"{name}{ending}" for name in known for ending in ENDINGS}
    return next((k for k, name in enumerate(names) if name in meant), None)


def _whole(text: str) -> str:
    """Return a name; a whole number without its zeros behind the point."""
    found = _WHOLE.fullmatch(text)
    return text if found is None else found[1]
