"""Joint values in JSON and YAML: a map or a list of numbers per pose, or a list of them beside the names of the joints.

[{"joint_1": 18.3, "joint_2": 51.0, ...}, ...]
{"joint_names": ["shoulder", ...], "positions": [[0.1, ...], ...]}
[{"timestamp": 0.0, "joints": [0.1, ...]}, ...]    [{"name": [...], "position": [...]}, ...]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.files.one_line import short
from ...core.files.tree_values import Tree, fields_of, got, is_list, is_map, is_plain_number, items_of
from ...core.files.trees import parse_tree
from ...core.geometry.se3 import Array
from ...errors import InputError

# Keys of the names of the joints, and of the values of one pose or of all.
NAME_KEYS = ("joint_names", "names", "name")
VALUE_KEYS = (
    "joints", "q", "joint_positions", "positions", "position", "joint_values", "joint_angles", "angles", "joint_pose",
    "joint_states", "actual_q", "values",
)  # fmt: skip


class JointRows(NamedTuple):
    """Names of the columns, empty where the file has none, and their numbers (n, k)."""

    names: list[str]
    values: Array


def joint_rows(data: bytes, name: str) -> JointRows:
    """Return the joint values of a file; raises `InputError` for anything else than the forms above."""
    tree = parse_tree(data, name, several=True)
    names = _names(tree)
    rows = tree if is_list(tree) else _list_of_poses(tree)
    if not rows:
        raise InputError(f"{name}: expected a list with the joint values of each pose, got {got(tree)}.")
    found = [_row(row, f"{name}, pose {k}") for k, row in enumerate(rows)]
    of_rows, _ = found[0]
    for k, (own, numbers) in enumerate(found):
        if own != of_rows or len(numbers) != len(found[0][1]):
            what = f", {short(', '.join(own))}" if own else ""
            raise InputError(
                f"{name}, pose {k}: expected the {len(found[0][1])} numbers of pose 0, got {len(numbers)}{what}."
            )
    values = np.array([numbers for _, numbers in found])
    if names and len(names) == values.shape[1] and not of_rows:
        return JointRows(names, values)
    return JointRows(list(of_rows), values)


def _names(tree: Tree) -> list[str]:
    """Return the names that stand beside the values; none where there are none."""
    for key in NAME_KEYS:
        found = items_of(fields_of(tree).get(key))
        if found and all(isinstance(one, str) for one in found):
            return [str(one) for one in found]
    return []


def _list_of_poses(tree: Tree) -> list[Tree]:
    """Return the only list of maps or lists in a map; that of a known key first."""
    lists = {
        str(key): items_of(value)
        for key, value in fields_of(tree).items()
        if items_of(value) and all(is_map(one) or is_list(one) for one in items_of(value))
    }
    known = [lists[key] for key in VALUE_KEYS if key in lists] or list(lists.values())
    return known[0] if len(known) == 1 or any(key in lists for key in VALUE_KEYS) else []


def _row(row: Tree, where: str) -> tuple[tuple[str, ...], list[float]]:
    """Return names and numbers of one pose."""
    if is_list(row):
        return (), _numbers(row, where)
    fields = fields_of(row)
    for key in VALUE_KEYS:
        if is_list(fields.get(key)):
            names, numbers = _names(row), _numbers(fields[key], f"{where}, {key}")
            others = {str(k): float(value) for k, value in fields.items() if is_plain_number(value)}
            if names and len(names) == len(numbers):
                return (*others, *names), [*others.values(), *numbers]
            return ((*others, *(f"joint_{k + 1}" for k in range(len(numbers)))) if others else ()), [
                *others.values(),
                *numbers,
            ]
    inner = next((value for key, value in fields.items() if key in VALUE_KEYS and is_map(value)), {})
    pairs = {str(key): value for key, value in {**fields, **fields_of(inner)}.items() if is_plain_number(value)}
    if not pairs:
        raise InputError(f"{where}: expected joint values by their names, got {got(row)}.")
    return tuple(pairs), [float(value) for value in pairs.values()]


def _numbers(values: list[Tree], where: str) -> list[float]:
    for k, value in enumerate(values):
        if not is_plain_number(value):
            raise InputError(f"{where}[{k}]: expected a number, got {got(value)}.")
    return [float(value) for value in values if is_plain_number(value)]
