"""The covariance of Nguyen and Pham's X to first order, with the correlations that the method itself ignores.

Model and notation as in `nguyen`: that module's Sigma_R and Sigma_t are the method's own; here are the derivatives of
its X by the data, through which any covariance of the motions may be put.
"""

from __future__ import annotations

import numpy as np

from ....core.geometry.packed3x3 import EYE, cross, product, unpack
from ....core.geometry.se3 import Array
from ....model.noise.models import PairNoise
from ...procrustes.limit import trial_blocks
from .stages import (
    BLOCK,
    CrossTerm,
    Moved,
    NguyenResult,
    at_rotation,
    covariance_of,
    measured,
    refined_rotations,
    residual_covariance,
    translation_data,
    typical_length,
    weights,
)


def covariances_at(
    A: Array, B: Array, X: Array, noise: PairNoise | None, cross_term: CrossTerm = "derived"
) -> NguyenResult:
    """Return the covariances that `NguyenDerivatives` needs at a known X (T, 4, 4) of checked motions (T, N, 4, 4): no
    iteration.
    """
    parts = []
    for trials in trial_blocks(len(A), A.shape[1], BLOCK):
        length = np.ones(len(X[trials])) if noise is not None else typical_length(A[trials], B[trials])
        R, t = X[trials, :3, :3], X[trials, :3, 3]
        data = measured(A[trials], B[trials], noise, length, R=R)
        _, _, information, a, W = at_rotation(data, R)
        Sigma_R = covariance_of(information)
        refined = refined_rotations(data.S_a, a, W)
        D, _, W_t = _translation_residual(translation_data(data, R, refined, Sigma_R, cross_term), t, cross_term)
        Sigma_t = covariance_of(np.einsum("tijm,tikm->tjk", D, product(W_t, D)))
        parts.append((Sigma_R, Sigma_t, length))
    Sigma_R, Sigma_t, length = map(np.concatenate, zip(*parts, strict=True))
    return NguyenResult(X, Sigma_R, Sigma_t, np.zeros((len(X), 2), np.intp), np.ones(len(X), dtype=bool), length)


def _translation_residual(moved: Moved, t: Array, cross_term: CrossTerm) -> tuple[Array, Array, Array]:
    """``R_A - I``, V and ``P^-1`` of the second stage at t, (T, 3, 3, m) each."""
    V = cross(np.einsum("tijm,tj->tim", moved.R_A, t))
    P, _ = residual_covariance(moved, V)
    W, _ = weights(P, "translation", cross_term == "derived")
    return moved.R_A - EYE[:, :, None], V, unpack(W)


class NguyenDerivatives:
    """First-order sensitivities of X to the data at a result for trials T: ``Sigma_X = Q (sum F Sigma F^T) Q^T``.

    The estimate solves ``f = sum a x Q^-1 r = 0`` and ``h = sum (R_A - I)^T P^-1 e = 0``. With weights held fixed
    (their derivatives multiply residuals: second order), ``d alpha = J_l(alpha)^-1 theta_A``, d beta alike, and
    ``K = S_a Q^-1``, the parts of one pair are

        f_k = [a]x Q^-1 (d alpha - R d beta)
        h_k = (R_A - I)^T P^-1 ( R tau_B - tau_A + V J_l(a) ((I - K) d alpha + K R d beta) )

    and ``theta_R = F^-1 sum f_k``, ``tau = T^-1 (sum h_k + H theta_R)``; the error of R enters all e_k,

        H = sum (R_A - I)^T P^-1 ( -[R t_B]x - V J_l(a) K [a]x )

    so that ``Q = [[F^-1, 0], [T^-1 H F^-1, T^-1]]``. Full covariances of the motions, their correlation of rotation and
    translation included, and errors that pairs share may be put through F.
    """

    def __init__(
        self,
        result: NguyenResult,
        noise: PairNoise | None,
        trials: slice = slice(None),
        cross_term: CrossTerm = "derived",
    ) -> None:
        X = result.X.reshape(-1, 4, 4)[trials]
        self.R, self.t = X[:, :3, :3], X[:, :3, 3]
        self.Sigma_R = result.Sigma_R.reshape(-1, 3, 3)[trials]
        self.length = result.length.reshape(-1)[trials]
        self.noise, self.cross_term = noise, cross_term
        self.sums = np.zeros((3, len(X), 3, 3))  # F, T and H

    def block(self, A: Array, B: Array, pairs: slice = slice(None)) -> Array:
        """F (2, 6, 6, T, m) of motions (T, m, 4, 4), which are ``pairs`` of all."""
        data = measured(A, B, self.noise, self.length, pairs, self.R)
        _, _, information, a, W = at_rotation(data, self.R)
        refined = refined_rotations(data.S_a, a, W)
        moved = translation_data(data, self.R, refined, self.Sigma_R, self.cross_term)
        D, V, W_t = _translation_residual(moved, self.t, self.cross_term)
        D_W = product(D.swapaxes(1, 2), W_t)
        by_phi = product(D_W, V)
        by_latent = product(by_phi, refined.J)
        by_difference = product(cross(a), W)  # f = sum a x Q^-1 r
        by_measured = product(by_latent, refined.K)
        F = np.zeros((2, 6, 6, *A.shape[:2]))
        rows = F.transpose(0, 3, 1, 2, 4)  # (2, T, 6, 6, m)
        rows[0, :, :3, :3] = product(by_difference, data.J_inverse[0])
        rows[0, :, 3:, :3] = product(by_latent - by_measured, data.J_inverse[0])
        rows[0, :, 3:, 3:] = -D_W
        R_J = np.einsum("tij,tjkm->tikm", self.R, data.J_inverse[1])
        rows[1, :, :3, :3] = -product(by_difference, R_J)
        rows[1, :, 3:, :3] = product(by_measured, R_J)
        rows[1, :, 3:, 3:] = np.einsum("tijm,tjk->tikm", D_W, self.R)
        shared = product(by_phi, refined.by_R) - product(D_W, cross(moved.q + data.t[0]))
        self.sums += [information, np.einsum("tijm,tjkm->tik", D_W, D), shared.sum(axis=-1)]
        return F

    def weight(self, N: int) -> Array:
        """Q (T, 6, 6), after all blocks."""
        F, T, H = self.sums
        Q = np.zeros((len(F), 6, 6))
        Q[:, :3, :3], Q[:, 3:, 3:] = np.linalg.inv(F), np.linalg.inv(T)
        Q[:, 3:, :3] = Q[:, 3:, 3:] @ H @ Q[:, :3, :3]
        return Q
