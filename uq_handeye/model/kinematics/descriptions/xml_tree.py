"""Elements of an XML file about a robot, with the lines on which they begin.

Nothing in a file can run or grow: document types and entities are refused, and levels and elements are bounded.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple
from xml.parsers import expat

from ....errors import InputError

MAX_PARTS = 100_000


class Element(NamedTuple):
    """An element of the file, and the line that it begins on."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element]


def xml_tree(text: str, where: str, max_levels: int, check: Callable[[str, bool, str], None]) -> Element:
    """Return the root of a file; raises `InputError` for what is no XML, or too large.

    ``check`` is called with the tag of each element, whether it is the root, and its place in words.
    """
    parser = expat.ParserCreate()
    stack: list[Element] = []
    root: list[Element] = []
    count = 0

    def at() -> str:
        return f"{where}, line {parser.CurrentLineNumber}"

    def refuse(*_: object) -> None:
        raise InputError(f"{at()}: expected XML without a document type or entities.")

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        check(tag, not stack, at())
        if len(stack) >= max_levels:
            raise InputError(f"{at()}: expected at most {max_levels} levels, got more.")
        if count > MAX_PARTS:
            raise InputError(f"{at()}: expected at most {MAX_PARTS} elements, got more.")
        element = Element(tag, attributes, parser.CurrentLineNumber, [])
        (stack[-1].children if stack else root).append(element)
        stack.append(element)

    def end(_: str) -> None:
        stack.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        problem = expat.errors.messages[error.code]
        raise InputError(f"{where}, line {error.lineno}: not XML: {problem}.") from error
    return root[0]
