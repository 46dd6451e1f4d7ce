"""TUM trajectories: ``timestamp tx ty tz qx qy qz qw`` per line, separated by spaces; ``#`` starts a comment line.

Seconds, metres, unit quaternion with the scalar last. A line with these names before the first row is taken, as a
comment or without #, though the format has none; it may say that the scalar comes first. Source of the rules: TUM RGB-D
benchmark, "File Formats" (cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats), and its reader in ``evo``
(MichaelGrupp/evo, ``evo/tools/file_interface.py``).
"""

from __future__ import annotations

from typing import BinaryIO, NoReturn

from ..errors import InputError
from ..files.lines import decoded, is_number, rows_of, short
from .columns import meaning
from .contents import COLUMNS as USUAL
from .contents import Contents, Side
from .rotation_form import QUATERNIONS

COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


_MATRIX = "; matrices are read as --format matrix, or by their content"
_HINTS = {
    4: _MATRIX,
    7: "; add a time, or the row number, as the first column",
    12: _MATRIX,
    16: _MATRIX,
}


def names_order(words: list[bytes]) -> str | None:
    """The order of the quaternion in a line of names of the columns, or None for any other line."""
    meant = [meaning(word.decode("utf-8", errors="replace")) for word in words]
    order = "".join(column[-1] for column in meant[4:] if column.startswith("q"))
    return order if meant[:4] == list(USUAL[:4]) and order in QUATERNIONS else None


def read_tum(file: BinaryIO, name: str) -> Contents:
    """The poses of a TUM file, as they stand there."""
    orders: list[str] = []
    begun = False

    def comment(text: bytes, where: str) -> None:
        if order := names_order(text.lstrip(b"# \t").split()):
            orders[:] = [order]

    def fields_of(text: bytes, where: str) -> list[bytes] | None:
        fields = text.split()
        nonlocal begun
        if not begun:
            order = names_order(fields) if len(fields) == len(COLUMNS) else None
            if order:
                orders[:] = [order]
                return None
            begun = True
            orders[:] = orders or ["xyzw"]
        if len(fields) != len(COLUMNS):
            words = decoded(text, f"{where}: expected {' '.join(COLUMNS)}")
            hint = _HINTS.get(len(fields), "; docs/formats.md has the formats")
            raise InputError(
                f"{where}: expected the 8 numbers {' '.join(COLUMNS)} separated by spaces, got {len(fields)} "
                f"fields, {short(words)}{hint}."
            )
        return fields

    def explain(fields: list[bytes], where: str) -> NoReturn:
        for column, field in zip(COLUMNS, fields, strict=True):
            if not is_number(field):
                text = decoded(field, f"{where}, column {column}: expected a number")
                raise InputError(f"{where}, column {column}: expected a number, got {short(text)}.")
        raise AssertionError(where)  # the caller has found something wrong

    table, lines = rows_of(file, name, fields_of, explain, comment)
    if not len(lines):
        raise InputError(f"{name}: the file is empty; expected {' '.join(COLUMNS)} on each line.")
    notes = ("quaternions with the scalar first, as the columns are named",) if orders[0] == "wxyz" else ()
    columns = (*COLUMNS[:4], *(f"q{letter}" for letter in orders[0]))
    side = Side(name, table[:, 1:4], table[:, 4:], table[:, 0].copy(), lines, "line", orders[0], columns)
    return Contents(only=side, notes=notes)
