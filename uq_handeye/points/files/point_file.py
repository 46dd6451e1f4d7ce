"""Points in CSV: ``pose,point,x,y,z`` with a header line, one point per line; the points of a target ``point,x,y,z``.

``pose`` is the number of the robot pose, from 0; names are numbered in the order of their appearance. ``point`` is a
name or a number. Other names of both columns are taken as well (`POSE`, `POINT`), with units behind x, y and z:
``x_mm``, ``x [mm]``. Fields are separated by commas, semicolons (numbers then may have decimal commas) or tabs. A point
with an empty coordinate or NaN was not seen. Further columns are not used. Without a header five fields a line are
pose, point and coordinates, and four those of a target. Tables with one row per pose: `wide_table`.
"""

from __future__ import annotations

import csv
import logging
import math
import re
import warnings
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, InputWarning
from ...files.lines import decoded, is_number, rows_of, short
from ...files.open import StrPath, as_path, opened, shown
from ...formats.columns import meaning_and_unit
from ...formats.contents import require_units
from ...geometry.se3 import Array
from ..measured import PointSet, Target
from .wide_table import long_table

MAX_BYTES = 200_000_000
POSE = ("pose", "row", "view", "frame", "shot", "scan", "capture", "image", "picture", "station", "position")
POINT = ("point", "marker", "feature", "sphere", "ball", "corner", "label", "target", "name", "tag", "fiducial")
ENDINGS = ("", "_id", "id", " id", "_no", "_nr", "_number", "_name", "_index", "_idx", "#")
TIMES = ("timestamp", "time", "stamp", "t")
PAGE = "docs/formats.md, points"
# Median distance (m) from which on points of a camera look like millimetres.
FAR = 30.0

_WHOLE = re.compile(r"(\d+)\.0*")  # 3.0 is 3

_log = logging.getLogger("uq_handeye")


def read_points(path: StrPath, units: str | None = None) -> PointSet:
    """Points of a CSV file with the header ``pose,point,x,y,z``, in any order, in the frame of the camera.

    Parameters
    ----------
    path : path of the file
    units : str or None
        Length unit of ``x, y, z``: m, mm, ...; None: what the header says, else m. Those returned are in metres.

    Raises
    ------
    InputError
        One line that names the file and the line: a file that cannot be read or is no such table; see `PointSet`.
    """
    reader, table = _table(path, units, "pose,point,x,y,z", True)
    row = _pose_numbers(reader, table[:, 0])
    if reader.point_at is None:
        point = _counted(reader, row)
    else:
        point = np.array(reader.points.names)[table[:, 1].astype(np.intp)]
    if units is None and reader.unit is None and np.median(np.linalg.norm(table[:, 2:], axis=1)) > FAR:
        far = float(np.median(np.linalg.norm(table[:, 2:], axis=1)))
        warnings.warn(
            f"{reader.file}: the points are {far:.3g} m away (median): they look like millimetres. Read them with "
            'units="mm" (--units mm).',
            InputWarning,
            stacklevel=2,
        )
    try:
        return PointSet(row, point, table[:, 2:])
    except InputError as error:
        raise InputError(f"{reader.file}: {str(error)[0].lower()}{str(error)[1:]}") from error


def read_target(path: StrPath, units: str | None = None) -> Target:
    """Points of a target in its own frame, from a CSV file with the header ``point,x,y,z``, in metres.

    Without names the points are numbered from 0. Raises `InputError` as `read_points`.
    """
    reader, table = _table(path, units, "point,x,y,z", False)
    names = reader.points.names if reader.point_at is not None else [str(k) for k in range(len(table))]
    if reader.point_at is not None:
        names = np.array(names)[table[:, 1].astype(np.intp)].tolist()
    try:
        return Target(np.array(names), table[:, 2:])
    except InputError as error:
        raise InputError(f"{reader.file}: {str(error)[0].lower()}{str(error)[1:]}") from error


def _table(path: StrPath, units: str | None, header: str, poses: bool) -> tuple[_Reader, Array]:
    """Pose, point (by their index) and coordinates in metres (k, 5), of points that were seen."""
    location = as_path(path)
    reader = _Reader(shown(location), header, poses)
    with opened(location, MAX_BYTES) as file:
        text = long_table(file, reader.file, lambda names: _place(names, POINT) is not None) if poses else file
        table, lines = rows_of(text, reader.file, reader.fields_of, reader.explain, lambda text, where: None)
    if reader.names is None:
        raise InputError(f"{reader.file}: the file is empty; expected the header {header} and one line per point.")
    if not len(lines):
        raise InputError(f"{reader.file}: no rows after the header; expected one line per point.")
    if reader.unit is not None and units not in (None, "m", reader.unit):
        raise InputError(
            f"{reader.file} names its coordinates in {reader.unit}, and `units` says {units}. Leave `units` out."
        )
    factor = require_units(reader.unit or units or "m")
    seen = ~np.isnan(table[:, 2:]).any(axis=1)
    if (wrong := np.isinf(table[:, 2:]).any(axis=1)).any():
        raise InputError(
            f"{reader.file}, line {lines[int(np.argmax(wrong))]}: expected finite coordinates, got infinity."
        )
    if not seen.any():
        raise InputError(f"{reader.file}: expected points with coordinates, got none.")
    if not seen.all():
        _log.info("%s: %d points without coordinates are left out", reader.file, int((~seen).sum()))
    table = table[seen]
    table[:, 2:] *= factor
    return reader, table


def _pose_numbers(reader: _Reader, index: Array) -> NDArray[np.int64]:
    """Numbers of the poses: as they stand there where all are whole numbers, else by their first appearance."""
    names = reader.poses.names
    values = [float(name) if is_number(name.encode()) else math.nan for name in names]
    if reader.timed or not all(value >= 0 and value == math.floor(value) and value < 1e9 for value in values):
        if (
            not reader.timed
            and all(value == math.floor(value) for value in values if math.isfinite(value))
            and min(values) < 0
        ):
            raise InputError(f"{reader.file}: expected numbers of poses from 0, got {min(values):g}.")
        _log.info("%s: poses are numbered 0 to %d in the order of the file", reader.file, len(names) - 1)
        return index.astype(np.int64)
    return np.array(values)[index.astype(np.intp)].astype(np.int64)


def _counted(reader: _Reader, row: NDArray[np.int64]) -> NDArray[np.str_]:
    """Names of points without any: their place within the pose, where all poses have as many."""
    _, count = np.unique(row, return_counts=True)
    if len(count) > 1 and count.max() > 1 and count.min() != count.max():
        raise InputError(
            f"{reader.file}: expected a column point, as the poses have {count.min()} to {count.max()} points: which "
            f"is which is not known. Name the points ({PAGE})."
        )
    order = np.argsort(row, kind="stable")
    place = np.empty(len(row), dtype=np.intp)
    place[order] = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    _log.info("%s: no column of points: they are numbered within each pose, in the order of the file", reader.file)
    return np.asarray(place.astype(str))


class _Names:
    """Index of names in the order of their first appearance; whole numbers are one, however they are written."""

    def __init__(self) -> None:
        self.index: dict[str, int] = {}

    @property
    def names(self) -> list[str]:
        return list(self.index)

    def number(self, text: str) -> bytes:
        if whole := _WHOLE.fullmatch(text):
            text = whole[1]
        return str(self.index.setdefault(text, len(self.index))).encode()


class _Reader:
    """The header, and the names of poses and points, which need not be numbers."""

    def __init__(self, file: str, header: str, poses: bool) -> None:
        self.file, self.header, self.with_poses = file, header, poses
        self.names: list[str] | None = None
        self.mark: str | None = ","
        self.unit: str | None = None
        self.pose_at: int | None = None
        self.point_at: int | None = None
        self.timed = False
        self.axes: list[int] = []
        self.poses, self.points = _Names(), _Names()

    def fields_of(self, text: bytes, where: str) -> list[bytes] | None:
        line = decoded(text, f"{where}: expected the header {self.header}")
        if self.names is None and self._header(line, where):
            return None
        assert self.names is not None
        fields = self._split(line, where)
        if len(fields) != len(self.names):
            raise InputError(f"{where}: expected {len(self.names)} fields, got {len(fields)} ({short(line)}).")
        found = [b"0", b"0"]
        for k, (place, names) in enumerate(((self.pose_at, self.poses), (self.point_at, self.points))):
            if place is not None:
                if not fields[place]:
                    raise InputError(f"{where}, column {self.names[place]}: expected a name or a number, got nothing.")
                found[k] = names.number(fields[place])
        for place in self.axes:
            value = fields[place]
            if self.mark != ",":
                value = value.replace(",", ".")
            found.append(value.encode() if value and value.lower() not in ("na", "none", "null", "-") else b"nan")
        return found

    def _split(self, line: str, where: str) -> list[str]:
        if self.mark is None:
            fields = line.split()
        elif '"' in line:
            try:
                fields = next(csv.reader([line], delimiter=self.mark, strict=True, skipinitialspace=True))
            except csv.Error as error:
                raise InputError(f"{where}: the quotation marks do not match.") from error
        else:
            fields = line.split(self.mark)
        return [field.strip(" \t\"'") for field in fields]

    def _header(self, line: str, where: str) -> bool:
        """Read the names of the columns; False where the line holds numbers, as there is no header."""
        self.mark = next((mark for mark in (";", "\t", ",") if mark in line), None)
        names = self._split(line, where)
        numeric = [is_number(name.encode()) for name in names]
        named = len(names) == 4 + self.with_poses and not numeric[int(self.with_poses)]
        if all(numeric) or (named and sum(numeric) == len(names) - 1):  # the point may have a name
            if len(names) != 4 + self.with_poses:
                raise InputError(f"{where}: expected the header {self.header}, got {short(line)} ({PAGE}).")
            names = ["pose", "point", "x", "y", "z"][0 if self.with_poses else 1 :]
            self._columns(names, where, line)
            _log.info("%s: no header; the columns are taken as %s", self.file, ",".join(names))
            return False
        self._columns(names, where, line)
        return True

    def _columns(self, names: list[str], where: str, line: str) -> None:
        small = [name.lower().strip() for name in names]
        meant = [meaning_and_unit(name) for name in small]
        self.names = names
        missing = []
        for axis in "xyz":
            places = [k for k, (column, _) in enumerate(meant) if column == axis]
            if len(places) > 1:
                raise InputError(f"{where}: expected one column {axis}, got {len(places)} in {short(line)}.")
            missing += [] if places else [axis]
            self.axes += places
        if self.with_poses:
            self.pose_at = _place(small, POSE)
            if self.pose_at is None:
                self.pose_at = next(
                    (k for k, name in enumerate(small) if meant[k][0] == "timestamp" or name in TIMES), None
                )
                self.timed = self.pose_at is not None
            if self.pose_at is None:
                missing.insert(0, "pose")
        self.point_at = _place(small, POINT)
        if self.point_at is None:
            self.point_at = next((k for k, name in enumerate(small) if name in ("id", "no", "nr", "#", "number")), None)
        if missing:
            raise InputError(
                f"{where}: expected the header {self.header}, got {short(line)} (missing: {', '.join(missing)}). One "
                f"point per line ({PAGE})."
            )
        units = {meant[k][1] for k in self.axes}
        if len(units) > 1:
            raise InputError(f"{where}: expected one unit for x, y and z, got {short(line)}.")
        (self.unit,) = units

    def explain(self, fields: list[bytes], where: str) -> NoReturn:
        assert self.names is not None
        for k, field in enumerate(fields[2:]):
            if not is_number(field):
                column = self.names[self.axes[k]]
                raise InputError(f"{where}, column {column}: expected a number, got {short(field.decode())}.")
        raise AssertionError(where)  # the caller has found something wrong


def _place(names: list[str], known: tuple[str, ...]) -> int | None:
    """Return which column bears one of the known names, with or without an ending."""
    meant = {f"{name}{ending}" for name in known for ending in ENDINGS}
    return next((k for k, name in enumerate(names) if name in meant), None)
