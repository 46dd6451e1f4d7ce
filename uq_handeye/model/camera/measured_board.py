"""A measured board: the places of its points, its bow, and their uncertainty.

Its points are ``P = p + o + B w`` (`board_shape`), and their errors ``F a`` with independent a of standard deviation 1,
``F = B L``, ``L L^T`` the covariance of w. Every number is linear in the points or, to first order, taken as such: its
variance is ``|c^T F|^2``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays


@dataclass(frozen=True, eq=False)
class MeasuredBoard(ReadOnlyArrays):
    """Points of a board, in its frame and in metres, with their uncertainty."""

    shape: str  # name of the `BoardShape`
    nominal: Array  # (u, 3) points as they were meant
    points: Array  # (u, 3) as measured
    factor: Array  # (u, 3, q) F: F F^T, with F as (3u, q), is the covariance of all points, m^2

    @cached_property
    def axes(self) -> Array:
        """(3, 3) rows: x and y in the plane of the board, and its normal."""
        return board_axes(self.nominal)

    @property
    def flat(self) -> bool:
        """True if every point lies where it was meant to."""
        return bool(np.array_equal(self.nominal, self.points))

    @property
    def deviations(self) -> Array:
        """(u, 3) standard deviations of the points along `axes`, m."""
        return np.asarray(np.linalg.norm(np.einsum("ij,ujq->uiq", self.axes, self.factor), axis=-1))

    @cached_property
    def heights(self) -> Array:
        """(u,) of the points over the plane nearest to them, m."""
        return self._over_plane((self.points - self.nominal) @ self.axes[2])

    @cached_property
    def bow(self) -> tuple[float, float]:
        """Highest point minus lowest point over the plane, and its standard deviation to first order, m."""
        high, low = int(np.argmax(self.heights)), int(np.argmin(self.heights))
        errors = self._over_plane(np.einsum("j,ujq->uq", self.axes[2], self.factor))
        return float(self.heights[high] - self.heights[low]), float(np.linalg.norm(errors[high] - errors[low]))

    @property
    def size(self) -> float:
        """Diagonal of the points as meant, m."""
        return float(np.linalg.norm(np.ptp((self.nominal - self.nominal.mean(axis=0)) @ self.axes.T, axis=0)))

    @property
    def in_plane(self) -> float:
        """Root mean square displacement of the points within the plane, m."""
        return float(np.sqrt(np.mean(np.sum(((self.points - self.nominal) @ self.axes[:2].T) ** 2, axis=1))))

    @cached_property
    def stretch(self) -> tuple[float, float]:
        """Share by which squares are wider (along x) than high (along y), and its standard deviation.

        The slopes of ``dx = a + b x + c y`` and of dy, by least squares over the points: ``dx/dx - dy/dy``.
        """
        slopes = np.linalg.pinv(self._plane)[1:]  # (2, u) by x and by y
        moved = (self.points - self.nominal) @ self.axes[:2].T
        errors = np.einsum("ij,ujq->uiq", self.axes[:2], self.factor)
        value = float(slopes[0] @ moved[:, 0] - slopes[1] @ moved[:, 1])
        return value, float(np.linalg.norm(slopes[0] @ errors[:, 0] - slopes[1] @ errors[:, 1]))

    @cached_property
    def _plane(self) -> Array:
        """(u, 3) columns 1, x, y."""
        local = (self.nominal - self.nominal.mean(axis=0)) @ self.axes.T
        return np.column_stack([np.ones(len(local)), local[:, :2]])

    def _over_plane(self, values: Array) -> Array:
        """Values (u, ...) without their part that is linear in x and y."""
        Q = np.linalg.qr(self._plane)[0]
        return np.asarray(values - Q @ (Q.T @ values))


def board_axes(points: Array) -> Array:
    """Return (3, 3) rows: x of the board's frame within the plane of the points, y, and the normal on the side of z."""
    normal = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2]
    normal = normal * (np.sign(normal[2]) or 1.0)
    along = np.eye(3)[0] if abs(normal[0]) < 0.9 else np.eye(3)[1]
    x = along - normal * (normal @ along)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal])
