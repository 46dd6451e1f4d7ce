"""Large arrays of a result file in a compact form, without loss.

A list of `MIN_PACKED_NUMBERS` numbers or more becomes

    {"shape": [n, 6, 40], "float64": "..."}

the little-endian numbers in C order, byte k of all numbers before byte k + 1, deflated (zlib) and in base64. Of
matrices that are equal to their transposes ``"lower": true`` says that only the lower triangles are written, row by
row. A list of `MIN_PACKED_RECORDS` records or more becomes ``{"runs": [...]}``, for each run of records with equal
names a dictionary of lists, ``{name: its values, "number of records": n}``; equal values of a run are written once, as
``{"each": value}``.
"""

from __future__ import annotations

import base64
import binascii
import math
import zlib
from itertools import groupby
from types import NoneType
from typing import Any

import numpy as np

from ...errors import InputError
from ..geometry.se3 import Array
from ..limits import MAX_TABLE_BYTES

# Fewest numbers of an array, and fewest records of a list, that are written in a compact form.
MIN_PACKED_NUMBERS, MIN_PACKED_RECORDS = 40, 10
_NUMBERS, _RUNS, _COUNT, _EACH = "float64", "runs", "number of records", "each"


def packed(data: Any) -> Any:
    """Return plain values with their large arrays in the compact form."""
    kind = type(data)
    if kind is dict:
        return {name: packed(part) for name, part in data.items()}
    if kind not in (list, tuple):
        return data
    if _count(data) >= MIN_PACKED_NUMBERS and (array := _array(data)) is not None:
        return _of_array(array)
    if len(data) >= MIN_PACKED_RECORDS and all(type(record) is dict for record in data):
        runs = [list(run) for _, run in groupby(data, key=tuple)]
        return {_RUNS: [{name: _column([record[name] for record in run]) for name in run[0]} | {_COUNT: len(run)}
                        for run in runs]}  # fmt: skip
    return [packed(part) for part in data]


def unpacked(data: Any) -> Any:
    """Return plain values of numbers and lists, as before `packed`; raises `InputError` where a part is damaged."""
    kind = type(data)
    if kind is list:
        return [unpacked(part) for part in data]
    if kind is not dict:
        return data
    if _NUMBERS in data:
        return _to_array(data).tolist()
    if _RUNS in data:
        return [record for run in data[_RUNS] for record in _records(run)]
    return {name: unpacked(part) for name, part in data.items()}


def _column(values: list[Any]) -> Any:
    """Return the values of one name in all records, the same ones once."""
    first = values[0]
    if type(first) in (bool, float, int, str, NoneType) and all(type(v) is type(first) and v == first for v in values):
        return {_EACH: first}
    return packed(values)


def _records(run: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the records of a run."""
    count, columns = int(run[_COUNT]), {}
    for name, part in run.items():
        if name == _COUNT:
            continue
        columns[name] = [part[_EACH]] * count if type(part) is dict and part.keys() == {_EACH} else unpacked(part)
        if len(columns[name]) != count:
            raise InputError(
                f"The file is damaged: expected {count} records, got {len(columns[name])} of {name!r:.40}."
            )
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def _count(data: Any) -> int:
    """Return the number of numbers that the first parts of a nested list suggest."""
    count = 1
    while type(data) in (list, tuple):
        if not data:
            return 0
        count *= len(data)
        data = data[0]
    return count if type(data) is float else 0


def _array(data: Any) -> Array | None:
    """Return the array of nested lists of equal lengths whose numbers are all floating-point; None for others."""
    shape, flat = [], [data]
    while flat and type(flat[0]) in (list, tuple):
        lengths = {len(part) if type(part) in (list, tuple) else -1 for part in flat}
        if len(lengths) > 1:
            return None
        shape.append(lengths.pop())
        flat = [one for part in flat for one in part]
    if any(type(one) is not float for one in flat):
        return None
    return np.array(flat, dtype="<f8").reshape(shape)


def _of_array(array: Array) -> dict[str, Any]:
    found: dict[str, Any] = {"shape": list(array.shape)}
    k = array.shape[-1]
    if array.ndim > 1 and array.shape[-2] == k and (array == array.mT).all():
        found["lower"] = True
        array = array[..., *np.tril_indices(k)]
    by_byte = np.ascontiguousarray(array.reshape(-1, 1), dtype="<f8").view(np.uint8).T
    text = base64.b64encode(zlib.compress(by_byte.tobytes())).decode("ascii")
    return found | {_NUMBERS: text}


def _to_array(data: dict[str, Any]) -> Array:
    try:
        shape, lower = tuple(map(int, data["shape"])), data.get("lower", False)
        k = shape[-1]
        written = (*shape[:-2], k * (k + 1) // 2) if lower else shape
        size = 8 * math.prod(written)
        if min(shape) < 0 or size > MAX_TABLE_BYTES:
            raise ValueError(f"it is of shape {shape}")
        expand = zlib.decompressobj()
        raw = expand.decompress(base64.b64decode(data[_NUMBERS], validate=True), size + 1)
        if len(raw) != size or not expand.eof:
            raise ValueError(f"its numbers are not those of shape {shape}")
        by_byte = np.frombuffer(raw, dtype=np.uint8).reshape(8, -1)
        array = np.ascontiguousarray(by_byte.T).view("<f8").reshape(written)
        if not lower:
            return array
        whole = np.empty(shape)
        rows, columns = np.tril_indices(k)
        whole[..., rows, columns] = whole[..., columns, rows] = array
        return whole
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, binascii.Error, zlib.error) as error:
        raise InputError(f"The file is damaged: an array cannot be read, {error}.") from error
