"""Numbers out of trees (`trees`): every error says where in the file, what was expected and what came."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.se3 import Array
from .lines import short


def got(value: Any) -> str:
    """Describe the value that was received, in few words."""
    if isinstance(value, dict):
        return f"the keys {short(', '.join(map(str, value)))}"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    return "nothing" if value is None else short(str(value))


def number(value: Any, where: str) -> float:
    """A finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: expected a number, got {got(value)}.")
    try:
        result = float(value)
    except OverflowError:
        result = np.inf
    if not np.isfinite(result):
        raise InputError(
            f"{where}: expected a finite number, got {result}; leave out poses that were not measured, on both sides."
        )
    return result


def item(value: Any, key: str, where: str) -> Any:
    """``value[key]`` of a map."""
    if not isinstance(value, dict):
        raise InputError(f"{where}: expected a map with {key}, got {got(value)}.")
    if key not in value:
        raise InputError(f"{where}: expected the field {key}, got {got(value)}.")
    return value[key]


def vector(value: Any, size: int, where: str) -> list[float]:
    """Check and return a list of ``size`` finite numbers."""
    if not isinstance(value, list) or len(value) != size:
        raise InputError(f"{where}: expected a list of {size} numbers, got {got(value)}.")
    return [number(entry, f"{where}[{k}]") for k, entry in enumerate(value)]


_TRANSFORM = ("translation", "rotation")


def transform(value: Any, where: str) -> list[float]:
    """x, y, z and the quaternion x, y, z, w of a ``geometry_msgs/Transform`` or ``Pose``, stamped or not."""
    for outer in ("transform", "pose"):
        if isinstance(value, dict) and outer in value and not {"translation", "position"} & set(value):
            return transform(value[outer], f"{where}, {outer}")
    names = ("position", "orientation") if isinstance(value, dict) and "position" in value else _TRANSFORM
    numbers: list[float] = []
    for part, axes in zip(names, ("xyz", "xyzw"), strict=True):
        fields = item(value, part, where)
        numbers += [number(item(fields, axis, f"{where}, {part}"), f"{where}, {part}.{axis}") for axis in axes]
    return numbers


def matrix(value: Any, where: str) -> Array:
    """A 4x4 matrix: four rows of four numbers, or 16 numbers row by row."""
    if isinstance(value, list) and len(value) == 16:
        return np.array(vector(value, 16, where)).reshape(4, 4)
    if not isinstance(value, list) or len(value) != 4:
        raise InputError(f"{where}: expected a 4x4 matrix, got {got(value)}.")
    return np.array([vector(row, 4, f"{where}[{k}]") for k, row in enumerate(value)])
