"""Methods that solve for rotation and translation together: 4DPA in its limit, dual tensors, dual quaternions.

`daniilidis`, `lu`, `heller`, `zhang` and `zhao` write ``q_A q_X = q_X q_B`` in unit dual quaternions ``q + eps q'``;
`condurache` fits dual rotation vectors, and 4DPA (Wu, Sun, Wang and Liu 2019) in the limit of its scaling factor the
vectors ``sin(angle) axis`` (`limit`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.geometry.se3 import Array, skew
from ..core.rounding import CHAIN_ROUNDING
from ..model.errors.models import PairNoise
from .degeneracy import MIN_SPREAD_RATIO, NO_ROTATION
from .limit import solve_limit, solve_moments
from .method import Derivatives, Estimate, Functions, Method, closed_form, published, require
from .moments import Factors, Moments, MomentSolver
from .quaternions import (
    Signs,
    dual_quaternions,
    left_matrix,
    pose_of,
    quaternions,
    right_matrix,
    rotation_vectors,
    twists,
)
from .sensitivity import LimitDerivatives
from .separated import require_two_axes


def _limit(A: Array, B: Array, noise: PairNoise | None) -> Estimate:
    """Wu, Sun, Wang and Liu (2019): 4D Procrustes analysis, in the limit of its scaling factor (`limit`)."""
    return closed_form(solve_limit(A, B))


def _of_limit(A: Array, B: Array, noise: PairNoise | None, X: Array) -> Callable[[slice], Derivatives]:
    return lambda trials: LimitDerivatives(X[trials], checked=True)


FOURDPA = Method(
    **published("4dpa"),
    solver=Functions(_limit, _of_limit),
    mathematics=_limit.__doc__,
)


def _condurache_factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    q_A, q_B = quaternions(A, B, signs)
    return ((twists(A, rotation_vectors(q_A)), twists(B, rotation_vectors(q_B))),)


def _condurache(moments: Moments, N: int) -> Estimate:
    r"""Condurache and Burlacu (2016): orthogonal dual tensors, the dual form of fitting rotation vectors.

    A pose is an orthogonal dual tensor ``R + eps [t]x R``; its dual rotation vector (screw) ``alpha + eps alpha'`` is
    rotated by X like a vector: ``alpha_A + eps alpha_A' = (R_X + eps [t_X]x R_X)(alpha_B + eps alpha_B')``. The best X
    is the orthogonal part of the dual matrix

        sum (alpha_A + eps alpha_A')(alpha_B + eps alpha_B')^T = H + eps K

    whose real part is found by singular value decomposition of H, ``R_X = U diag(1, 1, det) V^T``, and whose dual part
    is linear: the dual matrix times the transposed dual tensor of X must be symmetric, which is ``M t_X = -sum(
    alpha_A' x R_X alpha_B + alpha_A x R_X alpha_B')``. The publication offers SVD and QR and leaves the dual vector
    open; here it is the logarithm, SVD. With ``sin(angle)`` vectors in its place the same formulas are 4DPA's limit
    (T2): the two methods differ in the weight of a pair only, angle^2 here and sin(angle)^2 there.
    """
    require_two_axes(moments[0][:, :3, :3], N)
    return closed_form(solve_moments(moments[0], N))


CONDURACHE = Method(
    **published("condurache"),
    solver=MomentSolver(_condurache_factors, _condurache),
    mathematics=_condurache.__doc__,
)


def _daniilidis_rows() -> Array:
    """The 6x8 system as a linear function of (a, b, a', b'): (12, 6, 8)."""
    rows = np.zeros((12, 6, 8))
    for k, e in enumerate(np.eye(3)):
        for j, sign in ((k, 1.0), (3 + k, -1.0)):
            S = np.column_stack([sign * e, skew(e)])
            rows[j, :3, :4] = rows[j, 3:, 4:] = S
            rows[6 + j, 3:, :4] = S
    return rows


_DANIILIDIS_GRAM = np.einsum("jra,krb->jkab", _daniilidis_rows(), _daniilidis_rows()).reshape(144, 64)


def _daniilidis_factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    a, b = (dual_quaternions(T, q) for T, q in zip((A, B), quaternions(A, B, signs), strict=True))
    c = np.concatenate([a[..., 1:4], b[..., 1:4], a[..., 5:], b[..., 5:]], axis=-1)
    return ((c, c),)


def _daniilidis(moments: Moments, N: int) -> Estimate:
    r"""Daniilidis (1999): rotation and translation together, by dual quaternions and a singular value decomposition.

    ``q_A q_X = q_X q_B`` in unit dual quaternions ``q + eps q'`` gives, with the vector parts ``a, a'`` of A and ``b,
    b'`` of B (the scalar parts are equal without noise), six equations per pair,

        [ a - b     [a + b]x      0       0       ]
        [ a' - b'   [a' + b']x    a - b   [a + b]x ] (q, q') = 0

    The stacked matrix has, without noise, a null space of two dimensions, spanned by the right singular vectors ``v7 =
    (u1, w1)``, ``v8 = (u2, w2)`` of the smallest singular values, here the eigenvectors of the 8x8 Gram matrix. X is
    the combination with ``|q| = 1`` and ``q . q' = 0``: the second is a quadratic equation, of whose two roots the one
    with the larger |q|^2 is taken. Rotation and translation equations are weighed as they come: the result depends on
    the unit of length.
    """
    cc = moments[0]
    values, vectors = np.linalg.eigh((cc.reshape(-1, 144) @ _DANIILIDIS_GRAM).reshape(-1, 8, 8))
    rotation = np.trace(cc[:, :6, :6], axis1=-2, axis2=-1)
    gap = values[:, 2] - values[:, 1]
    require((gap > MIN_SPREAD_RATIO * rotation) & (rotation > NO_ROTATION * N), "more than two singular values vanish.")
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
    require(norm > CHAIN_ROUNDING, "the rotation part of both roots vanishes.")
    return closed_form(pose_of(best / norm[:, None]))


DANIILIDIS = Method(
    **published("daniilidis"),
    solver=MomentSolver(_daniilidis_factors, _daniilidis),
    mathematics=_daniilidis.__doc__,
)


def _lu_rows() -> Array:
    """The 8x8 system as a linear function of (q_A, q'_A, q_B, q'_B): (16, 8, 8)."""
    rows = np.zeros((16, 8, 8))
    for first, matrices in ((0, left_matrix(np.eye(4))), (8, -right_matrix(np.eye(4)))):
        rows[first : first + 4, :4, :4] = rows[first : first + 4, 4:, 4:] = matrices
        rows[first + 4 : first + 8, 4:, :4] = matrices
    return rows


_LU_GRAM = np.einsum("jra,krb->jkab", _lu_rows(), _lu_rows()).reshape(256, 64)


def dual_factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    """``(q_A, q'_A, q_B, q'_B)`` (..., 16), twice."""
    sides = [dual_quaternions(T, q) for T, q in zip((A, B), quaternions(A, B, signs), strict=True)]
    c = np.concatenate(sides, axis=-1)
    return ((c, c),)


def dual_gram(moments: Array) -> Array:
    """``sum M^T M`` (T, 8, 8) of the 8x8 systems M above, from the moments (T, 16, 16)."""
    G = (moments.reshape(-1, 256) @ _LU_GRAM).reshape(-1, 8, 8)
    return np.asarray(0.5 * (G + G.mT))


def _lu(moments: Moments, N: int) -> Estimate:
    r"""Lu and Chou (1995, in IEEE Xplore from 2002): eight-space quaternions, one linear system for both parts.

    ``q_A q_X = q_X q_B`` in unit dual quaternions, all eight rows per pair:

        [ E  0 ]                 E = L(q_A) - R(q_B)
        [ F  E ] (q, q') = 0,    F = L(q'_A) - R(q'_B)

    The publication solves it by least squares, with Gaussian elimination of one half and a Schur decomposition for the
    other. So here: q' is eliminated from the Gram matrix, ``q' = -(sum E^T E)^+ (sum E^T F) q``, and q is the
    eigenvector of the smallest eigenvalue of the Schur complement

        sum (E^T E + F^T F) - (sum F^T E) (sum E^T E)^+ (sum E^T F)

    Left open and chosen here: the pseudo-inverse leaves out the smallest eigenvalue of ``sum E^T E``, which is zero
    without noise because ``(0, q)`` solves the system too; q' is then made orthogonal to q. The result depends on the
    unit of length.
    """
    return closed_form(pose_of(eight_space(dual_gram(moments[0]), N)))


def eight_space(G: Array, N: int) -> Array:
    """``(q, q')`` (T, 8) with |q| = 1 and q . q' = 0, as above."""
    values, vectors = np.linalg.eigh(G[:, 4:, 4:])  # sum E^T E
    require(
        (values[:, 1] > MIN_SPREAD_RATIO * values[:, 3]) & (values[:, 3] > NO_ROTATION * N),
        "the rotation axes are parallel.",
    )
    inverse = (vectors[..., 1:] / values[:, None, 1:]) @ vectors[..., 1:].mT
    eliminate = -inverse @ G[:, 4:, :4]
    S = G[:, :4, :4] + G[:, :4, 4:] @ eliminate
    spectrum, axes = np.linalg.eigh(0.5 * (S + S.mT))
    require(spectrum[:, 1] - spectrum[:, 0] > MIN_SPREAD_RATIO * values[:, 3], "two rotations fit equally well.")
    q = axes[..., 0]
    dual = (eliminate @ q[..., None])[..., 0]
    dual -= np.einsum("ti,ti->t", q, dual)[:, None] * q
    return np.concatenate([q, dual], axis=-1)


LU = Method(
    **published("lu"),
    solver=MomentSolver(dual_factors, _lu),
    mathematics=_lu.__doc__,
)
