"""The number of cores, and the number of threads of linear algebra."""

from __future__ import annotations

import os
from functools import cache
from typing import Any


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
