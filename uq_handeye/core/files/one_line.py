"""One-line error messages: text of a file or a library, made safe for a message and a terminal.

Text of a file that a message quotes is escaped and cut, so that it neither floods the message nor moves the cursor of
a terminal. `refused` turns any exception of a library on a damaged file into an `InputError` of one line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any

from ...errors import InputError
from ..limits import MAX_NAME_CHARACTERS

_CONTROLS = re.compile(
    r"(?!\x1b\[[0-9;]*m)[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]|\r(?!\n)"
)


def short(text: str) -> str:
    """Quoted on one line, and cut where it would flood the message."""
    return ascii(text if len(text) <= 80 else f"{text[:77]}...")


def require_name(name: object) -> None:
    """Raise `InputError` for what is no short printable text: names reach terminals and files."""
    if not isinstance(name, str) or not name.isprintable() or not 0 < len(name) <= MAX_NAME_CHARACTERS:
        raise InputError(
            f"Expected the name of an arm, a camera or a target of 1 to {MAX_NAME_CHARACTERS} printable "
            f"characters, got {name!a:.60}."
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None and (said := next((one for of, one in self.words if issubclass(kind, of)), None)):
            raise InputError(f"{self.what}{said(error)}.") from error
