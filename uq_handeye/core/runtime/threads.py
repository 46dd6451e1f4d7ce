"""Cores, and threads of linear algebra.

Work arrays that are kept between calls: fresh pages from the system cost as much as the work done on them.
"""

from __future__ import annotations

import math
import os
import threading
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def one_thread() -> Any:
    """A context in which linear algebra keeps to one thread.

    Products of matrices of a hundred rows are just large enough for several, which on a busy machine wait for each
    other far longer than one takes.
    """
    return _libraries().limit(limits=1)


@cache
def _libraries() -> Any:
    """The libraries that the process has loaded; to look for them takes milliseconds."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


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
