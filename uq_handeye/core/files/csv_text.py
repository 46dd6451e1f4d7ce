"""Tables as CSV text that is safe to open in a spreadsheet.

A spreadsheet runs a cell that begins with ``=``, ``+``, ``-`` or ``@`` as a formula, wherever its text comes from: the
name of a point, a joint or a picture. Such a text gets an apostrophe before it, as a spreadsheet writes it; numbers do
not. `plain_text` removes it again.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

# A cell of a table: a number, a text, or nothing.
Cell = float | int | str | None

# The wide forms are signs of a formula in Japanese and Chinese editions.
_FORMULA = re.compile(r"'*\s*[=+\-@\t\r\uff1d\uff0b\uff0d\uff20]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def csv_text(rows: Iterable[Iterable[Cell]]) -> str:
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


def _cell(value: Cell) -> str:
    if value is None:
        return ""
    if not isinstance(value, str):
        return repr(value)
    text = safe_text(value)
    return '"' + text.replace('"', '""') + '"' if any(mark in text for mark in ',;"\t#') else text
