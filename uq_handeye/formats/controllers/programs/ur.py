"""Poses in programs and logs of Universal Robots: ``p[x, y, z, rx, ry, rz]``, in m and as a rotation vector in rad.

Source: Universal Robots, The URScript Programming Language, "Types" and "Module motion": a pose is
``p[x, y, z, ax, ay, az]``, where ax, ay, az is a rotation vector; ``movej([...])`` and ``get_inverse_kin`` have joints.
"""

from __future__ import annotations

import re

from ...contents import Contents
from ..forms import CONTROLLERS
from .found import VALUE, Found, Lines, contents_of

_POSE = re.compile(rf"\bp\s*\[\s*({VALUE}(?:\s*,\s*{VALUE}){{5}})\s*\]")
_BEGUN = re.compile(r"\bp\s*\[")
_LABEL = re.compile(r"(\w+)\s*=\s*$")
# Frames that each program of PolyScope declares.
_FEATURE = re.compile(r"(?:Base|Tool)(?:_\d+)?")
_JOINTS = re.compile(r"\b(?:movej|servoj)\s*\(\s*\[")


def is_ur(head: str) -> bool:
    """Return whether a text holds poses of URScript, or is a program of joint targets."""
    return bool(_POSE.search(head) or _JOINTS.search(head))


def read_ur(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    lines = Lines(text)
    found = Found(joints=len(_JOINTS.findall(text)))
    features = 0
    for match in _POSE.finditer(text):
        before = text[max(0, match.start() - 80) : match.start()]
        if before.rpartition("\n")[2].lstrip().startswith("#") or re.search(r"set_tcp\s*\(\s*$", before):
            continue
        label = _LABEL.search(before)
        if label is not None and _FEATURE.fullmatch(label[1]):
            features += 1
            continue
        values = [value.strip() for value in match[1].split(",")]
        found.add(lines.at(match.start()), "" if label is None else label[1], values, name)
    if features:
        found.notes.append(f"{features} features (Base, Tool) are left out")
    left = len(_BEGUN.findall(text)) - len(_POSE.findall(text))
    if left:
        found.notes.append(f"{left} times p[ without six numbers is left out")
    return contents_of(found, name, CONTROLLERS["ur"])
