"""Results that cannot be changed, arrays included: what a frozen dataclass alone does not give."""

from __future__ import annotations

from typing import Any

import numpy as np

# What arrays are in.
HOLDERS = (np.ndarray, tuple, dict)


class ReadOnlyArrays:
    """Base of a frozen dataclass whose arrays are read-only, also those within tuples and dicts.

    They are views: nothing is copied. Who wants to change one takes a copy, ``np.array(result.X)``.
    """

    def __post_init__(self) -> None:
        held = vars(self)  # its fields, no more
        for name, value in held.items():
            if isinstance(value, HOLDERS):
                held[name] = read_only(value)


def read_only(value: Any) -> Any:
    """An array as a read-only view; a tuple or dict with its arrays so; anything else as it is."""
    if isinstance(value, np.ndarray):
        if value.flags.writeable:
            value = value.view()
            value.flags.writeable = False
    elif isinstance(value, tuple):
        if any(isinstance(item, HOLDERS) for item in value):
            items = [read_only(item) for item in value]
            value = value._make(items) if hasattr(value, "_make") else tuple(items)
    elif isinstance(value, dict):
        value = {key: read_only(item) for key, item in value.items()}
    return value
