"""Poses of ABB: robtargets in modules (``.mod``, ``.sys``, ``.prg``) and in logs of CRobT.

``CONST robtarget p10:=[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[9E9,...]];`` in mm, with the scalar of the quaternion
first. Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types: robtarget, pose, pos,
orient, CRobT. Data of tools, work objects and loads hold frames as well, which are no poses of the robot; jointtarget
holds joints.
"""

from __future__ import annotations

import re

from ...contents import Contents
from ..forms import CONTROLLERS
from .found import VALUE, Found, Lines, contents_of

_THREE = rf"\[\s*({VALUE}(?:\s*,\s*{VALUE}){{2}})\s*\]"
_FOUR = rf"\[\s*({VALUE}(?:\s*,\s*{VALUE}){{3}})\s*\]"
_POSE = re.compile(rf"{_THREE}[ \t]*[,;]?\s*(?:(?:rot|ori|orient|orientation|quat|q)\s*[:=]\s*)?{_FOUR}", re.IGNORECASE)
_LABEL = re.compile(r"([A-Za-z]\w*)(?:\{[\d,]*\})?$")
_OTHER_DATA = re.compile(r"\b(?:tooldata|wobjdata|loaddata)\b", re.IGNORECASE)
_JOINTS = re.compile(r"\bjointtarget\s+\w+[^:=;\n]*:=|\bMoveAbsJ\b", re.IGNORECASE)
_COMMENT = re.compile(r"^[^\"!\n]*(?:\"[^\"\n]*\"[^\"!\n]*)*!(.*)$", re.MULTILINE)
# Tool and work object at the end of a movement, and a movement to a named position.
_END = re.compile(r",\s*([A-Za-z]\w*)\s*(?:\\\s*WObj\s*:=\s*(\w+))?\s*;", re.IGNORECASE)
_MOVE = re.compile(rf"\bMove[LJC]\s+([A-Za-z]\w*)\s*,[^;\n]{{0,400}}?{_END.pattern}", re.IGNORECASE)
_DECLARED = re.compile(r"\brobtarget\b|\bCRobT\b|\bMove[LJC]\s+\[\s*\[", re.IGNORECASE)


def is_abb(head: str) -> bool:
    """Return whether a text declares robtargets or joint targets, or is a log of CRobT."""
    return bool(_DECLARED.search(head) or _JOINTS.search(head))


def has_lists(head: str) -> bool:
    """Return whether a text holds poses as ``[x, y, z], [four numbers]``, whoever wrote them."""
    return not head.lstrip().startswith(("{", "<")) and bool(_POSE.search(head))


def read_abb(text: str, name: str, sure: bool = True) -> Contents:
    """Return the poses of a text; unless ``sure``, the order of the quaternion is open."""
    lines = Lines(text)
    found = Found(joints=len(_JOINTS.findall(text)))
    text = _COMMENT.sub(lambda match: match[0][: match.start(1) - match.start(0)] + " " * len(match[1]), text)
    moved = {match[1]: match.group(0, 2, 3) for match in _MOVE.finditer(text)}
    others = 0
    for match in _POSE.finditer(text):
        start = text.rfind(";", 0, match.start()) + 1
        before = text[max(start, match.start() - 300) : match.start()]
        if _OTHER_DATA.search(before):
            others += 1
            continue
        label = _LABEL.search(before.rstrip("[:= \t\n")[-80:])
        values = [value.strip() for value in f"{match[1]},{match[2]}".split(",")]
        end = _END.search(text, match.end(), match.end() + 400)
        tool = moved.get("" if label is None else label[1]) or (
            None if end is None or "move" not in before.lower() else end
        )
        if tool is not None:
            found.tools.append(f"{tool[1]}, {tool[2] or 'wobj0'}")
        found.add(lines.at(match.start()), "" if label is None else label[1], values, name)
    if others:
        found.notes.append(f"{others} frames of tools and work objects are left out")
    return contents_of(found, name, CONTROLLERS["abb"], sure=sure)
