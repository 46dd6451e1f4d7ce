"""Results in notebooks: HTML that needs nothing but itself, on light and on dark pages; and X as a pandas table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch
from html import escape as escaped
from typing import TYPE_CHECKING, Any

from ..geometry.conventions import COMPONENTS
from .document import (
    Answer,
    Block,
    Caution,
    Cell,
    Checks,
    Code,
    Document,
    Heading,
    Paragraph,
    Points,
    Table,
    document_of,
    groups_of,
)

if TYPE_CHECKING:
    from ..geometry.se3 import Array

# Neither text nor page colours are set, so that those of the notebook hold; tints are half transparent over any page.
_FRAME = "font-family:system-ui,sans-serif;line-height:1.45;max-width:60em"
_TABLE = "border-collapse:collapse;font-variant-numeric:tabular-nums;margin:0.4em 0"
_CELL = "border:1px solid rgba(128,128,128,0.4);padding:0.15em 0.7em"
_NUMBER = f"{_CELL};text-align:right;white-space:nowrap"
_WARNING = "border-left:4px solid #d55e00;background:rgba(213,94,0,0.12);padding:0.3em 0.7em;margin:0.4em 0"
_ANSWER = "font-size:1.08em;margin:0.4em 0;padding:0.1em 0.7em"
# Lines of status, visible on light and on dark pages; the word is printed, too.
_STATUS = {"ok": "#009e73", "caution": "#e69f00", "failed": "#d55e00", "not run": "#808080"}
_MARKED = ' style="background:rgba(213,94,0,0.12)"'
_PRE = "font-family:ui-monospace,monospace;font-size:0.9em;line-height:1.3;overflow-x:auto;margin:0.4em 0"
# Red and blue of equal lightness that colour-blind readers can tell apart; the sign is printed, too.
_POSITIVE, _NEGATIVE = "213,94,0", "0,114,178"


@singledispatch
def html_of(result: Any) -> str:
    """The form of a result in notebooks; a topic registers what shows more than the text."""
    return to_html(type(result).__name__, document_of(result))


def to_html(
    title: str, document: Document, *, beside: str = "", seen: int = 1, folded: Sequence[tuple[str, str]] = ()
) -> str:
    """The document below its title: the first groups, ``seen`` of them, and what looks wrong; the others folded away.

    ``folded`` are titles with the markup, trusted, that is folded away below them.
    """
    groups = list(groups_of(document))
    while seen < len(groups) and all(isinstance(block, Caution) for block in groups[seen]):
        seen += 1
    first, rest = ("".join(_block(b) for group in part for b in group) for part in (groups[:seen], groups[seen:]))
    folds = [_folded(*fold) for fold in ([("All of it", rest)] if rest else []) + [*folded]]
    heading = f'<p style="margin:0.2em 0"><b style="font-size:1.15em">{escape(title)}</b> {escape(beside)}</p>'
    return f'<div style="{_FRAME}">{heading}{first}{"".join(folds)}</div>'


def blocks_html(blocks: Sequence[Block]) -> str:
    """Blocks one below the other, to be folded away."""
    return "".join(map(_block, blocks))


def escape(text: str) -> str:
    """Text as HTML, with the signs of print for those of a terminal."""
    return escaped(text.replace("d^2", "d²").replace("+-", "±"))


def _block(block: Block) -> str:
    match block:
        case Heading():
            return f'<p style="margin:0.3em 0"><b>{escape(block.text)}</b></p>'
        case Paragraph():
            return _paragraph(block.text)
        case Answer():
            weight = "bold" if block.status == "failed" else "normal"
            style = f"{_ANSWER};font-weight:{weight};border-left:4px solid {_STATUS[block.status]}"
            return f'<p style="{style}">{escape(block.text)}</p>'
        case Checks():
            return _checks(block)
        case Caution():
            return f'<p style="{_WARNING}"><b>Caution:</b> {escape(block.text)}</p>'
        case Points():
            return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in block.items)}</ul>"
        case Table():
            return _table(block)
        case Code():
            return f'<pre style="{_PRE}">{escape(block.text)}</pre>'
        case _:
            raise TypeError(f"Expected a block that a notebook shows, got a {block.kind}.")


def _paragraph(text: str) -> str:
    return f'<p style="margin:0.3em 0">{escape(text)}</p>'


def _folded(title: str, content: str) -> str:
    return f'<details><summary style="cursor:pointer">{escape(title)}</summary>{content}</details>'


def _table(table: Table) -> str:
    groups = "".join(f'<th colspan="{count}" style="{_CELL}">{escape(title)}</th>' for title, count in table.groups)
    head = "".join(f'<th scope="col" style="{_CELL}">{escape(name)}</th>' for name in table.columns)
    body = "".join(
        f"<tr{_MARKED if k in table.marked else ''}>{_cells(row, table)}</tr>"
        for k, row in enumerate(table.rows)
        if row
    )
    top = "".join(f"<tr>{line}</tr>" for line in (groups, head if any(table.columns) else "") if line)
    caption = _paragraph(table.caption) if table.caption else ""
    whole = f'<table style="{_TABLE}"><thead>{top}</thead><tbody>{body}</tbody></table>'
    return f'{caption}<div style="overflow-x:auto">{whole}</div>'


def _checks(checks: Checks) -> str:
    """A line for each check, its status with a coloured edge."""
    rows = []
    for status, name, text in checks.rows:
        edge = f"border:0;border-left:4px solid {_STATUS[status]};padding:0.05em 0.7em;text-align:left"
        rest = "border:0;padding:0.05em 0.7em;text-align:left"
        weight = "bold" if status in ("caution", "failed") else "normal"
        cells = f'<td style="{rest}">{escape(name)}</td><td style="{rest}">{escape(text)}</td>'
        rows.append(f'<tr><th scope="row" style="{edge};font-weight:{weight}">{escape(status)}</th>{cells}</tr>')
    return f'<table style="{_TABLE}"><tbody>{"".join(rows)}</tbody></table>'


def _cells(row: Sequence[Cell], table: Table) -> str:
    cells = []
    for k, cell in enumerate(row):
        text, span = (cell, "") if isinstance(cell, str) else (cell[0], f' colspan="{cell[1]}"')
        left = span or k in table.text_columns or (k == 0 and table.named)
        style = f"{_CELL};text-align:left" if left else _NUMBER
        if k == 0:
            cells.append(f'<th scope="row"{span} style="{style};font-weight:normal">{escape(text)}</th>')
        else:
            cells.append(f'<td{span} style="{style}">{escape(text)}</td>')
    return "".join(cells)


def matrix_html(T: Array) -> str:
    rows = "".join(
        "<tr>" + "".join(f'<td style="{_NUMBER}">{x + 0.0:.9f}</td>' for x in row) + "</tr>" for row in T.round(9)
    )
    return f'<table style="{_TABLE}">{rows}</table>'


def heat_html(values: Array, correlation: Array, form: str) -> str:
    """A table of ``values`` tinted by the correlation: the darker the stronger, of one hue for each sign."""
    head = "".join(f'<th scope="col" style="{_CELL}">{name}</th>' for name in ("", *COMPONENTS))
    rows = []
    for i, name in enumerate(COMPONENTS):
        cells = []
        for value, strength in zip(values[i], correlation[i], strict=True):
            hue = _POSITIVE if strength >= 0 else _NEGATIVE
            tint = f"background:rgba({hue},{0.6 * min(abs(float(strength)), 1.0):.2f})"
            cells.append(f'<td style="{_NUMBER};{tint}">{form.format(value)}</td>')
        rows.append(f'<tr><th scope="row" style="{_CELL};text-align:left">{name}</th>{"".join(cells)}</tr>')
    return f'<table style="{_TABLE}"><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
