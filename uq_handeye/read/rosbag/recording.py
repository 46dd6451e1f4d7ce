"""`Recording`: the robot and camera messages of a bag, or of texts of ``ros2 topic echo``, read once."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from ...core.files.lines import decoded
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.source import Source
from ...core.limits import MAX_TABLE_BYTES
from ...errors import InputError
from ...formats.ros_messages import MessageError, number, pair_text, part, poses_in, printed_name, when_and_where
from ...formats.ros_topic import is_ros_topic, records_of
from .bag import HINT, Bag, Message, Topic, is_bag, opened_bag
from .camera_info import CameraInfo, camera_info_of
from .joints import JointTopic, JointTrack
from .tags import TagTrack, corners_in
from .track import Pair, Track
from .tree import Tree

FORMAT = "rosbag"
# The topic as which a text of transforms is listed.
TEXT_TOPIC = "/tf"


@dataclass
class Recording:
    """Content of a bag, by topic."""

    name: str
    topics: dict[str, Topic] = field(default_factory=dict)
    tree: Tree = field(default_factory=Tree)
    poses: dict[str, dict[Pair, Track]] = field(default_factory=dict)
    tags: dict[str, dict[Pair, TagTrack]] = field(default_factory=dict)
    joints: dict[str, JointTopic] = field(default_factory=dict)
    infos: dict[str, CameraInfo] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    duration: float = 0.0
    size: int = 0
    digest: str = ""

    def source(self, notes: Iterable[str]) -> Source:
        """Return where poses come from; the hash is of the messages that were read."""
        return Source(self.name, FORMAT, self.size, self.digest, (*self.notes, *notes))

    def joint_tracks(self, topic: str) -> list[JointTrack]:
        """Return the joint values of a topic, those of most joints first."""
        found = self.joints.get(topic) or self.joints.get(f"/{topic}")
        if found is None or not found.sets:
            there = ", ".join(self.joints) or "none"
            raise InputError(
                f"--joints {topic}: {self.name} has no such topic of JointState; there are: {there}. {HINT}."
            )
        return found.tracks


def read_recording(paths: StrPath | Iterable[StrPath]) -> Recording:
    """Read what a bag, or several bags of one session, hold of robot and camera.

    Parameters
    ----------
    paths : path or several
        ``.bag`` of ROS 1; of ROS 2 the folder or ``.db3``; ``.mcap`` of ROS or Foxglove; texts of ``ros2 topic echo``.

    Raises
    ------
    InputError
        A file that cannot be read, in one line.
    MissingExtraError
        rosbags is not installed.
    """
    files = [as_path(paths)] if isinstance(paths, str | os.PathLike) else _several(paths)
    reader = _Reader(Recording(", ".join(shown(Path(file.name)) for file in files)))
    for file in files:
        if is_bag(file) or not _text(reader, file):
            with opened_bag(file) as bag:
                reader.read(bag)
    found = reader.found
    found.digest = reader.hash.hexdigest()
    for line, count in reader.problems.items():
        found.notes.append(f"{line}: {count} messages are left out")
    return found


def _several(paths: Iterable[StrPath]) -> list[Path]:
    try:
        files = [as_path(path) for path in paths]
    except TypeError:
        raise InputError(f"Expected the path of a bag, got {type(paths).__name__}.") from None
    if not files:
        raise InputError("Expected the path of a bag, got none.")
    return files


def _text(reader: _Reader, path: Path) -> bool:
    """Read a text of ``topic echo``; False: the file is no such text."""
    name = shown(path)
    with opened(path, MAX_TABLE_BYTES) as file:
        if not is_ros_topic(file.read(65536).decode("utf-8", errors="replace")):
            return False
        file.seek(0)
        data = file.read()
    text = decoded(data.removeprefix(b"\xef\xbb\xbf"), f"{name}: expected what ros2 topic echo prints")
    reader.hash.update(data)
    reader.found.size += len(data)
    found = reader.found
    topic = found.topics.setdefault(TEXT_TOPIC, Topic(TEXT_TOPIC, "text of topic echo", 0, "transforms"))
    for _, records in records_of(text, name, found.notes):
        topic.count += 1
        for record in records:
            if record.time is None or not (record.parent and record.child):
                raise InputError(
                    f"{name}: expected transforms with stamps and both frames (/tf, TransformStamped), got poses. Give "
                    "the file as ROBOT or CAMERA."
                )
            topic.first, topic.last = min(topic.first, record.time), max(topic.last, record.time)
            found.tree.track((record.parent, record.child)).add(record.time, record.numbers)
    found.duration = max(found.duration, topic.duration)
    return True


class _Reader:
    """Sorts the messages of bags into a `Recording`."""

    def __init__(self, found: Recording) -> None:
        self.found = found
        self.hash = hashlib.sha256()
        self.problems: dict[str, int] = {}

    def read(self, bag: Bag) -> None:
        found = self.found
        found.duration = max(found.duration, bag.duration)
        for one in bag.topics:
            topic = found.topics.setdefault(one.name, one)
            topic.count += one.count if topic is not one else 0
        take = {"transforms": self._transforms, "poses": self._poses, "tags": self._tags}
        take |= {"joints": self._joints, "info": self._info}
        for message in bag.messages(found.notes.append):
            self.hash.update(message.data)
            found.size += len(message.data)
            try:
                take[message.kind](message)
            except MessageError as error:
                words = f"{message.topic}: expected {error}"
                self.problems[words] = self.problems.get(words, 0) + 1

    def _at(self, message: Message, time: float | None) -> float:
        """Return the time of a pose: its stamp, or when it was received if it has none."""
        at = time if time else message.received
        topic = self.found.topics[message.topic]
        topic.first, topic.last = min(topic.first, at), max(topic.last, at)
        return at

    def _transforms(self, message: Message) -> None:
        static = message.topic.rstrip("/").endswith("static")
        for record in poses_in(message.value):
            if not (record.parent and record.child):
                raise MessageError("transforms with both frames")
            if record.parent == record.child:
                raise MessageError("transforms between two frames")
            track = self.found.tree.track((record.parent, record.child))
            track.static |= static
            track.add(self._at(message, record.time), record.numbers)

    def _poses(self, message: Message) -> None:
        for record in poses_in(message.value):
            tracks = self.found.poses.setdefault(message.topic, {})
            pair = (record.parent, record.child)
            track = tracks.setdefault(pair, Track(f"{message.topic} ({pair_text(*pair)})"))
            track.add_pose(self._at(message, record.time), record)

    def _tags(self, message: Message) -> None:
        time, frame = when_and_where(message.value)
        corners = corners_in(message.value)
        if corners is None:
            self._poses(message)
            if (topic := self.found.topics[message.topic]).last < topic.first:
                self._at(message, time)
            return
        at = self._at(message, time)
        for name, pixels in corners:
            tags = self.found.tags.setdefault(message.topic, {})
            tags.setdefault((frame, name), TagTrack(f"{message.topic} ({pair_text(frame, name)})")).add(at, pixels)

    def _joints(self, message: Message) -> None:
        at = self._at(message, when_and_where(message.value)[0])
        joints = part(message.value, "joints")
        if joints is None:
            given, positions = part(message.value, "name"), part(message.value, "position")
        else:  # of Foxglove: a message for each, which may lack its position
            moved = [one for one in joints if part(one, "position") is not None]
            given, positions = ([part(one, name) for one in moved] for name in ("name", "position"))
        if given is None or positions is None or len(given) != len(positions) or not len(given):
            raise MessageError("as many positions as names of joints")
        names = [printed_name(str(name)) for name in given]
        values = [number(value, "position") for value in positions]
        if len(set(names)) < len(names):
            raise MessageError("each joint once")
        self.found.joints.setdefault(message.topic, JointTopic()).add(at, names, values)

    def _info(self, message: Message) -> None:
        self._at(message, when_and_where(message.value)[0])
        info = camera_info_of(message.value)
        before = self.found.infos.setdefault(message.topic, info)
        if not before.like(info):
            raise MessageError("the same intrinsics as in the first message")
