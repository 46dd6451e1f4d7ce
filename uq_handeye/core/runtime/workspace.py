"""Work arrays that are kept between calls: fresh pages from the system cost as much as the work done on them."""

from __future__ import annotations

import math
import threading

import numpy as np
from numpy.typing import NDArray

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
