"""Poses of KUKA's ``.dat`` and ``.src`` files: ``DECL E6POS XP1={X 100.0,Y 0.0,Z 500.0,A 0.0,B 90.0,C 0.0,...}``.

Millimetres and degrees: A about Z, B about the new Y, C about the new X. Source: KUKA System Software, Operating and
Programming Instructions for System Integrators: structures FRAME, POS and E6POS; AXIS and E6AXIS hold joints. The
frames of tools and bases (``$TOOL``, ``BASE_DATA`` ...) are no poses; ``$POS_ACT`` of a log is one.
"""

from __future__ import annotations

import re

from .program_text import VALUE, ProgramPoses

_STRUCTURE = re.compile(r"\{([^{}]*)\}")
_KUKA_PAIR = re.compile(rf"\b([A-Z]\w*)(?:\s*[:=]\s*|\s+)({VALUE})", re.IGNORECASE)
# A comma that parts two fields has a name behind it.
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_NAME = re.compile(r"([$\w]+)(?:\s*\[[\d,\s]*\])?\s*=\s*(?:E6POS|POS|FRAME)?\s*:?\s*$", re.IGNORECASE)
_FRAMES = re.compile(r"\bFDAT\s+F(\w+)\s*=\s*\{TOOL_NO\s+(\d+)\s*,\s*BASE_NO\s+(\d+)", re.IGNORECASE)
_NO_POSES = re.compile(r"^\$(?!POS_|AXIS_|TCP)|TOOL|BASE(?!_T_)|LOAD|WORLD|^ROBROOT", re.IGNORECASE)


def is_kuka(head: str) -> bool:
    """Return whether a text holds structures of poses or joints in KRL."""
    if re.search(r"\bE6AXIS\b", head, re.IGNORECASE):
        return True
    if head.lstrip().startswith(("{", "[")) and ":" in head[:200] and '"' in head[:200]:
        return False  # JSON
    structures = ({key.upper() for key, _ in _KUKA_PAIR.findall(one[1])} for one in _STRUCTURE.finditer(head))
    return any({"X", "A"} <= keys or {"A1", "A2"} <= keys for keys in structures)


def add_kuka_poses(found: ProgramPoses) -> None:
    """Add the poses of a text of KUKA."""
    frames = {label.upper(): f"TOOL_NO {tool}, BASE_NO {base}" for label, tool, base in _FRAMES.findall(found.text)}
    parts = others = 0
    for match in _STRUCTURE.finditer(found.text):
        before = found.before(match)
        content = _DECIMAL_COMMA.sub(".", match[1])
        values = {key.upper(): value for key, value in _KUKA_PAIR.findall(content)}
        if before.lstrip().startswith(";"):
            continue
        if {"A1", "A2"} <= values.keys():
            found.joints += 1
            continue
        if not set("XYZABC") & values.keys():
            continue
        label = _NAME.search(before)
        taught = re.search(r"\b(?:E6)?POS\s+\S*\s*=?\s*$", before, re.IGNORECASE) is not None
        if label is not None and not taught and _NO_POSES.search(label[1]):
            others += 1
        elif not set("XYZABC") <= values.keys() or "_REL" in before.upper():
            parts += 1
        else:
            if label is not None and (frame := frames.get(label[1][1:].upper())) is not None:  # XP1 and FP1
                found.tools.append(frame)
            found.add(found.line(match.start()), label, [values[key] for key in "XYZABC"])
    found.note(parts, "relative or incomplete frames (not all of X, Y, Z, A, B, C) are left out")
    found.note(others, "frames of tools and bases are left out")
