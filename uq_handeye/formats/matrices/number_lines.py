"""Lines of a text as numbers: without comments, brackets, names and the words of NumPy, MATLAB and C++ around them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from ...core.files.one_line import short
from ...errors import InputError
from ..number_table import COMMA_NUMBER, number_of
from .layout import COUNTS

_COMMENT = re.compile(r"(#|//|%|--).*")
# Bounded, so that long lines take no longer than they are.
_DTYPE = re.compile(r",?\s{0,3}(dtype|device|requires_grad)\s{0,3}=\s{0,3}[\w.:']{1,40}")
_CALL = re.compile(r"\b[A-Za-z_][\w.]{0,40}\s{0,3}(?=\()")
_LABEL = re.compile(r"[:\[({]")
# MATLAB prints one factor for all numbers of a matrix.
_FACTOR = re.compile(r"^\s*\d(\.\d+)?e[+-]?\d+\s*\*\s*$", re.IGNORECASE)
_MARKS = str.maketrans("[](){};|\t\"'", " " * 11)
# Words in front of the numbers of a line: a file, a name.
MAX_LABEL_WORDS = 3


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
        if (
            last - first >= min(COUNTS) and len(known) - last <= MAX_LABEL_WORDS
        ):  # the name of a picture behind the numbers
            words, known, values = words[:last], known[:last], values[:last]
        if first > MAX_LABEL_WORDS or not all(known[first:]):
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
