"""Data of the fit: points that were measured in the frame of the camera, and the target that they belong to.

Closed-form starts: poses of a known target (Kabsch), and the shape of an unknown one by its poses in turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import median

from ...core.files.lines import short
from ...core.geometry.checks import as_numbers
from ...core.geometry.nearest_rotation import nearest_rotation
from ...core.geometry.se3 import Array
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import InputError

# A coordinate beyond it (m) is in no cell; characters of a name.
LARGEST, LONGEST = 1e4, 200


def _require_names(names: NDArray[np.str_]) -> None:
    for name in np.unique(names).tolist():
        if not name.isprintable() or len(name) > LONGEST:
            raise InputError(
                f"Expected names of points with at most {LONGEST} characters, all of which print, got {short(name)}."
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
        if not np.isfinite(xyz).all() or np.abs(xyz).max() > LARGEST:
            raise InputError(
                f"Expected `xyz` to be finite and below {LARGEST:g} m. Leave out points that were not seen."
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
    def of(cls, points: Any) -> PointSet:
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
        if not np.isfinite(xyz).all() or np.abs(xyz).max(initial=0.0) > LARGEST:
            raise InputError(f"Expected the points of the target to be finite and below {LARGEST:g} m.")
        _require_names(names)
        unique, count = np.unique(names, return_counts=True)
        if (count > 1).any():
            raise InputError(f"Expected each point of the target once, got {unique[np.argmax(count)]} twice.")
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "xyz", xyz)
        super().__post_init__()

    @classmethod
    def of(cls, target: Any) -> Target:
        """A target as it is, an array (m, 3) whose points are named 0, 1, ..., or coordinates by name."""
        if isinstance(target, Target):
            return target
        if isinstance(target, Mapping):
            return cls(np.array([str(name) for name in target]), np.array([list(xyz) for xyz in target.values()]))
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


SWEEPS, STILL = 40, 1e-6
# The first sweeps take medians over the poses.
BY_MEDIANS = 5
# Poses are sought again where a point is so many times the median residual off; and how many at most.
FAR, NEAR, MOST_SOUGHT = 6.0, 10.0, 200


def sums(values: Array, index: NDArray[np.intp], n: int) -> Array:
    """Sum of values (k, ...) by index (k,), (n, ...)."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    total = np.stack([np.bincount(index, flat[:, c], n) for c in range(flat.shape[1])], axis=-1)
    return np.asarray(total.reshape(n, *values.shape[1:]))


def kabsch(y: Array, p: Array, pose: NDArray[np.intp], n: int, weight: Array) -> Array:
    """Poses (n, 4, 4) that carry p (k, 3) to y (k, 3) by weighted least squares, all at once; Kabsch 1976."""
    total = np.maximum(sums(weight, pose, n), 1e-300)[:, None]
    y_mean, p_mean = (sums(weight[:, None] * x, pose, n) / total for x in (y, p))
    cross = sums(weight[:, None, None] * (y - y_mean[pose])[:, :, None] * (p - p_mean[pose])[:, None], pose, n)
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3], _ = nearest_rotation(cross)
    T[:, :3, 3] = y_mean - (T[:, :3, :3] @ p_mean[..., None])[..., 0]
    return T


def robust_kabsch(y: Array, p: Array, pose: NDArray[np.intp], n: int, rounds: int = 12) -> Array:
    """`kabsch` with weights that fall with the residual, against wrong points (Geman-McClure about the median)."""
    T = kabsch(y, p, pose, n, np.ones(len(y)))
    for _ in range(rounds):
        r = np.linalg.norm(y - placed(T, p, pose), axis=-1)
        scale = np.maximum(2.0 * medians(r, pose, n), 1e-12)
        T = kabsch(y, p, pose, n, (1.0 + (r / scale[pose]) ** 2) ** -2.0)
    return T


def consensus(y: Array, p: Array, pose: NDArray[np.intp], n: int) -> Array:
    """`robust_kabsch`; poses with points far off are sought again among those of three of their points (RANSAC)."""
    T = robust_kabsch(y, p, pose, n)
    r = np.linalg.norm(y - placed(T, p, pose), axis=-1)
    scale = max(float(np.median(r)), 1e-12)
    largest = np.zeros(n)
    np.maximum.at(largest, pose, r)
    rng = np.random.default_rng(0)
    for i in np.flatnonzero(largest > FAR * scale)[:MOST_SOUGHT]:
        mine = np.flatnonzero(pose == i)
        if len(mine) < 5:  # of four, no three are alone in agreeing
            continue
        three = np.array(list(islice(combinations(range(len(mine)), 3), 84)))
        if len(mine) > 9:
            three = np.argsort(rng.random((100, len(mine))), axis=1)[:, :3]
        index = mine[three].ravel()
        tried = kabsch(y[index], p[index], np.repeat(np.arange(len(three)), 3), len(three), np.ones(len(index)))
        at = np.einsum("tab,kb->tka", tried[:, :3, :3], p[mine]) + tried[:, None, :3, 3]
        away = np.linalg.norm(y[mine] - at, axis=-1)
        best = int(np.argmin(np.minimum(away, NEAR * scale).sum(axis=1)))
        near = mine[away[best] < NEAR * scale]
        if len(near) > 3:
            T[i] = kabsch(y[near], p[near], np.zeros(len(near), dtype=np.intp), 1, np.ones(len(near)))[0]
    return T


def medians(values: Array, index: NDArray[np.intp], n: int) -> Array:
    """(n,) medians by index."""
    return np.asarray(median(values, index, np.arange(n)))


def placed(T: Array, p: Array, pose: NDArray[np.intp]) -> Array:
    """``R p + t`` (k, 3) of points p (k, 3), each by its pose."""
    return np.asarray((T[pose, :3, :3] @ p[..., None])[..., 0] + T[pose, :3, 3])


def unknown_shape(
    y: Array, pose: NDArray[np.intp], point: NDArray[np.intp], n: int, m: int, largest: int
) -> tuple[Array, Array]:
    """Shape (m, 3) about its centroid and poses (n, 4, 4), in the axes of the camera at pose ``largest``.

    Poses join the shape one after the other, the one with most points in common first; then shape and poses in turn
    (generalised Procrustes analysis, Gower 1975), with missing points.
    """
    shape, known = np.zeros((m, 3)), np.zeros(m, dtype=bool)
    mine = pose == largest
    shape[point[mine]], known[point[mine]] = y[mine], True
    open_ = np.ones(n, dtype=bool)
    open_[largest] = False
    T = np.tile(np.eye(4), (n, 1, 1))
    while open_.any():
        common = np.bincount(pose[known[point]], minlength=n) * open_
        i = int(np.argmax(common))
        if common[i] < 3:  # not connected; the rank of the fit says so
            break
        mine = pose == i
        both = mine & known[point]
        T[i] = robust_kabsch(y[both], shape[point[both]], np.zeros(int(both.sum()), dtype=np.intp), 1)[0]
        new = mine & ~known[point]
        shape[point[new]] = (y[new] - T[i, :3, 3]) @ T[i, :3, :3]
        known[point[new]], open_[i] = True, False
    joined = ~open_[pose]
    for sweep in range(SWEEPS):
        before = shape
        T = robust_kabsch(y, shape[point], pose, n, 3)
        back = ((y - T[pose, :3, 3])[:, None] @ T[pose, :3, :3])[:, 0]
        if sweep < BY_MEDIANS:  # the pose that the shape started from may have wrong points, too
            shape = np.stack([medians(back[:, c], point, m) for c in range(3)], axis=-1)
        r = np.linalg.norm(back - shape[point], axis=-1)
        weight = joined * (1.0 + (r / max(2.0 * float(np.median(r)), 1e-12)) ** 2) ** -2.0
        total = np.bincount(point, weight, m)
        shape = sums(weight[:, None] * back, point, m) / np.maximum(total, 1e-300)[:, None]
        one = np.zeros(m, dtype=np.intp)
        shape = placed(kabsch(before, shape, one, 1, np.ones(m)), shape, one)  # anchored
        if np.abs(shape - before).max() < STILL * max(float(np.abs(shape).max()), 1e-9):
            break
    T = consensus(y, shape[point], pose, n)
    centre = shape.mean(axis=0)
    T[:, :3, 3] += (T[:, :3, :3] @ centre[:, None])[..., 0]
    return shape - centre, T
