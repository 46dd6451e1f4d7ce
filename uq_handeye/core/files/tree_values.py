"""Numbers from trees (`trees`): every error states the place in the file, the expected and the actual value."""

from __future__ import annotations

import sys
from typing import Any, TypeAlias, TypeGuard

import numpy as np

from ...errors import InputError
from ..geometry.se3 import Array
from .json_values import Json
from .one_line import short

# Content of a file of YAML, JSON, TOML or XML; parts of it are taken by the functions below, which check them.
Tree: TypeAlias = Json


def fields_of(value: Tree) -> dict[str, Any]:
    """Return the entries of a map; none of anything else."""
    return value if isinstance(value, dict) else {}


def items_of(value: Tree) -> list[Any]:
    """Return the items of a list; none of anything else."""
    return value if isinstance(value, list) else []


def is_map(value: Tree) -> TypeGuard[dict[str, Any]]:
    """Return whether a value is a map, also an empty one."""
    return fields_of(value) is value


def is_list(value: Tree) -> TypeGuard[list[Any]]:
    """Return whether a value is a list, also an empty one."""
    return items_of(value) is value


def is_plain_number(value: Tree) -> TypeGuard[float]:
    """Return whether a value is a number, and not true or false."""
    return isinstance(value, int | float) and value is not True and value is not False


def got(value: Tree) -> str:
    """Describe the value that was received, in few words."""
    if is_map(value):
        return f"the keys {short(', '.join(map(str, value)))}"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    return "nothing" if value is None else short(str(value))


def number(value: Tree, where: str) -> float:
    """A finite number."""
    if not is_plain_number(value):
        raise InputError(f"{where}: expected a number, got {got(value)}.")
    if not abs(value) <= sys.float_info.max:
        got_number = value if type(value) is float else np.inf
        raise InputError(
            f"{where}: expected a finite number, got {got_number}; leave out poses that were not measured, on both "
            "sides."
        )
    return float(value)


def item(value: Tree, key: str, where: str) -> Tree:
    """``value[key]`` of a map."""
    if not is_map(value):
        raise InputError(f"{where}: expected a map with {key}, got {got(value)}.")
    if key not in value:
        raise InputError(f"{where}: expected the field {key}, got {got(value)}.")
    found: Tree = value[key]
    return found


def vector(value: Tree, size: int, where: str) -> list[float]:
    """Check and return a list of ``size`` finite numbers."""
    if not is_list(value) or len(value) != size:
        raise InputError(f"{where}: expected a list of {size} numbers, got {got(value)}.")
    return [number(entry, f"{where}[{k}]") for k, entry in enumerate(value)]


_TRANSFORM = ("translation", "rotation")


def transform(value: Tree, where: str) -> list[float]:
    """x, y, z and the quaternion x, y, z, w of a ``geometry_msgs/Transform`` or ``Pose``, stamped or not."""
    for outer in ("transform", "pose"):
        if outer in fields_of(value) and not {"translation", "position"} & set(fields_of(value)):
            return transform(fields_of(value)[outer], f"{where}, {outer}")
    names = ("position", "orientation") if "position" in fields_of(value) else _TRANSFORM
    numbers: list[float] = []
    for part, axes in zip(names, ("xyz", "xyzw"), strict=True):
        fields = item(value, part, where)
        numbers += [number(item(fields, axis, f"{where}, {part}"), f"{where}, {part}.{axis}") for axis in axes]
    return numbers


def matrix(value: Tree, where: str) -> Array:
    """A 4x4 matrix: four rows of four numbers, or 16 numbers row by row."""
    if len(items_of(value)) == 16:
        return np.array(vector(value, 16, where)).reshape(4, 4)
    if len(items_of(value)) != 4:
        raise InputError(f"{where}: expected a 4x4 matrix, got {got(value)}.")
    return np.array([vector(row, 4, f"{where}[{k}]") for k, row in enumerate(items_of(value))])
