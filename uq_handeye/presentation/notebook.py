"""Results in notebooks: HTML that needs nothing but itself, on light and on dark pages; and X as a pandas table."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from ..geometry.conventions import COMPONENTS

if TYPE_CHECKING:
    from ..geometry.se3 import Array

# Neither text nor page colours are set, so that those of the notebook hold; tints are half transparent over any page.
_FRAME = "font-family:system-ui,sans-serif;line-height:1.45;max-width:60em"
_TABLE = "border-collapse:collapse;font-variant-numeric:tabular-nums;margin:0.4em 0"
_CELL = "border:1px solid rgba(128,128,128,0.4);padding:0.15em 0.7em;text-align:right"
_WARNING = "border-left:4px solid #d55e00;background:rgba(213,94,0,0.12);padding:0.3em 0.7em;margin:0.4em 0"
_PRE = "font-family:ui-monospace,monospace;font-size:0.9em;line-height:1.3;overflow-x:auto;margin:0.4em 0"
# Red and blue of equal lightness that colour-blind readers can tell apart; the sign is printed, too.
_POSITIVE, _NEGATIVE = "213,94,0", "0,114,178"


def text_html(title: str, verdict: str, text: str, warnings: tuple[str, ...] = ()) -> str:
    """A result that is best read as text: its name and its verdict, and the text folded away."""
    cautions = [f'<p style="{_WARNING}"><b>Caution:</b> {escape(caution)}</p>' for caution in warnings]
    details = f'<pre style="{_PRE}">{escape(text)}</pre>'
    return _whole([_heading(title, ""), _paragraph(verdict), *cautions, _folded("All of it", details)])


def _whole(parts: list[str]) -> str:
    return f'<div style="{_FRAME}">{"".join(parts)}</div>'


def _heading(title: str, beside: str) -> str:
    return f'<p style="margin:0.2em 0"><b style="font-size:1.15em">{escape(title)}</b> {escape(beside)}</p>'


def _paragraph(text: str) -> str:
    return f'<p style="margin:0.3em 0">{escape(text)}</p>'


def _folded(title: str, content: str) -> str:
    return f'<details><summary style="cursor:pointer">{escape(title)}</summary>{content}</details>'


def _table(head: list[str], rows: list[list[str]]) -> str:
    top = "".join(f'<th scope="col" style="{_CELL}">{escape(cell)}</th>' for cell in head)
    body = "".join(
        f'<tr><th scope="row" style="{_CELL};text-align:left;font-weight:normal">{escape(first)}</th>'
        + "".join(f'<td style="{_CELL}">{escape(cell)}</td>' for cell in rest)
        + "</tr>"
        for first, *rest in rows
    )
    return f'<table style="{_TABLE}"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>'


def _matrix(T: Array) -> str:
    rows = "".join(
        "<tr>" + "".join(f'<td style="{_CELL}">{x + 0.0:.9f}</td>' for x in row) + "</tr>" for row in T.round(9)
    )
    return f'<table style="{_TABLE}">{rows}</table>'


def _heat(values: Array, correlation: Array, form: str) -> str:
    """A table of ``values`` tinted by the correlation: the darker the stronger, of one hue for each sign."""
    head = "".join(f'<th scope="col" style="{_CELL}">{name}</th>' for name in ("", *COMPONENTS))
    rows = []
    for i, name in enumerate(COMPONENTS):
        cells = []
        for value, strength in zip(values[i], correlation[i], strict=True):
            hue = _POSITIVE if strength >= 0 else _NEGATIVE
            tint = f"background:rgba({hue},{0.6 * min(abs(float(strength)), 1.0):.2f})"
            cells.append(f'<td style="{_CELL};{tint}">{form.format(value)}</td>')
        rows.append(f'<tr><th scope="row" style="{_CELL};text-align:left">{name}</th>{"".join(cells)}</tr>')
    return f'<table style="{_TABLE}"><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
