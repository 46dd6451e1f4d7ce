"""Numbers of poses from points: measured points, residuals, and points left out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import TINY
from ...errors import InputError
from ...findings import Finding, texts
from ..errors.joint_covariance import JointCovariance
from .closed_form import placed
from .least_squares import sight_lines
from .measured import PointSet, Target


@dataclass(frozen=True, eq=False)
class Posed(ReadOnlyArrays):
    """The numbers of `PointPoses`, which lies above its words, picture and files."""

    poses: Array  # (n, 4, 4) camera_T_target
    rows: NDArray[np.int64]  # (n,) numbers of these poses: rows of the robot poses
    covariance: JointCovariance  # of the errors (theta, tau) of all poses, camera frame, left rotation and additive
    target: Target  # as given
    sd: Array  # (2,) standard deviations of a point: lateral, axial, m
    dof: Array  # (2,) degrees of freedom of the residuals, lateral and axial
    noise_given: bool
    points: PointSet  # all measured points
    residuals: Array  # (k, 3) measured minus predicted, camera frame, m; NaN where a point could not be used
    used: NDArray[np.bool_]  # (k,)
    refused: tuple[tuple[int, str], ...]  # poses without a result, with the reason
    findings: tuple[Finding, ...]

    @property
    def n(self) -> int:
        """Number of poses."""
        return len(self.poses)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings that are more than a note, in words."""
        return texts(self.findings)

    @property
    def sigma_lateral(self) -> float:
        """Standard deviation of a point across the line of sight, per axis, m."""
        return float(self.sd[0])

    @property
    def sigma_axial(self) -> float:
        """Standard deviation of a point along the line of sight, m."""
        return float(self.sd[1])

    @cached_property
    def predicted(self) -> Array:
        """(k, 3) points as poses and target predict them, camera frame, m; NaN where there is no pose."""
        pose = np.clip(np.searchsorted(self.rows, self.points.row), 0, self.n - 1)
        point = self.target.find(self.points.point)
        known = (self.rows[pose] == self.points.row) & (point >= 0)
        return np.where(known[:, None], placed(self.poses, self.target.xyz[np.maximum(point, 0)], pose), np.nan)

    @property
    def predicted_residuals(self) -> Array:
        """(k, 3) residuals computed again from points, poses and target."""
        return np.asarray(self.points.xyz - self.predicted)

    @cached_property
    def split_residuals(self) -> tuple[Array, Array, Array]:
        """(k, 2) residuals across the line of sight, (k,) along it, and (k,) distances, m; NaN as in ``residuals``."""
        at = self.predicted
        u = sight_lines(np.where(np.isnan(at), [0.0, 0.0, 1.0], at))
        x = np.cross([0.0, 1.0, 0.0], u)
        x /= np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), TINY)
        across = np.stack([np.sum(self.residuals * e, axis=-1) for e in (x, np.cross(u, x))], axis=-1)
        return across, np.sum(self.residuals * u, axis=-1), np.linalg.norm(at, axis=-1)

    @property
    def outliers(self) -> list[tuple[int, str, float]]:
        """Points that were left out of a pose: number of the pose, name of the point, distance in m; farthest first."""
        distance = np.linalg.norm(self.residuals, axis=-1)
        out = np.flatnonzero(~self.used & np.isfinite(distance))
        out = out[np.argsort(-distance[out], kind="stable")]
        return [(int(self.points.row[k]), str(self.points.point[k]), float(distance[k])) for k in out]

    def select(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Self:
        """Select poses by their numbers or a mask; nothing is estimated again."""
        numbers = np.arange(self.n)[index]
        if (np.diff(numbers) <= 0).any():
            raise InputError("Expected poses in ascending order, each once.")
        rows = self.rows[numbers]
        kept = np.isin(self.points.row, rows)
        return replace(
            self,
            poses=self.poses[numbers],
            rows=rows,
            covariance=self.covariance.rows(numbers),
            points=self.points.where(kept),
            residuals=self.residuals[kept],
            used=self.used[kept],
        )
