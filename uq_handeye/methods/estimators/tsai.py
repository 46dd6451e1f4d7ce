r"""Tsai and Lenz (1989): the rotation by modified Rodrigues vectors, then the translation.

With ``P = 2 sin(angle / 2) axis`` of A and of B, and the Rodrigues vector ``g = tan(angle_X / 2) axis_X`` of X,

    [P_A + P_B]x g = P_B - P_A

which is linear in g; least squares over the pairs, then ``(R_A - I) t = R_X t_B - t_A``. A rotation of X by 180 degrees
has no Rodrigues vector.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.geometry.se3 import Array, vee
from ..procrustes.degeneracy import NO_ROTATION
from .common.axes import Signs, quaternions
from .common.linear import translation_factors, with_translation
from .common.method import Estimate, Method, require
from .common.moments import Factors, Moments, MomentSolver

# Squared cosine of half the rotation angle of X below which g is too long for nine digits.
HALF_TURN_OF_X = 1e-7


def _factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    q_A, q_B = quaternions(A, B, signs)
    P = 2.0 * np.concatenate([q_A[..., 1:], q_B[..., 1:]], axis=-1)
    return (P, P), translation_factors(A, B)


def _solution(moments: Moments, N: int) -> Estimate:
    PP, of_translation = moments
    AA, AB, BA, BB = PP[:, :3, :3], PP[:, :3, 3:], PP[:, 3:, :3], PP[:, 3:, 3:]
    S = AA + AB + BA + BB  # sum s s^T, s = P_A + P_B
    M = np.trace(S, axis1=-2, axis2=-1)[:, None, None] * np.eye(3) - S  # sum [s]x^T [s]x
    values = np.linalg.eigvalsh(M)
    scale = np.trace(AA, axis1=-2, axis2=-1)
    require(
        (values[:, 0] > HALF_TURN_OF_X * scale) & (scale > NO_ROTATION * N),
        "X rotates by 180 degrees, or the rotation axes are parallel.",
    )
    # sum [s]x^T (P_B - P_A) = -2 sum P_A x P_B, the axial vector of sum P_A P_B^T
    g = np.linalg.solve(M, -2.0 * vee(AB.mT)[..., None])[..., 0]
    q = np.concatenate([np.ones((len(g), 1)), g], axis=-1)
    R = Rotation.from_quat(q, scalar_first=True).as_matrix()
    return with_translation(R, of_translation, N)


METHOD = Method(
    name="tsai",
    authors="R. Y. Tsai and R. K. Lenz",
    year=1989,
    title="A New Technique for Fully Autonomous and Efficient 3D Robotics Hand/Eye Calibration. "
    "IEEE Trans. Robotics and Automation 5(3), 345-358",
    doi="10.1109/70.34770",
    structure="separated",
    form="closed form",
    minimises="sum |[P_A + P_B]x g - (P_B - P_A)|^2 over the Rodrigues vector g of X, then "
    "sum |(R_A - I) t - (R_X t_B - t_A)|^2",
    singular="X itself rotates by nearly 180 degrees: its Rodrigues vector, tan(angle_X / 2) long, has lost its digits",
    solver=MomentSolver(_factors, _solution),
)
