r"""Methods that solve for both unknowns of ``G_i X C_i = W`` on the poses themselves: `shah` and `li`.

The literature writes ``A X' = Z' B`` with ``A = C = camera_T_target``, ``B = inv(G) = gripper_T_base``, ``X' = inv(W)``
and ``Z' = inv(X)`` (names for eye-in-hand). Both methods see the poses through one moment matrix of their entries, so
that estimate and covariance are those of `moments`, with poses in the place of pairs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....core.geometry.se3 import Array, inverse, inverse_jacobian
from ....errors import InputError
from ....model.poses.motions import relative_motions
from ....model.poses.pose_pairs import PosePairs
from ...procrustes.degeneracy import DEGENERATE
from .axes import Signs
from .method import Estimate, closed_form, explained, require
from .moments import Factors, Moments, MomentSolver

_EYE = np.eye(3)
SHAPE = (19, 13)  # of the moments


class RobotWorld(NamedTuple):
    """Both unknowns, (T, 4, 4) each."""

    X: Array
    W: Array


@dataclass(frozen=True)
class RobotWorldMethod:
    """A published estimator of X and W together: ``method(poses) -> RobotWorld``."""

    name: str
    authors: str
    year: int
    title: str
    doi: str | None
    structure: str
    minimises: str
    solution: Callable[[Array, int], RobotWorld]  # of the moments (T, 19, 13) of n poses
    # of the moments and the poses G, C; and d xi / d moments (T, 6, 19, 13) of X and of W
    refined: Callable[[Array, Array, Array], RobotWorld] | None = None
    slopes: Callable[[Array, int], tuple[Array, Array]] | None = None
    form: str = "closed form"
    weighted: bool = False

    def __repr__(self) -> str:
        return f"RobotWorldMethod({self.name}: {self.authors} {self.year}, {self.structure}, {self.form})"

    def __call__(self, poses: PosePairs) -> RobotWorld:
        """X and W (..., 4, 4) of poses, which may have leading axes."""
        if not isinstance(poses, PosePairs):
            raise InputError(f"Expected `poses` to be PosePairs, got {type(poses).__name__}.")
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
    poses = np.zeros((2, len(R_X), 4, 4))
    poses[0, :, :3, :3], poses[0, :, :3, 3] = R_Z, t_Z
    poses[1, :, :3, :3], poses[1, :, :3, 3] = R_X, t_X
    poses[..., 3, 3] = 1.0
    X, W = inverse(poses)
    return RobotWorld(X, W)


def translations(s: Sums, R_Z: Array, n: int) -> tuple[Array, Array]:
    """t_X' and t_Z' by least squares of ``R_A t_X' - t_Z' = R_Z t_B - t_A``."""
    T = len(R_Z)
    M = np.zeros((T, 6, 6))
    M[:, :3, :3] = M[:, 3:, 3:] = n * _EYE
    M[:, 3:, :3], M[:, :3, 3:] = -s.R_A, -s.R_A.mT
    values = np.linalg.eigvalsh(M)
    require(values[:, 0] > DEGENERATE * values[:, -1], "the rotation axes are parallel.")
    carried = np.einsum("tbac,tbc->ta", s.R_A_tB, R_Z)  # sum R_A^T R_Z t_B
    rhs = np.concatenate([carried - s.turned, s.t_A - (R_Z @ s.t_B[..., None])[..., 0]], axis=1)
    x = np.linalg.solve(M, rhs[..., None])[..., 0]
    return x[:, :3], x[:, 3:]
