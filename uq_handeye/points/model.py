r"""Noise of a measured point: two variances, across the line of sight and along it.

Model: the error of point y in the frame of the camera is Gaussian with zero mean and

    V = g_1(r) phi_1 (I - u u^T) + g_2(r) phi_2 u u^T,     u = y / |y|,  r = |y| / r_0

phi_1 (m^2) across the line of sight, lateral; phi_2 along it, axial; r_0 the median distance. The growth g is 1, or
``g_1 = r^2, g_2 = r^4``: a camera with one error in pixels and one of disparity has a lateral standard deviation in
proportion to the distance and an axial one in proportion to its square. With one variance, phi_1 = phi_2, V is
isotropic, as that of a tracker with several cameras.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.se3 import Array

LATERAL, AXIAL = 0, 1


@dataclass(frozen=True)
class NoiseModel:
    """Kinds of variances: one (isotropic) or two, constant or growing with the distance."""

    isotropic: bool = False
    growing: bool = False
    distance: float = 1.0  # r_0, m

    @property
    def name(self) -> str:
        """``isotropic``, ``lateral and axial``, and whether they grow."""
        return ("isotropic" if self.isotropic else "lateral and axial") + (", growing" if self.growing else "")

    def growth(self, points: Array) -> Array:
        """(k, 2) of the variances at points (k, 3): lateral, axial."""
        if not self.growing:
            return np.ones((len(points), 2))
        r2 = np.sum(points * points, axis=-1) / self.distance**2
        return np.stack([r2, r2 if self.isotropic else r2 * r2], axis=-1)


def sight_lines(points: Array) -> Array:
    """(k, 3) unit vectors from the camera to points (k, 3)."""
    length = np.linalg.norm(points, axis=-1, keepdims=True)
    return np.asarray(np.where(length > 0, points / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0]))


def weight_matrices(u: Array, lateral: Array, axial: Array) -> Array:
    """``w_1 (I - u u^T) + w_2 u u^T`` (k, 3, 3) for weights (k,)."""
    return np.asarray(
        lateral[:, None, None] * np.eye(3) + (axial - lateral)[:, None, None] * (u[:, :, None] * u[:, None])
    )
