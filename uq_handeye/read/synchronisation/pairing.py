"""Rows of two streams for a given time offset: poses of one, the other interpolated at their times, and their noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...model.errors.models import PoseNoise
from .interpolation import Interpolated, at_times


class Pairing(NamedTuple):
    """Two streams sorted by time, one of which is interpolated at the times of the other; times from any origins."""

    robot_times: Array
    robot: Array
    camera_times: Array
    camera: Array
    side: str  # "robot" or "camera": the interpolated one
    kind: str
    max_gap: float
    inverted: bool  # eye-to-hand

    @property
    def n(self) -> int:
        """Number of poses of the side that is not interpolated: the most rows that there can be."""
        return len(self.camera_times if self.side == "robot" else self.robot_times)

    def interpolated(self, offset: float, rows: NDArray[np.intp] | None = None) -> Interpolated:
        """Return the interpolated side at the times of the other one; rates are by the offset."""
        if self.side == "robot":
            wanted = self.camera_times if rows is None else self.camera_times[rows]
            return at_times(self.robot_times, self.robot, wanted + offset, self.kind, self.max_gap)
        wanted = self.robot_times if rows is None else self.robot_times[rows]
        found = at_times(self.camera_times, self.camera, wanted - offset, self.kind, self.max_gap)
        return found._replace(rate=-found.rate)

    def rows_at(self, offset: float) -> NDArray[np.intp]:
        """Return the rows for which nothing is extrapolated and no gap is bridged."""
        return np.flatnonzero(self.interpolated(offset).fine)

    def poses(self, found: Interpolated, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return robot and camera poses (k, 4, 4) of the rows that were interpolated as ``found``."""
        if self.side == "robot":
            return found.poses, self.camera[rows]
        return self.robot[rows], found.poses


def thinned(rows: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return at most ``most`` of the rows, evenly spread."""
    if len(rows) <= most:
        return rows
    return rows[np.linspace(0, len(rows) - 1, most).round().astype(np.intp)]


def noise_at(noise: PoseNoise, found: Interpolated, side: str) -> PoseNoise:
    """Return the noise of rows from that of the samples: the mean of two is less noisy by ``w^2 + (1 - w)^2``."""
    S = getattr(noise, side)
    if S is None:
        return noise
    w = np.clip(found.weight, 0.0, 1.0)
    less = (w**2 + (1 - w) ** 2)[:, None, None] * S
    return PoseNoise(less, noise.camera) if side == "robot" else PoseNoise(noise.robot, less)


def noise_of_rows(noise: PoseNoise, found: Interpolated, side: str) -> PoseNoise:
    """Return the noise to calibrate all rows with as if they were independent: `noise_at`, and samples that rows share.

    Rows whose intervals touch share a sample. With the weights ``w_ik`` of sample k in row i, their errors have the
    covariances ``sum_k w_ik w_jk S``. What neighbours do to X is alike, so that of row i counts what it shares with all
    others: ``sum_k w_ik s_k S``, with ``s_k = sum_j w_jk``. That is `noise_at` where the interpolated stream has twice
    the rate of the other, and S itself, not 2/3 of it, where both have the same.
    """
    S = getattr(noise, side)
    if S is None:
        return noise
    w = np.clip(found.weight, 0.0, 1.0)
    size = int(found.left.max(initial=0)) + 2
    used = np.bincount(found.left, w, size) + np.bincount(found.left + 1, 1 - w, size)
    counted = (w * used[found.left] + (1 - w) * used[found.left + 1])[:, None, None] * S
    return PoseNoise(counted, noise.camera) if side == "robot" else PoseNoise(noise.robot, counted)
