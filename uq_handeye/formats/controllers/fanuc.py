"""Poses of FANUC: the section /POS of TP programs (``.ls``), and listings of position registers (``posreg.va``).

``P[1]{ GP1: UF : 0, UT : 1, CONFIG : 'N U T, 0, 0, 0', X = 100.000 mm, ..., W = ... deg, ... };`` in mm and degrees: W,
P, R about the fixed axes X, Y, Z. Source: FANUC Robot Controller Operator's Manual, "Position data" and "Position
registers". A position may hold joints instead (``J1 = 10.000 deg``). Further motion groups (``GP2:``, rails and
positioners) are no part of the pose.
"""

from __future__ import annotations

import re

from ...errors import InputError
from .program_text import VALUE, ProgramPoses
from .tables import HELP

_START = re.compile(r"\bP(?:R)?\s*\[\s*(\d+)[^\]\n]{0,80}\]\s*\{|^[ \t]*\[\s*\d+\s*,\s*(\d+)\s*\]\s*=", re.MULTILINE)
_FANUC_PAIR = re.compile(rf"\b([XYZWPR])\s*[=:]\s*({VALUE})\s*(mm|cm|m|deg|rad|inch|in)?\b", re.IGNORECASE)
_GROUP = re.compile(r"\bGP[2-9]\s*:", re.IGNORECASE)
_TOOL = re.compile(r"\bUF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)", re.IGNORECASE)
_JOINT = re.compile(r"\bJ1\s*[=:]", re.IGNORECASE)
IS_FANUC = re.compile(r"^[ \t]*/(?:PROG|POS)\b|\*POSREG\*|\bP(?:R)?\s*\[\s*\d+[^\]\n]{0,80}\]\s*\{", re.MULTILINE)
_FANUC_COMMENT = re.compile(r"^[ \t]*(?:\d+[ \t]*:)?[ \t]*!.*$", re.MULTILINE)


def add_fanuc_poses(found: ProgramPoses) -> str | None:
    """Return the length unit that the positions say."""
    text = _FANUC_COMMENT.sub(lambda match: " " * len(match[0]), found.text)
    section = re.search(r"^[ \t]*/POS\b", text, re.MULTILINE)
    starts = list(_START.finditer(text, 0 if section is None else section.end()))
    lengths: set[str] = set()
    empty = groups = 0
    for k, start in enumerate(starts):
        block = text[start.end() : starts[k + 1].start() if k + 1 < len(starts) else len(text)]
        if (further := _GROUP.search(block)) is not None:
            groups += 1
            block = block[: further.start()]
        if _JOINT.search(block):
            found.joints += 1
            continue
        label = f"P[{start[1]}]" if start[1] else f"PR[{start[2]}]"
        line = found.line(start.start())
        pairs = {key.upper(): (value, unit.lower()) for key, value, unit in _FANUC_PAIR.findall(block)[:6]}
        if all(value.startswith("*") for value, _ in pairs.values()):
            empty += 1
            continue
        if missing := [key for key in "XYZWPR" if key not in pairs]:
            raise InputError(
                f"{found.name}, line {line}: expected X, Y, Z, W, P, R of {label}, {', '.join(missing)} is missing; "
                f"{HELP}."
            )
        if any(pairs[key][1] not in ("", "deg") for key in "WPR"):
            got = pairs["W"][1]
            raise InputError(f"{found.name}, line {line}: expected W, P, R of {label} in deg, got {got}; {HELP}.")
        lengths |= {pairs[key][1] for key in "XYZ"}
        if (frame := _TOOL.search(block)) is not None:
            found.tools.append(f"UF {frame[1]}, UT {frame[2]}")
        found.add(line, None, [pairs[key][0] for key in "XYZWPR"], label)
    if groups:
        found.notes.append(f"further motion groups (GP2 ...) of {groups} positions are not used")
    found.note(empty, f"position{' that was' if empty == 1 else 's that were'} not taught left out")
    if len(lengths) > 1:
        units = ", ".join(unit or "none" for unit in sorted(lengths))
        raise InputError(f"{found.name}: expected one unit for all positions, got {units}; {HELP}.")
    return {"mm": "mm", "cm": "cm", "m": "m", "inch": "in", "in": "in"}.get(lengths.pop()) if lengths else None
