"""Poses of a running ROS 2 system by tf, taken when the robot stands still.

A transform that tf calls ``parent -> child`` is the pose ``parent_T_child``: robot ``base_T_gripper``, camera
``camera_T_target``. The newest of both are taken; where they were stamped further apart than `APART`, or one is older
than `OLD`, nothing is taken.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...errors import InputError, MissingExtraError
from ...geometry.se3 import Array
from .source import Pair

# Largest difference of the stamps of one pair, and largest age (s).
APART, OLD = 0.2, 2.0


class Tf:
    """The pair ``robot`` and ``camera``, each ``"parent:child"``, of a tf buffer.

    ``buffer`` has ``lookup_transform(parent, child, time)`` as that of tf2; ``newest`` is its time that asks for the
    newest; ``now`` returns seconds on the clock of the stamps.
    """

    on_demand, pending = True, False

    def __init__(self, robot: str, camera: str, buffer: Any, newest: Any, now: Any, close: Any = None) -> None:
        self.name = "tf"
        self._frames = {"robot": _two(robot, "robot"), "camera": _two(camera, "camera")}
        self._buffer, self._newest, self._now, self._close = buffer, newest, now, close

    def take(self) -> Pair:
        """Return the newest pair; raises `InputError` where a transform is missing, old, or of another moment."""
        (robot, at), (camera, seen) = (self._pose(side) for side in ("robot", "camera"))
        if at and seen and abs(at - seen) > APART:  # 0: static
            raise InputError(f"Robot and camera were stamped {abs(at - seen):.2f} s apart. Let the robot stand still.")
        age = self._now() - max(at, seen)
        if (at or seen) and age > OLD:
            raise InputError(f"The newest transforms are {age:.1f} s old. Is the target in view?")
        return Pair(robot, camera, max(at, seen) or None)

    def _pose(self, side: str) -> tuple[Array, float]:
        parent, child = self._frames[side]
        try:
            stamped = self._buffer.lookup_transform(parent, child, self._newest)
        except Exception as error:  # of tf2, which need not be installed where this is tested
            raise InputError(f"tf knows no {side} pose {parent} -> {child}: {error}") from error
        move, turn, stamp = stamped.transform.translation, stamped.transform.rotation, stamped.header.stamp
        T = np.eye(4)
        T[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        T[:3, 3] = move.x, move.y, move.z
        return T, stamp.sec + 1e-9 * stamp.nanosec

    def close(self) -> None:
        """End the node."""
        if self._close is not None:
            self._close()


def tf_source(robot: str, camera: str) -> Tf:
    """Return the source of a node of its own; raises `MissingExtraError` where there is no rclpy."""
    try:
        import rclpy
        from rclpy.time import Time
        from tf2_ros import Buffer, TransformListener
    except ImportError as error:
        raise MissingExtraError("--ros needs rclpy and tf2_ros. Start it in a shell where ROS 2 is set up.") from error
    rclpy.init()
    node = rclpy.create_node("uq_handeye_live")
    buffer = Buffer()
    TransformListener(buffer, node)
    thread = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
    thread.start()
    return Tf(robot, camera, buffer, Time(), lambda: 1e-9 * node.get_clock().now().nanoseconds, rclpy.shutdown)


def _two(frames: str, name: str) -> tuple[str, str]:
    parent, colon, child = frames.partition(":")
    if not (parent and colon and child):
        raise InputError(f"Expected the {name} frames as parent:child, e.g. base_link:tool0, got {frames!r}.")
    return parent, child
