"""Work arrays that are kept between calls: fresh pages from the system cost as much as the work done on them."""

from __future__ import annotations

import math
import threading

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Longest array that is kept per name and thread; longer ones are made each time.
MAX_KEPT_NUMBERS = 400_000


class _Kept(threading.local):
    def __init__(self) -> None:
        self.buffers: dict[str, Array] = {}


_KEPT = _Kept()


def scratch(name: str, *shape: int) -> Array:
    """An array with any content, valid until the same thread asks for ``name`` again."""
    size = math.prod(shape)
    if size > MAX_KEPT_NUMBERS:
        return np.empty(shape)
    buffer = _KEPT.buffers.get(name)
    if buffer is None or buffer.size < size:
        buffer = _KEPT.buffers[name] = np.empty(size)
    return buffer[:size].reshape(shape)
