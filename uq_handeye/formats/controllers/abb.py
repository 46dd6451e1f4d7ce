"""Poses of ABB: robtargets in modules (``.mod``, ``.sys``, ``.prg``) and in logs of CRobT.

``CONST robtarget p10:=[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[9E9,...]];`` in mm, with the scalar of the quaternion
first. Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types: robtarget, pose, pos,
orient, CRobT. Data of tools, work objects and loads hold frames as well, which are no poses of the robot; jointtarget
holds joints.
"""

from __future__ import annotations

import re

from .program_text import VALUE, ProgramPoses, fields_of_list

_THREE = rf"\[\s*({VALUE}(?:\s*,\s*{VALUE}){{2}})\s*\]"
_FOUR = rf"\[\s*({VALUE}(?:\s*,\s*{VALUE}){{3}})\s*\]"
_ABB_POSE = re.compile(
    rf"{_THREE}[ \t]*[,;]?\s*(?:(?:rot|ori|orient|orientation|quat|q)\s*[:=]\s*)?{_FOUR}", re.IGNORECASE
)
_ABB_LABEL = re.compile(r"([A-Za-z]\w*)(?:\{[\d,]*\})?$")
_OTHER_DATA = re.compile(r"\b(?:tooldata|wobjdata|loaddata)\b", re.IGNORECASE)
_ABB_JOINTS = re.compile(r"\bjointtarget\s+\w+[^:=;\n]*:=|\bMoveAbsJ\b", re.IGNORECASE)
_ABB_COMMENT = re.compile(r"^[^\"!\n]*(?:\"[^\"\n]*\"[^\"!\n]*)*!(.*)$", re.MULTILINE)
# Tool and work object at the end of a movement, and a movement to a named position.
_END = re.compile(r",\s*([A-Za-z]\w*)\s*(?:\\\s*WObj\s*:=\s*(\w+))?\s*;", re.IGNORECASE)
_MOVE = re.compile(rf"\bMove[LJC]\s+([A-Za-z]\w*)\s*,[^;\n]{{0,400}}?{_END.pattern}", re.IGNORECASE)
IS_ABB = re.compile(rf"\brobtarget\b|\bCRobT\b|\bMove[LJC]\s+\[\s*\[|{_ABB_JOINTS.pattern}", re.IGNORECASE)


def has_lists(head: str) -> bool:
    """Return whether a text holds poses as ``[x, y, z], [four numbers]``, whoever wrote them."""
    return not head.lstrip().startswith(("{", "<")) and bool(_ABB_POSE.search(head))


def add_abb_poses(found: ProgramPoses) -> None:
    """Add the poses of a text of ABB."""
    found.joints = len(_ABB_JOINTS.findall(found.text))
    text = _ABB_COMMENT.sub(lambda one: one[0][: one.start(1) - one.start(0)] + " " * len(one[1]), found.text)
    moved = {match[1]: match.group(0, 2, 3) for match in _MOVE.finditer(text)}
    others = 0
    for match in _ABB_POSE.finditer(text):
        start = text.rfind(";", 0, match.start()) + 1
        before = text[max(start, match.start() - 300) : match.start()]
        if _OTHER_DATA.search(before):
            others += 1
            continue
        label = _ABB_LABEL.search(before.rstrip("[:= \t\n")[-80:])
        end = _END.search(text, match.end(), match.end() + 400) if "move" in before.lower() else None
        if (tool := moved.get("" if label is None else label[1]) or end) is not None:
            found.tools.append(f"{tool[1]}, {tool[2] or 'wobj0'}")
        found.add(found.line(match.start()), label, fields_of_list(f"{match[1]},{match[2]}"))
    found.note(others, "frames of tools and work objects are left out")
