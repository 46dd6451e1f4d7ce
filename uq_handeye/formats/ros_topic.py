"""Output of ``ros2 topic echo`` (ROS 2) and ``rostopic echo`` (ROS 1): messages that hold poses, ``---`` after each.

The messages are Pose, PoseStamped, PoseWithCovarianceStamped, TransformStamped, TFMessage, Odometry and the others of
`ros_messages`, also as rospy and rclpy print them; of ``ros2 topic echo --csv`` PoseStamped, PoseWithCovarianceStamped
and TransformStamped, whose columns are sec, nanosec, frame_id(, child_frame_id), x, y, z, qx, qy, qz, qw. Sources:
``ros2topic/ros2topic/verb/echo.py`` in ros2/ros2cli with ``rosidl_runtime_py/convert.py`` in
ros2/rosidl_runtime_py; ``tools/rostopic`` in ros/ros_comm.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from ..core.files.lines import is_number
from ..core.limits import MAX_LISTED
from ..errors import InputError
from .contents import Contents
from .echoed_messages import PRINTED, TOOL_LINE, messages_of
from .ros_messages import MessageError, Stamped, frame_name, poses_in
from .ros_sides import side_of

_FIRST = re.compile(
    r"\{?(header|transforms|transform|translation|pose|position|detections|markers|child_frame_id):\s*($|[{\[])"
)
# A part with x below it, not a list.
_PART = re.compile(r"(?:^|[\s{-])(?:position|translation):\s*(?:\{\s*)?x:", re.MULTILINE)
_NAMES = ("x", "y", "z", "qx", "qy", "qz", "qw")


def is_ros_topic(head: str) -> bool:
    """Return whether a text is what the tools print: fields by indentation, or lines of --csv."""
    lines = [line for line in head.split("\n") if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        return False
    if _csv_row(lines[0]) is not None or any(map(PRINTED.search, lines[:20])):
        return True
    first = next((line for line in lines if not TOOL_LINE.match(line.lstrip()) and line.strip() != "---"), "")
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
    for line, fields, wrong, ended in messages_of(text):
        try:
            if wrong is not None:
                raise MessageError(wrong[1])
            found = poses_in(fields)
        except MessageError as problem:
            if begun and not ended:
                notes.append("the last message is cut off, and left out")
                return
            if wrong is not None:
                raise InputError(f"{name}, line {wrong[0]}: {wrong[1]}.") from None
            raise InputError(
                f"{name}, the message at line {line}: expected {problem}, got the fields "
                f"{', '.join(list(fields)[:MAX_LISTED]) or 'none'}; echo a topic of poses or /tf (docs/how-to/ros.md)."
            ) from None
        begun = True
        yield line, found


def _csv_row(line: str) -> list[Stamped] | None:
    """Return the poses of a line of --csv, several of a TFMessage; None for any other line."""
    fields = [field.strip() for field in line.strip().split(",")]
    if len(fields) > 11 and len(fields) % 11 == 0:
        parts = [fields[k : k + 11] for k in range(0, len(fields), 11)]
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
    if frames not in (3, 4) or count not in (7, 43) or (count == 43 and frames == 4):
        return None
    if not all(is_number(field.encode()) for field in fields[frames:]):
        return None
    numbers = tuple(map(float, fields[frames : frames + 7]))
    if abs(sum(q * q for q in numbers[3:]) - 1.0) > 2e-3:
        return None
    parent, child = frame_name(fields[2]), frame_name(fields[3]) if frames == 4 else ""
    covariance = tuple(map(float, fields[frames + 7 :])) or None
    return Stamped(float(fields[0]) + 1e-9 * float(fields[1]), parent, child, numbers, covariance)


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
