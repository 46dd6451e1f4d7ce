"""MCAP files of any recorder: the channels with their types, and their messages in the order of the file.

Format (https://mcap.dev/spec): records follow one another, each an opcode (1 byte), a length (8 bytes, little endian)
and the content. A chunk is a record that holds records, compressed or not. A summary at the end, which recorders may
leave out, repeats types and channels, counts the messages, and says which channels each chunk has.

A file that was cut off, as by a crash of the recorder, is read up to its last complete record; those of a chunk that
was cut off are recovered if it is not compressed. Records are bounded by the file, and what chunks unpack to by
`MAX_CHUNK_BYTES`.
"""

from __future__ import annotations

import io
import os
import struct
from binascii import crc32
from collections import Counter
from collections.abc import Collection, Iterator
from enum import IntEnum
from pathlib import Path
from typing import BinaryIO, NamedTuple

from ...core.limits import MAX_DESCRIPTION_BYTES
from .decompression import MAX_CHUNK_BYTES, TOO_LARGE, DamagedError, decompressors

MCAP_MAGIC = b"\x89MCAP0\r\n"
# Opcode and length before each record; size of the footer with the end of the file.
RECORD_HEAD = struct.Struct("<BQ")
FOOTER_BYTES = RECORD_HEAD.size + 20 + len(MCAP_MAGIC)
# Types and channels of one file. A cell has some tens.
MAX_CHANNELS = 10_000


class Opcode(IntEnum):
    """Kinds of records."""

    HEADER = 1
    FOOTER = 2
    SCHEMA = 3
    CHANNEL = 4
    MESSAGE = 5
    CHUNK = 6
    MESSAGE_INDEX = 7
    CHUNK_INDEX = 8
    ATTACHMENT = 9
    ATTACHMENT_INDEX = 10
    STATISTICS = 11
    METADATA = 12
    METADATA_INDEX = 13
    SUMMARY_OFFSET = 14
    END_OF_DATA = 15


OPCODES = frozenset(Opcode)


class McapChannel(NamedTuple):
    """One topic and the type of its messages."""

    id: int
    topic: str
    msgtype: str  # name of the type; empty: the file has none
    encoding: str  # of the messages: cdr, ros1, protobuf, json, ...
    schema_encoding: str  # of the definition: ros2msg, ros2idl, ros1msg, protobuf, jsonschema, ...; empty: none
    schema: bytes
    msgcount: int = 0


class _Chunk(NamedTuple):
    place: int
    channels: frozenset[int]  # empty: not known


class McapFile:
    """An MCAP file that is open."""

    def __init__(self, path: Path) -> None:
        self.file = path.open("rb")
        try:
            self._open()
        except BaseException:
            self.file.close()
            raise

    def _open(self) -> None:
        self.schemas: dict[int, tuple[str, str, bytes]] = {}
        self.channels: dict[int, McapChannel] = {}
        self.counts: Counter[int] = Counter()
        self.chunks: list[_Chunk] = []
        self.described = 0  # bytes of definitions
        self.start_time, self.end_time = 2**63 - 1, 0  # ns
        self.size = os.fstat(self.file.fileno()).st_size
        if self.file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
            raise DamagedError("the first bytes are not those of MCAP")
        opcode, place, length = _record(self.file, len(MCAP_MAGIC), self.size) or (0, 0, 0)
        if opcode != Opcode.HEADER:
            raise DamagedError("the file has no header")
        self.file.seek(place)
        self.profile = _Fields(self.file.read(min(length, 4096))).text()
        self.start = self.end = place + length
        self.end = self.size
        self.cut = not self._has_footer()
        if self.cut or not self._summarised():
            self.schemas, self.channels, self.chunks = {}, {}, []
            self._scan()
        if self.cut and not self.channels:
            raise DamagedError("the file was cut off before its first message")
        self.connections = [one._replace(msgcount=self.counts[key]) for key, one in self.channels.items()]
        self.message_count = self.counts.total()

    def _has_footer(self) -> bool:
        self.file.seek(max(0, self.size - FOOTER_BYTES))
        data = self.file.read(FOOTER_BYTES)
        found = (
            data[:1] == bytes([Opcode.FOOTER]) and data.endswith(MCAP_MAGIC) and self.size - FOOTER_BYTES >= self.start
        )
        if found:
            (self.summary,) = struct.unpack_from("<Q", data, RECORD_HEAD.size)
            self.end = self.size - FOOTER_BYTES
        return found

    def _summarised(self) -> bool:
        """Read the summary; False: there is none that counts the messages and has their channels."""
        if not self.start <= self.summary < self.end:
            return False
        counted = False
        for opcode, place, length in _records(self.file, self.summary, self.end):
            if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK_INDEX, Opcode.STATISTICS):
                continue
            fields = _Fields(self._read(place, length))
            if opcode == Opcode.CHUNK_INDEX:
                _, _, at, _ = fields.numbers("<QQQQ")
                offsets = fields.bytes()
                channels = (struct.unpack_from("<H", offsets, k)[0] for k in range(0, len(offsets) - 9, 10))
                self.chunks.append(_Chunk(at, frozenset(channels)))
            elif opcode == Opcode.STATISTICS:
                total, *_, chunks, self.start_time, self.end_time = fields.numbers("<QHIIIIQQ")
                counts = fields.bytes()
                self.counts = Counter(dict(struct.unpack_from("<HQ", counts, k) for k in range(0, len(counts) - 9, 10)))
                counted = total == self.counts.total()
            else:
                self._describe(opcode, fields)
        known = all(key in self.channels for key, count in self.counts.items() if count)
        return counted and known and (not self.chunks or len(self.chunks) == chunks)

    def _scan(self) -> None:
        """Read types and channels, and count the messages, record by record."""
        self.counts = Counter()
        self.start_time, self.end_time = 2**63 - 1, 0
        for opcode, data in self._contents(frozenset()):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._describe(opcode, _Fields(data))
            elif opcode == Opcode.MESSAGE:
                channel, _, time, _ = _Fields(data).numbers("<HIQQ")
                self.counts[channel] += 1
                self.start_time, self.end_time = min(self.start_time, time), max(self.end_time, time)

    def _describe(self, opcode: int, fields: _Fields) -> None:
        """Take the record of a type or of a channel."""
        if len(self.schemas) + len(self.channels) > MAX_CHANNELS:
            raise DamagedError(f"more than {MAX_CHANNELS} types and channels")
        (key,) = fields.numbers("<H")
        if opcode == Opcode.SCHEMA:
            self.schemas[key] = name, _, data = fields.text(), fields.text(), fields.bytes()
            self.described += len(name) + len(data)
            if self.described > MAX_DESCRIPTION_BYTES:
                raise DamagedError(f"definitions of more than {MAX_DESCRIPTION_BYTES / 1e6:g} MB")
            return
        (schema,) = fields.numbers("<H")
        topic, encoding = fields.text(), fields.text()
        self.channels.setdefault(key, McapChannel(key, topic, "", encoding, "", b""))
        if (found := self.schemas.get(schema)) is not None:
            name, form, data = found
            self.channels[key] = McapChannel(key, topic, name, encoding, form, data)

    def messages(self, wanted: Collection[McapChannel]) -> Iterator[tuple[McapChannel, int, bytes]]:
        """Yield channel, time of recording (ns) and data of the messages of these channels."""
        of = {one.id: one for one in wanted}
        for opcode, data in self._contents(frozenset(of)):
            if opcode == Opcode.MESSAGE:
                channel, _, time, _ = _Fields(data).numbers("<HIQQ")
                if channel in of:
                    yield of[channel], time, data[22:]

    def _contents(self, wanted: frozenset[int]) -> Iterator[tuple[int, bytes]]:
        """Yield opcode and content of the records that matter, also of those in chunks; by the index if there is one.

        Of a message that is not ``wanted`` only the head.
        """
        if self.chunks:
            for chunk in self.chunks:
                if not chunk.channels or chunk.channels & wanted:
                    found = _record(self.file, chunk.place, self.size)
                    if found is None or found[0] != Opcode.CHUNK:
                        raise DamagedError(f"the index names a chunk at byte {chunk.place}, where there is none")
                    yield from self._in_chunk(found[1], found[2])
            return
        place = self.start
        for opcode, place, length in _records(self.file, self.start, self.end):
            if opcode == Opcode.END_OF_DATA:
                return
            if opcode == Opcode.CHUNK:
                yield from self._in_chunk(place, length)
            elif opcode == Opcode.MESSAGE:
                head = self._read(place, min(length, 22))
                whole = len(head) == 22 and struct.unpack_from("<H", head)[0] in wanted
                yield opcode, self._read(place, length) if whole else head
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                yield opcode, self._read(place, length)
            place += length
        if not self.cut:
            raise DamagedError(f"the record at byte {place} is damaged")
        yield from self._in_cut_chunk(place)

    def _read(self, place: int, length: int) -> bytes:
        if length > MAX_CHUNK_BYTES:
            raise DamagedError(TOO_LARGE.format(MAX_CHUNK_BYTES / 1e6))
        self.file.seek(place)
        return self.file.read(length)

    def _in_chunk(self, place: int, length: int) -> Iterator[tuple[int, bytes]]:
        fields = _Fields(self._read(place, length))
        _, _, size, checksum = fields.numbers("<QQQI")
        compression = fields.text()
        (packed,) = fields.numbers("<Q")
        if compression not in decompressors():
            raise DamagedError(f"a chunk is compressed by {compression[:20]!r}, which is not known")
        content = decompressors()[compression](fields.rest(packed), size)
        if len(content) != size or (checksum and crc32(content) != checksum):
            raise DamagedError("a chunk is damaged: its size or checksum is wrong")
        yield from _inner(content)

    def _in_cut_chunk(self, place: int) -> Iterator[tuple[int, bytes]]:
        """Yield the complete records of a chunk that was cut off; none of a compressed one."""
        self.file.seek(place)
        data = self.file.read(MAX_CHUNK_BYTES)
        name = RECORD_HEAD.size + 28 + 4  # behind times, size, checksum, and the length of the compression's name
        if len(data) >= name + 8 and data[0] == Opcode.CHUNK and not any(data[name - 4 : name]):
            yield from _inner(data[name + 8 :])

    def close(self) -> None:
        """Close the file."""
        self.file.close()


def _inner(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the records of a chunk."""
    for opcode, place, length in _records(io.BytesIO(content), 0, len(content)):
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            yield opcode, content[place : place + length]


def _record(file: BinaryIO, place: int, end: int) -> tuple[int, int, int] | None:
    """Return opcode, place and length of the content of the record at a place; None: there is no complete one."""
    file.seek(place)
    head = file.read(RECORD_HEAD.size)
    if len(head) < RECORD_HEAD.size:
        return None
    opcode, length = RECORD_HEAD.unpack(head)
    after = place + RECORD_HEAD.size + length
    return (opcode, place + RECORD_HEAD.size, length) if after <= end and opcode in OPCODES else None


def _records(file: BinaryIO, place: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, place and length of the contents of records, up to the last complete one."""
    while (found := _record(file, place, end)) is not None:
        yield found
        place = found[1] + found[2]


class _Fields:
    """Content of a record, read field by field."""

    def __init__(self, data: bytes) -> None:
        self.data, self.place = data, 0

    def rest(self, length: int) -> bytes:
        """Return so many bytes."""
        if self.place + length > len(self.data):
            raise DamagedError("a record is cut off")
        self.place += length
        return self.data[self.place - length : self.place]

    def numbers(self, form: str) -> tuple[int, ...]:
        """Return integers by their format."""
        return struct.unpack(form, self.rest(struct.calcsize(form)))

    def bytes(self) -> bytes:
        """Return bytes behind their length."""
        return self.rest(self.numbers("<I")[0])

    def text(self) -> str:
        """Return a text behind its length."""
        return self.bytes().decode(errors="replace")
