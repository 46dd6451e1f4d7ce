"""YAML, JSON and XML of people's tools as plain lists, dicts, numbers and texts; nothing in a file can run or grow.

Anchors, aliases, document types, deep nesting and files of more than 20 MB are refused. YAML goes through the events of
PyYAML, so that tags (OpenCV's ``!!opencv-matrix``, or any other) name nothing to be made.
"""

from __future__ import annotations

import json
import re
from typing import Any

from ..errors import InputError
from .lines import decoded, one_line, short

MAX_BYTES = 20_000_000  # lists and texts take up to twenty times their size in memory
MAX_DEPTH = 30

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
    if start in ("{", "["):
        try:
            return _json(text, name, several)
        except InputError as error:
            try:  # YAML in braces; OpenCV before 4.6 wrote `1.` for 1.0 in its JSON
                return _yaml(text, name, several)
            except InputError:
                raise error from None
    return _yaml(text, name, several)


def _json(text: str, name: str, several: bool) -> Any:
    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            keys = [key for key, _ in pairs]
            raise InputError(f"{name}: the key {short(next(k for k in keys if keys.count(k) > 1))} is given twice.")
        return found

    decoder = json.JSONDecoder(object_pairs_hook=once)
    try:
        if not several:
            return decoder.decode(text)
        found: list[Any] = []
        end = _after(text, 0)
        while end < len(text) or not found:
            value, end = decoder.raw_decode(text, end)
            found.append(value)
            end = _after(text, end)
        return found if len(found) > 1 else found[0]
    except InputError:
        raise
    except json.JSONDecodeError as error:
        raise InputError(f"{name}, line {error.lineno}: not JSON: {one_line(error.msg)}.") from error
    except RecursionError as error:
        raise InputError(f"{name}: expected JSON nested at most {MAX_DEPTH} deep, got deeper.") from error
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"{name}: not JSON: {one_line(str(error))}.") from error


def _after(text: str, end: int) -> int:
    """Return where the next document begins."""
    between = _BETWEEN.match(text, end)
    return end if between is None else between.end()


class _Builder:
    """Lists and dicts from the events of a parser."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.root: Any = None
        self.stack: list[tuple[Any, list[str]]] = []  # a container and, of a dict, the key that waits for its value

    def add(self, value: Any, line: int) -> None:
        if not self.stack:
            self.root = value
            return
        container, key = self.stack[-1]
        if isinstance(container, list):
            container.append(value)
        elif not key:
            if isinstance(value, list | dict):
                raise InputError(f"{self.name}, line {line}: expected a name as key, got a list or a map.")
            key.append(str(value))
        else:
            if key[0] in container:
                raise InputError(f"{self.name}, line {line}: the key {short(key[0])} is given twice.")
            container[key.pop()] = value

    def open(self, container: Any, line: int) -> None:
        if len(self.stack) >= MAX_DEPTH:
            raise InputError(f"{self.name}, line {line}: expected at most {MAX_DEPTH} levels of nesting, got more.")
        self.add(container, line)
        self.stack.append((container, []))

    def close(self) -> None:
        self.stack.pop()


def _yaml(text: str, name: str, several: bool) -> Any:
    import yaml  # slow to import

    first, newline, rest = text.partition("\n")
    if first.startswith("%YAML"):  # OpenCV writes %YAML:1.0, which YAML does not know
        text = newline + rest
    text = text.rstrip().removesuffix("\n---")  # the separator that ROS prints after a message
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    builder, found = _Builder(name), []
    try:
        for event in yaml.parse(text, Loader=loader):
            line = 0 if event.start_mark is None else event.start_mark.line + 1
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
                raise InputError(
                    f"{name}, line {line}: expected YAML without anchors and aliases (& and *); write the values out."
                )
            if isinstance(event, yaml.DocumentStartEvent):
                builder = _Builder(name)
            elif isinstance(event, yaml.DocumentEndEvent):
                found.append(builder.root)
                if len(found) > 1 and not several:
                    raise InputError(f"{name}, line {line}: expected one YAML document, got a second one.")
            elif isinstance(event, yaml.ScalarEvent):
                builder.add(_scalar(event.value) if event.implicit[0] else event.value, line)
            elif isinstance(event, yaml.SequenceStartEvent):
                builder.open([], line)
            elif isinstance(event, yaml.MappingStartEvent):
                builder.open({}, line)
            elif isinstance(event, yaml.CollectionEndEvent):
                builder.close()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        at = "" if mark is None else f", line {mark.line + 1}"
        problem = error.problem or error.context or "unknown"
        raise InputError(f"{name}{at}: not YAML: {one_line(problem)}.") from error
    except InputError:
        raise
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise InputError(f"{name}: not YAML: {one_line(str(error))}.") from error
    found = [root for root in found if root is not None] or [None]  # an empty one between two separators
    return found if len(found) > 1 else found[0]


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
    return content if isinstance(content, dict) else root


def _words(text: str) -> Any:
    """The numbers of an element, or its text."""
    words = text.split()
    numbers = [_scalar(word) for word in words]
    if words and all(isinstance(number, float) for number in numbers):
        return numbers if len(numbers) > 1 else numbers[0]
    return text.strip().removeprefix('"').removesuffix('"')
