"""The two stages of Nguyen and Pham's method: what is measured, the rotation, the translation. Model: `nguyen`.

Each stage is a Gauss-Newton iteration with its latents eliminated: `at_rotation` gives gradient and information of the
first at any R, `rotation_stage` iterates it; `refined_rotations` and `translation_data` carry its result and errors
over to `translation_stage`.

Gauss-Newton steps of many trials at once for `nguyen`: damping, counting, and when each trial ends.

Model: at each state a stage gives its gradient g and information F; the full step is ``F^-1 g``, of the length
``sqrt(g^T F^-1 g)`` in standard deviations, which has no unit. Two rules end an iteration: ``scaled`` by that length,
with damped steps where full ones do not lead down; ``published`` by the length in rad or in the length unit of the
data, undamped.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.packed3x3 import (
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
from ...core.geometry.se3 import Array, vee
from ...errors import InputError
from ...model.noise.models import PairNoise
from ..procrustes.degeneracy import are_determined, raise_undetermined
from ..procrustes.limit import signed_svd
from .method import require

Stop = Literal["scaled", "published"]

# 'scaled': a step below this many standard deviations ends the iteration, far below anything that noise lets one see.
TOLERANCE = 1e-8
# Ratio of a step to the last, below which the next is expected to be shorter by the same ratio or more.
FAST = 1e-2
# 'published': steps in rad and in the length unit of the data, and iterations at most.
PUBLISHED_ROTATION, PUBLISHED_TRANSLATION, PUBLISHED_ITERATIONS = 1e-10, 1e-5, 10
# Relative rise of the sum of squares that passes: near the minimum rounding alone raises it, and would undo good steps.
ROUNDING = 1e-7
# A step below this (standard deviations), no shorter than the last, ends too: rounding may stay above TOLERANCE.
STALLED = 1e-5
# Second stage, which has no sum to judge by: a step that turns round, longer than this times the last, is damped.
SWING = 0.3


class Rule(NamedTuple):
    """Rule that ends an iteration."""

    stop: Stop
    most: int


class Descent:
    """Gauss-Newton steps of the trials that have not yet ended: damped, counted, and judged.

    The full step is ``F^-1 g``, a damped one ``(F + d diag F)^-1 g``. In the first stage a step that raised the sum of
    squares is undone and tried again with more damping. In the second, where the sum is known for linearised latents
    only, damping grows while the steps swing to and fro. Convergence is judged by the full step only.
    """

    def __init__(self, T: int, rule: Rule, published: float) -> None:
        self.rule, self.published = rule, published
        self.trials: NDArray[np.intp] = np.arange(T)
        self.converged = np.zeros(T, dtype=bool)
        self.iterations = np.zeros(T, dtype=np.intp)
        self.count = 0
        self.squares: Array = np.full(T, np.inf)
        self.length: Array = self.squares
        self.damping: Array = np.zeros(T)
        self.gradient = self.information = self.last = np.empty(0)
        self.rejected: NDArray[np.bool_] | None = None

    def note(self, gradient: Array, information: Array) -> None:
        """Take note of the state reached."""
        self.count += 1
        self.gradient, self.information, self.rejected = gradient, information, None

    def judge(self, squares: Array, gradient: Array, information: Array) -> NDArray[np.bool_] | None:
        """Take note of the state reached, or tell which trials are to go back to the state before."""
        before = self.gradient, self.information
        self.note(gradient, information)
        rejected = ~(squares <= (1.0 + ROUNDING) * self.squares + TOLERANCE**2)
        if self.rule.stop == "published" or self.count == 1 or not rejected.any():
            self.squares = squares
            if self.damping.any():
                self.damping = _less(self.damping)
            return None
        self.squares = np.where(rejected, self.squares, squares)
        self.gradient = np.where(rejected[:, None], before[0], gradient)
        self.information = np.where(rejected[:, None, None], before[1], information)
        self.damping = np.where(rejected, np.maximum(10.0 * self.damping, 1e-2), _less(self.damping))
        self.rejected = rejected
        return rejected

    def step(self) -> tuple[Array, NDArray[np.bool_]]:
        """The step (T, 3) of the first stage, and which trials end with it."""
        step, length, converged = self._full_step()
        return self._ended(self._damped(step, converged), length, converged)

    def relaxed_step(self, impossible: NDArray[np.bool_] | None) -> tuple[Array, NDArray[np.bool_]]:
        """The step (T, 3) of the second stage, and which trials end with it; impossible ones without convergence."""
        step, length, converged = self._full_step()
        if self.rule.stop == "scaled" and self.count > 2:
            swings = (length > SWING * self.length) & ((self.last * self.gradient).sum(axis=-1) < 0)
            if swings.any() or self.damping.any():
                self.damping = np.where(swings, np.clip(2.0 * self.damping, 0.5, 8.0), 0.7 * self.damping)
        if impossible is not None:
            converged &= ~impossible
        step, ended = self._ended(self._damped(step, converged), length, converged)
        self.last = step
        if impossible is not None:
            ended |= impossible & (self.count >= PUBLISHED_ITERATIONS)
        return step, ended

    def _full_step(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """The full step, its length in standard deviations, and whether it is so short that the iteration converged."""
        try:
            solved = np.linalg.solve(self.information, self.gradient[:, :, None])
        except np.linalg.LinAlgError:  # say which problem it is
            singular = np.linalg.matrix_rank(self.information) < self.information.shape[-1]
            require(~singular, "the information about X is singular: its motions leave a direction open.")
            raise
        step = np.asarray(solved[:, :, 0], dtype=float)
        length = np.sqrt(np.maximum((step * self.gradient).sum(axis=-1), 0.0))
        if self.rule.stop == "published":
            return step, length, np.sqrt((step * step).sum(axis=-1)) < self.published
        # Near the minimum, a step that is no shorter than the last one is rounding.
        stalled = (length < STALLED) & (length >= self.length)
        if self.rejected is not None:
            stalled &= ~self.rejected
        # Where steps shrink fast, the next one, which is not taken, is shorter than this by their ratio once more.
        shrinking = (length < FAST * self.length) & np.isfinite(self.length)
        next_step = length * np.where(shrinking, length / np.where(shrinking, self.length, 1.0), 1.0)
        return step, length, (next_step < TOLERANCE) | stalled

    def _damped(self, step: Array, converged: NDArray[np.bool_]) -> Array:
        if not self.damping.any():
            return step
        diagonal = np.einsum("tii->ti", self.information)[:, :, None] * EYE
        damped = np.linalg.solve(self.information + self.damping[:, None, None] * diagonal, self.gradient[:, :, None])
        return np.where(converged[:, None], step, damped[:, :, 0])

    def _ended(self, step: Array, length: Array, converged: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        self.length = length
        self.iterations[self.trials] = self.count
        self.converged[self.trials] = converged
        return step, converged | (self.count >= self.rule.most)

    def keep(self, keep: NDArray[np.bool_]) -> None:
        """Go on with some of the trials."""
        self.trials, self.squares, self.damping = self.trials[keep], self.squares[keep], self.damping[keep]
        self.length = self.length[keep]
        self.gradient, self.information = self.gradient[keep], self.information[keep]
        self.last = self.last[keep] if len(self.last) else self.last
        self.rejected = None


def _less(damping: Array) -> Array:
    return np.where(damping > 1e-3, 0.1 * damping, 0.0)


CrossTerm = Literal["derived", "published"]

# Pairs that are worked on at once, about 2 kB each: they fit the cache.
BLOCK = 4096
# Motions beyond this angle (rad) may have lost the sign of their axis to noise.
NEAR_HALF_TURN = 2.8


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

    def take(self, keep: Any) -> Measured:
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
    if squares.max() > NEAR_HALF_TURN**2:
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
    other = np.where(opposite & (angle > NEAR_HALF_TURN), 1.0 - 2 * np.pi / np.maximum(angle, 1.0), 1.0)
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


def rotation_stage(data: Measured, R: Array, rule: Rule) -> Turn:
    T, _, m = data.alpha.shape
    descent = Descent(T, rule, PUBLISHED_ROTATION)
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

    def take(self, keep: Any) -> Moved:
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


def translation_stage(data: Moved, rule: Rule, cross_term: CrossTerm) -> Shift:
    """Gauss-Newton on t and the latent rotations ``exp(-[n]x) R_A``; the n are eliminated and follow each step."""
    T = len(data.q)
    descent = Descent(T, rule, PUBLISHED_TRANSLATION)
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
