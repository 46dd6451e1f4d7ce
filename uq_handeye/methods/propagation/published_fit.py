"""4DPA over all pairs of n poses in O(n): X and its pose-aware covariance without forming a single pair.

Model and conventions as in `procrustes` and `propagation`. With ``P = G`` (robot) or ``P = inv(C)`` (camera), both
motions of a pair are ``inv(P_j) P_i``, and the two vectors that the limit T2 needs of each,

    2 u = vee(R_j^T R_i),    2 w = R_j^T t_i - R_i^T t_j + s_i - s_j,    s = R^T t,

are antisymmetric bilinear forms ``y_i^T B_k y_j`` of ``y = (R, t, s, 1)`` in R^16. The sum over all pairs of products
of such forms therefore needs only one 16x16 moment matrix of the poses. With y of the robot and y' of the camera

    N = sum_i y_i y'_i^T,     m_kl = 4 sum_(i<j) (u, w)_k (v, z)_l = 1/2 tr( N^T C_kl ),    C_kl = B_k N B_l^T

and ``d m_kl = dy_i^T C_kl y'_i + dy'_i^T C_kl^T y_i``. What T2 and T3 ask of the moments is linear in them, so that the
derivatives of f and h by all poses take six 16x16 matrices.

X, W and their covariances by a published method: what `calibrate` needs of METHODS and ROBOT_WORLD_METHODS.

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
from typing import NamedTuple, cast

import numpy as np

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array, block, inverse_jacobian, pose, skew
from ...errors import InputError
from ...findings import Finding
from ...model.noise.models import Noise, PoseNoise, require_count
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ..estimators import solve
from ..estimators.method import require_converged
from ..estimators.registry import METHODS, ROBOT_WORLD_METHODS, find
from ..procrustes.limit import solve_moments
from ..procrustes.sensitivity import weight_of_sums
from .noise_transport import covariance_of_poses, noise_of_pairs, pose_twists
from .propagate import find_curved, pose_sensitivities, propagate_and_check


def _forms() -> Array:
    """B (6, 16, 16): 2 u and 2 w of a pair as bilinear forms of its poses, ``y = (R row by row, t, s, 1)``."""
    B = np.zeros((6, 16, 16))
    for k in range(3):
        a, b = (k + 2) % 3, (k + 1) % 3  # vee(M)_k = M_ab - M_ba, M = R_j^T R_i
        for c in range(3):
            B[k, 3 * c + b, 3 * c + a] = 1.0  # R_i[c, b] R_j[c, a]
            B[k, 3 * c + a, 3 * c + b] = -1.0
            B[3 + k, 9 + c, 3 * c + k] = 1.0  # t_i[c] R_j[c, k]
            B[3 + k, 3 * c + k, 9 + c] = -1.0
        B[3 + k, 12 + k, 15] = 1.0  # s_i[k] 1
        B[3 + k, 15, 12 + k] = -1.0
    return B


_B = _forms()
_BASIS = np.eye(36).reshape(36, 6, 6)
_TURNS = skew(np.eye(3))


class AllPairs:
    """All pairs ``i < j`` of n poses, by their moments."""

    def __init__(self, poses: PosePairs) -> None:
        frames, by_pose = pose_twists(poses, slice(0, 1))
        # Pairs do not see a common shift of all P; about their mean the translations cancel least.
        self.frames, self.by_pose = [], []
        for P, by_xi in zip((P[0] for P in frames), by_pose, strict=True):
            shift = P[:, :3, 3].mean(axis=0)
            P, by_xi = P.copy(), by_xi[0].copy()
            P[:, :3, 3] -= shift
            by_xi[..., 3:, :] -= skew(shift) @ by_xi[..., :3, :]  # rho about the new origin
            self.frames.append(P)
            self.by_pose.append(by_xi)
        self.y = [_coordinates(P) for P in self.frames]
        self.n_pairs = poses.n * (poses.n - 1) // 2
        N = self.y[0].T @ self.y[1]
        self.C = np.einsum("kpq,lrq->klpr", _B @ N, _B)
        self.moments = 0.5 * np.einsum("pr,klpr->kl", N, self.C)

    @property
    def precise(self) -> bool:
        """True if the moments keep 12 digits: they are differences of terms of order 1, and of order sin^2(angle)."""
        return bool(np.linalg.norm(self.moments[:3, :3]) > 1e-3 * self.n_pairs)

    def solve(self) -> Array:
        """X (4, 4) in the limit (T2)."""
        return solve_moments(self.moments, self.n_pairs)

    def sensitivities(self, X: Array) -> list[Array]:
        """``d xi_X / d xi_k`` (n, 6, 6) by the error of every pose k, robot and camera (T4)."""
        R, t = X[:3, :3], X[:3, 3]
        by_moments = _constraints(_BASIS, R, t).T.reshape(6, 6, 6)
        C = np.einsum("akl,klpr->apr", by_moments, self.C)
        by_y = (self.y[1] @ C.mT, self.y[0] @ C)  # (6, n, 16): derivatives of f, h by y_i and by y'_i
        G = self.moments[:3, :3] @ R.T
        h_theta = _constraints(self.moments, _TURNS @ R, t)[:, 3:].T
        Q = weight_of_sums(G[None], h_theta[None], self.n_pairs)[0]
        return [
            Q @ (D.swapaxes(0, 1) @ _coordinate_jacobian(P)) @ by_xi
            for D, P, by_xi in zip(by_y, self.frames, self.by_pose, strict=True)
        ]

    def propagate(self, noise: PoseNoise, X: Array) -> Array:
        """The pose-aware covariance (6, 6) of X (T4)."""
        n = len(self.y[0])
        require_count(noise.robot, n, "robot", "poses")
        require_count(noise.camera, n, "camera", "poses")
        return covariance_of_poses(self.sensitivities(X), noise)


def solve_all_pairs(poses: PosePairs) -> Array:
    """X (..., 4, 4) of all pairs in the limit (T2), over the leading axes of the poses."""
    n_pairs = poses.n * (poses.n - 1) // 2
    frames, _ = pose_twists(poses, slice(None))
    y = []
    for P in frames:
        centred = P.copy()
        centred[..., :3, 3] -= P[..., :3, 3].mean(axis=-2, keepdims=True)
        y.append(_coordinates(centred))
    N = y[0].mT @ y[1]
    by_left = (_B.transpose(0, 2, 1) @ N[..., None, :, :]).reshape(*N.shape[:-2], 6, 256)
    by_right = (N[..., None, :, :] @ _B.transpose(0, 2, 1)).reshape(*N.shape[:-2], 6, 256)
    moments = 0.5 * by_left @ by_right.mT
    return solve_moments(moments.reshape(*poses.robot.shape[:-3], 6, 6), n_pairs)


def _constraints(moments: Array, R: Array, t: Array) -> Array:
    """f and h (T2) from the moments ``sum (u, w)(v, z)^T`` (..., 6, 6), linear in them and in R: (..., 6)."""
    up = moments[..., :3, :3] @ R.mT  # sum u p^T, p = R v
    wp_uq = (moments[..., 3:, :3] + moments[..., :3, 3:]) @ R.mT
    trace = np.trace(up, axis1=-2, axis2=-1)[..., None]
    h = _axial(wp_uq) + t * trace - (up.mT @ t)  # u x (t x p) = t (u . p) - p (u . t)
    return np.concatenate([_axial(up), h], axis=-1)


def _axial(M: Array) -> Array:
    """``sum a x b`` from ``sum a b^T``."""
    return np.stack([M[..., 1, 2] - M[..., 2, 1], M[..., 2, 0] - M[..., 0, 2], M[..., 0, 1] - M[..., 1, 0]], axis=-1)


def _coordinates(P: Array) -> Array:
    """y (..., 16) of poses (..., 4, 4)."""
    R, t = P[..., :3, :3], P[..., :3, 3]
    s = (t[..., None, :] @ R)[..., 0, :]
    return np.concatenate([R.reshape(*t.shape[:-1], 9), t, s, np.ones((*t.shape[:-1], 1))], axis=-1)


def _coordinate_jacobian(P: Array) -> Array:
    """``dy / d zeta`` (n, 16, 6) for ``P -> exp(zeta) P``: dR = [theta]x R, dt = rho + theta x t, ds = R^T rho."""
    R, t = P[:, :3, :3], P[:, :3, 3]
    J = np.zeros((len(P), 16, 6))
    # theta x r for each column r of R, row c of R at 3 c .. 3 c + 2
    J[:, :9, :3] = -skew(R.mT).transpose(0, 2, 1, 3).reshape(-1, 9, 3)
    J[:, 9:12, :3] = -skew(t)
    J[:, 9:12, 3:] = np.eye(3)
    J[:, 12:15, 3:] = R.mT
    return J


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
        of_poses = noise.ITEM == "pose" and kind in (None, "poses")
        if method in ROBOT_WORLD_METHODS and not of_poses:
            raise InputError(f"Method {method!r} works on poses: its covariance needs PoseNoise and kind 'poses'.")
        if poses is None or not of_poses:
            S, findings = propagate_and_check(
                motions, noise=noise, X=self.X, method=method, scale=self.scale, kind=kind
            )
            return Covariances(S, None, findings)
        noise, findings = cast(PoseNoise, noise), []
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
            weights = noise_of_pairs(motions, noise)
        estimate = require_converged(found, found.estimate(motions.A, motions.B, weights))
        X, iterations = np.asarray(estimate.X), int(estimate.iterations)
    W = None if poses is None else mean_target(poses, X)
    return Published(motions, method, scale, X, W, iterations, everything)
