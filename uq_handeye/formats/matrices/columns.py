"""Matrices in tables whose columns are named by row and column: ``r11,r12,...,tx,ty,tz``, ``m00 ... m33``, ``T[0][3]``.

A name ends with two indices from 0 or from 1, with brackets, points or underscores between them or none, or with one
index of all 16 or 12 numbers (``O_T_EE_0 ... O_T_EE_15``, ``field.O_T_EE0``). A 3x3 needs the columns of a translation
(`..columns`), or t1, t2, t3. Other columns are not used, but for a time.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field
from io import BytesIO

import numpy as np

from ...core.files.lines import short
from ...core.files.table import Places, Schema, name_and_unit, read_table, split_names
from ...core.formatting.units import LENGTH_UNITS
from ...errors import InputError
from ..columns import SECONDS, meaning_and_unit
from ..contents import Contents, Reading, matrices_side
from .arrays import BOTH, found_in, with_last_row

_TWO = re.compile(r"(.*?)[\[(_. ]*(\d)[\])(\[_., ]*(\d)[\])]*")
_ONE = re.compile(r"(.*?)[\[(_. ]*(\d{1,2})[\])]*")
FRANKA = "o_t_ee"


@dataclass(frozen=True)
class Header:
    """Places of the numbers in a table.

    Parameters
    ----------
    line : line of the names, counted from 1
    matrix : columns of the numbers of the matrix, row by row or as they are counted
    names : of all columns
    translation : columns of x, y, z; empty: in the matrix
    units : of the translation, or None
    time : column and its unit
    counted : whether the nine numbers of a rotation are only counted
    """

    line: int
    matrix: list[int]
    names: list[str]
    translation: list[int] = field(default_factory=list)
    units: str | None = None
    time: tuple[int, str] | None = None
    counted: bool = False


def header_of(text: str) -> Header | None:
    """Return the names of the columns, if the first line that holds anything names those of matrices."""
    for number, raw in enumerate(text[:65536].split("\n"), start=1):
        content = raw.strip().lstrip("#%").strip()
        if not content:
            continue
        names, _ = split_names(content, ",;\t ")
        if len(names) >= 12 and sum(bool(re.search("[A-Za-z]", name)) for name in names) >= 9:
            return _header(number, names)
        if not raw.strip().startswith(("#", "%")):
            return None
    return None


def _header(number: int, names: list[str]) -> Header | None:
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
        axes = [[k for k, (column, _) in enumerate(meant) if column == axis] for axis in "xyz"]
        by_number = [at for at in one.values() if sorted(at) in ([0, 1, 2], [1, 2, 3])]
        if all(axes):
            translation = [columns[0] for columns in axes]
        elif by_number:
            translation = [by_number[0][index] for index in sorted(by_number[0])]
        else:
            return None
    of = translation or [matrix[k] for k in (3, 7, 11)]
    said_units = {units.get(k) or meant[k][1] for k in of}
    return Header(
        number,
        matrix,
        names,
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


def read_columns(text: str, name: str, header: Header, readings: tuple[Reading, ...] = ()) -> Contents:
    """Return the poses below a header; ``readings`` say what they are where the names do."""
    used = [*header.matrix, *header.translation, *([] if header.time is None else [header.time[0]])]
    # The names may stand in a comment, also of MATLAB, whose comments begin with %.
    lines = text.split("\n")
    lines[: header.line] = [*[""] * (header.line - 1), lines[header.line - 1].strip().lstrip("#%")]
    lines = ["" if line.lstrip().startswith("%") else line for line in lines]
    schema = Schema("the names of matrices", "pose", lambda names, line, where: Places(used), marks=",;\t ")
    found_table = read_table(BytesIO("\n".join(lines).encode()), name, schema)
    table = found_table.values
    k = len(header.matrix)
    notes = [f"matrices from the columns {short(header.names[header.matrix[0]])} to {header.names[header.matrix[-1]]}"]
    if header.translation:
        readings = readings or (BOTH if header.counted else ())
        T = with_last_row(np.concatenate([table[:, :9].reshape(-1, 3, 3), table[:, 9:12, None]], axis=2))
    else:
        found = found_in(table[:, :k])
        if found is None:
            raise InputError(
                f"{found_table.at(0)}: expected a matrix in the columns {header.names[header.matrix[0]]} to "
                f"{header.names[header.matrix[-1]]}, got no last row 0, 0, 0, 1 and no rotation (docs/formats.md, "
                "Matrices in text)."
            )
        T = found.T
        readings = readings or found.readings
        notes.append(found.note)
    times = None
    if header.time is not None:
        times = table[:, -1] * SECONDS[header.time[1]]
    if header.units is not None:
        notes.append(f"translations in {header.units}, as the columns are named")
    side = matrices_side(
        name, T, rows=found_table.lines, counted="line", timestamps=times, units=header.units, readings=readings
    )
    return Contents(only=side, notes=tuple(notes))
