"""Derivatives of 4DPA's X by the errors of its data, in the limit (T2, T3) and at finite d (39)-(48).

Model: the data carry ``xi = (theta, tau)`` (left rotation, additive translation, rad and m), X carries ``xi_X`` in
the same convention in the frame of A. Both classes give, block by block of pairs,

    F (2, 6, 6, T, m)     for robot and camera, trials T, pairs m: derivatives by xi of the motion of that pair
    Q (T, 6, 6)           such that  Sigma_X = Q (sum over pairs of F Sigma F^T) Q^T     to first order

Pairs come last because NumPy is fastest on long rows.

The limit. With B carried into the frame of A by X (``R_B' = R R_B R^T``, ``t_B' = R t_B``), ``u, w`` of A and
``p = R v, q = R z`` of B, the estimate solves

    f = sum u x p = 0,     h = sum( u x (t x p) + w x p + u x q ) = 0

and ``df = M theta_X + sum f_i xi_i``, ``dh = M tau_X + h_theta theta_X + sum h_i xi_i`` vanish, so that with
``F_i = [f_i; h_i]``

    Q = [[-M^-1, 0], [M^-1 h_theta M^-1, -M^-1]]

At finite d, F is the derivative of X itself through the octonion, and Q the unit matrix.

The paper's covariances at finite d: Sigma_sigma (42)-(48), and Sigma_R, Sigma_t and cross terms (53)-(59), (66).

Model: E = F2(A), Z = F2(B) on SO(4) carry the errors of A and B; the octonion ``sigma = (q_L, q_R)/sqrt(2)`` moves by
``delta q_L = -(F11 - lambda_min I)^+ delta F11 q_L`` (39), (44) and alike for q_R, to first order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, NoReturn

import numpy as np

from ...core.geometry.checks import as_numbers, as_transforms, entry_rows, surely_transforms
from ...core.geometry.se3 import Array, skew, vee
from ...core.runtime.read_only import scratch
from ...errors import DegenerateMotionError, require_type
from ...model.noise.models import PairNoise, require_count
from .. import _closed_form
from .limit import (
    DEGENERATE,
    NO_ROTATION,
    Scaled,
    Suspicious,
    are_determined,
    as_pairs,
    infinite_directions,
    name_axis,
    octonion,
    pair_blocks,
    solve_scaled,
)

_EYE = np.eye(3)


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
        lost = values[trial] <= max(DEGENERATE * values[trial, 0], NO_ROTATION * N)
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


class Linearised(NamedTuple):
    """Quantities that the derivatives at finite d need, for trials T."""

    sigma: Array  # (T, 8)
    pinv: Array  # (T, 2, 4, 4): (F11 - lambda_min I)^+ and that of F22
    to_X: Array  # (T, 6, 8): d xi_X / d sigma
    scale: float


def linearised(solution: Scaled, X: Array | None, scale: float) -> Linearised:
    """Linearise at the solution, or at X (T, 4, 4) where it is given."""
    sigma = solution.sigma.reshape(-1, 8) if X is None else octonion(X, scale)
    pinv = np.stack([solution.pinv_L.reshape(-1, 4, 4), solution.pinv_R.reshape(-1, 4, 4)], axis=1)
    return Linearised(sigma, pinv, pose_from_octonion_jacobian(sigma, scale), scale)


class ScaledDerivatives:
    """Derivatives of X at finite d through the octonion, (39)-(48) and (53)-(59), for some of the trials."""

    def __init__(self, at: Linearised, trials: slice) -> None:
        self.sigma, self.pinv, self.to_X, self.scale = (
            at.sigma[trials],
            at.pinv[trials],
            at.to_X[trials],
            at.scale,
        )

    def by_image(self, A: Array, B: Array) -> Array:
        """``d sigma / d b`` with ``b = (vec E, vec Z)`` (45): (T, m, 8, 32)."""
        E, Z = _closed_form.F2(A, self.scale), _closed_form.F2(B, self.scale)
        q = np.sqrt(2.0) * self.sigma[:, None]
        result = np.empty((*A.shape[:2], 8, 32))
        # (39) with M = -F11: delta q = -(F11 - lambda I)^+ (q^T kron I) delta vec(F11), and sigma = q / sqrt(2)
        result[..., :4, :] = self.pinv[:, None, 0] @ _closed_form.dF11q_db(E, Z, q[..., :4])
        result[..., 4:, :] = self.pinv[:, None, 1] @ _closed_form.dF22q_db(E, Z, q[..., 4:])
        result *= -np.sqrt(0.5)
        return result

    def of_octonion(self, A: Array, B: Array) -> Array:
        """``d sigma / d xi``: (2, T, m, 8, 6)."""
        by_image = self.by_image(A, B)
        return np.stack(
            [
                by_image[..., :16] @ _closed_form.dF2_dxi(A, self.scale),
                by_image[..., 16:] @ _closed_form.dF2_dxi(B, self.scale),
            ]
        )

    def block(self, A: Array, B: Array, pairs: slice) -> Array:
        return np.moveaxis(self.to_X[:, None] @ self.of_octonion(A, B), (3, 4), (1, 2))

    def weight(self, N: int) -> Array:
        return np.broadcast_to(np.eye(6), (len(self.sigma), 6, 6))


def columns_by_octonion(sigma: Array) -> Array:
    """P_1 .. P_4, (..., 8) -> (..., 4, 4, 8): c_i = P_i sigma (20), delta c_i = 2 P_i delta sigma (55)."""
    factors = (_closed_form.P_1, _closed_form.P_2, _closed_form.P_3, _closed_form.P_4)
    return np.stack([P(sigma) for P in factors], axis=-3)


def pose_from_octonion_jacobian(sigma: Array, scale: float) -> Array:
    """``d xi_X / d sigma``, (..., 8) -> (..., 6, 8), from ``delta c_i = 2 P_i(sigma) delta sigma`` (55).

    The columns c_1, c_2, c_3 hold the rotation, ``[theta]x = dR R^T``; the fourth holds the translation,
    ``tau = d delta c_4`` (59).
    """
    R = _closed_form.sigma_to_R(sigma)[..., :3, :3]
    by_octonion = 2.0 * columns_by_octonion(sigma)[..., :3, :]  # (..., column, row, 8)
    dR = by_octonion[..., :3, :, :].swapaxes(-3, -2)
    dR_Rt = np.einsum("...ija,...kj->...ika", dR, R)
    J = np.empty((*sigma.shape[:-1], 6, 8))
    J[..., 0, :] = 0.5 * (dR_Rt[..., 2, 1, :] - dR_Rt[..., 1, 2, :])
    J[..., 1, :] = 0.5 * (dR_Rt[..., 0, 2, :] - dR_Rt[..., 2, 0, :])
    J[..., 2, :] = 0.5 * (dR_Rt[..., 1, 0, :] - dR_Rt[..., 0, 1, :])
    J[..., 3:, :] = scale * by_octonion[..., 3, :, :]
    return J


# The scaling factor of the paper's experiments, used where a formula exists at finite d only.
PAPER_SCALE = 1e4
# Pairs whose derivatives are held at once: about 6 kB each.
BLOCK = 1024


class OctonionCovariance(NamedTuple):
    """The octonion of X and its covariance at finite d."""

    sigma: Array  # (..., 8): (q_L, q_R) / sqrt(2)  (18)
    covariance: Array  # (..., 8, 8): (48), of sigma itself


def octonion_covariance(
    A: Any, B: Any, noise: PairNoise, *, scale: float = PAPER_SCALE, literal: bool = False
) -> OctonionCovariance:
    """Sigma_sigma (42)-(48): both diagonal blocks and the cross block (46)-(47), for independent pairs.

    The sum over pairs is ``sum_i D_i Sigma_i D_i^T``; ``literal=True`` takes the averaged derivative and one
    shared Sigma_b of (45) instead. The paper's blocks are those of (q_L, q_R); sigma carries the factor
    1/sqrt(2) of (18), its covariance 1/2, which (48) leaves out and (55) needs.

    Parameters
    ----------
    A, B : (..., N, 4, 4)
    noise : PairNoise
    scale : float
        The scaling factor d.
    """
    require_type("noise", noise, PairNoise, "PairNoise")
    A, B = as_pairs(A, B)
    require_count(noise.A, A.shape[-3], "A", "motions")
    require_count(noise.B, A.shape[-3], "B", "motions")
    solution = solve_scaled(A, B, scale)
    total = literal_sum if literal else _octonion_sum
    S = _per_trial(A, B, noise, linearised(solution, None, scale), total)
    return OctonionCovariance(solution.sigma, S.reshape(*A.shape[:-3], 8, 8))


def literal_covariance(A: Array, B: Array, noise: PairNoise, X: Array | None, scale: float) -> Array:
    """Sigma_X (T, 6, 6) through (45) as printed; A, B (..., N, 4, 4) and X (T, 4, 4) or None to solve for it."""
    at = linearised(solve_scaled(A, B, scale), X, scale)
    S = _per_trial(A, B, noise, at, literal_sum)
    return np.asarray(at.to_X @ S @ at.to_X.mT)


def _per_trial(
    A: Array,
    B: Array,
    noise: PairNoise,
    at: Linearised,
    total: Callable[[ScaledDerivatives, Array, Array, PairNoise], Array],
) -> Array:
    flat_A, flat_B = (T.reshape(-1, *T.shape[-3:]) for T in (A, B))
    trials = [slice(k, k + 1) for k in range(len(flat_A))]
    return np.array([total(ScaledDerivatives(at, k), flat_A[k], flat_B[k], noise) for k in trials]).reshape(-1, 8, 8)


def _octonion_sum(derivatives: ScaledDerivatives, A: Array, B: Array, noise: PairNoise) -> Array:
    S = np.zeros((8, 8))
    for pairs in pair_blocks(A.shape[1], BLOCK):
        by_pair = derivatives.of_octonion(A[:, pairs], B[:, pairs])[:, 0]
        for D, covariance in zip(by_pair, (noise.A, noise.B), strict=True):
            if covariance is not None:
                S += (D @ (covariance if covariance.ndim == 2 else covariance[pairs]) @ D.mT).sum(axis=0)
    return S


def literal_sum(derivatives: ScaledDerivatives, A: Array, B: Array, noise: PairNoise) -> Array:
    """(45): ``D Sigma_b D^T`` with the mean derivative by b and the mean covariance of b over the pairs."""
    N = A.shape[1]
    D, S_b = np.zeros((8, 32)), np.zeros((32, 32))
    for pairs in pair_blocks(N, BLOCK):
        D += derivatives.by_image(A[:, pairs], B[:, pairs])[0].sum(axis=0) / N
        for k, (T, covariance) in enumerate(((A, noise.A), (B, noise.B))):
            if covariance is not None:
                J = _closed_form.dF2_dxi(T[0, pairs], derivatives.scale)
                half = slice(16 * k, 16 * k + 16)
                S_b[half, half] += (J @ (covariance if covariance.ndim == 2 else covariance[pairs]) @ J.mT).sum(
                    axis=0
                ) / N
    return D @ S_b @ D.T


class PaperCovariances(NamedTuple):
    """Covariances that (53)-(59) read off Sigma_sigma."""

    R4: Array  # (..., 4, 4): <dR4 dR4^T> on SO(4) (56)
    R: Array  # (..., 3, 3): Sigma_R = <dR dR^T> (58) = tr(Sigma_theta) I - Sigma_theta
    t: Array  # (..., 3, 3): Sigma_t (59)
    R_t: Array  # (..., 3, 3, 3): [i] = <delta R_column_i delta t^T>, d times the blocks c_i, c_4 of (55)


def paper_covariances(sigma: Array, covariance_sigma: Array, scale: float) -> PaperCovariances:
    """Sigma_R, Sigma_t and the rotation-translation cross terms from Sigma_sigma (55)-(59)."""
    P = columns_by_octonion(sigma)
    S = np.asarray(covariance_sigma)[..., None, :, :]
    R4 = 4.0 * (P @ S @ P.mT).sum(axis=-3)  # (56)
    cross = 4.0 * (P[..., :3, :, :] @ S @ P[..., 3:, :, :].mT)  # (55) with i = 1, 2, 3 and j = 4
    Sigma_t = 4.0 * scale**2 * (P[..., 3, :, :] @ np.asarray(covariance_sigma) @ P[..., 3, :, :].mT)
    Sigma_t = 0.5 * (Sigma_t + Sigma_t.mT)  # symmetric to rounding, which d^2 enlarges
    return PaperCovariances(R4, R4[..., :3, :3], Sigma_t[..., :3, :3], scale * cross[..., :3, :3])


def so4_covariance(X: Array, covariance: Array, scale: float) -> Array:
    """``<dR4 dR4^T>`` of ``R4 = F2(X, d)`` from the 6x6 covariance of X: (65)-(66), (..., 4, 4).

    Exact to first order in the errors. The approximation printed in (66) drops the term of
    ``<theta x tau>``, and (65) prints ``t^T dt`` where ``dt^T dt`` is meant.
    """
    covariance = as_numbers(covariance, "covariance")
    t = as_transforms(X, "X", stack=False)[..., :3, 3]
    theta, tau = covariance[..., :3, :3], covariance[..., 3:, 3:]
    cross = covariance[..., :3, 3:]
    Sigma_R = np.trace(theta, axis1=-2, axis2=-1)[..., None, None] * _EYE - theta
    twist = vee(cross.mT)  # <theta x tau>
    Rt = (Sigma_R @ t[..., None])[..., 0]
    result = np.empty((*covariance.shape[:-2], 4, 4))
    result[..., :3, :3] = Sigma_R + tau / scale**2
    result[..., :3, 3] = result[..., 3, :3] = -(twist + Rt) / scale
    result[..., 3, 3] = (
        np.trace(tau, axis1=-2, axis2=-1) + 2.0 * np.sum(t * twist, axis=-1) + np.sum(t * Rt, axis=-1)
    ) / scale**2
    return result
