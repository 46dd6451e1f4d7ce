"""Degeneracy of motions that do not determine X: the limits, the directions that stay open, and the reason, reported
once.

Model: the rotation is that of ``H = sum u v^T = U S V^T`` (or of rotation vectors in place of u, v), S with the sign of
``det(U V^T)`` in its last value; ``M = tr(H R^T) I - H R^T`` has the eigenvalues ``(s2 + s3, s1 + s3, s1 + s2)``,
ascending, in the basis U. X is determined where M is regular.

4D Procrustes analysis (4DPA): registration, orthonormalisation, and X from AX = XB.

Equations (n) are those of J. Wu, Y. Sun, M. Wang, M. Liu, "Hand-eye Calibration: 4D Procrustes Analysis
Approach", 2019. Model: ``A_i X = X B_i`` with ``X = gripper_T_camera`` for eye-in-hand
(``base_T_camera`` for eye-to-hand), ``A`` relative motions of the robot, ``B`` of the camera. (The paper's
(6) calls ``A`` the camera and ``B`` the gripper; its X is the inverse of ours, its equation the same.)

At a finite scaling factor d, `solve_scaled` is the paper's route: SE(3) -> SO(4) by F2 (51), then Problem 2 through the
generated matrices F11, F22 (33)-(35). `solve_limit` is the limit d -> infinity of that route in closed form
(T2 in the theory page): with ``u = vee(R_A)/2 = sin(angle) axis``,
``w = (t_A + R_A^T t_A)/2``, likewise ``v, z`` of B,

    H = sum u v^T = U S V^T,       R_X = U diag(1, 1, det(U V^T)) V^T
    M = tr(G) I - G,  G = H R_X^T,     t_X = -M^-1 sum (w x R_X v + u x R_X z)

Only the moments ``H`` and ``K = sum (u z^T + w v^T)`` of the pairs enter, so time is linear in N and memory
constant. The rotation does not depend on the translations, and a pair weighs sin^2(angle): motions near
90 degrees count most, motions near 180 degrees count nothing.

4DPA at a finite scaling factor d, the paper's route: to SO(4) by (49), (51), Problem 2 by (33)-(35), and back.

Problem 1: registration of two point sets on SO(4) or SE(3), (14)-(15).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice, product
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry.checks import CHUNK, as_numbers, as_transforms, entry_rows, is_number, surely_transforms
from ...core.geometry.nearest_rotation import nearest_rotation, orthonormalise
from ...core.geometry.se3 import Array, pose
from ...core.runtime.read_only import scratch
from ...core.runtime.threads import cores
from ...errors import DegenerateMotionError, InputError
from .. import _closed_form

# Below this ratio of the eigenvalues of M (squared spread of the rotation axes, rad^2) the smallest one is
# rounding of the input: 1e-10 is a spread of 1e-5 rad.
DEGENERATE = 1e-10
# Total weight 4 sum |u| |v| below which there is no rotation at all (rad^2 per pair).
NO_ROTATION = 1e-14


def are_determined(smallest: Array, largest: Array, N: int) -> NDArray[np.bool_]:
    """Return whether M of N pairs is regular, from its smallest and largest eigenvalue (...)."""
    return np.asarray((largest > NO_ROTATION * N) & (smallest > DEGENERATE * largest))


def raise_undetermined(
    U: Array, s: Array, eigenvalues: Array, N: int, index: tuple[int, ...], half_turns_count: bool
) -> NoReturn:
    """Raise the `DegenerateMotionError` of one problem that says why, and which directions of X stay open.

    Parameters
    ----------
    U, s, eigenvalues : (3, 3), (3,), (3,)
        Of the module.
    N : int
        Number of pairs.
    index : tuple
        Of the problem among several; empty for one alone.
    half_turns_count : bool
        Whether a motion by 180 degrees tells something, up to the sign of its axis.
    """
    start = f"The motions do not determine X{f' (problem {index})' if index else ''}: "
    largest = eigenvalues[2]
    if not largest > NO_ROTATION * N:
        raise DegenerateMotionError(
            f"{start}none of them rotates{'' if half_turns_count else ' by an angle other than 0 or 180 degrees'}. "
            "Neither the rotation nor the translation of X is observable. Move the robot so that it rotates about at "
            "least two different axes, by 30 to 150 degrees.",
            np.eye(6),
        )
    lost = U.T[eigenvalues <= DEGENERATE * largest]
    axes = " and ".join(name_axis(axis) for axis in lost)
    if s[1] <= DEGENERATE * s[0]:
        reason = (
            f"all rotation axes are parallel to {axes} in the frame of `A`. They show neither the rotation of X about "
            "this axis nor its translation along it, and the rest of the translation follows that rotation. Add "
            "motions that rotate about another axis."
        )
    else:
        half_turns = ", or the signs of the axes of half turns are lost" if half_turns_count else ""
        reason = (
            f"the rotation axes of `A` are those of `B` mirrored{half_turns}: no rotation about {axes} fits better "
            "than another. One of the two is left-handed or inverted."
        )
    raise DegenerateMotionError(start + reason, infinite_directions(lost))


def infinite_directions(axes: Array) -> Array:
    """Rotation about and translation along each axis (k, 3), as unit vectors (2k, 6) of (theta, tau)."""
    zero = np.zeros_like(axes)
    return np.vstack([np.hstack([axes, zero]), np.hstack([zero, axes])])


def name_axis(axis: Array) -> str:
    """An axis (3,) as text, of the sign that makes its largest component positive."""
    sign = -1.0 if axis[np.argmax(np.abs(axis))] < 0 else 1.0
    return "(" + ", ".join(f"{x:.3f}" for x in np.round(sign * axis, 3) + 0.0) + ")"


# Pairs from which on a second thread pays for itself.
PARALLEL_PAIRS = 50_000

# (M32 - M23, M13 - M31, M21 - M12) from the entries of M, row by row.
# The entries (M32, M13, M21) and (M23, M31, M12) of a 4x4 matrix stored as rows.
_UPPER, _LOWER = np.array([9, 2, 4]), np.array([6, 8, 1])
_AXIAL = np.zeros((3, 9))
_AXIAL[(0, 1, 2), (7, 2, 3)] = 1.0
_AXIAL[(0, 1, 2), (5, 6, 1)] = -1.0


def as_pairs(A: Any, B: Any) -> tuple[Array, Array]:
    """Shapes made equal; the values are checked where they are read."""
    A = as_numbers(A.as_matrix() if hasattr(A, "as_matrix") else A, "A")
    B = as_numbers(B.as_matrix() if hasattr(B, "as_matrix") else B, "B")
    for T, name in ((A, "A"), (B, "B")):
        if T.ndim < 3 or T.shape[-2:] != (4, 4):
            raise InputError(f"Expected `{name}` to have shape (..., N, 4, 4), got {T.shape}.")
    if A.shape[-3] != B.shape[-3]:
        raise InputError(
            f"Expected `A` and `B` to hold the same number of motions, got {A.shape[-3]} and {B.shape[-3]}."
        )
    if A.shape[-3] < 2:
        raise InputError(f"Expected at least 2 motions to determine X, got {A.shape[-3]}.")
    if 0 in A.shape or 0 in B.shape:
        raise InputError(f"Expected at least one problem, got shapes {A.shape} and {B.shape}.")
    if A.shape != B.shape:
        try:
            A, B = np.broadcast_arrays(A, B)
        except ValueError as error:
            raise InputError(
                f"Expected the leading axes of `A` and `B` to broadcast, got {A.shape} and {B.shape}."
            ) from error
    return A, B


# ---------------------------------------------------------------------------- the limit d -> infinity (T2)


def solve_limit(A: Array, B: Array) -> Array:
    """X by T2 on arrays of equal shape ``(..., N, 4, 4)``; values are checked on the way."""
    batch, N = A.shape[:-3], A.shape[-3]
    flat_A, flat_B = A.reshape(-1, N, 4, 4), B.reshape(-1, N, 4, 4)
    try:
        moments = _moments(flat_A, flat_B, checked=False)
    except Suspicious:
        require_transforms(A, B)
        moments = _moments(flat_A, flat_B, checked=True)
    return solve_moments(moments.reshape(*batch, 6, 6), N)


class Suspicious(Exception):
    """A block of motions that may not be rigid: the whole input needs the second look."""


def require_transforms(A: Array, B: Array) -> None:
    """The second look: raise the `InputError` that says what is wrong, if anything is."""
    as_transforms(A, "A")
    as_transforms(B, "B")


def signed_svd(H: Array) -> tuple[Array, Array, Array, Array]:
    """U, S and V^T of the module for H (..., 3, 3), and the eigenvalues of M (..., 3), ascending, in the basis U."""
    U, s, Vt = np.linalg.svd(H)
    sign = np.linalg.det(U @ Vt)
    U[..., 2] *= sign[..., None]
    s[..., 2] *= sign
    # H R^T = U S U^T with the signed S, hence M = U diag(s2 + s3, s1 + s3, s1 + s2) U^T.
    return U, s, Vt, np.add.reduce(s, axis=-1, keepdims=True) - s


def solve_moments(moments: Array, N: int) -> Array:
    """X by T2 from ``4 sum (u, w) (v, z)^T``, shape (..., 6, 6), of N pairs."""
    H = moments[..., :3, :3]
    K = moments[..., :3, 3:] + moments[..., 3:, :3]
    U, s, Vt, eigenvalues = signed_svd(H)
    if not (determined := are_determined(eigenvalues[..., 0], eigenvalues[..., 2], N)).all():
        where = tuple(int(i) for i in np.argwhere(~determined)[0])
        raise_undetermined(U[where], s[where], eigenvalues[where], N, where, half_turns_count=False)
    M_inverse = (U / eigenvalues[..., None, :]) @ U.mT
    X = np.zeros((*H.shape[:-2], 4, 4))
    R = X[..., :3, :3]
    np.matmul(U, Vt, out=R)
    X[..., 3, 3] = 1.0
    # sum (w x R v + u x R z) is minus the axial vector of P = K R^T.
    P = K @ R.mT
    np.matmul(M_inverse, _AXIAL @ P.reshape(*P.shape[:-2], 9, 1), out=X[..., :3, 3:])
    return X


def _moments(A: Array, B: Array, checked: bool) -> Array:
    """``4 sum_i (u, w)_i (v, z)_i^T`` over the pairs of each problem: (T, N, 4, 4) -> (T, 6, 6).

    X does not depend on the common factor. Raises `Suspicious` unless the input was ``checked``.
    """
    T, N = A.shape[:2]
    if T * N <= CHUNK:
        return _chunk_moments(A, B, scratch("moments", 44 * T * N), checked)
    threads = min(4, cores()) if T * N >= PARALLEL_PAIRS else 1
    parts = np.empty((len(range(0, N, CHUNK)), T, 6, 6))  # summed in one order, whatever the number of threads

    def work(share: int) -> None:
        buffer = np.empty(44 * CHUNK)  # allocated once: fresh pages cost as much as the work
        blocks = product(trial_blocks(T, N), enumerate(pair_blocks(N)))
        for trials, (k, pairs) in islice(blocks, share, None, threads):
            parts[k, trials] = _chunk_moments(A[trials, pairs], B[trials, pairs], buffer, checked)

    if threads == 1:
        work(0)
    else:
        with ThreadPoolExecutor(threads) as pool:  # NumPy releases the interpreter lock inside its loops
            list(pool.map(work, range(threads)))
    return np.asarray(parts.sum(axis=0))


def trial_blocks(T: int, N: int, size: int = CHUNK) -> Iterator[slice]:
    """Trials that are worked on together: about ``size`` pairs."""
    step = max(1, size // N)
    return (slice(i, i + step) for i in range(0, T, step))


def pair_blocks(N: int, size: int = CHUNK) -> Iterator[slice]:
    """Pairs of one trial that are worked on together: ``size`` at most."""
    return (slice(j, j + size) for j in range(0, N, size))


def _chunk_moments(A: Array, B: Array, work: Array, checked: bool) -> Array:
    """The same for one block; ``work`` holds 44 numbers per pair."""
    T, N = A.shape[:2]
    work = work[: 44 * T * N].reshape(22, 2 * T * N)
    rows = entry_rows(A.reshape(-1, 4, 4), B.reshape(-1, 4, 4), out=work[:16])
    if not checked and not surely_transforms(rows):
        raise Suspicious
    uw = work[16:]  # twice u, w of A, then twice v, z of B
    np.subtract(work.take(_UPPER, 0), work.take(_LOWER, 0), out=uw[:3])
    t = rows[:3, 3]
    np.einsum("ijm,im->jm", rows[:3, :3], t, out=uw[3:])
    uw[3:] += t
    uw = uw.reshape(6, 2, T, N)
    return np.asarray(uw[:, 0].transpose(1, 0, 2) @ uw[:, 1].transpose(1, 2, 0))


# ------------------------------------------------------------------ the paper's route at finite d (Problem 2)


_EYE4 = np.eye(4)


def solve_4dpa(A: Any, B: Any, scale: float | None) -> Array:
    """X (..., 4, 4) by 4DPA at the scaling factor ``scale``, or in its limit (None); see `estimators.solve`."""
    A, B = as_pairs(A, B)
    return solve_limit(A, B) if scale is None else solve_scaled(A, B, scale).X


class Scaled(NamedTuple):
    """Solution of Problem 2 at finite d with what its covariance (39)-(48) needs again."""

    X: Array  # (..., 4, 4)
    sigma: Array  # (..., 8), the unit octonion (18)
    pinv_L: Array  # (..., 4, 4): (F11 - lambda_min I)^+
    pinv_R: Array  # (..., 4, 4): (F22 - lambda_min I)^+


def check_scale(scale: float) -> None:
    if not (is_number(scale) and np.isfinite(scale) and scale > 0):
        raise InputError(f"Expected `scale` to be a positive number or None, got {scale!r}.")


def so4_from_se3(T: ArrayLike, scale: float, mapping: str = "F2") -> Array:
    """The maps F1 (49) and F2 (51) at ``eps = 1/scale``: (..., 4, 4) in SE(3) to nearly SO(4).

    ``F2 = [[R, t/d], [-t^T R/d, 1]]``; F1 has the opposite sign in its last row. F2 is orthogonal up to
    |t|^2/d^2, F1 only up to 2 |t|/d: the rotation nearest to F1(T) is diag(R, 1), so that F1 carries no
    translation through Problem 2, which therefore takes F2.
    """
    check_scale(scale)
    if mapping not in ("F1", "F2"):
        raise InputError(f"Expected `mapping` to be 'F1' or 'F2', got {mapping!r}.")
    function = _closed_form.F2 if mapping == "F2" else _closed_form.F1
    return np.asarray(function(as_transforms(T, "T", stack=False), scale), dtype=float)


def se3_from_so4(R4: ArrayLike, scale: float) -> Array:
    """Inverse of F1 and F2: rotation from the upper left block, ``t = d R4[:3, 3]``; (..., 4, 4).

    The block is orthonormalised, which changes it by the order of |t|^2/d^2.
    """
    check_scale(scale)
    R4 = as_numbers(R4, "R4")
    if R4.ndim < 2 or R4.shape[-2:] != (4, 4):
        raise InputError(f"Expected `R4` to have shape (..., 4, 4), got {R4.shape}.")
    if not np.isfinite(R4).all():
        raise InputError("Expected `R4` to be finite, got NaN or infinity.")
    return pose(orthonormalise(R4[..., :3, :3]), scale * R4[..., :3, 3])


def octonion(X: ArrayLike, scale: float) -> Array:
    """The unit octonion ``sigma = (q_L, q_R)/sqrt(2)`` (18) of X on SO(4); (..., 4, 4) -> (..., 8).

    ``q_L q_R^T`` has the entries ``<R_L(e_j) R_R(e_k), R4>/4`` for R4 in SO(4); the two leading singular
    vectors give the octonion of the nearest rotation for the image of X, which is in SO(4) to order 1/d only.
    """
    R4 = so4_from_se3(X, scale)
    basis = _closed_form.R_L(_EYE4)[:, None] @ _closed_form.R_R(_EYE4)
    U, _, Vt = np.linalg.svd(np.einsum("jkab,...ab->...jk", basis, R4))
    return _signed_octonion(U[..., 0], Vt[..., 0, :])


def _signed_octonion(q_L: Array, q_R: Array) -> Array:
    """Signs fixed by ``R[3, 3] > 0``, which ``R`` owes to a pose, and by ``q_L[0] >= 0``."""
    corner = (_closed_form.R_L(q_L) @ _closed_form.R_R(q_R))[..., 3, 3]
    q_R = np.where(corner < 0, -1.0, 1.0)[..., None] * q_R
    sign = np.where(q_L[..., 0] < 0, -1.0, 1.0)[..., None]
    return np.asarray(np.concatenate([sign * q_L, sign * q_R], axis=-1) / math.sqrt(2.0))


def solve_scaled(A: Array, B: Array, scale: float) -> Scaled:
    """Problem 2 on ``F2(A_i), F2(B_i)`` through the generated F11 and F22 (33)-(35).

    The eigenvectors of the smallest eigenvalues are q_L
    and q_R (34); the signs are fixed by ``R[3, 3] > 0`` and ``q_L[0] >= 0``.
    """
    check_scale(scale)
    # The limit checks the input, and tells motions that do not determine X: at finite d the translations hide
    # it by terms of the order of |t|^2/d^2.
    solve_limit(A, B)
    longest = max(float(np.abs(T[..., :3, 3]).max()) for T in (A, B))
    if longest > 0 and not 0.01 * longest < scale < 1e12 * longest:
        raise InputError(
            f"Expected `scale` well above the longest translation, {longest:.3g}, and below 1e12 times it, got "
            f"{scale:g}: a small one leaves SO(4), a large one rounds the translations away."
        )
    batch, N = A.shape[:-3], A.shape[-3]
    flat_A, flat_B = A.reshape(-1, N, 4, 4), B.reshape(-1, N, 4, 4)
    sums = np.zeros((2, len(flat_A), 4, 4))
    for trials, pairs in product(trial_blocks(len(flat_A), N), pair_blocks(N)):
        E = _closed_form.F2(flat_A[trials, pairs], scale)
        Z = _closed_form.F2(flat_B[trials, pairs], scale)
        sums[0, trials] += _closed_form.F11(E, Z).sum(axis=1)  # (35)
        sums[1, trials] += _closed_form.F22(E, Z).sum(axis=1)
    values, vectors = np.linalg.eigh(sums)  # (34), ascending
    if not np.all(values[..., 1] - values[..., 0] > DEGENERATE * (values[..., 3] - values[..., 0])):
        raise DegenerateMotionError("The motions do not determine X at this `scale`; make it larger.", np.eye(6))
    sigma = _signed_octonion(vectors[0, ..., 0], vectors[1, ..., 0])
    X = se3_from_so4(_closed_form.sigma_to_R(sigma), scale)
    # (F - lambda_min I)^+ from the decomposition at hand: the smallest eigenvalue is the one left out.
    inverse_gaps = 1.0 / (values[..., 1:] - values[..., :1])
    pinv = (vectors[..., 1:] * inverse_gaps[..., None, :]) @ vectors[..., 1:].mT
    return Scaled(X.reshape(*batch, 4, 4), sigma.reshape(*batch, 8), *(p.reshape(*batch, 4, 4) for p in pinv))


def register(U: ArrayLike, V: ArrayLike) -> tuple[Array, Array]:
    """Problem 1: the rotation and translation that carry the points U onto V.

    Minimises ``sum |R u_i + t - v_i|^2`` (13) over R in SO(n) and t. By (14)-(15), with the correlation
    ``sum (v_i - v_mean)(u_i - u_mean)^T``: its singular value decomposition, the transpose of the paper's H.

    Parameters
    ----------
    U, V : (..., N, n)
        Corresponding points; n = 4 in the paper, any n >= 2 here.

    Returns
    -------
    R : (..., n, n)
    t : (..., n)

    Raises
    ------
    InputError
        Shapes differ, values are not finite, or more than one rotation fits equally well: the points span
        fewer than n - 1 directions, or are mirror images with equal smallest singular values.
    """
    U, V = as_numbers(U, "U"), as_numbers(V, "V")
    if U.ndim < 2 or U.shape != V.shape or U.shape[-1] < 2 or U.shape[-2] < 1:
        raise InputError(
            f"Expected `U` and `V` to have the same shape (..., N, n) with n >= 2, got {U.shape} and {V.shape}."
        )
    if not (np.isfinite(U).all() and np.isfinite(V).all()):
        raise InputError("Expected `U` and `V` to be finite, got NaN or infinity.")
    U_mean, V_mean = U.mean(axis=-2), V.mean(axis=-2)
    correlation = np.swapaxes(V - V_mean[..., None, :], -1, -2) @ (U - U_mean[..., None, :])
    R, unique = nearest_rotation(correlation)
    if not unique.all():
        raise InputError(
            f"Expected `U` and `V` to span at least {U.shape[-1] - 1} directions and not to be mirror images, so that "
            "one rotation fits best; more than one fits equally well."
        )
    return R, V_mean - (R @ U_mean[..., None])[..., 0]
