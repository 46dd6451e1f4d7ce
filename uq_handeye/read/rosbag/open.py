"""Message types that are read, and their definitions where a bag has none (``messages.toml``).

Definitions in a bag come from outside: only names and types of fields are taken from them, if they are names.

Bounded decompression for the reader of bags, whose own makes gigabytes of a kilobyte when a file asks for it.

A chunk or message becomes at most `LARGEST_CHUNK` bytes, a compressed file at most `LARGEST_RATIO` times as many as it
has, and `LEAST` in any case; beyond it the reader's error says so.

Bags opened: ROS 1 ``.bag``, ROS 2 folders, ``.db3`` and ``.mcap``; every failure is one line that names the file.

MCAP files that were cut off, as by a crash of the recorder: read up to the last complete record.

Records of MCAP follow one another (mcap.dev/spec: opcode, length of 8 bytes, content), a chunk holds some of its own,
and the index comes last. Behind the last complete record those of a chunk that was cut off are shown, and the end of a
file without index; the library then scans the records.
"""

from __future__ import annotations

import bz2
import io
import math
import os
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO, NamedTuple

from ...core.files.lines import one_line, refused
from ...core.files.open import reason, require_size, shown
from ...core.files.trees import parse_toml
from ...errors import InputError, InputWarning, MissingExtraError
from ...formats.ros_messages import printed_name

POSES = {
    *("geometry_msgs/msg/" + name for name in ("Pose", "PoseStamped", "PoseArray", "Transform", "TransformStamped")),
    *("geometry_msgs/msg/" + name for name in ("PoseWithCovariance", "PoseWithCovarianceStamped")),
    "nav_msgs/msg/Odometry",
}
TRANSFORMS = {"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"}
JOINTS, INFO = "sensor_msgs/msg/JointState", "sensor_msgs/msg/CameraInfo"
# Tags and markers, by the last part of the type: several packages have messages of these names.
TAGS = ("AprilTagDetectionArray", "ArucoMarkers", "ArucoDetection")
MARKERS = {"aruco_msgs/msg/MarkerArray", "aruco_msgs/msg/Marker"}

_NAME, _TYPE = re.compile(r"[A-Za-z]\w*"), re.compile(r"[A-Za-z]\w*(/msg/[A-Za-z]\w*)?")


# What a topic is read as, by its type; tags and markers also by the last part of the type.
_KINDS = {
    **dict.fromkeys(POSES, "poses"),
    **dict.fromkeys(TRANSFORMS, "transforms"),
    **dict.fromkeys((*MARKERS, *TAGS), "tags"),
    JOINTS: "joints",
    INFO: "info",
}


def kind_of(msgtype: str) -> str | None:
    """Return what a topic of this type is read as: poses, transforms, joints, info or tags; None: it is not read."""
    return _KINDS.get(msgtype) or _KINDS.get(msgtype.rpartition("/")[2])


@cache
def definitions() -> dict[str, str]:
    """Return the fields of messages by type, for bags of ROS 2 that hold no definitions."""
    return parse_toml(Path(__file__).with_name("messages.toml"))


class Types:
    """Types of the messages of one bag, registered when they are asked for."""

    def __init__(self, ros2: bool) -> None:
        from rosbags import typesys

        self.ros2, self.typesys = ros2, typesys
        self.known = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE if ros2 else typesys.Stores.ROS1_NOETIC)
        for name, text in definitions().items():
            if name not in self.known.fielddefs:
                self.known.register(typesys.get_types_from_msg(text, name))
        self.stores: dict[str, Any] = {}

    def decode(self, data: bytes, msgtype: str) -> Any:
        """Return the message as an object with its fields."""
        store = self.stores[msgtype]
        return store.deserialize_cdr(data, msgtype) if self.ros2 else store.deserialize_ros1(data, msgtype)

    def require(self, msgtype: str, definition: Any) -> bool:
        """Make a type known, by the definition in the bag if there is one; False: there is none anywhere."""
        form, text = definition.format.name, definition.data
        if msgtype in self.stores:
            return True
        if form == "NONE" or not text:
            if msgtype in self.known.fielddefs:
                self.stores[msgtype] = self.known
            return msgtype in self.stores
        found: dict[str, Any] = {}
        if form == "MSG":
            found = dict(self.typesys.get_types_from_msg(text, msgtype))
        else:
            for part in re.split(r"^=+\nIDL: .*\n", text, flags=re.MULTILINE):
                found |= self.typesys.get_types_from_idl(part) if part.strip() else {}
        store = self.typesys.get_typestore(self.typesys.Stores.EMPTY)
        store.register({name: ([], _checked(name, fields)) for name, (_, fields) in found.items()})
        self.stores[msgtype] = store
        return True


def _checked(name: str, fields: Any) -> Any:
    """Return the fields of a definition if all names and types in it are names; raises `ValueError` otherwise."""
    if not _TYPE.fullmatch(name):
        raise ValueError(f"definition of {name[:60]!r}: no name of a type")
    for field, kind in fields:
        if not _NAME.fullmatch(field):
            raise ValueError(f"definition of {name}: {field[:60]!r} is no name")
        for value in _leaves(kind):
            if type(value) is str and value and not _TYPE.fullmatch(value):
                raise ValueError(f"definition of {name[:60]}: {value[:60]!r} is no name")
            if not isinstance(value, str | int):
                raise ValueError(f"definition of {name[:60]}: {type(value).__name__} in place of a type")
    return fields


def _leaves(value: Any, depth: int = 0) -> Iterator[Any]:
    if type(value) not in (tuple, list) or depth == 8:
        yield value
        return
    for part in value:
        yield from _leaves(part, depth + 1)


LARGEST_CHUNK = 100_000_000
LARGEST_RATIO, LEAST = 100, 1_000_000_000


class TooLarge(ValueError):
    """More came out of a compressed part than any recorder puts in."""

    def __init__(self, most: float) -> None:
        super().__init__(f"a compressed part holds more than {most / 1e6:g} MB")


def unpacked(make: Callable[[], Any], data: bytes, *_: Any) -> bytes:
    """Return the content of compressed data, one frame after the other; ``make`` makes a decompressor of a frame."""
    content, rest = b"", bytes(data)
    while rest:
        frame = make()
        content += frame.decompress(rest, max_length=LARGEST_CHUNK + 1 - len(content))
        if len(content) > LARGEST_CHUNK:
            raise TooLarge(LARGEST_CHUNK)
        if not frame.eof:
            raise ValueError("a compressed part is cut off")
        rest = frame.unused_data
    return content


class _Counted(io.RawIOBase):
    """A compressed file that is read as far as its size allows."""

    def __init__(self, file: BinaryIO, most: int) -> None:
        self.file, self.most, self.left = file, most, most

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        data = self.file.read(len(buffer))
        self.left -= len(data)
        if self.left < 0:
            raise TooLarge(self.most)
        buffer[: len(data)] = data
        return len(data)


@cache
def bound_the_reader() -> None:
    """Put these in the place of what the library of bags decompresses with."""
    import lz4.frame  # type: ignore[import-untyped]
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import reader as ros2
    from rosbags.rosbag2 import storage_mcap

    zstd: Any = vars(storage_mcap)["zstd"]
    of_zstd, of_lz4 = partial(unpacked, zstd.ZstdDecompressor), partial(unpacked, lz4.frame.LZ4FrameDecompressor)

    def opened(file: BinaryIO, mode: str) -> Any:
        size = os.fstat(file.fileno()).st_size
        return _Counted(zstd.open(file, mode), max(LEAST, LARGEST_RATIO * size))

    ros1.decompressors.update(bz2=partial(unpacked, bz2.BZ2Decompressor), lz4=of_lz4)
    storage_mcap.DECOMPRESSORS.update(zstd=of_zstd, lz4=of_lz4)
    setattr(ros2, "zstd", SimpleNamespace(decompress=of_zstd, open=opened))  # noqa: B010


MCAP_MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, CHUNK, DATA_END = 0x01, 0x02, 0x06, 0x0F
# End of the data (without checksum) and footer without summary.
TAIL = bytes([DATA_END]) + (4).to_bytes(8, "little") + bytes(4) + bytes([FOOTER]) + (20).to_bytes(8, "little")
TAIL += bytes(20) + MCAP_MAGIC


def cut_off(path: Path) -> SimpleNamespace | None:
    """Return a file without end as a path that opens as far as it is complete, with an end behind its last record.

    None: it has its end, or not even a first record.
    """
    size = os.path.getsize(path)
    with path.open("rb") as file:
        file.seek(max(0, size - len(MCAP_MAGIC)))
        if file.read() == MCAP_MAGIC and size > len(MCAP_MAGIC):
            return None
        end = _complete(file, len(MCAP_MAGIC), size)
        if end == len(MCAP_MAGIC):
            return None
        file.seek(end)
        more = _inside(file.read(LARGEST_CHUNK)) + TAIL

    def opened(mode: str = "rb") -> io.BufferedReader:
        return io.BufferedReader(_Ended(path.open("rb"), end, more))

    return SimpleNamespace(open=opened, suffix=path.suffix, exists=path.exists, is_dir=path.is_dir)


def _complete(file: BinaryIO, place: int, size: int) -> int:
    """Return the place behind the last complete record of the data."""
    while True:
        file.seek(place)
        head = file.read(9)
        after = place + 9 + int.from_bytes(head[1:], "little")
        if len(head) < 9 or not HEADER <= head[0] < DATA_END or head[0] == FOOTER or after > size:
            return place
        place = after


def _inside(data: bytes) -> bytes:
    """Return the complete records inside a chunk that was cut off; none of one that is compressed."""
    name = 9 + 28 + 4  # behind opcode and length: times, size and checksum, and the length of the compression's name
    if len(data) < name or data[0] != CHUNK:
        return b""
    start = name + int.from_bytes(data[name - 4 : name], "little")
    if start > name:
        return b""
    inner = data[start + 8 :]
    return inner[: _complete(io.BytesIO(inner), 0, len(inner))]


class _Ended(io.RawIOBase):
    """The first bytes of a file, and others behind them."""

    def __init__(self, file: BinaryIO, end: int, more: bytes) -> None:
        self.file, self.end, self.more, self.place = file, end, more, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self.place, os.SEEK_END: self.end + len(self.more)}[whence]
        self.place = max(0, start + offset)
        return self.place

    def tell(self) -> int:
        return self.place

    def readinto(self, buffer: Any) -> int:
        if self.place < self.end:
            self.file.seek(self.place)
            data = self.file.read(min(len(buffer), self.end - self.place))
        else:
            data = self.more[self.place - self.end :][: len(buffer)]
        buffer[: len(data)] = data
        self.place += len(data)
        return len(data)

    def close(self) -> None:
        self.file.close()
        super().close()


SUFFIXES = (".bag", ".mcap", ".db3")
# First bytes of each, and of compressed files.
MAGIC = {".bag": b"#ROSBAG", ".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0"}
ZSTD = b"\x28\xb5\x2f\xfd"
# The largest metadata.yaml, in bytes: usual ones have some ten thousand.
MOST_METADATA = 1_000_000
# The longest message that is read, in bytes: those read here have a few kilobytes.
LONGEST = 20_000_000
HINT = "uq-handeye bag lists what a bag holds (docs/how-to/ros.md)"


class Message(NamedTuple):
    """One message that is read."""

    topic: str
    kind: str
    value: Any
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

    def __init__(self, reader: Any, name: str, ros2: bool, beside: bool) -> None:
        self.reader, self.name, self.beside = reader, name, beside  # a file of a folder with metadata.yaml
        self.types = Types(ros2)
        self.read = reader.messages
        self.duration = max(0.0, 1e-9 * (reader.end_time - reader.start_time)) if reader.message_count else 0.0
        self.topics = [self._topic(one) for one in reader.connections]

    def _topic(self, one: Any) -> Topic:
        kind, problem = kind_of(one.msgtype), ""
        if kind is not None:
            try:
                if not self.types.require(one.msgtype, one.msgdef):
                    kind, problem = None, "no definition of its type in the bag"
            except Exception as error:  # of a library, by a file from anywhere
                kind, problem = None, one_line(f"definition of its type: {error}")
        return Topic(printed_name(one.topic), one.msgtype, int(one.msgcount), kind, problem)

    def messages(self, cut: Callable[[str], None]) -> Iterator[Message]:
        """Yield the messages that are read; of a bag that is damaged behind some of them, ``cut`` hears why."""
        kinds = {(one.name, one.msgtype): one.kind for one in self.topics}
        topics = {one.topic: printed_name(one.topic) for one in self.reader.connections}
        wanted = [one for one in self.reader.connections if kinds[(topics[one.topic], one.msgtype)]]
        if not wanted:
            return
        found, count = self.read(wanted), 0
        while True:
            try:
                if (message := next(found, None)) is None:
                    return
                one, time, data = message
                if len(data) > LONGEST:
                    continue
                value = self.types.decode(data, one.msgtype)
            except Exception as error:  # of a library, by a file from anywhere
                if not count:
                    raise InputError(f"{_unreadable(self.name, self.beside, error)}.") from error
                cut(f"the bag is damaged behind {count} messages, and the rest is left out ({_words(error)})")
                return
            count += 1
            topic = topics[one.topic]
            yield Message(topic, kinds[(topic, one.msgtype)] or "", value, 1e-9 * time, bytes(data))


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag rather than a text."""
    return path.suffix.lower() in SUFFIXES or path.is_dir()


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
    ros2 = path.suffix.lower() != ".bag"
    beside = path.is_file() and (path.parent / "metadata.yaml").exists()
    reader: Any = None
    system = (OSError, lambda error: f"Cannot read {name}: {reason(error)}")
    with refused("", (system, (Exception, partial(_unreadable, name, beside)))):
        part: Any = cut_off(path) if path.is_file() and path.suffix.lower() == ".mcap" else None
        reader = (rosbags.rosbag2.Reader if ros2 else rosbags.rosbag1.Reader)(part or path)
        reader.open()
        bag = Bag(reader, name, ros2, beside)
        if part is not None:
            bag.read = reader.storage.messages_scan  # in any order, without index
            warnings.warn(f"{name}: the file was cut off; what is complete before the cut is read.", InputWarning, 3)
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
                raise InputError(f"{name}: the file is empty; expected a bag ({', '.join(SUFFIXES)}).")
            _require_bag(path, name)
            return path
        if (metadata := path / "metadata.yaml").exists():
            require_size(os.path.getsize(metadata), MOST_METADATA, metadata)
            return path
        inside = sorted(one for one in path.iterdir() if one.suffix.lower() in SUFFIXES)
    except OSError as error:
        raise InputError(f"Cannot read {name}: {reason(error)}.") from error
    if len(inside) == 1:
        return inside[0]
    found = f"{len(inside)} files" if inside else "none"
    raise InputError(
        f"{name}: expected a bag of ROS 2, a folder with metadata.yaml or one file {' or '.join(SUFFIXES)}, got {found}"
        ". ros2 bag reindex writes a metadata.yaml."
    )


def _require_bag(path: Path, name: str) -> None:
    """Raise `InputError` if the first bytes of a file are not those of a bag of its suffix."""
    with open(path, "rb") as file:
        head = file.read(16)
    suffix = path.suffix.lower()
    if head.startswith(ZSTD):
        raise InputError(
            f"{name}: a compressed file. Give the folder of the bag, with its metadata.yaml, or decompress it: zstd -d."
        )
    of = next((one for one, magic in MAGIC.items() if head.startswith(magic)), None)
    if of is not None and of != suffix:
        raise InputError(f"{name}: the content is that of a {of} file, the suffix is not. Rename it.")
    if of is None:
        raise InputError(f"{name}: no ROS bag; expected a file {', '.join(SUFFIXES)}, or the folder of ros2 bag.")


def _unreadable(name: str, beside: bool, error: BaseException) -> str:
    hint = "a bag that was cut off is mended by rosbag reindex, ros2 bag reindex or mcap recover"
    if beside:
        hint = f"a compressed bag is read by its folder, which has metadata.yaml; {hint}"
    return f"{name}: not a bag that can be read ({_words(error)}); {hint}"


def _words(error: BaseException) -> str:
    return one_line(str(error)) or type(error).__name__
