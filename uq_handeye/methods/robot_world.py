"""Methods that solve for both unknowns of ``G_i X C_i = W`` on the poses themselves: `shah` and `li`.

The literature writes ``A X' = Z' B`` with ``A = C = camera_T_target``, ``B = inv(G) = gripper_T_base``, ``X' = inv(W)``
and ``Z' = inv(X)`` (names for eye-in-hand). Both methods see the poses through one moment matrix of their entries, so
that estimate and covariance are those of `moments`, with poses in the place of pairs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from ..core.geometry.se3 import Array, inverse, inverse_jacobian, pose
from ..errors import InputError, require_type
from ..model.poses.motions import relative_motions
from ..model.poses.pose_pairs import PosePairs
from .degeneracy import MIN_SPREAD_RATIO
from .linear import Normal, normal, require_axes, require_rotation, right_handed, slopes, turn_of
from .method import Estimate, Published, closed_form, explained, published, require
from .moments import Factors, Moments, MomentSolver
from .pairs import pair_blocks, trial_blocks
from .quaternions import Signs

_EYE = np.eye(3)
# Places of the unknowns of `li`: the entries of R_X' and R_Z' row by row, t_X' and t_Z'.
_X, _Z, _T_X, _T_Z = slice(0, 9), slice(9, 18), slice(18, 21), slice(21, 24)


class RobotWorld(NamedTuple):
    """Both unknowns, (T, 4, 4) each."""

    X: Array
    W: Array


@dataclass(frozen=True, kw_only=True, repr=False)
class RobotWorldMethod(Published):
    """A published estimator of X and W together: ``method(poses) -> RobotWorld``."""

    solution: Callable[[Array, int], RobotWorld]  # of the moments (T, 19, 13) of n poses
    # of the moments and the poses G, C; and d xi / d moments (T, 6, 19, 13) of X and of W
    refined: Callable[[Array, Array, Array], RobotWorld] | None = None
    slopes: Callable[[Array, int], tuple[Array, Array]] | None = None
    weighted: bool = False

    def __call__(self, poses: PosePairs) -> RobotWorld:
        """X and W (..., 4, 4) of poses, which may have leading axes."""
        require_type("poses", poses, PosePairs, "PosePairs")
        if poses.n < 3:
            raise InputError(f"Expected at least 3 poses, got {poses.n}.")
        batch, n = poses.robot.shape[:-3], poses.n
        G, C = (T.reshape(-1, n, 4, 4) for T in (poses.effective_robot, poses.camera))
        moments = self._solver(0).moments(G, C, None)[0]

        def motions(k: int) -> tuple[Array, Array]:
            all_pairs = relative_motions(PosePairs(G[k], C[k]), "all")
            return all_pairs.A, all_pairs.B

        with explained(self.name, motions, batch):
            found = self.solution(moments, n) if self.refined is None else self.refined(moments, G, C)
        return RobotWorld(*(T.reshape(*batch, 4, 4) for T in found))

    def _solver(self, which: int) -> MomentSolver:
        """For X (0) or W (1) only."""

        def solution(moments: Moments, n: int) -> Estimate:
            return closed_form(self.solution(moments[0], n)[which])

        def slopes(moments: Moments, n: int) -> list[Array]:
            assert self.slopes is not None
            return [self.slopes(moments[0], n)[which]]

        return MomentSolver(_factors, solution, slopes=None if self.slopes is None else slopes, axes=False)

    def sensitivities(self, poses: PosePairs) -> tuple[list[Array], list[Array]]:
        """``d xi / d xi_k`` (n, 6, 6) of X and of W, each by the errors of the robot and the camera poses."""
        G, C = poses.effective_robot[None], poses.camera[None]
        found = self(poses)
        result = []
        for which in (0, 1):
            with explained(self.name):
                derivatives = self._solver(which).derivatives(G, C, None, found[which][None])(slice(0, 1))
            F = derivatives.block(G, C, slice(None))[:, :, :, 0].transpose(0, 3, 1, 2)  # (2, n, 6, 6)
            by_robot = F[0] @ inverse_jacobian(poses.robot) if poses.setup == "eye-to-hand" else F[0]
            result.append([by_robot, F[1]])
        return result[0], result[1]


def _factors(G: Array, C: Array, signs: Signs | None) -> Factors:
    """``(R_A, t_A, 1, R_A^T t_A, t_B)`` (..., 19) and ``(R_B, t_B, 1)`` (..., 13), A = C, B = inv(G)."""
    A, B = C, inverse(G)
    R_A, t_A, t_B = A[..., :3, :3], A[..., :3, 3], B[..., :3, 3]
    one = np.ones((*t_A.shape[:-1], 1))
    turned = (R_A.mT @ t_A[..., None])[..., 0]
    left = np.concatenate([R_A.reshape(*one.shape[:-1], 9), t_A, one, turned, t_B], axis=-1)
    right = np.concatenate([B[..., :3, :3].reshape(*one.shape[:-1], 9), t_B, one], axis=-1)
    return ((left, right),)


class Sums(NamedTuple):
    """Sums over the poses that the two methods read from the moments."""

    K: Array  # (T, 9, 9): sum R_A^T kron R_B^T
    R_A: Array  # (T, 3, 3)
    R_A_tB: Array  # (T, 3, 3, 3): sum R_A[a, b] t_B[c]
    t_A: Array
    t_B: Array  # (T, 3)
    turned: Array  # (T, 3): sum R_A^T t_A
    tA_tB: Array  # (T, 3, 3)
    tB_tB: Array  # (T, 3, 3)


def sums(moments: Array) -> Sums:
    T = len(moments)
    kron = moments[:, :9, :9].reshape(T, 3, 3, 3, 3)  # R_A[a, b] R_B[c, d]
    return Sums(
        K=kron.transpose(0, 2, 4, 1, 3).reshape(T, 9, 9),
        R_A=moments[:, :9, 12].reshape(T, 3, 3),
        R_A_tB=moments[:, :9, 9:12].reshape(T, 3, 3, 3),
        t_A=moments[:, 9:12, 12],
        t_B=moments[:, 12, 9:12],
        turned=moments[:, 13:16, 12],
        tA_tB=moments[:, 9:12, 9:12],
        tB_tB=moments[:, 16:, 9:12],
    )


def result_of(R_X: Array, t_X: Array, R_Z: Array, t_Z: Array) -> RobotWorld:
    """X and W from X' = inv(W) and Z' = inv(X)."""
    return RobotWorld(inverse(pose(R_Z, t_Z)), inverse(pose(R_X, t_X)))


def translations(s: Sums, R_Z: Array, n: int) -> tuple[Array, Array]:
    """t_X' and t_Z' by least squares of ``R_A t_X' - t_Z' = R_Z t_B - t_A``."""
    T = len(R_Z)
    M = np.zeros((T, 6, 6))
    M[:, :3, :3] = M[:, 3:, 3:] = n * _EYE
    M[:, 3:, :3], M[:, :3, 3:] = -s.R_A, -s.R_A.mT
    values = np.linalg.eigvalsh(M)
    require(values[:, 0] > MIN_SPREAD_RATIO * values[:, -1], "the rotation axes are parallel.")
    carried = np.einsum("tbac,tbc->ta", s.R_A_tB, R_Z)  # sum R_A^T R_Z t_B
    rhs = np.concatenate([carried - s.turned, s.t_A - (R_Z @ s.t_B[..., None])[..., 0]], axis=1)
    x = np.linalg.solve(M, rhs[..., None])[..., 0]
    return x[:, :3], x[:, 3:]


def _normal_equations(moments: Array, n: int = 0) -> tuple[Array, Array]:
    """G (T, 24, 24) and g (T, 24) from the moments of n poses."""
    s = sums(moments)
    T = len(moments)
    G = np.zeros((T, 24, 24))
    G[:, _X, _X] = n * np.eye(9)
    G[:, _X, _Z] = -s.K
    G[:, _Z, _Z] = n * np.eye(9) + (_EYE[:, None, :, None] * s.tB_tB[:, None, :, None]).reshape(T, 9, 9)
    G[:, _Z, _T_X] = -s.R_A_tB.swapaxes(2, 3).reshape(T, 9, 3)
    G[:, _Z, _T_Z] = (_EYE[:, None, :] * s.t_B[:, None, :, None]).reshape(T, 9, 3)
    G[:, _T_X, _T_X] = G[:, _T_Z, _T_Z] = n * _EYE
    G[:, _T_X, _T_Z] = -s.R_A.mT
    lower = np.tril_indices(24, -1)
    G[:, lower[0], lower[1]] = G[:, lower[1], lower[0]]
    return G, np.concatenate([np.zeros((T, 9)), s.tA_tB.reshape(T, 9), -s.turned, s.t_A], axis=1)


def _li_linear(moments: Array, n: int) -> tuple[Normal, Array]:
    # all pairs: sum_ij |R_Ai - R_Aj|^2 = 2 (n^2 I - S^T S) with S = sum R_A
    S = sums(moments).R_A
    require_axes(n * n * _EYE - S.mT @ S, n * n)
    G, g = _normal_equations(moments, n)
    equations = normal(G)
    return equations, equations.solve(g)


def _li_projected(y: Array) -> RobotWorld:
    for part in (_X, _Z):
        require_rotation(y[:, part].reshape(-1, 3, 3))
    return result_of(right_handed(y[:, _X]), y[:, _T_X], right_handed(y[:, _Z]), y[:, _T_Z])


def _li(moments: Array, n: int) -> RobotWorld:
    r"""Li, Wang and Wu (2010): robot-world and hand-eye calibration, all entries by one linear least-squares problem.

    With ``A X' = Z' B`` (`robot_world`) and x, z the entries of R_X' and R_Z' row by row, a pose gives

        (R_A kron I) x - (I kron R_B^T) z = 0,     (I kron t_B^T) z - R_A t_X' + t_Z' = t_A

    solved for the 24 unknowns without constraint; the 3x3 blocks are then replaced by the nearest rotations, and the
    translations are kept. (The publication's Kronecker variant.) The result depends on the unit of length. As the
    normal equations square the condition of the problem, one step of iterative refinement follows.
    """
    return _li_projected(_li_linear(moments, n)[1])


def _li_refined(moments: Array, G: Array, C: Array) -> RobotWorld:
    """Apply one step of iterative refinement by the residuals of the poses (T, n, 4, 4) themselves."""
    T, n = G.shape[:2]
    equations, y = _li_linear(moments, n)
    gradient = np.zeros_like(y)
    for trials, poses in product(trial_blocks(T, n), pair_blocks(n)):
        gradient[trials] += _gradient(C[trials, poses], inverse(G[trials, poses]), y[trials])
    return _li_projected(y - equations.solve(gradient))


def _gradient(A: Array, B: Array, y: Array) -> Array:
    """Half the gradient (T, 24) of the sum of squares at y."""
    R_X, R_Z = (y[:, None, part].reshape(-1, 1, 3, 3) for part in (_X, _Z))
    t_X, t_Z = (y[:, None, part, None] for part in (_T_X, _T_Z))
    R_A, R_B, t_A, t_B = A[..., :3, :3], B[..., :3, :3], A[..., :3, 3:], B[..., :3, 3:]
    of_R = R_A @ R_X - R_Z @ R_B
    of_t = R_Z @ t_B - R_A @ t_X + t_Z - t_A
    parts = (R_A.mT @ of_R, of_t @ t_B.mT - of_R @ R_B.mT, -R_A.mT @ of_t, of_t)
    return np.concatenate([part.sum(axis=1).reshape(len(y), -1) for part in parts], axis=1)


def _li_slopes(moments: Array, n: int) -> tuple[Array, Array]:
    """Return the slopes of X = inv(Z') and of W = inv(X')."""
    equations, y = _li_linear(moments, n)
    found = _li_projected(y)
    dy = slopes(_normal_equations, moments.shape[1:], equations, y)
    result = []
    for found_pose, block, shift in ((found.X, _Z, _T_Z), (found.W, _X, _T_X)):
        inverted = inverse(found_pose)
        M = y[:, block].reshape(-1, 3, 3)
        by_moments = np.concatenate([turn_of(M, inverted[:, :3, :3], dy[:, block]), dy[:, shift]], axis=1)
        result.append((inverse_jacobian(inverted) @ by_moments).reshape(-1, 6, *moments.shape[1:]))
    return result[0], result[1]


LI = RobotWorldMethod(**published("li"), solution=_li, refined=_li_refined, slopes=_li_slopes)


def _shah(moments: Array, n: int) -> RobotWorld:
    r"""Shah (2013): robot-world and hand-eye calibration by the Kronecker product and a singular value decomposition.

    With ``A X' = Z' B`` (`robot_world`), ``vec R_X' = (R_A^T kron R_B^T) vec R_Z'``: without noise ``K = sum R_A^T kron
    R_B^T`` has the singular value n, whose singular vectors are ``vec R_X'`` and ``vec R_Z'`` up to scale. With noise
    they are those of the largest singular value, each projected to the nearest rotation; the translations follow by
    linear least squares.
    """
    s = sums(moments)
    U, values, Vt = np.linalg.svd(s.K)
    require(values[:, 0] - values[:, 1] > MIN_SPREAD_RATIO * n, "the rotation axes are parallel.")
    R_X, R_Z = right_handed(U[..., 0]), right_handed(Vt[:, 0])
    t_X, t_Z = translations(s, R_Z, n)
    return result_of(R_X, t_X, R_Z, t_Z)


SHAH = RobotWorldMethod(**published("shah"), solution=_shah)
