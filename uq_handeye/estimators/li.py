r"""Li, Wang and Wu (2010): robot-world and hand-eye calibration, all entries by one linear least-squares problem.

With ``A X' = Z' B`` (`robot_world`) and x, z the entries of R_X' and R_Z' row by row, a pose gives

    (R_A kron I) x - (I kron R_B^T) z = 0,     (I kron t_B^T) z - R_A t_X' + t_Z' = t_A

solved for the 24 unknowns without constraint; the 3x3 blocks are then replaced by the nearest rotations, and the
translations are kept. (The publication's Kronecker variant.) The result depends on the unit of length.
"""

from __future__ import annotations

import numpy as np

from ..procrustes import DEGENERATE
from ..se3 import Array
from .method import require
from .robot_world import RobotWorld, RobotWorldMethod, result_of, right_handed, sums

_EYE = np.eye(3)


def _solution(moments: Array, n: int) -> RobotWorld:
    s = sums(moments)
    T = len(moments)
    G = np.zeros((T, 24, 24))
    x, z, t_X, t_Z = slice(0, 9), slice(9, 18), slice(18, 21), slice(21, 24)
    G[:, x, x] = n * np.eye(9)
    G[:, x, z] = -s.K
    G[:, z, z] = n * np.eye(9) + (_EYE[:, None, :, None] * s.tB_tB[:, None, :, None]).reshape(T, 9, 9)
    G[:, z, t_X] = -s.R_A_tB.swapaxes(2, 3).reshape(T, 9, 3)
    G[:, z, t_Z] = (_EYE[:, None, :] * s.t_B[:, None, :, None]).reshape(T, 9, 3)
    G[:, t_X, t_X] = G[:, t_Z, t_Z] = n * _EYE
    G[:, t_X, t_Z] = -s.R_A.mT
    lower = np.tril_indices(24, -1)
    G[:, lower[0], lower[1]] = G[:, lower[1], lower[0]]
    g = np.concatenate([np.zeros((T, 9)), s.tA_tB.reshape(T, 9), -s.turned, s.t_A], axis=1)
    diagonal = np.sqrt(np.diagonal(G, axis1=-2, axis2=-1))
    scaled = G / (diagonal[:, :, None] * diagonal[:, None, :])
    values = np.linalg.eigvalsh(scaled)
    require(values[:, 0] > DEGENERATE * values[:, -1], "its linear equations are singular.")
    y = np.linalg.solve(scaled, (g / diagonal)[..., None])[..., 0] / diagonal
    return result_of(right_handed(y[:, x]), y[:, t_X], right_handed(y[:, z]), y[:, t_Z])


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
)
