"""Results that cannot be changed, arrays included: what a frozen dataclass alone does not give."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, cast

import numpy as np


class ReadOnlyArrays:
    """Base of a frozen dataclass whose arrays are read-only, also those within tuples and dicts.

    They are views: nothing is copied. Who wants to change one takes a copy, ``np.array(result.X)``.
    """

    def __post_init__(self) -> None:
        for field in fields(cast(Any, self)):
            object.__setattr__(self, field.name, read_only(getattr(self, field.name)))


def read_only(value: Any) -> Any:
    """An array as a read-only view; a tuple or dict with its arrays so; anything else as it is."""
    if isinstance(value, np.ndarray):
        value = value.view()
        value.flags.writeable = False
    elif isinstance(value, tuple):
        items = [read_only(item) for item in value]
        value = value._make(items) if hasattr(value, "_make") else tuple(items)
    elif isinstance(value, dict):
        value = {key: read_only(item) for key, item in value.items()}
    return value
