"""Poses whose position and rotation are two lists, each behind its own name.

In lines, ``Position: [0.1, 0.2, 0.3]`` and ``Orientation (quaternion): [0, 0, 0, 1]``, as people print them; or in
cells of a table, ``"[0.1 0.2 0.3]","[1.2 0.1 0.3]"`` below ``rvec,tvec``, as pandas writes arrays. The names give the
form of the rotation; where they do not, there are several readings (`records`).
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from typing import TypeAlias

from ...core.limits import MAX_LINE_CHARACTERS, MAX_ROWS
from ...errors import InputError
from ..contents import Contents
from ..number_table import MAX_HEAD_LINES, NUMBER
from .records import records_side
from .tables import HELP

# Parts of a pose by their names: numbers, or rows of a matrix.
Entry: TypeAlias = dict[str, list[float] | list[list[float]]]
_NUMBERS = re.compile(rf"[\[(\s]*{NUMBER}(?:[\s,;]+{NUMBER}){{2,15}}[\])\s]*,?")
_LABEL = r"(?<![\w.])([A-Za-z][\w .-]{0,60}(?:\([^()]{0,60}\))?)"
_PART = re.compile(rf"""{_LABEL}\s*[:=]\s*[\[("]?\s*({NUMBER}(?:[\s,;]+{NUMBER}){{2,8}})\s*[\])"]?""")
_ANY = re.compile(NUMBER)
_COMMA = r"[+-]?\d+,\d+"  # decimal commas, with blanks or semicolons between the numbers
_COMMA_PART = re.compile(
    rf"""{_LABEL}\s*[:=]\s*[\[("]?\s*({_COMMA}(?:(?:\s*;\s*|\s+){_COMMA}){{2,8}})\s*(?:[\])"]|$)"""
)
_LABELLED_POSITIONS = {"position", "pos", "translation", "trans", "tvec", "xyz", "p", "t"}
# Words of a rotation, and the name under which `records` takes its numbers.
_ROTATIONS = {
    **dict.fromkeys(("rvec", "rotvec"), "rotvec"),
    **dict.fromkeys(("rpy", "roll"), "rpy"),
    **dict.fromkeys(("quaternion", "quat", "orientation", "orient", "rotation", "rot", "euler", "q"), "orientation"),
}  # fmt: skip


def is_labelled(head: str) -> bool:
    """Return whether a text holds positions and rotations as lists behind their names."""
    if head.lstrip().startswith("{") or (head.lstrip().startswith("<") and "<origin" not in head):  # of URDF
        return False
    try:
        first = next(_entries(head, MAX_HEAD_LINES), None)
    except (InputError, csv.Error):
        return False
    return first is not None and len(first) == 2


def read_labelled(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    try:
        values = list(_entries(text, None))
    except csv.Error as error:
        raise InputError(f"{name}: not a table: {error}; {HELP}.") from error
    if values and len(values[-1]) < 2:
        raise InputError(f"{name}: expected a position and a rotation of each pose, the last has one of them; {HELP}.")
    side = records_side(values, name)
    if side is None:
        raise InputError(f"{name}: expected the same names and numbers for each pose, got several; {HELP}.")
    return Contents(only=side)


def _entries(text: str, most: int | None) -> Iterator[Entry]:
    """Yield position and rotation of each pose, of the first lines only if ``most`` is given."""
    if most is not None:
        text = "\n".join(text.split("\n", 3 * most)[: 3 * most])
    text = re.sub(r"\]\s*\n\s*\[", " ", text).replace("[[", "[").replace("]]", "]") if '"' not in text else text
    cells = '"' in text.partition("\n")[2][:MAX_LINE_CHARACTERS] and "<origin" not in text
    yield from _of_cells(text) if cells else _of_lines(text)


def _of_lines(text: str) -> Iterator[Entry]:
    entry: Entry = {}
    for line in text.split("\n"):
        if len(line) > MAX_LINE_CHARACTERS:
            continue
        parts = [(label, numbers.replace(",", ".")) for label, numbers in _COMMA_PART.findall(line)]
        for label, numbers in parts or _PART.findall(line):
            found = _part(label, list(map(float, _ANY.findall(numbers))))
            if found is None:
                continue
            if found[0] in entry or (len(entry) == 2 and found[0] != "position"):
                yield entry
                entry = {}
            entry[found[0]] = found[1]
    if entry:
        yield entry


def _of_cells(text: str) -> Iterator[Entry]:
    first = text.partition("\n")[0]
    separator = max(",;\t", key=first.count)
    rows = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    header = next(rows, [])
    for k, row in enumerate(rows):
        if k > MAX_ROWS:
            raise InputError(f"Expected at most {MAX_ROWS} rows.")
        entry: Entry = {}
        for label, cell in zip(header, row, strict=False):
            if cell.lstrip().startswith(("[", "(")) and _NUMBERS.fullmatch(bare := _without_inner(cell)):
                found = _part(label, list(map(float, _ANY.findall(bare))))
                if found is not None:
                    entry[found[0]] = found[1]
        if entry:
            yield entry


def _without_inner(cell: str) -> str:
    """Return a list of lists as one list."""
    return re.sub(r"[\[\]()\n]", " ", cell[: 20 * MAX_LINE_CHARACTERS])


def _part(label: str, numbers: list[float]) -> tuple[str, list[float] | list[list[float]]] | None:
    """Return name and value of a part of a pose."""
    words = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label).lower())
    if len(numbers) == 16:
        return "matrix", [numbers[k : k + 4] for k in (0, 4, 8, 12)]
    if len(numbers) == 9:
        return ("R", [numbers[k : k + 3] for k in (0, 3, 6)]) if {*words} & {*_ROTATIONS, "r"} else None
    if len(numbers) == 3 and {*words} & _LABELLED_POSITIONS:
        return "position", numbers
    kind = next((_ROTATIONS[word] for word in words if word in _ROTATIONS), None)
    if kind is None or len(numbers) not in ((3, 4) if kind == "orientation" else (3,)):
        return None
    return kind, numbers
