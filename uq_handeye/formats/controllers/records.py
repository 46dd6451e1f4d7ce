"""Poses in JSON and YAML under user-defined names: maps of numbers and short lists, one per pose.

``{"x": 0.1, ..., "rx": ...}`` is a row of a table; ``position`` and ``rpy`` may be lists, ``R`` a 3x3 matrix. The names
give the form of the rotation; where they do not, there are several readings, as in tables.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.files.table import Places
from ...core.files.tree_values import fields_of, is_map, is_plain_number, items_of
from ...core.geometry.se3 import Array
from ..columns import is_pose_header
from ..contents import Side, matrices_side
from ..matrices.matrix_trees import numbers_of
from ..number_table import NumberTable
from .tables import pose_side

_POSITIONS = ("translation", "position", "pos", "xyz", "t", "tvec", "trans", "p", "translation_vector", "pose_t")
_MATRICES = ("R", "rotation", "rotation_matrix", "rot", "rmat", "pose_R")
# Names of lists of three angles, and the columns that they are.
_LISTS = {
    **dict.fromkeys(("rvec", "rotvec", "rotation_vector", "axis_angle"), ("rotvec_x", "rotvec_y", "rotvec_z")),
    **dict.fromkeys(("rpy", "roll_pitch_yaw"), ("roll", "pitch", "yaw")),
    "abc": ("a", "b", "c"),
    "wpr": ("w", "p", "r"),
}
# Names that leave the form open: three angles, a rotation vector, or a quaternion of either order.
_OPEN = ("rotation", "orientation", "quaternion", "quat", "q", "euler", "angles", "rot")
# Names of six or seven numbers of a whole pose.
_POSES = (
    "pose", "tcp", "tcp_pose", "actual_tcp_pose", "tcp_coords", "coords", "cartesian", "flange", "end_pose", "value",
    "values",
)  # fmt: skip


def entries_of(tree: Any) -> tuple[Any, str]:
    """Return a tree that holds the poses of one side in other ways as a list of maps, and the name of that list.

    A single pose; columns by their names (``{"x": [...], "y": [...]}``, also with numbered rows as pandas writes them);
    one list of poses among other entries, whatever its name. Any other tree is returned as it is.
    """
    if not is_map(tree):
        return tree, ""
    if is_records([tree]):
        return [tree], ""
    whole = {str(key): list(fields_of(value).values()) or value for key, value in tree.items()}
    columns = {key: found.tolist() for key, value in whole.items() if (found := _vector(value)) is not None}
    if is_pose_header(tuple(columns)) and len({len(column) for column in columns.values()}) == 1:
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)], ""
    lists = {str(key): value for key, value in tree.items() if is_records(value) or _is_rows(value)}
    if len(lists) != 1:
        return tree, ""
    ((key, found),) = lists.items()
    return found, key


def _is_rows(value: Any) -> bool:
    """Return whether a list holds six or seven numbers per pose."""
    found = numbers_of(value)
    return found is not None and found.ndim == 2 and found.shape[1] in (6, 7) and len(found) > 1


def _vector(value: Any) -> Array | None:
    found = numbers_of(value)
    return found if found is not None and found.ndim == 1 else None


def is_records(values: Any) -> bool:
    """Return whether a list holds one pose per map."""
    first = next(iter(items_of(values)), None)
    return is_map(first) and _row(first) is not None


def records_side(values: list[Any], name: str) -> Side | None:
    """Return the poses of a list of maps; None where they are no poses by names that are known.

    Raises `InputError` for poses that are wrong.
    """
    rows = [_row(entry) if is_map(entry) else None for entry in values]
    first = rows[0]
    if first is None or any(row is None or row[0] != first[0] or len(row[1]) != len(first[1]) for row in rows):
        return None
    names, numbers = first[0], np.array([row[1] for row in rows if row is not None])
    if names == ("matrix",):
        return matrices_side(name, numbers.reshape(-1, 4, 4))
    lines = np.arange(len(numbers))
    units = ("",) * numbers.shape[1]
    table = NumberTable(name, list(names), Places(range(len(units))), numbers, lines, units=units)
    return pose_side(table, "pose")


def _axis_and_angle(entry: dict[str, Any]) -> list[float] | None:
    """Return ``{"Rotation": {"Angle": a, "Axis": [x, y, z]}}``, as Ensenso writes it, as a rotation vector."""
    for value in entry.values():
        parts = {str(key).lower(): part for key, part in fields_of(value).items()}
        axis, angle = numbers_of(parts.get("axis")), parts.get("angle")
        if axis is not None and axis.shape == (3,) and is_plain_number(angle) and np.linalg.norm(axis) > 0:
            return [float(part) for part in angle * axis / np.linalg.norm(axis)]
    return None


def _row(entry: dict[str, Any]) -> tuple[tuple[str, ...], list[float]] | None:
    """Return names and numbers of one map: of a table, ``("matrix",)`` of a 4x4, no names of a bare pose."""
    lists: dict[str, Any] = {
        str(key): found.tolist() for key, value in entry.items() if (found := numbers_of(value)) is not None
    }
    lists |= {key.lower(): value for key, value in lists.items() if key.lower() not in lists and key not in ("R", "T")}
    turned = _axis_and_angle(entry)
    if turned is not None:
        lists["rotvec"] = turned
    for key in _POSES:
        if np.shape(lists.get(key, [])) in ((6,), (7,)):
            return (), lists[key]
    if set(lists) == {"matrix"} and np.shape(lists["matrix"]) == (4, 4):
        return ("matrix",), np.ravel(lists["matrix"]).tolist()
    position = next((lists[key] for key in _POSITIONS if np.shape(lists.get(key, 0)) in ((3,), (3, 1))), None)
    if position is not None:
        t = np.ravel(position).tolist()
        for key in _MATRICES:
            if np.shape(lists.get(key, 0)) == (3, 3):
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = lists[key], t
                return ("matrix",), T.ravel().tolist()
        for key, columns in _LISTS.items():
            if np.shape(lists.get(key, 0)) in ((3,), (3, 1)):
                return ("x", "y", "z", *columns), [*t, *np.ravel(lists[key]).tolist()]
        for key, value in lists.items():
            if np.shape(value) == (4,) and (order := key.lower()[-4:]) in ("xyzw", "wxyz"):
                return ("x", "y", "z", *(f"q{axis}" for axis in order)), [*t, *value]
        for key in _OPEN:
            if np.shape(lists.get(key, 0)) in ((3,), (4,)):
                return (), [*t, *lists[key]]
    named: dict[str, float] = {} if position is None else dict(zip("xyz", t, strict=True))
    for key, value in entry.items():
        for inner, number in value.items() if is_map(value) else [("", value)]:
            if is_plain_number(number):
                named[f"{key}.{inner}" if inner else str(key)] = float(number)
    return (tuple(named), list(named.values())) if is_pose_header(tuple(named)) else None
