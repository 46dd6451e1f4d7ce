r"""Camera poses from corners, linearised at intrinsics and poses that are better known than from the pictures alone.

Model: picture i sees the corners of the board at ``z_ij = project(k, C_i P_j) + e`` (`bundle`). The pictures alone give
intrinsics k_0 with their covariance Sigma_k, and poses C_i at k_0 whose errors follow those of k by G_i. That is the
minimum of the pictures and its derivatives there. Robot poses move both, to k and C_i of an estimate of X, and where
that step is large the derivatives are those of other poses. With the residuals r_i and their derivatives A_i by k and
B_i by the error of C_i, all over the pixel noise, at that estimate,

    S_i = (B_i^T B_i)^-1,   d_i = -S_i B_i^T r_i,   G_i = -S_i B_i^T A_i
    measured pose at k_0:   C_i moved by  m_i = d_i + G_i (k_0 - k)

of the own covariance S_i. An error of the pose as moved is another one of the pose where the corners are linearised:
S_i and G_i are turned by ``J_l(-m_i)^-1``. X by these poses is one step of Gauss-Newton of the least squares over
intrinsics, X, W and all poses, but for the information of the pictures about k, which stays that of their own minimum.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array, left_jacobian, perturb
from ..corners import Corners
from .bundle import Bundle, Sight


def linearised(bundle: Bundle, corners: Corners, parameters: Array, poses: Array) -> Bundle:
    """Return a bundle with poses and derivatives that are linearised elsewhere; see the module.

    ``parameters`` (p,) and ``poses`` (n, 4, 4), camera_T_target, are where the corners are linearised. The parameters
    of the bundle and their covariance stay those of the pictures alone.
    """
    counts = bundle.used / bundle.picture_noise[corners.picture]
    sight = Sight.of(bundle.model, bundle.shape, corners, counts)
    r, A, B = sight.rows(parameters, poses, bundle.free)
    own = np.linalg.inv(B.mT @ B)
    d, G = -(own @ (B.mT @ r[..., None]))[..., 0], -(own @ (B.mT @ A))
    moved = d + G @ (bundle.parameters - parameters)[bundle.free]
    turn = np.tile(np.eye(6), (len(d), 1, 1))
    turn[:, :3, :3] = np.linalg.inv(left_jacobian(-moved[:, :3]))
    own = turn @ own @ turn.mT
    by_parameters = np.zeros_like(bundle.by_parameters)
    by_parameters[..., bundle.free] = turn @ G
    poses = perturb(poses, moved)
    return replace(
        bundle,
        poses=poses,
        residuals=(corners.pixels - sight.predicted(bundle.parameters, poses)[corners.picture, corners.place]),
        own=0.5 * (own + own.mT),
        by_parameters=by_parameters,
    )


def with_pictures(bundle: Bundle, corners: Corners, rows: NDArray[np.intp], part: Bundle) -> Bundle:
    """Return a bundle whose pictures ``rows`` have the poses and derivatives of a ``part`` of it, with its corners."""
    poses, own, by_parameters = bundle.poses.copy(), bundle.own.copy(), bundle.by_parameters.copy()
    poses[rows], own[rows], by_parameters[rows] = part.poses, part.own, part.by_parameters
    residuals = bundle.residuals.copy()
    residuals[np.isin(corners.picture, rows)] = part.residuals
    return replace(bundle, poses=poses, residuals=residuals, own=own, by_parameters=by_parameters)
