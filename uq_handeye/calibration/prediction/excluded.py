"""Residuals of poses that a fit did not use, against that fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.geometry.se3 import Array, difference
from ...fit.likelihood.constraint import OnPoses, Unknowns
from ...model.poses.pose_pairs import PosePairs
from ..estimate.estimated import Estimated
from .predict import own_noise, predict_camera

# Of data without noise (rad, m).
ROUNDING = 1e-10


class Residual(NamedTuple):
    """Residuals of m poses."""

    rotation: Array  # (m,) rad
    translation: Array  # (m,) m
    distance2: Array  # (m,) squared Mahalanobis distance from the prediction of the fit


def residuals_against(result: Estimated, poses: PosePairs) -> Residual:
    """Return the residuals of ``G X C = W`` of poses that the result was not fitted to, and their distances.

    The distance is that of the camera pose from its prediction (`predict_camera`), with the noise of one measurement:
    the mean of the noise of the poses that were used. Where the motions leave a part of X open, the errors of X and W
    count as independent, without those along what is open.
    """
    assert result.W is not None
    constraint = OnPoses(poses.robot, poses.camera, poses.setup == "eye-to-hand")
    linear = constraint.linearise(Unknowns(result.X, result.W), poses.robot, poses.camera)
    length = np.linalg.norm(linear.r.reshape(-1, 2, 3), axis=-1)
    if result.posterior is not None and result.opened is None:
        joints = None if result.kinematics is None else poses.joints
        ahead = predict_camera(result, joints, poses.robot)
        e, S = difference(poses.camera, ahead.poses), ahead.covariance
    else:
        e, S = linear.r, np.zeros((len(poses), 6, 6))
        by_robot, by_camera = linear.sides
        of_X, of_W = linear.J[..., :6], linear.J[..., 6:]
        parts = ((by_robot, own_noise(result, "robot")), (by_camera, own_noise(result, "camera")))
        for D, covariance in (*parts, (of_X, result.covariance), (of_W, result.covariance_W)):
            if covariance is not None:
                S = S + D @ covariance @ D.mT
    S = S + ROUNDING**2 * np.eye(6)
    return Residual(length[:, 0], length[:, 1], np.sum(e * np.linalg.solve(S, e[..., None])[..., 0], axis=-1))
