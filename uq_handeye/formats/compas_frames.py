"""Frames of COMPAS in its JSON: ``{"dtype": "compas.geometry/Frame", "data": {"point", "xaxis", "yaxis"}}``.

A frame is the pose of its own axes in the frame that it is given in: the columns of the rotation are the x axis, the
part of the y axis that is perpendicular to it, and their cross product. A ``Transformation`` has its 4x4 ``matrix``.
Source: compas-dev/compas, ``compas/geometry/frame.py`` and ``compas/data/encoders.py``.
"""

from __future__ import annotations

import numpy as np

from ..core.files.tree_values import Tree, is_list, is_map
from ..core.files.trees import MAX_DEPTH
from .matrices.matrix_trees import numbers_of

PARTS = ("point", "xaxis", "yaxis")


def without_compas(tree: Tree, depth: int = 0) -> Tree:
    """Return a tree in which frames and transformations of COMPAS, at most `MAX_DEPTH` deep, are 4x4 matrices."""
    if depth > MAX_DEPTH:
        return tree
    if is_list(tree):
        return [without_compas(entry, depth + 1) for entry in tree] if any(map(is_map, tree)) else tree
    if not is_map(tree):
        return tree
    if {"dtype", "data"} <= set(tree) and str(tree["dtype"]).startswith("compas"):
        return without_compas(tree["data"], depth + 1)
    parts = [numbers_of(tree.get(name)) for name in PARTS]
    if all(part is not None and part.shape == (3,) for part in parts):
        return _matrix(np.array(parts, dtype=float)) or tree
    if set(tree) == {"matrix"}:
        matrix: Tree = tree["matrix"]
        return matrix
    return {key: without_compas(value, depth + 1) for key, value in tree.items()}


def _matrix(parts: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[list[float]] | None:
    """Return the matrix of point, x axis and y axis (3, 3); None for axes that make no frame."""
    point, x, y = parts
    z = np.cross(x, y)
    with np.errstate(all="ignore"):
        axes = np.array([x / np.linalg.norm(x), np.cross(z, x) / np.linalg.norm(np.cross(z, x)), z / np.linalg.norm(z)])
    if not np.isfinite(axes).all():
        return None
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = axes.T, point
    return [[float(value) for value in row] for row in T]
