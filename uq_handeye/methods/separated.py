r"""Separated methods: first a rotation that fits the motions' rotations, then the translation.

The rotation is the method's own, from the sum over pairs of products of two vectors, functions of the unit quaternions
of the motions. Given it, the translation of all of them is that of linear least squares,

    sum_i |(R_A - I) t_X - (R_X t_B - t_A)|^2,    the translation part of  A X = X B
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.geometry.nearest_rotation import orthonormalise
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array, pose, skew, vee
from ..core.rounding import HALF_DIGITS
from .degeneracy import MIN_SPREAD_RATIO, NO_ROTATION
from .method import Estimate, Method, closed_form, published, require
from .moments import Factors, Moments, MomentSolver
from .quaternions import Signs, left_matrix, quaternions, right_matrix, rotation_vectors, unit_axes

_EYE = np.eye(3)
# -2 sym( L(v_A)^T R(v_B) ) as a linear function of sum v_A v_B^T
_MIXED = -np.einsum("jra,krb->jkab", left_matrix(np.eye(4)[1:]), right_matrix(np.eye(4)[1:]))
_HORAUD_GRAM = (_MIXED + _MIXED.swapaxes(-1, -2)).reshape(9, 16)


def separated(
    name: str, vectors: Callable[[Array, Array], tuple[Array, Array]], rotation: Callable[[Array, int], Array]
) -> Method:
    """Return the method whose rotation (T, 3, 3) follows from ``sum l r^T`` (T, p, q) of N pairs.

    ``vectors`` makes l (..., p) and r (..., q) of the quaternions (..., 4) of A and of B. The docstring of ``rotation``
    is the description of the method.
    """

    def factors(A: Array, B: Array, signs: Signs | None) -> Factors:
        return vectors(*quaternions(A, B, signs)), translation_factors(A, B)

    def solution(moments: Moments, N: int) -> Estimate:
        return with_translation(rotation(moments[0], N), moments[1], N)

    return Method(**published(name), solver=MomentSolver(factors, solution), mathematics=rotation.__doc__)


def translation_factors(A: Array, B: Array) -> tuple[Array, Array]:
    """``(D, D^T t_A)`` (..., 12) with ``D = R_A - I``, and ``(t_B, 1)`` (..., 4)."""
    D, t = A[..., :3, :3] - _EYE, A[..., :3, 3:]
    left = np.concatenate([D.reshape(*D.shape[:-2], 9), (D.mT @ t)[..., 0]], axis=-1)
    right = np.concatenate([B[..., :3, 3], np.ones((*B.shape[:-2], 1))], axis=-1)
    return left, right


def with_translation(R: Array, moments: Array, N: int) -> Estimate:
    """X (T, 4, 4) from its rotation (T, 3, 3) and the moments (T, 12, 4) of `translation_factors`."""
    D = moments[:, :9, 3].reshape(-1, 3, 3)
    M = -(D + D.mT)  # sum D^T D, as R_A^T R_A = I
    values = np.linalg.eigvalsh(M)
    require(values[:, 0] > MIN_SPREAD_RATIO * np.maximum(values[:, 2], 1e-4 * N), "the translation is not determined.")
    D_tB = moments[:, :9, :3].reshape(-1, 3, 3, 3)  # sum D[b, a] t_B[c]
    rhs = np.einsum("tbac,tbc->ta", D_tB, R) - moments[:, 9:, 3]
    return closed_form(pose(R, np.linalg.solve(M, rhs[..., None])[..., 0]))


def _axes(q_A: Array, q_B: Array) -> tuple[Array, Array]:
    """``sin(angle / 2) axis`` of A and of B, side by side and twice."""
    both = np.concatenate([q_A[..., 1:], q_B[..., 1:]], axis=-1)
    return both, both


def of_quaternion(q: Array) -> Array:
    """The rotations (T, 3, 3) of quaternions (T, 4), which need not have unit length."""
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def tsai(ab: Array, N: int) -> Array:
    r"""Tsai and Lenz (1989): the rotation by modified Rodrigues vectors, then the translation.

    With ``P = 2 sin(angle / 2) axis`` of A and of B, and the Rodrigues vector ``g = tan(angle_X / 2) axis_X`` of X,

        [P_A + P_B]x g = P_B - P_A

    which is linear in g; least squares over the pairs, then ``(R_A - I) t = R_X t_B - t_A``. A rotation of X by 180
    degrees has no Rodrigues vector.
    """
    PP = 4.0 * ab
    AA, AB, BA, BB = PP[:, :3, :3], PP[:, :3, 3:], PP[:, 3:, :3], PP[:, 3:, 3:]
    S = AA + AB + BA + BB  # sum s s^T, s = P_A + P_B
    M = np.trace(S, axis1=-2, axis2=-1)[:, None, None] * _EYE - S  # sum [s]x^T [s]x
    # near a half turn of X its Rodrigues vector, of squared length scale / values[0], loses half of the digits
    values = np.linalg.eigvalsh(M)
    scale = np.trace(AA, axis1=-2, axis2=-1)
    require(
        (values[:, 0] > HALF_DIGITS * scale) & (scale > NO_ROTATION * N),
        "X rotates by 180 degrees, or the rotation axes are parallel.",
    )
    # sum [s]x^T (P_B - P_A) = -2 sum P_A x P_B, the axial vector of sum P_A P_B^T
    g = np.linalg.solve(M, -2.0 * vee(AB.mT)[..., None])[..., 0]
    return of_quaternion(np.concatenate([np.ones((len(g), 1)), g], axis=-1))


TSAI = separated("tsai", _axes, tsai)

_CROSS = skew(_EYE).reshape(3, 9)  # vec [n]x = n^T CROSS


def _planes(q_A: Array, q_B: Array) -> tuple[Array, Array]:
    """``(I - n n^T, n)`` (..., 12) of the axes n of A and of B."""
    sides = []
    for q, name in ((q_A, "A"), (q_B, "B")):
        n = unit_axes(q, name)
        across = _EYE.reshape(9) - (n[..., :, None] * n[..., None, :]).reshape(*n.shape[:-1], 9)
        sides.append(np.concatenate([across, n], axis=-1))
    return sides[0], sides[1]


def shiu(M: Array, N: int) -> Array:
    r"""Shiu and Ahmad (1989): each motion fixes X up to a turn about its axis; the turns are solved for together.

    From one pair, ``n_A = R_X n_B`` gives ``R_X = n_A n_B^T + c P + s Q`` with unknown ``c = cos, s = sin`` of a turn
    about n_A; P and Q span the matrices that carry the plane across n_B to that across n_A. The publication equates
    this for two pairs, which is linear in the four unknowns. For N pairs, which it leaves open, the 2 N unknowns and
    the common ``R`` minimise ``sum |R - n_A n_B^T - c_i P_i - s_i Q_i|^2``. The turns drop out by projection,

        ( N I - sum Pi_i ) vec R = sum vec(n_A n_B^T),    Pi = (P_A kron P_B + [n_A]x kron [n_B]x) / 2,  P = I - n n^T

    a 9x9 system, whatever N; R is then projected to the nearest rotation. As in the publication each motion counts the
    same, however small its angle, which is why small rotations do so much harm.
    """
    # rows (a, b) and columns (c, d) of a sum of Kronecker products: K[ac, bd] = sum A[a, b] B[c, d]
    kron = M[:, :9, :9].reshape(-1, 3, 3, 3, 3)
    turned = (_CROSS.T @ M[:, 9:, 9:] @ _CROSS).reshape(-1, 3, 3, 3, 3)
    W = N * np.eye(9) - 0.5 * (kron + turned).transpose(0, 1, 3, 2, 4).reshape(-1, 9, 9)
    values = np.linalg.eigvalsh(W)
    require(values[:, 0] > MIN_SPREAD_RATIO * N, "the rotation axes are parallel.")
    return orthonormalise(np.linalg.solve(W, M[:, 9:, 9:].reshape(-1, 9, 1)).reshape(-1, 3, 3))


SHIU = separated("shiu", _planes, shiu)


def _chou_gram() -> Array:
    """Gram matrix (36, 16) of the rows of Chou's 4x4 system as a linear function of sum (a, b)(a, b)^T."""
    rows = np.zeros((6, 4, 4))
    for k, e in enumerate(_EYE):
        for j, sign in ((k, 1.0), (3 + k, -1.0)):
            rows[j, 0, 1:], rows[j, 1:, 0] = -sign * e, sign * e
            rows[j, 1:, 1:] = skew(e)
    return np.asarray(np.einsum("jra,krb->jkab", rows, rows).reshape(36, 16))


_CHOU_GRAM = _chou_gram()


def chou(ab: Array, N: int) -> Array:
    r"""Chou and Kamel (1991): the quaternion of X as the null vector of a linear system, then the translation.

    ``q_A q_X = q_X q_B`` gives four equations per pair that are linear in q_X. As the scalar parts of q_A and q_B are
    equal without noise, they are written with the vector parts a, b only,

        [ 0      -(a - b)^T   ]
        [ a - b   [a + b]x    ] q_X = 0

    stacked over the pairs and solved by singular value decomposition: the right singular vector of the smallest
    singular value, which is the eigenvector of the 4x4 Gram matrix. The sum of squares is ``sum |a - R_X b|^2``: the
    same function of R_X as in `horaud`, by another route, so that the two methods agree to rounding.
    """
    values, vectors = np.linalg.eigh((ab.reshape(-1, 36) @ _CHOU_GRAM).reshape(-1, 4, 4))
    gap = values[:, 1] - values[:, 0]
    require(
        (gap > MIN_SPREAD_RATIO * values[:, 3]) & (values[:, 3] > NO_ROTATION * N), "the rotation axes are parallel."
    )
    return of_quaternion(vectors[..., 0])


CHOU = separated("chou", _axes, chou)


def park(M: Array, N: int) -> Array:
    r"""Park and Martin (1994): the rotation that fits the rotation vectors, then the translation.

    With ``alpha, beta`` the rotation vectors (logarithms) of R_A and R_B, ``alpha = R_X beta``; the best R_X of ``sum
    |alpha - R_X beta|^2`` is ``(M^T M)^(-1/2) M^T`` with ``M = sum beta alpha^T``. It is computed by singular value
    decomposition with the determinant fixed to +1, which also serves two motions, where M is singular. A motion counts
    by the square of its angle.
    """
    require_two_axes(M, N)
    return orthonormalise(M)


def require_two_axes(M: Array, N: int) -> None:
    """Raise `Singular` unless ``M = sum alpha beta^T`` (T, 3, 3) of N pairs determines the rotation."""
    s = np.linalg.svd(M, compute_uv=False)
    across = s[:, 1] + np.sign(np.linalg.det(M)) * s[:, 2]
    require((across > MIN_SPREAD_RATIO * s[:, 0]) & (s[:, 0] > NO_ROTATION * N), "the rotation axes are parallel.")


PARK = separated("park", lambda q_A, q_B: (rotation_vectors(q_A), rotation_vectors(q_B)), park)


def horaud(v_v: Array, N: int) -> Array:
    r"""Horaud and Dornaika (1995): the rotation from eigenvectors of the motions by unit quaternions, then the
    translation.

    ``R_A R_X = R_X R_B`` carries the eigenvector v_B of R_B (eigenvalue 1) to that of R_A, ``v_A = R_X v_B``. For unit
    quaternions ``|v_A - q v_B q*|^2 = |v_A q - q v_B|^2`` is quadratic in q: the best q is the eigenvector of the
    smallest eigenvalue of ``sum (L(v_A) - R(v_B))^T (L(v_A) - R(v_B))``. This is the closed form of the paper; its
    nonlinear minimisation over rotation and translation together is not meant here.

    The length of the eigenvectors, which the derivation leaves open, is ``sin(angle / 2)``: they are the vector parts
    of the unit quaternions of the motions, so that larger rotations count more, as in OpenCV's implementation.
    """
    # the squares L^T L = |v_A|^2 I and R^T R = |v_B|^2 I shift all eigenvalues alike
    values, vectors = np.linalg.eigh((v_v.reshape(-1, 9) @ _HORAUD_GRAM).reshape(-1, 4, 4))
    spread, gap = values[:, 3] - values[:, 0], values[:, 1] - values[:, 0]
    require((gap > MIN_SPREAD_RATIO * spread) & (spread > NO_ROTATION * N), "the rotation axes are parallel.")
    return of_quaternion(vectors[..., 0])


HORAUD = separated("horaud", lambda q_A, q_B: (q_A[..., 1:], q_B[..., 1:]), horaud)
