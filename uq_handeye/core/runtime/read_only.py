"""Results that cannot be changed, arrays included: what a frozen dataclass alone does not give.

Work arrays that are kept between calls: fresh pages from the system cost as much as the work done on them.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray


class ReadOnlyArrays:
    """Base of a frozen dataclass whose arrays are read-only, also those within tuples and dicts.

    They are views: nothing is copied. Who wants to change one takes a copy, ``np.array(result.X)``.
    """

    def __post_init__(self) -> None:
        vars(self).update({name: read_only(value) for name, value in vars(self).items()})  # its fields, no more


def read_only(value: Any) -> Any:
    """An array as a read-only view; a tuple or dict with its arrays so; anything else as it is."""
    kind: Any = next((kind for kind in _READ_ONLY if isinstance(value, kind)), None)
    return value if kind is None else _READ_ONLY[kind](value)


def _array(value: NDArray[Any]) -> NDArray[Any]:
    if value.flags.writeable:
        value = value.view()
        value.flags.writeable = False
    return value


def _tuple(value: Any) -> Any:
    items = [read_only(item) for item in value]
    if all(new is old for new, old in zip(items, value, strict=True)):
        return value
    return value._make(items) if hasattr(value, "_make") else tuple(items)


_READ_ONLY: dict[type, Callable[[Any], Any]] = {
    np.ndarray: _array,
    tuple: _tuple,
    dict: lambda value: {key: read_only(item) for key, item in value.items()},
}


Array = NDArray[np.float64]

# Numbers that are kept per name and thread at most; longer arrays are made anew.
KEEP = 400_000


class _Kept(threading.local):
    def __init__(self) -> None:
        self.buffers: dict[str, Array] = {}


_KEPT = _Kept()


def scratch(name: str, *shape: int) -> Array:
    """An array with any content, valid until the same thread asks for ``name`` again."""
    size = math.prod(shape)
    if size > KEEP:
        return np.empty(shape)
    buffer = _KEPT.buffers.get(name)
    if buffer is None or buffer.size < size:
        buffer = _KEPT.buffers[name] = np.empty(size)
    return buffer[:size].reshape(shape)
