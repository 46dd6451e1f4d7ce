"""Poses in messages of ROS, recognised by the names of their fields: nested dicts of a text, or objects of a bag.

Fields as in ros/common_msgs and ros2/common_interfaces (``geometry_msgs/msg``: Pose, PoseStamped, PoseArray,
PoseWithCovarianceStamped, TransformStamped; ``nav_msgs/msg/Odometry``), ros2/geometry2 (``tf2_msgs/msg/TFMessage``),
AprilRobotics/apriltag_ros (``AprilTagDetectionArray``, with poses), pal-robotics/aruco_ros
(``aruco_msgs/MarkerArray``), JMU-ROBOTICS-VIVA/ros2_aruco (``ArucoMarkers``) and fictionlab/ros_aruco_opencv
(``ArucoDetection``, with boards by their names); foxglove/foxglove-sdk (FrameTransform, FrameTransforms, PoseInFrame,
PosesInFrame, Odometry), whose time and frame are fields of the message itself, without a header. Metres; quaternions by
the names x, y, z, w. A pose is that of the child in the frame of the header: ``parent_T_child``.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

from ..core.files.tree_values import is_map
from ..core.limits import MAX_NAME_CHARACTERS, MAX_ROWS
from .columns import seconds_of

# A message or part of one: nested dicts of a text, or an object of rclpy, rospy or rosbags: no type is common to them.
Message: TypeAlias = Any


# Fields that name the child of a pose: of ROS, and of Foxglove's Odometry.
CHILD_FRAMES = ("child_frame_id", "body_frame_id")


class Stamped(NamedTuple):
    """One pose ``parent_T_child`` of a message."""

    time: float | None  # s; None without a header
    parent: str
    child: str
    numbers: tuple[float, ...]  # x, y, z, qx, qy, qz, qw
    covariance: tuple[float, ...] | None = None  # 36 numbers of PoseWithCovariance, row by row

    @property
    def pair(self) -> str:
        """``parent:child`` as the options name it."""
        return pair_text(self.parent, self.child)


class MessageError(Exception):
    """Error of a message: what it lacks, in a few words."""


def pair_text(parent: str, child: str) -> str:
    """Return ``parent:child``; a message may leave one of them out."""
    return f"{parent or '?'}:{child or '?'}"


def frame_name(text: Message) -> str:
    """Return the name of a frame; ROS 1 may put a slash before it."""
    return printed_name(str(text or "").strip().removeprefix("/"))


def printed_name(text: str) -> str:
    """Return a name as people can read and type it: escaped where it does not print, and cut where it is endless."""
    text = text if text.isprintable() else ascii(text)[1:-1]
    return text if len(text) <= MAX_NAME_CHARACTERS else f"{text[:MAX_NAME_CHARACTERS]}..."


def part(value: Message, name: str) -> Message:
    """Return a field of a message, or None."""
    return value.get(name) if is_map(value) else getattr(value, name, None)


def stamp_of(header: Message) -> float | None:
    """Return the time of a header in seconds, or None if it has none."""
    return _seconds(part(header, "stamp"))


def _seconds(stamp: Message) -> float | None:
    """Return a time in seconds: of ROS 2, of ROS 1, of Foxglove in JSON, of Protocol Buffers, or as a text."""
    for names in (("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec"), ("seconds", "nanos")):
        whole, rest = (part(stamp, name) for name in names)
        if whole is not None and rest is not None:
            return number(whole, "stamp") + 1e-9 * number(rest, "stamp")
    return seconds_of(stamp) if isinstance(stamp, str) else None


def when_and_where(message: Message) -> tuple[float | None, str]:
    """Return the time of a message (s; None without a stamp) and its frame, by its header or by its own fields."""
    if (header := part(message, "header")) is not None:
        return stamp_of(header), frame_name(part(header, "frame_id"))
    frame = part(message, "parent_frame_id")
    return _seconds(part(message, "timestamp")), frame_name(part(message, "frame_id") if frame is None else frame)


def number(value: Message, name: str) -> float:
    """Return a number, or raise `MessageError`."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise MessageError(f"a number in {name}") from None


def poses_in(message: Message) -> list[Stamped]:
    """Return every pose of a message, in its order; raises `MessageError` if it holds none."""
    found = _poses(message, None, "", "")
    if found is None:
        raise MessageError("a pose or a transform")
    return found


def _poses(value: Message, time: float | None, parent: str, child: str) -> list[Stamped] | None:
    """Return the poses of a message or of a part of it; None if it is none that is known."""
    own_time, own_parent = when_and_where(value)
    if part(value, "header") is not None or own_time is not None:
        time = own_time
    parent = own_parent or parent
    named = next((name for key in CHILD_FRAMES if (name := part(value, key)) is not None), None)
    child = child if named is None else frame_name(named)
    if part(value, "translation") is not None and part(value, "rotation") is not None:
        return [_numbers(value, ("translation", "rotation"), time, parent, child)]
    if part(value, "position") is not None and part(value, "orientation") is not None:
        return [_numbers(value, ("position", "orientation"), time, parent, child)]
    for name in ("transforms", "detections", "markers"):
        items = part(value, name)
        if items is not None:
            items = _listed(items, name) + _listed(part(value, "boards") or [], "boards")
            return [one for item in items for one in _poses(item, time, parent, _marker(item)) or []]
    poses, ids = part(value, "poses"), part(value, "marker_ids")
    if poses is not None:
        items = _listed(poses, "poses")
        names = [f"pose_{k}" for k in range(len(items))] if len(items) > 1 else [child]
        if ids is not None:
            names = [f"marker_{number(k, 'marker_ids'):.0f}" for k in _listed(ids, "marker_ids")]
        if len(names) != len(items) and items:
            raise MessageError("as many marker_ids as poses")
        return [one for item, name in zip(items, names, strict=False) for one in _poses(item, time, parent, name) or []]
    for name in ("transform", "pose"):
        if (inner := part(value, name)) is not None:
            found = _poses(inner, time, parent, child)
            covariance = part(value, "covariance")
            if covariance is None or found is None or len(found) != 1:
                return found
            return [found[0]._replace(covariance=_covariance(covariance))]
    return None


def _covariance(value: Message) -> tuple[float, ...] | None:
    """Return the 36 numbers of a covariance; None where they are not 36 numbers."""
    try:
        numbers = tuple(float(x) for x in value)
    except (TypeError, ValueError):
        return None
    return numbers if len(numbers) == 36 else None


def _listed(value: Message, name: str) -> list[Message]:
    try:
        items = list(value)
    except TypeError:
        raise MessageError(f"a list of {name}") from None
    if len(items) > MAX_ROWS:
        raise MessageError(f"at most {MAX_ROWS} {name}")
    return items


def _marker(item: Message) -> str:
    """Return the name of a tag or marker by its number: tag_3 of apriltag_ros, marker_3 of aruco_msgs."""
    ids, name = part(item, "id"), "marker_"
    ids = part(item, "marker_id") if ids is None else ids
    if ids is None:
        return frame_name(part(item, "board_name"))
    alone = not hasattr(ids, "__iter__")  # a text or a list of one or more is of apriltag_ros
    if part(item, "size") is not None or not alone:
        name = "tag_"
    values = [ids] if alone or type(ids) is str else _listed(ids, "id")
    return name + "_".join(f"{number(k, 'id'):.0f}" for k in values)


def _numbers(value: Message, names: tuple[str, str], time: float | None, parent: str, child: str) -> Stamped:
    fields = []
    for name, axes in zip(names, ("xyz", "xyzw"), strict=True):
        inner = part(value, name)
        for axis in axes:
            if (entry := part(inner, axis)) is None:
                raise MessageError(f"{name}.{axis}")
            fields.append(number(entry, f"{name}.{axis}"))
    return Stamped(time, parent, child, tuple(fields))
