"""Transformation values of Kawasaki, ``.as`` files: the section ``.TRANS`` with ``p1 x y z o a t``, in mm and degrees.

O, A, T are Euler angles about Z, the new Y, the new Z. Source: Kawasaki, AS Language Reference Manual: transformation
values, SAVE, POINT, TRANS; the section ``.JOINTS`` and names with # hold joints.
"""

from __future__ import annotations

import re

from ...errors import InputError
from .program_text import VALUE, ProgramPoses, fields_of_list
from .tables import HELP

_LINE = re.compile(rf"\s*([#A-Za-z][\w.\[\],]*)\s+({VALUE}(?:[\s,]+{VALUE})*)\s*")
_TRANS = re.compile(rf"\b(\w+)\s*=\s*TRANS\s*\(\s*({VALUE}(?:\s*,\s*{VALUE}){{5}})\s*\)", re.IGNORECASE)
IS_KAWASAKI = re.compile(r"^[ \t]*\.(?:TRANS|JOINTS|PROGRAM)\b|=\s*TRANS\s*\(", re.MULTILINE | re.IGNORECASE)


def add_kawasaki_poses(found: ProgramPoses) -> None:
    """Add the poses of a text of Kawasaki."""
    section = ""
    for number, line in enumerate(found.text.splitlines(), start=1):
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
        if len(values) < 6:
            raise InputError(
                f"{found.name}, line {number}: expected a name and x y z o a t in the section .TRANS, got "
                f"{content.strip()[:60]!r}; {HELP}."
            )
        found.add(number, match, values[:6])
    for match in _TRANS.finditer(found.text):
        found.add(found.line(match.start()), match, fields_of_list(match[2]))
