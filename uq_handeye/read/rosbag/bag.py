"""A bag opened for reading: ROS 1 ``.bag``; ROS 2 folders and ``.db3``; ``.mcap`` of any recorder. ROS is not needed.

The package rosbags reads bags of ROS, `mcap` single MCAP files. Guards around them keep a damaged or hostile file from
causing a traceback or filling memory: every failure is one line that names the file, messages are bounded in size, and
so is decompression (`decompression`).
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from ...core.files.one_line import one_line, refused
from ...core.files.open import reason, require_size, shown
from ...core.limits import MAX_DESCRIPTION_BYTES, MAX_MESSAGE_BYTES
from ...errors import InputError, InputWarning, MissingExtraError
from ...formats.ros_messages import printed_name
from .decompression import DamagedError, bound_the_reader
from .mcap import MCAP_MAGIC, McapChannel, McapFile
from .message_types import Decoder, NotRead, RosMessage, Types, kind_of, type_name

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Ros1Reader
    from rosbags.rosbag2 import Reader as Ros2Reader

# A topic of a bag as its reader has it, and what tells it from others.
AnyConnection: TypeAlias = "Connection | McapChannel"
Key: TypeAlias = tuple[int, str, str]

# The first bytes of each kind of bag, by its suffix, and of a compressed file.
MAGIC = {".bag": b"#ROSBAG", ".mcap": MCAP_MAGIC, ".db3": b"SQLite format 3\0"}
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
HINT = "uq-handeye bag lists what a bag holds (docs/how-to/ros.md)"


class Message(NamedTuple):
    """One message that is read."""

    topic: str
    kind: str
    value: RosMessage
    received: float  # s
    data: bytes


@dataclass
class Topic:
    """One topic: how much there is, and of what."""

    name: str
    msgtype: str
    count: int
    kind: str | None = None  # what it is read as
    problem: str = ""  # why it is not, though it would be
    first: float = math.inf
    last: float = -math.inf

    @property
    def duration(self) -> float:
        """Seconds between its first and last message, of those that were read."""
        return max(0.0, self.last - self.first)


class Bag:
    """A bag that is open."""

    def __init__(self, reader: Ros1Reader | Ros2Reader | McapFile, name: str, ros2: bool, in_folder: bool) -> None:
        self.reader, self.name = reader, name
        self.in_folder = in_folder  # a file of a folder that has metadata.yaml
        self.types = Types(ros2)
        self.decoders: dict[Key, Decoder] = {}
        self.read: Callable[..., Iterator[tuple[AnyConnection, int, bytes]]] = reader.messages
        self.duration = max(0.0, 1e-9 * (reader.end_time - reader.start_time)) if reader.message_count else 0.0
        self.topics = [self._topic(one) for one in reader.connections]

    def _topic(self, one: AnyConnection) -> Topic:
        msgtype, problem = type_name(one.msgtype), ""
        kind = kind_of(msgtype)
        try:
            if kind is not None or (isinstance(one, McapChannel) and not one.msgtype):
                self.decoders[_key(one)] = self.types.decoder(one)
        except NotRead as error:
            kind, problem = None, str(error)
        except Exception as error:  # of a library, by a file from anywhere
            kind, problem = None, one_line(f"definition of its type: {error}")
        return Topic(printed_name(one.topic), printed_name(msgtype) or "no type", int(one.msgcount), kind, problem)

    def messages(self, cut: Callable[[str], None]) -> Iterator[Message]:
        """Yield the messages that are read; of a bag that is damaged behind some of them, ``cut`` hears why."""
        wanted = [one for one in self.reader.connections if _key(one) in self.decoders]
        if not wanted:
            return
        found, count = self.read(wanted), 0
        while True:
            try:
                if (message := next(found, None)) is None:
                    return
                one, time, data = message
                if len(data) > MAX_DESCRIPTION_BYTES:  # a message that is read has some kilobytes
                    continue
                value = self.decoders[_key(one)](data)
            except Exception as error:  # of a library, by a file from anywhere
                if not count:
                    raise InputError(f"{_unreadable(self.name, self.in_folder, error)}.") from error
                cut(f"the bag is damaged behind {count} messages, and the rest is left out ({_words(error)})")
                return
            count += 1
            yield Message(
                printed_name(one.topic), kind_of(type_name(one.msgtype)) or "", value, 1e-9 * time, bytes(data)
            )


def _key(one: AnyConnection) -> Key:
    return one.id, one.topic, one.msgtype


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag rather than a text."""
    return path.suffix.lower() in MAGIC or path.is_dir()


@contextmanager
def opened_bag(path: Path) -> Iterator[Bag]:
    """A bag opened for reading; raises `InputError` in one line."""
    path = _located(path)
    name = shown(path)
    try:
        import rosbags.rosbag1
        import rosbags.rosbag2
    except ImportError as error:
        raise MissingExtraError(
            f"Reading the bag {name} needs rosbags: pip install '.[rosbag]' in the clone of uq-handeye. ROS is not "
            "needed."
        ) from error
    bound_the_reader()
    suffix = path.suffix.lower()
    in_folder = path.is_file() and (path.parent / "metadata.yaml").exists()
    system = (OSError, lambda error: f"Cannot read {name}: {reason(error)}")
    reader: Ros1Reader | Ros2Reader | McapFile
    with refused("", (system, (Exception, partial(_unreadable, name, in_folder)))):
        if path.is_file() and suffix == ".mcap":
            reader = McapFile(path)
            if reader.cut:
                warnings.warn(
                    f"{name}: the file was cut off; what is complete before the cut is read.", InputWarning, 3
                )
        else:
            reader = rosbags.rosbag1.Reader(path) if suffix == ".bag" else rosbags.rosbag2.Reader(path)
            reader.open()
        bag = Bag(reader, name, suffix != ".bag", in_folder)
    try:
        yield bag
    finally:
        with suppress(Exception):  # of a damaged file; everything that could be read was
            reader.close()


def _located(path: Path) -> Path:
    """Return the bag itself: of a folder without metadata.yaml its only .mcap or .db3."""
    name = shown(path)
    try:
        if not path.exists():
            raise InputError(f"Cannot read {name}: there is no such file or folder; check the path.")
        if not path.is_dir():
            if not path.is_file():
                raise InputError(f"Cannot read {name}: it is a device or socket, expected a bag.")
            if os.path.getsize(path) == 0:
                raise InputError(f"{name}: the file is empty; expected a bag ({', '.join(MAGIC)}).")
            _require_bag(path, name)
            return path
        if (metadata := path / "metadata.yaml").exists():
            require_size(os.path.getsize(metadata), MAX_MESSAGE_BYTES, metadata)
            return path
        inside = sorted(one for one in path.iterdir() if one.suffix.lower() in MAGIC)
    except OSError as error:
        raise InputError(f"Cannot read {name}: {reason(error)}.") from error
    if len(inside) == 1:
        return inside[0]
    found = f"{len(inside)} files" if inside else "none"
    raise InputError(
        f"{name}: expected a bag of ROS 2, a folder with metadata.yaml or one file {' or '.join(MAGIC)}, got {found}"
        ". ros2 bag reindex writes a metadata.yaml."
    )


def _require_bag(path: Path, name: str) -> None:
    """Raise `InputError` if the first bytes of a file are not those of a bag of its suffix."""
    with open(path, "rb") as file:
        head = file.read(16)
    suffix = path.suffix.lower()
    if head.startswith(ZSTD_MAGIC):
        raise InputError(
            f"{name}: a compressed file. Give the folder of the bag, with its metadata.yaml, or decompress it: zstd -d."
        )
    of = next((one for one, magic in MAGIC.items() if head.startswith(magic)), None)
    if of is not None and of != suffix:
        raise InputError(f"{name}: the content is that of a {of} file, the suffix is not. Rename it.")
    if of is None:
        raise InputError(f"{name}: no ROS bag; expected a file {', '.join(MAGIC)}, or the folder of ros2 bag.")


def _unreadable(name: str, in_folder: bool, error: BaseException) -> str:
    if isinstance(error, DamagedError):
        return f"{name}: not a bag that can be read ({_words(error)}); mcap doctor says more of it"
    hint = "a bag that was cut off is mended by rosbag reindex, ros2 bag reindex or mcap recover"
    if in_folder:
        hint = f"a compressed bag is read by its folder, which has metadata.yaml; {hint}"
    return f"{name}: not a bag that can be read ({_words(error)}); {hint}"


def _words(error: BaseException) -> str:
    return one_line(str(error)) or type(error).__name__
