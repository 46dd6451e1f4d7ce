"""YAML, JSON and XML of people's tools as plain lists, dicts, numbers and texts; nothing in a file can run or grow.

Anchors, aliases, document types, deep nesting and files of more than 20 MB are refused. YAML goes through the events of
PyYAML, so that tags (OpenCV's ``!!opencv-matrix``, or any other) name nothing to be made.

Numbers out of trees (`trees`): every error says where in the file, what was expected and what came.

Names of poses in files of several arrays or entries: which side they are, and in which frames.
"""

from __future__ import annotations

import json
import math
import re
import sys
import tomllib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from ...errors import InputError
from ..geometry.se3 import Array
from .lines import Words, decoded, one_line, refused, short
from .open import opened, shown

MAX_BYTES = 20_000_000  # lists and texts take up to twenty times their size in memory
MAX_DEPTH = 30
MAX_TOML = 50_000_000
_DEEP = f"at most {MAX_DEPTH} levels of nesting, got more"

# What stands between two documents of JSON.
_BETWEEN = re.compile(r"[\s,]*")

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.(inf|Inf|INF)|\.(nan|Nan|NaN|NAN)")


def parse_tree(data: bytes, name: str, several: bool = False) -> Any:
    """The content of a YAML, JSON or XML file; `InputError` with the line for what is none of them.

    With ``several``, documents that follow each other (JSON lines, YAML with ``---`` between) are a list; else a second
    one is refused.
    """
    text = decoded(data.removeprefix(b"\xef\xbb\xbf"), f"{name}: expected YAML, JSON or XML")
    start = text.lstrip()[:1]
    if start == "<":
        return _xml(text, name)
    # YAML may stand in braces; OpenCV before 4.6 wrote `1.` for 1.0 in its JSON.
    failures: list[InputError] = []
    for parse in (_json, parse_yaml) if start in ("{", "[") else (parse_yaml,):
        try:
            return parse(text, name, several)
        except InputError as error:
            failures.append(error)
    raise failures[0] from failures[0].__cause__


_OF_JSON: Words = (
    (InputError, None),
    (json.JSONDecodeError, lambda error: f", line {error.lineno}: not JSON: {one_line(error.msg)}"),
    (RecursionError, lambda error: f": expected JSON nested at most {MAX_DEPTH} deep, got deeper"),
    (ValueError, lambda error: f": not JSON: {one_line(str(error))}"),  # an integer of thousands of digits
)


def _json(text: str, name: str, several: bool) -> Any:
    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            keys = [key for key, _ in pairs]
            raise InputError(f"{name}: the key {short(next(k for k in keys if keys.count(k) > 1))} is given twice.")
        return found

    decoder = json.JSONDecoder(object_pairs_hook=once)
    found: list[Any] = []
    end = _after(text, 0)
    with refused(name, _OF_JSON):
        if not several:
            return decoder.decode(text)
        while end < len(text) or not found:
            value, end = decoder.raw_decode(text, end)
            found.append(value)
            end = _after(text, end)
    return found if len(found) > 1 else found[0]


def is_json(head: str) -> bool:
    """Return whether the beginning of a text (of 64 kB) is one value of JSON, not one in each line."""
    text = head.strip()
    try:
        _, end = json.JSONDecoder().raw_decode(text)
    except (ValueError, RecursionError) as error:
        place = getattr(error, "pos", math.inf)  # unless it is no error of JSON, which its reader says
        return place == math.inf or (len(head) >= 60_000 and place > len(text) - 1000)  # cut off
    return end == len(text)


def _after(text: str, end: int) -> int:
    """Return where the next document begins."""
    between = _BETWEEN.match(text, end)
    return end if between is None else between.end()


class _Builder:
    """Lists and dicts from the events of PyYAML."""

    def __init__(self, name: str, several: bool, scalar: Callable[[str], Any]) -> None:
        self.name, self.several, self.scalar = name, several, scalar
        self.documents: list[Any] = []
        self.root: Any = None
        self.stack: list[tuple[Any, list[str]]] = []  # a container and, of a dict, the key that waits for its value

    def take(self, event: Any) -> None:
        """Take one event; raises `InputError` with its line for what is refused."""
        line = 0 if event.start_mark is None else event.start_mark.line + 1
        kind = type(event).__name__.removesuffix("Event")
        if kind == "Alias" or getattr(event, "anchor", None) is not None:
            raise self._error(line, "YAML without anchors and aliases (& and *); write the values out")
        if kind == "Scalar":
            self._add(self.scalar(event.value) if event.implicit[0] else event.value, line)
        elif kind in ("SequenceStart", "MappingStart"):
            if len(self.stack) >= MAX_DEPTH:
                raise self._error(line, _DEEP)
            container: Any = [] if kind == "SequenceStart" else {}
            self._add(container, line)
            self.stack.append((container, []))
        elif kind in ("SequenceEnd", "MappingEnd"):
            self.stack.pop()
        elif kind == "DocumentStart":
            self.root = None
        elif kind == "DocumentEnd":
            self.documents.append(self.root)
            if len(self.documents) > 1 and not self.several:
                raise self._error(line, "one YAML document, got a second one")

    def _add(self, value: Any, line: int) -> None:
        if not self.stack:
            self.root = value
            return
        container, key = self.stack[-1]
        if is_list(container):
            container.append(value)
        elif key:
            container[key.pop()] = value
        elif is_list(value) or is_map(value):
            raise self._error(line, "a name as key, got a list or a map")
        elif str(value) in container:
            raise InputError(f"{self.name}, line {line}: the key {short(str(value))} is given twice.")
        else:
            key.append(str(value))

    def _error(self, line: int, words: str) -> InputError:
        return InputError(f"{self.name}, line {line}: expected {words}.")


def parse_yaml(text: str, name: str, several: bool = False, texts: bool = False) -> Any:
    """The content of YAML, as `parse_tree` reads it; ``texts``: every scalar stays text, and an empty one is None."""
    import yaml  # slow to import

    first, newline, rest = text.partition("\n")
    if first.startswith("%YAML"):  # OpenCV writes %YAML:1.0, which YAML does not know
        text = newline + rest
    text = text.rstrip().removesuffix("\n---")  # the separator that ROS prints after a message
    builder = _Builder(name, several, (lambda value: value or None) if texts else _scalar)
    with refused(name, ((InputError, None), ((yaml.YAMLError, RecursionError, ValueError), _of_yaml))):
        for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            builder.take(event)
    found = [root for root in builder.documents if root is not None] or [None]  # an empty one between two separators
    return found if len(found) > 1 else found[0]


def _of_yaml(error: Exception) -> str:
    """Return where YAML is damaged, and how."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    at = "" if mark is None else f", line {mark.line + 1}"
    problem = getattr(error, "problem", None) or getattr(error, "context", None) or str(error)
    # PyYAML from 6.0.4 on looks ahead, and stops first where it is nested too deeply.
    return f"{at}: expected {_DEEP}" if "nesting depth" in problem else f"{at}: not YAML: {one_line(problem)}"


def _scalar(text: str) -> Any:
    """A plain scalar of YAML: a number, yes or no, nothing, or text."""
    if _NUMBER.fullmatch(text):
        return float(re.sub(r"\.(?=[iInN])", "", text))
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    return None if text in ("", "~", "null") else text


def _xml(text: str, name: str) -> Any:
    """OpenCV's XML: elements are keys, elements named ``_`` are items, texts are numbers where they are."""
    from xml.parsers import expat

    parser = expat.ParserCreate()
    parser.buffer_text = True
    root: dict[str, Any] = {}
    stack: list[tuple[str, list[tuple[str, Any]], list[str]]] = [("", [], [])]

    def refuse(*_: Any) -> None:
        raise InputError(f"{name}, line {parser.CurrentLineNumber}: expected XML without a document type or entities.")

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) == 1 and tag != "opencv_storage":
            raise InputError(
                f"{name}, line {parser.CurrentLineNumber}: expected the XML of OpenCV's FileStorage, <opencv_storage>, "
                f"got <{one_line(tag)}>."
            )
        if len(stack) > MAX_DEPTH:
            raise InputError(f"{name}, line {parser.CurrentLineNumber}: expected at most {MAX_DEPTH} levels, got more.")
        stack.append((tag, [], []))

    def end(tag: str) -> None:
        _, children, parts = stack.pop()
        value: Any
        if not children:
            value = _words("".join(parts))
        elif all(key == "_" for key, _ in children):
            value = [item for _, item in children]
        else:
            value = dict(children)
            if len(value) < len(children):
                raise InputError(
                    f"{name}, line {parser.CurrentLineNumber}: an element of <{one_line(tag)}> is given twice."
                )
        stack[-1][1].append((tag, value))

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = lambda data: stack[-1][2].append(data)
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        problem = expat.errors.messages[error.code]
        raise InputError(f"{name}, line {error.lineno}: not XML: {problem}.") from error
    content = stack[0][1][0][1]
    return content if is_map(content) else root


def _words(text: str) -> Any:
    """The numbers of an element, or its text."""
    words = text.split()
    if words and all(map(_NUMBER.fullmatch, words)):
        return [_scalar(word) for word in words] if len(words) > 1 else _scalar(words[0])
    return text.strip().removeprefix('"').removesuffix('"')


def fields_of(value: Any) -> dict[Any, Any]:
    """Return the entries of a map; none of anything else."""
    return value if isinstance(value, dict) else {}


def items_of(value: Any) -> list[Any]:
    """Return the items of a list; none of anything else."""
    return value if isinstance(value, list) else []


def is_map(value: Any) -> TypeGuard[dict[Any, Any]]:
    """Return whether a value is a map, also an empty one."""
    return fields_of(value) is value


def is_list(value: Any) -> TypeGuard[list[Any]]:
    """Return whether a value is a list, also an empty one."""
    return items_of(value) is value


def is_plain_number(value: Any) -> TypeGuard[float]:
    """Return whether a value is a number, and not true or false."""
    return isinstance(value, int | float) and value is not True and value is not False


def parse_toml(path: Path, most: int | None = None) -> dict[str, Any]:
    """All of a TOML file of at most ``most`` bytes, by default `MAX_TOML`; raises `InputError`."""
    with opened(path, MAX_TOML if most is None else most) as file:
        data = file.read()
    with refused(shown(path), _OF_TOML):
        return tomllib.loads(data.decode("utf-8-sig"))


def _line_of(error: UnicodeDecodeError) -> int:
    return error.object.count(b"\n", 0, error.start) + 1


_OF_TOML: Words = (
    (UnicodeDecodeError, lambda error: f", line {_line_of(error)}: expected UTF-8 text, got other bytes"),
    (RecursionError, lambda error: ": expected a TOML file, got arrays nested too deeply"),
    # TOMLDecodeError, or a number with thousands of digits.
    (ValueError, lambda error: f": expected a TOML file, got an error: {' '.join(str(error).split())}"),
)


def got(value: Any) -> str:
    """Describe the value that was received, in few words."""
    if is_map(value):
        return f"the keys {short(', '.join(map(str, value)))}"
    if type(value) in (list, tuple):
        return f"a list of {len(value)}"
    return "nothing" if value is None else short(str(value))


def number(value: Any, where: str) -> float:
    """A finite number."""
    if not is_plain_number(value):
        raise InputError(f"{where}: expected a number, got {got(value)}.")
    if not abs(value) <= sys.float_info.max:
        got_number = value if type(value) is float else np.inf
        raise InputError(
            f"{where}: expected a finite number, got {got_number}; leave out poses that were not measured, on both "
            "sides."
        )
    return float(value)


def item(value: Any, key: str, where: str) -> Any:
    """``value[key]`` of a map."""
    if not is_map(value):
        raise InputError(f"{where}: expected a map with {key}, got {got(value)}.")
    if key not in value:
        raise InputError(f"{where}: expected the field {key}, got {got(value)}.")
    return value[key]


def vector(value: Any, size: int, where: str) -> list[float]:
    """Check and return a list of ``size`` finite numbers."""
    if not is_list(value) or len(value) != size:
        raise InputError(f"{where}: expected a list of {size} numbers, got {got(value)}.")
    return [number(entry, f"{where}[{k}]") for k, entry in enumerate(value)]


_TRANSFORM = ("translation", "rotation")


def transform(value: Any, where: str) -> list[float]:
    """x, y, z and the quaternion x, y, z, w of a ``geometry_msgs/Transform`` or ``Pose``, stamped or not."""
    for outer in ("transform", "pose"):
        if outer in fields_of(value) and not {"translation", "position"} & set(value):
            return transform(value[outer], f"{where}, {outer}")
    names = ("position", "orientation") if "position" in fields_of(value) else _TRANSFORM
    numbers: list[float] = []
    for part, axes in zip(names, ("xyz", "xyzw"), strict=True):
        fields = item(value, part, where)
        numbers += [number(item(fields, axis, f"{where}, {part}"), f"{where}, {part}.{axis}") for axis in axes]
    return numbers


def matrix(value: Any, where: str) -> Array:
    """A 4x4 matrix: four rows of four numbers, or 16 numbers row by row."""
    if len(items_of(value)) == 16:
        return np.array(vector(value, 16, where)).reshape(4, 4)
    if len(items_of(value)) != 4:
        raise InputError(f"{where}: expected a 4x4 matrix, got {got(value)}.")
    return np.array([vector(row, 4, f"{where}[{k}]") for k, row in enumerate(value)])


_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_FRAMES = {
    "base": ("base", "world", "robotbase", "baselink", "fixed"),
    "gripper": ("gripper", "hand", "tool", "tcp", "ee", "eef", "flange", "endeffector", "effector", "wrist"),
    "camera": ("camera", "cam", "optical"),
    "target": (
        "target", "board", "tag", "marker", "pattern", "object", "checkerboard", "chessboard", "charuco", "aruco",
        "apriltag",
    ),
}  # fmt: skip
_FRAME_OF = {word: frame for frame, words in _FRAMES.items() for word in words}
# Words that say that something is a pose, and nothing of the frames.
_POSE = {"pose", "poses", "t", "h", "tf", "transform", "transforms", "transformation", "transformations", "mat", "mats"}
_POSE |= {"matrix", "matrices", "list", "all", "homogeneous"}
# Words between two frames: base_T_gripper, gripper2base, gripper_to_base, gripper_in_base.
_INVERTS = {"2", "to", "in"}
_ALONE = {"pose", "poses", "tf", "transform", "transforms", "transformation", "transformations"}
_SIDES = {
    ("base", "gripper"): ("robot", "base_T_gripper"),
    ("gripper", "base"): ("robot", "gripper_T_base"),
    ("camera", "target"): ("camera", "camera_T_target"),
    ("target", "camera"): ("camera", "target_T_camera"),
}
_LONGEST = 60


@lru_cache(maxsize=4096)
def pose_name(key: str) -> tuple[str, str] | None:
    """Return side and frame of poses by their name; None for a name that does not say them.

    ``A_T_B``, ``T_A_B`` and ``B2A`` (of OpenCV) are the pose of B in A.

    >>> pose_name("T_base_ee"), pose_name("target2cam"), pose_name("marker_pose"), pose_name("camera_matrix")
    (('robot', 'base_T_gripper'), ('camera', 'camera_T_target'), ('camera', 'camera_T_target'), None)
    """
    if not 0 < len(key) <= _LONGEST:
        return None
    parts = _WORDS.findall(key.replace("tool0", "tool"))
    if "t" in parts:  # a translation; T is a pose
        return None
    words = [word.lower() for word in parts]
    if words in (["robot"], ["camera"]):
        return _SIDES["base", "gripper"] if words == ["robot"] else _SIDES["camera", "target"]
    frames: list[str] = []
    inverts, fillers = False, set()
    for word in words:
        if word in _FRAME_OF:
            if not frames or frames[-1] != _FRAME_OF[word]:  # end effector, camera optical
                frames.append(_FRAME_OF[word])
        elif word in _INVERTS and len(frames) == 1 and not inverts:
            inverts = True
        elif word in _POSE or word in ("robot", "end", "link", "frame"):
            fillers.add(word)
        else:
            return None
    if len(frames) == 2:
        return _SIDES.get((frames[1], frames[0]) if inverts else (frames[0], frames[1]))
    if inverts or not fillers & _ALONE or fillers & {"matrix", "matrices", "mat", "mats"}:
        return None
    if not frames and "robot" in fillers:
        return _SIDES["base", "gripper"]
    if frames in (["camera"], ["target"]) and "robot" not in fillers:
        return _SIDES["camera", "target"]
    return _SIDES["base", "gripper"] if frames == ["gripper"] else None
