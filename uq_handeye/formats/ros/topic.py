"""Output of ``ros2 topic echo`` (ROS 2) and ``rostopic echo`` (ROS 1): messages that hold poses, ``---`` after each.

Read are Pose, PoseStamped, PoseWithCovarianceStamped, TransformStamped, TFMessage, Odometry and what else `messages`
names, also as rospy and rclpy print them; of ``ros2 topic echo --csv`` PoseStamped, PoseWithCovarianceStamped and
TransformStamped, whose columns are sec, nanosec, frame_id(, child_frame_id), x, y, z, qx, qy, qz, qw. Sources:
``ros2topic/ros2topic/verb/echo.py`` in ros2/ros2cli with ``rosidl_runtime_py/convert.py`` in
ros2/rosidl_runtime_py; ``tools/rostopic`` in ros/ros_comm.

Messages as ``ros2 topic echo`` and ``rostopic echo`` print them: fields by indentation, ``---`` after each message.

They are YAML, but for the lines that the tools print between messages, and a last message that Ctrl-C cuts off. A
message also begins where the first line of the one before comes again (printed by rospy), and a line may be a message
as rclpy prints it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from ...core.files.lines import is_number, short
from ...core.files.trees import fields_of, is_map, parse_yaml
from ...errors import InputError
from ..contents import Contents
from .messages import MessageError, Stamped, frame_name, poses_in, side_of

_AT = re.compile(r"line (\d+):")
# What the tools say between messages.
SAID = re.compile(
    r"\[?(WARNING|WARN|ERROR|INFO)|A message was lost|total count|Subscribing|Could not|\^C|%YAML"
    r"|\S*[$#>]? ?(ros2 (topic|run|launch)|rostopic |rosrun )"
)

# A message as Python prints it, in one line: geometry_msgs.msg.Pose(position=geometry_msgs.msg.Point(x=0.1, ...
PRINTED = re.compile(r"\b[a-z]\w*_msgs\.msg\.(_\w+\.)?[A-Z]\w*\(")
_ARRAY = re.compile(r"\barray\((\[[^\[\]]*\])[^()]*\)")
_CLASS = re.compile(r"\b[A-Za-z_][\w.]*\(")
_FIELD = re.compile(r"\b(\w+)=")


class EchoError(Exception):
    """Error in a line: its number and a few words."""

    def __init__(self, line: int, words: str) -> None:
        super().__init__(words)
        self.line = line


def messages_of(text: str) -> Iterator[tuple[int, dict[str, Any], EchoError | None, bool]]:
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
        if body == "---" or (body.endswith("---") and SAID.match(body)):
            if lines:
                yield (begun, *_parsed(lines), True)
            lines = []
        elif body and not body.startswith("#") and not SAID.match(body):
            begun = begun if lines else number
            lines.append((number, line))
    if lines:
        yield (begun, *_parsed(lines), False)


def _in_braces(text: str) -> str:
    """Return a message that Python printed as the same message in braces."""
    text = _CLASS.sub("{", _ARRAY.sub(r"\1", text))
    return _FIELD.sub(r"\1: ", text.replace(")", "}"))


def _parsed(lines: list[tuple[int, str]]) -> tuple[dict[str, Any], EchoError | None]:
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
        elif words.startswith("not YAML"):
            words = f"expected name: value, indented below its field, got {short(text.strip())}"
        return {}, EchoError(line, words)
    if is_map(found) or flow:
        return fields_of(found), None
    return {}, EchoError(lines[0][0], f"expected name: value, got {short(lines[0][1].strip())}")


_FIRST = re.compile(
    r"\{?(header|transforms|transform|translation|pose|position|poses|detections|markers|child_frame_id):\s*($|[{\[])"
)
_PART = re.compile(r"(^|[\s{-])(position|translation):\s*($|\{)", re.MULTILINE)
_NAMES = ("x", "y", "z", "qx", "qy", "qz", "qw")
# Numbers after the frames of the lines of --csv: a pose, and one with its covariance.
_COUNTS = (7, 43)
# Fields of a TransformStamped.
_TRANSFORM = 11
# Fields that a message names.
NAMED = 10


def is_ros_topic(head: str) -> bool:
    """Return whether a text is what the tools print: fields by indentation, or lines of --csv."""
    lines = [line for line in head.split("\n") if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        return False
    if _csv_row(lines[0]) is not None or any(map(PRINTED.search, lines[:20])):
        return True
    first = next((line for line in lines if not SAID.match(line.lstrip()) and line.strip() != "---"), "")
    return bool(_FIRST.match(first)) and bool(_PART.search(head))


def read_ros_topic(text: str, name: str) -> Contents:
    """Return the poses of a text; several pairs of frames are refused by their names."""
    notes: list[str] = []
    records, lines = [], []
    for line, found in records_of(text, name, notes):
        records += found
        lines += [line] * len(found)
    if not records:
        raise InputError(f"{name}: expected messages with poses or transforms, got none.")
    return side_of(records, lines, name, notes)


def records_of(text: str, name: str, notes: list[str]) -> Iterator[tuple[int, list[Stamped]]]:
    """Yield the poses of each message with its line; a message that is cut off at the end is left out, and noted."""
    first = next((line for line in text.split("\n") if line.strip() and not line.lstrip().startswith("#")), "")
    if _csv_row(first) is not None:
        yield from _csv_records(text, name)
        return
    begun = False
    for line, fields, error, ended in messages_of(text):
        try:
            if error is not None:
                raise error
            found = poses_in(fields)
        except (EchoError, MessageError) as problem:
            if begun and not ended:
                notes.append("the last message is cut off, and left out")
                return
            if isinstance(problem, EchoError):
                raise InputError(f"{name}, line {problem.line}: {problem}.") from None
            raise InputError(
                f"{name}, the message at line {line}: expected {problem}, got the fields "
                f"{', '.join(list(fields)[:NAMED]) or 'none'}; echo a topic of poses or /tf (docs/how-to/ros.md)."
            ) from None
        begun = True
        yield line, found


def _csv_row(line: str) -> list[Stamped] | None:
    """Return the poses of a line of --csv, several of a TFMessage; None for any other line."""
    fields = [field.strip() for field in line.strip().split(",")]
    if len(fields) > _TRANSFORM and len(fields) % _TRANSFORM == 0:
        parts = [fields[k : k + _TRANSFORM] for k in range(0, len(fields), _TRANSFORM)]
        found = [one for part in parts if (one := _csv_pose(part)) is not None and one.child]
        return found if len(found) == len(parts) else None
    one = _csv_pose(fields)
    return None if one is None else [one]


def _csv_pose(fields: list[str]) -> Stamped | None:
    if len(fields) < 10 or not (fields[0].isdecimal() and fields[1].isdecimal() and int(fields[1]) < 10**9):
        return None
    frames = 2
    while frames < len(fields) and not is_number(fields[frames].encode()):
        frames += 1
    count = len(fields) - frames
    if frames not in (3, 4) or count not in _COUNTS or (count == 43 and frames == 4):
        return None
    if not all(is_number(field.encode()) for field in fields[frames:]):
        return None
    numbers = tuple(map(float, fields[frames : frames + 7]))
    if abs(sum(q * q for q in numbers[3:]) - 1.0) > 2e-3:
        return None
    parent, child = frame_name(fields[2]), frame_name(fields[3]) if frames == 4 else ""
    return Stamped(float(fields[0]) + 1e-9 * float(fields[1]), parent, child, numbers)


def _csv_records(text: str, name: str) -> Iterator[tuple[int, list[Stamped]]]:
    for number, line in enumerate(text.split("\n"), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if (found := _csv_row(line)) is None:
            raise InputError(
                f"{name}, line {number}: expected sec,nanosec,frame_id,{','.join(_NAMES)} as ros2 topic echo --csv "
                "prints a PoseStamped, got another line."
            )
        yield number, found
