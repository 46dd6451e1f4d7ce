r"""Li, Wang and Wu (2010): robot-world and hand-eye calibration, all entries by one linear least-squares problem.

With ``A X' = Z' B`` (`robot_world`) and x, z the entries of R_X' and R_Z' row by row, a pose gives

    (R_A kron I) x - (I kron R_B^T) z = 0,     (I kron t_B^T) z - R_A t_X' + t_Z' = t_A

solved for the 24 unknowns without constraint; the 3x3 blocks are then replaced by the nearest rotations, and the
translations are kept. (The publication's Kronecker variant.) The result depends on the unit of length. As the normal
equations square the condition of the problem, one step of iterative refinement follows.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ...core.geometry.se3 import Array, inverse, inverse_jacobian
from ..procrustes.limit import pair_blocks, trial_blocks
from .common.linear import Normal, normal, require_axes, require_rotation, right_handed, slopes, turn_of
from .common.robot_world import SHAPE, RobotWorld, RobotWorldMethod, result_of, sums

_EYE = np.eye(3)
_X, _Z, _T_X, _T_Z = slice(0, 9), slice(9, 18), slice(18, 21), slice(21, 24)


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


def _linear(moments: Array, n: int) -> tuple[Normal, Array]:
    # all pairs: sum_ij |R_Ai - R_Aj|^2 = 2 (n^2 I - S^T S) with S = sum R_A
    S = sums(moments).R_A
    require_axes(n * n * _EYE - S.mT @ S, n * n)
    G, g = _normal_equations(moments, n)
    equations = normal(G)
    return equations, equations.solve(g)


def _projected(y: Array) -> RobotWorld:
    for part in (_X, _Z):
        require_rotation(y[:, part].reshape(-1, 3, 3))
    return result_of(right_handed(y[:, _X]), y[:, _T_X], right_handed(y[:, _Z]), y[:, _T_Z])


def _solution(moments: Array, n: int) -> RobotWorld:
    return _projected(_linear(moments, n)[1])


def _refined(moments: Array, G: Array, C: Array) -> RobotWorld:
    """Apply one step of iterative refinement by the residuals of the poses (T, n, 4, 4) themselves."""
    T, n = G.shape[:2]
    equations, y = _linear(moments, n)
    gradient = np.zeros_like(y)
    for trials, poses in product(trial_blocks(T, n), pair_blocks(n)):
        gradient[trials] += _gradient(C[trials, poses], inverse(G[trials, poses]), y[trials])
    return _projected(y - equations.solve(gradient))


def _gradient(A: Array, B: Array, y: Array) -> Array:
    """Half the gradient (T, 24) of the sum of squares at y."""
    R_X, R_Z = (y[:, None, part].reshape(-1, 1, 3, 3) for part in (_X, _Z))
    t_X, t_Z = (y[:, None, part, None] for part in (_T_X, _T_Z))
    R_A, R_B, t_A, t_B = A[..., :3, :3], B[..., :3, :3], A[..., :3, 3:], B[..., :3, 3:]
    of_R = R_A @ R_X - R_Z @ R_B
    of_t = R_Z @ t_B - R_A @ t_X + t_Z - t_A
    parts = (R_A.mT @ of_R, of_t @ t_B.mT - of_R @ R_B.mT, -R_A.mT @ of_t, of_t)
    return np.concatenate([part.sum(axis=1).reshape(len(y), -1) for part in parts], axis=1)


def _slopes(moments: Array, n: int) -> tuple[Array, Array]:
    """Return the slopes of X = inv(Z') and of W = inv(X')."""
    equations, y = _linear(moments, n)
    found = _projected(y)
    dy = slopes(_normal_equations, SHAPE, equations, y)
    result = []
    for pose, block, shift in ((found.X, _Z, _T_Z), (found.W, _X, _T_X)):
        inverted = inverse(pose)
        M = y[:, block].reshape(-1, 3, 3)
        by_moments = np.concatenate([turn_of(M, inverted[:, :3, :3], dy[:, block]), dy[:, shift]], axis=1)
        result.append((inverse_jacobian(inverted) @ by_moments).reshape(-1, 6, *SHAPE))
    return result[0], result[1]


METHOD = RobotWorldMethod(
    name="li",
    authors="A. Li, L. Wang and D. Wu",
    year=2010,
    title="Simultaneous Robot-World and Hand-Eye Calibration Using Dual-Quaternions and Kronecker Product. "
    "Int. J. Physical Sciences 5(10), 1530-1536",
    doi=None,  # the journal gave none
    structure="simultaneous",
    minimises="sum |R_A R_X' - R_Z' R_B|^2 + |R_Z' t_B + t_Z' - R_A t_X' - t_A|^2 over any 3x3 matrices, which are "
    "then projected",
    solution=_solution,
    refined=_refined,
    slopes=_slopes,
)
