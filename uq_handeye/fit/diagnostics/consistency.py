"""Agreement of robot and camera poses under some reading: X is fitted to pairs of poses, and W must be constant."""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array, inverse
from ...errors import DegenerateMotionError
from ...methods.limit import solve_limit
from ...model.poses.residuals import pose_residuals

# Rotation residual beyond which another reading of the files is tried.
LARGE_ROTATION_RAD = np.radians(2.0)
# A reading fits if its translation residuals are below this share of the travel of the robot.
MAX_MISFIT_SHARE = 0.2


def consistency(G: Array, C: Array, max_pairs: int = 2000) -> tuple[float, float, float] | None:
    """Return RMS rotation and translation of W about its mean, and |t_X|, by X of about ``max_pairs`` motions."""
    n = len(G)
    lag = np.unique(np.linspace(1, n - 1, max(1, max_pairs // n)).astype(int))
    i = np.concatenate([np.arange(n - k) for k in lag])
    j = np.concatenate([np.arange(k, n) for k in lag])
    A, B = inverse(G)[j] @ G[i], C[j] @ inverse(C)[i]
    try:
        X = solve_limit(A, B)
    except DegenerateMotionError:
        return None
    angle, distance = pose_residuals(G, C, X)
    return float(np.sqrt(np.mean(angle**2))), float(np.sqrt(np.mean(distance**2))), float(np.linalg.norm(X[:3, 3]))
