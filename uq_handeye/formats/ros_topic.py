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

Output of ``ros2 run tf2_ros tf2_echo PARENT CHILD`` (ROS 2) and ``rosrun tf tf_echo PARENT CHILD`` (ROS 1).

    At time 1700000000.250000000
    - Translation: [0.400, -0.100, 0.500]
    - Rotation: in Quaternion (xyzw) [0.000, 0.000, 0.707, 0.707]
    - Rotation: in RPY (radian) [0.000, -0.000, 1.571]
    - Rotation: in RPY (degree) [0.000, -0.000, 90.000]

Sources: ``tf2_ros/src/tf2_echo.cpp`` in ros2/geometry2 and ``tf/src/tf_echo.cpp`` in ros/geometry. What is printed is
``parent_T_child``, in metres, the scalar of the quaternion last; RPY are angles about fixed axes. The numbers have
three decimals unless tf2_echo was given a precision. Of a rotation with few decimals the degrees say more than the
quaternion, which they must agree with. tf2_echo prints the nanoseconds of a stamp without leading zeros.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..core.files.lines import floats, is_number
from ..core.files.one_line import short
from ..core.files.tree_values import fields_of, is_map
from ..core.files.trees import parse_yaml
from ..core.geometry.se3 import Array
from ..errors import InputError
from .contents import Contents
from .ros_messages import MessageError, Stamped, frame_name, one_side, poses_in, side_of, unit_quaternions

_AT = re.compile(r"line (\d+):")
# A field, an item, or a list of numbers over several lines.
_FIELD_LINE = re.compile(r"\s*(?:- )*[A-Za-z_]\w*:(?:\s|$)|\s*-\s|[\s\d.,eE+\[\]-]+$")
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
        elif words.startswith("not YAML"):  # found where the next line does not go on
            line, text = next((one for one in lines if not _FIELD_LINE.match(one[1])), (line, text))
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
            if error is not None:
                raise InputError(f"{name}, line {error.line}: {error}.") from None
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


_TIME = re.compile(r"At time\s+(-?\d+)(?:\.(\d+))?\s*$")
_NUMBERS = r"\[?\s*([^\]]*?)\s*\]?\s*$"
_TRANSLATION = re.compile(r"-?\s*Translation:\s*" + _NUMBERS)
_QUATERNION = re.compile(r"-?\s*(?:Rotation:)?\s*in Quaternion\s*(?:\(xyzw\))?\s*" + _NUMBERS)
_DEGREES = re.compile(r"-?\s*(?:Rotation:)?\s*in RPY \(degrees?\)\s*" + _NUMBERS)
# Decimals up to which the degrees are used in place of the quaternion, and a rotation is named coarse.
FEW, COARSE = 6, 4


def is_tf_echo(head: str) -> bool:
    """Return whether a text is what tf_echo prints."""
    if "in Quaternion" not in head:
        return False
    lines = (line.lstrip(" \t-") for line in head.splitlines())
    return any(line.startswith("Translation:") and "[" in line for line in lines)


def read_tf_echo(text: str, name: str) -> Contents:
    """Return the poses of a text, one per block."""
    blocks = _blocks(text, name)
    if not blocks:
        raise InputError(
            f"{name}: expected blocks of tf_echo (At time, Translation, Rotation: in Quaternion), got none."
        )
    notes: list[str] = []
    if len(blocks) > 1 and blocks[-1].quaternion is None:
        notes.append("the last block is incomplete, and left out")
        blocks.pop()
    for block in blocks:
        if block.translation is None or block.quaternion is None:
            lacks = "Translation" if block.translation is None else "Rotation: in Quaternion"
            raise InputError(f"{name}, line {block.line}: expected the line {lacks} after it, got none.")
    rows = [(*block.translation, *block.quaternion) for block in blocks]  # type: ignore[misc]
    numbers = np.array(rows, dtype=float)
    decimals = max(block.decimals for block in blocks)
    numbers[:, 3:] = unit_quaternions(numbers[:, 3:], decimals)
    if decimals <= FEW and all(block.degrees is not None for block in blocks):
        degrees = np.array([block.degrees for block in blocks])
        numbers[:, 3:], by_angles = _by_degrees(numbers[:, 3:], degrees, decimals)
        if by_angles:
            notes.append("rotations from the lines in degrees, which have more digits than the quaternions")
    if decimals <= COARSE:
        notes.append(
            f"{decimals} decimals: translations are rounded to {10.0 ** (3 - decimals):g} mm; ros2 topic echo has all "
            "digits, tf2_echo more with -p 9"
        )
    lines = np.array([block.line for block in blocks])
    return one_side(name, numbers, _stamps(blocks), lines, notes)


class _Block:
    """Lines of one pose, after ``At time``."""

    def __init__(self, line: int, stamp: tuple[str, str] | None) -> None:
        self.line, self.stamp = line, stamp
        self.translation: list[float] | None = None
        self.quaternion: list[float] | None = None
        self.degrees: list[float] | None = None
        self.decimals = 0


def _blocks(text: str, name: str) -> list[_Block]:
    blocks: list[_Block] = []
    for line, raw in enumerate(text.split("\n"), start=1):
        body = raw.strip()
        if time := _TIME.match(body):
            blocks.append(_Block(line, (time.group(1), time.group(2) or "0")))
            continue
        for part, pattern, count in (
            ("translation", _TRANSLATION, 3),
            ("quaternion", _QUATERNION, 4),
            ("degrees", _DEGREES, 3),
        ):
            if (found := pattern.match(body)) is None:
                continue
            if not blocks or (part == "translation" and blocks[-1].translation is not None):
                blocks.append(_Block(line, None))  # without the line of the time
            values = _values(found.group(1), count, f"{name}, line {line}")
            if values is None and part == "degrees":
                continue
            if values is None:
                if part == "quaternion":  # cut off; it is an error unless it is the last block
                    continue
                raise InputError(
                    f"{name}, line {line}: expected {count} numbers in brackets, got {short(found.group(1))}."
                )
            setattr(blocks[-1], part, values)
            if part == "quaternion":
                blocks[-1].decimals = max(len(word.partition(".")[2]) for word in re.split(r"[,\s]+", found.group(1)))
    return blocks


def _values(text: str, count: int, where: str) -> list[float] | None:
    """Return numbers separated by commas or blanks, or None if they are not as many."""
    words = [word for word in re.split(r"[,\s]+", text) if word]
    if len(words) != count:
        return None
    if (numbers := floats(words)) is None:
        raise InputError(f"{where}: expected numbers, got {short(text)}.")
    return numbers


def _by_degrees(q: Array, degrees: Array, decimals: int) -> tuple[Array, bool]:
    """Return the rotations of RPY in degrees as quaternions (n, 4), if they agree with those within the rounding."""
    norm = np.linalg.norm(q, axis=1)
    if not np.isfinite(degrees).all() or not (norm > 0).all():
        return q, False
    by_angles = Rotation.from_euler("xyz", degrees, degrees=True)
    apart = (by_angles.inv() * Rotation.from_quat(q)).magnitude()
    if (apart > 3.0 * 10.0**-decimals).any():
        return q, False
    return by_angles.as_quat(), True


def _stamps(blocks: list[_Block]) -> NDArray[np.float64] | None:
    """Return the times; None where a block has none, or all are 0 as of static transforms."""
    if any(block.stamp is None for block in blocks):
        return None
    stamps = [block.stamp for block in blocks if block.stamp is not None]
    longest = max(len(rest) for _, rest in stamps)
    if longest == 9:  # nanoseconds as a whole number
        return np.array([float(whole) + 1e-9 * float(rest) for whole, rest in stamps])
    times = np.array([float(f"{whole}.{rest}") for whole, rest in stamps])
    return None if len(times) > 1 and not times.any() else times
