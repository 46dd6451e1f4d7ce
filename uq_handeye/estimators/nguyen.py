r"""Nguyen and Pham's iterative estimate of X with the covariances of its rotation and of its translation.

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

The refined ``R_Ak = exp([a_k]x)`` has the left error ``phi_k``. With ``v = R_Ak t``, ``e = q - (R_Ak - I) t`` and
``V = [v]x`` the residual of the second stage has the covariance

    P = Cov(e) = Cov(q) + V Cov(phi) V^T + Cov(q, phi) V^T + V Cov(phi, q)
    T = sum (R_Ak - I)^T P^-1 (R_Ak - I),     Sigma_t = T^-1

As in the publication, the correlation of rotation and translation within the covariance of a motion is ignored when
weighting, the pairs are taken as independent, though all q_k share the error of R, and no cross-covariance of rotation
and translation is given. `NguyenDerivatives` ignores none of the three.

Source: H. Nguyen, Q.-C. Pham, "On the covariance of X in AX = XB", IEEE Trans. Robotics 34 (2018),
doi:10.1109/TRO.2018.2861905, arXiv:1706.03498.

Arrays inside hold the pairs last, (T, entries, m): NumPy is fastest on long rows. A symmetric 3x3 matrix is packed as
(xx, yy, zz, yz, xz, xy). Motions by exactly 180 degrees are singular: their axis has no sign.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..errors import DegenerateMotionError, InputError
from ..noise import PairNoise, require_count
from ..procrustes import DEGENERATE, NO_ROTATION, as_pairs, infinite_directions, orthonormalise, trial_blocks
from ..se3 import Array, as_transforms
from .method import Derivatives, Estimate, Method

CrossTerm = Literal["derived", "published"]
Stop = Literal["scaled", "published"]

# Pairs that are worked on at once, about 2 kB each.
BLOCK = 4096
# 'scaled': a step below this many standard deviations ends the iteration.
TOLERANCE = 1e-8
# 'published': steps in rad and in the length unit of the data, and iterations at most.
PUBLISHED_ROTATION, PUBLISHED_TRANSLATION, PUBLISHED_ITERATIONS = 1e-10, 1e-5, 10
# Relative rise of the sum of squares that is taken as rounding.
ROUNDING = 1e-7
# Determinant over that of the isotropic matrix of the same trace, below which a 3x3 inverse is left to LAPACK.
FLAT = 1e-7
# Steps (standard deviations) below which one that is no shorter than the last is rounding.
STALLED = 1e-5
# Steps of the second stage that turn round without shrinking by this factor are damped.
SWING = 0.3
# Ratio of eigenvalues below which a covariance is singular.
SINGULAR = 1e-13
# Added to squared angles, so that 0 / 0 does not come up.
TINY = 1e-300
# Motions beyond this angle (rad) may have lost the sign of their axis to noise.
NEAR_HALF_TURN = 2.8

# Arrays and `take`, which is several times faster than a list between brackets.
_ROWS, _COLUMNS = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])  # of the packed entries
_PACK, _PACK_TRANSPOSED = np.array([0, 4, 8, 5, 2, 1]), np.array([0, 4, 8, 7, 6, 3])
_UNPACK = np.array([0, 5, 4, 5, 1, 3, 4, 3, 2])
_COFACTOR = np.array([[1, 2, 0, 4, 5, 3], [2, 0, 1, 5, 3, 4], [3, 4, 5, 0, 1, 2], [3, 4, 5, 3, 4, 5]])
_EYE = np.eye(3)
# [v]x, row by row, is _CROSS v; the axial part of sum a b^T is sum a x b.
_CROSS = np.zeros((9, 3))
_CROSS[(7, 2, 3), (0, 1, 2)], _CROSS[(5, 6, 1), (0, 1, 2)] = 1.0, -1.0


def _information_of_moments() -> Array:
    """The (9, 36) matrix from packed ``sum a a^T (x) W`` to ``sum [a]x^T W [a]x``."""
    basis = _CROSS.reshape(3, 3, 3)  # [e_k]x = basis[:, :, k]
    W = np.zeros((6, 3, 3))
    W[range(6), _ROWS, _COLUMNS] = W[range(6), _COLUMNS, _ROWS] = 1.0
    by_pair = np.einsum("jil,njk,kmp->lpnim", basis, W, basis)
    twice = [by_pair[i, j] + (by_pair[j, i] if i != j else 0.0) for i, j in zip(_ROWS, _COLUMNS, strict=True)]
    return np.stack(twice).reshape(36, 9).T


_INFORMATION = _information_of_moments()


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


def nguyen(
    A: Any,
    B: Any,
    noise: PairNoise | None = None,
    *,
    cross_term: CrossTerm = "derived",
    stop: Stop = "scaled",
    max_iterations: int = 100,
) -> NguyenResult:
    """X from ``A_k X = X B_k`` by Nguyen and Pham's two stages, weighted by the noise.

    Parameters
    ----------
    A, B : (..., N, 4, 4)
        Motions of robot and camera; leading axes are independent problems and broadcast.
    noise : PairNoise or None
        The 3x3 blocks of rotation and of translation are used; their correlation is ignored, as published. None is
        isotropic noise, equal on A and B, with the root mean square translation of the data times as much
        deviation in translation as in rotation: no unit enters.
    cross_term : "derived" or "published"
        ``Cov(q_k, phi_k)``: as derived, or with the opposite sign and ``R t_A`` in place of ``R t_B``.
    stop : "scaled" or "published"
        ``scaled`` ends at steps below 1e-8 standard deviations, whatever the units, with damped steps where a full
        one would raise the sum of squares. ``published`` ends at steps below 1e-10 rad, then 1e-5 in the length unit
        of the data, after 10 undamped iterations at most.
    max_iterations : int
        Per stage, for ``scaled``.

    Returns
    -------
    NguyenResult
        A problem that did not converge has ``converged`` False and the last iterate.

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
    _check_noise(noise, N)
    flat_A, flat_B = A.reshape(-1, N, 4, 4), B.reshape(-1, N, 4, 4)
    rule = _Rule(stop, PUBLISHED_ITERATIONS if stop == "published" else int(max_iterations))
    parts = [
        _solve(flat_A[trials], flat_B[trials], noise, cross_term, rule, trials.start, batch)
        for trials in trial_blocks(len(flat_A), N, BLOCK)
    ]
    joined = parts[0] if len(parts) == 1 else NguyenResult(*map(np.concatenate, zip(*parts, strict=True)))
    return NguyenResult(*(part.reshape((*batch, *part.shape[1:])) for part in joined))


class _Rule(NamedTuple):
    """When an iteration ends."""

    stop: Stop
    most: int


def _solve(
    A: Array, B: Array, noise: PairNoise | None, cross_term: CrossTerm, rule: _Rule, first: int, batch: tuple[int, ...]
) -> NguyenResult:
    T = len(A)
    length = np.ones(T) if noise is not None else _typical_length(A, B)
    data = _measured(A, B, noise, length)
    R = _start(data, first, batch)
    turn = _rotation_stage(data, R, rule)
    X = np.zeros((T, 4, 4))
    X[:, :3, :3] = turn.R
    X[:, 3, 3] = 1.0
    refined = _refined(data.S_a, turn.a, turn.W)
    moved = _translation_data(data, turn.R, refined, _inv(turn.F), cross_term)
    shift = _translation_stage(moved, rule, cross_term)
    X[:, :3, 3] = shift.t
    return NguyenResult(
        X,
        moved.Sigma_R,
        shift.Sigma_t,
        np.stack([turn.iterations, shift.iterations], axis=-1),
        turn.converged & shift.converged,
        length,
    )


# ------------------------------------------------------------------------------------------------- what is measured


class _Measured(NamedTuple):
    """The data of both stages; S have the trials or the pairs as 1 where they are all equal."""

    alpha: Array  # (T, 3, m)
    beta: Array  # (T, 3, m)
    S_a: Array  # (T, 3, 3, m)
    S_b: Array  # (T, 3, 3, m)
    J_inverse: Array  # (2, T, 3, 3, m): J_l^-1 of alpha and of beta
    t: Array  # (2, T, 3, m)
    S_t: Array  # (2, T or 1, 3, 3, m or 1)

    def take(self, keep: Any) -> _Measured:
        """The rotation stage's data of some of the trials."""
        return self._replace(alpha=self.alpha[keep], beta=self.beta[keep], S_a=self.S_a[keep], S_b=self.S_b[keep])


def _typical_length(A: Array, B: Array) -> Array:
    """Root mean square translation of each problem, or 1 where there is none."""
    squares = sum(np.einsum("tmi,tmi->t", P[..., :3, 3], P[..., :3, 3]) for P in (A, B)) / (2.0 * A.shape[1])
    return np.asarray(np.sqrt(np.where(squares > 0, squares, 1.0)))


def _check_noise(noise: Any, N: int) -> None:
    if noise is None:
        return
    if not isinstance(noise, PairNoise):
        raise InputError(f"Expected `noise` to be PairNoise or None, got {type(noise).__name__}.")
    require_count(noise.A, N, "A", "motions")
    require_count(noise.B, N, "B", "motions")


def _blocks_of(noise: PairNoise | None, length: Array, pairs: slice) -> tuple[Array, Array]:
    """Covariances (2, T or 1, 3, 3, m or 1) of the rotations and of the translations of A and B."""
    if noise is None:
        both = np.broadcast_to(_EYE[:, :, None], (2, 1, 3, 3, 1))
        return both, both * np.square(length)[:, None, None, None]
    full = [np.zeros((6, 6)) if S is None else S for S in (noise.A, noise.B)]
    rows = [S[:, :, None] if S.ndim == 2 else S[pairs].transpose(1, 2, 0) for S in full]
    stacked = np.stack(np.broadcast_arrays(*rows))[:, None]
    return stacked[:, :, :3, :3], stacked[:, :, 3:, 3:]


def _measured(
    A: Array, B: Array, noise: PairNoise | None, length: Array, pairs: slice = slice(None), R: Array | None = None
) -> _Measured:
    """The data of motions (T, m, 4, 4); the signs of axes near half turns by R if it is known."""
    T, m = A.shape[:2]
    both = np.stack([A, B])
    vectors = Rotation.from_matrix(both[..., :3, :3].reshape(-1, 3, 3), assume_valid=True).as_rotvec()
    v = np.ascontiguousarray(vectors.reshape(2, T, m, 3).swapaxes(2, 3))
    squares = np.einsum("stim,stim->stm", v, v)
    if squares.max() > NEAR_HALF_TURN**2:
        _turn_axes(A, B, v, squares, R)
    S_R, S_t = _blocks_of(noise, length, pairs)
    J_inverse = _inverse_jacobian(v, squares)
    S = np.einsum("stijm,stkjm->stikm", np.einsum("stijm,stjkm->stikm", J_inverse, S_R), J_inverse)  # T6
    t = np.ascontiguousarray(both[..., :3, 3].swapaxes(2, 3))
    return _Measured(v[0], v[1], S[0], S[1], J_inverse, t, S_t)


def _turn_axes(A: Array, B: Array, v: Array, squares: Array, R: Array | None) -> None:
    """Near half turns, take the other rotation vector of B, beyond 180 degrees, if it is the one that fits alpha.

    It is the one for which ``alpha . R beta > 0``, R the rotation that fits the vectors ``sin(angle) axis``, which
    have no ambiguity. Writes to v (2, T, 3, m) and its squared lengths.
    """
    if R is None:
        u, w = (
            np.stack([P[..., 2, 1] - P[..., 1, 2], P[..., 0, 2] - P[..., 2, 0], P[..., 1, 0] - P[..., 0, 1]], axis=1)
            for P in (A, B)
        )
        R = orthonormalise(u @ w.mT)
    opposite = np.einsum("tim,tim->tm", v[0], R @ v[1]) < 0
    angle = np.sqrt(squares[1])
    other = np.where(opposite & (angle > NEAR_HALF_TURN), 1.0 - 2 * np.pi / np.maximum(angle, 1.0), 1.0)
    v[1] *= other[:, None]
    squares[1] *= other * other


def _of_axis(scalar: Array, cross: Array | float, outer: Array, v: Array) -> Array:
    """``scalar I + cross [v]x + outer v v^T``: vectors (..., 3, m) and factors (..., m) -> (..., 3, 3, m)."""
    factor = cross if isinstance(cross, float) else cross[..., None, :]
    result = (_CROSS @ (factor * v)).reshape(*v.shape[:-2], 3, 3, v.shape[-1])
    result += (outer[..., None, :] * v)[..., :, None, :] * v[..., None, :, :]
    for i in range(3):
        result[..., i, i, :] += scalar
    return np.asarray(result)


def _inverse_jacobian(v: Array, squares: Array) -> Array:
    """``J_l(v)^-1 = I - [v]x / 2 + c [v]x^2``, ``c = (1 - (a/2) cot(a/2)) / a^2``; (..., 3, m) -> (..., 3, 3, m)."""
    half = 0.5 * np.sqrt(squares)
    large = half > 0.25
    safe = np.where(large, half, 1.0)
    c = 0.25 * (1.0 - safe / np.tan(safe)) / (safe * safe)
    if not large.all():  # Bernoulli numbers; the closed form cancels
        s = squares
        series = 1 / 12 + s * (1 / 720 + s * (1 / 30240 + s * (1 / 1209600 + s / 47900160)))
        c = np.where(large, c, series)
    return _of_axis(1.0 - c * squares, -0.5, c, v)


def _rotation(v: Array) -> Array:
    """``exp([v]x)``: (..., 3, m) -> (..., 3, 3, m)."""
    squares = np.einsum("...im,...im->...m", v, v)
    sinc, first = _sinc(squares)
    return _of_axis(1.0 - first * squares, sinc, first, v)


def _sinc(squares: Array) -> tuple[Array, Array]:
    """``sin(a) / a`` and ``(1 - cos a) / a^2`` of ``a^2``."""
    half = 0.5 * np.sqrt(squares + TINY)
    sine = np.sin(half) / half
    return np.cos(half) * sine, 0.5 * sine * sine


def _exponential(v: Array) -> tuple[Array, Array]:
    """``exp([v]x)`` and ``J_l(v)``: (..., 3, m) -> (..., 3, 3, m) each."""
    squares = np.einsum("...im,...im->...m", v, v)
    sinc, first = _sinc(squares)
    large = squares > 0.25
    second = (1.0 - sinc) / np.where(large, squares, 1.0)  # (a - sin a) / a^3
    if not large.all():
        s = squares
        second = np.where(large, second, 1 / 6 - s / 120 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110))))
    return _of_axis(1.0 - first * squares, sinc, first, v), _of_axis(sinc, first, second, v)


# -------------------------------------------------------------------------------------------- packed 3x3 matrices


def _inverse(S: Array, what: str, singular_raises: bool = True) -> tuple[Array, NDArray[np.bool_] | None]:
    """Inverses of packed symmetric matrices (T, 6, m), and which trials hold one that is not positive definite.

    By cofactors where these are accurate. Raises `InputError` for a singular one unless told not to.
    """
    i, j, k, m = _COFACTOR
    inverse = S.take(i, axis=1)
    inverse *= S.take(j, axis=1)
    subtracted = S.take(k, axis=1)
    subtracted *= S.take(m, axis=1)
    inverse -= subtracted
    # cofactors (xx, yy, zz, yz, xz, xy): det = xx C_xx + xy C_xy + xz C_xz
    determinant = S[:, 0] * inverse[:, 0] + S[:, 5] * inverse[:, 5] + S[:, 4] * inverse[:, 4]
    third = (S[:, 0] + S[:, 1] + S[:, 2]) / 3.0
    bad: NDArray[np.bool_] | None = None
    if (determinant > FLAT * third * third * third).all():
        inverse /= determinant[:, None]
    else:
        full = np.moveaxis(_unpacked(S), 3, 1)
        values, vectors = np.linalg.eigh(full)
        regular = values[..., 0] > SINGULAR * values[..., 2]
        if not regular.all():
            if singular_raises:
                raise InputError(
                    f"Expected `noise` with covariances of `A` and `B` of which at least one is regular in {what}, got "
                    f"a combined covariance with eigenvalues {values[~regular][0].tolist()}; weights would be infinite."
                )
            bad = np.asarray(~regular.all(axis=-1))
        W = (vectors / values[..., None, :]) @ vectors.mT
        inverse = W.reshape(*W.shape[:2], 9)[..., _PACK].swapaxes(1, 2)
    return inverse, bad


def _inv(M: Array) -> Array:
    return np.asarray(np.linalg.inv(M), dtype=float)


def _unpacked(S: Array) -> Array:
    """(T, 6, m) -> (T, 3, 3, m)."""
    return S.take(_UNPACK, axis=1).reshape(len(S), 3, 3, -1)


def _packed(S: Array) -> Array:
    """(T, 3, 3, m), symmetric -> (T, 6, m)."""
    return S.reshape(len(S), 9, -1).take(_PACK, axis=1)


def _carried(R: Array, S: Array) -> Array:
    """Packed ``R S R^T`` (T, 6, m) of S (T, 3, 3, m)."""
    by_entry = R.take(_ROWS, axis=1)[:, :, :, None] * R.take(_COLUMNS, axis=1)[:, :, None, :]
    return np.asarray(by_entry.reshape(len(R), 6, 9) @ S.reshape(len(S), 9, -1))


def _times(M: Array, v: Array) -> Array:
    """``M v`` per pair: (T, 3, 3, m), (T, 3, m) -> (T, 3, m)."""
    return np.asarray(np.einsum("tijm,tjm->tim", M, v))


def _product(M: Array, N: Array) -> Array:
    """``M N`` per pair, (T, 3, 3, m)."""
    return np.asarray(np.einsum("tijm,tjkm->tikm", M, N))


def _product_transposed(M: Array, N: Array) -> Array:
    """``M N^T`` per pair, (T, 3, 3, m)."""
    return np.asarray(np.einsum("tijm,tkjm->tikm", M, N))


def _cross(v: Array) -> Array:
    """``[v]x`` per pair: (T, 3, m) -> (T, 3, 3, m)."""
    return np.asarray((_CROSS @ v).reshape(len(v), 3, 3, -1))


# ------------------------------------------------------------------------------------------------ first stage: R


def _start(data: _Measured, first: int, batch: tuple[int, ...]) -> Array:
    """Park and Martin's rotation: the R that minimises ``sum |alpha - R beta|^2``; (T, 3, 3)."""
    U, s, Vt = np.linalg.svd(data.alpha @ data.beta.mT)
    sign = np.linalg.det(U @ Vt)
    U[:, :, 2] *= sign[:, None]
    s[:, 2] *= sign
    eigenvalues = s.sum(axis=-1, keepdims=True) - s  # of the information matrix, in the basis U, ascending
    N = data.alpha.shape[-1]
    largest = eigenvalues[:, 2]
    determined = (largest > NO_ROTATION * N) & (eigenvalues[:, 0] > DEGENERATE * largest)
    if not determined.all():
        k = int(np.argmin(determined))
        index = tuple(int(i) for i in np.unravel_index(first + k, batch)) if batch else ()
        _raise_undetermined(U[k], s[k], eigenvalues[k], N, f" (problem {index})" if index else "")
    return np.asarray(U @ Vt)


def _raise_undetermined(U: Array, s: Array, eigenvalues: Array, N: int, at: str) -> NoReturn:
    if not eigenvalues[2] > NO_ROTATION * N:
        raise DegenerateMotionError(
            f"The motions do not determine X{at}: none of them rotates. Neither the rotation nor the translation of X "
            "is observable. Move the robot so that it turns about at least two different axes.",
            np.eye(6),
        )
    lost = U.T[eigenvalues <= DEGENERATE * eigenvalues[2]]
    axes = " and ".join(str((np.round(axis, 3) + 0.0).tolist()) for axis in lost)
    if s[1] <= DEGENERATE * s[0]:
        message = (
            f"The motions do not determine X{at}: all rotation axes are parallel to {axes} in the frame of `A`. "
            "Neither the rotation of X about this axis nor its translation along it is observable. Add motions that "
            "turn about another axis."
        )
    else:
        message = (
            f"The motions do not determine X{at}: the rotation axes of `A` are those of `B` mirrored, or turns by 180 "
            f"degrees about axes of either sign, and no rotation about {axes} fits better than another."
        )
    raise DegenerateMotionError(message, infinite_directions(lost))


class _Turn(NamedTuple):
    """The rotation stage at R."""

    R: Array  # (T, 3, 3)
    F: Array  # (T, 3, 3)
    a: Array  # (T, 3, m): true alpha
    W: Array  # (T, 3, 3, m): Q^-1
    converged: NDArray[np.bool_]
    iterations: NDArray[np.intp]


def _at_rotation(data: _Measured, R: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Sum of squares, gradient g, information F, true alpha and Q^-1 at R."""
    r = data.alpha - R @ data.beta
    Q = _carried(R, data.S_b)
    Q += _packed(data.S_a)
    packed, _ = _inverse(Q, "rotation")
    W = _unpacked(packed)
    weighted = _times(W, r)
    a = data.alpha - _times(data.S_a, weighted)
    g = (a @ weighted.mT).reshape(-1, 9) @ _CROSS
    moments = (a.take(_ROWS, axis=1) * a.take(_COLUMNS, axis=1)) @ packed.mT
    F = (moments.reshape(-1, 36) @ _INFORMATION.T).reshape(-1, 3, 3)
    return np.einsum("tim,tim->t", r, weighted), -g, F, a, W


def _rotation_stage(data: _Measured, R: Array, rule: _Rule) -> _Turn:
    T, _, m = data.alpha.shape
    descent = _Descent(T, rule, PUBLISHED_ROTATION)
    result = R.copy(), np.empty((T, 3, 3)), np.empty((T, 3, m)), np.empty((T, 3, 3, m))
    before = R
    while True:
        squares, g, F, a, W = _at_rotation(data, R)
        rejected = descent.judge(squares, g, F)
        if rejected is not None:
            R = np.where(rejected[:, None, None], before, R)
        step, ended = descent.step()
        before = R
        R = Rotation.from_rotvec(step).as_matrix() @ R
        if len(R) == T and ended.all():
            return _Turn(R, descent.information, a, W, descent.converged, descent.iterations)
        if ended.any():
            for whole, part in zip(result, (R, descent.information, a, W), strict=True):
                whole[descent.trials[ended]] = part[ended]
            if ended.all():
                return _Turn(*result, descent.converged, descent.iterations)
            keep = ~ended
            data, R, before = data.take(keep), R[keep], before[keep]
            descent.keep(keep)


class _Descent:
    """Gauss-Newton steps of the trials that have not yet ended: damped, counted, and judged.

    The full step is ``F^-1 g``, a damped one ``(F + d diag F)^-1 g``. In the first stage a step that raised the sum of
    squares is undone and tried again with more damping. In the second, where the sum is known for linearised latents
    only, damping grows while the steps swing to and fro. Convergence is judged by the full step alone.
    """

    def __init__(self, T: int, rule: _Rule, published: float) -> None:
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
        step = np.asarray(np.linalg.solve(self.information, self.gradient[:, :, None])[:, :, 0], dtype=float)
        length = np.sqrt(np.maximum((step * self.gradient).sum(axis=-1), 0.0))
        if self.rule.stop == "published":
            return step, length, np.sqrt((step * step).sum(axis=-1)) < self.published
        # Near the minimum, a step that is no shorter than the last one is rounding.
        stalled = (length < STALLED) & (length >= self.length)
        if self.rejected is not None:
            stalled &= ~self.rejected
        return step, length, (length < TOLERANCE) | stalled

    def _damped(self, step: Array, converged: NDArray[np.bool_]) -> Array:
        if not self.damping.any():
            return step
        diagonal = np.einsum("tii->ti", self.information)[:, :, None] * _EYE
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


# ----------------------------------------------------------------------------------------------- second stage: t


class _Moved(NamedTuple):
    """What the translation stage takes from the first: measured q and R_A, and the covariance of (phi, q)."""

    q: Array  # (T, 3, m)
    R_A: Array  # (T, 3, 3, m)
    S_q: Array  # (T, 6, m): Cov(q), packed
    S_phi: Array  # (T, 3, 3, m): Cov(phi)
    S_q_phi: Array  # (T, 3, 3, m): Cov(q, phi)
    Sigma_R: Array  # (T, 3, 3)

    def take(self, keep: Any) -> _Moved:
        return _Moved(*(x[keep] for x in self))


class _Refined(NamedTuple):
    """The error of the refined R_A: ``phi = by_R theta_R + (what the pair's own data add, independent of theta_R)``."""

    R_A: Array  # (T, 3, 3, m)
    J: Array  # (T, 3, 3, m): J_l(a)
    K: Array  # (T, 3, 3, m): S_a Q^-1; da = (I - K) d alpha + K R d beta - K [a]x theta_R
    by_R: Array  # (T, 3, 3, m): -J K [a]x


def _refined(S_a: Array, a: Array, W: Array) -> _Refined:
    R_A, J = _exponential(a)
    K = _product(S_a, W)
    return _Refined(R_A, J, K, -_product(J, _product(K, _cross(a))))


def _translation_data(data: _Measured, R: Array, refined: _Refined, Sigma_R: Array, cross_term: CrossTerm) -> _Moved:
    J, by_R = refined.J, refined.by_R
    R_tB = R @ data.t[1]
    own = data.S_a - _product(refined.K, data.S_a)  # Cov(a) at known R: S_a - S_a Q^-1 S_a
    S_phi = _product_transposed(_product(J, own), J)
    # dq = -[R t_B]x theta_R + R tau_B - tau_A;  Sigma_R @ M with M (T, 3, 3, m) is M Sigma_R per pair.
    q_by_R = -_cross(R_tB)
    q_Sigma, phi_Sigma = Sigma_R[:, None] @ q_by_R, Sigma_R[:, None] @ by_R
    S_phi += _product_transposed(phi_Sigma, by_R)
    S_q = _packed(_product_transposed(q_Sigma, q_by_R)) + _carried(R, data.S_t[1]) + _packed(data.S_t[0])
    if cross_term == "derived":
        S_q_phi = _product_transposed(q_Sigma, by_R)
    else:
        S_q_phi = _product_transposed(Sigma_R[:, None] @ _cross(R @ data.t[0]), by_R)
    return _Moved(R_tB - data.t[0], refined.R_A, S_q, S_phi, S_q_phi, Sigma_R)


class _Shift(NamedTuple):
    t: Array  # (T, 3)
    Sigma_t: Array  # (T, 3, 3)
    converged: NDArray[np.bool_]
    iterations: NDArray[np.intp]


def _residual_covariance(data: _Moved, V: Array) -> tuple[Array, Array]:
    """Packed ``P = Cov(q + V phi)``, and ``Cov(q + V phi, phi)``; (T, 6, m), (T, 3, 3, m)."""
    V_phi = _product(V, data.S_phi)
    half = _product_transposed(data.S_q_phi + 0.5 * V_phi, V).reshape(len(V), 9, -1)
    V_phi += data.S_q_phi
    return data.S_q + half.take(_PACK, axis=1) + half.take(_PACK_TRANSPOSED, axis=1), V_phi


def _translation_stage(data: _Moved, rule: _Rule, cross_term: CrossTerm) -> _Shift:
    """Gauss-Newton on t and the latent rotations ``exp(-[n]x) R_A``; the n are eliminated and follow each step."""
    T = len(data.q)
    descent = _Descent(T, rule, PUBLISHED_TRANSLATION)
    result = np.empty((T, 3)), np.empty((T, 3, 3))
    D = data.R_A - _EYE[:, :, None]
    normal, right = np.einsum("tijm,tikm->tjk", D, D), np.einsum("tijm,tim->tj", D, data.q)
    t, n = np.linalg.solve(normal, right[:, :, None])[:, :, 0], np.zeros_like(data.q)
    while True:
        R = data.R_A if descent.count == 0 else _product(_rotation(-n), data.R_A)
        D = R - _EYE[:, :, None]
        D_t = np.einsum("tijm,tj->tim", D, t)
        V = _cross(D_t + t[:, :, None])
        e = data.q - D_t
        if descent.count > 0:
            e += _times(V, n)
        P, e_phi = _residual_covariance(data, V)
        packed, impossible = _inverse(P, "translation", cross_term == "derived")
        W = _unpacked(packed)
        weighted, W_D = _times(W, e), _product(W, D)
        descent.note(np.einsum("tijm,tim->tj", D, weighted), np.einsum("tijm,tikm->tjk", D, W_D))
        step, ended = descent.relaxed_step(impossible)
        t = t + step
        if ended.any():
            result[0][descent.trials[ended]] = t[ended]
            result[1][descent.trials[ended]] = np.linalg.inv(descent.information[ended])
            if impossible is not None:
                result[1][descent.trials[ended & impossible]] = np.nan
            if ended.all():
                return _Shift(*result, descent.converged, descent.iterations)
        latent = np.einsum("tjim,tjm->tim", e_phi, weighted - np.einsum("tijm,tj->tim", W_D, step))
        n = latent if not descent.damping.any() else n + (latent - n) / (1.0 + descent.damping[:, None, None])
        if ended.any():
            keep = ~ended
            data, t, n = data.take(keep), t[keep], n[keep]
            descent.keep(keep)


# ------------------------------------------------------------------------------------------------- derivatives of X


def covariances_at(
    A: Array, B: Array, X: Array, noise: PairNoise | None, cross_term: CrossTerm = "derived"
) -> NguyenResult:
    """What `NguyenDerivatives` needs where X (T, 4, 4) of checked motions (T, N, 4, 4) is known: no iteration."""
    parts = []
    for trials in trial_blocks(len(A), A.shape[1], BLOCK):
        length = np.ones(len(X[trials])) if noise is not None else _typical_length(A[trials], B[trials])
        R, t = X[trials, :3, :3], X[trials, :3, 3]
        data = _measured(A[trials], B[trials], noise, length, R=R)
        _, _, information, a, W = _at_rotation(data, R)
        Sigma_R = _inv(information)
        refined = _refined(data.S_a, a, W)
        P, _ = _residual_covariance(
            _translation_data(data, R, refined, Sigma_R, cross_term), _cross(np.einsum("tijm,tj->tim", refined.R_A, t))
        )
        D = refined.R_A - _EYE[:, :, None]
        W_D = _product(_unpacked(_inverse(P, "translation", cross_term == "derived")[0]), D)
        Sigma_t = _inv(np.einsum("tijm,tikm->tjk", D, W_D))
        parts.append((Sigma_R, Sigma_t, length))
    Sigma_R, Sigma_t, length = map(np.concatenate, zip(*parts, strict=True))
    return NguyenResult(X, Sigma_R, Sigma_t, np.zeros((len(X), 2), np.intp), np.ones(len(X), dtype=bool), length)


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
        data = _measured(A, B, self.noise, self.length, pairs, self.R)
        _, _, information, a, W = _at_rotation(data, self.R)
        refined = _refined(data.S_a, a, W)
        moved = _translation_data(data, self.R, refined, self.Sigma_R, self.cross_term)
        D = refined.R_A - _EYE[:, :, None]
        V = _cross(np.einsum("tijm,tj->tim", refined.R_A, self.t))
        P, _ = _residual_covariance(moved, V)
        D_W = _product(D.swapaxes(1, 2), _unpacked(_inverse(P, "translation", self.cross_term == "derived")[0]))
        by_phi = _product(D_W, V)
        by_latent = _product(by_phi, refined.J)
        by_difference = _product(_cross(a), W)  # f = sum a x Q^-1 r
        by_measured = _product(by_latent, refined.K)
        F = np.zeros((2, 6, 6, *A.shape[:2]))
        rows = F.transpose(0, 3, 1, 2, 4)  # (2, T, 6, 6, m)
        rows[0, :, :3, :3] = _product(by_difference, data.J_inverse[0])
        rows[0, :, 3:, :3] = _product(by_latent - by_measured, data.J_inverse[0])
        rows[0, :, 3:, 3:] = -D_W
        R_J = np.einsum("tij,tjkm->tikm", self.R, data.J_inverse[1])
        rows[1, :, :3, :3] = -_product(by_difference, R_J)
        rows[1, :, 3:, :3] = _product(by_measured, R_J)
        rows[1, :, 3:, 3:] = np.einsum("tijm,tjk->tikm", D_W, self.R)
        shared = _product(by_phi, refined.by_R) - _product(D_W, _cross(moved.q + data.t[0]))
        self.sums += [information, np.einsum("tijm,tjkm->tik", D_W, D), shared.sum(axis=-1)]
        return F

    def weight(self, N: int) -> Array:
        """Q (T, 6, 6), after all blocks."""
        F, T, H = self.sums
        Q = np.zeros((len(F), 6, 6))
        Q[:, :3, :3], Q[:, 3:, 3:] = np.linalg.inv(F), np.linalg.inv(T)
        Q[:, 3:, :3] = Q[:, 3:, 3:] @ H @ Q[:, :3, :3]
        return Q


class _Solver:
    """The default variant among the other methods."""

    def estimate(self, A: Array, B: Array, noise: PairNoise | None) -> Estimate:
        result = nguyen(A, B, noise)
        return Estimate(result.X, result.converged, result.iterations.sum(axis=-1), result)

    def derivatives(self, A: Array, B: Array, noise: PairNoise | None, X: Array) -> Callable[[slice], Derivatives]:
        at = covariances_at(A, B, X, noise, "derived")
        return lambda trials: NguyenDerivatives(at, noise, trials)


METHOD = Method(
    name="nguyen",
    authors="H. Nguyen and Q.-C. Pham",
    year=2018,
    title="On the Covariance of X in AX = XB. IEEE Trans. Robotics 34(6), 1651-1658",
    doi="10.1109/TRO.2018.2861905",
    structure="separated",
    form="iterative",
    minimises="the Mahalanobis distance of rotation vectors alpha - R_X beta, then of q - (R_A - I) t, both with errors in "
    "all variables, weighted by the noise",
    singular="motions of 180 degrees, unless others tell the sign of their axes; a noise model without noise in some "
    "direction on both sides",
    solver=_Solver(),
    weighted=True,
)
