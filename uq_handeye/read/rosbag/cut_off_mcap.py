"""MCAP files that were cut off, as by a crash of the recorder, read up to the last complete record.

rosbags refuses an MCAP file that does not end with a footer. It reads one whose footer names no index, by scanning
the records. So the complete records of a cut file are shown to it with such a footer behind them, without a copy of
the file.

Format (https://mcap.dev/spec): records follow one another, each an opcode (1 byte), a length (8 bytes, little endian)
and the content. A chunk is a record that holds records; those of a chunk that was cut off are recovered if the chunk
is not compressed.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, BinaryIO

from .decompression import MAX_CHUNK_BYTES

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

MCAP_MAGIC = b"\x89MCAP0\r\n"
# Opcodes of the records that the data consist of: all but the footer (2) and the end of the data (15).
DATA_OPCODES = b"\x01\x03\x04\x05\x06\x07\x08\x09\x0a\x0b\x0c\x0d\x0e"
CHUNK_OPCODE = b"\x06"
# The end of the data without a checksum, and the footer without an index.
FOOTER = b"\x0f\x04" + bytes(7 + 4) + b"\x02\x14" + bytes(7 + 20) + MCAP_MAGIC


def completed(path: Path) -> SimpleNamespace | None:
    """Return a file that was cut off, as a path that opens with a footer behind its last complete record.

    None: the file has its footer, or not even one complete record.
    """
    size = os.path.getsize(path)
    with path.open("rb") as file:
        file.seek(max(0, size - len(MCAP_MAGIC)))
        if file.read() == MCAP_MAGIC and size > len(MCAP_MAGIC):
            return None
        end = _end_of_records(file, len(MCAP_MAGIC), size)
        if end == len(MCAP_MAGIC):
            return None
        file.seek(end)
        more = _records_in_chunk(file.read(MAX_CHUNK_BYTES)) + FOOTER

    def opened(mode: str = "rb") -> io.BufferedReader:
        return io.BufferedReader(_Continued(path.open("rb"), end, more))

    return SimpleNamespace(open=opened, suffix=path.suffix, exists=path.exists, is_dir=path.is_dir)


def _end_of_records(file: BinaryIO, place: int, size: int) -> int:
    """Return the place behind the last complete record, from ``place`` on."""
    while True:
        file.seek(place)
        opcode, length = file.read(1), file.read(8)
        after = place + 9 + int.from_bytes(length, "little")
        if len(length) < 8 or opcode not in DATA_OPCODES or after > size:
            return place
        place = after


def _records_in_chunk(data: bytes) -> bytes:
    """Return the complete records inside a chunk that was cut off; none of a compressed one."""
    name = 9 + 28 + 4  # behind opcode and length: times, size and checksum, and the length of the compression's name
    if len(data) < name or data[:1] != CHUNK_OPCODE or any(data[name - 4 : name]):
        return b""
    inner = data[name + 8 :]
    return inner[: _end_of_records(io.BytesIO(inner), 0, len(inner))]


class _Continued(io.RawIOBase):
    """The first ``end`` bytes of a file, and others behind them."""

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

    def readinto(self, buffer: WriteableBuffer) -> int:
        view = memoryview(buffer)
        if self.place < self.end:
            self.file.seek(self.place)
            data = self.file.read(min(len(view), self.end - self.place))
        else:
            data = self.more[self.place - self.end :][: len(view)]
        view[: len(data)] = data
        self.place += len(data)
        return len(data)

    def close(self) -> None:
        self.file.close()
        super().close()
