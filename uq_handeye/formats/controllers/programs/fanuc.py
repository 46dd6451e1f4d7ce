"""Poses of FANUC: the section /POS of TP programs (``.ls``), and listings of position registers (``posreg.va``).

``P[1]{ GP1: UF : 0, UT : 1, CONFIG : 'N U T, 0, 0, 0', X = 100.000 mm, ..., W = ... deg, ... };`` in mm and degrees: W,
P, R about the fixed axes X, Y, Z. Source: FANUC Robot Controller Operator's Manual, "Position data" and "Position
registers". A position may hold joints instead (``J1 = 10.000 deg``). Further motion groups (``GP2:``, rails and
positioners) are no part of the pose.
"""

from __future__ import annotations

import re

from ....errors import InputError
from ...contents import Contents
from ..forms import CONTROLLERS
from ..tables import HELP
from .found import VALUE, Found, Lines, contents_of

_START = re.compile(r"\bP(?:R)?\s*\[\s*(\d+)[^\]\n]{0,80}\]\s*\{|^[ \t]*\[\s*\d+\s*,\s*(\d+)\s*\]\s*=", re.MULTILINE)
_PAIR = re.compile(rf"\b([XYZWPR])\s*[=:]\s*({VALUE})\s*(mm|cm|m|deg|rad|inch|in)?\b", re.IGNORECASE)
_GROUP = re.compile(r"\bGP[2-9]\s*:", re.IGNORECASE)
_TOOL = re.compile(r"\bUF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)", re.IGNORECASE)
_JOINT = re.compile(r"\bJ1\s*[=:]", re.IGNORECASE)
_NUMBERS = ("X", "Y", "Z", "W", "P", "R")
_IS_PROGRAM = re.compile(r"^[ \t]*/(?:PROG|POS)\b|\*POSREG\*|\bP(?:R)?\s*\[\s*\d+[^\]\n]{0,80}\]\s*\{", re.MULTILINE)
_COMMENT = re.compile(r"^[ \t]*(?:\d+[ \t]*:)?[ \t]*!.*$", re.MULTILINE)
_UNITS = {"mm": "mm", "cm": "cm", "m": "m", "inch": "in", "in": "in"}


def is_fanuc(head: str) -> bool:
    """Return whether a text is a TP program or a listing of position registers."""
    return bool(_IS_PROGRAM.search(head))


def read_fanuc(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    lines = Lines(text)
    text = _COMMENT.sub(lambda match: " " * len(match[0]), text)
    found = Found()
    section = re.search(r"^[ \t]*/POS\b", text, re.MULTILINE)
    starts = list(_START.finditer(text, 0 if section is None else section.end()))
    lengths: set[str] = set()
    empty = groups = 0
    for k, start in enumerate(starts):
        end = starts[k + 1].start() if k + 1 < len(starts) else len(text)
        block = text[start.end() : end]
        if (further := _GROUP.search(block)) is not None:
            groups += 1
            block = block[: further.start()]
        label = f"P[{start[1]}]" if start[1] else f"PR[{start[2]}]"
        line = lines.at(start.start())
        if _JOINT.search(block):
            found.joints += 1
            continue
        pairs = _PAIR.findall(block)
        values = {key.upper(): value for key, value, _ in pairs[:6]}
        if all(value.startswith("*") for value in values.values()):
            empty += 1
            continue
        if set(values) != set(_NUMBERS):
            missing = ", ".join(key for key in _NUMBERS if key not in values)
            raise InputError(
                f"{name}, line {line}: expected X, Y, Z, W, P, R of {label}, {missing} is missing; {HELP}."
            )
        units = {key.upper(): unit.lower() for key, _, unit in pairs[:6]}
        if any(units[key] not in ("", "deg") for key in "WPR"):
            raise InputError(f"{name}, line {line}: expected W, P, R of {label} in deg, got {units['W']}; {HELP}.")
        lengths |= {units[key] for key in "XYZ"}
        if (frame := _TOOL.search(block)) is not None:
            found.tools.append(f"UF {frame[1]}, UT {frame[2]}")
        found.add(line, label, [values[key] for key in _NUMBERS], name)
    if groups:
        found.notes.append(f"further motion groups (GP2 ...) of {groups} positions are not used")
    if empty:
        were = "1 position that was" if empty == 1 else f"{empty} positions that were"
        found.notes.append(f"{were} not taught left out")
    if len(lengths) > 1:
        got = ", ".join(unit or "none" for unit in sorted(lengths))
        raise InputError(f"{name}: expected one unit for all positions, got {got}; {HELP}.")
    length = _UNITS.get(lengths.pop()) if lengths else None
    return contents_of(found, name, CONTROLLERS["fanuc"], length)
