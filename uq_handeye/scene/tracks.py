"""`Tracks`: which point of a scene is seen in which picture, and where."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array
from ..core.read_only import ReadOnlyArrays
from ..errors import InputError


@dataclass(frozen=True, eq=False)
class Tracks(ReadOnlyArrays):
    """Observations of scene points, sorted by point; a picture sees a point at most once.

    Pixels are those of `camera.models`: the centre of the first pixel is (0, 0).
    """

    picture: NDArray[np.intp]  # (N,) number of the picture among ``names``
    point: NDArray[np.intp]  # (N,) number of the point, 0 to m - 1, ascending
    pixels: Array  # (N, 2)
    names: tuple[str, ...]  # n pictures, by the names of their files
    image_size: tuple[int, int]  # width, height

    def __post_init__(self) -> None:
        N = len(self.point)
        if self.pixels.shape != (N, 2) or self.picture.shape != (N,):
            raise InputError(
                f"Expected `picture`, `point` and `pixels` of one number of observations, got {self.picture.shape}, "
                f"{self.point.shape} and {self.pixels.shape}."
            )
        if N and (
            (np.diff(self.point) < 0).any() or not 0 <= self.picture.min() <= self.picture.max() < len(self.names)
        ):
            raise InputError("Expected observations sorted by point, of the pictures that `names` has.")
        super().__post_init__()

    @classmethod
    def of(
        cls, picture: Array, point: Array, pixels: Array, names: tuple[str, ...], image_size: tuple[int, int]
    ) -> Tracks:
        """Build tracks of observations in any order, of points by any numbers."""
        _, number = np.unique(point, return_inverse=True)
        order = np.lexsort((picture, number))
        return cls(np.asarray(picture, np.intp)[order], number[order], pixels[order], names, image_size)

    def __len__(self) -> int:
        return len(self.point)

    @property
    def n(self) -> int:
        """Number of pictures."""
        return len(self.names)

    @cached_property
    def first(self) -> NDArray[np.intp]:
        """(m,) first observation of each point."""
        return np.flatnonzero(np.diff(self.point, prepend=-1))

    @property
    def m(self) -> int:
        """Number of points."""
        return len(self.first)

    @cached_property
    def of_each_picture(self) -> list[NDArray[np.intp]]:
        """Observations of each of the n pictures."""
        order = np.argsort(self.picture, kind="stable")
        return np.split(order, np.cumsum(self.per_picture)[:-1])

    @cached_property
    def per_picture(self) -> NDArray[np.intp]:
        """(n,) number of points that each picture shows."""
        return np.bincount(self.picture, minlength=self.n)

    def by_point(self, values: Array) -> Array:
        """Sum values (N, ...) over the observations of each point: (m, ...)."""
        return np.asarray(np.add.reduceat(values, self.first, axis=0)) if len(self) else values[:0]

    def where(self, kept: NDArray[np.bool_]) -> tuple[Tracks, NDArray[np.intp]]:
        """Return the observations that are kept and the (m,) numbers of their points, which are counted again."""
        points, number = np.unique(self.point[kept], return_inverse=True)
        return (
            replace(self, picture=self.picture[kept], point=number, pixels=self.pixels[kept]),
            np.asarray(points, dtype=np.intp),
        )

    def of_pictures(self, kept: NDArray[np.intp]) -> tuple[Tracks, NDArray[np.intp]]:
        """Return the tracks of some pictures, by ascending numbers, and the numbers of their points, seen twice."""
        number = np.full(self.n, -1)
        number[kept] = np.arange(len(kept))
        seen = number[self.picture] >= 0
        seen &= np.bincount(self.point[seen], minlength=self.m)[self.point] > 1
        found, points = self.where(seen)
        names = tuple(self.names[k] for k in kept)
        return replace(found, picture=number[found.picture], names=names), points
