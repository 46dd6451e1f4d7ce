r"""Daniilidis (1999): rotation and translation together, by dual quaternions and a singular value decomposition.

``q_A q_X = q_X q_B`` in unit dual quaternions ``q + eps q'`` gives, with the vector parts ``a, a'`` of A and ``b, b'``
of B (the scalar parts are equal without noise), six equations per pair,

    [ a - b     [a + b]x      0       0       ]
    [ a' - b'   [a' + b']x    a - b   [a + b]x ] (q, q') = 0

The stacked matrix has, without noise, a null space of two dimensions, spanned by the right singular vectors ``v7 = (u1,
w1)``, ``v8 = (u2, w2)`` of the smallest singular values, here the eigenvectors of the 8x8 Gram matrix. X is the
combination with ``|q| = 1`` and ``q . q' = 0``: the second is a quadratic equation, of whose two roots the one with the
larger |q|^2 is taken. Rotation and translation equations are weighed as they come: the result depends on the unit of
length.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array, skew
from ..procrustes.degeneracy import DEGENERATE, NO_ROTATION
from .common.axes import Signs, dual_quaternions, pose_of, quaternions
from .common.method import Estimate, Method, closed_form, require
from .common.moments import Factors, Moments, MomentSolver


def _rows() -> Array:
    """The 6x8 system as a linear function of (a, b, a', b'): (12, 6, 8)."""
    rows = np.zeros((12, 6, 8))
    for k, e in enumerate(np.eye(3)):
        for j, sign in ((k, 1.0), (3 + k, -1.0)):
            S = np.column_stack([sign * e, skew(e)])
            rows[j, :3, :4] = rows[j, 3:, 4:] = S
            rows[6 + j, 3:, :4] = S
    return rows


_GRAM = np.einsum("jra,krb->jkab", _rows(), _rows()).reshape(144, 64)


def _factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    a, b = (dual_quaternions(T, q) for T, q in zip((A, B), quaternions(A, B, signs), strict=True))
    c = np.concatenate([a[..., 1:4], b[..., 1:4], a[..., 5:], b[..., 5:]], axis=-1)
    return ((c, c),)


def _solution(moments: Moments, N: int) -> Estimate:
    cc = moments[0]
    values, vectors = np.linalg.eigh((cc.reshape(-1, 144) @ _GRAM).reshape(-1, 8, 8))
    rotation = np.trace(cc[:, :6, :6], axis1=-2, axis2=-1)
    gap = values[:, 2] - values[:, 1]
    require((gap > DEGENERATE * rotation) & (rotation > NO_ROTATION * N), "more than two singular values vanish.")
    u, w = vectors[:, :4, :2], vectors[:, 4:, :2]
    # q . q' = lambda^T Omega lambda for the combination lambda of the two vectors
    omega, axes = np.linalg.eigh(0.5 * (u.mT @ w + w.mT @ u))
    require(
        (omega[:, 0] <= 0) & (omega[:, 1] >= 0),
        "the noise leaves no combination of the last two singular vectors that is a dual quaternion.",
    )
    weights = np.sqrt(np.abs(omega[:, ::-1]))
    roots = np.stack([weights, weights * [1.0, -1.0]], axis=-1)  # (T, 2, root)
    candidates = vectors[:, :, :2] @ axes @ roots  # (T, 8, root)
    sizes = np.einsum("tar,tar->tr", candidates[:, :4], candidates[:, :4])
    best = np.take_along_axis(candidates, np.argmax(sizes, axis=1)[:, None, None], axis=2)[..., 0]
    norm = np.sqrt(sizes.max(axis=1))
    require(norm > 1e-9, "the rotation part of both roots vanishes.")
    return closed_form(pose_of(best / norm[:, None]))


METHOD = Method(
    name="daniilidis",
    authors="K. Daniilidis",
    year=1999,
    title="Hand-Eye Calibration Using Dual Quaternions. Int. J. Robotics Research 18(3), 286-298",
    doi="10.1177/02783649922066213",
    structure="simultaneous",
    form="closed form",
    minimises="the algebraic error |T (q, q')|^2 of the dual-quaternion equations; the two constraints are met within "
    "its two smallest singular vectors",
    singular="motions of 180 degrees, unless others fix the sign of their axes; noise so large that the quadratic "
    "equation has no real root",
    solver=MomentSolver(_factors, _solution),
)
