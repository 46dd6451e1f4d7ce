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

Models of other files, which are not searched for but taken as given or named:

- ``brown_full``: ``brown`` with the thin prism ``x_d += s1 s + s2 s^2``, ``y_d += s3 s + s4 s^2`` and the tilted sensor
  of OpenCV, in its order of 14 coefficients.
- ``inverse_brown`` (RealSense, ifm): the first five coefficients of ``brown`` lead from (x_d, y_d) to (a, b).
- ``fisheye624`` (Project Aria; COLMAP's RAD_TAN_THIN_PRISM_FISHEYE): ``(x_r, y_r) = (h / rho) (x, y)`` with six
  coefficients ``h = phi (1 + k0 phi^2 + ... + k5 phi^12)``, then with ``p = (p0, p1)``, ``s = x_r^2 + y_r^2``:
  ``(x_d, y_d) = (x_r, y_r) (1 + 2 p . (x_r, y_r)) + s p + (s0 s + s1 s^2, s2 s + s3 s^2)``.

Source: documentation of OpenCV's calib3d and fisheye modules; D. Brown, Photogrammetric Engineering 37 (1971);
J. Kannala, S. Brandt, IEEE Trans. PAMI 28 (2006), doi:10.1109/TPAMI.2006.153; ``rs2_deproject_pixel_to_point`` of
librealsense; ``FisheyeRadTanThinPrism.h`` of projectaria_tools.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array

LINEAR = ("fx", "fy", "cx", "cy")
# What pixels counted from the corner of the first pixel are larger by.
CORNER_PX = 0.5
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


class CameraModel(NamedTuple):
    """A family of cameras; parameters are ``LINEAR`` and then ``coefficients``."""

    name: str
    coefficients: tuple[str, ...]
    distort: Distortion
    wide: bool = False  # whether it describes rays beyond 90 degrees from the axis

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
    return _by_angle(coefficients, x, y, z)


def _by_angle(coefficients: Array, x: Array, y: Array, z: Array) -> Distorted:
    """Distort by a polynomial in the angle from the axis, with any number of coefficients."""
    # On the optical axis h/rho is 1/z, and its derivative by rho is 0: the tiny number keeps that without a branch.
    rho = np.sqrt(x * x + y * y) + 1e-12 * np.abs(z)
    phi = np.arctan2(rho, z)
    q = phi * phi
    over = 1.0 / rho
    series, derivative = np.zeros_like(q), np.zeros_like(q)
    for degree, k in reversed(list(enumerate(coefficients.tolist(), 1))):
        series, derivative = q * (k + series), q * ((2 * degree + 1) * k + derivative)
    ratio = phi * over * (1.0 + series)
    whole = (1.0 + derivative) / (rho * rho + z * z)
    slope = (whole * z - ratio) * over * over  # of the ratio by rho, over rho
    columns = []
    power = phi * over
    for _ in range(len(coefficients)):
        power = power * q
        columns.append((power * x, power * y))
    xy = slope * x * y
    by_point = (slope * x * x + ratio, xy), (xy, slope * y * y + ratio), (-whole * x, -whole * y)
    return Distorted((ratio * x, ratio * y), tuple(columns), by_point)


def _brown_full(coefficients: Array, x: Array, y: Array, z: Array) -> Distorted:
    at, by_coefficients, by_brown = _brown(coefficients[:8], x, y, z)
    s1, s2, s3, s4 = coefficients[8:12].tolist()
    a, b = x / z, y / z
    s = a * a + b * b
    of_s = s1 + 2.0 * s2 * s, s3 + 2.0 * s4 * s
    at = at[0] + s * (s1 + s2 * s), at[1] + s * (s3 + s4 * s)
    by_s = 2.0 * a / z, 2.0 * b / z, -2.0 * s / z
    by_point = [(part[0] + of_s[0] * by, part[1] + of_s[1] * by) for part, by in zip(by_brown, by_s, strict=True)]
    none = np.zeros_like(s)
    columns = (*by_coefficients, (s, none), (s * s, none), (none, s), (none, s * s))
    # The tilted sensor: a homography of the plane.
    H, by_tilts = _tilt(*coefficients[12:14].tolist())
    w = 1.0 / (H[2, 0] * at[0] + H[2, 1] * at[1] + H[2, 2])
    seen = tuple((H[k, 0] * at[0] + H[k, 1] * at[1] + H[k, 2]) * w for k in (0, 1))
    J = [[(H[k, j] - seen[k] * H[2, j]) * w for j in (0, 1)] for k in (0, 1)]

    def through(part: Pair) -> Pair:
        return J[0][0] * part[0] + J[0][1] * part[1], J[1][0] * part[0] + J[1][1] * part[1]

    def tilted(D: Array) -> Pair:
        top = [D[k, 0] * at[0] + D[k, 1] * at[1] + D[k, 2] for k in range(3)]
        return (top[0] - seen[0] * top[2]) * w, (top[1] - seen[1] * top[2]) * w

    x_by, y_by, z_by = map(through, by_point)
    return Distorted((seen[0], seen[1]), (*map(through, columns), *map(tilted, by_tilts)), (x_by, y_by, z_by))


def _tilt(tx: float, ty: float) -> tuple[Array, tuple[Array, Array]]:
    """Homography (3, 3) of a sensor that is tilted by two angles, as OpenCV's, and its derivatives by both."""
    (cx, sx), (cy, sy) = ((np.cos(angle), np.sin(angle)) for angle in (tx, ty))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]])
    about_y = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
    by_x = np.array([[0.0, 0.0, 0.0], [0.0, -sx, cx], [0.0, -cx, -sx]])
    by_y = np.array([[-sy, 0.0, -cy], [0.0, 0.0, 0.0], [cy, 0.0, -sy]])

    def projector(R: Array, ones: float) -> Array:
        return np.array([[R[2, 2], 0.0, -R[0, 2]], [0.0, R[2, 2], -R[1, 2]], [0.0, 0.0, ones]])

    R = about_y @ about_x
    moves = about_y @ by_x, by_y @ about_x
    M = projector(R, 1.0)
    return M @ R, (projector(moves[0], 0.0) @ R + M @ moves[0], projector(moves[1], 0.0) @ R + M @ moves[1])


def _inverse_brown(coefficients: Array, x: Array, y: Array, z: Array, max_steps: int = 50) -> Distorted:
    """Solve ``brown(x_d, y_d) = (a, b)`` by Newton steps; the derivatives are those of the implicit function."""
    whole = np.append(coefficients, np.zeros(3))
    w = 1.0 / z
    a, b = x * w, y * w
    u, v, one = a.copy(), b.copy(), np.ones_like(a)
    for _ in range(max_steps):
        found = _brown(whole, u, v, one)
        (xx, xy), (_, yy) = found.by_point[:2]
        off_a, off_b = found.at[0] - a, found.at[1] - b
        over = 1.0 / (xx * yy - xy * xy)
        step_u, step_v = (yy * off_a - xy * off_b) * over, (xx * off_b - xy * off_a) * over
        size = np.maximum(np.hypot(step_u, step_v) / 0.2, 1.0)  # steps are 0.2 at most: the polynomial may fold
        u, v = u - step_u / size, v - step_v / size
        if max(np.abs(step_u).max(initial=0.0), np.abs(step_v).max(initial=0.0)) < 1e-13:
            break
    found = _brown(whole, u, v, one)
    (xx, xy), (_, yy) = found.by_point[:2]
    over = 1.0 / (xx * yy - xy * xy)
    ia, ib, ic = yy * over, -xy * over, xx * over  # the inverse, symmetric as the derivative of brown is
    columns = tuple((-(ia * p + ib * q), -(ib * p + ic * q)) for p, q in found.by_coefficients[:5])
    by_point = (ia * w, ib * w), (ib * w, ic * w), (-(ia * a + ib * b) * w, -(ib * a + ic * b) * w)
    return Distorted((u, v), columns, by_point)


def _fisheye624(coefficients: Array, x: Array, y: Array, z: Array) -> Distorted:
    (u, v), radial, by_point = _by_angle(coefficients[:6], x, y, z)
    p0, p1, s0, s1, s2, s3 = coefficients[6:].tolist()
    s, dot = u * u + v * v, p0 * u + p1 * v
    at = u * (1.0 + 2.0 * dot) + s * (p0 + s0 + s1 * s), v * (1.0 + 2.0 * dot) + s * (p1 + s2 + s3 * s)
    of_u, of_v = 2.0 * (p0 + s0 + 2.0 * s1 * s), 2.0 * (p1 + s2 + 2.0 * s3 * s)  # by s, times two
    J = (
        (1.0 + 2.0 * dot + 2.0 * p0 * u + of_u * u, 2.0 * p1 * u + of_u * v),
        (2.0 * p0 * v + of_v * u, 1.0 + 2.0 * dot + 2.0 * p1 * v + of_v * v),
    )

    def through(part: Pair) -> Pair:
        return J[0][0] * part[0] + J[0][1] * part[1], J[1][0] * part[0] + J[1][1] * part[1]

    none = np.zeros_like(s)
    tangential = (2.0 * u * u + s, 2.0 * u * v), (2.0 * u * v, 2.0 * v * v + s)
    prism = (s, none), (s * s, none), (none, s), (none, s * s)
    x_by, y_by, z_by = map(through, by_point)
    return Distorted(at, (*map(through, radial), *tangential, *prism), (x_by, y_by, z_by))


MODELS = {
    model.name: model
    for model in (
        CameraModel("pinhole", (), _pinhole),
        CameraModel("brown", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), _brown),
        CameraModel("fisheye", ("k1", "k2", "k3", "k4"), _fisheye, wide=True),
        CameraModel(
            "brown_full",
            ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
            _brown_full,
        ),
        CameraModel("inverse_brown", ("k1", "k2", "p1", "p2", "k3"), _inverse_brown),
        CameraModel(
            "fisheye624",
            ("k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"),
            _fisheye624,
            wide=True,
        ),
    )
}
