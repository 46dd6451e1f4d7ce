r"""Condurache and Burlacu (2016): orthogonal dual tensors, the dual form of fitting rotation vectors.

A pose is an orthogonal dual tensor ``R + eps [t]x R``; its dual rotation vector (screw) ``alpha + eps alpha'`` is
rotated by X like a vector: ``alpha_A + eps alpha_A' = (R_X + eps [t_X]x R_X)(alpha_B + eps alpha_B')``. The best X is
the orthogonal part of the dual matrix

    sum (alpha_A + eps alpha_A')(alpha_B + eps alpha_B')^T = H + eps K

whose real part is found by singular value decomposition of H, ``R_X = U diag(1, 1, det) V^T``, and whose dual part is
linear: the dual matrix times the transposed dual tensor of X must be symmetric, which is ``M t_X = -sum( alpha_A' x R_X
alpha_B + alpha_A x R_X alpha_B')``. The publication offers SVD and QR and leaves the dual vector open; here it is the
logarithm, SVD. With ``sin(angle)`` vectors in its place the same formulas are 4DPA's limit (T2): the two methods differ
in the weight of a pair only, angle^2 here and sin(angle)^2 there.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array
from ..procrustes.degeneracy import DEGENERATE, NO_ROTATION
from ..procrustes.limit import solve_moments
from .common.axes import Signs, quaternions, rotation_vectors, twists
from .common.method import Estimate, Method, closed_form, require
from .common.moments import Factors, Moments, MomentSolver


def _factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    q_A, q_B = quaternions(A, B, signs)
    return ((twists(A, rotation_vectors(q_A)), twists(B, rotation_vectors(q_B))),)


def _solution(moments: Moments, N: int) -> Estimate:
    H = moments[0][:, :3, :3]
    s = np.linalg.svd(H, compute_uv=False)
    across = s[:, 1] + np.sign(np.linalg.det(H)) * s[:, 2]
    require((across > DEGENERATE * s[:, 0]) & (s[:, 0] > NO_ROTATION * N), "the rotation axes are parallel.")
    return closed_form(solve_moments(moments[0], N))


METHOD = Method(
    name="condurache",
    authors="D. Condurache and A. Burlacu",
    year=2016,
    title="Orthogonal Dual Tensor Method for Solving the AX = XB Sensor Calibration Problem. "
    "Mechanism and Machine Theory 104, 382-404",
    doi="10.1016/j.mechmachtheory.2016.06.002",
    structure="simultaneous",
    form="closed form",
    minimises="|alpha_A - X alpha_B|^2 of dual rotation vectors (screws): the real part by R_X, which does not depend "
    "on the translations, the dual part by t_X",
    singular="motions of 180 degrees, unless others fix the sign of their axes; where noise carries a motion across "
    "180 degrees its screw passes to the complementary one, X jumps by about the noise, and the covariance is that of "
    "one side",
    solver=MomentSolver(_factors, _solution),
)
