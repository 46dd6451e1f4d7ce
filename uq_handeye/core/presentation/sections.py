"""One list of sections of a result, of which every output shows some.

The list has all facts of a result in one order. A `Part` is made into a `Section` only where an output selects it, so
that a terminal does not wait for what only a page shows. Text, page, certificate and notebook name the sections that
they show by their anchors.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import NamedTuple

from .document import Block, Document, Heading, Paragraph, Section


class Part(NamedTuple):
    """A section of a result that has not been made yet."""

    anchor: str
    title: str
    blocks: Callable[[], Sequence[Block]]


def selected(
    parts: Iterable[Part], anchors: Collection[str], *, folded: bool = False, wide: bool = False
) -> list[Section]:
    """Return the sections of these anchors, in the order of the list; those without content are left out."""
    found = (Section(one.anchor, one.title, one.blocks(), folded, wide) for one in parts if one.anchor in anchors)
    return [section for section in found if section.blocks]


def text_of(sections: Iterable[Section], untitled: Collection[str] = ()) -> Document:
    """Return sections as a document, without those that only say why something is missing.

    Sections whose anchors are ``untitled`` have no heading.
    """
    return [
        [*([] if section.anchor in untitled else [Heading(f"{section.title}:")]), *section.blocks]
        for section in sections
        if not all(isinstance(block, Paragraph) and block.empty for block in section.blocks)
    ]
