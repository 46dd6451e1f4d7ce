"""Messages as ``ros2 topic echo`` and ``rostopic echo`` print them: fields by indentation, ``---`` after each message.

They are YAML, but for the lines that the tools print between messages, and a last message that Ctrl-C cuts off. A
message also begins where the first line of the one before comes again (printed by rospy), and a line may be a message
as rclpy prints it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from ..core.files.one_line import short
from ..core.files.tree_values import Tree, fields_of, is_map
from ..core.files.trees import parse_yaml
from ..errors import InputError

_AT = re.compile(r"line (\d+):")
# A field, an item, or a list of numbers over several lines.
_FIELD_LINE = re.compile(r"\s*(?:- )*[A-Za-z_]\w*:(?:\s|$)|\s*-\s|[\s\d.,eE+\[\]-]+$")
# Lines that the tools print between messages.
TOOL_LINE = re.compile(
    r"\[?(WARNING|WARN|ERROR|INFO)|A message was lost|total count|Subscribing|Could not|\^C|%YAML"
    r"|\S*[$#>]? ?(ros2 (topic|run|launch)|rostopic |rosrun )"
)
# A message as Python prints it, in one line: geometry_msgs.msg.Pose(position=geometry_msgs.msg.Point(x=0.1, ...
PRINTED = re.compile(r"\b[a-z]\w*_msgs\.msg\.(_\w+\.)?[A-Z]\w*\(")
_ARRAY = re.compile(r"\barray\((\[[^\[\]]*\])[^()]*\)")
_CLASS = re.compile(r"\b[A-Za-z_][\w.]*\(")
_FIELD = re.compile(r"\b(\w+)=")
# What is wrong with a message: the number of the line, and a few words.
Wrong = tuple[int, str]


def messages_of(text: str) -> Iterator[tuple[int, dict[str, Tree], Wrong | None, bool]]:
    """Yield each message: its first line, its fields, what is wrong with it, and whether ``---`` ends it."""
    begun = 0
    lines: list[tuple[int, str]] = []
    for number, line in enumerate(text.split("\n"), start=1):
        line = line.rstrip("\r \t")
        if printed := PRINTED.search(line):
            if lines:
                yield (begun, *_parsed(lines), True)
            lines = []
            yield (number, *_parsed([(number, _in_braces(line[printed.start() :]))]), True)
            continue
        body = line.lstrip(" \t")
        if lines and body == line and lines[0][1] == body:
            yield (begun, *_parsed(lines), True)
            lines = []
        if body == "---" or (body.endswith("---") and TOOL_LINE.match(body)):
            if lines:
                yield (begun, *_parsed(lines), True)
            lines = []
        elif body and not body.startswith("#") and not TOOL_LINE.match(body):
            begun = begun if lines else number
            lines.append((number, line))
    if lines:
        yield (begun, *_parsed(lines), False)


def _in_braces(text: str) -> str:
    """Return a message that Python printed as the same message in braces."""
    text = _CLASS.sub("{", _ARRAY.sub(r"\1", text))
    return _FIELD.sub(r"\1: ", text.replace(")", "}"))


def _parsed(lines: list[tuple[int, str]]) -> tuple[dict[str, Tree], Wrong | None]:
    """Return the fields of one message as nested dicts and lists; numbers stay text until they are asked for."""
    flow = lines[0][1].lstrip().startswith("{")  # of --flow-style
    try:
        found = parse_yaml("\n".join(text for _, text in lines), "line 1", texts=not flow)
    except InputError as error:
        at = _AT.search(str(error))
        line, text = lines[min(int(at[1]), len(lines)) - 1 if at else 0]
        words = str(error).rpartition("line ")[2].partition(": ")[2].rstrip(".").replace("the key", "the field")
        if "is given twice" in words:
            words += " in a message; is a line of --- missing?"
        elif words.startswith("not YAML"):  # found where the next line does not go on
            line, text = next((one for one in lines if not _FIELD_LINE.match(one[1])), (line, text))
            words = f"expected name: value, indented below its field, got {short(text.strip())}"
        return {}, (line, words)
    if is_map(found) or flow:
        return fields_of(found), None
    return {}, (lines[0][0], f"expected name: value, got {short(lines[0][1].strip())}")
