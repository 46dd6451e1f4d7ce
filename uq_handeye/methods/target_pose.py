"""The target pose W of a published X: the mean of its measurements by all poses, and its derivatives.

Model: ``G_i X C_i = W`` for poses without noise; ``W = base_T_target`` for eye-in-hand, with ``G = base_T_gripper``,
and ``W = gripper_T_target`` for eye-to-hand, with ``G = gripper_T_base``. W is the unweighted mean of its n
measurements: the rotation nearest to the sum of theirs, the mean of their translations. Errors are ``xi = (theta,
tau)``: left rotation, additive translation, in the parent frame of W. To first order (T5)

    xi_W = mean_i( J_X xi_X + J_G xi_G + J_C xi_C ),
    J_X = [[R_G, 0], [-R_G [R_X t_C]x, R_G]],   J_G = [[I, 0], [-[R_G (R_X t_C + t_X)]x, I]],   J_C = blkdiag(R_G R_X)

and ``xi_X = sum_k D_k xi_k`` depends on the same errors of the poses (T4), so that each pose carries both to W.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.geometry.nearest_rotation import orthonormalise
from ..core.geometry.se3 import Array, block, inverse_jacobian, pose, skew
from ..model.poses.pose_pairs import PosePairs

_EYE = np.eye(3)


def mean_target(poses: PosePairs, X: Array) -> Array:
    """W (..., 4, 4), the mean of ``G_i X C_i``."""
    measured = poses.effective_robot @ X[..., None, :, :] @ poses.camera
    return pose(orthonormalise(measured[..., :3, :3].sum(axis=-3)), measured[..., :3, 3].mean(axis=-2))


def loop_derivatives(R_G: Array, R_X: Array, arm: Array, lever: Array) -> tuple[Array, Array, Array]:
    """J_X, J_G and J_C (..., n, 6, 6): ``d xi / d (xi_X, xi_G, xi_C)`` of ``G X C``.

    R_G (..., n, 3, 3), R_X (..., 1, 3, 3) or (3, 3), ``arm = R_X t_C`` and ``lever = R_G (R_X t_C + t_X)`` (..., n, 3).
    """
    turned = R_G @ R_X
    return (
        block(R_G, 0.0, -R_G @ skew(arm), R_G),
        block(_EYE, 0.0, -skew(lever), _EYE),
        block(turned, 0.0, 0.0, turned),
    )


def _derivatives(poses: PosePairs, X: Array) -> tuple[Array, Array, Array]:
    """`loop_derivatives` of poses at X (4, 4), J_G by the robot pose as it is measured."""
    R_G = poses.effective_robot[:, :3, :3]
    arm = poses.camera[:, :3, 3] @ X[:3, :3].T
    J_X, J_G, J_C = loop_derivatives(R_G, X[:3, :3], arm, (R_G @ (arm + X[:3, 3])[..., None])[..., 0])
    return J_X, J_G @ inverse_jacobian(poses.robot) if poses.setup == "eye-to-hand" else J_G, J_C


def target_by_X(poses: PosePairs, X: Array) -> Array:
    """The mean of J_X (6, 6): ``d xi_W / d xi_X`` of `mean_target`."""
    return np.asarray(_derivatives(poses, X)[0].mean(axis=0))


def target_sensitivities(poses: PosePairs, X: Array, D: Sequence[Array | None]) -> list[Array | None]:
    """``d xi_W / d xi_k`` (n, 6, 6) of `mean_target`; ``D`` holds those of X, by robot and by camera poses."""
    J_X, *by_pose = _derivatives(poses, X)
    mean = J_X.mean(axis=0)
    return [None if by_X is None else mean @ by_X + J / poses.n for by_X, J in zip(D, by_pose, strict=True)]
