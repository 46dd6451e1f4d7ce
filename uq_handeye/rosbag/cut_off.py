"""MCAP files that were cut off, as by a crash of the recorder: read up to the last complete record.

Records of MCAP follow one another (mcap.dev/spec: opcode, length of 8 bytes, content), a chunk holds some of its own,
and the index comes last. Behind the last complete record those of a chunk that was cut off are shown, and the end of a
file without index; the library then scans the records.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any, BinaryIO

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, CHUNK, DATA_END = 0x01, 0x02, 0x06, 0x0F
# Of the content of a chunk, in bytes.
LARGEST_CHUNK = 100_000_000
# End of the data (without checksum) and footer without summary.
TAIL = bytes([DATA_END]) + (4).to_bytes(8, "little") + bytes(4) + bytes([FOOTER]) + (20).to_bytes(8, "little")
TAIL += bytes(20) + MAGIC


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
        file.seek(max(0, size - len(MAGIC)))
        if file.read() == MAGIC and size > len(MAGIC):
            return None
        end = _complete(file, len(MAGIC), size)
        if end == len(MAGIC):
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
