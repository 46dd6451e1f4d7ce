"""Messages of Protocol Buffers decoded by the descriptors that a recording holds; no generated code is needed.

Encoding as in https://protobuf.dev/programming-guides/encoding, descriptors as in ``google/protobuf/descriptor.proto``.
A message becomes a dict by the names of its fields. A number or text that is not in the data has its default, as proto3
does not write 0 and empty texts; a message, or a field declared ``optional``, that is not in the data is left out.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import NamedTuple, TypeAlias

from ...core.files.trees import MAX_DEPTH
from ...core.limits import MAX_LISTED, MAX_MESSAGE_BYTES
from .decompression import DamagedError

Decoded: TypeAlias = dict[str, "Value"]
Value: TypeAlias = float | int | str | bytes | Decoded | list["Value"]


class WireType(IntEnum):
    """Forms of the entries of an encoded message."""

    VARINT = 0
    FIXED64 = 1
    BYTES = 2
    FIXED32 = 5


class FieldType(IntEnum):
    """Types of fields in descriptors."""

    DOUBLE = 1
    FLOAT = 2
    INT64 = 3
    UINT64 = 4
    INT32 = 5
    FIXED64 = 6
    FIXED32 = 7
    BOOL = 8
    TEXT = 9
    GROUP = 10
    MESSAGE = 11
    BINARY = 12
    UINT32 = 13
    ENUM = 14
    SFIXED32 = 15
    SFIXED64 = 16
    SINT32 = 17
    SINT64 = 18


# Format of the numbers of fixed length by their type.
_FIXED: dict[int, str] = {
    FieldType.DOUBLE: "<d",
    FieldType.FLOAT: "<f",
    FieldType.FIXED64: "<Q",
    FieldType.SFIXED64: "<q",
    FieldType.FIXED32: "<I",
    FieldType.SFIXED32: "<i",
}
# Defaults of types that are no integers.
_ZEROS: dict[int, Value] = {FieldType.TEXT: "", FieldType.BINARY: b"", FieldType.DOUBLE: 0.0, FieldType.FLOAT: 0.0}


class Field(NamedTuple):
    """One field of a message type."""

    name: str
    type: int
    type_name: str  # of a message
    repeated: bool
    default: Value | None  # where it is not in the data; None: it is left out


class MessageTypes:
    """Message types of one ``FileDescriptorSet``."""

    def __init__(self, descriptors: bytes) -> None:
        if len(descriptors) > MAX_MESSAGE_BYTES:
            raise DamagedError(f"descriptors of more than {MAX_MESSAGE_BYTES / 1e6:g} MB")
        self.fields: dict[str, dict[int, Field]] = {}
        for file in _all(descriptors, 1):
            package = _text(file, 2)
            for inner in _all(file, 4):
                self._add(inner, package, 0)

    def _add(self, descriptor: bytes, parent: str, depth: int) -> None:
        """Take a ``DescriptorProto`` and those that are nested in it."""
        if depth > MAX_DEPTH:
            raise DamagedError(f"types nested more than {MAX_DEPTH} deep")
        name = f"{parent}.{_text(descriptor, 1)}".strip(".")
        self.fields[name] = dict(map(_field, _all(descriptor, 2)))
        for inner in _all(descriptor, 3):
            self._add(inner, name, depth + 1)

    def decoder(self, name: str) -> Callable[[bytes], Decoded]:
        """Return the function that decodes messages of a type; raises `DamagedError` if there is no such type."""
        if name not in self.fields:
            known = ", ".join(list(self.fields)[:MAX_LISTED]) or "none"
            raise DamagedError(f"its descriptors have no type {name[:80]!r}, but {known}")
        return lambda data: self._decoded(bytes(data), name, 0)

    def _decoded(self, data: bytes, name: str, depth: int) -> Decoded:
        if len(data) > MAX_MESSAGE_BYTES or depth > MAX_DEPTH:
            raise DamagedError(f"a message of more than {MAX_MESSAGE_BYTES / 1e6:g} MB or {MAX_DEPTH} levels")
        fields = self.fields.get(name)
        if fields is None:
            raise DamagedError(f"its descriptors lack the type {name[:80]!r}")
        lists: dict[str, list[Value]] = {field.name: [] for field in fields.values() if field.repeated}
        single = {field.name: field.default for field in fields.values() if not field.repeated}
        found: Decoded = {one: value for one, value in single.items() if value is not None} | lists
        for number, value in _entries(data):
            if (field := fields.get(number)) is None:
                continue
            values = self._values(field, value, depth)
            if field.repeated:
                lists[field.name] += values
            elif values:
                found[field.name] = values[-1]
        return found

    def _values(self, field: Field, value: int | bytes, depth: int) -> list[Value]:
        """Return the values of one entry; several of a packed list."""
        if field.type == FieldType.MESSAGE:
            return [self._decoded(_bytes(value), field.type_name, depth + 1)]
        if field.type == FieldType.TEXT:
            return [_bytes(value).decode(errors="replace")]
        if field.type == FieldType.BINARY:
            return [_bytes(value)]
        if field.type in _FIXED:
            data = _bytes(value)
            size = struct.calcsize(_FIXED[field.type])
            if not data or len(data) % size:
                raise DamagedError(f"the field {field.name[:80]!r} has {len(data)} bytes")
            return [one for (one,) in struct.iter_unpack(_FIXED[field.type], data)]
        raw = [value] if isinstance(value, int) else list(_varints(value))
        return [_integer(one, field.type) for one in raw]


def _field(descriptor: bytes) -> tuple[int, Field]:
    """Return number and meaning of a ``FieldDescriptorProto``."""
    numbers: dict[int, int] = {key: value for key, value in _entries(descriptor) if isinstance(value, int)}
    kind = numbers.get(5, 0)
    optional = bool(numbers.get(17, 0))
    zero = _ZEROS.get(kind, 0)
    default = None if kind in (FieldType.MESSAGE, FieldType.GROUP) or optional else zero
    repeated = numbers.get(4) == 3  # its label: repeated
    return numbers.get(3, 0), Field(_text(descriptor, 1), kind, _text(descriptor, 6).lstrip("."), repeated, default)


def _entries(data: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Yield number and value of each field of an encoded message; numbers of fixed length as their bytes."""
    place = 0
    while place < len(data):
        key, place = _varint(data, place)
        number, wire = key >> 3, key & 7
        if wire == WireType.VARINT:
            value, place = _varint(data, place)
            yield number, value
            continue
        length = 8 if wire == WireType.FIXED64 else 4 if wire == WireType.FIXED32 else None
        if wire == WireType.BYTES:
            length, place = _varint(data, place)
        if length is None:
            raise DamagedError(f"an entry of the wire type {wire}")
        if place + length > len(data):
            raise DamagedError("a message that is cut off")
        yield number, data[place : place + length]
        place += length


def _varint(data: bytes, place: int) -> tuple[int, int]:
    """Return an integer of at most ten bytes, and the place behind it."""
    value = 0
    for k, byte in enumerate(data[place : place + 10]):
        value |= (byte & 0x7F) << (7 * k)
        if byte < 0x80:
            return value & (2**64 - 1), place + k + 1
    raise DamagedError("a number that is cut off")


def _varints(data: bytes) -> Iterator[int]:
    place = 0
    while place < len(data):
        value, place = _varint(data, place)
        yield value


def _integer(value: int, kind: int) -> int:
    """Return an integer with its sign."""
    if kind in (FieldType.SINT32, FieldType.SINT64):
        return (value >> 1) ^ -(value & 1)
    if kind in (FieldType.INT32, FieldType.INT64, FieldType.ENUM) and value >= 2**63:
        return value - 2**64
    return value


def _all(data: bytes, number: int) -> list[bytes]:
    """Return every value of a field of a descriptor."""
    return [_bytes(value) for key, value in _entries(data) if key == number]


def _text(data: bytes, number: int) -> str:
    """Return the text of a field of a descriptor; empty where there is none."""
    return next((one.decode(errors="replace") for one in _all(data, number)), "")


def _bytes(value: int | bytes) -> bytes:
    if isinstance(value, int):
        raise DamagedError("a number in place of a text or a message")
    return value
