"""Tables with one row per pose, as trackers write them (``pose,A_x,A_y,A_z,B_x,...``), as tables of one point per line.

The axis stands behind the name of the point (``A_x``, ``A x [mm]``, ``A.x_mm``) or before its number (``x1``).
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterator
from typing import BinaryIO

from ...errors import InputError
from ...files.lines import decoded, is_number, short

_UNIT = r"(?P<unit>[ _]?(?:\[\w+\]|\(\w+\)|(?<=[ _])(?:m|mm|cm|in)))?"
_BEHIND = re.compile(rf"(?P<name>.*\w)[ _.:/-](?P<axis>[xyz]){_UNIT}", re.IGNORECASE)
_BEFORE = re.compile(rf"(?P<axis>[xyz])[ _]?(?P<name>\d+){_UNIT}", re.IGNORECASE)
# Points of a row.
FEWEST, MOST = 2, 10_000
LONGEST = 1_000_000  # bytes of the header


def long_table(file: BinaryIO, name: str, is_long: Callable[[list[str]], bool]) -> BinaryIO:
    """Return a wide table as one with a point per line; another table as it is, which ``is_long`` says of a header."""
    first = file.readline(LONGEST)
    found = None
    try:
        line = decoded(first.removeprefix(b"\xef\xbb\xbf"), name).strip()
        mark = next((mark for mark in (";", "\t", ",") if mark in line), " ")
        header = [cell.strip(" \t\"'") for cell in line.split(mark)]
        found = None if is_long([cell.lower() for cell in header]) else _columns(header)
    except InputError:
        pass
    if found is None:
        file.seek(0)
        return file
    points, unit = found
    other = [k for k in range(len(header)) if all(k not in axes for axes in points.values())]
    first_line = ["pose" if not other else header[other[0]], "point", *(f"{axis}{unit}" for axis in "xyz")]
    return io.BytesIO(b"".join([_line(first_line), *_rows(file, mark, len(header), other[:1], points, name)]))


def _columns(header: list[str]) -> tuple[dict[str, list[int]], str] | None:
    """Return the columns x, y, z of each point and their unit; None: the table is not wide."""
    for pattern in (_BEHIND, _BEFORE):
        places: dict[str, dict[str, int]] = {}
        units = set()
        for k, cell in enumerate(header):
            if match := pattern.fullmatch(cell):
                places.setdefault(match["name"], {})[match["axis"].lower()] = k
                units.add((match["unit"] or "").lower())
        points = {name: [axes[a] for a in "xyz"] for name, axes in places.items() if len(axes) == 3}
        if FEWEST <= len(points) <= MOST and len(units) == 1:
            unit = units.pop().strip(" _[]()")
            return points, f"_{unit}" if unit else ""
    return None


def _rows(
    file: BinaryIO, mark: str, count: int, other: list[int], points: dict[str, list[int]], name: str
) -> Iterator[bytes]:
    row = 0
    for number, raw in enumerate(file, start=2):
        where = f"{name}, line {number}"
        line = decoded(raw, where).strip("\r\n ")
        if not line or line.startswith("#"):
            continue
        cells = [cell.strip(" \t\"'") for cell in (line.split() if mark == " " else line.split(mark))]
        if len(cells) != count:
            raise InputError(f"{where}: expected {count} fields, got {len(cells)} ({short(line)}).")
        for point, places in points.items():
            values = [cells[k].replace(",", ".") for k in places]
            for value in values:
                if value and not is_number(value.encode()):
                    raise InputError(f"{where}, point {point}: expected a number, got {short(value)}.")
            yield _line([cells[other[0]] if other else str(row), point, *values])
        row += 1


def _line(cells: list[str]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode()
