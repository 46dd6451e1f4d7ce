r"""Functions of several poses of a rig: relative poses, with what they are known to and what stays open of them.

``T_ij = T_i^-1 T_j`` of two poses on one carrier has the error, in the frame of i,

    xi = -R_i^T (theta_i, tau_i - [t_j - t_i]x theta_i) + R_i^T (theta_j, tau_j)                        (T18)

so that its covariance needs the block between i and j of the joint covariance.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import svd

from ..core.geometry.se3 import Array, block, inverse, skew

# Part of a direction, in units of the rig, that counts as none.
NEGLIGIBLE = 1e-6


def relative_pose(T_i: Array, T_j: Array) -> tuple[Array, Array, Array]:
    """Return ``T_i^-1 T_j`` and its derivatives (6, 6) by the errors of both."""
    R = T_i[:3, :3].T
    by_i = -block(R, 0.0, -R @ skew(T_j[:3, 3] - T_i[:3, 3]), R)
    return inverse(T_i) @ T_j, by_i, block(R, 0.0, 0.0, R)


def open_of(by: Array, U: Array, lever: float) -> Array:
    """(j, 6) directions of a function, whose derivatives are ``by`` (6, p), that the open ones U (k, p) move.

    In rad and m, orthonormal in units of the rig.
    """
    if not len(U):
        return np.zeros((0, 6))
    units = np.repeat([lever, 1.0], 3)
    moved = (U @ by.T) * units
    _, s, V = svd(moved, full_matrices=False)
    return np.asarray(V[s > NEGLIGIBLE] / units)


def closed(covariance: Array, opened: Array, lever: float) -> Array:
    """(6, 6) covariance on the directions that are not open: 0 along the others."""
    if not len(opened):
        return covariance
    units = np.repeat([lever, 1.0], 3)
    U = opened * units
    P = (np.eye(6) - U.T @ U) / units[:, None] * units
    return np.asarray(P @ covariance @ P.T)
