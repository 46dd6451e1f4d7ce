r"""Shiu and Ahmad (1989): each motion fixes X up to a turn about its axis; the turns are solved for together.

From one pair, ``n_A = R_X n_B`` gives ``R_X = n_A n_B^T + c P + s Q`` with unknown ``c = cos, s = sin`` of a turn about
n_A; P and Q span the matrices that carry the plane across n_B to that across n_A. The publication equates this for two
pairs, which is linear in the four unknowns. For N pairs, which it leaves open, the 2 N unknowns and the common ``R``
minimise ``sum |R - n_A n_B^T - c_i P_i - s_i Q_i|^2``. The turns drop out by projection,

    ( N I - sum Pi_i ) vec R = sum vec(n_A n_B^T),    Pi = (P_A kron P_B + [n_A]x kron [n_B]x) / 2,    P = I - n n^T

a 9x9 system, whatever N; R is then projected to the nearest rotation. As in the publication each motion counts the
same, however small its angle, which is why small rotations do so much harm.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array, skew
from ..procrustes.degeneracy import DEGENERATE
from .common.axes import Signs, quaternions, unit_axes
from .common.linear import translation_factors, with_translation
from .common.method import Estimate, Method, require
from .common.moments import Factors, Moments, MomentSolver

_CROSS = skew(np.eye(3)).reshape(3, 9)  # vec [n]x = n^T CROSS
_I9 = np.eye(3).reshape(9)


def _factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    sides = []
    for q, name in zip(quaternions(A, B, signs), "AB", strict=True):
        n = unit_axes(q, name)
        across = _I9 - (n[..., :, None] * n[..., None, :]).reshape(*n.shape[:-1], 9)
        sides.append(np.concatenate([across, n], axis=-1))
    return (sides[0], sides[1]), translation_factors(A, B)


def _solution(moments: Moments, N: int) -> Estimate:
    M, of_translation = moments
    # rows (a, b) and columns (c, d) of a sum of Kronecker products: K[ac, bd] = sum A[a, b] B[c, d]
    kron = M[:, :9, :9].reshape(-1, 3, 3, 3, 3)
    turned = (_CROSS.T @ M[:, 9:, 9:] @ _CROSS).reshape(-1, 3, 3, 3, 3)
    Pi = 0.5 * (kron + turned).transpose(0, 1, 3, 2, 4).reshape(-1, 9, 9)
    W = N * np.eye(9) - Pi
    values = np.linalg.eigvalsh(W)
    require(values[:, 0] > DEGENERATE * N, "the rotation axes are parallel.")
    vec_R = np.linalg.solve(W, M[:, 9:, 9:].reshape(-1, 9, 1))
    return with_translation(orthonormalise(vec_R.reshape(-1, 3, 3)), of_translation, N)


METHOD = Method(
    name="shiu",
    authors="Y. C. Shiu and S. Ahmad",
    year=1989,
    title="Calibration of Wrist-Mounted Robotic Sensors by Solving Homogeneous Transform Equations of the Form AX=XB. "
    "IEEE Trans. Robotics and Automation 5(1), 16-29",
    doi="10.1109/70.88014",
    structure="separated",
    form="closed form",
    minimises="sum |R - n_A n_B^T - c_i P_i - s_i Q_i|^2 over R and the turns (c_i, s_i) about each axis, then "
    "sum |(R_A - I) t - (R_X t_B - t_A)|^2",
    singular="a motion without rotation, whose axis is open; motions of 180 degrees, unless others fix the sign",
    solver=MomentSolver(_factors, _solution),
)
