"""Lines of an untrusted text: bounded, decoded, and quoted in messages.

Tables as CSV text that is safe to open in a spreadsheet.

A spreadsheet runs a cell that begins with ``=``, ``+``, ``-`` or ``@`` as a formula, wherever its text comes from: the
name of a point, a joint or a picture. Such a text gets an apostrophe before it, as a spreadsheet writes it; numbers do
not. `plain_text` takes it off again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO

from ...errors import InputError

if TYPE_CHECKING:
    import pandas as pd

# What a hostile or mistaken file may cost.
MAX_BYTES = 1_000_000_000
MAX_ROWS = 10_000_000
MAX_LINE = 10_000

# What spreadsheets write where there is no value: a row of it is no comment.
NO_VALUE = re.compile(rb"#\s*(?:N/?[AV]\b|[A-Z0-9/]+[!?])")


def lines_of(file: BinaryIO, name: str) -> Iterator[bytes]:
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


def floats(words: Iterable[str | bytes]) -> list[float] | None:
    """Return the numbers of words as `float` reads them; None where one of them is no number."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return None


def is_number(text: bytes) -> bool:
    """Return whether `float` accepts the text, without underscores."""
    return floats([text]) is not None and b"_" not in text


def short(text: str) -> str:
    """Quoted on one line, and cut where it would flood the message."""
    return ascii(text if len(text) <= 80 else f"{text[:77]}...")


_CONTROLS = re.compile(
    r"(?!\x1b\[[0-9;]*m)[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]|\r(?!\n)"
)


def printable(text: str) -> str:
    """Text for a terminal: what moves its cursor or turns its writing round is escaped; colours and tabs stay."""
    return _CONTROLS.sub(lambda found: ascii(found[0])[1:-1], text)


def one_line(text: str) -> str:
    """A message of another library, without its line ends, cut where it would flood ours."""
    text = " ".join(text.split())
    text = text if text.isprintable() else ascii(text)
    return (text if len(text) <= 160 else f"{text[:157]}...").rstrip(".")


def words_of(error: BaseException) -> str:
    """Return what a library says, or, as its messages may be empty, the kind of its error."""
    return f": {one_line(str(error)) or type(error).__name__}"


# Kinds of exceptions, and what follows the beginning of the message; None: they pass as they are.
Words = Sequence[tuple[type[Exception] | tuple[type[Exception], ...], Callable[[Any], str] | None]]
# Any exception of a library; and those of data that are not what they should be.
ANY: Words = ((InputError, None), (Exception, words_of))
OF_DATA: Words = ((InputError, None), ((KeyError, TypeError, ValueError, IndexError), words_of))


class refused:
    """Context in which what is raised on a damaged file becomes an `InputError` in one line.

    Parameters
    ----------
    what : the beginning of the message
    words : a table of kinds of exceptions and of the words that follow; the first kind that fits says them
    """

    def __init__(self, what: str, words: Words = ANY) -> None:
        self.what, self.words = what, words

    def __enter__(self) -> None: ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> None:
        if kind is not None and (said := next((one for of, one in self.words if issubclass(kind, of)), None)):
            raise InputError(f"{self.what}{said(error)}.") from error


# The wide forms are signs of a formula in Japanese and Chinese editions.
_FORMULA = re.compile(r"'*\s*[=+\-@\t\r\uff1d\uff0b\uff0d\uff20]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Return rows as text, each ended by a line feed: numbers bit by bit, None empty, texts as `safe_text`."""
    return "".join(f"{','.join(map(_cell, row))}\n" for row in rows)


def frame_text(frame: pd.DataFrame) -> str:
    """Return a data frame without its index as text, its texts as `safe_text`."""
    safe = frame.map(lambda value: safe_text(value) if isinstance(value, str) else value)
    return str(safe.to_csv(index=False, lineterminator="\n"))


def safe_text(text: str) -> str:
    """Return a text on one line that no spreadsheet takes for a formula.

    >>> safe_text("=1+1"), safe_text("-7.5"), safe_text("corner")
    ("'=1+1", '-7.5', 'corner')
    """
    line = " ".join(text.splitlines())
    return f"'{line}" if _FORMULA.match(line) and not _NUMBER.fullmatch(line) else line


def plain_text(text: str) -> str:
    """Return the text that `safe_text` was given."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if not isinstance(value, str):
        return repr(value)
    text = safe_text(value)
    return '"' + text.replace('"', '""') + '"' if any(mark in text for mark in ',;"\t#') else text
