"""Starts of the search for maxima of a posterior: at the estimate, and at the estimates from parts of the data.

A Gaussian likelihood has one maximum near the estimate of `ml`. With heavy tails data that contradict each other leave
several, each near what those data say that agree.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from scipy.linalg import solve_triangular

from ...errors import InputError, NotConvergedError
from ...geometry.se3 import Array, logarithm
from ...likelihood.gauss_helmert import Fit, efficient
from ...likelihood.robust import robust_fit
from ...noise.models import Noise
from ...poses.motions import Motions
from ...poses.pose_pairs import PosePairs
from .density import Density

# Poses or motions that may determine X by themselves.
FEWEST = 3


def starts_of(data: PosePairs | Motions, noise: Noise, density: Density) -> Array:
    """Whitened coordinates (k, d): 0, the estimate of `ml`; for heavy tails those of halves and of what agrees too."""
    starts = [np.zeros(density.d)]
    if density.student_t is None:
        return np.stack(starts)
    row, half = np.arange(len(data)), len(data) // 2
    parts = [row[:half], row[half:], row[::2], row[1::2]]
    with suppress(InputError, NotConvergedError):
        robust = robust_fit(data, noise)
        starts.append(_coordinates(robust.fit, density))
        parts.append(np.flatnonzero(robust.weights == 0))  # may agree among themselves
    for part in parts:
        if len(part) >= FEWEST:
            with suppress(InputError, NotConvergedError):
                starts.append(_coordinates(efficient(data.rows(part), noise.rows(part)), density))
    at = np.stack(starts)
    return np.asarray(at[np.isfinite(density(at))])


def _coordinates(fit: Fit, density: Density) -> Array:
    """The error of another fit's X and W from the estimate, whitened; scales at 1."""
    errors = []
    for T, origin in zip(fit.unknowns, density.fit.unknowns, strict=True):
        if T is not None and origin is not None:
            errors += [logarithm(T[:3, :3] @ origin[:3, :3].T), T[:3, 3] - origin[:3, 3]]
    size = density.d - len(density.scales.sides)
    y = np.zeros(density.d)
    y[:size] = solve_triangular(density.factor[:size, :size], np.concatenate(errors)[:size], lower=True)
    return y
