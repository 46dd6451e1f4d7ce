"""Poses of a running ROS 2 system, by tf or by topics, taken while the robot does not move.

A transform that tf calls ``parent -> child`` is the pose ``parent_T_child``: robot ``base_T_gripper``, camera
``camera_T_target``; a topic of poses holds these. The newest pose is taken; one older than `MAX_AGE_S` is refused.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...errors import InputError, MissingExtraError
from ...formats.ros_messages import Message, MessageError, Stamped, poses_in
from .sources import Side

MAX_AGE_S = 2.0

Clock = Callable[[], float]


class Tf(Side):
    """A side by tf, ``"parent:child"``.

    ``buffer`` has ``lookup_transform(parent, child, time)`` as that of tf2; ``newest`` is its time that asks for the
    newest; ``now`` returns seconds on the clock of the stamps.
    """

    def __init__(self, frames: str, buffer: Any, newest: Any, now: Clock) -> None:
        self._parent, colon, self._child = frames.partition(":")
        if not (self._parent and colon and self._child):
            raise InputError(f"Expected frames as parent:child, e.g. base_link:tool0, or a /topic, got {frames!r}.")
        self._buffer, self._newest, self._now = buffer, newest, now

    def newest(self) -> tuple[Array, float | None]:
        """Return the newest transform."""
        try:
            stamped = self._buffer.lookup_transform(self._parent, self._child, self._newest)
        except Exception as error:  # of tf2, which need not be installed where this is tested
            raise InputError(f"tf knows no pose {self._parent} -> {self._child}: {error}") from error
        return _pose(stamped, f"{self._parent} -> {self._child}", self._now)


class Topic(Side):
    """A side by a topic of poses: `receive` is what its subscription calls."""

    def __init__(self, name: str, now: Clock) -> None:
        self._name, self._now = name, now
        self._last: tuple[Message, float] | None = None

    def receive(self, message: Message) -> None:
        """Keep the newest message, and when it came."""
        self._last = message, self._now()

    def newest(self) -> tuple[Array, float | None]:
        """Return the pose of the newest message; without a stamp it is of the moment in which it came."""
        if self._last is None:
            raise InputError(f"Nothing has come on {self._name} yet. Is the target in view?")
        message, came = self._last
        return _pose(message, self._name, self._now, came)


class Node:
    """A node of its own, in a thread; raises `MissingExtraError` where there is no rclpy."""

    def __init__(self) -> None:
        try:
            import rclpy
        except ImportError as error:
            raise MissingExtraError("--ros needs rclpy. Start it in a shell where ROS 2 is set up.") from error
        self._rclpy, self._buffer = rclpy, None
        rclpy.init()
        self._node = rclpy.create_node("uq_handeye_live")
        threading.Thread(target=rclpy.spin, args=(self._node,), daemon=True).start()

    def side(self, spec: str) -> Tf | Topic:
        """Return the side by frames ``"parent:child"`` of tf, or by a topic ``"/name"``."""
        if spec.startswith("/"):
            side = Topic(spec, self._now)
            self._node.create_subscription(self._type_of(spec), spec, side.receive, 10)
            return side
        from rclpy.time import Time
        from tf2_ros import Buffer, TransformListener

        if self._buffer is None:
            self._buffer = Buffer()
            self._listener = TransformListener(self._buffer, self._node)
        return Tf(spec, self._buffer, Time(), self._now)

    def _type_of(self, topic: str) -> Any:
        from rosidl_runtime_py.utilities import get_message

        types = dict(self._node.get_topic_names_and_types())
        if topic not in types:
            raise InputError(f"There is no topic {topic}. Topics: {', '.join(sorted(types))}.")
        return get_message(types[topic][0])

    def _now(self) -> float:
        return 1e-9 * float(self._node.get_clock().now().nanoseconds)

    def close(self) -> None:
        """End the node."""
        self._rclpy.shutdown()


def _pose(message: Message, name: str, now: Clock, came: float | None = None) -> tuple[Array, float | None]:
    """Return the one pose of a message, and its stamp; None: a static transform."""
    try:
        found: list[Stamped] = poses_in(message)
    except MessageError as error:
        raise InputError(f"{name}: expected {error}.") from error
    if len(found) != 1:
        raise InputError(f"{name}: expected one pose in a message, got {len(found)}. Give its frames of tf.")
    time = found[0].time or came
    if time is not None and now() - time > MAX_AGE_S:
        raise InputError(f"{name}: the newest pose is {now() - time:.1f} s old. Is the target in view?")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(found[0].numbers[3:]).as_matrix(), found[0].numbers[:3]
    return T, time
