"""Consistency of two lists of poses with one X, computed quickly: to compare readings of the same files."""

from __future__ import annotations

import numpy as np

from ..errors import DegenerateMotionError
from ..geometry.se3 import Array, inverse
from ..procrustes.limit import solve_limit
from .residuals import pose_residuals

# Rotation residual (rad) beyond which another reading of the files is looked for.
LARGE_ROTATION = np.radians(2.0)
# The direction in which a camera sees its target varies by less than this share of what any other list of poses shows.
STEADY_VIEW = 0.5
# Pairs of poses that are looked at.
SEARCH_PAIRS = 2000


def consistency(G: Array, C: Array) -> tuple[float, float, float] | None:
    """Return RMS rotation and translation of W about its mean, and |t_X|, of X fitted to some of the pairs."""
    n = len(G)
    lag = np.unique(np.linspace(1, n - 1, max(1, SEARCH_PAIRS // n)).astype(int))
    i = np.concatenate([np.arange(n - k) for k in lag])
    j = np.concatenate([np.arange(k, n) for k in lag])
    A, B = inverse(G)[j] @ G[i], C[j] @ inverse(C)[i]
    try:
        X = solve_limit(A, B)
    except DegenerateMotionError:
        return None
    angle, distance = pose_residuals(G, C, X)
    return float(np.sqrt(np.mean(angle**2))), float(np.sqrt(np.mean(distance**2))), float(np.linalg.norm(X[:3, 3]))


def direction_spread(T: Array) -> float:
    """RMS angle (rad) of the directions of the translations of poses (n, 4, 4) about their mean direction."""
    t = T[:, :3, 3]
    directions = t / np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-12)
    mean = np.mean(directions, axis=0)
    across = np.linalg.norm(np.cross(directions, mean), axis=1)
    return float(np.sqrt(np.mean(np.arctan2(across, directions @ mean) ** 2)))
