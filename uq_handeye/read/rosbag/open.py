"""Bags opened: ROS 1 ``.bag``, ROS 2 folders, ``.db3`` and ``.mcap``; every failure is one line that names the file.

MCAP files that were cut off, as by a crash of the recorder: read up to the last complete record.

Records of MCAP follow one another (mcap.dev/spec: opcode, length of 8 bytes, content), a chunk holds some of its own,
and the index comes last. Behind the last complete record those of a chunk that was cut off are shown, and the end of a
file without index; the library then scans the records.
"""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from ...core.files.lines import one_line
from ...core.files.open import reason, require_size, shown
from ...errors import InputError, InputWarning, MissingExtraError
from ...formats.ros.messages import printed_name
from .decompression import LARGEST_CHUNK, bound_the_reader
from .types import Types, kind_of

MCAP_MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, CHUNK, DATA_END = 0x01, 0x02, 0x06, 0x0F
# End of the data (without checksum) and footer without summary.
TAIL = bytes([DATA_END]) + (4).to_bytes(8, "little") + bytes(4) + bytes([FOOTER]) + (20).to_bytes(8, "little")
TAIL += bytes(20) + MCAP_MAGIC


class CutOff:
    """Path of an MCAP file without end, which opens as one that ends behind its last complete record."""

    def __init__(self, path: Path, end: int, more: bytes) -> None:
        self.path, self.end, self.more, self.suffix = path, end, more, path.suffix

    def __str__(self) -> str:
        return str(self.path)

    def exists(self) -> bool:
        """Return whether there is such a file."""
        return self.path.exists()

    def is_dir(self) -> bool:
        """Return False."""
        return False

    def open(self, mode: str = "rb") -> Any:
        """Open the complete records and an end behind them."""
        return io.BufferedReader(_Ended(self.path.open("rb"), self.end, self.more + TAIL))


def cut_off(path: Path) -> CutOff | None:
    """Return the file as far as it is complete; None: it has its end, or not even a first record."""
    size = os.path.getsize(path)
    with path.open("rb") as file:
        file.seek(max(0, size - len(MCAP_MAGIC)))
        if file.read() == MCAP_MAGIC and size > len(MCAP_MAGIC):
            return None
        end = _complete(file, len(MCAP_MAGIC), size)
        if end == len(MCAP_MAGIC):
            return None
        file.seek(end)
        return CutOff(path, end, _inside(file.read(LARGEST_CHUNK)))


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


class Connection(NamedTuple):
    """One topic of a bag."""

    topic: str
    msgtype: str
    messages: int
    kind: str | None  # what it is read as
    problem: str  # why it is not, though it would be


class Bag:
    """A bag that is open."""

    def __init__(self, reader: Any, name: str, ros2: bool, beside: bool) -> None:
        self.reader, self.name, self.beside = reader, name, beside  # a file of a folder with metadata.yaml
        self.types = Types(ros2)
        self.read = reader.messages
        self.duration = max(0.0, 1e-9 * (reader.end_time - reader.start_time)) if reader.message_count else 0.0
        self.connections = [self._connection(one) for one in reader.connections]

    def _connection(self, one: Any) -> Connection:
        kind, problem = kind_of(one.msgtype), ""
        if kind is not None:
            try:
                if not self.types.require(one.msgtype, one.msgdef):
                    kind, problem = None, "no definition of its type in the bag"
            except Exception as error:  # of a library, by a file from anywhere
                kind, problem = None, one_line(f"definition of its type: {error}")
        return Connection(printed_name(one.topic), one.msgtype, int(one.msgcount), kind, problem)

    def messages(self, cut: Callable[[str], None]) -> Iterator[Message]:
        """Yield the messages that are read; of a bag that is damaged behind some of them, ``cut`` hears why."""
        kinds = {(one.topic, one.msgtype): one.kind for one in self.connections}
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
                    raise _unreadable(self.name, error, self.beside) from error
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
    try:
        part: Any = cut_off(path) if path.is_file() and path.suffix.lower() == ".mcap" else None
        reader = (rosbags.rosbag2.Reader if ros2 else rosbags.rosbag1.Reader)(part or path)
        reader.open()
        bag = Bag(reader, name, ros2, beside)
        if part is not None:
            bag.read = reader.storage.messages_scan  # in any order, without index
            warnings.warn(f"{name}: the file was cut off; what is complete before the cut is read.", InputWarning, 3)
    except OSError as error:
        raise InputError(f"Cannot read {name}: {reason(error)}.") from error
    except Exception as error:  # of a library, by a file from anywhere
        raise _unreadable(name, error, beside) from error
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


def _unreadable(name: str, error: BaseException, beside: bool = False) -> InputError:
    hint = "a bag that was cut off is mended by rosbag reindex, ros2 bag reindex or mcap recover"
    if beside:
        hint = f"a compressed bag is read by its folder, which has metadata.yaml; {hint}"
    return InputError(f"{name}: not a bag that can be read ({_words(error)}); {hint}.")


def _words(error: BaseException) -> str:
    return one_line(str(error)) or type(error).__name__
