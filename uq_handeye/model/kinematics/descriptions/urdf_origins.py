"""A URDF with other origins of some joints: the rest of the text stays as it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from xml.parsers import expat
from xml.sax.saxutils import escape

from ....core.files.open import StrPath
from ....core.geometry.se3 import Array
from .urdf import read_tree, urdf_text


class Placed(NamedTuple):
    """An ``<origin>``."""

    xyz: Array  # (3,) m
    rpy: Array  # (3,) rad, about the fixed axes x, y, z

    @property
    def attributes(self) -> str:
        xyz, rpy = (" ".join(f"{value:.17g}" for value in values) for values in self)
        return f'xyz="{xyz}" rpy="{rpy}"'


def with_origins(path_or_text: StrPath, origins: Mapping[str, Placed], comment: str = "") -> str:
    """Return the text of a URDF with these origins of joints, by name, and a comment in front of ``<robot>``.

    Raises `InputError` as `urdf.read_tree`, for the same files.
    """
    read_tree(path_or_text)  # refuses what is no URDF, document types and entities
    data = urdf_text(path_or_text)[0].encode()
    parser = expat.ParserCreate("UTF-8")
    stack: list[tuple[str, str]] = []
    edits: list[tuple[int, int, str]] = []  # first byte, end, what takes its place
    waiting: dict[str, int] = {}  # joints without an origin so far: the end of their start tag

    def start(tag: str, attributes: dict[str, str]) -> None:
        here = parser.CurrentByteIndex
        stack.append((tag, attributes.get("name", "")))
        if not stack[:-1] and comment:
            edits.append((here, here, f"<!-- {escape(comment).replace('--', '- -')} -->\n"))
        depth, joint = len(stack), stack[1][1] if len(stack) > 1 and stack[1][0] == "joint" else ""
        if joint not in origins:
            return
        if depth == 2:
            waiting[joint] = _end_of_tag(data, here)
        elif depth == 3 and tag == "origin":
            end = _end_of_tag(data, here)
            closing = "/>" if data[end - 2 : end] == b"/>" else ">"
            edits.append((here, end, f"<origin {origins[joint].attributes}{closing}"))
            del waiting[joint]

    def end(tag: str) -> None:
        if len(stack) == 2 and tag == "joint" and (at := waiting.pop(stack[1][1], None)) is not None:
            edits.append((at, at, f"\n    <origin {origins[stack[1][1]].attributes}/>"))
        stack.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)
    for first, last, text in sorted(edits, reverse=True):
        data = data[:first] + text.encode() + data[last:]
    return data.decode()


def _end_of_tag(data: bytes, at: int) -> int:
    """Return where the tag that starts at a byte ends: a ``>`` outside of quotes."""
    quote = b""
    for k in range(at, len(data)):
        byte = data[k : k + 1]
        if quote:
            quote = b"" if byte == quote else quote
        elif byte in (b'"', b"'"):
            quote = byte
        elif byte == b">":
            return k + 1
    return len(data)
