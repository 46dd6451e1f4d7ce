"""Derivatives of X by the errors of its data, in the limit of an infinite scaling factor (T2, T3).

Model: the data carry ``xi = (theta, tau)`` (left rotation, additive translation, rad and m), X carries ``xi_X`` in
the same convention in the frame of A. `LimitDerivatives` (`ScaledDerivatives` at a finite d) give by blocks of pairs

    F (2, 6, 6, T, m)     for robot and camera, trials T, pairs m: derivatives by xi of the motion of that pair
    Q (T, 6, 6)           such that  Sigma_X = Q (sum over pairs of F Sigma F^T) Q^T     to first order

Pairs come last because NumPy is fastest on long rows. With B carried into the frame of A by X (``R_B' = R R_B R^T``,
``t_B' = R t_B``), ``u, w`` of A and ``p = R v, q = R z`` of B, the estimate solves

    f = sum u x p = 0,     h = sum( u x (t x p) + w x p + u x q ) = 0

and ``df = M theta_X + sum f_i xi_i``, ``dh = M tau_X + h_theta theta_X + sum h_i xi_i`` vanish, so that with
``F_i = [f_i; h_i]``

    Q = [[-M^-1, 0], [M^-1 h_theta M^-1, -M^-1]]
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from ..core.geometry.checks import entry_rows, surely_transforms
from ..core.geometry.se3 import Array, skew
from ..core.scratch import scratch
from ..errors import DegenerateMotionError
from .degeneracy import MIN_SPREAD_RATIO, NO_ROTATION, are_determined, infinite_directions, name_axis
from .limit import Suspicious


class LimitDerivatives:
    """Raw derivatives of f and h (T2) for X (T, 4, 4)."""

    def __init__(self, X: Array, checked: bool) -> None:
        self.checked = checked
        self.R, self.t = X[:, :3, :3], X[:, :3, 3]
        self.G = np.zeros((len(X), 3, 3))  # sum u p^T
        self.h_theta = np.zeros((len(X), 3, 3))

    def block(self, A: Array, B: Array, pairs: slice) -> Array:
        T, m = A.shape[:2]
        rows = entry_rows(A.reshape(-1, 4, 4), B.reshape(-1, 4, 4), out=scratch("rows", 16, 2 * T * m))
        if not self.checked and not surely_transforms(rows):
            raise Suspicious
        entries = rows.reshape(4, 4, 2, T, m)
        R, t = entries[:3, :3], entries[:3, 3]
        # B in the frame of A: R_B' = R_X R_B R_X^T, t_B' = R_X t_B
        turned = np.einsum("tij,jktm->iktm", self.R, R[:, :, 1])
        np.einsum("tkj,ijtm->iktm", self.R, turned, out=R[:, :, 1])
        t[:, 1] = np.einsum("tij,jtm->itm", self.R, t[:, 1])
        u = np.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        w = np.einsum("ij...,i...->j...", R, t)
        w += t
        u *= 0.5  # u and p: axis 1 is robot, camera
        w *= 0.5  # w and q
        # [D S E] with du = D theta, dw = E theta + S tau (T3)
        half = np.multiply(R, 0.5, out=scratch("half", 3, 3, 2, T, m))
        by_motion = scratch("by_motion", 3, 9, 2, T, m)
        D, S = by_motion[:, :3], by_motion[:, 3:6]
        np.negative(half, out=D)
        S[:] = half.swapaxes(0, 1)
        half_trace = half[0, 0] + half[1, 1] + half[2, 2]
        for i in range(3):
            D[i, i] += half_trace
            S[i, i] += 0.5
        # f = u x p and h = u x (t x p) + w x p + u x q, differentiated by w and q, and by u and p
        t_X = skew(self.t)
        vectors = scratch("vectors", 3, 7, T, m)
        vectors[:, :2] = t
        np.negative(u[:, 1], out=vectors[:, 2])
        vectors[:, 3] = u[:, 0]
        np.einsum("tij,jtm->itm", t_X, vectors[:, 2], out=vectors[:, 4])
        vectors[:, 4] -= w[:, 1]
        vectors[:, 5:] = w
        crosses = cross_rows(vectors, out=scratch("crosses", 3, *vectors.shape))
        by_t, by_w, by_u, by_q = crosses[:, :, :2], crosses[:, :, 2:4], crosses[:, :, 4:6], crosses[:, :, 6]
        by_u[:, :, 1] += np.einsum("ijtm,tjk->iktm", by_w[:, :, 1], t_X)
        np.einsum("ij...,jk...->ik...", half.swapaxes(0, 1), by_t, out=by_motion[:, 6:])
        F = scratch("F", 2, 6, 6, T, m)
        F_rows = F.transpose(1, 2, 0, 3, 4)
        F_rows[:3, 3:] = 0.0
        product = scratch("product", *by_motion.shape)
        np.einsum("ij...,jk...->ik...", by_w, by_motion, out=product)
        F_rows[:3, :3], F_rows[3:, 3:] = product[:, :3], product[:, 3:6]
        np.einsum("ij...,jk...->ik...", by_u, D, out=F_rows[3:, :3])
        F_rows[3:, :3] += product[:, 6:]
        # From the frame of A back to that of B.
        F[1] = np.einsum("ajtm,tjk->aktm", F[1].reshape(12, 3, T, m), self.R).reshape(6, 6, T, m)
        self.G += u[:, 0].swapaxes(0, 1) @ u[:, 1].transpose(1, 2, 0)
        # h_theta = -sum( ([u][t] + [w]) [p] + [u] [q] ), and [p]^T = -[p]
        self.h_theta -= trials_first(by_u[:, :, 1]) @ trials_first(by_w[:, :, 0]).mT
        self.h_theta += trials_first(by_w[:, :, 1]) @ trials_first(by_q).mT
        return F

    def weight(self, N: int) -> Array:
        return weight_of_sums(self.G, self.h_theta, N)


def weight_of_sums(G: Array, h_theta: Array, N: int) -> Array:
    """Q (T, 6, 6) from ``G = sum u p^T`` and h_theta (T, 3, 3) of N pairs; raises where M is singular."""
    # M = tr(G) I - sym(G) has the eigenvectors of sym(G).
    values, vectors = np.linalg.eigh(0.5 * (G + G.mT))
    values = np.add.reduce(values, axis=-1, keepdims=True) - values  # descending
    if not (determined := are_determined(values[:, 2], values[:, 0], N)).all():
        trial = int(np.argmin(determined))
        lost = values[trial] <= max(MIN_SPREAD_RATIO * values[trial, 0], NO_ROTATION * N)
        _raise_infinite(vectors[trial].T[lost])
    M_inverse = (vectors / values[:, None, :]) @ vectors.mT
    Q = np.zeros((len(values), 6, 6))
    np.matmul(M_inverse @ h_theta, M_inverse, out=Q[:, 3:, :3])
    Q[:, :3, :3] = Q[:, 3:, 3:] = -M_inverse
    return Q


def _raise_infinite(axes: Array) -> NoReturn:
    named = " and ".join(name_axis(axis) for axis in axes)
    raise DegenerateMotionError(
        "The motions do not determine X, or `X` does not belong to them: the variance of its rotation about, and of "
        f"its translation along, {named} in the frame of `A` is infinite.",
        infinite_directions(axes),
    )


def cross_rows(v: Array, out: Array | None = None) -> Array:
    """``[v]x`` with the vectors along the first axis: (3, ...) -> (3, 3, ...)."""
    result = np.empty((3, *v.shape)) if out is None else out
    result[0, 0] = result[1, 1] = result[2, 2] = 0.0
    result[2, 1], result[0, 2], result[1, 0] = v
    result[1, 2], result[2, 0], result[0, 1] = -v
    return result


def trials_first(rows: Array) -> Array:
    """(k, l, T, m) -> (T, k, l m), for sums over pairs as one product per trial."""
    k, _, T, _ = rows.shape
    return rows.transpose(2, 0, 1, 3).reshape(T, k, -1)
