"""Tables of numbers in text, line by line: memory grows with the rows only, and every bad line has its number."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from typing import BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.se3 import Array

# What a hostile or mistaken file may cost.
MAX_BYTES = 1_000_000_000
MAX_ROWS = 10_000_000
MAX_LINE = 10_000


def rows_of(
    file: BinaryIO,
    name: str,
    fields_of: Callable[[bytes, str], list[bytes] | None],
    explain: Callable[[list[bytes], str], NoReturn],
    comment: Callable[[bytes, str], None],
) -> tuple[Array, NDArray[np.int64]]:
    """The numbers (n, k) of a file, finite or not, and the line number of each row.

    Blank lines and lines that start with # are left out. ``fields_of`` splits a line, always into as many fields, or
    returns None for one that holds no row; ``explain`` raises for fields that are not all numbers; ``comment`` sees the
    lines that start with # before the first row: some tools name the columns there.
    """
    values, numbers = array("d"), array("q")
    for number, line in enumerate(_lines(file, name), start=1):
        text = line.strip()
        if not text:
            continue
        where = f"{name}, line {number}"
        if text.startswith(b"#"):
            if not numbers:
                comment(text, where)
            continue
        if (fields := fields_of(text, where)) is None:
            continue
        try:
            row = list(map(float, fields))
        except ValueError:
            explain(fields, where)
        if b"_" in text and any(b"_" in field for field in fields):  # float() takes 1_000 for a number
            explain(fields, where)
        if len(numbers) == MAX_ROWS:
            raise InputError(f"{where}: expected at most {MAX_ROWS} rows; split the file.")
        values.extend(row)
        numbers.append(number)
    if not numbers:
        return np.empty((0, 0)), np.empty(0, dtype=np.int64)
    return np.frombuffer(values).reshape(len(numbers), -1), np.frombuffer(numbers, dtype=np.int64)


def _lines(file: BinaryIO, name: str) -> Iterator[bytes]:
    """The lines of a file, none of them longer than `MAX_LINE`, without a byte order mark."""
    total = 0
    while line := file.readline(MAX_LINE + 2):  # + 2: the line end may be CR LF
        if not total:
            line = line.removeprefix(b"\xef\xbb\xbf") or b"\n"
        if len(line) > MAX_LINE and len(line.rstrip(b"\r\n")) > MAX_LINE:
            raise InputError(
                f"{name}: expected lines of at most {MAX_LINE} characters, got a longer one after "
                f"{total} bytes; is it a table in text?"
            )
        total += len(line)
        yield line


def decoded(text: bytes, what: str) -> str:
    """UTF-8 text without NUL, or an `InputError` that says what was expected."""
    try:
        result = text.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{what}, got bytes that are not UTF-8 text; is it a text file?") from error
    if "\0" in result:
        raise InputError(f"{what}, got NUL bytes; is it a binary file, or text in UTF-16?")
    return result


def is_number(text: bytes) -> bool:
    """Return whether `float` accepts the text, without underscores."""
    try:
        float(text)
    except ValueError:
        return False
    return b"_" not in text


def short(text: str) -> str:
    """Quoted on one line, and cut where it would flood the message."""
    return ascii(text if len(text) <= 80 else f"{text[:77]}...")


def one_line(text: str) -> str:
    """A message of another library, without its line ends, cut where it would flood ours."""
    text = " ".join(text.split())
    text = text if text.isprintable() else ascii(text)
    return (text if len(text) <= 160 else f"{text[:157]}...").rstrip(".")
