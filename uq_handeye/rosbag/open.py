"""Bags opened: ROS 1 ``.bag``, ROS 2 folders, ``.db3`` and ``.mcap``; every failure is one line that names the file."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import InputError, InputWarning, MissingExtraError
from ..files.lines import one_line
from ..files.open import reason, shown
from .cut_off import cut_off
from .types import Types, kind_of

SUFFIXES = (".bag", ".mcap", ".db3")
# First bytes of each, and of compressed files.
MAGIC = {".bag": b"#ROSBAG", ".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0"}
ZSTD = b"\x28\xb5\x2f\xfd"
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
        return Connection(one.topic, one.msgtype, int(one.msgcount), kind, problem)

    def messages(self, cut: Callable[[str], None]) -> Iterator[Message]:
        """Yield the messages that are read; of a bag that is damaged behind some of them, ``cut`` hears why."""
        kinds = {(one.topic, one.msgtype): one.kind for one in self.connections}
        wanted = [one for one in self.reader.connections if kinds[(one.topic, one.msgtype)]]
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
            yield Message(one.topic, kinds[(one.topic, one.msgtype)] or "", value, 1e-9 * time, bytes(data))


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
        if (path / "metadata.yaml").exists():
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
