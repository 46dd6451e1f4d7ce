"""Frozen dataclasses whose arrays are read-only as well."""

from __future__ import annotations

from typing import TypeVar, cast

import numpy as np

T = TypeVar("T")

# What is an array or may contain one.
HOLDERS_OF_ARRAYS = (np.ndarray, dict, tuple)


class ReadOnlyArrays:
    """Base of a frozen dataclass whose arrays are read-only, also those within tuples and dicts.

    They are views: nothing is copied. Who wants to change one takes a copy, ``np.array(result.X)``.
    """

    def __post_init__(self) -> None:
        fields = vars(self)
        for name, value in fields.items():
            if isinstance(value, HOLDERS_OF_ARRAYS):
                fields[name] = read_only(value)


def read_only(value: T) -> T:
    """Return an array as a read-only view, a tuple or dict with its arrays so, anything else as it is."""
    if isinstance(value, np.ndarray):
        if not value.flags.writeable:
            return value
        view = value.view()
        view.flags.writeable = False
        return cast(T, view)
    if isinstance(value, dict):
        return cast(T, {key: read_only(item) for key, item in value.items()})
    if isinstance(value, tuple) and any(issubclass(kind, HOLDERS_OF_ARRAYS) for kind in set(map(type, value))):
        items = [read_only(item) for item in value]
        if any(new is not old for new, old in zip(items, value, strict=True)):
            return cast(T, value._make(items) if hasattr(value, "_make") else tuple(items))
    return value
