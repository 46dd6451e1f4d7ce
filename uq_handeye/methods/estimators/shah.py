r"""Shah (2013): robot-world and hand-eye calibration by the Kronecker product and a singular value decomposition.

With ``A X' = Z' B`` (`robot_world`), ``vec R_X' = (R_A^T kron R_B^T) vec R_Z'``: without noise ``K = sum R_A^T kron
R_B^T`` has the singular value n, whose singular vectors are ``vec R_X'`` and ``vec R_Z'`` up to scale. With noise they
are those of the largest singular value, each projected to the nearest rotation; the translations follow by linear least
squares.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array
from ..procrustes.degeneracy import DEGENERATE
from .common.linear import right_handed
from .common.method import require
from .common.robot_world import RobotWorld, RobotWorldMethod, result_of, sums, translations


def _solution(moments: Array, n: int) -> RobotWorld:
    s = sums(moments)
    U, values, Vt = np.linalg.svd(s.K)
    require(values[:, 0] - values[:, 1] > DEGENERATE * n, "the rotation axes are parallel.")
    R_X, R_Z = right_handed(U[..., 0]), right_handed(Vt[:, 0])
    t_X, t_Z = translations(s, R_Z, n)
    return result_of(R_X, t_X, R_Z, t_Z)


METHOD = RobotWorldMethod(
    name="shah",
    authors="M. Shah",
    year=2013,
    title="Solving the Robot-World/Hand-Eye Calibration Problem Using the Kronecker Product. "
    "J. Mechanisms and Robotics 5(3), 031007",
    doi="10.1115/1.4024473",
    structure="separated",
    minimises="sum |R_A R_X' - R_Z' R_B|^2 over matrices of fixed norm, then projected; then the translation part",
    solution=_solution,
)
