"""Bounded decompression for the reader of bags, whose own makes gigabytes of a kilobyte when a file asks for it.

A chunk or message becomes at most `LARGEST_CHUNK` bytes, a compressed file at most `LARGEST_RATIO` times as many as it
has, and `LEAST` in any case; beyond it the reader's error says so.
"""

from __future__ import annotations

import bz2
import io
import os
from collections.abc import Callable
from functools import cache, partial
from types import SimpleNamespace
from typing import Any, BinaryIO

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
