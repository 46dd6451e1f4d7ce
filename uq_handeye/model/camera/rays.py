"""Directions in the camera frame that belong to pixels, and their uncertainty from the intrinsics.

Model: the pixel z of a direction d, ``|d| = 1``, is ``project(k, d)`` (`models`). Its inverse has no closed form.
Newton steps on the sphere give it,  ``d <- (d + J^+ (z - project(k, d))) / |...|`` with ``J = d project / d d`` (2, 3),
which vanishes along d, so that the pseudo-inverse steps along the sphere. They hold beyond 90 degrees from the axis
too.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array
from .models import CameraModel

# A direction is one of a pixel where its projection is nearer than this; the steps end a thousand times nearer.
MAX_RAY_ERROR_PX = 1e-3


def rays(model: CameraModel, parameters: Array, pixels: Array, max_steps: int = 30) -> Array:
    """Unit vectors (..., 3) in the camera frame; nan where no direction is seen at that pixel."""
    away = (pixels - parameters[2:4]) / parameters[:2]
    radius = np.linalg.norm(away, axis=-1)
    angle = np.minimum(radius, 2.5) if model.wide else np.arctan(radius)
    across = away * (np.sin(angle) / np.maximum(radius, 1e-12))[..., None]
    d = np.concatenate([across, np.cos(angle)[..., None]], axis=-1)
    for _ in range(max_steps):
        seen = model.project(parameters, d)
        off = pixels - seen.pixels
        if np.abs(off).max(initial=0.0) <= 1e-3 * MAX_RAY_ERROR_PX:
            break
        J = seen.by_point
        # J^+ = J^T (J J^T)^-1, a little damped where the model folds
        square = J @ J.mT
        square = square + 1e-12 * np.trace(square, axis1=-2, axis2=-1)[..., None, None] * np.eye(2)
        step = (J.mT @ np.linalg.solve(square, off[..., None]))[..., 0]
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        d = d + step * np.minimum(1.0, 0.2 / np.maximum(length, 1e-12))
        if not model.wide:  # these see nothing behind the camera
            d[..., 2] = np.maximum(d[..., 2], 1e-3)
        d /= np.linalg.norm(d, axis=-1, keepdims=True)
    off = pixels - model.project(parameters, d).pixels
    seen_there = np.asarray(np.abs(off).max(axis=-1, keepdims=True) < MAX_RAY_ERROR_PX)
    return np.where(seen_there, d, np.nan)


def pixel_deviation(model: CameraModel, parameters: Array, covariance: Array, pixels: Array) -> Array:
    """Standard deviation (...) in pixels, in the worst direction, of where a point is seen that is known in the camera
    frame and predicted at ``pixels`` (..., 2), by the covariance (k, k) of the intrinsics only; nan as in `rays`."""
    d = rays(model, parameters, pixels)
    known = np.isfinite(d[..., 2])
    J = model.project(parameters, np.where(known[..., None], d, [0.0, 0.0, 1.0])).by_parameters
    largest = np.linalg.eigvalsh(J @ covariance @ J.mT)[..., -1]
    return np.where(known, np.sqrt(np.maximum(largest, 0.0)), np.nan)
