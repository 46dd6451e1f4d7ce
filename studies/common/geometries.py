"""Geometries that several studies share."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from uq_handeye.core.geometry.se3 import Array


def random_transforms(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Axes uniform on the sphere, angles uniform in 0.4 to 2.6 rad, translations normal with 0.5 m per axis."""
    axis = rng.normal(size=(*shape, 3))
    axis *= rng.uniform(0.4, 2.6, (*shape, 1)) / np.linalg.norm(axis, axis=-1, keepdims=True)
    T = np.zeros((*shape, 4, 4))
    T[..., :3, :3] = Rotation.from_rotvec(axis.reshape(-1, 3)).as_matrix().reshape(*shape, 3, 3)
    T[..., :3, 3] = 0.5 * rng.normal(size=(*shape, 3))
    T[..., 3, 3] = 1.0
    return T
