"""Results in notebooks: HTML that needs nothing but itself, on light and on dark pages; and X as a pandas table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any

from ..geometry.conventions import COMPONENTS
from .document import Block, Caution, Document, document_of, groups_of
from .html import Look, block_html

if TYPE_CHECKING:
    from ..geometry.se3 import Array

# Neither text nor page colours are set, so that those of the notebook hold; tints are half transparent over any page.
_FRAME = "font-family:system-ui,sans-serif;line-height:1.45;max-width:60em"
_TABLE = "border-collapse:collapse;font-variant-numeric:tabular-nums;margin:0.4em 0"
_CELL = "border:1px solid rgba(128,128,128,0.4);padding:0.15em 0.7em"
_NUMBER = f"{_CELL};text-align:right;white-space:nowrap"
_CHECK = "border:0;padding:0.05em 0.7em;text-align:left"
_STYLES = {
    "heading": "margin:0.3em 0",
    "paragraph": "margin:0.3em 0",
    "empty": "margin:0.3em 0",
    "caution": "border-left:4px solid #d55e00;background:rgba(213,94,0,0.12);padding:0.3em 0.7em;margin:0.4em 0",
    "code": "font-family:ui-monospace,monospace;font-size:0.9em;line-height:1.3;overflow-x:auto;margin:0.4em 0",
    "table": _TABLE,
    "cell": _CELL,
    "marked": "background:rgba(213,94,0,0.12)",
    "column of words": _CELL,
    "words": f"{_CELL};text-align:left",
    "words long": f"{_CELL};text-align:left",
    "number": _NUMBER,
    "name": f"{_CELL};text-align:left;font-weight:normal",
    "number of a row": f"{_NUMBER};font-weight:normal",
    "check": _CHECK,
}
# Lines of status, visible on light and on dark pages; the word is printed, too.
for _status, _colour in {"ok": "#009e73", "caution": "#e69f00", "failed": "#d55e00", "not run": "#808080"}.items():
    _bold = "bold" if _status == "failed" else "normal"
    _line = f"border-left:4px solid {_colour}"
    _STYLES[f"answer {_status}"] = f"font-size:1.08em;margin:0.4em 0;padding:0.1em 0.7em;font-weight:{_bold};{_line}"
    _strong = "bold" if _status in ("caution", "failed") else "normal"
    _STYLES[f"status {_status}"] = f"border:0;{_line};padding:0.05em 0.7em;text-align:left;font-weight:{_strong}"
LOOK = Look({role: f' style="{style}"' for role, style in _STYLES.items()}, page=False)
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
    first, rest = ("".join(map(blocks_html, part)) for part in (groups[:seen], groups[seen:]))
    folds = [_folded(*fold) for fold in ([("All of it", rest)] if rest else []) + [*folded]]
    heading = f'<p style="margin:0.2em 0"><b style="font-size:1.15em">{LOOK.said(title)}</b> {LOOK.said(beside)}</p>'
    return f'<div style="{_FRAME}">{heading}{first}{"".join(folds)}</div>'


def blocks_html(blocks: Sequence[Block]) -> str:
    """Blocks one below the other, to be folded away."""
    return "".join(block_html(block, LOOK) for block in blocks)


def _folded(title: str, content: str) -> str:
    return f'<details><summary style="cursor:pointer">{LOOK.said(title)}</summary>{content}</details>'


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
