"""Points that were measured in the frame of the camera, and the target that they belong to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.files.one_line import short
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...core.limits import MAX_NAME_CHARACTERS
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError

# No robot cell is as large: a larger coordinate is a reading error or in another unit.
MAX_COORDINATE_M = 1e4


def _require_names(names: NDArray[np.str_]) -> None:
    for name in np.unique(names).tolist():
        if not name.isprintable() or len(name) > MAX_NAME_CHARACTERS:
            raise InputError(
                f"Expected names of points with at most {MAX_NAME_CHARACTERS} characters, all of which print, got "
                f"{short(name)}."
            )


@dataclass(frozen=True, eq=False)
class PointSet(ReadOnlyArrays):
    """k measured points, sorted by pose.

    Parameters
    ----------
    row : (k,) whole numbers
        Number of the pose: the row of the robot poses, from 0.
    point : (k,) text
        Name of the point of the target; each once per pose.
    xyz : (k, 3)
        Coordinates in the frame of the camera, m.

    Raises
    ------
    InputError
        Wrong shapes, numbers that are not finite, a point twice in one pose.
    """

    row: NDArray[np.int64]
    point: NDArray[np.str_]
    xyz: Array

    def __post_init__(self) -> None:
        xyz = as_numbers(self.xyz, "xyz")
        row, point = np.asarray(self.row), np.asarray(self.point).astype(str)
        k = len(xyz) if xyz.ndim else 0
        if xyz.shape != (k, 3) or row.shape != (k,) or point.shape != (k,) or k == 0:
            raise InputError(
                f"Expected `row` (k,), `point` (k,) and `xyz` (k, 3) with k >= 1, got {row.shape}, {point.shape} and "
                f"{xyz.shape}."
            )
        if row.dtype.kind not in "iuf" or (row != np.floor(row)).any() or (row < 0).any():
            raise InputError("Expected `row` to be numbers of poses: whole, from 0.")
        if not np.isfinite(xyz).all() or np.abs(xyz).max() > MAX_COORDINATE_M:
            raise InputError(
                f"Expected `xyz` to be finite and below {MAX_COORDINATE_M:g} m. Leave out points that were not seen."
            )
        _require_names(point)
        row = row.astype(np.int64)
        order = np.lexsort((point, row))
        order = order[np.argsort(row[order], kind="stable")]
        twice = (row[order][1:] == row[order][:-1]) & (point[order][1:] == point[order][:-1])
        if twice.any():
            k = order[int(np.argmax(twice))]
            raise InputError(
                f"Expected each point once per pose, got point {point[k]} twice in pose {row[k]}. Give the points of a "
                "pose different names."
            )
        for name, value in (("row", row), ("point", point), ("xyz", xyz)):
            object.__setattr__(self, name, value[order])
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.row)

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """(n,) numbers of the poses, ascending."""
        return np.unique(self.row)

    @cached_property
    def names(self) -> NDArray[np.str_]:
        """(m,) names of the points, in the order of the numbers where they are numbers."""
        names = np.unique(self.point)
        if all(name.isdecimal() for name in names.tolist()):
            names = names[np.argsort(names.astype(float), kind="stable")]
        return names

    def where(self, mask: NDArray[np.bool_]) -> PointSet:
        """Return some of the points."""
        return PointSet(self.row[mask], self.point[mask], self.xyz[mask])

    @classmethod
    def of(cls, points: PointSet | ArrayLike) -> PointSet:
        """Points as they are, or of an array (n, m, 3): pose, point, coordinates; NaN where a point was not seen."""
        if isinstance(points, PointSet):
            return points
        xyz = as_numbers(points, "points")
        if xyz.ndim != 3 or xyz.shape[-1] != 3:
            raise InputError(
                "Expected `points` to be a PointSet (read_points) or an array (n, m, 3) of n poses and m points, got "
                f"the shape {xyz.shape}."
            )
        seen = ~np.isnan(xyz).any(axis=-1)
        row, point = np.nonzero(seen)
        return cls(row, point.astype(str), xyz[seen])


@dataclass(frozen=True, eq=False)
class Target(ReadOnlyArrays):
    """Points of a target in its own frame: names (m,) and coordinates (m, 3), m."""

    names: NDArray[np.str_]
    xyz: Array

    def __post_init__(self) -> None:
        xyz, names = as_numbers(self.xyz, "target"), np.asarray(self.names).astype(str)
        if xyz.ndim != 2 or xyz.shape[-1] != 3 or names.shape != xyz.shape[:1]:
            raise InputError(f"Expected the target as (m, 3) with m names, got {xyz.shape} and {names.shape}.")
        if not np.isfinite(xyz).all() or np.abs(xyz).max(initial=0.0) > MAX_COORDINATE_M:
            raise InputError(f"Expected the points of the target to be finite and below {MAX_COORDINATE_M:g} m.")
        _require_names(names)
        unique, count = np.unique(names, return_counts=True)
        if (count > 1).any():
            raise InputError(f"Expected each point of the target once, got {unique[np.argmax(count)]} twice.")
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "xyz", xyz)
        super().__post_init__()

    @classmethod
    def of(cls, target: Target | Mapping[str, ArrayLike] | ArrayLike) -> Target:
        """A target as it is, an array (m, 3) whose points are named 0, 1, ..., or coordinates by name."""
        if isinstance(target, Target):
            return target
        if isinstance(target, Mapping):
            return cls(np.array([str(name) for name in target]), np.array([np.asarray(xyz) for xyz in target.values()]))
        xyz = as_numbers(target, "target")
        return cls(np.arange(len(xyz) if xyz.ndim else 0).astype(str), xyz)

    def find(self, names: ArrayLike) -> NDArray[np.intp]:
        """(k,) index of each name, -1 where the target has none such."""
        order = np.argsort(self.names)
        sought = np.asarray(names).astype(str)
        place = np.clip(np.searchsorted(self.names, sought, sorter=order), 0, max(len(self.names) - 1, 0))
        if not len(self.names):
            return np.full(sought.shape, -1, dtype=np.intp)
        return np.where(self.names[order[place]] == sought, order[place], -1)
