r"""X, W and their covariances by a published method: what `calibrate` needs of METHODS and ROBOT_WORLD_METHODS.

Robot-world calibration: the pose W that every ``G_i X C_i`` measures, with its covariance.

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
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array, block, inverse_jacobian, skew
from ...errors import InputError
from ...findings import Finding
from ...model.noise.models import Noise, PairNoise, PoseNoise
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ..estimators import solve
from ..estimators.common.method import require_converged
from ..estimators.registry import METHODS, ROBOT_WORLD_METHODS, find
from .all_pairs import AllPairs
from .noise_transport import covariance_of_poses, noise_of_pairs
from .propagate import find_curved, pose_sensitivities, propagate_and_check

_EYE = np.eye(3)


def mean_target(poses: PosePairs, X: Array) -> Array:
    """W (..., 4, 4), the mean of ``G_i X C_i``."""
    measured = poses.effective_robot @ X[..., None, :, :] @ poses.camera
    W = np.zeros((*measured.shape[:-3], 4, 4))
    W[..., :3, :3] = orthonormalise(measured[..., :3, :3].sum(axis=-3))
    W[..., :3, 3] = measured[..., :3, 3].mean(axis=-2)
    W[..., 3, 3] = 1.0
    return W


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


class Covariances(NamedTuple):
    """First-order covariances, and what speaks against them."""

    of_X: Array  # (6, 6)
    of_W: Array | None  # (6, 6)
    findings: list[Finding]


@dataclass(frozen=True, eq=False)
class Published:
    """X (4, 4) of a published method on the motions, and W where there are poses."""

    motions: Motions
    method: str
    scale: float | None
    X: Array
    W: Array | None
    iterations: int
    everything: AllPairs | None  # 4DPA of all pairs, without forming them

    def covariances(self, noise: Noise, kind: str | None = None) -> Covariances:
        """The covariances of X and, for noise on poses, of W (6, 6), to first order; ``kind`` as in `propagate`."""
        motions, method, poses = self.motions, self.method, self.motions.poses
        if method in ROBOT_WORLD_METHODS and not (isinstance(noise, PoseNoise) and kind in (None, "poses")):
            raise InputError(f"Method {method!r} works on poses: its covariance needs PoseNoise and kind 'poses'.")
        if poses is None or not isinstance(noise, PoseNoise) or kind not in (None, "poses"):
            S, findings = propagate_and_check(
                motions, noise=noise, X=self.X, method=method, scale=self.scale, kind=kind
            )
            return Covariances(S, None, findings)
        findings = []
        by_error: Sequence[Array | None]
        by_error_W: Sequence[Array | None]
        if method in ROBOT_WORLD_METHODS:
            by_error, by_error_W = ROBOT_WORLD_METHODS[method].sensitivities(poses)
        else:
            if self.everything:
                by_error = self.everything.sensitivities(self.X)
            else:
                by_error = pose_sensitivities(motions, noise, self.X, method, self.scale)
            by_error_W = target_sensitivities(poses, self.X, by_error)
        covariance, covariance_W = (covariance_of_poses(D, noise) for D in (by_error, by_error_W))
        if method in METHODS and not METHODS[method].smooth:
            # what is uncorrelated with the errors of the poses reaches W through X alone
            whole, findings = propagate_and_check(motions, noise, X=self.X, method=method)
            rest = whole - covariance
            J = target_by_X(poses, self.X)
            added = J @ rest @ J.T
            covariance, covariance_W = covariance + rest, covariance_W + 0.5 * (added + added.T)
        elif method in METHODS:
            findings = find_curved(METHODS[method], motions.A[None], motions.B[None], self.X[None], covariance[None])
        return Covariances(covariance, covariance_W, findings)


def fit_published(
    motions: Motions, noise: Noise | None, method: str, scale: float | None, everything: AllPairs | None
) -> Published:
    """X and W; ``noise`` weights the methods that take weights. Raises as `calibrate` does."""
    poses = motions.poses
    if method in ROBOT_WORLD_METHODS:
        if poses is None:
            raise InputError(f"Method {method!r} solves G X C = W: it needs poses, got motions without poses.")
        both = ROBOT_WORLD_METHODS[method](poses)
        return Published(motions, method, None, *both, 0, None)
    iterations = 0
    if everything:
        X = everything.solve()
    elif method == "4dpa":
        X = solve(motions.A, motions.B, scale=scale)
    else:
        found = find(method)
        weights = None
        if found.weighted and noise is not None:
            weights = noise if isinstance(noise, PairNoise) else noise_of_pairs(motions, noise)
        estimate = require_converged(found, found.estimate(motions.A, motions.B, weights))
        X, iterations = np.asarray(estimate.X), int(estimate.iterations)
    W = None if poses is None else mean_target(poses, X)
    return Published(motions, method, scale, X, W, iterations, everything)
