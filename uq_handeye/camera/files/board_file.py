"""Points of a target in CSV: ``x,y,z`` with a header line, one point per line, metres or the unit that the header says.

``x_mm,y_mm,z_mm`` and ``x [mm]`` are read as such. A target that no `Board` describes: circles, tags on a plate, marks.
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from ...errors import InputError
from ...files.lines import decoded, is_number, rows_of, short
from ...files.open import StrPath, as_path, opened, shown
from ...formats.columns import meaning_and_unit
from ...formatting.units import LENGTH_UNITS
from ...geometry.se3 import Array

MAX_BYTES = 1_000_000
HEADER = "x,y,z"


def read_board_points(path: StrPath) -> Array:
    """The points (m, 3) of a target in its own frame, in metres.

    Raises
    ------
    InputError
        One line that names the file and the line: a file that cannot be read, or is no such table.
    """
    location = as_path(path)
    name = shown(location)
    factors: list[float] = []

    def fields_of(text: bytes, where: str) -> list[bytes] | None:
        fields = text.replace(b";", b",").split(b",")
        if not factors:
            titles = decoded(text, f"{where}: expected the header {HEADER}").replace(";", ",").split(",")
            found = [meaning_and_unit(title.strip(" \t\"'")) for title in titles]
            if [column for column, _ in found] != ["x", "y", "z"]:
                raise InputError(f"{where}: expected the header {HEADER}, got {short(','.join(titles))}.")
            factors.extend(LENGTH_UNITS[unit or "m"] for _, unit in found)
            return None
        if len(fields) != 3:
            raise InputError(f"{where}: expected a point, 3 numbers separated by ',', got {len(fields)} fields.")
        return fields

    def explain(fields: list[bytes], where: str) -> NoReturn:
        wrong = next(field for field in fields if not is_number(field))
        what = f"{where}: expected a point, 3 numbers"
        raise InputError(f"{what}, got {short(decoded(wrong, what).strip())}.")

    with opened(location, MAX_BYTES) as file:
        table, lines = rows_of(file, name, fields_of, explain, lambda text, where: None)
    if not len(lines):
        raise InputError(f"{name}: expected the header {HEADER} and one line per point of the board, got no point.")
    if not (finite := np.isfinite(table)).all():
        row = int(np.argmin(finite.all(axis=1)))
        raise InputError(f"{name}, line {lines[row]}: expected finite numbers, got {table[row].tolist()}.")
    return np.asarray(table * factors)
