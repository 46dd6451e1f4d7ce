"""Bounded decompression for the reader of bags.

rosbags decompresses a chunk, a message or a file to whatever size the compressed data ask for, and a kilobyte can ask
for gigabytes. `bound_the_reader` replaces its decompressors by those of this module, which stop at a limit that no
recorder reaches: of a chunk or message `MAX_CHUNK_BYTES`, of a compressed file `MAX_COMPRESSION_RATIO` times its own
size, or `MAX_TABLE_BYTES` where that is more.
"""

from __future__ import annotations

import bz2
import io
import os
from collections.abc import Callable
from functools import cache, partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, BinaryIO, Protocol

from ...core.limits import MAX_TABLE_BYTES

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

# Recorders close a chunk after some megabytes; the messages that are read here have some kilobytes.
MAX_CHUNK_BYTES = 100_000_000
# Poses compress by a factor of 2 to 10.
MAX_COMPRESSION_RATIO = 100
TOO_LARGE = "a compressed part holds more than {:g} MB"


class DamagedError(ValueError):
    """Data of a recording that are damaged, cut off or beyond a limit, in a few words."""


class Decompressor(Protocol):
    """Decompressor of one frame, as the modules bz2, lz4.frame and zstd have it."""

    @property
    def eof(self) -> bool:
        """True behind the end of the frame."""

    @property
    def unused_data(self) -> bytes | None:
        """Data behind the end of the frame."""

    def decompress(self, data: bytes, max_length: int) -> bytes:
        """Return at most ``max_length`` bytes of the content."""


def unpacked(make: Callable[[], Decompressor], data: bytes, *_: int) -> bytes:
    """Return the content of compressed data, one frame after the other; ``make`` makes the decompressor of a frame."""
    content, rest = b"", bytes(data)
    while rest:
        frame = make()
        content += frame.decompress(rest, max_length=MAX_CHUNK_BYTES + 1 - len(content))
        if len(content) > MAX_CHUNK_BYTES:
            raise DamagedError(TOO_LARGE.format(MAX_CHUNK_BYTES / 1e6))
        if not frame.eof:
            raise ValueError("a compressed part is cut off")
        rest = frame.unused_data or b""
    return content


class _Bounded(io.RawIOBase):
    """Content of a compressed file, up to a limit."""

    def __init__(self, file: BinaryIO, limit: int) -> None:
        self.file, self.limit, self.left = file, limit, limit

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: WriteableBuffer) -> int:
        view = memoryview(buffer)
        data = self.file.read(len(view))
        self.left -= len(data)
        if self.left < 0:
            raise DamagedError(TOO_LARGE.format(self.limit / 1e6))
        view[: len(data)] = data
        return len(data)


@cache
def decompressors() -> dict[str, Callable[..., bytes]]:
    """Return the decompressors of chunks by the names that MCAP gives them."""
    import lz4.frame  # type: ignore[import-untyped]
    from rosbags.rosbag2 import storage_mcap

    zstd = vars(storage_mcap)["zstd"]
    of_zstd, of_lz4 = partial(unpacked, zstd.ZstdDecompressor), partial(unpacked, lz4.frame.LZ4FrameDecompressor)
    return {"": lambda data, *_: bytes(data), "zstd": of_zstd, "lz4": of_lz4}


@cache
def bound_the_reader() -> None:
    """Replace the decompressors of rosbags."""
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import reader as ros2
    from rosbags.rosbag2 import storage_mcap

    zstd = vars(storage_mcap)["zstd"]
    of = decompressors()

    def opened(file: BinaryIO, mode: str) -> _Bounded:
        size = os.fstat(file.fileno()).st_size
        return _Bounded(zstd.open(file, mode), max(MAX_TABLE_BYTES, MAX_COMPRESSION_RATIO * size))

    ros1.decompressors.update(bz2=partial(unpacked, bz2.BZ2Decompressor), lz4=of["lz4"])
    storage_mcap.DECOMPRESSORS.update(zstd=of["zstd"], lz4=of["lz4"])
    setattr(ros2, "zstd", SimpleNamespace(decompress=of["zstd"], open=opened))  # noqa: B010
