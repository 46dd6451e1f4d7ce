"""4DPA over all pairs of n poses in O(n): X and its pose-aware covariance without forming a single pair.

Model and conventions as in `limit` and `propagate`. With ``P = G`` (robot) or ``P = inv(C)`` (camera), both
motions of a pair are ``inv(P_j) P_i``, and the two vectors that the limit T2 needs of each,

    2 u = vee(R_j^T R_i),    2 w = R_j^T t_i - R_i^T t_j + s_i - s_j,    s = R^T t,

are antisymmetric bilinear forms ``y_i^T B_k y_j`` of ``y = (R, t, s, 1)`` in R^16. The sum over all pairs of products
of such forms therefore needs only one 16x16 moment matrix of the poses. With y of the robot and y' of the camera

    N = sum_i y_i y'_i^T,     m_kl = 4 sum_(i<j) (u, w)_k (v, z)_l = 1/2 tr( N^T C_kl ),    C_kl = B_k N B_l^T

and ``d m_kl = dy_i^T C_kl y'_i + dy'_i^T C_kl^T y_i``. T2 and T3 are linear in the moments, so that the
derivatives of f and h by all poses take six 16x16 matrices.
"""

from __future__ import annotations

import numpy as np

from ..core.geometry.se3 import Array, skew
from ..model.errors.models import PoseNoise, require_count
from ..model.poses.pose_pairs import PosePairs
from .limit import solve_moments
from .noise_transport import covariance_of_poses, pose_twists
from .sensitivity import weight_of_sums


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
