r"""Camera models: where a point in front of the camera is seen, and the derivatives of it.

A point ``p = (x, y, z)`` in the camera frame (z along the optical axis, x right, y down; the unit of length of the
board) is seen at the pixel

    (u, v) = (fx x_d + cx, fy y_d + cy)

with the coefficients of OpenCV's models, in OpenCV's order:

- ``pinhole``: ``(x_d, y_d) = (a, b) = (x/z, y/z)``.
- ``brown`` (Brown-Conrady, with the denominator of OpenCV's rational model): ``s = a^2 + b^2``,
  ``x_d = g a + 2 p1 a b + p2 (s + 2 a^2)``, ``y_d = g b + p1 (s + 2 b^2) + 2 p2 a b``,
  ``g = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)``.
- ``fisheye`` (Kannala-Brandt): with ``rho = sqrt(x^2 + y^2)``, ``phi = atan2(rho, z)`` and
  ``h = phi (1 + k1 phi^2 + k2 phi^4 + k3 phi^6 + k4 phi^8)``:  ``(x_d, y_d) = (h / rho) (x, y)``.

Source: documentation of OpenCV's calib3d and fisheye modules; D. Brown, Photogrammetric Engineering 37 (1971);
J. Kannala, S. Brandt, IEEE Trans. PAMI 28 (2006), doi:10.1109/TPAMI.2006.153.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry.se3 import Array

LINEAR = ("fx", "fy", "cx", "cy")


class Projected(NamedTuple):
    """Pixels of points (..., 3) and their derivatives; where a point is behind the camera they mean nothing."""

    pixels: Array  # (..., 2)
    by_parameters: Array  # (..., 2, k) in the order of the model's names
    by_point: Array  # (..., 2, 3)


# Distorted coordinates (..., 2) of points (..., 3), derivatives by the coefficients (..., 2, c) and points (..., 2, 3).
Distortion = Callable[[Array, Array], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class CameraModel:
    """A family of cameras; parameters are ``LINEAR`` and then ``coefficients``."""

    name: str
    coefficients: tuple[str, ...]
    distort: Distortion

    @property
    def names(self) -> tuple[str, ...]:
        """Of all parameters: focal lengths and centre in pixels, coefficients without unit."""
        return LINEAR + self.coefficients

    def project(self, parameters: Array, points: Array) -> Projected:
        """Of ``points`` (..., 3) in the camera frame with ``parameters`` (k,)."""
        fx, fy, cx, cy = parameters[:4]
        distorted, by_coefficients, by_point = self.distort(parameters[4:], points)
        scale = np.array([fx, fy])
        by_parameters = np.zeros((*distorted.shape, 4 + len(self.coefficients)))
        by_parameters[..., 0, 0], by_parameters[..., 1, 1] = distorted[..., 0], distorted[..., 1]
        by_parameters[..., 0, 2] = by_parameters[..., 1, 3] = 1.0
        by_parameters[..., 4:] = scale[:, None] * by_coefficients
        return Projected(scale * distorted + np.array([cx, cy]), by_parameters, scale[:, None] * by_point)


def _normalised(points: Array) -> tuple[Array, Array, Array]:
    """a = x/z, b = y/z, and their derivatives by the point (..., 2, 3)."""
    z = points[..., 2]
    a, b = points[..., 0] / z, points[..., 1] / z
    by_point = np.zeros((*points.shape[:-1], 2, 3))
    by_point[..., 0, 0] = by_point[..., 1, 1] = 1.0 / z
    by_point[..., 0, 2], by_point[..., 1, 2] = -a / z, -b / z
    return a, b, by_point


def _pinhole(coefficients: Array, points: Array) -> tuple[Array, Array, Array]:
    a, b, by_point = _normalised(points)
    return np.stack([a, b], axis=-1), np.empty((*a.shape, 2, 0)), by_point


def _brown(coefficients: Array, points: Array) -> tuple[Array, Array, Array]:
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients
    a, b, by_point = _normalised(points)
    s = a * a + b * b
    powers = np.stack([s, s * s, s * s * s], axis=-1)
    below = 1.0 + powers @ np.array([k4, k5, k6])
    g = (1.0 + powers @ np.array([k1, k2, k3])) / below
    slopes = np.stack([np.ones_like(s), 2 * s, 3 * s * s], axis=-1)
    g_s = (slopes @ np.array([k1, k2, k3]) - g * (slopes @ np.array([k4, k5, k6]))) / below
    distorted = np.stack(
        [g * a + 2 * p1 * a * b + p2 * (s + 2 * a * a), g * b + p1 * (s + 2 * b * b) + 2 * p2 * a * b], axis=-1
    )
    ab = np.stack([a, b], axis=-1)
    by_coefficients = np.empty((*a.shape, 2, 8))
    radial = ab[..., :, None] * (powers / below[..., None])[..., None, :]
    by_coefficients[..., [0, 1, 4]] = radial
    by_coefficients[..., 5:] = -g[..., None, None] * radial
    by_coefficients[..., 0, 2] = by_coefficients[..., 1, 3] = 2 * a * b
    by_coefficients[..., 0, 3], by_coefficients[..., 1, 2] = s + 2 * a * a, s + 2 * b * b
    by_ab = np.empty((*a.shape, 2, 2))
    by_ab[..., 0, 0] = g + 2 * a * a * g_s + 2 * p1 * b + 6 * p2 * a
    by_ab[..., 1, 1] = g + 2 * b * b * g_s + 6 * p1 * b + 2 * p2 * a
    by_ab[..., 0, 1] = by_ab[..., 1, 0] = 2 * a * b * g_s + 2 * p1 * a + 2 * p2 * b
    return distorted, by_coefficients, by_ab @ by_point


def _fisheye(coefficients: Array, points: Array) -> tuple[Array, Array, Array]:
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    square = x * x + y * y
    # On the optical axis h/rho is 1/z, and its derivative by rho is 0: the tiny number keeps that without a branch.
    rho = np.sqrt(square) + 1e-12 * np.abs(z)
    phi = np.arctan2(rho, z)
    powers = np.stack([phi**3, phi**5, phi**7, phi**9], axis=-1)
    h = phi + powers @ coefficients
    h_phi = 1.0 + (powers / phi[..., None]) @ (coefficients * np.array([3.0, 5.0, 7.0, 9.0]))
    ratio = h / rho
    xy = points[..., :2]
    by_coefficients = xy[..., :, None] * (powers / rho[..., None])[..., None, :]
    whole = rho * rho + z * z
    ratio_rho = (h_phi * z / whole - ratio) / rho
    by_point = np.zeros((*x.shape, 2, 3))
    by_point[..., :2] = xy[..., :, None] * (xy * (ratio_rho / rho)[..., None])[..., None, :]
    by_point[..., 0, 0] += ratio
    by_point[..., 1, 1] += ratio
    by_point[..., 2] = -xy * (h_phi / whole)[..., None]
    return ratio[..., None] * xy, by_coefficients, by_point


MODELS = {
    model.name: model
    for model in (
        CameraModel("pinhole", (), _pinhole),
        CameraModel("brown", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), _brown),
        CameraModel("fisheye", ("k1", "k2", "k3", "k4"), _fisheye),
    )
}
