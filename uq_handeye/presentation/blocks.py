"""What a page of the report is made of: sections of paragraphs, lists, tables, figures and text to copy.

Everything is plain text; the template escapes it and decides how it looks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

# A cell that holds the text of several.
Cell = str | tuple[str, int]


@dataclass(frozen=True)
class Paragraph:
    """A paragraph; ``empty`` says that something is missing, and why."""

    text: str
    empty: bool = False
    kind: str = "paragraph"


@dataclass(frozen=True)
class Points:
    """A list; those in ``marked`` stand out."""

    items: Sequence[str]
    marked: frozenset[str] = frozenset()
    kind: str = "points"


@dataclass(frozen=True)
class Table:
    """A table with a caption; the first cell of a row is its heading. A cell ``(text, k)`` goes over k columns."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    text_columns: frozenset[int] = frozenset()  # all others hold numbers and are set to the right
    marked: frozenset[int] = frozenset()  # rows that stand out
    verbatim: bool = False  # names and values as they are: no typographic signs
    kind: str = "table"

    @property
    def worded(self) -> bool:
        """Whether a heading of a row is longer than a short word or number, and needs room on a narrow screen."""
        return any(len(row[0]) > 12 for row in self.rows if isinstance(row[0], str))


@dataclass(frozen=True)
class Drawing:
    """A figure as SVG markup, trusted, with alt text and caption."""

    stem: str
    svg: str
    alt: str
    caption: str
    kind: str = "drawing"


@dataclass(frozen=True)
class Code:
    """Text to copy, with what it is and its units and convention."""

    title: str
    text: str
    note: str
    kind: str = "code"


Block = Paragraph | Points | Table | Drawing | Code


@dataclass(frozen=True)
class Section:
    """A heading with its anchor and what stands below it."""

    anchor: str
    title: str
    blocks: Sequence[Block]
