"""Corners in CSV: ``row,x,y,z,u,v`` with a header line, one corner per line.

``row`` is the number of the robot pose that the picture was taken at, ``x, y, z`` the point on the board (m, or as the
header says: ``x_mm``), ``u, v`` the pixel. A column ``name`` has the file of the picture, ``used`` (of files that this
package writes) 1 or 0, ``diameter`` that of the disc (in the unit of x, y, z) whose image has its centroid at u, v;
other columns are not used.
"""

from __future__ import annotations

import logging
import warnings

import numpy as np
from numpy.typing import NDArray

from ...core.files.csv_text import csv_text, plain_text
from ...core.files.one_line import short
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.table import Places, Schema, Table, in_order, name_and_unit, read_table, rows_are_numbers
from ...core.geometry.se3 import Array
from ...core.limits import MAX_PLAIN_LENGTH_M, MAX_TABLE_BYTES
from ...core.presentation.units import LENGTH_UNITS
from ...errors import InputError, InputWarning
from ...formats.contents import require_units
from .corners import Corners

COLUMNS = ("row", "x", "y", "z", "u", "v")
HEADER = ",".join(COLUMNS)
_log = logging.getLogger("uq_handeye")


def read_corners(path: StrPath, units: str = "m") -> Corners:
    """Corners of a CSV file with the header ``row,x,y,z,u,v``, in any order, and perhaps ``name``.

    Parameters
    ----------
    path : path of the file
    units : str
        Length unit of ``x, y, z``: m, mm, ..., where the header does not name it (``x_mm``, ``x [mm]``); those returned
        are in metres.

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
    with opened(location, MAX_TABLE_BYTES) as file:
        table = read_table(file, name, SCHEMA)
    meant, units_named = zip(*(_name_and_unit(table.column(k)) for k in range(table.values.shape[1])), strict=True)
    if left := [one for one in table.names if _name_and_unit(one)[0] not in (*meant, "name")]:
        _log.info("%s: not used: the columns %s", name, short(", ".join(left)))
    if len(set(units_named[1:4])) > 1:
        raise InputError(f"{name}: expected one unit for x, y and z, got {short(', '.join(table.names))}.")
    if units_named[1] is not None:
        if units not in ("m", units_named[1]):
            raise InputError(f"{name} names its points in {units_named[1]}, and `units` is {units}. Leave `units` out.")
        factor = require_units(units_named[1])
    table.require_finite("; leave out corners that were not seen")
    value = dict(zip(meant, table.values.T, strict=True))
    points = np.stack([value[axis] for axis in "xyz"], axis=-1) * factor
    pixels = np.stack([value[axis] for axis in "uv"], axis=-1)
    used = np.ones(len(table.values), dtype=bool)
    if "used" in value:
        if not np.isin(value["used"], (0, 1)).all():
            raise InputError(f"{name}, column used: expected 1 or 0, got others.")
        used = value["used"] == 1
    try:
        discs = value["diameter"] * factor if "diameter" in value else None
        corners = Corners(value["row"], points, pixels, _pictures(table, value["row"]), diameter=discs)
    except InputError as error:
        raise InputError(f"{name}: {str(error)[0].lower()}{str(error)[1:]}") from error
    if (span := float(np.linalg.norm(np.ptp(points, axis=0)))) > MAX_PLAIN_LENGTH_M:
        warnings.warn(
            f"{name}: their points span {span:.3g} m, more than a board does: they look like millimetres. Read them "
            'with units="mm" (--units mm).',
            InputWarning,
            stacklevel=3,
        )
    corners.require_once(name)
    return corners, used[np.argsort(value["row"], kind="stable")]


def _name_and_unit(name: str) -> tuple[str, str | None]:
    """A name in small letters, of coordinates of the board without their unit, and that: ``x_mm``, ``x [mm]``."""
    bare, unit = name_and_unit(name.lower(), LENGTH_UNITS)
    return (bare, unit) if bare in ("x", "y", "z", "diameter") else (name.lower(), None)


def _places(names: list[str], line: str, where: str) -> Places:
    small = [_name_and_unit(name)[0] for name in names]
    missing = [column for column in COLUMNS if column not in small]
    _, twice = in_order(small, (*COLUMNS, "name", "used", "diameter"))
    if missing or twice:
        what = f"missing: {', '.join(missing)}" if missing else f"twice: {', '.join(sorted(twice))}"
        hint = "; the header line is missing" if rows_are_numbers(names) else ""
        raise InputError(f"{where}: expected the header {HEADER}, got {short(line)} ({what}){hint}.")
    wanted = [*COLUMNS, *(name for name in ("used", "diameter") if name in small)]
    return Places([small.index(column) for column in wanted], [small.index("name")] if "name" in small else [])


SCHEMA = Schema(f"the header {HEADER}", "corner", _places, quotes=True)


def _pictures(table: Table, row: Array) -> tuple[str, ...]:
    """Return the names of the pictures, in ascending order of the rows; a row has one name."""
    named: dict[float, tuple[str, int]] = {}
    for k, (number, (text,)) in enumerate(zip(row.tolist(), table.texts, strict=bool(table.texts))):
        name = plain_text(text)
        before, first = named.setdefault(number, (name, k))
        if before != name:
            raise InputError(
                f"{table.at(k)}: row {number:g} is of {short(name)}, in {table.at(first)} of {short(before)}."
            )
    return tuple(named[number][0] or f"row {number:g}" for number in np.unique(row).tolist()) if named else ()


def corners_text(corners: Corners, used: NDArray[np.bool_]) -> str:
    """Format corners as `corners_and_used` reads them, bit by bit."""
    table = np.column_stack([corners.points, corners.pixels]).tolist()
    rows = zip(corners.row.tolist(), table, used.tolist(), corners.picture.tolist(), strict=True)
    lines = ([row, *numbers, int(use), corners.names[picture]] for row, numbers, use, picture in rows)
    return csv_text([[*COLUMNS, "used", "name"], *lines])
