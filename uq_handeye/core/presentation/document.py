"""The document model: the content of a result or a page as blocks, rendered as text here and as HTML by `html`.

A document is a sequence of blocks, or of lists of blocks that belong together. Everything is plain text; the renderer
escapes it and decides on its appearance.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Any, ClassVar

from ...findings import Finding

# Longest line of text, in characters, unless the caller says otherwise.
WIDTH = 118
# Columns of a first screen, and of text where stdout is no terminal.
COLUMNS = 80

# Make a piece of text look like its role: "answer", "heading", or the status of a check.
Style = Callable[[str, str], str]

# Longest of the words for the status of a check.
STATUS_WIDTH = len("caution")

# A cell that holds the text of several.
Cell = str | tuple[str, int]


class Block:
    """Part of a document."""

    kind: ClassVar[str]


@dataclass(frozen=True)
class Heading(Block):
    """A line above what it names."""

    text: str
    kind: ClassVar[str] = "heading"


@dataclass(frozen=True)
class Paragraph(Block):
    """A paragraph; ``empty`` says that something is missing, and why."""

    text: str
    empty: bool = False
    indent: str = ""  # of the first line of text
    hang: str | None = None  # of the others; None: as the first
    kind: ClassVar[str] = "paragraph"


@dataclass(frozen=True)
class Answer(Block):
    """The sentence that a result is asked for, with the status of the result."""

    text: str
    status: str = "ok"  # "ok", "caution" or "failed"
    kind: ClassVar[str] = "answer"


@dataclass(frozen=True)
class Checks(Block):
    """Checks, one line each: status ("ok", "caution", "failed" or "not run"), name, and what was found."""

    rows: Sequence[tuple[str, str, str]]
    kind: ClassVar[str] = "checks"

    @classmethod
    def of(cls, checks: Iterable[Any]) -> Checks:
        """The checks of a result, of ``status``, ``name`` and ``text``."""
        return cls([(check.status, check.name, check.text) for check in checks])


@dataclass(frozen=True)
class Caution(Block):
    """Caution about what looks wrong, stated before the numbers."""

    text: str
    kind: ClassVar[str] = "caution"


@dataclass(frozen=True)
class Points(Block):
    """A list; those in ``marked`` stand out."""

    items: Sequence[str]
    marked: frozenset[int] = frozenset()  # numbers of the items, from 0

    @classmethod
    def of_findings(cls, findings: Sequence[Finding]) -> Points:
        """A list of findings; those that are more than a note stand out."""
        marked = frozenset(k for k, finding in enumerate(findings) if finding.severity != "note")
        return cls([str(finding) for finding in findings], marked)

    kind: ClassVar[str] = "points"


@dataclass(frozen=True)
class Table(Block):
    """A table with a caption; the first cell of a row is its heading. A cell ``(text, k)`` goes over k columns."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[Cell]]  # one without cells is a rule
    text_columns: frozenset[int] = frozenset()  # all others hold numbers and are set to the right
    marked: frozenset[int] = frozenset()  # rows that stand out
    verbatim: bool = False  # names and values as they are: no typographic signs
    units: Sequence[str] = ()  # of the columns
    groups: Sequence[tuple[str, int]] = ()  # headings over so many columns each
    named: bool = True  # whether the first column holds names, which are set to the left
    kind: ClassVar[str] = "table"

    @property
    def worded(self) -> bool:
        """True if a heading of a row is longer than a short word or number, and needs room on a narrow screen."""
        return any(len(row[0]) > 12 for row in self.rows if isinstance(row[0], str))

    @property
    def columns(self) -> list[str]:
        """The heads with their units."""
        units = self.units or [""] * len(self.head)
        return [f"{name} ({unit})" if unit else name for name, unit in zip(self.head, units, strict=True)]


@dataclass(frozen=True)
class Drawing(Block):
    """A figure as SVG markup, trusted, with alt text and caption; text leaves it out."""

    stem: str
    svg: str
    alt: str
    caption: str
    scene: str = ""  # JSON, trusted, that `turn.js` draws in its place
    small: bool = False  # readable in half the width of a page
    kind: ClassVar[str] = "drawing"


@dataclass(frozen=True)
class Badge(Block):
    """A word that decides, such as PASS, with its status ("ok", "caution" or "failed") and the sentence behind it."""

    word: str
    text: str
    status: str
    kind: ClassVar[str] = "badge"


@dataclass(frozen=True)
class Code(Block):
    """Text to copy, with what it is and its units and convention."""

    title: str
    text: str
    note: str
    kind: ClassVar[str] = "code"


Document = Sequence[Block | Sequence[Block]]


@dataclass(frozen=True)
class Section:
    """A heading with its anchor and what stands below it."""

    anchor: str
    title: str
    blocks: Sequence[Block]
    folded: bool = False  # closed on a page until it is opened
    wide: bool = False  # across both columns of a printed page


def groups_of(document: Document) -> Iterable[Sequence[Block]]:
    """The blocks that stand together; a block by itself is a group."""
    return ([part] if isinstance(part, Block) else part for part in document)


@singledispatch
def document_of(result: Any, **options: Any) -> Document:
    """Return the document of a result. Each topic registers the function that makes the document of its own result."""
    raise TypeError(f"Expected a result with a document, got {type(result).__name__}.")


def plain_style(text: str, role: str) -> str:
    """Return the text as it is."""
    return text


def to_text(document: Document, width: int = WIDTH, style: Style = plain_style) -> str:
    """Return the document as text, with an empty line between groups; paragraphs and lists are wrapped to ``width``."""
    groups = groups_of(document)
    texts = ["\n".join(line.rstrip() for block in group for line in _lines(block, width, style)) for group in groups]
    return "\n\n".join(text for text in texts if text) + "\n"


def _lines(block: Block, width: int, style: Style) -> list[str]:
    match block:
        case Heading():
            return [style(block.text, "heading")]
        case Paragraph():
            return [] if block.empty else _wrapped(block.text, width, block.indent, block.hang)
        case Answer():
            lines = _wrapped(block.text, width)
            return [style(style(line, "failed") if block.status == "failed" else line, "answer") for line in lines]
        case Checks():
            return _check_lines(block, width, style)
        case Caution():
            first, *rest = _wrapped(f"CAUTION: {block.text}", width, "", "  ")
            return [first.replace("CAUTION:", style("CAUTION:", "caution"), 1), *rest]
        case Points():
            return [line for item in block.items for line in _wrapped(f"- {item}", width, "", "  ")]
        case Table():
            return _table_lines(block, width)
        case Code():
            return block.text.splitlines()
        case _:  # a drawing
            return []


def _wrapped(text: str, width: int, indent: str = "", hang: str | None = None) -> list[str]:
    hang = indent if hang is None else hang
    return textwrap.wrap(
        text, width, initial_indent=indent, subsequent_indent=hang, break_long_words=False, break_on_hyphens=False
    )


def _check_lines(checks: Checks, width: int, style: Style) -> list[str]:
    """Status and name in columns of their own, the text beside them; a list of names is no column."""
    names = max((len(name) for _, name, _ in checks.rows if "," not in name), default=0)
    lines = []
    for status, name, text in checks.rows:
        start = f"{status:<{STATUS_WIDTH}}  "
        hang = " " * len(start)
        if "," in name:
            start += f"{name}: "
        else:
            start += f"{name:<{names}}  "
            hang = " " * len(start)
        first, *rest = _wrapped(start + text, width, "", hang)
        lines += [style(status, status) + first[len(status) :], *rest]
    return lines


def _table_lines(table: Table, width: int) -> list[str]:
    """Columns as wide as their widest cell, two spaces apart, one where the line would be too long.

    Those below a caption are indented. The last cell of a row goes over several columns as a wrapped paragraph.
    """
    heads = [list(line) for line in (table.head, table.units) if any(line)]
    plain = [[str(cell) for cell in row] for row in (*heads, *table.rows) if row and isinstance(row[-1], str)]
    widths = [max(map(len, column)) for column in zip(*plain, strict=True)]
    widths = widths or [max((len(row[0]) for row in table.rows), default=0)]
    indent = "  " if table.caption else ""
    gap = "  " if len(indent) + sum(widths) + 2 * (len(widths) - 1) <= width else " "
    left = table.text_columns | ({0} if table.named else set())

    def joined(cells: Sequence[Cell]) -> str:
        placed = (
            str(c).ljust(w) if k in left else str(c).rjust(w)
            for k, (c, w) in enumerate(zip(cells, widths, strict=False))
        )
        return gap.join(placed)

    lines = _wrapped(table.caption, width)
    if table.groups:
        line, at = "", 0
        for title, count in table.groups:
            line = f"{line} "[: len(line) + bool(line)].ljust(sum(widths[:at]) + len(gap) * at) + title
            at += count
        lines.append(indent + line)
    for row in (*heads, *table.rows):
        if not row:
            lines.append(indent + "-" * len(joined([""] * len(widths))))
        elif isinstance(row[-1], tuple):
            start = f"{indent}{joined(row[:-1])}{gap}"
            lines += _wrapped(start + row[-1][0], width, "", " " * len(start))
        else:
            lines.append(indent + joined(row))
    return lines
