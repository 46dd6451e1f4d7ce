"""The reader of tables in text: CSV, TSV, semicolons or blanks, one row per line under a line of names.

Every table of the toolkit whose columns are known by their names is read here: poses, joints, points, corners, boards,
matrices by their elements. A `Schema` declares the columns; the reader handles what all have in common: separators,
quotes, decimal commas where commas do not separate, blank lines and comments (``#``), names in a comment, a byte order
mark, line ends of any system and bounded size. Its errors are one line that names the file, the line as an editor
numbers it, and the column.

A new column of a file is an entry in its schema. Tables without known names, as people and controllers write them, are
parsed by `formats.number_table`.
"""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..geometry.se3 import Array
from ..limits import MAX_ROWS
from .lines import NO_VALUE, decoded, is_number, lines_of
from .one_line import short

MARKS = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "spaces"}
# Comments that are kept.
MAX_COMMENTS = 200

_UNIT = r"(.+?)(?:\s*[\[(]\s*([^\])]*?)\s*[\])]|[{}]([^\W_]{{1,7}}|[°-]))"


class Places(NamedTuple):
    """Columns of a table that its schema asks for.

    Parameters
    ----------
    numbers : columns of numbers, in the order in which `Table.values` has them
    texts : columns of text, in the order in which each of `Table.texts` has them
    names : of all columns, where the line is the first row of a table that names none; None: it is the line of names
    """

    numbers: Sequence[int]
    texts: Sequence[int] = ()
    names: Sequence[str] | None = None


@dataclass(frozen=True)
class Schema:
    """Meaning of the columns of a table, and how its lines are written.

    Parameters
    ----------
    expected : what a file should begin with, for messages: "the header x,y,z"
    row : what a line holds, for messages: "pose", "corner"
    places : finds the columns by their names; also given the line as it stands there and its place (``robot.csv, line
        1``). Raises `InputError` for names that are not those of the table.
    named : whether names that stand in a comment are those of the table; None: names in comments are not looked for.
        They hold unless a line of names follows.
    marks : what may separate fields; the first that the line of names holds does, else the first of all. A blank, which
        comes last, stands for any blanks.
    decimal_commas : whether numbers may have decimal commas where commas do not separate
    missing : texts, in small letters, that stand for a number that is not known; they become NaN
    needs : what to do about a line of another number of fields, by that number
    quotes : whether marks and blanks between quotation marks belong to the field
    """

    expected: str
    row: str
    places: Callable[[list[str], str, str], Places]
    named: Callable[[list[str]], bool] | None = None
    marks: str = ",;\t"
    decimal_commas: bool = True
    missing: Collection[str] = ()
    needs: Callable[[int], str] = field(default=lambda count: "")
    quotes: bool = False


@dataclass
class Table:
    """Content of a table.

    Parameters
    ----------
    name : the file, for messages
    names : of all columns, as they stand in the file; empty: it names none
    places : of the columns that are used
    values : (n, k) numbers, finite or not
    lines : (n,) line number of each row
    texts : per row, the columns of text
    comments : lines that start with #, without it; at most `MAX_COMMENTS`
    mark : what separates the fields
    decimal_commas : whether numbers were written with them
    """

    name: str
    names: list[str]
    places: Places
    values: Array
    lines: NDArray[np.int64]
    texts: list[tuple[str, ...]] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)
    mark: str = ","
    decimal_commas: bool = False

    @property
    def headings(self) -> tuple[str, ...]:
        """Names of the columns of `values`; none where the file names none."""
        return tuple(self.names[k] for k in self.places.numbers) if self.names else ()

    def at(self, row: int) -> str:
        """Return a row in words: ``robot.csv, line 12``."""
        return f"{self.name}, line {self.lines[row]}"

    def column(self, k: int) -> str:
        """Return the name of column k of `values`."""
        return self.names[self.places.numbers[k]]

    def require_finite(self, help: str = "") -> None:
        """Raise `InputError` for the first number that is not finite."""
        if not (finite := np.isfinite(self.values)).all():
            row, k = divmod(int(np.argmin(finite)), self.values.shape[1])
            raise InputError(
                f"{self.at(row)}, column {self.column(k)}: expected a finite number, got {self.values[row, k]}{help}."
            )


def read_table(file: BinaryIO, name: str, schema: Schema) -> Table:
    """Return the rows of a file.

    Memory grows with the numbers and texts that are used only.

    Parameters
    ----------
    file : opened, at its beginning
    name : of the file, for messages
    schema : what its columns are

    Raises
    ------
    InputError
        One line that names the file, the line and the column: other names of columns, another number of fields, a field
        that is no number, lines or rows beyond `MAX_LINE_CHARACTERS` and `MAX_ROWS`, no header, no rows.
    """
    reader = _Reader(name, schema)
    values, numbers = array("d"), array("q")
    for number, line in enumerate(lines_of(file, name), start=1):
        text = line.strip(b"\r\n ") if " " not in schema.marks else line.strip()
        if not text.strip():
            continue
        where = f"{name}, line {number}"
        if text.lstrip().startswith(b"#") and not NO_VALUE.match(text.lstrip()):
            reader.comment(text.strip(), where, begun=bool(numbers))
            continue
        if (fields := reader.fields(text, where)) is None:
            continue
        try:
            row = list(map(float, fields))
        except ValueError:
            reader.explain(fields, where)
            raise
        if b"_" in text:  # float() takes 1_000 for a number
            reader.explain(fields, where)
        if len(numbers) == MAX_ROWS:
            raise too_many(where, MAX_ROWS)
        values.extend(row)
        numbers.append(number)
    if reader.places is None:
        raise InputError(f"{name}: the file is empty; expected {schema.expected} and one line per {schema.row}.")
    if not numbers:
        raise InputError(f"{name}: no rows after the header; expected one line per {schema.row}.")
    return Table(
        name,
        reader.names,
        reader.places,
        np.frombuffer(values).reshape(len(numbers), -1),
        np.frombuffer(numbers, dtype=np.int64),
        reader.texts,
        reader.comments,
        reader.mark,
        reader.decimal_commas,
    )


def name_and_unit(name: str, known: Collection[str], marks: str = "_") -> tuple[str, str | None]:
    """Return a name without the unit behind it, and the unit: ``x [mm]``, ``x_mm``; None where there is none.

    In brackets any word is a unit, whether known or not, also none at all; behind one of ``marks`` only one that is
    ``known``.

    >>> name_and_unit("x [mm]", ["mm"]), name_and_unit("x_mm", ["mm"]), name_and_unit("joint_a", ["mm"])
    (('x', 'mm'), ('x', 'mm'), ('joint_a', None))
    """
    split = re.fullmatch(_UNIT.format(marks), name) if len(name) <= 400 else None
    if split is None or (split[2] is None and split[3] not in known):
        return name, None
    return split[1], split[2] if split[2] is not None else split[3]


def split_names(line: str, marks: str = ",;\t") -> tuple[list[str], str]:
    """Return the names of a line, without quotes, and what separates them."""
    mark = next((mark for mark in marks if mark in line), marks[0] if " " not in marks else " ")
    return [name.strip(" \t\"'") for name in (line.split() if mark == " " else line.split(mark))], mark


def in_order(found: Sequence[str], wanted: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return which wanted names are missing, and which are there twice."""
    return [name for name in wanted if name not in found], [name for name in wanted if found.count(name) > 1]


class _Reader:
    """Names and fields of the lines of one file."""

    def __init__(self, file: str, schema: Schema) -> None:
        self.file, self.schema = file, schema
        self.names: list[str] = []
        self.places: Places | None = None
        self.mark = ","
        self.separator: bytes | None = b","
        self.decimal_commas = False
        self.texts: list[tuple[str, ...]] = []
        self.comments: list[str] = []
        self._kept: dict[bytes, str] = {}
        self._commented: str | None = None  # a line of names in a comment; another may follow
        self._whole = False  # every column is a number that is used, in its order

    def comment(self, text: bytes, where: str, begun: bool) -> None:
        """Keep a comment, and look for names in it."""
        bare = text.lstrip(b"# \t")
        if len(self.comments) < MAX_COMMENTS:
            self.comments.append(bare.decode("utf-8", errors="replace"))
        if self.schema.named is None or begun or self.places is not None or self._commented is not None:
            return
        with suppress(InputError):
            line = decoded(bare, where)
            if self.schema.named(split_names(line, self.schema.marks)[0]):
                self._commented = line

    def fields(self, text: bytes, where: str) -> list[bytes] | None:
        """Return the numbers of a row as texts; None for the line of names."""
        if self.places is None and self._names(text, where):
            return None
        assert self.places is not None
        fields = self._split(text, where)
        if len(fields) != len(self.names):
            if len(fields) == len(self.names) + 1 and not fields[-1].strip():  # a comma behind the last number
                fields.pop()
            else:
                line = decoded(text, f"{where}: expected {len(self.names)} fields")
                how = f"{len(self.names)} fields separated by {MARKS[self.mark]}"
                raise other_count(where, how, len(fields), line, self.schema.needs(len(fields)))
        if self.places.texts:
            self.texts.append(tuple(self._text(fields[k], where, k) for k in self.places.texts))
        if not self._whole:
            fields = [fields[k] for k in self.places.numbers]
        if self.mark != "," and self.schema.decimal_commas and b"," in text:
            self.decimal_commas = self.decimal_commas or any(b"," in part for part in fields)
            fields = [part.replace(b",", b".") for part in fields]
        if self.schema.missing:
            fields = [b"nan" if self._is_missing(part) else part for part in fields]
        return fields

    def _is_missing(self, part: bytes) -> bool:
        return part.strip(b" \t\"'").decode("utf-8", errors="replace").lower() in self.schema.missing

    def _text(self, part: bytes, where: str, column: int) -> str:
        if part not in self._kept:
            self._kept[part] = decoded(part, f"{where}, column {self.names[column]}: expected text").strip(" \t\"'")
        return self._kept[part]

    def _split(self, text: bytes, where: str) -> list[bytes]:
        if b'"' in text:
            if self.schema.quotes and self.separator is not None:
                try:
                    line = decoded(text, f"{where}: expected text")
                    row = next(csv.reader([line], delimiter=self.mark, strict=True, skipinitialspace=True))
                except csv.Error as error:
                    raise InputError(f"{where}: the quotation marks do not match.") from error
                return [part.encode() for part in row]
            text = text.replace(b'"', b"")
        return text.split(self.separator)

    def _names(self, text: bytes, where: str) -> bool:
        """Read the line of names; False where the line is a row."""
        line = decoded(text, f"{where}: expected {self.schema.expected}")
        begun = False
        if self._commented is not None and any(is_number(word) for word in re.split(rb"[,;\s]+", text)):
            line, begun = self._commented, True
        self.names, self.mark = split_names(line, self.schema.marks)
        self.separator = None if self.mark == " " else self.mark.encode()
        if self.schema.quotes and '"' in line:
            with suppress(InputError):  # quotes that do not match: the names tell more of what is wrong
                self.names = [part.decode().strip(" \t\"'") for part in self._split(line.encode(), where)]
        self.places = self.schema.places(self.names, line, where)
        if self.places.names is not None:
            self.names = list(self.places.names)
        self._whole = list(self.places.numbers) == list(range(len(self.names)))
        return self.places.names is None and not begun

    def explain(self, fields: list[bytes], where: str) -> None:
        """Raise for the first field that is no number."""
        assert self.places is not None
        for k, part in zip(self.places.numbers, fields, strict=True):
            if not is_number(part):
                at = f"{where}, column {self.names[k]}: expected a number"
                raise no_number(where, self.names[k], decoded(part, at))


def too_many(where: str, most: int) -> InputError:
    """Return the error of a table that is too long."""
    return InputError(f"{where}: expected at most {most} rows; split the file.")


def other_count(where: str, expected: str, count: int, line: str, hint: str) -> InputError:
    """Return the error of a line with another number of fields."""
    return InputError(f"{where}: expected {expected}, got {count}, {short(line)}{hint}.")


def no_number(where: str, column: str, text: str) -> InputError:
    """Return the error of a field that is no number."""
    text = text.strip(" \t")
    return InputError(f"{where}, column {column}: expected a number, got {short(text) if text else 'an empty field'}.")


def rows_are_numbers(names: Sequence[str]) -> bool:
    """Return whether a line holds numbers, not names."""
    return bool(names) and all(is_number(name.encode()) for name in names)


def numbers_only(line: str) -> Iterator[str]:
    """Yield the words of a line if all of them are numbers: the header is missing."""
    words = [word for word in re.split(r"[,;\s]+", line) if word]
    if len(words) > 1 and rows_are_numbers(words):
        yield from words
