"""Poses of Staubli: data files of VAL 3 (``.dtx``), and poses in text, ``{x, y, z, rx, ry, rz}``, in mm and degrees.

Rotations about X, the new Y, the new Z. Source: Staubli, VAL 3 Reference Manual, types trsf, point (pointRx) and frame;
in a ``.dtx`` the fields of a value that are 0 may be left out. Data of the types tool, frame and world hold no poses of
the robot, jointRx holds joints.
"""

from __future__ import annotations

import re

from ...contents import Contents
from ..forms import CONTROLLERS
from .found import VALUE, Found, Lines, contents_of

_NUMBERS = ("x", "y", "z", "rx", "ry", "rz")
_TAG = re.compile(r"<(/?)([A-Za-z_][\w:]*)([^<>]*?)(/?)>")
_ATTRIBUTE = re.compile(r"""(?<![\w:])([\w:]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_POINTS = ("point", "pointrx", "trsf", "pointrs")
_BRACES = re.compile(rf"\{{\s*({VALUE}(?:\s*[,;]\s*{VALUE}){{5}})\s*\}}")
_WORDS = re.compile(
    r"\b(?:trsf|pointRx|point|shoulder|[rl]efty|righty|[se]?free|ssame|epositive|enegative)\b", re.IGNORECASE
)
_LABEL = re.compile(r"([A-Za-z]\w*)(?:\[\d*\])?(?:\.trsf)?\s*=?\s*\{?\s*$")
_FIELDS = re.compile(r"""<[^<>]*\brx\s*=\s*["'][^<>]*\bry\s*=|<[^<>]*\bx\s*=\s*["'][^<>]*\brz?\s*=""")


def is_staubli(head: str) -> bool:
    """Return whether a text is data of VAL 3, or holds poses in braces."""
    if head.lstrip().startswith("<"):
        small = head[:4096].lower()
        return "val3" in small or "staubli" in small or bool(_FIELDS.search(head, 0, 65_536))
    return bool(_BRACES.search(head) and _WORDS.search(head))


def has_braces(head: str) -> bool:
    """Return whether a text holds six numbers in braces, whoever wrote them."""
    return bool(_BRACES.search(head))


def read_staubli(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    found = Found()
    lines = Lines(text)
    if text.lstrip().startswith("<"):
        _read_data(text, name, lines, found)
    else:
        for match in _BRACES.finditer(text):
            before = text[text.rfind("\n", 0, match.start()) + 1 : match.start()][-80:]
            if before.lstrip().startswith("//"):
                continue
            label = _LABEL.search(before)
            values = [value.strip() for value in re.split("[,;]", match[1])]
            found.add(lines.at(match.start()), "" if label is None else label[1], values, name)
    return contents_of(found, name, CONTROLLERS["staubli"])


def _read_data(text: str, name: str, lines: Lines, found: Found) -> None:
    """Add the values of the points of a ``.dtx``."""
    label, kind = "", ""
    others = completed = 0
    for match in _TAG.finditer(text):
        if match[1]:
            continue
        fields = {key.lower().removeprefix("xsi:"): a or b for key, a, b in _ATTRIBUTE.findall(match[3])}
        tag = match[2].lower()
        if "name" in fields:
            label = fields["name"]
        if tag == "data":
            kind = fields.get("type", "").lower()
            kind = fields.get("datatype", kind).lower() if kind in ("array", "element", "collection") else kind
            types = re.findall(r"""\btype\s*=\s*["']([\w:]+)["']""", match[3])
            kind = next((one.lower() for one in types if one.lower() not in ("array", "element", "collection")), kind)
            continue
        if "j1" in fields and "j2" in fields:
            found.joints += 1
            continue
        if not set(_NUMBERS) & fields.keys() and not (tag == "value" and kind in _POINTS):
            continue
        if kind and kind not in _POINTS:
            others += 1
            continue
        completed += not set(_NUMBERS) <= fields.keys()
        where = f"{label}[{fields['key']}]" if "key" in fields else label
        found.add(lines.at(match.start()), where, [fields.get(key, "0").strip() for key in _NUMBERS], name)
    if others:
        found.notes.append(f"{others} values of tools, frames and others are left out")
    if completed:
        found.notes.append(f"{completed} points lack fields, which are 0")
