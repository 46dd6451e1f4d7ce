"""The two stages of Nguyen and Pham's method: the measured data, the rotation, the translation. Model: `nguyen`.

Each stage is a Gauss-Newton iteration with its latents eliminated: `at_rotation` gives gradient and information of the
first at any R, `rotation_stage` iterates it; `refined_rotations` and `translation_data` carry its result and errors
over to `translation_stage`.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.nearest_rotation import orthonormalise
from ..core.geometry.packed3x3 import (
    EYE,
    NotDefinite,
    carried,
    cross,
    exponential,
    inverse_jacobian,
    pack,
    packed_inverse,
    plus_symmetric,
    product,
    product_transposed,
    rotation,
    sum_of_crosses,
    sum_of_informations,
    times,
    unpack,
)
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array, vee
from ..errors import InputError
from ..model.errors.models import PairNoise
from .degeneracy import are_determined, raise_undetermined
from .gauss_newton import Descent, Stop
from .limit import signed_svd
from .quaternions import NEAR_HALF_TURN_RAD

CrossTerm = Literal["derived", "published"]


class NguyenResult(NamedTuple):
    """X with the covariances of its two parts, ``xi = (theta, tau)``: left rotation (rad), additive translation.

    Where no noise model was given, both covariances are in units of the unknown variance of a rotation: multiply them
    by its value in rad^2.
    """

    X: Array  # (..., 4, 4)
    Sigma_R: Array  # (..., 3, 3)
    Sigma_t: Array  # (..., 3, 3)
    iterations: NDArray[np.intp]  # (..., 2): rotation, translation
    converged: NDArray[np.bool_]  # (...): both stages
    length: Array  # (...): without noise model, deviation of a translation over that of a rotation; else 1


# ----------------------------------------------------------------------------- what is measured, and its weights


class Measured(NamedTuple):
    """The data of both stages; S have the trials or the pairs as 1 where they are all equal."""

    alpha: Array  # (T, 3, m)
    beta: Array  # (T, 3, m)
    S_a: Array  # (T, 3, 3, m)
    S_b: Array  # (T, 3, 3, m)
    J_inverse: Array  # (2, T, 3, 3, m): J_l^-1 of alpha and of beta
    t: Array  # (2, T, 3, m)
    S_t: Array  # (2, T or 1, 3, 3, m or 1)

    def take(self, keep: NDArray[np.bool_]) -> Measured:
        """The rotation stage's data of some of the trials."""
        return self._replace(alpha=self.alpha[keep], beta=self.beta[keep], S_a=self.S_a[keep], S_b=self.S_b[keep])


def typical_length(A: Array, B: Array) -> Array:
    """Root mean square translation of each problem, or 1 where there is none."""
    squares = sum(np.einsum("tmi,tmi->t", P[..., :3, 3], P[..., :3, 3]) for P in (A, B)) / (2.0 * A.shape[1])
    return np.asarray(np.sqrt(np.where(squares > 0, squares, 1.0)))


def _blocks_of(noise: PairNoise | None, length: Array, pairs: slice) -> tuple[Array, Array]:
    """Covariances (2, T or 1, 3, 3, m or 1) of the rotations and of the translations of A and B."""
    if noise is None:
        both = np.broadcast_to(EYE[:, :, None], (2, 1, 3, 3, 1))
        return both, both * np.square(length)[:, None, None, None]
    full = [np.zeros((6, 6)) if S is None else S for S in (noise.A, noise.B)]
    rows = [S[:, :, None] if S.ndim == 2 else S[pairs].transpose(1, 2, 0) for S in full]
    stacked = np.stack(np.broadcast_arrays(*rows))[:, None]
    return stacked[:, :, :3, :3], stacked[:, :, 3:, 3:]


def measured(
    A: Array, B: Array, noise: PairNoise | None, length: Array, pairs: slice = slice(None), R: Array | None = None
) -> Measured:
    """The data of motions (T, m, 4, 4); the signs of axes near half turns by R if it is known."""
    T, m = A.shape[:2]
    both = np.stack([A, B])
    vectors = Rotation.from_matrix(both[..., :3, :3].reshape(-1, 3, 3), assume_valid=True).as_rotvec()
    v = np.ascontiguousarray(vectors.reshape(2, T, m, 3).swapaxes(2, 3))
    squares = np.einsum("stim,stim->stm", v, v)
    if squares.max() > NEAR_HALF_TURN_RAD**2:
        _turn_axes(A, B, v, squares, R)
    S_R, S_t = _blocks_of(noise, length, pairs)
    J_inverse = inverse_jacobian(v, squares)
    S = np.einsum("stijm,stkjm->stikm", np.einsum("stijm,stjkm->stikm", J_inverse, S_R), J_inverse)  # T6
    t = np.ascontiguousarray(both[..., :3, 3].swapaxes(2, 3))
    return Measured(v[0], v[1], S[0], S[1], J_inverse, t, S_t)


def _turn_axes(A: Array, B: Array, v: Array, squares: Array, R: Array | None) -> None:
    """Near half turns, take the other rotation vector of B, beyond 180 degrees, if it is the one that fits alpha.

    It is the one for which ``alpha . R beta > 0``, R the rotation that fits the vectors ``sin(angle) axis``, which
    have no ambiguity. Writes to v (2, T, 3, m) and its squared lengths.
    """
    if R is None:
        u, w = vee(A[..., :3, :3]), vee(B[..., :3, :3])
        R = orthonormalise(u.mT @ w)
    opposite = np.einsum("tim,tim->tm", v[0], R @ v[1]) < 0
    angle = np.sqrt(squares[1])
    other = np.where(opposite & (angle > NEAR_HALF_TURN_RAD), 1.0 - 2 * np.pi / np.maximum(angle, 1.0), 1.0)
    v[1] *= other[:, None]
    squares[1] *= other * other


def weights(S: Array, of: str, indefinite_raises: bool = True) -> tuple[Array, NDArray[np.bool_] | None]:
    """Inverses of packed covariances of residuals, see `packed_inverse`; `InputError` if one is singular."""
    try:
        return packed_inverse(S, indefinite_raises)
    except NotDefinite as found:
        raise InputError(
            f"Expected `noise` with covariances of `A` and `B` of which at least one is regular in {of}, got a "
            f"combined covariance with eigenvalues {found.eigenvalues.tolist()}; weights would be infinite."
        ) from None


def covariance_of(information: Array) -> Array:
    return np.asarray(np.linalg.inv(information), dtype=float)


# ------------------------------------------------------------------------------------------------ first stage: R


def starting_rotation(data: Measured, first: int, batch: tuple[int, ...]) -> Array:
    """Park and Martin's rotation: the R that minimises ``sum |alpha - R beta|^2``; (T, 3, 3)."""
    U, s, Vt, eigenvalues = signed_svd(data.alpha @ data.beta.mT)  # eigenvalues of the information matrix
    N = data.alpha.shape[-1]
    if not (determined := are_determined(eigenvalues[:, 0], eigenvalues[:, 2], N)).all():
        k = int(np.argmin(determined))
        index = tuple(int(i) for i in np.unravel_index(first + k, batch)) if batch else ()
        raise_undetermined(U[k], s[k], eigenvalues[k], N, index, half_turns_count=True)
    return np.asarray(U @ Vt)


class Turn(NamedTuple):
    """The rotation stage at R."""

    R: Array  # (T, 3, 3)
    F: Array  # (T, 3, 3)
    a: Array  # (T, 3, m): true alpha
    W: Array  # (T, 3, 3, m): Q^-1
    converged: NDArray[np.bool_]
    iterations: NDArray[np.intp]


def at_rotation(data: Measured, R: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Sum of squares, gradient g, information F, true alpha and Q^-1 at R."""
    r = data.alpha - R @ data.beta
    Q = carried(R, data.S_b)
    Q += pack(data.S_a)
    packed, _ = weights(Q, "rotation")
    W = unpack(packed)
    weighted = times(W, r)
    a = data.alpha - times(data.S_a, weighted)
    squares = np.einsum("tim,tim->t", r, weighted)
    return squares, sum_of_crosses(a, weighted), sum_of_informations(a, packed), a, W


def rotation_stage(data: Measured, R: Array, stop: Stop, max_iterations: int, published_step: float = 1e-10) -> Turn:
    """Iterate the rotation from R; the rule 'published' ends at steps below ``published_step`` (rad)."""
    T, _, m = data.alpha.shape
    descent = Descent(T, stop, max_iterations, published_step)
    result = R.copy(), np.empty((T, 3, 3)), np.empty((T, 3, m)), np.empty((T, 3, 3, m))
    before = R
    while True:
        squares, g, F, a, W = at_rotation(data, R)
        rejected = descent.judge(squares, g, F)
        if rejected is not None:
            R = np.where(rejected[:, None, None], before, R)
        step, ended = descent.step()
        before = R
        R = Rotation.from_rotvec(step).as_matrix() @ R
        if len(R) == T and ended.all():
            return Turn(R, descent.information, a, W, descent.converged, descent.iterations)
        if ended.any():
            for whole, part in zip(result, (R, descent.information, a, W), strict=True):
                whole[descent.trials[ended]] = part[ended]
            if ended.all():
                return Turn(*result, descent.converged, descent.iterations)
            keep = ~ended
            data, R, before = data.take(keep), R[keep], before[keep]
            descent.keep(keep)


# ----------------------------------------------------------------------------------------------- second stage: t


class Moved(NamedTuple):
    """Input of the translation stage from the first: measured q and R_A, and the covariance of (phi, q)."""

    q: Array  # (T, 3, m)
    R_A: Array  # (T, 3, 3, m)
    S_q: Array  # (T, 6, m): Cov(q), packed
    S_phi: Array  # (T, 3, 3, m): Cov(phi)
    S_q_phi: Array  # (T, 3, 3, m): Cov(q, phi)
    Sigma_R: Array  # (T, 3, 3)

    def take(self, keep: NDArray[np.bool_]) -> Moved:
        return Moved(*(x[keep] for x in self))


class Refined(NamedTuple):
    """The error of the refined R_A: ``phi = by_R theta_R + (what the pair's own data add, independent of theta_R)``."""

    R_A: Array  # (T, 3, 3, m)
    J: Array  # (T, 3, 3, m): J_l(a)
    K: Array  # (T, 3, 3, m): S_a Q^-1; da = (I - K) d alpha + K R d beta - K [a]x theta_R
    by_R: Array  # (T, 3, 3, m): -J K [a]x


def refined_rotations(S_a: Array, a: Array, W: Array) -> Refined:
    R_A, J = exponential(a)
    K = product(S_a, W)
    return Refined(R_A, J, K, -product(J, product(K, cross(a))))


def translation_data(data: Measured, R: Array, refined: Refined, Sigma_R: Array, cross_term: CrossTerm) -> Moved:
    J, by_R = refined.J, refined.by_R
    R_tB = R @ data.t[1]
    own = data.S_a - product(refined.K, data.S_a)  # Cov(a) at known R: S_a - S_a Q^-1 S_a
    S_phi = product_transposed(product(J, own), J)
    # dq = -[R t_B]x theta_R + R tau_B - tau_A;  Sigma_R @ M with M (T, 3, 3, m) is M Sigma_R per pair.
    q_by_R = -cross(R_tB)
    q_Sigma, phi_Sigma = Sigma_R[:, None] @ q_by_R, Sigma_R[:, None] @ by_R
    S_phi += product_transposed(phi_Sigma, by_R)
    S_q = pack(product_transposed(q_Sigma, q_by_R)) + carried(R, data.S_t[1]) + pack(data.S_t[0])
    if cross_term == "derived":
        S_q_phi = product_transposed(q_Sigma, by_R)
    else:
        S_q_phi = product_transposed(Sigma_R[:, None] @ cross(R @ data.t[0]), by_R)
    return Moved(R_tB - data.t[0], refined.R_A, S_q, S_phi, S_q_phi, Sigma_R)


class Shift(NamedTuple):
    t: Array  # (T, 3)
    Sigma_t: Array  # (T, 3, 3)
    converged: NDArray[np.bool_]
    iterations: NDArray[np.intp]


def residual_covariance(data: Moved, V: Array) -> tuple[Array, Array]:
    """Packed ``P = Cov(q + V phi)``, and ``Cov(q + V phi, phi)``; (T, 6, m), (T, 3, 3, m)."""
    V_phi = product(V, data.S_phi)
    half = product_transposed(data.S_q_phi + 0.5 * V_phi, V)
    V_phi += data.S_q_phi
    return plus_symmetric(data.S_q, half), V_phi


def translation_stage(
    data: Moved, stop: Stop, max_iterations: int, cross_term: CrossTerm, published_step: float = 1e-5
) -> Shift:
    """Gauss-Newton on t and the latent rotations ``exp(-[n]x) R_A``; the n are eliminated and follow each step.

    The rule 'published' ends at steps below ``published_step``, in the length unit of the data.
    """
    T = len(data.q)
    descent = Descent(T, stop, max_iterations, published_step)
    result = np.empty((T, 3)), np.empty((T, 3, 3))
    D = data.R_A - EYE[:, :, None]
    normal, right = np.einsum("tijm,tikm->tjk", D, D), np.einsum("tijm,tim->tj", D, data.q)
    t, n = np.linalg.solve(normal, right[:, :, None])[:, :, 0], np.zeros_like(data.q)
    while True:
        R = data.R_A if descent.count == 0 else product(rotation(-n), data.R_A)
        D = R - EYE[:, :, None]
        D_t = np.einsum("tijm,tj->tim", D, t)
        V = cross(D_t + t[:, :, None])
        e = data.q - D_t
        if descent.count > 0:
            e += times(V, n)
        P, e_phi = residual_covariance(data, V)
        packed, impossible = weights(P, "translation", cross_term == "derived")
        W = unpack(packed)
        weighted, W_D = times(W, e), product(W, D)
        descent.note(np.einsum("tijm,tim->tj", D, weighted), np.einsum("tijm,tikm->tjk", D, W_D))
        step, ended = descent.relaxed_step(impossible)
        t = t + step
        if ended.any():
            result[0][descent.trials[ended]] = t[ended]
            result[1][descent.trials[ended]] = np.linalg.inv(descent.information[ended])
            if impossible is not None:
                result[1][descent.trials[ended & impossible]] = np.nan
            if ended.all():
                return Shift(*result, descent.converged, descent.iterations)
        latent = np.einsum("tjim,tjm->tim", e_phi, weighted - np.einsum("tijm,tj->tim", W_D, step))
        n = latent if not descent.damping.any() else n + (latent - n) / (1.0 + descent.damping[:, None, None])
        if ended.any():
            keep = ~ended
            data, t, n = data.take(keep), t[keep], n[keep]
            descent.keep(keep)
