r"""Horaud and Dornaika (1995): the rotation from eigenvectors of the motions by unit quaternions, then the translation.

``R_A R_X = R_X R_B`` carries the eigenvector v_B of R_B (eigenvalue 1) to that of R_A, ``v_A = R_X v_B``. For unit
quaternions ``|v_A - q v_B q*|^2 = |v_A q - q v_B|^2`` is quadratic in q: the best q is the eigenvector of the smallest
eigenvalue of ``sum (L(v_A) - R(v_B))^T (L(v_A) - R(v_B))``. This is the closed form of the paper; its nonlinear
minimisation over rotation and translation together is not meant here.

The length of the eigenvectors, which the derivation leaves open, is ``sin(angle / 2)``: they are the vector parts of
the unit quaternions of the motions, so that larger rotations count more, as in OpenCV's implementation.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.geometry.se3 import Array
from ..procrustes.degeneracy import DEGENERATE, NO_ROTATION
from .common.axes import Signs, left_matrix, quaternions, right_matrix
from .common.linear import translation_factors, with_translation
from .common.method import Estimate, Method, require
from .common.moments import Factors, Moments, MomentSolver

_BASIS = np.eye(4)[1:]
# -2 sym( L(v_A)^T R(v_B) ) as a linear function of sum v_A v_B^T
_MIXED = -np.einsum("jra,krb->jkab", left_matrix(_BASIS), right_matrix(_BASIS))
_MIXED = (_MIXED + _MIXED.swapaxes(-1, -2)).reshape(9, 16)


def _factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    q_A, q_B = quaternions(A, B, signs)
    return (q_A[..., 1:], q_B[..., 1:]), translation_factors(A, B)


def _solution(moments: Moments, N: int) -> Estimate:
    v_v, of_translation = moments
    # the squares L^T L = |v_A|^2 I and R^T R = |v_B|^2 I shift all eigenvalues alike
    values, vectors = np.linalg.eigh((v_v.reshape(-1, 9) @ _MIXED).reshape(-1, 4, 4))
    spread = values[:, 3] - values[:, 0]
    gap = values[:, 1] - values[:, 0]
    require((gap > DEGENERATE * spread) & (spread > NO_ROTATION * N), "the rotation axes are parallel.")
    R = Rotation.from_quat(vectors[..., 0], scalar_first=True).as_matrix()
    return with_translation(R, of_translation, N)


METHOD = Method(
    name="horaud",
    authors="R. Horaud and F. Dornaika",
    year=1995,
    title="Hand-eye Calibration. Int. J. Robotics Research 14(3), 195-210",
    doi="10.1177/027836499501400301",
    structure="separated",
    form="closed form",
    minimises="sum |v_A - R_X v_B|^2, v the eigenvectors of the motions with length sin(angle / 2), then "
    "sum |(R_A - I) t - (R_X t_B - t_A)|^2",
    singular="motions of 180 degrees, unless others fix the sign of their axes",
    solver=MomentSolver(_factors, _solution),
)
