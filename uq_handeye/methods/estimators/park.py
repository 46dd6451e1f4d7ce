r"""Park and Martin (1994): the rotation that fits the rotation vectors, then the translation.

With ``alpha, beta`` the rotation vectors (logarithms) of R_A and R_B, ``alpha = R_X beta``; the best R_X of ``sum
|alpha - R_X beta|^2`` is ``(M^T M)^(-1/2) M^T`` with ``M = sum beta alpha^T``. It is computed by singular value
decomposition with the determinant fixed to +1, which also serves two motions, where M is singular. A motion counts by
the square of its angle.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array
from ..procrustes.degeneracy import DEGENERATE, NO_ROTATION
from .common.axes import Signs, quaternions, rotation_vectors
from .common.linear import translation_factors, with_translation
from .common.method import Estimate, Method, require
from .common.moments import Factors, Moments, MomentSolver


def _factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    q_A, q_B = quaternions(A, B, signs)
    return (rotation_vectors(q_A), rotation_vectors(q_B)), translation_factors(A, B)


def _solution(moments: Moments, N: int) -> Estimate:
    M, of_translation = moments
    s = np.linalg.svd(M, compute_uv=False)
    across = s[:, 1] + np.sign(np.linalg.det(M)) * s[:, 2]
    require((across > DEGENERATE * s[:, 0]) & (s[:, 0] > NO_ROTATION * N), "the rotation axes are parallel.")
    return with_translation(orthonormalise(M), of_translation, N)


METHOD = Method(
    name="park",
    authors="F. C. Park and B. J. Martin",
    year=1994,
    title="Robot Sensor Calibration: Solving AX=XB on the Euclidean Group. "
    "IEEE Trans. Robotics and Automation 10(5), 717-721",
    doi="10.1109/70.326576",
    structure="separated",
    form="closed form",
    minimises="sum |alpha - R_X beta|^2 of rotation vectors, then sum |(R_A - I) t - (R_X t_B - t_A)|^2",
    singular="motions of 180 degrees, unless others fix the sign of their axes",
    solver=MomentSolver(_factors, _solution),
)
