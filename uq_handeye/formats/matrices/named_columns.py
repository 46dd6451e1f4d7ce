"""Matrices in tables whose columns are named by row and column: ``r11,r12,...,tx,ty,tz``, ``m00 ... m33``, ``T[0][3]``.

A name ends with two indices from 0 or from 1, with brackets, points or underscores between them or none, or with one
index of all 16 or 12 numbers (``O_T_EE_0 ... O_T_EE_15``, ``field.O_T_EE0``). A 3x3 needs the columns of a translation
(`..columns`), or t1, t2, t3. Other columns are not used, but for a time.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...core.files.one_line import short
from ...core.files.table import name_and_unit
from ...core.presentation.units import LENGTH_UNITS
from ...errors import InputError
from ..columns import SECONDS, meaning_and_unit
from ..contents import Contents, Reading, matrices_side
from ..number_table import names_of, read_number_table
from .layout import BOTH, matrices_in, with_last_row
from .matrix_contents import HELP

_TWO = re.compile(r"(.*?)[\[(_. ]*(\d)[\])(\[_., ]*(\d)[\])]*")
_ONE = re.compile(r"(.*?)[\[(_. ]*(\d{1,2})[\])]*")
FRANKA = "o_t_ee"


class Header(NamedTuple):
    """Places of the numbers in a table."""

    matrix: list[int]  # columns of the numbers of the matrix, row by row or as they are counted
    translation: list[int]  # columns of x, y, z; empty: in the matrix
    units: str | None  # of the translation
    time: tuple[int, str] | None  # column and its unit
    counted: bool  # whether the nine numbers of a rotation are only counted


def names_matrices(head: str) -> bool:
    """Return whether the first line that holds anything, or a comment above it, names the columns of matrices."""
    for line in head[:65536].split("\n"):
        if header_of(names := names_of(line)) is not None:
            return True
        if any(names) and not line.strip().startswith(("#", "%")):
            break
    return False


def header_of(names: Sequence[str]) -> Header | None:
    """Return what the names of columns say of matrices; None: nothing."""
    if len(names) < 12 or sum(bool(re.search("[A-Za-z]", name)) for name in names) < 9:
        return None
    two: dict[str, dict[tuple[int, int], int]] = defaultdict(dict)
    one: dict[str, dict[int, int]] = defaultdict(dict)
    units: dict[int, str] = {}
    for k, name in enumerate(names):
        bare, unit = name_and_unit(name, LENGTH_UNITS)
        if unit is not None and unit.lower() in LENGTH_UNITS:
            units[k] = unit.lower()
        else:
            bare = name
        if (match := _TWO.fullmatch(bare)) is not None:
            two[match[1].lower()][int(match[2]), int(match[3])] = k
        if (match := _ONE.fullmatch(bare)) is not None:
            one[match[1].lower()][int(match[2])] = k
    meant = [meaning_and_unit(name) for name in names]
    times = [(k, unit or "s") for k, (column, unit) in enumerate(meant) if column == "timestamp"]
    found: list[tuple[str, list[int]]] = [(stem, order) for stem, at in two.items() if (order := _grid(at))]
    found += [(stem, order) for stem, at in one.items() if (order := _counted(at))]
    if len(found) > 1:
        found = [one for one in found if re.sub(".*[/.]", "", one[0]).strip("_") == FRANKA] or found[:1]
    if not found:
        return None
    matrix = found[0][1]
    translation: list[int] = []
    if len(matrix) == 9:
        where = {column: k for k, (column, _) in reversed(list(enumerate(meant)))}
        axes = [where[axis] for axis in "xyz" if axis in where]
        by_number = [[at[k] for k in sorted(at)] for at in one.values() if sorted(at) in ([0, 1, 2], [1, 2, 3])]
        if not (translation := axes if len(axes) == 3 else next(iter(by_number), [])):
            return None
    of = translation or [matrix[k] for k in (3, 7, 11)]
    said_units = {units.get(k) or meant[k][1] for k in of}
    return Header(
        matrix,
        translation,
        said_units.pop() if len(said_units) == 1 else None,
        times[0] if times else None,
        len(matrix) == 9 and not any(_grid(at) == matrix for at in two.values()),
    )


def _grid(at: dict[tuple[int, int], int]) -> list[int]:
    """The columns of a full 3x3, 3x4 or 4x4, row by row; empty for anything else."""
    for rows, columns in ((4, 4), (3, 4), (3, 3)):
        for start in (0, 1):
            wanted = [(start + i, start + j) for i in range(rows) for j in range(columns)]
            if sorted(at) == wanted:
                return [at[place] for place in wanted]
    return []


def _counted(at: dict[int, int]) -> list[int]:
    """The columns of 16, 12 or 9 numbers that are counted from 0 or 1; empty for anything else."""
    for count in (16, 12, 9):
        for start in (0, 1):
            if sorted(at) == list(range(start, start + count)):
                return [at[k] for k in sorted(at)]
    return []


def read_columns(text: str, name: str, readings: tuple[Reading, ...] = ()) -> Contents:
    """Return the poses below names of columns; ``readings`` say what they are where the names do not."""
    table = read_number_table(text, name, lambda names: header_of(names) is not None, HELP)
    names = table.headings
    if (header := header_of(names)) is None:
        column, text = table.names[table.places.texts[0]], table.texts[0][0]
        raise InputError(f"{table.at(0)}, column {column}: expected a number, got {short(text)} ({HELP}).")
    first, last = names[header.matrix[0]], names[header.matrix[-1]]
    notes = [f"matrices from the columns {short(first)} to {last}"]
    matrix = table.values[:, header.matrix]
    if header.translation:
        readings = readings or (BOTH if header.counted else ())
        parts = [matrix.reshape(-1, 3, 3), table.values[:, header.translation, None]]
        T = with_last_row(np.concatenate(parts, axis=2))
    elif (found := matrices_in(matrix)) is not None:
        T, readings = found.T, readings or found.readings
        notes.append(found.note)
    else:
        raise InputError(
            f"{table.at(0)}: expected a matrix in the columns {first} to {last}, got no last row 0, 0, 0, 1 and no "
            f"rotation ({HELP})."
        )
    times = None if header.time is None else table.values[:, header.time[0]] * SECONDS[header.time[1]]
    if header.units is not None:
        notes.append(f"translations in {header.units}, as the columns are named")
    side = matrices_side(
        name, T, rows=table.lines, counted="line", timestamps=times, units=header.units, readings=readings
    )
    return Contents(only=side, notes=tuple(notes))
