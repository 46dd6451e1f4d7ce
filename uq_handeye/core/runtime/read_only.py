"""Frozen dataclasses whose arrays are read-only as well."""

from __future__ import annotations

from typing import TypeVar, cast

import numpy as np

T = TypeVar("T")


class ReadOnlyArrays:
    """Base of a frozen dataclass whose arrays are read-only, also those within tuples and dicts.

    They are views: nothing is copied. Who wants to change one takes a copy, ``np.array(result.X)``.
    """

    def __post_init__(self) -> None:
        vars(self).update({name: read_only(value) for name, value in vars(self).items()})  # its fields, no more


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
    if isinstance(value, tuple):
        items = [read_only(item) for item in value]
        if any(new is not old for new, old in zip(items, value, strict=True)):
            return cast(T, value._make(items) if hasattr(value, "_make") else tuple(items))
    return value
