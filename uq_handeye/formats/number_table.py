"""Tables of numbers as people and programs write them: with or without a line of names, in any of the usual styles.

Fields are separated by commas, semicolons, tabs or spaces, or are in brackets, one pair per pose (Python, JSON and
NumPy lists, also over several lines); or each number follows its name (``X=1 Y=2``, ``{"x": 1, "y": 2}``).
Accepted as well are decimal commas where commas do not separate, quotes, units behind numbers (``90 deg``), comments
(lines that start with #, %, //, ! or ;), a line of units below the names, a byte order mark, line ends of any system,
and columns of text, which are left out. The meaning of the numbers is not decided here.
"""

from __future__ import annotations

import csv
import re
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np

from ..core.files.folders import numbers_in
from ..core.files.lines import NO_VALUE
from ..core.files.one_line import short
from ..core.files.table import MAX_COMMENTS, Places, Table, no_number, other_count, too_many
from ..core.limits import MAX_LINE_CHARACTERS, MAX_ROWS
from ..errors import InputError
from .columns import counts_poses, meaning_and_unit, seconds_of

# First lines of a text by which a table is recognised; those before its names or numbers may hold a title.
MAX_HEAD_LINES = 50
# Numbers that a pose of a table without names has at least.
MIN_NUMBERS = 6

# Columns that say whether a pose was measured, and their words.
SEEN_COLUMNS = ("visible", "detected", "found", "valid", "is_valid", "success", "tracked", "tracking_valid")
_YES, _NO = ("true", "1", "1.0", "yes"), ("false", "0", "0.0", "no")

NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
# A number with its unit; Fortran writes 1.0D+00, C 1.0f.
_FIELD = re.compile(
    rf"({NUMBER.replace('eE', 'eEdD')}f?|[+-]?(?:nan|inf(?:inity)?))\s*(mm|cm|m|in|deg|rad|°)?", re.IGNORECASE
)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*(?:mm|cm|m|in|deg|rad|°)?")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+\.\d+")
COMMA_NUMBER = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?|[+-]?\d+")
_NAMED = re.compile(
    rf"""(?<![\w.])["']?([A-Za-z_][\w.]*)["']?\s*(?:[:=]\s*["']?|\s)([+-]?\d+,\d+(?![\d.]|,\s*[\d.+-])|{NUMBER}|[+-]?nan\b)"""
    r"""\s*(mm\b|deg\b|rad\b|m\b|°)?""",
    re.IGNORECASE,
)
_ANY_NUMBER = re.compile(NUMBER)
_COMMENT = re.compile(r"#|%|//|!|;")
_GROUP = re.compile(r"\[([^\[\]{}()]*)\]")
_INNER = re.compile(r"[\[({]([^\[\](){}]*)[\])}]")
_JOINTS = re.compile(r"(?:joints?|angles|positions_rad|(?<![^\W_])q)\w*[\"']?\s*[:=]?\s*[\[({]*$", re.IGNORECASE)
_END_COMMENT = re.compile(r"\s(?:#|//|%).*$")
_MAP = re.compile(r"\{([^{}\[\]]*)\}")
# What the robot sensor interface of KUKA measured, beside what it commanded (RSol).
_MEASURED = re.compile(r"<RIst\b[^<>]*>")
# The first comment of COLMAP's images.txt.
_COLMAP = "two lines of data per image"
# Names in the point files of Epson, which say that a number is real.
_EPSON = {f"r{axis}": axis for axis in "XYZUVW"}
_SPACED_UNIT = re.compile(r"\s+(?=[\[(][\w°/^ -]*[\])])")


class Row(NamedTuple):
    """One line of a table: the fields as texts, or the numbers behind their names."""

    line: int
    fields: list[str]
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()  # names above the first row that mean nothing of a pose


@dataclass
class NumberTable(Table):
    """A table whose style was found out.

    Parameters
    ----------
    units : behind the numbers of each column; empty where there is none
    notes : what was found out
    unknown : names of the columns that mean nothing of a pose
    numbers : (n,) of a column that numbers the poses or names their pictures; () where there is none
    """

    units: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    numbers: tuple[int, ...] = ()


def read_number_table(
    text: str, name: str, is_header: Callable[[Sequence[str]], bool], help: str, guessed: bool = False
) -> NumberTable:
    """Return the numbers of a text.

    Parameters
    ----------
    text : the whole file, or with ``guessed`` its beginning, of which the last line is left out
    name : of the file, for messages
    is_header : whether names of columns are those of poses
    help : what the messages end with: the page or the option that helps

    Raises
    ------
    InputError
        One line that names the file, the line, and the column.
    """
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    if _COLMAP in text[:MAX_LINE_CHARACTERS]:
        text = _without_points(text)
    if guessed and "\n" in text[1:]:
        text = text[: text.rindex("\n")]
    names, rows, notes = _named_rows(text, name, is_header)
    if names is None and not rows:
        rows = list(_stacked_rows(text, is_header))
    if names is None and not rows:
        rows = _one_pose(text)
    if names is None and not rows:
        raise InputError(f"{name}: expected a table of poses, got no line of at least {MIN_NUMBERS} numbers; {help}.")
    if not rows:
        raise InputError(f"{name}: no rows below the names of the columns; expected one line per pose.")
    return _table(name, names, rows, notes, help)


def _without_points(text: str) -> str:
    """Return the pictures of COLMAP: below each stands a line of points, which may be empty."""
    lines = text.split("\n")
    first = next((k for k, line in enumerate(lines) if not line.startswith("#")), 0)
    lines[first + 1 :: 2] = [""] * len(lines[first + 1 :: 2])
    return "\n".join(lines)


def names_of(line: str) -> list[str]:
    """Return the fields of a line that may hold the names of the columns, also in a comment."""
    bare = line.replace("\r", " ").strip().lstrip("#%/!; \t")
    return _split(bare, _separator(bare))


def number_of(field: str, units: bool = True) -> float | None:
    """Return the number of a field; None for a text, and unless ``units`` for a number with its unit."""
    field = field.strip()
    match = _FIELD.fullmatch(field.replace(",", "") if _THOUSANDS.fullmatch(field) else field)
    if match is None or (match[2] and not units):
        return None
    number = match[1].lower()
    return float(number if number.endswith(("inf", "nan", "y")) else number.rstrip("f").replace("d", "e"))


def _named_rows(
    text: str, name: str, is_header: Callable[[Sequence[str]], bool]
) -> tuple[tuple[str, ...] | None, list[Row], list[str]]:
    """Return the names of the columns, if there are any, the rows, and notes."""
    names: tuple[str, ...] | None = None
    rows: list[Row] = []
    notes: list[str] = []
    title = comments = 0
    before: list[str] = []
    last: list[str] = []  # fields of the line before the numbers
    separator: str | None = None
    in_groups = False
    for number, line in _lines_of(text, name):
        content = line.strip()
        if _COMMENT.match(content) and not NO_VALUE.match(content.encode()):
            comments += 1
            if names is None and not rows and comments < MAX_COMMENTS:
                names = tuple(found) if is_header(found := names_of(content)) else None
            continue
        named = _named_row(number, content, is_header)
        if named is not None:
            rows.append(named)
            continue
        if not content.strip("|-+=: \t"):  # a rule of a table
            continue
        if not rows and _is_unit_row(content):
            names = None if names is None else _with_units(names, _split(content, _separator(content)))
            continue
        grouped = _group(content)
        if rows and in_groups and grouped is None:
            title += 1
            continue
        if not rows:
            in_groups = grouped is not None
        content = _END_COMMENT.sub("", content) if grouped is None else grouped
        if not rows:
            separator = _separator(content, len(names or ()))
        fields = _split(content, separator)
        lacking = len(names or ()) - len(fields)
        if lacking > 0 and separator and content.count(separator) == len(names or ()) - 1:  # empty at the end
            fields += [""] * lacking
        numbers = [field for field in fields if number_of(_point(field, separator)) is not None]
        if not rows and len(numbers) < (MIN_NUMBERS if names is None else 1):
            found = _split(content, _separator(content))
            if is_header(both := found) or is_header(both := _with_above(last, found)):
                names = tuple(both)
                continue
            title, last = title + 1, found
            if title > MAX_HEAD_LINES:
                break
            continue
        above, before = before, fields
        if rows and not numbers and is_header(fields):  # files put together repeat the names
            continue
        if names is None and not numbers and number < MAX_HEAD_LINES and is_header(both := _with_above(above, fields)):
            names, rows = tuple(both), []  # what came before was no pose
            continue
        if separator != "," and any("," in field for field in numbers):
            note = "numbers with decimal commas"
            notes += [note] if note not in notes else []
        rows.append(Row(number, [_point(field, separator) for field in fields]))
        if len(rows) > MAX_ROWS:
            raise too_many(f"{name}, line {number}", MAX_ROWS)
    if names is None and rows and last and len(last) == len(rows[0].fields):
        rows[0] = rows[0]._replace(unknown=tuple(last))
        notes.append(f"columns taken in their order: the names {short(', '.join(last))} say nothing of a pose")
    elif title and rows:
        notes.append(f"lines without a pose left out: {title}")
    return names, rows, notes


def _lines_of(text: str, name: str) -> Iterator[tuple[int, str]]:
    """Yield the lines with their numbers; brackets that hold one pose each are a line."""
    begin = text[: 2 * MAX_LINE_CHARACTERS].lstrip()
    if begin.startswith(("[", "(", "{", "array", "np.")) or re.match(r"[A-Za-z_]\w*\s*=\s*(np\.)?(array)?\(?\[", begin):
        maps = list(islice(_MAP.finditer(text), MAX_ROWS + 1))
        groups = maps or list(islice(_GROUP.finditer(text), MAX_ROWS + 1))
        if groups and len(_ANY_NUMBER.findall(groups[0][1][:MAX_LINE_CHARACTERS])) >= MIN_NUMBERS:
            if len(groups) == 1 and re.search(r"[;\n]", groups[0][1].strip()):  # a matrix of MATLAB
                inner = "\n" * text.count("\n", 0, groups[0].start()) + groups[0][1].replace(";", "\n")
                yield from ((k, line) for k, line in enumerate(inner.split("\n"), start=1) if line.strip())
                return
            ends = [match.start() for match in re.finditer("\n", text)]
            for match in groups:
                if _JOINTS.search(text[max(0, match.start() - 40) : match.start()]):
                    continue
                if match.end() - match.start() > MAX_LINE_CHARACTERS:
                    raise InputError(f"{name}: expected a pose in each pair of brackets, got {match.end()} characters.")
                yield bisect_right(ends, match.start()) + 1, " ".join(match[1].split("\n"))
            return
    start = 0
    number = 0
    while start <= len(text):
        number += 1
        end = text.find("\n", start)
        end = len(text) if end < 0 else end
        if end - start > MAX_LINE_CHARACTERS:
            raise InputError(
                f"{name}, line {number}: expected lines of at most {MAX_LINE_CHARACTERS} characters, got a longer "
                "one; is it a table in text?"
            )
        if line := text[start:end].strip():
            yield number, line
        start = end + 1


def _named_row(number: int, content: str, is_header: Callable[[Sequence[str]], bool]) -> Row | None:
    """Return a line in which each number stands behind its name."""
    measured = _MEASURED.search(content)
    pairs = _named_numbers(content if measured is None else measured[0])
    if len(pairs) < MIN_NUMBERS or not is_header(names := [pair[0] for pair in pairs]):
        return None
    return Row(number, [pair[1] for pair in pairs], tuple(names), tuple(pair[2].lower() for pair in pairs))


def _named_numbers(content: str) -> list[tuple[str, str, str]]:
    """Return name, number and unit of each number behind its name; commas are decimal where there is no point."""
    found = _NAMED.findall(content)
    decimal = not any("." in value for _, value, _ in found)
    return [
        (name, value.replace(",", ".") if decimal else value.partition(",")[0], unit) for name, value, unit in found
    ]


def _stacked_rows(text: str, is_header: Callable[[Sequence[str]], bool]) -> Iterator[Row]:
    """Yield poses whose numbers stand below each other, each behind its name."""
    pairs: dict[str, tuple[str, str]] = {}
    begin = 1
    for number, line in enumerate(text.split("\n"), start=1):
        for name, value, unit in _named_numbers(line[:MAX_LINE_CHARACTERS]):
            if name in pairs:
                if is_header(_row(begin, pairs).names):
                    yield _row(begin, pairs)
                pairs, begin = {}, number
            pairs[name] = (value, unit.lower())
    if is_header(_row(begin, pairs).names):
        yield _row(begin, pairs)


def _one_pose(text: str) -> list[Row]:
    """Return six or seven numbers below each other, one per line, as one pose."""
    lines = [line.strip(" \t,;") for line in text.split("\n", 40) if line.strip() and not _COMMENT.match(line.strip())]
    whole = len(lines) in (MIN_NUMBERS, MIN_NUMBERS + 1) and all(number_of(line) is not None for line in lines)
    return [Row(1, lines)] if whole else []


def _row(number: int, pairs: dict[str, tuple[str, str]]) -> Row:
    pairs = {axis: pairs[name] for name, axis in _EPSON.items()} if _EPSON.keys() <= pairs.keys() else pairs
    return Row(number, [value for value, _ in pairs.values()], tuple(pairs), tuple(unit for _, unit in pairs.values()))


def _group(content: str) -> str | None:
    """Return the numbers of a pose that stand in brackets in a line, as in ``p1 = posx(1, 2, 3, 4, 5, 6)``."""
    for match in _INNER.finditer(content):
        inner = match[1].strip()
        fields = re.split(r"\s*[,;]\s*|\s+", inner)
        numbers = len(fields) >= MIN_NUMBERS and all(number_of(field) is not None for field in fields[:MIN_NUMBERS])
        if numbers and not _JOINTS.search(content[max(0, match.start() - 40) : match.start()]):
            return inner
    return None


def _separator(content: str, columns: int = 0) -> str | None:
    """Return what separates the fields of a line; None for spaces."""
    content = content.rstrip("; \t,")
    bare = _bare(content)
    for mark in "|;":
        if mark in bare:
            return mark
    if "\t" in bare.strip() and len(bare.split("\t")) > len(bare.replace("\t", " ").split(", ")):
        return "\t"
    if "," in bare:
        words = bare.split()
        if len(words) >= MIN_NUMBERS and len(words) >= columns and all(COMMA_NUMBER.fullmatch(word) for word in words):
            return None
        return ","
    return None


def _bare(content: str) -> str:
    """Return a line without the brackets, the quotes and the name around its fields."""
    if '"' in content:
        return content
    match = re.fullmatch(r"[^\[\](){}]*?[\[({](.*)[\])}]\W*", content)
    return (
        match[1] if match is not None and number_of(match[1].replace(";", ",").split(",")[0]) is not None else content
    )


def _split(content: str, separator: str | None) -> list[str]:
    """Return the fields of a line."""
    content = _bare(content.rstrip("; \t" if separator != "\t" else "; "))
    content = content.strip("| ") if separator == "|" else content
    if separator is None:
        return [field.strip("\"',") for field in _SPACED_UNIT.sub("", " ".join(content.split())).split()]
    fields = (
        next(csv.reader([content], delimiter=separator, skipinitialspace=True))
        if '"' in content
        else (content.split(separator))
    )
    fields = [field.strip(" \t'\"") for field in fields]
    while len(fields) > 1 and not fields[-1]:
        fields.pop()
    if fields and ":" in fields[0] and number_of(fields[0]) is None and seconds_of(fields[0]) is None:  # "pose 1: 0.1"
        label, _, first = fields[0].rpartition(":")
        if number_of(first) is not None:
            fields[:1] = [label, first.strip()]
    return fields


def _point(field: str, separator: str | None) -> str:
    """Return a number with a decimal comma with a point."""
    return field.replace(",", ".") if "," in field and _DECIMAL_COMMA.fullmatch(field) else field


def _is_unit_row(content: str) -> bool:
    """Return whether a line holds units only: [mm];[mm];[mm];[deg];..."""
    words = [word.strip("[]()\"' ") for word in re.split(r"[,;\t]|\s{1,}", content)]
    known = {"mm", "cm", "m", "in", "deg", "rad", "°", "s", "ms", "ns", "-", "", "degree", "degrees"}
    return len(set(words) & {"mm", "cm", "m", "deg", "rad", "°"}) > 0 and set(words) <= known


def _with_above(above: Sequence[str], names: Sequence[str]) -> list[str]:
    """Return names with those of the line above: Rotation, Position above X, Y, Z, W, X, Y, Z of Motive."""
    if len(above) != len(names):
        return list(names)
    return [f"{one}_{name}" if one else name for one, name in zip(above, names, strict=True)]


def _with_units(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    if len(names) != len(units):
        return tuple(names)
    bare = [unit.strip("[]() ") for unit in units]
    return tuple(f"{one} [{unit}]" if unit not in ("", "-") else one for one, unit in zip(names, bare, strict=True))


def _times(rows: list[Row], count: int) -> tuple[int, list[float]] | None:
    """Return the column of dates or times of day that grow, and its seconds; None where there is none."""
    for k in range(count):
        if seconds_of(rows[0].fields[k]) is None or number_of(rows[0].fields[k]) is not None:
            continue
        seconds = [seconds_of(row.fields[k]) for row in rows]
        found = [time for time in seconds if time is not None]
        if len(found) == len(rows) and all(a < b for a, b in pairwise(found)):
            return k, found
    return None


def _not_seen(names: Sequence[str], rows: list[Row]) -> set[int]:
    """Return the rows of which a column (``visible``, ``detected``) says that no pose was measured; never all."""
    for k, name in enumerate(names):
        said = [row.fields[k].strip().lower() for row in rows] if name.strip().lower() in SEEN_COLUMNS else []
        left = {number for number, word in enumerate(said) if word in _NO}
        if said and len(left) < len(rows) and all(word in _NO or word in _YES for word in said):
            return left
    return set()


def _table(name: str, names: tuple[str, ...] | None, rows: list[Row], notes: list[str], help: str) -> NumberTable:
    """Return the columns of numbers, each row with as many fields."""
    first = rows[0]
    if first.names:
        names = first.names
        rows = [row for row in rows if row.names]
        for row in rows:
            if row.names != names:
                raise InputError(
                    f"{name}, line {row.line}: expected the numbers {', '.join(names)} as in line {first.line}, got "
                    f"{short(', '.join(row.names))}; {help}."
                )
    count = len(first.fields) if names is None else len(names)
    what = "the columns of the first line" if names is None else "the names"
    for row in rows:
        if len(row.fields) != count or row.names != first.names:
            how = f"{count} fields as {what} say"
            raise other_count(f"{name}, line {row.line}", how, len(row.fields), ", ".join(row.fields), f"; {help}")
    if names is not None and (unseen := _not_seen(names, rows)):
        rows = [row for k, row in enumerate(rows) if k not in unseen]
        first = rows[0]
        notes.append(f"rows in which nothing was seen left out: {len(unseen)}")
    if (times := _times(rows, count)) is not None:
        k, seconds = times
        rows = [
            row._replace(fields=[repr(time) if j == k else field for j, field in enumerate(row.fields)])
            for row, time in zip(rows, seconds, strict=True)
        ]
        if names is not None and meaning_and_unit(names[k])[0] != "timestamp":
            names = tuple("timestamp" if j == k else one for j, one in enumerate(names))
        first = rows[0]
        notes.append(f"dates and times of column {k + 1} read as seconds")
    columns = [k for k in range(count) if number_of(first.fields[k]) is not None]
    values = np.empty((len(rows), len(columns)))
    for i, row in enumerate(rows):
        for j, k in enumerate(columns):
            value = number_of(row.fields[k])
            if value is None:
                column = str(k + 1) if names is None else names[k]
                raise no_number(f"{name}, line {row.line}", column, row.fields[k])
            values[i, j] = value
    between = [k for k in range(count) if k not in columns and columns and columns[0] < k < columns[-1]]
    if names is None and between:
        raise InputError(
            f"{name}, line {first.line}: expected numbers, got {short(first.fields[between[0]])} between them; {help}."
        )
    others = [k for k in range(count) if k not in columns]
    if others:
        left = [str(k + 1) if names is None else names[k] for k in others]
        notes.append(f"not used: the columns of text {short(', '.join(left))}")
    matches = [_FIELD.fullmatch(first.fields[k].strip()) for k in columns]
    units = first.units or tuple("" if match is None else (match[2] or "").lower() for match in matches)
    lines = np.array([row.line for row in rows], dtype=np.int64)
    counting = next((k for k, one in enumerate(names or ()) if counts_poses(one)), None)
    numbers = () if counting is None else numbers_in(row.fields[counting] for row in rows)
    texts = [tuple(row.fields[k] for k in others) for row in rows]
    table = (name, list(names or ()), Places(columns, others), values, lines, texts)
    return NumberTable(*table, units=units, notes=tuple(notes), unknown=first.unknown, numbers=numbers)
