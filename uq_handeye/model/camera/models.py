r"""Camera models: the pixel of a point in front of the camera, and its derivatives.

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
from numpy.typing import NDArray

from ...core.geometry.se3 import Array

LINEAR = ("fx", "fy", "cx", "cy")
Pair = tuple[Array, Array]  # along u and v, each of the shape of the points


class Projected(NamedTuple):
    """Pixels of points (..., 3) and their derivatives; where a point is behind the camera they mean nothing.

    In memory each component of points (..., m, 3) lies together: of a derivative, ``swapaxes(-1, -3)`` is contiguous.
    """

    pixels: Array  # (..., 2)
    by_parameters: Array  # (..., 2, k) in the order of the model's names, of the free ones
    by_point: Array  # (..., 2, 3)


class Distorted(NamedTuple):
    """Distorted coordinates (x_d, y_d), and their derivatives."""

    at: Pair
    by_coefficients: tuple[Pair, ...]
    by_point: tuple[Pair, Pair, Pair]


# Of the coefficients, x, y and z.
Distortion = Callable[[Array, Array, Array, Array], Distorted]


@dataclass(frozen=True)
class CameraModel:
    """A family of cameras; parameters are ``LINEAR`` and then ``coefficients``."""

    name: str
    coefficients: tuple[str, ...]
    distort: Distortion

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters: focal lengths and centre in pixels, coefficients without unit."""
        return LINEAR + self.coefficients

    def project(self, parameters: Array, points: Array, free: NDArray[np.bool_] | None = None) -> Projected:
        """Project ``points`` (..., 3) in the camera frame with ``parameters`` (k,); derivatives by the ``free``
        ones.
        """
        if points.ndim == 1:
            return Projected(*(part[0] for part in self.project(parameters, points[None], free)))
        seen = self.distort(parameters[4:], *(points[..., k] for k in range(3)))
        scale, centre = parameters[:2], parameters[2:4]
        wanted = np.arange(len(self.names)) if free is None else np.flatnonzero(free)
        lead, m = points.shape[:-2], points.shape[-2]
        pixels, by_point = np.empty((*lead, 2, m)), np.empty((*lead, 3, 2, m))
        by_parameters = np.empty((*lead, len(wanted), 2, m))
        for axis in (0, 1):  # along u, along v
            np.multiply(seen.at[axis], scale[axis], out=pixels[..., axis, :])
            pixels[..., axis, :] += centre[axis]
            for k in range(3):
                np.multiply(seen.by_point[k][axis], scale[axis], out=by_point[..., k, axis, :])
            for place, k in enumerate(wanted.tolist()):
                column = by_parameters[..., place, axis, :]
                if k >= len(LINEAR):
                    np.multiply(seen.by_coefficients[k - len(LINEAR)][axis], scale[axis], out=column)
                elif k % 2 == axis:
                    column[...] = seen.at[axis] if k < 2 else 1.0
                else:
                    column[...] = 0.0
        return Projected(pixels.mT, by_parameters.swapaxes(-1, -3), by_point.swapaxes(-1, -3))


def _pinhole(coefficients: Array, x: Array, y: Array, z: Array) -> Distorted:
    w = 1.0 / z
    a, b = x * w, y * w
    none = np.zeros_like(w)
    return Distorted((a, b), (), ((w, none), (none, w), (-a * w, -b * w)))


def _brown(coefficients: Array, x: Array, y: Array, z: Array) -> Distorted:
    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients.tolist()
    w = 1.0 / z
    a, b = x * w, y * w
    aa, bb, ab = a * a, b * b, 2.0 * a * b
    s = aa + bb
    over = 1.0 / (1.0 + s * (k4 + s * (k5 + s * k6)))
    g = (1.0 + s * (k1 + s * (k2 + s * k3))) * over
    g_s = 2.0 * over * (k1 + s * (2.0 * k2 + s * (3.0 * k3)) - g * (k4 + s * (2.0 * k5 + s * (3.0 * k6))))
    across, along = s + 2.0 * aa, s + 2.0 * bb
    at = g * a + p1 * ab + p2 * across, g * b + p1 * along + p2 * ab
    radial = s * over
    first = radial * a, radial * b
    second = first[0] * s, first[1] * s
    third = second[0] * s, second[1] * s
    below = tuple((-g * u, -g * v) for u, v in (first, second, third))
    by_coefficients = (first, second, (ab, along), (across, ab), third, *below)
    turned = 2.0 * (p1 * b + p2 * a)
    xx = (g + aa * g_s + turned + (4.0 * p2) * a) * w
    yy = (g + bb * g_s + turned + (4.0 * p1) * b) * w
    xy = (0.5 * ab * g_s + 2.0 * (p1 * a + p2 * b)) * w
    return Distorted(at, by_coefficients, ((xx, xy), (xy, yy), (-(xx * a + xy * b), -(xy * a + yy * b))))


def _fisheye(coefficients: Array, x: Array, y: Array, z: Array) -> Distorted:
    k1, k2, k3, k4 = coefficients.tolist()
    # On the optical axis h/rho is 1/z, and its derivative by rho is 0: the tiny number keeps that without a branch.
    rho = np.sqrt(x * x + y * y) + 1e-12 * np.abs(z)
    phi = np.arctan2(rho, z)
    q = phi * phi
    over = 1.0 / rho
    ratio = phi * over * (1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4))))
    whole = (1.0 + q * (3.0 * k1 + q * (5.0 * k2 + q * (7.0 * k3 + q * (9.0 * k4))))) / (rho * rho + z * z)
    slope = (whole * z - ratio) * over * over  # of the ratio by rho, over rho
    columns = []
    power = phi * over
    for _ in range(4):
        power = power * q
        columns.append((power * x, power * y))
    xy = slope * x * y
    by_point = (slope * x * x + ratio, xy), (xy, slope * y * y + ratio), (-whole * x, -whole * y)
    return Distorted((ratio * x, ratio * y), tuple(columns), by_point)


MODELS = {
    model.name: model
    for model in (
        CameraModel("pinhole", (), _pinhole),
        CameraModel("brown", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), _brown),
        CameraModel("fisheye", ("k1", "k2", "k3", "k4"), _fisheye),
    )
}
