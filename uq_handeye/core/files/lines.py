"""Lines of an untrusted text: bounded in length, decoded, and numbered."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import BinaryIO

from ...errors import InputError
from ..limits import MAX_LINE_CHARACTERS

# What spreadsheets write where there is no value: a row of it is no comment.
NO_VALUE = re.compile(rb"#\s*(?:N/?[AV]\b|[A-Z0-9/]+[!?])")


def lines_of(file: BinaryIO, name: str) -> Iterator[bytes]:
    """The lines of a file, none of them longer than `MAX_LINE_CHARACTERS`, without a byte order mark."""
    total = 0
    while line := file.readline(MAX_LINE_CHARACTERS + 2):  # + 2: the line end may be CR LF
        if not total:
            line = line.removeprefix(b"\xef\xbb\xbf") or b"\n"
        if len(line) > MAX_LINE_CHARACTERS and len(line.rstrip(b"\r\n")) > MAX_LINE_CHARACTERS:
            raise InputError(
                f"{name}: expected lines of at most {MAX_LINE_CHARACTERS} characters, got a longer one after "
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
