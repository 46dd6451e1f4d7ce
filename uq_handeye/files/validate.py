"""Checks of what was read from a file: every part has its type, and writing it again gives the same.

`Calibration.from_dict` uses them, so that a damaged file is refused where it is read and not where a part is used.
"""

from __future__ import annotations

import math
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

T = TypeVar("T")

# Numbers that are worked out from others again may differ from those in the file by this, relative to the largest of
# their row: files come from other machines.
ROUNDING = 1e-5
_LARGEST = int(np.finfo(float).max)


def unequal(again: Any, data: Any, path: str) -> str | None:
    """Return the path where ``data``, as read, differs from what is written again; None if nowhere.

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


def array_of(data: Any, shape: tuple[int, ...], path: str, infinite: bool = False) -> NDArray[np.float64]:
    """Numbers of that shape from lists of a file; raises `InputError` on anything else.

    ``infinite``: None stands for an infinite number, which JSON has not.
    """
    try:
        array = np.array(_infinite(data) if infinite else data, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"Expected {path} to be numbers of shape {shape}, got {data!r:.40}.") from error
    if array.shape != shape:
        raise InputError(f"Expected {path} to be numbers of shape {shape}, got shape {array.shape}.")
    if not (infinite or np.isfinite(array).all()):
        raise InputError(f"Expected {path} to be finite numbers of shape {shape}.")
    return array


def _infinite(data: Any) -> Any:
    if isinstance(data, list):
        return [_infinite(part) for part in data]
    return np.inf if data is None else data


def plain(value: Any) -> Any:
    """Arrays and tuples as lists, dictionaries part by part; None stands for an infinite number."""
    if isinstance(value, dict):
        return {name: plain(entry) for name, entry in value.items()}
    if isinstance(value, tuple | list):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value


def not_finite(data: Any, path: str) -> str | None:
    """Return the path where the data hold NaN, infinity, an integer beyond any float, or a truth value in a list; None
    if nowhere.
    """
    where = _not_finite(data)
    return None if where is None else path + where


def _not_finite(data: Any) -> str | None:
    """Return the end of the path: files hold many numbers, and few of them are wrong."""
    if not isinstance(data, dict | list | tuple):
        if isinstance(data, int):
            return "" if abs(data) > _LARGEST else None
        return "" if isinstance(data, float) and not math.isfinite(data) else None
    named = isinstance(data, dict)
    for name, part in data.items() if isinstance(data, dict) else enumerate(data):
        if type(part) is float and math.isfinite(part):
            continue
        found = "" if isinstance(part, bool) and not named else _not_finite(part)
        if found is not None:
            return f".{name}{found}"
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
