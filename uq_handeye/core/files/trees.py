"""Safe reading of YAML, JSON and XML files as plain lists, dicts, numbers and texts.

Nothing in a file can run code or expand: anchors, aliases, document types, deep nesting and files of more than 20 MB
are refused. YAML is read by the events of PyYAML, so that tags (OpenCV's ``!!opencv-matrix``, or any other) create no
objects.
"""

from __future__ import annotations

import io
import json
import math
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import InputError
from ..limits import HEAD_BYTES, MAX_DESCRIPTION_BYTES
from .lines import decoded
from .one_line import Words, one_line, refused, short
from .open import opened, shown
from .tree_values import Tree, is_list, is_map

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MAX_DEPTH = 30  # levels of nesting
_DEEP = f"at most {MAX_DEPTH} levels of nesting, got more"

# Characters allowed between two documents of JSON.
_BETWEEN = re.compile(r"[\s,]*")

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.(inf|Inf|INF)|\.(nan|Nan|NaN|NAN)")


def parse_tree(data: bytes, name: str, several: bool = False) -> Tree:
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


def _json(text: str, name: str, several: bool) -> Tree:
    def once(pairs: list[tuple[str, Tree]]) -> dict[str, Tree]:
        found = dict(pairs)
        if len(found) < len(pairs):
            keys = [key for key, _ in pairs]
            raise InputError(f"{name}: the key {short(next(k for k in keys if keys.count(k) > 1))} is given twice.")
        return found

    decoder = json.JSONDecoder(object_pairs_hook=once)
    found: list[Tree] = []
    end = _after(text, 0)
    with refused(name, _OF_JSON):
        if not several:
            whole: Tree = decoder.decode(text)
            return whole
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
        return place == math.inf or (len(head) > 0.9 * HEAD_BYTES and place > len(text) - 1000)  # cut off
    return end == len(text)


def _after(text: str, end: int) -> int:
    """Return where the next document begins."""
    between = _BETWEEN.match(text, end)
    return end if between is None else between.end()


class _Builder:
    """Lists and dicts from the events of PyYAML."""

    def __init__(self, name: str, several: bool, scalar: Callable[[str], Tree]) -> None:
        self.name, self.several, self.scalar = name, several, scalar
        self.documents: list[Tree] = []
        self.root: Tree = None
        # A container and, of a dict, the key that waits for its value.
        self.stack: list[tuple[dict[str, Tree] | list[Tree], list[str]]] = []

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
            container: dict[str, Tree] | list[Tree] = [] if kind == "SequenceStart" else {}
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

    def _add(self, value: Tree, line: int) -> None:
        if not self.stack:
            self.root = value
            return
        container, key = self.stack[-1]
        if isinstance(container, list):
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


def parse_yaml(text: str, name: str, several: bool = False, texts: bool = False) -> Tree:
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
    found: list[Tree] = [root for root in builder.documents if root is not None] or [
        None
    ]  # an empty one between two separators
    return found if len(found) > 1 else found[0]


def _of_yaml(error: Exception) -> str:
    """Return where YAML is damaged, and how."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    at = "" if mark is None else f", line {mark.line + 1}"
    problem = getattr(error, "problem", None) or getattr(error, "context", None) or str(error)
    # PyYAML from 6.0.4 on looks ahead, and stops first where it is nested too deeply.
    return f"{at}: expected {_DEEP}" if "nesting depth" in problem else f"{at}: not YAML: {one_line(problem)}"


def _scalar(text: str) -> str | float | bool | None:
    """A plain scalar of YAML: a number, yes or no, nothing, or text."""
    if _NUMBER.fullmatch(text):
        return float(re.sub(r"\.(?=[iInN])", "", text))
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    return None if text in ("", "~", "null") else text


def _xml(text: str, name: str) -> Tree:
    """OpenCV's XML: elements are keys, elements named ``_`` are items, texts are numbers where they are."""
    from xml.etree import ElementTree

    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{name}: expected XML without a document type or entities.")
    depth, events = 0, ElementTree.iterparse(io.StringIO(text), ("start", "end"))
    try:
        for event, element in events:
            depth += 1 if event == "start" else -1
            if depth > MAX_DEPTH:
                raise InputError(f"{name}: expected {_DEEP}.")
            if depth == 1 and element.tag != "opencv_storage" and event == "start":
                what = f"the XML of OpenCV's FileStorage, <opencv_storage>, got <{one_line(element.tag)}>"
                raise InputError(f"{name}: expected {what}.")
    except ElementTree.ParseError as error:
        line, problem = error.position[0], error.msg.partition(":")[0]
        raise InputError(f"{name}, line {line}: not XML: {problem}.") from error
    return _of_element(element, name) if len(element) else {}


def _of_element(element: Element, name: str) -> Tree:
    if not len(element):
        return _words(element.text or "")
    values = [(child.tag, _of_element(child, name)) for child in element]
    if all(key == "_" for key, _ in values):
        return [value for _, value in values]
    found = dict(values)
    if len(found) < len(values):
        raise InputError(f"{name}: an element of <{one_line(element.tag)}> is given twice.")
    return found


def _words(text: str) -> Tree:
    """The numbers of an element, or its text."""
    words = text.split()
    if words and all(map(_NUMBER.fullmatch, words)):
        return [_scalar(word) for word in words] if len(words) > 1 else _scalar(words[0])
    return text.strip().removeprefix('"').removesuffix('"')


def _line_of(error: UnicodeDecodeError) -> int:
    return error.object.count(b"\n", 0, error.start) + 1


_OF_TOML: Words = (
    (UnicodeDecodeError, lambda error: f", line {_line_of(error)}: expected UTF-8 text, got other bytes"),
    (RecursionError, lambda error: ": expected a TOML file, got arrays nested too deeply"),
    # TOMLDecodeError, or a number with thousands of digits.
    (ValueError, lambda error: f": expected a TOML file, got an error: {' '.join(str(error).split())}"),
)


def parse_toml(path: Path) -> dict[str, Any]:
    """All of a TOML file of at most `MAX_DESCRIPTION_BYTES`; raises `InputError`."""
    with opened(path, MAX_DESCRIPTION_BYTES) as file:
        data = file.read()
    with refused(shown(path), _OF_TOML):
        return tomllib.loads(data.decode("utf-8-sig"))
