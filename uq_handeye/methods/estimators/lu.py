r"""Lu and Chou (1995, in IEEE Xplore from 2002): eight-space quaternions, one linear system for both parts.

``q_A q_X = q_X q_B`` in unit dual quaternions, all eight rows per pair:

    [ E  0 ]                 E = L(q_A) - R(q_B)
    [ F  E ] (q, q') = 0,    F = L(q'_A) - R(q'_B)

The publication solves it by least squares, with Gaussian elimination of one half and a Schur decomposition for the
other. So here: q' is eliminated from the Gram matrix, ``q' = -(sum E^T E)^+ (sum E^T F) q``, and q is the eigenvector
of the smallest eigenvalue of the Schur complement

    sum (E^T E + F^T F) - (sum F^T E) (sum E^T E)^+ (sum E^T F)

Left open and chosen here: the pseudo-inverse leaves out the smallest eigenvalue of ``sum E^T E``, which is zero without
noise because ``(0, q)`` solves the system too; q' is then made orthogonal to q. The result depends on the unit of
length.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array
from ..procrustes.degeneracy import DEGENERATE, NO_ROTATION
from .common.axes import Signs, dual_quaternions, left_matrix, pose_of, quaternions, right_matrix
from .common.method import Estimate, Method, closed_form, require
from .common.moments import Factors, Moments, MomentSolver


def _rows() -> Array:
    """The 8x8 system as a linear function of (q_A, q'_A, q_B, q'_B): (16, 8, 8)."""
    rows = np.zeros((16, 8, 8))
    for first, matrices in ((0, left_matrix(np.eye(4))), (8, -right_matrix(np.eye(4)))):
        rows[first : first + 4, :4, :4] = rows[first : first + 4, 4:, 4:] = matrices
        rows[first + 4 : first + 8, 4:, :4] = matrices
    return rows


_GRAM = np.einsum("jra,krb->jkab", _rows(), _rows()).reshape(256, 64)


def dual_factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    """``(q_A, q'_A, q_B, q'_B)`` (..., 16), twice."""
    sides = [dual_quaternions(T, q) for T, q in zip((A, B), quaternions(A, B, signs), strict=True)]
    c = np.concatenate(sides, axis=-1)
    return ((c, c),)


def dual_gram(moments: Array) -> Array:
    """``sum M^T M`` (T, 8, 8) of the 8x8 systems M above, from the moments (T, 16, 16)."""
    G = (moments.reshape(-1, 256) @ _GRAM).reshape(-1, 8, 8)
    return np.asarray(0.5 * (G + G.mT))


def _solution(moments: Moments, N: int) -> Estimate:
    return closed_form(pose_of(eight_space(dual_gram(moments[0]), N)))


def eight_space(G: Array, N: int) -> Array:
    """``(q, q')`` (T, 8) with |q| = 1 and q . q' = 0, as above."""
    values, vectors = np.linalg.eigh(G[:, 4:, 4:])  # sum E^T E
    require(
        (values[:, 1] > DEGENERATE * values[:, 3]) & (values[:, 3] > NO_ROTATION * N), "the rotation axes are parallel."
    )
    inverse = (vectors[..., 1:] / values[:, None, 1:]) @ vectors[..., 1:].mT
    eliminate = -inverse @ G[:, 4:, :4]
    S = G[:, :4, :4] + G[:, :4, 4:] @ eliminate
    spectrum, axes = np.linalg.eigh(0.5 * (S + S.mT))
    require(spectrum[:, 1] - spectrum[:, 0] > DEGENERATE * values[:, 3], "two rotations fit equally well.")
    q = axes[..., 0]
    dual = (eliminate @ q[..., None])[..., 0]
    dual -= np.einsum("ti,ti->t", q, dual)[:, None] * q
    return np.concatenate([q, dual], axis=-1)


METHOD = Method(
    name="lu",
    authors="Y.-C. Lu and J. C. K. Chou",
    year=2002,
    title="Eight-Space Quaternion Approach for Robotic Hand-Eye Calibration. Proc. IEEE Int. Conf. Systems, Man and "
    "Cybernetics 1995, 3316-3321",
    doi="10.1109/ICSMC.1995.538297",
    structure="simultaneous",
    form="closed form",
    minimises="sum |E q|^2 + |F q + E q'|^2 over unit q and free q', the dual-quaternion equations",
    singular="motions of 180 degrees, unless others fix the sign of their axes",
    solver=MomentSolver(dual_factors, _solution),
)
