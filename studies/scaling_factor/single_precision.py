"""4DPA and its covariance in the precision of its input: the paper's route at finite d, and its limit.

The toolkit itself computes in double precision. Here every intermediate has the type of A and B (float32 or float64),
so that rounding can be studied. Model: ``A_i X = X B_i``, errors ``xi = (theta, tau)`` (left rotation, additive
translation, rad and the length unit of the input), in X in the frame of A. Numbers in parentheses are equations of the
paper, T2 and T3 sections of the theory page. Shapes: A, B (..., N, 4, 4), X (..., 4, 4); nothing is checked.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uq_handeye.symbolic import functions as closed_form

Real = NDArray[np.floating[Any]]

# (M32 - M23, M13 - M31, M21 - M12): rows and columns
_UPPER, _LOWER = ((2, 0, 1), (1, 2, 0)), ((1, 2, 0), (2, 0, 1))


class Octonion(NamedTuple):
    """Problem 2 at finite d."""

    q: Real  # (..., 2, 4): q_L and q_R, with R[3, 3] > 0
    pinv: Real  # (..., 2, 4, 4): (F - lambda_min I)^+ of F11 and F22


def problem_2(A: Real, B: Real, d: float) -> Octonion:
    """q_L and q_R (34) from F11 and F22 (33), (35) of the images F2 (51)."""
    scale = A.dtype.type(d)
    E, Z = closed_form.F2(A, scale), closed_form.F2(B, scale)
    sums = np.stack([closed_form.F11(E, Z).sum(axis=-3), closed_form.F22(E, Z).sum(axis=-3)], axis=-3)
    values, vectors = np.linalg.eigh(sums)
    q = vectors[..., 0].copy()
    corner = closed_form.sigma_to_R(_sigma(q))[..., 3, 3]
    q[..., 1, :] *= np.where(corner < 0, -1, 1).astype(A.dtype)[..., None]
    gaps = values[..., 1:] - values[..., :1]
    return Octonion(q, (vectors[..., 1:] / gaps[..., None, :]) @ vectors[..., 1:].mT)


def _sigma(q: Real) -> Real:
    """(18)"""
    return np.asarray(q.reshape(*q.shape[:-2], 8) * q.dtype.type(np.sqrt(0.5)))


def remapped(octonion: Octonion, d: float) -> Real:
    """X from the rotation on SO(4) (16), (51); its upper left block is orthonormalised."""
    R4 = closed_form.sigma_to_R(_sigma(octonion.q))
    return _pose(_nearest(R4[..., :3, :3]), R4.dtype.type(d) * R4[..., :3, 3])


def _pose(R: Real, t: Real) -> Real:
    X = np.zeros((*R.shape[:-2], 4, 4), R.dtype)
    X[..., :3, :3], X[..., :3, 3], X[..., 3, 3] = R, t, 1
    return X


def _nearest(M: Real) -> Real:
    """The rotation nearest to M (..., 3, 3)."""
    U, _, Vt = np.linalg.svd(M)
    U[..., -1] *= np.linalg.det(U @ Vt)[..., None]
    return np.asarray(U @ Vt)


class Linear(NamedTuple):
    """The covariance at finite d in two factors: ``Sigma_X = J D D^T J^T``."""

    D: Real  # (..., 8, 12 N): d sigma by the data, in units of their deviations
    J: Real  # (..., 6, 8): d xi_X / d sigma, its lower half of the order of d

    def covariance(self) -> Real:
        """(..., 6, 6) by ``J D``: what cancels cancels before it is squared."""
        return gram(self.J @ self.D)

    def printed(self) -> Real:
        """The same as (48), (55), (59) have it: first the covariance of sigma, then from it that of X."""
        return np.asarray(self.J @ gram(self.D) @ self.J.mT)


def gram(D: Real) -> Real:
    return np.asarray(D @ D.mT)


def linear(A: Real, B: Real, octonion: Octonion, d: float, deviations: Real) -> Linear:
    """First order by (39)-(48) and (53)-(59), of independent pairs.

    ``deviations`` (6,): those of xi of every A and B, independent.
    """
    scale = A.dtype.type(d)
    E, Z = closed_form.F2(A, scale), closed_form.F2(B, scale)
    q = octonion.q[..., None, :, :]
    by_image = np.stack(
        [closed_form.dF11q_db(E, Z, q[..., 0, :]), closed_form.dF22q_db(E, Z, q[..., 1, :])], axis=-3
    )  # (..., N, 2, 4, 32)
    by_error = np.concatenate(
        [
            by_image[..., :16] @ closed_form.dF2_dxi(A, scale)[..., None, :, :],
            by_image[..., 16:] @ closed_form.dF2_dxi(B, scale)[..., None, :, :],
        ],
        axis=-1,
    )
    by_error *= np.concatenate([deviations, deviations]).astype(A.dtype)
    by_error = -octonion.pinv[..., None, :, :, :] @ by_error
    of_sigma = _in_a_row(by_error.reshape(*by_error.shape[:-3], 8, 12)) * A.dtype.type(np.sqrt(0.5))
    return Linear(of_sigma, _pose_by_octonion(_sigma(octonion.q), scale))


def _in_a_row(D: Real) -> Real:
    """(..., N, k, 12) -> (..., k, 12 N)"""
    D = np.moveaxis(D, -3, -2)
    return np.asarray(D.reshape(*D.shape[:-2], -1))


def _pose_by_octonion(sigma: Real, scale: np.floating[Any]) -> Real:
    """``d xi_X / d sigma`` (..., 6, 8) from ``delta c_i = 2 P_i delta sigma`` (55), ``tau = d delta c_4`` (59)."""
    R = closed_form.sigma_to_R(sigma)[..., :3, :3]
    P = (closed_form.P_1, closed_form.P_2, closed_form.P_3, closed_form.P_4)
    columns = 2 * np.stack([P_i(sigma)[..., :3, :] for P_i in P], axis=-3)  # (..., column, row, 8)
    dR_Rt = np.einsum("...jia,...kj->...ika", columns[..., :3, :, :], R)
    axial = dR_Rt[..., *_UPPER, :] - dR_Rt[..., *_LOWER, :]
    return np.concatenate([axial / 2, scale * columns[..., 3, :, :]], axis=-2)


def limit(A: Real, B: Real) -> Real:
    """X for d to infinity (T2)."""
    u, w, v, z = (f(T) for T in (A, B) for f in (closed_form.u, closed_form.w))
    R = _nearest(u.mT @ v)
    p, q = v @ R.mT, z @ R.mT
    h = (np.cross(w, p) + np.cross(u, q)).sum(axis=-2)
    return _pose(R, -np.linalg.solve(_spread(u, p), h[..., None])[..., 0])


def _spread(u: Real, p: Real) -> Real:
    """``M = tr(G) I - G``, ``G = sym(sum u p^T)``."""
    G = u.mT @ p
    G = (G + G.mT) / 2
    return np.asarray(np.trace(G, axis1=-2, axis2=-1)[..., None, None] * np.eye(3, dtype=G.dtype) - G)


def limit_covariance(A: Real, B: Real, X: Real, deviations: Real) -> Real:
    """First order at the limit (T3): (..., 6, 6); arguments as for `linear`."""
    u, w, v, z = (f(T) for T in (A, B) for f in (closed_form.u, closed_form.w))
    R, t = X[..., None, :3, :3], _skew(X[..., None, :3, 3])
    p, q = (R @ v[..., None])[..., 0], (R @ z[..., None])[..., 0]
    U, W, P, Q = _skew(u), _skew(w), _skew(p), _skew(q)
    du, dw, dv, dz = (f(T) for T in (A, B) for f in (closed_form.du_dxi, closed_form.dw_dxi))
    dp, dq = R @ dv, R @ dz
    # f = sum u x p and h = sum( u x (t x p) + w x p + u x q ), by the data and by a turn of p and q
    f = np.concatenate([-P @ du, U @ dp], axis=-1)
    h = np.concatenate([-(_skew((t @ p[..., None])[..., 0]) + Q) @ du - P @ dw, (U @ t + W) @ dp + U @ dq], axis=-1)
    h_theta = -((U @ t + W) @ P + U @ Q).sum(axis=-3)
    white = np.concatenate([deviations, deviations]).astype(A.dtype)
    M = _spread(u, p)
    theta = -np.linalg.solve(M, _in_a_row(f * white))
    D = np.concatenate([theta, -np.linalg.solve(M, _in_a_row(h * white) + h_theta @ theta)], axis=-2)
    return gram(D)


def _skew(v: Real) -> Real:
    S = np.zeros((*v.shape, 3), v.dtype)
    S[..., *_UPPER], S[..., *_LOWER] = v, -v
    return S
