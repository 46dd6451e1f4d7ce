"""Corners in CSV: ``row,x,y,z,u,v`` with a header line, one corner per line.

``row`` is the number of the robot pose that the picture was taken at, ``x, y, z`` the point on the board, ``u, v`` the
pixel. A column ``name`` has the picture's file, ``used`` (of our own files) 1 or 0; others are not used.
"""

from __future__ import annotations

import csv
import logging
import warnings
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, InputWarning
from ...files.csv_text import csv_text, plain_text
from ...files.lines import MAX_BYTES, decoded, is_number, rows_of, short
from ...files.open import StrPath, as_path, opened, shown
from ...formats.contents import require_units
from ..corners import Corners

COLUMNS = ("row", "x", "y", "z", "u", "v")
HEADER = ",".join(COLUMNS)

# Points farther apart (m) are on no board.
LARGEST = 10.0

_log = logging.getLogger("uq_handeye")


def read_corners(path: StrPath, units: str = "m") -> Corners:
    """Corners of a CSV file with the header ``row,x,y,z,u,v``, in any order, and perhaps ``name``.

    Parameters
    ----------
    path : path of the file
    units : str
        Length unit of ``x, y, z``: m, mm, ...; those returned are in metres.

    Raises
    ------
    InputError
        One line that names the file and the line: a file that cannot be read or is no such table; see `Corners`.
    """
    corners, _ = corners_and_used(path, units)
    return corners


def corners_and_used(path: StrPath, units: str = "m") -> tuple[Corners, NDArray[np.bool_]]:
    """Read corners, and which of them, sorted by row, the column ``used`` marks as used; all where there is no such
    column.
    """
    factor = require_units(units)
    location = as_path(path)
    name = shown(location)
    with opened(location, MAX_BYTES) as file:
        reader = _Reader(name)
        table, lines = rows_of(file, name, reader.fields_of, reader.explain, lambda text, where: None)
    if not reader.names:
        raise InputError(f"{name}: the file is empty; expected the header {HEADER} and one line per corner.")
    if not len(lines):
        raise InputError(f"{name}: no rows after the header; expected one line per corner.")
    if reader.left:
        _log.info("%s: not used: the columns %s", name, short(", ".join(reader.left)))
    if not (finite := np.isfinite(table)).all():
        where = divmod(int(np.argmin(finite)), table.shape[1])
        raise InputError(
            f"{name}, line {lines[where[0]]}, column {reader.meant[where[1]]}: expected a finite number, got "
            f"{table[where]}; leave out corners that were not seen."
        )
    value = dict(zip(reader.meant, table.T, strict=True))
    points = np.stack([value[axis] for axis in "xyz"], axis=-1) * factor
    pixels = np.stack([value[axis] for axis in "uv"], axis=-1)
    if (span := float(np.linalg.norm(np.ptp(points, axis=0)))) > LARGEST:
        warnings.warn(
            f"{name}: their points span {span:.3g} m, more than a board does: they look like millimetres. Read them "
            'with units="mm" (--units mm).',
            InputWarning,
            stacklevel=3,
        )
    used = np.ones(len(table), dtype=bool)
    if "used" in value:
        if not np.isin(value["used"], (0, 1)).all():
            raise InputError(f"{name}, column used: expected 1 or 0, got others.")
        used = value["used"] == 1
    try:
        corners = Corners(value["row"], points, pixels, reader.pictures(value["row"]))
    except InputError as error:
        raise InputError(f"{name}: {str(error)[0].lower()}{str(error)[1:]}") from error
    return corners, used[np.argsort(value["row"], kind="stable")]


class _Reader:
    """The header, and the names of the pictures, which are no numbers."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.names: list[str] = []
        self.meant: list[str] = []  # of the fields that are numbers
        self.left: list[str] = []
        self.places: list[int] = []
        self.name_at: int | None = None
        self.mark = ","
        self.named: dict[float, tuple[str, str]] = {}  # by row: the name and where it stood first

    def fields_of(self, text: bytes, where: str) -> list[bytes] | None:
        if not self.names:
            self._header(decoded(text, f"{where}: expected the header {HEADER}"), where)
            return None
        fields = self._split(text, where) if b'"' in text else text.split(self.mark.encode())
        if len(fields) != len(self.names):
            raise InputError(
                f"{where}: expected {len(self.names)} fields separated by {self.mark!r}, got {len(fields)}."
            )
        numbers = [fields[k] for k in self.places]
        if self.name_at is not None and is_number(numbers[0]):
            row, name = float(numbers[0]), decoded(fields[self.name_at], f"{where}, column name: expected text")
            name = plain_text(name.strip())
            before, first = self.named.setdefault(row, (name, where))
            if before != name:
                raise InputError(f"{where}: row {row:g} is of {short(name)}, in {first} of {short(before)}.")
        return numbers

    def _split(self, text: bytes, where: str) -> list[bytes]:
        try:
            parts = next(csv.reader([decoded(text, f"{where}: expected text")], delimiter=self.mark, strict=True))
        except csv.Error as error:
            raise InputError(f"{where}: the quotation marks do not match.") from error
        return [part.encode() for part in parts]

    def _header(self, text: str, where: str) -> None:
        self.mark = next((mark for mark in (",", ";", "\t") if mark in text), ",")
        names = [name.strip(" \t\"'").lower() for name in text.split(self.mark)]
        missing = [column for column in COLUMNS if column not in names]
        twice = sorted({name for name in names if names.count(name) > 1 and name in (*COLUMNS, "name", "used")})
        if missing or twice:
            numbers = all(is_number(name.encode()) for name in names)
            what = f"missing: {', '.join(missing)}" if missing else f"twice: {', '.join(twice)}"
            hint = "; the header line is missing" if numbers else ""
            raise InputError(f"{where}: expected the header {HEADER}, got {short(text)} ({what}){hint}.")
        self.names = names
        self.meant = [*COLUMNS, *(["used"] if "used" in names else [])]
        self.places = [names.index(column) for column in self.meant]
        self.name_at = names.index("name") if "name" in names else None
        self.left = [name for name in names if name not in (*self.meant, "name")]

    def explain(self, fields: list[bytes], where: str) -> NoReturn:
        for column, field in zip(self.meant, fields, strict=True):
            if not is_number(field):
                got = short(decoded(field, f"{where}, column {column}: expected a number").strip(" \t"))
                raise InputError(f"{where}, column {column}: expected a number, got {got}.")
        raise AssertionError(where)  # the caller has found something wrong

    def pictures(self, row: Any) -> tuple[str, ...]:
        """Return the names of the pictures, in ascending order of the rows."""
        if self.name_at is None:
            return ()
        return tuple(self.named[number][0] or f"row {number:g}" for number in np.unique(row).tolist())


def corners_text(corners: Corners, used: NDArray[np.bool_]) -> str:
    """Format corners as `corners_and_used` reads them, bit by bit."""
    table = np.column_stack([corners.points, corners.pixels]).tolist()
    rows = zip(corners.row.tolist(), table, used.tolist(), corners.picture.tolist(), strict=True)
    lines = ([row, *numbers, int(use), corners.names[picture]] for row, numbers, use, picture in rows)
    return csv_text([[*COLUMNS, "used", "name"], *lines])
