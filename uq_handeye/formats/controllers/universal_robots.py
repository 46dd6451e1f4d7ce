"""Poses in programs and logs of Universal Robots: ``p[x, y, z, rx, ry, rz]``, in m and as a rotation vector in rad.

Source: Universal Robots, The URScript Programming Language, "Types" and "Module motion": a pose is
``p[x, y, z, ax, ay, az]``, where ax, ay, az is a rotation vector; ``movej([...])`` and ``get_inverse_kin`` have joints.
"""

from __future__ import annotations

import re

from .program_text import VALUE, ProgramPoses, fields_of_list

_UR_POSE = re.compile(rf"\bp\s*\[\s*({VALUE}(?:\s*,\s*{VALUE}){{5}})\s*\]")
_UR_LABEL = re.compile(r"(\w+)\s*=\s*$")
# Frames that each program of PolyScope declares.
_FEATURE = re.compile(r"(?:Base|Tool)(?:_\d+)?")
_UR_JOINTS = re.compile(r"\b(?:movej|servoj)\s*\(\s*\[")
IS_UR = re.compile(rf"{_UR_POSE.pattern}|{_UR_JOINTS.pattern}")


def add_ur_poses(found: ProgramPoses) -> None:
    """Add the poses of a text of Universal Robots."""
    found.joints = len(_UR_JOINTS.findall(found.text))
    features = whole = 0
    for match in _UR_POSE.finditer(found.text):
        whole += 1
        before = found.before(match)
        if before.lstrip().startswith("#") or re.search(r"set_tcp\s*\(\s*$", before):
            continue
        label = _UR_LABEL.search(before)
        if label is not None and _FEATURE.fullmatch(label[1]):
            features += 1
            continue
        found.add(found.line(match.start()), label, fields_of_list(match[1]))
    found.note(features, "features (Base, Tool) are left out")
    found.note(len(re.findall(r"\bp\s*\[", found.text)) - whole, "times p[ without six numbers is left out")
