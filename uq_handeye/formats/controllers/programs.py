"""Poses that stand in a robot's program, as one side of a pose file.

Poses that stand in the programs and data files of controllers, maker by maker.

Poses of ABB: robtargets in modules (``.mod``, ``.sys``, ``.prg``) and in logs of CRobT.

``CONST robtarget p10:=[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[9E9,...]];`` in mm, with the scalar of the quaternion
first. Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types: robtarget, pose, pos,
orient, CRobT. Data of tools, work objects and loads hold frames as well, which are no poses of the robot; jointtarget
holds joints.

Poses of FANUC: the section /POS of TP programs (``.ls``), and listings of position registers (``posreg.va``).

``P[1]{ GP1: UF : 0, UT : 1, CONFIG : 'N U T, 0, 0, 0', X = 100.000 mm, ..., W = ... deg, ... };`` in mm and degrees: W,
P, R about the fixed axes X, Y, Z. Source: FANUC Robot Controller Operator's Manual, "Position data" and "Position
registers". A position may hold joints instead (``J1 = 10.000 deg``). Further motion groups (``GP2:``, rails and
positioners) are no part of the pose.

Transformation values of Kawasaki, ``.as`` files: the section ``.TRANS`` with ``p1 x y z o a t``, in mm and degrees.

O, A, T are Euler angles about Z, the new Y, the new Z. Source: Kawasaki, AS Language Reference Manual: transformation
values, SAVE, POINT, TRANS; the section ``.JOINTS`` and names with # hold joints.

Poses of KUKA's ``.dat`` and ``.src`` files: ``DECL E6POS XP1={X 100.0,Y 0.0,Z 500.0,A 0.0,B 90.0,C 0.0,...}``.

Millimetres and degrees: A about Z, B about the new Y, C about the new X. Source: KUKA System Software, Operating and
Programming Instructions for System Integrators: structures FRAME, POS and E6POS; AXIS and E6AXIS hold joints. The
frames of tools and bases (``$TOOL``, ``BASE_DATA`` ...) are no poses; ``$POS_ACT`` of a log is one.

Poses of Staubli: data files of VAL 3 (``.dtx``), and poses in text, ``{x, y, z, rx, ry, rz}``, in mm and degrees.

Rotations about X, the new Y, the new Z. Source: Staubli, VAL 3 Reference Manual, types trsf, point (pointRx) and frame;
in a ``.dtx`` the fields of a value that are 0 may be left out. Data of the types tool, frame and world hold no poses of
the robot, jointRx holds joints.

Poses in programs and logs of Universal Robots: ``p[x, y, z, rx, ry, rz]``, in m and as a rotation vector in rad.

Source: Universal Robots, The URScript Programming Language, "Types" and "Module motion": a pose is
``p[x, y, z, ax, ay, az]``, where ax, ay, az is a rotation vector; ``movej([...])`` and ``get_inverse_kin`` have joints.

Positions of Yaskawa (Motoman) jobs, ``.jbi``: ``C00000=x,y,z,Rx,Ry,Rz`` below ``///RECTAN``, in mm and degrees.

Rotations about the fixed axes X, Y, Z. Source: Yaskawa, DX and YRC Options Instructions, Data Transmission: job data
format, position data ``///POSTYPE``, ``///RECTAN``, ``///RCONF``, ``///PULSE``. Positions in pulses are joints.
External and base axes (``EC``, ``BC``) are no poses.
"""

from __future__ import annotations

import re
import warnings
from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...core.files.lines import MAX_ROWS, floats
from ...errors import InputError, InputWarning
from ..contents import Contents, Side
from ..number_table import NUMBER
from .forms import CONTROLLERS, PoseForm, interpret
from .tables import HELP

# One number, or what a controller or a program writes in its place.
VALUE = rf"(?:{NUMBER}|\*+|[+-]?(?:nan|inf)\b)"
# Joint targets hold no pose.
JOINTS = (
    "joint values hold no pose: give them by --joints with --urdf or --dh, or let the controller convert them "
    f"to positions; {HELP}"
)


@dataclass
class Found:
    """Poses of a program in their order.

    Parameters
    ----------
    lines : line of each
    labels : name of each, or ""
    numbers : x, y, z and the rotation of each
    joints : joint targets that were met
    tools : tool and frame of each, where the program names them
    notes : what was found out
    """

    lines: list[int] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    numbers: list[Sequence[float]] = field(default_factory=list)
    joints: int = 0
    tools: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, line: int, label: str, values: Sequence[str], name: str) -> None:
        """Add a pose; raises `InputError` for a value that is no number."""
        if (numbers := floats(values)) is None:
            wrong = next(value for value in values if floats([value]) is None)
            raise InputError(
                f"{name}, line {line}: expected a number in the pose {label}, got {wrong[:20]!r}; leave out poses "
                "that were not taught, on both sides."
            )
        if len(self.lines) >= MAX_ROWS:
            raise InputError(f"{name}, line {line}: expected at most {MAX_ROWS} poses; split the file.")
        self.lines.append(line)
        self.labels.append(label)
        self.numbers.append(numbers)


class Lines:
    """Line numbers of places in a text."""

    def __init__(self, text: str) -> None:
        self.ends = [match.start() for match in re.finditer("\n", text)]

    def at(self, place: int) -> int:
        """Return the number of the line, from 1."""
        return bisect_right(self.ends, place - 1) + 1


def contents_of(found: Found, name: str, form: PoseForm, length: str | None = None, sure: bool = True) -> Contents:
    """Return the poses of a program in the convention of its maker, or, unless ``sure``, of those that it may have.

    Raises `InputError` where there are none, and says so where there are joint targets instead.
    """
    if not found.lines:
        if found.joints:
            raise InputError(f"{name}: got joint targets ({found.joints}) and no positions; {JOINTS}.")
        raise InputError(f"{name}: expected poses as {form.maker} writes them, got none; {HELP}.")
    used = Counter(found.tools)
    if len(used) > 1:
        warnings.warn(
            f"{name}: the poses are of several tools or frames: "
            f"{', '.join(f'{tool} ({count} poses)' for tool, count in used.most_common(6))}. Give poses of one tool in "
            f"one frame ({HELP}).",
            InputWarning,
            stacklevel=2,
        )
    numbers = np.array(found.numbers, dtype=float)
    translation, rotation = numbers[:, :3], numbers[:, 3:]
    angle = form.rotation[-3:] if form.rotation[-3:] in ("deg", "rad") else None
    known = form if sure else None
    read = interpret("unsaid", translation, rotation, known, length, None if form.name == "ur" else angle)
    notes = [*found.notes, *read.notes]
    if found.joints:
        notes.append(f"joint targets left out: {found.joints}")
    labels = tuple(
        f"line {line}" + (f" ({label})" if label else "") for line, label in zip(found.lines, found.labels, strict=True)
    )
    if any(found.labels):
        notes.append(f"{len(labels)} poses, {found.labels[0] or labels[0]} to {found.labels[-1] or labels[-1]}")
    columns = ("timestamp", "x", "y", "z", *form.columns)
    rows = np.array(found.lines, dtype=np.int64)
    side = Side(
        name, translation, rotation, None, rows, "line", "xyzw", columns, units=length, readings=read.readings,
        labels=labels,
    )  # fmt: skip
    return Contents(only=side, notes=tuple(notes))


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
_DECLARED = re.compile(r"\brobtarget\b|\bCRobT\b|\bMove[LJC]\s+\[\s*\[", re.IGNORECASE)


def is_abb(head: str) -> bool:
    """Return whether a text declares robtargets or joint targets, or is a log of CRobT."""
    return bool(_DECLARED.search(head) or _ABB_JOINTS.search(head))


def has_lists(head: str) -> bool:
    """Return whether a text holds poses as ``[x, y, z], [four numbers]``, whoever wrote them."""
    return not head.lstrip().startswith(("{", "<")) and bool(_ABB_POSE.search(head))


def read_abb(text: str, name: str, sure: bool = True) -> Contents:
    """Return the poses of a text; unless ``sure``, the order of the quaternion is open."""
    lines = Lines(text)
    found = Found(joints=len(_ABB_JOINTS.findall(text)))
    text = _ABB_COMMENT.sub(lambda match: match[0][: match.start(1) - match.start(0)] + " " * len(match[1]), text)
    moved = {match[1]: match.group(0, 2, 3) for match in _MOVE.finditer(text)}
    others = 0
    for match in _ABB_POSE.finditer(text):
        start = text.rfind(";", 0, match.start()) + 1
        before = text[max(start, match.start() - 300) : match.start()]
        if _OTHER_DATA.search(before):
            others += 1
            continue
        label = _ABB_LABEL.search(before.rstrip("[:= \t\n")[-80:])
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


_START = re.compile(r"\bP(?:R)?\s*\[\s*(\d+)[^\]\n]{0,80}\]\s*\{|^[ \t]*\[\s*\d+\s*,\s*(\d+)\s*\]\s*=", re.MULTILINE)
_FANUC_PAIR = re.compile(rf"\b([XYZWPR])\s*[=:]\s*({VALUE})\s*(mm|cm|m|deg|rad|inch|in)?\b", re.IGNORECASE)
_GROUP = re.compile(r"\bGP[2-9]\s*:", re.IGNORECASE)
_TOOL = re.compile(r"\bUF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)", re.IGNORECASE)
_JOINT = re.compile(r"\bJ1\s*[=:]", re.IGNORECASE)
_FANUC_NUMBERS = ("X", "Y", "Z", "W", "P", "R")
_IS_FANUC = re.compile(r"^[ \t]*/(?:PROG|POS)\b|\*POSREG\*|\bP(?:R)?\s*\[\s*\d+[^\]\n]{0,80}\]\s*\{", re.MULTILINE)
_FANUC_COMMENT = re.compile(r"^[ \t]*(?:\d+[ \t]*:)?[ \t]*!.*$", re.MULTILINE)
_UNITS = {"mm": "mm", "cm": "cm", "m": "m", "inch": "in", "in": "in"}


def is_fanuc(head: str) -> bool:
    """Return whether a text is a TP program or a listing of position registers."""
    return bool(_IS_FANUC.search(head))


def read_fanuc(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    lines = Lines(text)
    text = _FANUC_COMMENT.sub(lambda match: " " * len(match[0]), text)
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
        pairs = _FANUC_PAIR.findall(block)
        values = {key.upper(): value for key, value, _ in pairs[:6]}
        if all(value.startswith("*") for value in values.values()):
            empty += 1
            continue
        if set(values) != set(_FANUC_NUMBERS):
            missing = ", ".join(key for key in _FANUC_NUMBERS if key not in values)
            raise InputError(
                f"{name}, line {line}: expected X, Y, Z, W, P, R of {label}, {missing} is missing; {HELP}."
            )
        units = {key.upper(): unit.lower() for key, _, unit in pairs[:6]}
        if any(units[key] not in ("", "deg") for key in "WPR"):
            raise InputError(f"{name}, line {line}: expected W, P, R of {label} in deg, got {units['W']}; {HELP}.")
        lengths |= {units[key] for key in "XYZ"}
        if (frame := _TOOL.search(block)) is not None:
            found.tools.append(f"UF {frame[1]}, UT {frame[2]}")
        found.add(line, label, [values[key] for key in _FANUC_NUMBERS], name)
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


_LINE = re.compile(rf"\s*([#A-Za-z][\w.\[\],]*)\s+({VALUE}(?:[\s,]+{VALUE})*)\s*")
_TRANS = re.compile(rf"\b(\w+)\s*=\s*TRANS\s*\(\s*({VALUE}(?:\s*,\s*{VALUE}){{5}})\s*\)", re.IGNORECASE)
_IS_KAWASAKI = re.compile(r"^[ \t]*\.(?:TRANS|JOINTS|PROGRAM)\b|=\s*TRANS\s*\(", re.MULTILINE | re.IGNORECASE)


def is_kawasaki(head: str) -> bool:
    """Return whether a text has sections of transformation values or joints, or calls TRANS()."""
    return bool(_IS_KAWASAKI.search(head))


def read_kawasaki(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    found = Found()
    lines = Lines(text)
    section = ""
    for number, line in enumerate(text.splitlines(), start=1):
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
        if match is None or len(values) < 6:
            raise InputError(
                f"{name}, line {number}: expected a name and x y z o a t in the section .TRANS, got "
                f"{content.strip()[:60]!r}; {HELP}."
            )
        found.add(number, match[1], values[:6], name)
    for match in _TRANS.finditer(text):
        values = [value.strip() for value in match[2].split(",")]
        found.add(lines.at(match.start()), match[1], values, name)
    return contents_of(found, name, CONTROLLERS["kawasaki"])


_STRUCTURE = re.compile(r"\{([^{}]*)\}")
_KUKA_PAIR = re.compile(rf"\b([A-Z]\w*)(?:\s*[:=]\s*|\s+)({VALUE})", re.IGNORECASE)
_NAME = re.compile(r"([$\w]+)(?:\s*\[[\d,\s]*\])?\s*=\s*(?:E6POS|POS|FRAME)?\s*:?\s*$", re.IGNORECASE)
_KUKA_NUMBERS = ("X", "Y", "Z", "A", "B", "C")
_FRAMES = re.compile(r"\bFDAT\s+F(\w+)\s*=\s*\{TOOL_NO\s+(\d+)\s*,\s*BASE_NO\s+(\d+)", re.IGNORECASE)
_NO_POSES = re.compile(r"^\$(?!POS_|AXIS_|TCP)|TOOL|BASE(?!_T_)|LOAD|WORLD|^ROBROOT", re.IGNORECASE)


def is_kuka(head: str) -> bool:
    """Return whether a text holds structures of poses or joints in KRL."""
    if re.search(r"\bE6AXIS\b", head, re.IGNORECASE):
        return True
    if head.lstrip().startswith(("{", "[")) and ":" in head[:200] and '"' in head[:200]:
        return False  # JSON
    for match in _STRUCTURE.finditer(head):
        keys = {key.upper() for key, _ in _KUKA_PAIR.findall(match[1])}
        if {"X", "A"} <= keys or {"A1", "A2"} <= keys:
            return True
    return False


def read_kuka(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    lines = Lines(text)
    found = Found()
    frames = {label.upper(): f"TOOL_NO {tool}, BASE_NO {base}" for label, tool, base in _FRAMES.findall(text)}
    parts = others = 0
    for match in _STRUCTURE.finditer(text):
        line_start = text.rfind("\n", 0, match.start()) + 1
        before = text[max(line_start, match.start() - 100) : match.start()]
        if before.lstrip().startswith(";"):
            continue
        values = {key.upper(): value for key, value in _KUKA_PAIR.findall(match[1])}
        if {"A1", "A2"} <= values.keys():
            found.joints += 1
            continue
        if not {"X", "Y", "Z", "A", "B", "C"} & values.keys():
            continue
        label = _NAME.search(before)
        taught = re.search(r"\b(?:E6)?POS\s+\S*\s*=?\s*$", before, re.IGNORECASE) is not None
        if label is not None and not taught and _NO_POSES.search(label[1]):
            others += 1
        elif not set(_KUKA_NUMBERS) <= values.keys() or "_REL" in before.upper():
            parts += 1
        else:
            if label is not None and (frame := frames.get(label[1][1:].upper())) is not None:  # XP1 and FP1
                found.tools.append(frame)
            found.add(
                lines.at(match.start()), "" if label is None else label[1], [values[key] for key in _KUKA_NUMBERS], name
            )
    if parts:
        found.notes.append(f"{parts} relative or incomplete frames (not all of X, Y, Z, A, B, C) are left out")
    if others:
        found.notes.append(f"{others} frames of tools and bases are left out")
    return contents_of(found, name, CONTROLLERS["kuka"])


_STAUBLI_NUMBERS = ("x", "y", "z", "rx", "ry", "rz")
_TAG = re.compile(r"<(/?)([A-Za-z_][\w:]*)([^<>]*?)(/?)>")
_ATTRIBUTE = re.compile(r"""(?<![\w:])([\w:]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_POINTS = ("point", "pointrx", "trsf", "pointrs")
_BRACES = re.compile(rf"\{{\s*({VALUE}(?:\s*[,;]\s*{VALUE}){{5}})\s*\}}")
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
            label = _STAUBLI_LABEL.search(before)
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
        if not set(_STAUBLI_NUMBERS) & fields.keys() and not (tag == "value" and kind in _POINTS):
            continue
        if kind and kind not in _POINTS:
            others += 1
            continue
        completed += not set(_STAUBLI_NUMBERS) <= fields.keys()
        where = f"{label}[{fields['key']}]" if "key" in fields else label
        found.add(lines.at(match.start()), where, [fields.get(key, "0").strip() for key in _STAUBLI_NUMBERS], name)
    if others:
        found.notes.append(f"{others} values of tools, frames and others are left out")
    if completed:
        found.notes.append(f"{completed} points lack fields, which are 0")


_UR_POSE = re.compile(rf"\bp\s*\[\s*({VALUE}(?:\s*,\s*{VALUE}){{5}})\s*\]")
_BEGUN = re.compile(r"\bp\s*\[")
_UR_LABEL = re.compile(r"(\w+)\s*=\s*$")
# Frames that each program of PolyScope declares.
_FEATURE = re.compile(r"(?:Base|Tool)(?:_\d+)?")
_UR_JOINTS = re.compile(r"\b(?:movej|servoj)\s*\(\s*\[")


def is_ur(head: str) -> bool:
    """Return whether a text holds poses of URScript, or is a program of joint targets."""
    return bool(_UR_POSE.search(head) or _UR_JOINTS.search(head))


def read_ur(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    lines = Lines(text)
    found = Found(joints=len(_UR_JOINTS.findall(text)))
    features = 0
    for match in _UR_POSE.finditer(text):
        before = text[max(0, match.start() - 80) : match.start()]
        if before.rpartition("\n")[2].lstrip().startswith("#") or re.search(r"set_tcp\s*\(\s*$", before):
            continue
        label = _UR_LABEL.search(before)
        if label is not None and _FEATURE.fullmatch(label[1]):
            features += 1
            continue
        values = [value.strip() for value in match[1].split(",")]
        found.add(lines.at(match.start()), "" if label is None else label[1], values, name)
    if features:
        found.notes.append(f"{features} features (Base, Tool) are left out")
    left = len(_BEGUN.findall(text)) - len(_UR_POSE.findall(text))
    if left:
        found.notes.append(f"{left} times p[ without six numbers is left out")
    return contents_of(found, name, CONTROLLERS["ur"])


_POSITION = re.compile(r"\s*((?:BC|EC|BP|EX|[CP])\d+)\s*=\s*([^=]*)", re.IGNORECASE)
_IS_JOB = re.compile(r"^[ \t]*(?:/JOB\b|///RECTAN|///PULSE|///POSTYPE|[CP]\d{4,5}\s*=)", re.MULTILINE)


def is_yaskawa(head: str) -> bool:
    """Return whether a text is a job or its position data."""
    return bool(_IS_JOB.search(head))


def read_yaskawa(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    found = Found()
    kind = ""  # pulses are whole numbers, positions have decimals
    frames = []
    tool = frame = ""
    for number, line in enumerate(text.splitlines(), start=1):
        small = line.strip().lower()
        if small.startswith("//inst"):
            break
        if small.startswith(("///rectan", "///pulse")):
            kind = small[3:]
        elif small.startswith(("///tool", "///user")):
            tool, frame = (small[3:], frame) if small.startswith("///tool") else (tool, small[3:])
        elif small.startswith("///postype"):
            frames.append(line.strip()[10:].strip())
            kind = "pulse" if "pulse" in small else "rectan"
        elif (match := _POSITION.fullmatch(line.rstrip())) is not None:
            if match[1][0].upper() in "BE":
                continue
            if kind.startswith("pulse") or (not kind and "." not in match[2]):
                found.joints += 1
                continue
            values = [value.strip() for value in match[2].split(",")]
            if len(values) not in (6, 7, 8):
                raise InputError(
                    f"{name}, line {number}: expected x, y, z, Rx, Ry, Rz of {match[1]}, got {len(values)} numbers; "
                    f"{HELP}."
                )
            if tool or frame:
                found.tools.append(" ".join(f"{tool} {frame}".upper().split()))
            found.add(number, match[1], values[:6], name)
    others = sorted({frame for frame in frames if frame.upper() not in ("ROBOT", "BASE", "PULSE")})
    if others:
        found.notes.append(f"positions in the frame {', '.join(others)} of the job, not in the base of the robot")
    return contents_of(found, name, CONTROLLERS["yaskawa"])
