"""Statistics of the pictures: boards, coverage, residuals by picture, cell and ring, certainty of a pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from .calibrated import Calibrated
from .models import pixel_deviation
from .residual_pattern import LARGE

# Bins of the distance from the centre.
BINS = 12
# The mean of a cell is beyond chance where it is so many of its deviations long: once in 1,000.
BEYOND = float(np.sqrt(2 * np.log(1000)))
# Nodes of the map along the longer side of the picture.
NODES = 49


def covered(cam: Calibrated) -> float:
    """Share of the cells of the picture in which there are corners."""
    return float((cam.pattern.count > 0).mean())


def seen_points(cam: Calibrated) -> list[Array]:
    """The corners of each picture in the camera frame, (m_i, 3) each."""
    corners = cam.corners
    parts = np.split(corners.points, np.flatnonzero(corners.place == 0)[1:])
    return [points @ T[:3, :3].T + T[:3, 3] for points, T in zip(parts, cam.poses, strict=True)]


def distances(cam: Calibrated) -> Array:
    """(n,) depth of the middle of the corners of each picture along the optical axis."""
    return np.asarray(np.stack([points.mean(axis=0) for points in seen_points(cam)])[:, 2])


def tilts(cam: Calibrated) -> Array:
    """(n,) degrees between the optical axis and the normal of the points of each picture."""
    normals = [np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2] for points in seen_points(cam)]
    return np.asarray(np.degrees(np.arccos(np.clip(np.abs(np.array(normals)[:, 2]), 0.0, 1.0))))


def picture_rms(cam: Calibrated) -> Array:
    """(n,) root mean square of the residuals used, per coordinate, of every picture, in pixels."""
    used, picture = cam.bundle.used, cam.corners.picture
    squares = np.bincount(picture[used], np.sum(cam.bundle.residuals[used] ** 2, axis=1), cam.corners.n)
    return np.asarray(np.sqrt(squares / np.maximum(2 * np.bincount(picture[used], minlength=cam.corners.n), 1)))


def cells_that_matter(cam: Calibrated) -> NDArray[np.bool_]:
    """(CELLS, CELLS) where the mean residual is beyond chance and not small beside the pixel noise."""
    length = np.linalg.norm(cam.pattern.mean, axis=-1)
    s = cam.pixel_noise
    beyond = length > BEYOND * s / np.sqrt(np.maximum(cam.pattern.count, 1))
    return np.asarray(beyond & (length > LARGE * np.sqrt(2) * s) & (cam.pattern.count > 0))


def radial_means(cam: Calibrated) -> tuple[Array, Array, Array]:
    """Distance from the centre, mean outward residual (pixels) and number of corners of up to BINS rings."""
    used = cam.bundle.used
    away = cam.corners.pixels[used] - cam.bundle.parameters[2:4]
    radius = np.linalg.norm(away, axis=1)
    outward = np.sum(cam.bundle.residuals[used] * away, axis=1) / np.maximum(radius, 1e-9)
    ring = np.minimum((BINS * radius / (radius.max() or 1.0)).astype(int), BINS - 1)
    count = np.bincount(ring, minlength=BINS)
    some = count > 0
    at, mean = (np.bincount(ring, values, BINS)[some] / count[some] for values in (radius, outward))
    return at, mean, count[some].astype(float)


def certainty(cam: Calibrated) -> tuple[Array, Array, Array]:
    """Pixels u, v (rows, columns) of a grid over the picture, and the standard deviation there."""
    width, height = cam.image_size
    nodes = [max(round(NODES * length / max(width, height)), 9) for length in (width, height)]
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, nodes[0]), np.linspace(-0.5, height - 0.5, nodes[1]))
    bundle = cam.bundle
    deviation = pixel_deviation(
        bundle.model, bundle.intrinsics, bundle.intrinsics_covariance, np.stack([u, v], axis=-1)
    )
    return u, v, deviation
