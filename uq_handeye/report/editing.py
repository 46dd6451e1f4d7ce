"""Editing of a report: repeated sentences are removed, advice with code moves to the section on repeating the run."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from ..core.presentation.document import Block, Paragraph, Points, Section

# Sections for those who repeat the run or take X into their software.
FOR_PROGRAMMERS = ("forms", "repeat")
# The section with the answer, which keeps its advice.
ANSWER = "answer"
ADVICE = "Advice for repeating the run:"
# An option, an argument, a call, or an attribute of a result.
_CODE = re.compile(
    r"(?<![\w-])--[a-z]|\b[a-z_]+=[\w\"'\[(]|\b(?:calibrate|compare|report|[a-z]+_[a-z_]+)\(|\bresult\.[a-z_]+\b"
)
_BETWEEN = re.compile(r"(?<=[.!?]) (?=[A-Z])")


def _sentences(block: Block) -> list[str]:
    return [text for text in _BETWEEN.split(block.text) if len(text) > 40] if isinstance(block, Paragraph) else []


def edited(pages: Sequence[Sequence[Section]]) -> list[list[Section]]:
    """Return the sections without sentences that occur in earlier ones, and but for the answer without code.

    Sentences with options of the command or arguments of functions are moved to the section "repeat", if there is one.
    """
    said: set[str] = set()
    advice: list[str] = []

    def kept(text: str) -> str:
        """Return the sentences that have not occurred yet and hold no code."""
        found = []
        for sentence in _BETWEEN.split(text):
            if _CODE.search(sentence):
                advice.append(sentence)
            elif sentence not in said:
                found.append(sentence)
        said.update(sentence for sentence in found if len(sentence) > 40)
        return " ".join(found)

    def of_block(block: Block) -> list[Block]:
        match block:
            case Paragraph(empty=False):
                text = kept(block.text)
                return [replace(block, text=text)] if text else []
            case Points():
                items = [(text, k in block.marked) for k, item in enumerate(block.items) if (text := kept(item))]
                marked = frozenset(k for k, (_, stands_out) in enumerate(items) if stands_out)
                return [Points([text for text, _ in items], marked)] if items else []
        return [block]

    def of_section(section: Section) -> Section:
        if section.anchor == ANSWER:  # with its advice, whatever it holds
            said.update(text for block in section.blocks for text in _sentences(block))
        if section.anchor in (*FOR_PROGRAMMERS, ANSWER):
            return section
        return replace(section, blocks=[part for block in section.blocks for part in of_block(block)])

    found = [[of_section(section) for section in page] for page in pages]
    extra = [Paragraph(ADVICE), Points(list(dict.fromkeys(advice)))] if advice else []
    return [
        [replace(s, blocks=[*s.blocks, *extra]) if s.anchor == "repeat" else s for s in sections] for sections in found
    ]
