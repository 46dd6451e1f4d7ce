"""Error of an estimate, and whether its covariance is consistent with it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from uq_handeye.core.geometry.se3 import Array

CERTAIN = 0.999  # of the intervals that findings quote


def errors(X: Array, truth: Array) -> Array:
    """``xi = (theta, tau)`` (..., 6) with ``R = exp([theta]x) R_true``, ``t = t_true + tau``: rad and m."""
    turn = X[..., :3, :3] @ truth[..., :3, :3].mT
    theta = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(*turn.shape[:-2], 3)
    return np.concatenate([theta, X[..., :3, 3] - truth[..., :3, 3]], axis=-1)


def nees(e: Array, S: Array) -> Array:
    """``e^T S^-1 e`` of errors (T, k) with one covariance (k, k) or one each (T, k, k)."""
    k = e.shape[-1]
    return np.asarray((e[:, None, :] @ np.linalg.solve(np.broadcast_to(S, (len(e), k, k)), e[..., None]))[:, 0, 0])


def true_means(trials: int, freedom: int = 6) -> tuple[float, float]:
    """The interval that holds 99.9 % of the means over independent trials of a NEES whose covariance is consistent."""
    low, high = (float(chi2.ppf(share, freedom * trials)) / trials for share in ((1 - CERTAIN) / 2, (1 + CERTAIN) / 2))
    return low, high
