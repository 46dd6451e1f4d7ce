"""Matrices in tables whose columns are named by row and column: ``r11,r12,...,tx,ty,tz``, ``m00 ... m33``, ``T[0][3]``.

A name ends with two indices from 0 or from 1, with brackets, points or underscores between them or none, or with one
index of all 16 or 12 numbers (``O_T_EE_0 ... O_T_EE_15``, ``field.O_T_EE0``). A 3x3 needs the columns of a translation
(`..columns`), or t1, t2, t3. Other columns are not used, but for a time.

Matrices in text: a line per pose, or lines of four numbers, as people, NumPy, MATLAB, Eigen and KITTI write them.

One line: 16 numbers of a 4x4, 12 of its first three rows (KITTI odometry: devkit ``readme.txt``), or 9 + 3 of rotation
and translation, also with a row number or a time in front, with names of columns above (`columns`) or without. Several
lines: 4 lines of 4 numbers, 3 lines of 4, or any other division, such as that of ``print`` in Python. Brackets, commas,
semicolons, names (``T1 =``), labels and comments (``#``, ``%``, ``//``) do not matter. Where the numbers are those of
the transposed matrix, it is told by their places (`layout`).

Lines of a text as numbers: without comments, brackets, names and the words of NumPy, MATLAB and C++ around them.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.files.one_line import short
from ...core.files.table import name_and_unit
from ...core.files.trees import is_json
from ...core.formatting.units import LENGTH_UNITS
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..columns import SECONDS, meaning_and_unit
from ..contents import Contents, Reading, matrices_side
from ..number_table import COMMA_NUMBER, names_of, number_of, read_number_table
from .arrays import BOTH, COUNTS, MOST_BEFORE, Found, fitting, found_in, with_last_row

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
    elif (found := found_in(matrix)) is not None:
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


_COMMENT = re.compile(r"(#|//|%|--).*")
# Bounded, so that long lines take no longer than they are.
_DTYPE = re.compile(r",?\s{0,3}(dtype|device|requires_grad)\s{0,3}=\s{0,3}[\w.:']{1,40}")
_CALL = re.compile(r"\b[A-Za-z_][\w.]{0,40}\s{0,3}(?=\()")
_LABEL = re.compile(r"[:\[({]")
# MATLAB prints one factor for all numbers of a matrix.
_FACTOR = re.compile(r"^\s*\d(\.\d+)?e[+-]?\d+\s*\*\s*$", re.IGNORECASE)
_MARKS = str.maketrans("[](){};|\t\"'", " " * 11)
# Words in front of the numbers of a line: a file, a name.
MOST_WORDS = 3
# Numbers of a line that holds a whole matrix.
LONG = 12


class NumberLine(NamedTuple):
    """Numbers of a line, and its number in the file."""

    line: int
    values: tuple[float, ...]


class NotNumbersError(InputError):
    """A line that holds something else; ``printed_once``: a factor that MATLAB printed once for all numbers."""

    printed_once = False


def number_lines(text: str, name: str) -> Iterator[NumberLine]:
    """The lines that hold numbers; lines of words only are names, and left out.

    Raises `NotNumbersError` for anything else between numbers, and for a factor that MATLAB printed before them.
    """
    commas = _decimal_commas(text)
    for line, raw in enumerate(text.splitlines(), start=1):
        where = f"{name}, line {line}"
        if _FACTOR.match(raw):
            factor = NotNumbersError(
                f"{where}: the numbers are printed with a common factor ({raw.strip()}), which leaves too few digits "
                "for a rotation; write them with more (MATLAB: format long g, or writematrix)."
            )
            factor.printed_once = True
            raise factor
        content = _content(raw)
        if not content:
            continue
        if commas:
            content = content.replace(", ", " ").rstrip(",").replace(",", ".")
        words = content.replace(",", " ").split()
        values = tuple(number_of(word, units=False) for word in words)
        known = [value is not None for value in values]
        if not any(known):
            continue
        first = known.index(True)
        if first and len(known) - first < 3:  # "Pose 3", "Columns 1 through 4"
            continue
        last = len(known) - known[::-1].index(True)
        if last - first >= LONG and len(known) - last <= MOST_WORDS:  # the name of a picture behind the numbers
            words, known, values = words[:last], known[:last], values[:last]
        if first > MOST_WORDS or not all(known[first:]):
            wrong = words[first + known[first:].index(False)] if not all(known[first:]) else words[0]
            raise NotNumbersError(f"{where}: expected numbers of a matrix, got {short(wrong)}.")
        yield NumberLine(line, tuple(value for value in values[first:] if value is not None))


def _content(raw: str) -> str:
    """A line without comments, names and brackets."""
    content = _DTYPE.sub("", _COMMENT.sub("", raw.replace("\u2212", "-").replace("...", " ")))
    if "=" in content:
        content = content[content.rindex("=") + 1 :]
    mark = _LABEL.search(content)
    if mark is not None and mark[0] == ":" and re.search("[A-Za-z]", content[: mark.start()]):
        content = content[mark.end() :]
    content = _CALL.sub("", content)
    return content.translate(_MARKS).strip()


def _decimal_commas(text: str) -> bool:
    """Return whether the numbers have decimal commas: no point, and nothing else separates as many digits."""
    for raw in text[:65536].splitlines():
        content = _content(raw)
        if "," not in content:
            continue
        if "." in content or ", " in content:
            return False
        words = content.split()
        if len(words) > 1 and all(COMMA_NUMBER.fullmatch(word) for word in words):
            return True
    return False


_PER_LINE = tuple(count + before for count in COUNTS for before in range(MOST_BEFORE + 1))
_YAML = re.compile(r"^\s*(- |---\s*$|%YAML)|^\s*\{\s*([\"'A-Za-z]|$)")
# An entry of YAML that holds a list, or an item of a list.
_ENTRY = re.compile(r"^\s*(- )*[\"']?\w+[\"']?\s*:\s*([\[{][^\]}\n]*,|\n\s*- )", re.MULTILINE)
# Decimals that are too few for a rotation.
FEW = 3
HELP = "docs/formats.md, Matrices in text"
# Of 12 or 16 numbers, those of a robtarget or a jointtarget that say "no external axis".
_NONE = 1e8
# Characters that are seen of a longer text.
_CUT = 60000


def is_matrix_text(head: str) -> bool:
    """Return whether a text is of numbers of matrices, and of no other format."""
    if head.lstrip()[:1] == "<" or is_tree(head):
        return False
    if names_matrices(head):
        return True
    cut = len(head) >= _CUT
    lines: list[NumberLine] = []
    try:
        for line in number_lines(head[: head.rfind("\n")] if cut and "\n" in head else head, ""):
            lines.append(line)
    except NotNumbersError as error:
        return error.printed_once or _begins(lines)
    lines = _without_names(lines)
    if not lines:
        return False
    counts = {len(line.values) for line in lines}
    if len(counts) == 1:
        (count,) = counts
        table = np.array([line.values for line in lines])
        if count in COUNTS:
            return bool(np.abs(table).max() < _NONE) or not np.isfinite(table).all()
        if count in _PER_LINE:
            return fitting(table)
        if count == 4 and len(lines) >= 3:
            return True
        if count > 3:  # all matrices on one line, or poses of other forms
            return any(count >= 2 * one and fitting(table[:1, :one]) for one in COUNTS)
    blocks = _blocks(lines)
    return (blocks is not None and fitting(blocks[0])) or _begins(lines[:-1])


def _begins(lines: Sequence[NumberLine]) -> bool:
    """Return whether a text that is damaged further on begins with matrices."""
    if not lines:
        return False
    if len(lines[0].values) in _PER_LINE:
        return fitting(np.array([lines[0].values]))
    rows = [line.values for line in lines[:5] if len(line.values) == 4][:4]
    flat = np.array(rows).reshape(1, -1)
    return len(lines[0].values) <= 4 and any(flat.shape[1] >= count and fitting(flat[:, :count]) for count in COUNTS)


def _without_names(lines: Sequence[NumberLine]) -> list[NumberLine]:
    """The lines without numbers of columns, as pandas writes them above."""
    counted = len(lines) > 1 and len(lines[0].values) > 2 and lines[0].values == tuple(range(len(lines[0].values)))
    return list(lines[1:] if counted else lines)


def is_tree(head: str) -> bool:
    """Return whether a text is JSON or YAML."""
    first = next((line for line in head.split("\n", 200) if line.strip() and not line.lstrip().startswith("#")), "")
    if _YAML.match(first) or _ENTRY.search(head):
        return True
    return head.lstrip().startswith("[") and is_json(head)


def read_matrix_text(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    if names_matrices(text):
        return read_columns(text, name)
    lines = list(number_lines(text, name))
    if not lines:
        raise InputError(f"{name}: expected numbers of matrices, got none ({HELP}).")
    lines = _without_names(lines)
    counts = {len(line.values) for line in lines}
    if len(counts) == 1 and (count := next(iter(counts))) in _PER_LINE:
        table = np.array([line.values for line in lines])
        numbers = np.array([line.line for line in lines])
        found = found_in(table)
        if found is None:
            raise _no_layout(table[0], f"{name}, line {lines[0].line}", count)
        return contents_of(found, name, numbers, "line")
    if (blocks := _blocks(lines)) is None:
        raise _uneven(lines, name)
    table, numbers, note = blocks
    found = found_in(table)
    if found is None:
        raise _no_layout(table[0], f"{name}, line {numbers[0]}", table.shape[1])
    return contents_of(found, name, numbers, "the matrix of line", note)


def contents_of(found: Found, name: str, rows: NDArray[np.int64] | None, counted: str, *more: str) -> Contents:
    """The poses that were found, with times where numbers in front of the matrices are some."""
    notes = [found.note, *(note for note in more if note)]
    times, said = times_of(found.others)
    try:
        side = matrices_side(name, found.T, rows=rows, counted=counted, timestamps=times, readings=found.readings)
    except InputError as error:
        decimals = _decimals(found.T[:, :3, :3])
        hint = f"the rotations have {decimals} decimals, and need 6 or more; " if decimals <= FEW else ""
        raise InputError(f"{str(error).rstrip('.')} ({hint}{HELP}).") from error
    return Contents(only=side, notes=(*notes, *said))


def _decimals(R: Array) -> int:
    """Decimals of rotations, up to one more than `FEW`."""
    return next((k for k in range(FEW + 1) if np.abs(np.round(R, k) - R).max() < 1e-9), FEW + 1)


def times_of(others: Array) -> tuple[NDArray[np.float64] | None, list[str]]:
    """Times (s) among the numbers beside the matrices (n, k), and what is to be said of them."""
    said: list[str] = []
    for column in others.T:
        if np.isfinite(column).all() and (column == np.round(column)).all() and (np.diff(column) == 1).all():
            said.append("a number in each row counts the poses")
            continue
        if not np.isfinite(column).all() or (np.diff(column) <= 0).any():
            said.append("the numbers beside the matrices are not used")
            continue
        unit = next((unit for limit, unit in _STAMPS if abs(column[0]) > limit), None)
        said.append("timestamps beside the matrices" + ("" if unit is None else f", in {unit[0]}"))
        return column * (1.0 if unit is None else unit[1]), said
    return None, said


# Times since 1970 by their size.
_STAMPS = ((1e17, ("ns", 1e-9)), (1e14, ("us", 1e-6)), (1e11, ("ms", 1e-3)))


def _blocks(lines: Sequence[NumberLine]) -> tuple[Array, NDArray[np.int64], str] | None:
    """Numbers (n, 16) or (n, 12) of matrices over several lines, the line where each begins, what is to be said."""
    fours = [line for line in lines if len(line.values) == 4]
    few = [line for line in lines if len(line.values) < 4]
    note = ""
    if fours and few and len(fours) + len(few) == len(lines):
        note = "the numbers between the matrices are not used"
        for rows in (4, 3):
            groups = _groups(lines, rows)
            if groups is not None and fitting(groups[0]):
                return *groups, note
    flat = np.concatenate([line.values for line in lines])
    owners = np.repeat([line.line for line in lines], [len(line.values) for line in lines])
    first = None
    for count in COUNTS:
        if len(flat) % count == 0:
            table = flat.reshape(-1, count)
            begins = owners[::count]
            if fitting(table):
                return table, begins, ""
            first = first or ((table, begins, "") if {len(line.values) for line in lines} == {4} else None)
    return first


def _groups(lines: Sequence[NumberLine], rows: int) -> tuple[Array, NDArray[np.int64]] | None:
    """Matrices of ``rows`` lines of four numbers, with lines of fewer numbers before them only."""
    matrices: list[list[float]] = []
    begins: list[int] = []
    for line in lines:
        whole = not matrices or len(matrices[-1]) == 4 * rows
        if len(line.values) < 4:
            if not whole:
                return None
            continue
        if whole:
            matrices.append([])
            begins.append(line.line)
        matrices[-1] += line.values
    if not matrices or len(matrices[-1]) != 4 * rows:
        return None
    return np.array(matrices), np.array(begins)


def _no_layout(row: Array, where: str, count: int) -> InputError:
    numbers = ", ".join(f"{value:g}" for value in row[-4:])
    if count - 16 in range(MOST_BEFORE + 1):
        return InputError(
            f"{where}: expected a matrix 4x4 whose last row (or, column by column, every fourth number) is 0, 0, 0, 1; "
            f"the numbers end with {numbers} ({HELP})."
        )
    return InputError(
        f"{where}: expected 12 numbers of a matrix 3x4, or of a rotation and a translation, got no rotation among "
        f"them; the numbers end with {numbers}. Are digits lost, or is it another table ({HELP})?"
    )


def _uneven(lines: Sequence[NumberLine], name: str) -> InputError:
    """Return the error of lines that do not divide into matrices."""
    counts = [len(line.values) for line in lines]
    usual = max(set(counts), key=counts.count)
    if usual == 4 and set(counts) == {4}:
        over = len(lines) % 4
        return InputError(
            f"{name}: expected 4 lines of 4 numbers for each matrix (or 3), got {len(lines)} lines; the last one "
            f"has {over}, line {lines[-over].line} and after. Is the file cut off ({HELP})?"
        )
    odd = next((line for line in lines if len(line.values) != usual), lines[-1])
    if usual in (*_PER_LINE, 4):
        return InputError(
            f"{name}, line {odd.line}: expected {usual} numbers as in the other lines, got {len(odd.values)}. Is the "
            f"file cut off ({HELP})?"
        )
    return InputError(
        f"{name}, line {odd.line}: expected matrices of 16 or 12 numbers, on one line or in rows of 4, got "
        f"{len(odd.values)} numbers ({HELP})."
    )
