"""Checks of what was read from a file: every part has its type, and writing it again gives the same.

`Calibration.from_dict` uses them, so that a damaged file is refused where it is read and not where a part is used.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

# Numbers that are worked out from others again may differ from those in the file by this, relative to the largest of
# their row: files come from other machines.
ROUNDING = 1e-5


def misfit(value: Any, hint: Any, path: str) -> str | None:
    """The first part of ``value`` that is not of the type ``hint``, as a path; None if all are.

    Follows dataclasses, named tuples, unions, tuples, dictionaries and arrays of numbers.
    """
    origin, args = get_origin(hint), get_args(hint)
    if hint is Any:
        return None
    if origin in (Union, UnionType):
        found = [misfit(value, arg, path) for arg in args]
        return None if None in found else max((text for text in found if text), key=len)
    if origin is np.ndarray:
        return None if isinstance(value, np.ndarray) and value.dtype.kind in "fi" else path
    if origin is tuple and isinstance(value, tuple):
        kinds = args[:1] * len(value) if args[1:] == (Ellipsis,) else args
        return path if len(kinds) != len(value) else _first(zip(range(len(value)), value, kinds, strict=True), path)
    if origin is dict and isinstance(value, dict):
        return _first(((name, item, args[1]) for name, item in value.items()), path)
    if hint is float or hint is int:
        number = isinstance(value, int | np.integer) or (hint is float and isinstance(value, float))
        return None if number and not isinstance(value, bool) else path
    if origin is not None or not isinstance(value, hint):
        return path
    names = [field.name for field in fields(hint)] if is_dataclass(hint) else getattr(hint, "_fields", ())
    hints = get_type_hints(hint) if names else {}
    return _first(((name, getattr(value, name), hints[name]) for name in names), path)


def _first(parts: Any, path: str) -> str | None:
    return next((found for name, part, kind in parts if (found := misfit(part, kind, f"{path}.{name}"))), None)


def unequal(again: Any, data: Any, path: str) -> str | None:
    """Where ``data``, as read, differs from what is written again, as a path; None if nowhere.

    More names in ``data`` do not matter.
    """
    if isinstance(again, dict):
        if not isinstance(data, dict):
            return path
        for name, part in again.items():
            if name not in data:
                return f"{path}.{name}"
            if (found := unequal(part, data[name], f"{path}.{name}")) is not None:
                return found
        return None
    if isinstance(again, list):
        if not isinstance(data, list) or len(data) != len(again):
            return path
        if all(map(_is_number, again)) and all(map(_is_number, data)):
            return (
                None
                if again == data or np.allclose(again, data, rtol=0.0, atol=ROUNDING * float(np.abs(again).max()))
                else path
            )
        parts = ((unequal(a, b, f"{path}[{k}]")) for k, (a, b) in enumerate(zip(again, data, strict=True)))
        return next((found for found in parts if found is not None), None)
    if _is_number(again) and _is_number(data):
        return None if abs(again - data) <= ROUNDING * abs(again) else path
    return None if type(again) is type(data) and again == data else path


def not_finite(data: Any, path: str) -> str | None:
    """Where the data hold NaN or infinity, as a path; None if nowhere."""
    if isinstance(data, dict | list | tuple):
        items = data.items() if isinstance(data, dict) else enumerate(data)
        return next((found for name, part in items if (found := not_finite(part, f"{path}.{name}"))), None)
    return path if isinstance(data, float) and not np.isfinite(data) else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
