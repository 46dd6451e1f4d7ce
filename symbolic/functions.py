"""Every closed form of the registry as a NumPy function, made on first use: ``functions.W(H)``.

Those that the package runs are checked in (`uq_handeye.methods._closed_form`). The text of the others is printed from
their derivation, which the cache holds (`cache`), and compiled once per process.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uq_handeye.methods import _closed_form
from uq_handeye.methods._closed_form._arguments import Array, prepare

from .cache import derived
from .matrices import FORMS, RUN
from .printing import numpy_function


def __getattr__(name: str) -> Callable[..., Array]:
    if name not in FORMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    function: Callable[..., Array] = getattr(_closed_form, name) if name in RUN else _compile(name)
    globals()[name] = function  # found at once the next time
    return function


def __dir__() -> list[str]:
    return sorted(FORMS)


def _compile(name: str) -> Callable[..., Array]:
    """The function of the registry's own text; the cache checks each tree of an entry before it becomes text."""
    names: dict[str, Any] = {"np": np, "Array": Array, "ArrayLike": ArrayLike, "prepare": prepare}
    exec(compile(numpy_function(FORMS[name], derived(FORMS[name])), f"<closed form {name}>", "exec"), names)
    compiled: Callable[..., Array] = names[name]
    return compiled
