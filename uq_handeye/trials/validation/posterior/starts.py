"""Starts of the search for maxima of a posterior: the estimate, and the estimates from parts of the data.

A Gaussian likelihood has one maximum near the estimate of `ml`. With heavy tails, data that contradict each other give
several, each near the estimate from a part of the data that agrees.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from scipy.linalg import solve_triangular

from ....core.geometry.se3 import Array, difference
from ....core.limits import MIN_POSES
from ....errors import InputError, NotConvergedError
from ....fit.graph.gauss_helmert import Fit, efficient
from ....fit.graph.robust import robust_fit
from ....model.errors.models import Noise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from .density import Density


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
        if len(part) >= MIN_POSES:
            with suppress(InputError, NotConvergedError):
                starts.append(_coordinates(efficient(data.rows(part), noise.rows(part)), density))
    at = np.stack(starts)
    return np.asarray(at[np.isfinite(density(at))])


def _coordinates(fit: Fit, density: Density) -> Array:
    """The error of another fit's X and W from the estimate, whitened; scales at 1."""
    both = zip(fit.unknowns, density.fit.unknowns, strict=True)
    errors = [difference(T, origin) for T, origin in both if T is not None and origin is not None]
    size = density.d - len(density.scales.sides)
    y = np.zeros(density.d)
    y[:size] = solve_triangular(density.factor[:size, :size], np.concatenate(errors)[:size], lower=True)
    return y
