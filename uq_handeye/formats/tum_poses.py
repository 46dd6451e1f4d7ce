"""TUM trajectories: ``timestamp tx ty tz qx qy qz qw`` per line, separated by spaces; ``#`` starts a comment line.

Units are seconds and metres; the scalar of the unit quaternion is last. A line with these names before the first row is
accepted, as a comment or without #, though the format has none; it may say that the scalar comes first. Source of the
rules: TUM RGB-D benchmark, "File Formats" (cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats), and its reader in
``evo`` (MichaelGrupp/evo, ``evo/tools/file_interface.py``).
"""

from __future__ import annotations

from typing import BinaryIO

from ..core.files.one_line import short
from ..core.files.table import Places, Schema, read_table
from ..errors import InputError
from .columns import meaning_and_unit
from .contents import COLUMNS, Contents, Side
from .rotations import QUATERNIONS

TUM_COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
_MATRIX = "; matrices are read as --format matrix, or by their content"
_HINTS = {4: _MATRIX, 7: "; add a time, or the row number, as the first column", 12: _MATRIX, 16: _MATRIX}


def names_order(words: list[str]) -> str | None:
    """The order of the quaternion in a line of names of the columns, or None for any other line."""
    meant = [meaning_and_unit(word)[0] for word in words]
    order = "".join(column[-1] for column in meant[4:] if column.startswith("q"))
    return order if meant[:4] == list(COLUMNS[:4]) and order in QUATERNIONS else None


def _tum_places(names: list[str], line: str, where: str) -> Places:
    named = names_order(names) is not None
    if len(names) != len(TUM_COLUMNS):
        hint = _HINTS.get(len(names), "; docs/formats.md has the formats")
        raise InputError(
            f"{where}: expected the 8 numbers {' '.join(TUM_COLUMNS)} separated by spaces, got {len(names)} fields, "
            f"{short(line)}{hint}."
        )
    return Places(range(len(TUM_COLUMNS)), names=None if named else TUM_COLUMNS)


TUM_SCHEMA = Schema(
    f"the columns {' '.join(TUM_COLUMNS)}",
    "pose",
    _tum_places,
    named=lambda names: names_order(names) is not None,
    marks=" ",
    decimal_commas=False,
    needs=lambda count: _HINTS.get(count, "; docs/formats.md has the formats"),
)


def read_tum(file: BinaryIO, name: str) -> Contents:
    """The poses of a TUM file, as they stand there."""
    table = read_table(file, name, TUM_SCHEMA)
    order = names_order(table.names) or "xyzw"
    notes = ("quaternions with the scalar first, as the columns are named",) if order == "wxyz" else ()
    columns = (*TUM_COLUMNS[:4], *(f"q{letter}" for letter in order))
    values = table.values
    side = Side(name, values[:, 1:4], values[:, 4:], values[:, 0].copy(), table.lines, "line", order, columns)
    return Contents(only=side, notes=notes)
