"""Matrices in JSON and YAML under user-defined names: one per file, a list, or an entry per pose.

Only unambiguous forms are read: a matrix or a list of them alone; a map with one entry that is one; entries that are
matrices by numbered names (``pose_0``, ``pose_1``); a list of maps that each hold one under the same name, also below a
single name (``frames`` of NeRF). The order of the 16 numbers follows from their places (`layout`).
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ...core.files.folders import natural
from ...core.files.tree_values import Tree, fields_of, got, is_list, is_map, is_plain_number, items_of
from ...core.geometry.se3 import Array
from ...core.limits import MAX_ROWS
from ...errors import InputError
from ..contents import Contents
from .arrays import is_poses, side_of_array

_NUMBERED = re.compile(r"(.*?)[\[(_ -]*(\d+)[\])]*(\.[A-Za-z]\w*)?")


def numbers_of(value: Tree) -> Array | None:
    """Lists of numbers as an array, or None for anything else."""
    shape: list[int] = []
    level: list[Any] = [value]
    while all(map(is_list, level)) and len(shape) < 4:
        lengths = {len(entry) for entry in level}
        if len(lengths) != 1 or lengths == {0}:
            return None
        shape.append(lengths.pop())
        level = [inner for entry in level for inner in entry]
        if len(level) > MAX_ROWS:
            return None
    if not shape or not all(map(is_plain_number, level)):
        return None
    return np.array(level, dtype=float).reshape(shape)


def matrices_of(tree: Tree) -> tuple[Array, str] | None:
    """Return the matrices of a tree, and under which names they stood; None if they are not told without doubt."""
    values = numbers_of(tree)
    if values is not None:
        rows_of_poses = values.shape[-1] in (6, 7, 8)
        return (values, "") if is_poses(values.shape) and not rows_of_poses else None
    if is_map(tree):
        found = {str(key): one for key, value in tree.items() if (one := matrices_of(value)) is not None}
        if len(found) == 1:
            ((key, (values, below)),) = found.items()
            return values, f"{key}{f'.{below}' if below else ''}"
        stems = {match[1] if (match := _NUMBERED.fullmatch(key)) else key for key in found}
        if len(found) > 1 and len(stems) == 1:
            keys = sorted(found, key=natural)
            return _stacked([found[key][0] for key in keys], f"{keys[0]} to {keys[-1]}")
        return None
    entries = items_of(tree)
    if entries and all(map(is_map, entries)):
        each = [matrices_of(entry) for entry in entries]
        names = {None if one is None else one[1] for one in each}
        if len(names) == 1 and None not in names:
            return _stacked([one[0] for one in each if one is not None], str(names.pop()))
    return None


def listed(tree: Tree) -> Tree:
    """Return maps with an entry per pose by numbered names (``"0"``, ``pose_1``) as lists, also below other names.

    The pose vector of ViSP (``vpPoseVector::saveYAML``: six rows, metres and rotation vector) becomes one by names.
    """
    if not is_map(tree):
        return tree
    vector = numbers_of(tree["data"]) if set(tree) == {"rows", "cols", "data"} else None
    if vector is not None and vector.shape == (6, 1):
        values = vector.ravel().tolist()
        return [{"translation": values[:3], "rotvec": values[3:]}]
    stems: dict[str, list[str]] = {}
    for key, value in tree.items():
        if (is_map(value) or _is_pose(value)) and (match := _NUMBERED.fullmatch(str(key))) is not None:
            stems.setdefault(match[1].rstrip("_- [("), []).append(key)
    lists = {
        stem: [tree[key] for key in sorted(keys, key=natural)]
        for stem, keys in stems.items()
        if len(keys) > 1 and stem not in tree
    }
    if len(lists) == 1 and (first := numbers_of(next(iter(lists.values()))[0])) is not None and first.size > 7:
        return tree  # matrices of one side, which `matrices_of` reads with their names
    every = next(iter(lists.values()), [])
    if len(lists) == 1 and len(tree) == len(every) and not {"rows", "cols", "data"} <= set(fields_of(every[0])):
        return every
    taken = {key for stem in lists for key in stems[stem]}
    return {**{key: listed(value) for key, value in tree.items() if key not in taken}, **lists}


def _is_pose(value: Tree) -> bool:
    """Return whether a value is the six or seven numbers of a pose, or a matrix."""
    found = numbers_of(value)
    return found is not None and found.shape in ((6,), (7,), (4, 4), (3, 4), (16,), (12,))


def _stacked(parts: list[Array], name: str) -> tuple[Array, str] | None:
    """Poses of entries that hold one each."""
    shapes = {part.shape for part in parts}
    if len(shapes) != 1 or shapes.pop() not in ((4, 4), (3, 4), (16,), (12,)):
        return None
    return np.stack(parts), name


def read_matrix_tree(tree: Tree, name: str) -> Contents:
    """Return the poses of a tree."""
    found = matrices_of(tree)
    if found is None:
        raise InputError(
            f"{name}: expected matrices as a list, or each under one name, got {got(tree)} (docs/formats.md, JSON)."
        )
    values, where = found
    side, notes = side_of_array(values, name)
    return Contents(only=side, notes=(*([f"matrices from {where}"] if where else []), *notes))
