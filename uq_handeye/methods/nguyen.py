"""Nguyen and Pham's iterative estimate of X with the covariances of its rotation and of its translation.

Model: ``A_k X = X B_k`` (``X = gripper_T_camera`` for eye-in-hand, A the motions of the robot, B of the camera). The
data carry Gaussian errors ``xi = (theta, tau)``: left rotation in rad, additive translation in the length unit of the
data, independent from pair to pair. Two errors-in-variables problems, one after the other (T6 in the theory page),

    rotation      measured alpha_k, beta_k (rotation vectors of A and B);        alpha_k = R beta_k
    translation   measured R_Ak (refined by the rotation), q_k = R t_Bk - t_Ak;  q_k = (R_Ak - I) t

each with one latent quantity per pair: the true ``beta_k``, then the true ``R_Ak``. The published Gauss-Newton
iterations carry the latents along and eliminate them by a Schur complement; here it is done in closed form. With

    S_a = J_l(alpha)^-1 Sigma_RA J_l(alpha)^-T (S_b alike),   Q = S_a + R S_b R^T,   r = alpha - R beta

the true ``alpha`` given R is ``a = alpha - S_a Q^-1 r``, and the Schur complement is the information

    F = sum [a]x^T Q^-1 [a]x,     theta = F^-1 sum a x Q^-1 r,     Sigma_R = F^-1

The refined ``R_Ak = exp([a_k]x)`` has the left error ``phi_k``. With ``v = R_Ak t``, ``e = q - (R_Ak - I) t`` and ``V =
[v]x`` the residual of the second stage has the covariance

    P = Cov(e) = Cov(q) + V Cov(phi) V^T + Cov(q, phi) V^T + V Cov(phi, q)
    T = sum (R_Ak - I)^T P^-1 (R_Ak - I),     Sigma_t = T^-1

As in the publication, the correlation of rotation and translation within the covariance of a motion is ignored when
weighting, the pairs are taken as independent, though all q_k share the error of R, and no cross-covariance of rotation
and translation is given. `NguyenDerivatives`, the derivatives of X by the data, ignores none of the three: any
covariance of the motions may be put through it. The stages are in `nguyen_stages`, their iteration in `gauss_newton`.

Source: H. Nguyen, Q.-C. Pham, "On the covariance of X in AX = XB", IEEE Trans. Robotics 34 (2018),
doi:10.1109/TRO.2018.2861905, arXiv:1706.03498.

Motions by exactly 180 degrees are singular: their axis has no sign.
"""

from __future__ import annotations

from collections.abc import Callable
from types import NoneType

import numpy as np

from ..core.geometry.checks import as_transforms
from ..core.geometry.packed3x3 import EYE, cross, product, unpack
from ..core.geometry.se3 import Array, pose
from ..core.iterations import MAX_STEPS
from ..errors import InputError, require_type
from ..model.errors.models import PairNoise, require_count
from .gauss_newton import PUBLISHED_ITERATIONS, Stop
from .method import Derivatives, Estimate, Functions, Method, published
from .nguyen_stages import (
    CrossTerm,
    Moved,
    NguyenResult,
    at_rotation,
    covariance_of,
    measured,
    refined_rotations,
    residual_covariance,
    rotation_stage,
    starting_rotation,
    translation_data,
    translation_stage,
    typical_length,
    weights,
)
from .pairs import MotionsLike, as_pairs, trial_blocks


def covariances_at(
    A: Array, B: Array, X: Array, noise: PairNoise | None, cross_term: CrossTerm = "derived"
) -> NguyenResult:
    """Return the covariances that `NguyenDerivatives` needs at a known X (T, 4, 4) of checked motions (T, N, 4, 4): no
    iteration.
    """
    parts = []
    for trials in trial_blocks(len(A), A.shape[1]):
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


def nguyen(
    A: MotionsLike,
    B: MotionsLike,
    noise: PairNoise | None = None,
    *,
    cross_term: CrossTerm = "derived",
    stop: Stop = "scaled",
    max_iterations: int = MAX_STEPS,
) -> NguyenResult:
    """X from ``A_k X = X B_k`` by Nguyen and Pham's two stages, weighted by the noise.

    Parameters
    ----------
    A, B : (..., N, 4, 4)
        Motions of robot and camera; leading axes are independent problems and broadcast.
    noise : PairNoise or None
        The 3x3 blocks of rotation and of translation are used; their correlation is ignored, as published. None is
        isotropic noise, equal on A and B, with the root mean square translation of the data times as much
        standard deviation in translation as in rotation: no unit enters.
    cross_term : "derived" or "published"
        ``Cov(q_k, phi_k)``: as derived, or with the opposite sign and ``R t_A`` in place of ``R t_B``.
    stop : "scaled" or "published"
        ``scaled`` ends at steps below 1.5e-8 standard deviations, whatever the units, or where steps shrink so fast
        that the next one would be, with damped steps where a full one would raise the sum of squares. ``published``
        ends at steps below 1e-10 rad, then 1e-5 in the length unit of the data, after 10 undamped iterations at most.
    max_iterations : int
        Per stage, for ``scaled``.

    Returns
    -------
    NguyenResult
        X, Sigma_R, Sigma_t, iterations, converged, length. A problem that did not converge has ``converged`` False
        and the last iterate. Without a noise model both covariances are in units of the unknown variance of a rotation.

    Raises
    ------
    InputError
        Wrong shapes, values or options; a noise model with which a residual has no error in some direction.
    DegenerateMotionError
        The motions do not determine X: parallel rotation axes or no rotation.
    """
    if cross_term not in ("derived", "published"):
        raise InputError(f"Expected `cross_term` to be 'derived' or 'published', got {cross_term!r}.")
    if stop not in ("scaled", "published"):
        raise InputError(f"Expected `stop` to be 'scaled' or 'published', got {stop!r}.")
    if max_iterations < 1:
        raise InputError(f"Expected `max_iterations` to be at least 1, got {max_iterations!r}.")
    A, B = as_pairs(A, B)
    A, B = as_transforms(A, "A"), as_transforms(B, "B")
    batch, N = A.shape[:-3], A.shape[-3]
    require_type("noise", noise, (PairNoise, NoneType), "PairNoise or None")
    if noise is not None:
        require_count(noise.A, N, "A", "motions")
        require_count(noise.B, N, "B", "motions")
    flat_A, flat_B = A.reshape(-1, N, 4, 4), B.reshape(-1, N, 4, 4)
    most = PUBLISHED_ITERATIONS if stop == "published" else int(max_iterations)
    parts = [
        _solve(flat_A[trials], flat_B[trials], noise, cross_term, stop, most, trials.start, batch)
        for trials in trial_blocks(len(flat_A), N)
    ]
    joined = parts[0] if len(parts) == 1 else NguyenResult(*map(np.concatenate, zip(*parts, strict=True)))
    return NguyenResult(*(part.reshape((*batch, *part.shape[1:])) for part in joined))


def _solve(
    A: Array,
    B: Array,
    noise: PairNoise | None,
    cross_term: CrossTerm,
    stop: Stop,
    most: int,
    first: int,
    batch: tuple[int, ...],
) -> NguyenResult:
    T = len(A)
    length = np.ones(T) if noise is not None else typical_length(A, B)
    data = measured(A, B, noise, length)
    R = starting_rotation(data, first, batch)
    turn = rotation_stage(data, R, stop, most)
    refined = refined_rotations(data.S_a, turn.a, turn.W)
    moved = translation_data(data, turn.R, refined, covariance_of(turn.F), cross_term)
    shift = translation_stage(moved, stop, most, cross_term)
    return NguyenResult(
        pose(turn.R, shift.t),
        moved.Sigma_R,
        shift.Sigma_t,
        np.stack([turn.iterations, shift.iterations], axis=-1),
        turn.converged & shift.converged,
        length,
    )


def _by_default(A: Array, B: Array, noise: PairNoise | None) -> Estimate:
    result = nguyen(A, B, noise)
    return Estimate(result.X, result.converged, result.iterations.sum(axis=-1))


def _derivatives(A: Array, B: Array, noise: PairNoise | None, X: Array) -> Callable[[slice], Derivatives]:
    at = covariances_at(A, B, X, noise, "derived")
    return lambda trials: NguyenDerivatives(at, noise, trials)


METHOD = Method(
    **published("nguyen"),
    solver=Functions(_by_default, _derivatives),
    mathematics=__doc__,
    weighted=True,
)
