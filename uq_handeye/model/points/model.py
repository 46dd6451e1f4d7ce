r"""Noise of a measured point: two variances, across the line of sight and along it.

Model: the error of point y in the frame of the camera is Gaussian with zero mean and

    V = g_1(r) phi_1 (I - u u^T) + g_2(r) phi_2 u u^T,     u = y / |y|,  r = |y| / r_0

phi_1 (m^2) across the line of sight, lateral; phi_2 along it, axial; r_0 the median distance. The growth g is 1, or
``g_1 = r^2, g_2 = r^4``: a camera with one error in pixels and one of disparity has a lateral standard deviation in
proportion to the distance and an axial one in proportion to its square. With one variance, phi_1 = phi_2, V is
isotropic, as that of a tracker with several cameras.

The argument `noise` of `poses_from_points`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.formatting.units import parse_length
from ...core.geometry.se3 import Array
from ...errors import InputError

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


ISOTROPIC = "isotropic"
EXPECTED = (
    "Expected `noise` (--noise) to be standard deviations lateral,axial such as 0.1mm,0.5mm, one such as 0.2mm for "
    "isotropic noise, or 'isotropic' to estimate one"
)


@dataclass(frozen=True)
class GivenNoise:
    """One variance for both directions or two, and the variances (2,) where they are given."""

    isotropic: bool
    phi: Array | None


def given_noise(noise: Any) -> GivenNoise:
    """Read the argument; raises `InputError`."""
    if noise is None or (isinstance(noise, str) and noise.strip() in ("", "auto")):
        return GivenNoise(False, None)
    if isinstance(noise, str) and noise.strip() == ISOTROPIC:
        return GivenNoise(True, None)
    if isinstance(noise, bool):
        raise InputError(f"{EXPECTED}, got {noise!r}.")
    parts = [part.strip() for part in noise.split(",")] if isinstance(noise, str) else list(np.atleast_1d(noise))
    if len(parts) not in (1, 2):
        raise InputError(f"{EXPECTED}, got {noise!r}.")
    try:
        sd = [parse_length(part) if isinstance(part, str) else float(part) for part in parts]
    except (TypeError, ValueError, InputError) as error:
        raise InputError(f"{EXPECTED}, got {noise!r}.") from error
    if not all(1e-9 <= one <= 1.0 for one in sd):
        raise InputError(f"{EXPECTED}, between 1 nm and 1 m, got {noise!r}.")
    return GivenNoise(len(sd) == 1, np.array([sd[0], sd[-1]]) ** 2)
