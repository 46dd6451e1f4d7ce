"""Uncertainty of a point straight ahead of the camera by the error of X, over its distance.

Model: `task_space`. The point itself is exact, so that only the error of X counts. "Worst" is the standard deviation in
the worst direction, the root of the largest eigenvalue of the covariance of the point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ..estimated import Estimated, distance_of

_STEPS = np.array([0.25, 0.5, 0.75, 1.0, 1.5, 2.0])  # of the table, in distances to the target


class Ahead(NamedTuple):
    """Points straight ahead of the camera."""

    distance: Array  # (k,) m
    worst: Array  # (k,) m, standard deviation in the worst direction
    across: Array  # (k,) m, in the worst direction across the line of sight
    along: Array  # (k,) m, along it
    radius_95: Array  # (k,) m


def ahead(result: Estimated, distances: Array | None = None) -> Ahead:
    """The uncertainty of points on the optical axis; without ``distances`` (m) those of a small table.

    Raises `InputError` where the covariance of X is not determined.
    """
    if distances is None:
        distances = np.array([float(f"{x:.2g}") for x in distance_of(result.analysis)[0] * _STEPS])
    found = result.uncertainty_at(np.stack([0 * distances, 0 * distances, distances], axis=-1))
    R = result.X[:3, :3]
    in_camera = R.T @ found.covariance @ R
    root = np.sqrt(np.maximum(np.linalg.eigvalsh(in_camera[..., :2, :2])[..., -1], 0.0))
    return Ahead(distances, worst_deviation(found.covariance), root, np.sqrt(in_camera[..., 2, 2]), found.radius_95)


def worst_deviation(covariance: Array) -> Array:
    """Standard deviation (...) in the worst direction, of covariances (..., k, k)."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[..., -1], 0.0)))
