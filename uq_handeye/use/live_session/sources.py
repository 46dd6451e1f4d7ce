"""The interface of all sources of poses, and how one feeds a session.

JSON lines from another program: one pair of poses on each line, in any form that a JSON file of poses may have.

{"robot": [[1, 0, 0, 0.4], ...], "camera": [[...], ...], "timestamp": 12.5}

Where the robot is asked for its pose when a line comes, a line holds the camera pose alone.

A bag played back: its streams on one clock, pair by pair, as if the robot moved again.

Poses of a running ROS 2 system, by tf or by topics, taken when the robot stands still.

A transform that tf calls ``parent -> child`` is the pose ``parent_T_child``: robot ``base_T_gripper``, camera
``camera_T_target``; a topic of poses holds these. The newest is taken; one older than `OLD` is refused.

Poses of an arm of Universal Robots by RTDE.

RTDE gives the pose of the tool as x, y, z (m) and a rotation vector (rad), base_T_gripper.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, TextIO

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.geometry.se3 import Array
from ...errors import InputError, MissingExtraError
from ...formats.contents import FRAMES, finished
from ...formats.json_poses import read_json
from ...formats.ros_messages import MessageError, Stamped, poses_in
from ...model.poses.pose_pairs import Stream
from ...read.synchronisation.synchronise import synchronise
from .session import Session

# Largest difference of the stamps of one pair (s).
APART = 0.2


class Pair(NamedTuple):
    """A robot pose base_T_gripper and a camera pose camera_T_target, (4, 4) in m; the time in s, if known."""

    robot: Array
    camera: Array
    time: float | None = None


class Source(Protocol):
    """Something that poses come from.

    ``name`` is said to the user. With ``on_demand`` a pair is taken when the user says that the robot stands still;
    otherwise pairs come by themselves, and ``pending`` says that the next one waits already.
    """

    name: str
    on_demand: bool

    @property
    def pending(self) -> bool: ...

    def take(self) -> Pair | None:
        """Return the next pair; None: there will be no more. Raises `InputError` for one that cannot be used."""

    def close(self) -> None:
        """Let go of what the source holds."""


class Side:
    """One side of a pair, robot or camera, that can be asked at any time."""

    def newest(self) -> tuple[Array, float | None]:
        """Return the newest pose (4, 4) and its time (s), if it is on a clock; raises `InputError` if there is none."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of what the side holds."""


class Function(Side):
    """A side whose pose (4, 4) a function returns."""

    def __init__(self, function: Callable[[], Array]) -> None:
        self._function = function

    def newest(self) -> tuple[Array, float | None]:
        """Call the function."""
        return np.asarray(self._function(), dtype=float), None


class Taken:
    """Pairs of two sides, taken when the user says that the robot stands still."""

    on_demand, pending = True, False

    def __init__(self, name: str, robot: Side, camera: Side) -> None:
        self.name, self._robot, self._camera = name, robot, camera

    def take(self) -> Pair:
        """Return the newest pair; raises `InputError` where the two are of different moments."""
        (robot, at), (camera, seen) = self._robot.newest(), self._camera.newest()
        if at is not None and seen is not None and abs(at - seen) > APART:
            raise InputError(f"Robot and camera were stamped {abs(at - seen):.2f} s apart. Let the robot stand still.")
        return Pair(robot, camera, at if seen is None else seen)

    def close(self) -> None:
        """Close both sides."""
        self._robot.close()
        self._camera.close()


def feed(session: Session, source: Source, stop: threading.Event) -> None:
    """Add the pairs of a source that come by themselves, until it ends; what cannot be used is noted in the session."""
    while not stop.is_set():
        try:
            pair = source.take()
            if pair is None:
                return
            session.add(*pair, ask=not source.pending)
        except InputError as error:
            session.note(str(error))
            session.update()


# Longest line (characters); lines read ahead.
MOST, AHEAD = 100_000, 1000


class Lines:
    """Pairs from a text stream; ``how`` are arguments of `read_poses` on units and frames.

    ``robot``: asked when a line comes, in place of robot poses on the lines.
    """

    on_demand = False

    def __init__(
        self, stream: TextIO, how: Mapping[str, Any] | None = None, name: str = "standard input",
        robot: Side | None = None,
    ) -> None:  # fmt: skip
        self.name, self._how, self._count, self._robot = name, dict(how or {}), 0, robot
        self._lines: queue.Queue[str | None] = queue.Queue(AHEAD)
        threading.Thread(target=self._read, args=(stream,), daemon=True).start()

    def _read(self, stream: TextIO) -> None:
        while line := stream.readline(MOST + 1):
            if line.strip():
                self._lines.put(line)
        self._lines.put(None)

    @property
    def pending(self) -> bool:
        """True if another line waits."""
        return not self._lines.empty() and self._lines.queue[0] is not None

    def take(self) -> Pair | None:
        """Return the pair of the next line; None at the end."""
        line = self._lines.get()
        if line is None:
            return None
        self._count += 1
        return pair_of(line, f"{self.name}, line {self._count}", self._how, self._robot)

    def close(self) -> None:
        """Let go of the robot."""
        if self._robot is not None:
            self._robot.close()


def pair_of(line: str, name: str, how: Mapping[str, Any] | None = None, robot: Side | None = None) -> Pair:
    """Return the pair on one line, read as a JSON file of poses is; raises `InputError` naming the line."""
    how = how or {}
    if len(line) > MOST:
        raise InputError(f"{name}: longer than {MOST} characters. Write one pair of poses on each line.")
    try:
        tree = json.loads(line)
    except ValueError as error:
        raise InputError(f'{name}: expected JSON such as {{"robot": ..., "camera": ...}}: {error}.') from None
    contents = read_json([tree] if isinstance(tree, dict) else tree, name)
    poses, time = [], None
    for k, role in enumerate(FRAMES):
        if robot is not None and role == "robot":
            poses.append(robot.newest()[0])
            continue
        side = getattr(contents, role) or (contents.only if robot is not None else None)
        if side is None or len(side) != 1:
            what = "one robot and one camera pose, by the keys robot and camera"
            raise InputError(f"{name}: expected {what if robot is None else 'one camera pose, by the key camera'}.")
        unit, form = (how.get(key, (None, None))[k] for key in ("units", "rotation"))
        poses.append(finished(side, role, unit, form, how.get(f"{role}_frame", FRAMES[role][0]))[0])
        time = time if side.timestamps is None else float(side.timestamps[0])
    return Pair(poses[0], poses[1], time)


class Playback:
    """Pairs of two streams in the order of time; ``how`` are further arguments of `synchronise`.

    ``pause`` waits ``interval`` seconds before each pair but the first; 0: as fast as the answers.
    """

    on_demand = False

    def __init__(
        self, robot: Stream, camera: Stream, interval: float = 0.0, how: Mapping[str, Any] | None = None,
        name: str = "bag", pause: Callable[[float], None] = time.sleep,
    ) -> None:  # fmt: skip
        self.name, self._interval, self._pause, self._next = name, interval, pause, 0
        self._poses = synchronise(robot, camera, **(how or {})).poses

    @property
    def pending(self) -> bool:
        """True if the next pair is shown without a pause."""
        return self._interval == 0 and self._next < self._poses.n

    def take(self) -> Pair | None:
        """Return the next pair; None at the end."""
        k = self._next
        if k >= self._poses.n:
            return None
        if k and self._interval:
            self._pause(self._interval)
        self._next += 1
        times = self._poses.timestamps
        return Pair(self._poses.robot[k], self._poses.camera[k], None if times is None else float(times[k]))

    def close(self) -> None:
        """Nothing is held."""


# Largest age (s).
OLD = 2.0

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
        self._last: tuple[Any, float] | None = None

    def receive(self, message: Any) -> None:
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


def _pose(message: Any, name: str, now: Clock, came: float | None = None) -> tuple[Array, float | None]:
    """Return the one pose of a message, and its stamp; None: a static transform."""
    try:
        found: list[Stamped] = poses_in(message)
    except MessageError as error:
        raise InputError(f"{name}: expected {error}.") from error
    if len(found) != 1:
        raise InputError(f"{name}: expected one pose in a message, got {len(found)}. Give its frames of tf.")
    time = found[0].time or came
    if time is not None and now() - time > OLD:
        raise InputError(f"{name}: the newest pose is {now() - time:.1f} s old. Is the target in view?")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(found[0].numbers[3:]).as_matrix(), found[0].numbers[:3]
    return T, time


# Largest speed of the tool (m/s, rad/s) at which a pose is taken.
STILL = 1e-3


class Ur(Side):
    """The arm at ``host``, as a side of a pair; its clock is not that of other programs.

    ``receiver`` stands in for that of ur_rtde.
    """

    def __init__(self, host: str, receiver: Any = None) -> None:
        if receiver is None:
            try:
                from rtde_receive import RTDEReceiveInterface
            except ImportError as error:
                raise MissingExtraError("Poses by RTDE need ur_rtde: pip install ur_rtde.") from error
            try:
                receiver = RTDEReceiveInterface(host)
            except RuntimeError as error:
                raise InputError(f"No arm answers by RTDE at {host}: {error}. Check the address.") from error
        self._receiver = receiver

    def newest(self) -> tuple[Array, float | None]:
        """Return the pose of this moment; raises `InputError` while the arm moves."""
        speed = float(np.abs(self._receiver.getActualTCPSpeed()).max())
        if speed > STILL:
            raise InputError(f"The arm moves ({speed:.3f} m/s or rad/s). Take the pose when it stands still.")
        pose = np.asarray(self._receiver.getActualTCPPose(), dtype=float)
        robot = np.eye(4)
        robot[:3, :3], robot[:3, 3] = Rotation.from_rotvec(pose[3:]).as_matrix(), pose[:3]
        return robot, None

    def close(self) -> None:
        """End the connection."""
        self._receiver.disconnect()
