"""Poses of Staubli: data files of VAL 3 (``.dtx``), and poses in text, ``{x, y, z, rx, ry, rz}``, in mm and degrees.

Rotations about X, the new Y, the new Z. Source: Staubli, VAL 3 Reference Manual, types trsf, point (pointRx) and frame;
in a ``.dtx`` the fields of a value that are 0 may be left out. Data of the types tool, frame and world hold no poses of
the robot, jointRx holds joints.
"""

from __future__ import annotations

import re

from .program_text import VALUE, ProgramPoses, fields_of_list

_STAUBLI_NUMBERS = ("x", "y", "z", "rx", "ry", "rz")
_TAG = re.compile(r"<(/?)([A-Za-z_][\w:]*)([^<>]*?)(/?)>")
_ATTRIBUTE = re.compile(r"""(?<![\w:])([\w:]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_POINTS = ("point", "pointrx", "trsf", "pointrs")
BRACES = re.compile(rf"\{{\s*({VALUE}(?:\s*[,;]\s*{VALUE}){{5}})\s*\}}")
_WORDS = re.compile(
    r"\b(?:trsf|pointRx|point|shoulder|[rl]efty|righty|[se]?free|ssame|epositive|enegative)\b", re.IGNORECASE
)
_STAUBLI_LABEL = re.compile(r"([A-Za-z]\w*)(?:\[\d*\])?(?:\.trsf)?\s*=?\s*\{?\s*$")
_FIELDS = re.compile(r"""<[^<>]*\brx\s*=\s*["'][^<>]*\bry\s*=|<[^<>]*\bx\s*=\s*["'][^<>]*\brz?\s*=""")


def is_staubli(head: str) -> bool:
    """Return whether a text is data of VAL 3, or holds poses in braces."""
    if head.lstrip().startswith("<"):
        small = head[:4096].lower()
        return "val3" in small or "staubli" in small or bool(_FIELDS.search(head, 0, 65_536))
    return bool(BRACES.search(head) and _WORDS.search(head))


def add_staubli_poses(found: ProgramPoses) -> None:
    """Add the poses of a text of Staubli."""
    if found.text.lstrip().startswith("<"):
        return _staubli_data(found)
    for match in BRACES.finditer(found.text):
        before = found.before(match)
        if not before.lstrip().startswith("//"):
            found.add(found.line(match.start()), _STAUBLI_LABEL.search(before), fields_of_list(match[1]))


def _staubli_data(found: ProgramPoses) -> None:
    """Add the values of the points of a ``.dtx``."""
    label, kind = "", ""
    others = completed = 0
    for match in _TAG.finditer(found.text):
        if match[1]:
            continue
        fields = {key.lower().removeprefix("xsi:"): a or b for key, a, b in _ATTRIBUTE.findall(match[3])}
        tag = match[2].lower()
        label = fields.get("name", label)
        if tag == "data":
            kind = fields.get("type", "").lower()
            kind = fields.get("datatype", kind).lower() if kind in ("array", "element", "collection") else kind
            types = re.findall(r"""\btype\s*=\s*["']([\w:]+)["']""", match[3])
            kind = next((one.lower() for one in types if one.lower() not in ("array", "element", "collection")), kind)
        elif "j1" in fields and "j2" in fields:
            found.joints += 1
        elif set(_STAUBLI_NUMBERS) & fields.keys() or (tag == "value" and kind in _POINTS):
            if kind and kind not in _POINTS:
                others += 1
                continue
            completed += not set(_STAUBLI_NUMBERS) <= fields.keys()
            where = f"{label}[{fields['key']}]" if "key" in fields else label
            values = [fields.get(key, "0").strip() for key in _STAUBLI_NUMBERS]
            found.add(found.line(match.start()), None, values, where)
    found.note(others, "values of tools, frames and others are left out")
    found.note(completed, "points lack fields, which are 0")
