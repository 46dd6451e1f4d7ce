"""Rendering of the blocks of a document as HTML, with classes for a page and with styles for a notebook.

All text is escaped; trusted are only the markup of drawings and their scenes. A notebook shows results as HTML that
needs nothing but itself, on light and on dark pages.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from html import escape as escaped
from importlib import resources
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from ..geometry.conventions import COMPONENTS
from .document import (
    Answer,
    Badge,
    Block,
    Caution,
    Cell,
    Checks,
    Code,
    Document,
    Drawing,
    Heading,
    Paragraph,
    Points,
    Section,
    Table,
    document_of,
    groups_of,
)

if TYPE_CHECKING:
    from ..geometry.se3 import Array


def macros(package: str | None, name: str, html: bool = True, **known: Any) -> Any:
    """Return the macros of a template of a package; ``known`` are names that it uses.

    Their results are `Markup`, or with ``html=False`` plain text.
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=html, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    text = resources.files(package or "").joinpath(name).read_text(encoding="utf-8")
    return environment.from_string(text, globals=known).module


def pretty(text: str) -> str:
    """Signs of print for those of a terminal: d², ±, a true minus before a number."""
    text = text.replace("`", "").replace("d^2", "d²").replace("deg^2", "deg²").replace("mm^2", "mm²").replace("+-", "±")
    return re.sub(r"(?<![\w.)\]-])-(?=\d)", "\N{MINUS SIGN}", text)


@dataclass(frozen=True)
class Look:
    """Attributes of the elements by their role; ``page``: with anchors, buttons, and what is read aloud."""

    attributes: Mapping[str, str]
    page: bool
    tag: str = ""  # before points that stand out

    def __call__(self, role: str, *names: str) -> str:
        """Return the attributes of a role, such as `` class="answer ok"``, with a leading space."""
        name = " ".join((role, *names))
        found = self.attributes.get(name, self.attributes.get(role, ""))
        return found.format(name.replace("not run", "not-run"))

    def said(self, text: str, verbatim: bool = False) -> str:
        """Return text escaped, on a page with the signs of print, in a notebook with few of them."""
        if not self.page:
            return escaped(text.replace("d^2", "d²").replace("+-", "±"))
        return str(Markup.escape(text if verbatim else pretty(text)))


_PAGE = dict.fromkeys(("empty", "answer", "badge", "warnings", "small"), ' class="{}"')
_PAGE |= {"status": ' class="{}"', "marked": ' class="flagged"', "marked item": ' class="marked"'}
_PAGE |= {"column of words": ' class="text"', "words": ' class="text"', "words long": ' class="text long"'}
PAGE = Look(_PAGE, page=True)


def section_html(section: Section, look: Look, lead: bool = False) -> Markup:
    """Return what stands below the heading of a section; ``lead``: paragraphs as large as an answer."""
    if lead:
        look = replace(look, attributes={**look.attributes, "paragraph": ' class="lead"'})
    return Markup("\n".join(block_html(b, look, section.anchor, k) for k, b in enumerate(section.blocks, 1)))


def block_html(block: Block, look: Look, anchor: str = "", number: int = 0) -> str:
    """Return a block; ``anchor`` and ``number`` are its section on a page and its place there, from 1."""
    match block:
        case Heading():
            return f"<p{look('heading')}><b>{look.said(block.text)}</b></p>"
        case Paragraph():
            return f"<p{look('empty' if block.empty else 'paragraph')}>{look.said(block.text)}</p>"
        case Answer():
            return f"<p{look('answer', block.status)}>{look.said(block.text)}</p>"
        case Badge():
            text = f"<strong>{look.said(block.word, True)}</strong> <span>{look.said(block.text)}</span>"
            return f"<p{look('badge', block.status)}>{text}</p>"
        case Caution():
            return f"<p{look('caution')}><b>Caution:</b> {look.said(block.text)}</p>"
        case Checks():
            return _checks(block, look, anchor)
        case Points():
            return _points(block, look)
        case Table():
            return _table(block, look, f"{anchor}-table-{number}")
        case Drawing() if look.page:
            return _drawing(block, look)
        case Code():
            return _code(block, look)
        case _:
            raise TypeError(f"Expected a block that a notebook shows, got a {block.kind}.")


def _checks(checks: Checks, look: Look, anchor: str) -> str:
    """A line for each check, its status marked by colour and named."""
    rows = []
    for status, name, text in checks.rows:
        if look.page:
            first = f"<td><span{look('status', status)}>{status}</span></td>"
            second = f'<th scope="row">{look.said(name, True)}</th>'
        else:
            first = f'<th scope="row"{look("status", status)}>{look.said(status)}</th>'
            second = f"<td{look('check')}>{look.said(name)}</td>"
        rows.append(f"<tr>{first}{second}<td{look('check')}>{look.said(text)}</td></tr>")
    named = f' class="checks" aria-labelledby="{anchor}-title"' if look.page else look("table")
    return f"<table{named}><tbody>{''.join(rows)}</tbody></table>"


def _points(points: Points, look: Look) -> str:
    items = []
    for k, item in enumerate(points.items):
        marked = look.page and k in points.marked
        tag = f'<strong class="tag">{look.tag}</strong> ' if marked else ""
        items.append(f"<li{look('marked item') if marked else ''}>{tag}{look.said(item)}</li>")
    return f"<ul{look('warnings') if points.marked else ''}>{''.join(items)}</ul>"


def _drawing(drawing: Drawing, look: Look) -> str:
    scene = f'<script type="application/json" class="scene">{drawing.scene}</script>' if drawing.scene else ""
    return (
        f'<figure id="figure-{drawing.stem}"{look("small") if drawing.small else ""}>'
        f'<div class="drawing" role="img" tabindex="0" aria-label="{look.said(drawing.alt)}">{drawing.svg}</div>'
        f"{scene}<figcaption>{look.said(drawing.caption)}</figcaption></figure>"
    )


def _code(code: Code, look: Look) -> str:
    if not look.page:
        return f"<pre{look('code')}>{look.said(code.text)}</pre>"
    title = look.said(code.title, True)
    button = f'<button type="button" class="copy" hidden aria-label="Copy {title}">Copy</button>'
    return (
        f'<div class="code"><div class="bar"><h3>{title}</h3>{button}</div>'
        f'<p class="note">{look.said(code.note, True)}</p><pre tabindex="0">{look.said(code.text, True)}</pre></div>'
    )


def _table(table: Table, look: Look, name: str) -> str:
    groups = "".join(
        f'<th scope="col" colspan="{count}"{look("cell")}>{look.said(title)}</th>'
        if title or not look.page
        else f'<td colspan="{count}"></td>'
        for title, count in table.groups
    )
    head = "".join(
        f'<th scope="col"{look("column of words" if left else "cell")}>{look.said(column)}</th>'
        if column or not look.page
        else "<td></td>"
        for left, column in ((not k or k in table.text_columns, name) for k, name in enumerate(table.columns))
    )
    if not look.page and not any(table.columns):
        head = ""
    top = "".join(f"<tr>{line}</tr>" for line in (groups, head) if line)
    body = "".join(
        f"<tr{look('marked') if k in table.marked else ''}>{_cells(row, table, look)}</tr>"
        for k, row in enumerate(table.rows)
        if row or look.page
    )
    inside = f"<thead>{top}</thead><tbody>{body}</tbody>"
    if not look.page:
        caption = f"<p{look('paragraph')}>{look.said(table.caption)}</p>" if table.caption else ""
        return f'{caption}<div style="overflow-x:auto"><table{look("table")}>{inside}</table></div>'
    kinds = f"{'short' if len(table.rows) <= 20 else ''}{' worded' if table.worded else ''}"
    return (
        f'<p class="caption" id="{name}">{look.said(table.caption)}</p>'
        f'<div class="scroll" role="region" tabindex="0" aria-labelledby="{name}">'
        f'<table class="{kinds}" aria-labelledby="{name}">{inside}</table></div>'
    )


def _cells(row: Sequence[Cell], table: Table, look: Look) -> str:
    cells = []
    for k, cell in enumerate(row):
        text, span = (cell, "") if isinstance(cell, str) else (cell[0], f' colspan="{cell[1]}"')
        left = bool(span) or k in table.text_columns or (k == 0 and table.named)
        said = look.said(text, table.verbatim and not span)
        if k == 0:
            cells.append(f'<th scope="row"{span}{look("name" if left else "number of a row")}>{said}</th>')
        else:
            kind = ("words long" if table.verbatim and not span else "words") if left else "number"
            cells.append(f"<td{look(kind)}{span}>{said}</td>")
    return "".join(cells)


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
# Red and blue of equal lightness that colour-blind readers can distinguish; the sign is printed, too.
_POSITIVE, _NEGATIVE = "213,94,0", "0,114,178"


@singledispatch
def html_of(result: Any) -> str:
    """The form of a result in notebooks; a topic registers what shows more than the text."""
    title = getattr(result, "title", "") or type(result).__name__
    return to_html(title, document_of(result), seen=getattr(result, "unfolded", 1))


def to_html(
    title: str, document: Document, *, beside: str = "", seen: int = 1, folded: Sequence[tuple[str, str]] = ()
) -> str:
    """The document below its title: the first groups, ``seen`` of them, and what looks wrong; the others folded away.

    ``folded`` are titles with the markup, trusted, that is folded away below them.
    """
    groups = list(groups_of(document))
    while seen < len(groups) and all(block.kind == Caution.kind for block in groups[seen]):
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
