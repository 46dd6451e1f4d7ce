"""Poses that stand in the programs and data files of controllers, maker by maker, as one side of a pose file.

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
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...core.files.lines import floats
from ...core.numbers.limits import MAX_ROWS
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


class Found:
    """Poses of a program, in their order: line, name or "", numbers as texts; and what was met beside them."""

    def __init__(self, text: str, name: str) -> None:
        self.text, self.name = text, name
        self.poses: list[tuple[int, str, list[float]]] = []
        self.joints = 0  # joint targets that were met
        self.tools: list[str] = []  # tool and frame of each pose, where the program names them
        self.notes: list[str] = []

    @cached_property
    def _ends(self) -> list[int]:
        return [match.start() for match in re.finditer("\n", self.text)]

    def line(self, place: int) -> int:
        """Return the number of the line of a place in the text, from 1."""
        return bisect_right(self._ends, place - 1) + 1

    def before(self, match: re.Match[str], most: int = 100) -> str:
        """Return what stands before a match in its line."""
        start = self.text.rfind("\n", 0, match.start()) + 1
        return self.text[max(start, match.start() - most) : match.start()]

    def add(self, line: int, label: re.Match[str] | None, values: Sequence[str], named: str = "") -> None:
        """Add a pose; raises `InputError` for a value that is no number."""
        named = named if label is None else label[1]
        if (numbers := floats(values)) is None:
            wrong = next(value for value in values if floats([value]) is None)
            raise InputError(
                f"{self.name}, line {line}: expected a number in the pose {named}, got {wrong[:20]!r}; leave out poses "
                "that were not taught, on both sides."
            )
        if len(self.poses) >= MAX_ROWS:
            raise InputError(f"{self.name}, line {line}: expected at most {MAX_ROWS} poses; split the file.")
        self.poses.append((line, named, numbers))

    def note(self, count: int, words: str) -> None:
        """Say what was left out, if something was."""
        if count:
            self.notes.append(f"{count} {words}")

    def contents(self, form: PoseForm, length: str | None, sure: bool) -> Contents:
        """Return the poses in the convention of their maker, or, unless ``sure``, of those that it may have.

        Raises `InputError` where there are none, and says so where there are joint targets instead.
        """
        name = self.name
        if not self.poses:
            if self.joints:
                raise InputError(f"{name}: got joint targets ({self.joints}) and no positions; {JOINTS}.")
            raise InputError(f"{name}: expected poses as {form.maker} writes them, got none; {HELP}.")
        used = Counter(self.tools)
        if len(used) > 1:
            warnings.warn(
                f"{name}: the poses are of several tools or frames: "
                f"{', '.join(f'{tool} ({count} poses)' for tool, count in used.most_common(6))}. Give poses of one "
                f"tool in one frame ({HELP}).",
                InputWarning,
                stacklevel=2,
            )
        lines, names, rows = zip(*self.poses, strict=True)
        numbers = np.array(rows, dtype=float)
        translation, rotation = numbers[:, :3], numbers[:, 3:]
        angle = form.rotation[-3:] if form.rotation.endswith("-deg") else None
        readings, said = interpret("unsaid", translation, rotation, form if sure else None, length, angle)
        notes = [*self.notes, *said]
        if self.joints:
            notes.append(f"joint targets left out: {self.joints}")
        labels = [f"line {line}" + (f" ({one})" if one else "") for line, one in zip(lines, names, strict=True)]
        if any(names):
            notes.append(f"{len(labels)} poses, {names[0] or labels[0]} to {names[-1] or labels[-1]}")
        side = Side(
            name, translation, rotation, None, np.array(lines, dtype=np.int64), "line", "xyzw",
            ("timestamp", "x", "y", "z", *form.columns), units=length, readings=readings, labels=tuple(labels),
        )  # fmt: skip
        return Contents(only=side, notes=tuple(notes))


def _fields(text: str) -> list[str]:
    return [value.strip() for value in re.split("[,;]", text)]


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
_IS_ABB = re.compile(rf"\brobtarget\b|\bCRobT\b|\bMove[LJC]\s+\[\s*\[|{_ABB_JOINTS.pattern}", re.IGNORECASE)


def has_lists(head: str) -> bool:
    """Return whether a text holds poses as ``[x, y, z], [four numbers]``, whoever wrote them."""
    return not head.lstrip().startswith(("{", "<")) and bool(_ABB_POSE.search(head))


def _abb(found: Found) -> None:
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
        found.add(found.line(match.start()), label, _fields(f"{match[1]},{match[2]}"))
    found.note(others, "frames of tools and work objects are left out")


_START = re.compile(r"\bP(?:R)?\s*\[\s*(\d+)[^\]\n]{0,80}\]\s*\{|^[ \t]*\[\s*\d+\s*,\s*(\d+)\s*\]\s*=", re.MULTILINE)
_FANUC_PAIR = re.compile(rf"\b([XYZWPR])\s*[=:]\s*({VALUE})\s*(mm|cm|m|deg|rad|inch|in)?\b", re.IGNORECASE)
_GROUP = re.compile(r"\bGP[2-9]\s*:", re.IGNORECASE)
_TOOL = re.compile(r"\bUF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)", re.IGNORECASE)
_JOINT = re.compile(r"\bJ1\s*[=:]", re.IGNORECASE)
_IS_FANUC = re.compile(r"^[ \t]*/(?:PROG|POS)\b|\*POSREG\*|\bP(?:R)?\s*\[\s*\d+[^\]\n]{0,80}\]\s*\{", re.MULTILINE)
_FANUC_COMMENT = re.compile(r"^[ \t]*(?:\d+[ \t]*:)?[ \t]*!.*$", re.MULTILINE)


def _fanuc(found: Found) -> str | None:
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


_LINE = re.compile(rf"\s*([#A-Za-z][\w.\[\],]*)\s+({VALUE}(?:[\s,]+{VALUE})*)\s*")
_TRANS = re.compile(rf"\b(\w+)\s*=\s*TRANS\s*\(\s*({VALUE}(?:\s*,\s*{VALUE}){{5}})\s*\)", re.IGNORECASE)
_IS_KAWASAKI = re.compile(r"^[ \t]*\.(?:TRANS|JOINTS|PROGRAM)\b|=\s*TRANS\s*\(", re.MULTILINE | re.IGNORECASE)


def _kawasaki(found: Found) -> None:
    section = ""
    for number, line in enumerate(found.text.splitlines(), start=1):
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
        if len(values) < 6:
            raise InputError(
                f"{found.name}, line {number}: expected a name and x y z o a t in the section .TRANS, got "
                f"{content.strip()[:60]!r}; {HELP}."
            )
        found.add(number, match, values[:6])
    for match in _TRANS.finditer(found.text):
        found.add(found.line(match.start()), match, _fields(match[2]))


_STRUCTURE = re.compile(r"\{([^{}]*)\}")
_KUKA_PAIR = re.compile(rf"\b([A-Z]\w*)(?:\s*[:=]\s*|\s+)({VALUE})", re.IGNORECASE)
_NAME = re.compile(r"([$\w]+)(?:\s*\[[\d,\s]*\])?\s*=\s*(?:E6POS|POS|FRAME)?\s*:?\s*$", re.IGNORECASE)
_FRAMES = re.compile(r"\bFDAT\s+F(\w+)\s*=\s*\{TOOL_NO\s+(\d+)\s*,\s*BASE_NO\s+(\d+)", re.IGNORECASE)
_NO_POSES = re.compile(r"^\$(?!POS_|AXIS_|TCP)|TOOL|BASE(?!_T_)|LOAD|WORLD|^ROBROOT", re.IGNORECASE)


def _is_kuka(head: str) -> bool:
    """Return whether a text holds structures of poses or joints in KRL."""
    if re.search(r"\bE6AXIS\b", head, re.IGNORECASE):
        return True
    if head.lstrip().startswith(("{", "[")) and ":" in head[:200] and '"' in head[:200]:
        return False  # JSON
    structures = ({key.upper() for key, _ in _KUKA_PAIR.findall(one[1])} for one in _STRUCTURE.finditer(head))
    return any({"X", "A"} <= keys or {"A1", "A2"} <= keys for keys in structures)


def _kuka(found: Found) -> None:
    frames = {label.upper(): f"TOOL_NO {tool}, BASE_NO {base}" for label, tool, base in _FRAMES.findall(found.text)}
    parts = others = 0
    for match in _STRUCTURE.finditer(found.text):
        before = found.before(match)
        values = {key.upper(): value for key, value in _KUKA_PAIR.findall(match[1])}
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


def _is_staubli(head: str) -> bool:
    """Return whether a text is data of VAL 3, or holds poses in braces."""
    if head.lstrip().startswith("<"):
        small = head[:4096].lower()
        return "val3" in small or "staubli" in small or bool(_FIELDS.search(head, 0, 65_536))
    return bool(_BRACES.search(head) and _WORDS.search(head))


def _staubli(found: Found) -> None:
    if found.text.lstrip().startswith("<"):
        return _staubli_data(found)
    for match in _BRACES.finditer(found.text):
        before = found.before(match, 80)
        if not before.lstrip().startswith("//"):
            found.add(found.line(match.start()), _STAUBLI_LABEL.search(before), _fields(match[1]))


def _staubli_data(found: Found) -> None:
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


_UR_POSE = re.compile(rf"\bp\s*\[\s*({VALUE}(?:\s*,\s*{VALUE}){{5}})\s*\]")
_UR_LABEL = re.compile(r"(\w+)\s*=\s*$")
# Frames that each program of PolyScope declares.
_FEATURE = re.compile(r"(?:Base|Tool)(?:_\d+)?")
_UR_JOINTS = re.compile(r"\b(?:movej|servoj)\s*\(\s*\[")
_IS_UR = re.compile(rf"{_UR_POSE.pattern}|{_UR_JOINTS.pattern}")


def _ur(found: Found) -> None:
    found.joints = len(_UR_JOINTS.findall(found.text))
    features = whole = 0
    for match in _UR_POSE.finditer(found.text):
        whole += 1
        before = found.before(match, 80)
        if before.lstrip().startswith("#") or re.search(r"set_tcp\s*\(\s*$", before):
            continue
        label = _UR_LABEL.search(before)
        if label is not None and _FEATURE.fullmatch(label[1]):
            features += 1
            continue
        found.add(found.line(match.start()), label, _fields(match[1]))
    found.note(features, "features (Base, Tool) are left out")
    found.note(len(re.findall(r"\bp\s*\[", found.text)) - whole, "times p[ without six numbers is left out")


_POSITION = re.compile(r"\s*((?:BC|EC|BP|EX|[CP])\d+)\s*=\s*([^=]*)", re.IGNORECASE)
_IS_YASKAWA = re.compile(r"^[ \t]*(?:/JOB\b|///RECTAN|///PULSE|///POSTYPE|[CP]\d{4,5}\s*=)", re.MULTILINE)


def _yaskawa(found: Found) -> None:
    kind = ""  # pulses are whole numbers, positions have decimals
    frames = set()
    tool = frame = ""
    for number, line in enumerate(found.text.splitlines(), start=1):
        small = line.strip().lower()
        if small.startswith("//inst"):
            break
        if small.startswith(("///rectan", "///pulse")):
            kind = small[3:]
        elif small.startswith("///tool"):
            tool = small[3:]
        elif small.startswith("///user"):
            frame = small[3:]
        elif small.startswith("///postype"):
            frames.add(line.strip()[10:].strip())
            kind = "pulse" if "pulse" in small else "rectan"
        elif (match := _POSITION.fullmatch(line.rstrip())) is not None and match[1][0].upper() not in "BE":
            if kind.startswith("pulse") or (not kind and "." not in match[2]):
                found.joints += 1
                continue
            values = _fields(match[2])
            if len(values) not in (6, 7, 8):
                raise InputError(
                    f"{found.name}, line {number}: expected x, y, z, Rx, Ry, Rz of {match[1]}, got {len(values)} "
                    f"numbers; {HELP}."
                )
            if tool or frame:
                found.tools.append(" ".join(f"{tool} {frame}".upper().split()))
            found.add(number, match, values[:6])
    if others := sorted(frame for frame in frames if frame.upper() not in ("ROBOT", "BASE", "PULSE")):
        found.notes.append(f"positions in the frame {', '.join(others)} of the job, not in the base of the robot")


class Program(NamedTuple):
    """The language of a maker: what its texts look like, and what adds their poses and returns their length unit."""

    told: Callable[[str], object]
    read: Callable[[Found], str | None]
    loose: Callable[[str], object] = lambda head: False  # what is theirs only if the format is asked for


# In this order a text is asked.
PROGRAMS = {
    "yaskawa": Program(_IS_YASKAWA.search, _yaskawa),
    "fanuc": Program(_IS_FANUC.search, _fanuc),
    "kawasaki": Program(_IS_KAWASAKI.search, _kawasaki),
    "kuka": Program(_is_kuka, _kuka),
    "ur": Program(_IS_UR.search, _ur),
    "staubli": Program(_is_staubli, _staubli, _BRACES.search),
    "abb": Program(_IS_ABB.search, _abb, has_lists),
}


def read_program(maker: str, text: str, name: str, sure: bool = True) -> Contents:
    """Return the poses of a text; unless ``sure``, the convention of their rotations is open."""
    found = Found(text, name)
    return found.contents(CONTROLLERS[maker], PROGRAMS[maker].read(found), sure)
