"""Transformation values of Kawasaki, ``.as`` files: the section ``.TRANS`` with ``p1 x y z o a t``, in mm and degrees.

O, A, T are Euler angles about Z, the new Y, the new Z. Source: Kawasaki, AS Language Reference Manual: transformation
values, SAVE, POINT, TRANS; the section ``.JOINTS`` and names with # hold joints.
"""

from __future__ import annotations

import re

from ....errors import InputError
from ...contents import Contents
from ..forms import CONTROLLERS
from ..tables import HELP
from .found import VALUE, Found, Lines, contents_of

_LINE = re.compile(rf"\s*([#A-Za-z][\w.\[\],]*)\s+({VALUE}(?:[\s,]+{VALUE})*)\s*")
_TRANS = re.compile(rf"\b(\w+)\s*=\s*TRANS\s*\(\s*({VALUE}(?:\s*,\s*{VALUE}){{5}})\s*\)", re.IGNORECASE)
_IS_PROGRAM = re.compile(r"^[ \t]*\.(?:TRANS|JOINTS|PROGRAM)\b|=\s*TRANS\s*\(", re.MULTILINE | re.IGNORECASE)


def is_kawasaki(head: str) -> bool:
    """Return whether a text has sections of transformation values or joints, or calls TRANS()."""
    return bool(_IS_PROGRAM.search(head))


def read_kawasaki(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    found = Found()
    lines = Lines(text)
    section = ""
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.partition(";")[0].rstrip()
        if content.lstrip().startswith("."):
            section = content.strip().split()[0].split("(")[0].upper()
            continue
        if section not in (".TRANS", ".JOINTS") or not content:
            continue
        match = _LINE.fullmatch(content)
        if section == ".JOINTS" or content.lstrip().startswith("#"):
            found.joints += 1
            continue
        values = [] if match is None else re.split(r"[\s,]+", match[2])
        if match is None or len(values) < 6:
            raise InputError(
                f"{name}, line {number}: expected a name and x y z o a t in the section .TRANS, got "
                f"{content.strip()[:60]!r}; {HELP}."
            )
        found.add(number, match[1], values[:6], name)
    for match in _TRANS.finditer(text):
        values = [value.strip() for value in match[2].split(",")]
        found.add(lines.at(match.start()), match[1], values, name)
    return contents_of(found, name, CONTROLLERS["kawasaki"])
