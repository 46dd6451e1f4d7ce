"""4DPA at a finite scaling factor d, the paper's route: poses to SO(4), Problem 2 there, and back.

Poses become rotations in four dimensions by F2 (51) at ``eps = 1/d``. Problem 2, the rotation of X on SO(4), is an
eigenvalue problem for each of the two quaternions of the unit octonion ``sigma = (q_L, q_R)/sqrt(2)`` (18), with the
generated matrices F11 and F22 (33)-(35). X follows from the octonion. `limit.py` has the notation, and what remains
as d grows.
"""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.geometry.checks import as_numbers, as_transforms, is_number
from ..core.geometry.nearest_rotation import orthonormalise
from ..core.geometry.se3 import Array, pose
from ..errors import DegenerateMotionError, InputError
from . import _closed_form
from .degeneracy import MIN_SPREAD_RATIO
from .limit import solve_limit
from .pairs import MotionsLike, as_pairs, pair_blocks, trial_blocks


def solve_4dpa(A: MotionsLike, B: MotionsLike, scale: float | None) -> Array:
    """X (..., 4, 4) by 4DPA at the scaling factor ``scale``, or in its limit (None); see `methods.solve`."""
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
    basis = _closed_form.R_L(np.eye(4))[:, None] @ _closed_form.R_R(np.eye(4))
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
    if not np.all(values[..., 1] - values[..., 0] > MIN_SPREAD_RATIO * (values[..., 3] - values[..., 0])):
        raise DegenerateMotionError("The motions do not determine X at this `scale`; make it larger.", np.eye(6))
    sigma = _signed_octonion(vectors[0, ..., 0], vectors[1, ..., 0])
    X = se3_from_so4(_closed_form.sigma_to_R(sigma), scale)
    # (F - lambda_min I)^+ from the decomposition at hand: the smallest eigenvalue is the one left out.
    inverse_gaps = 1.0 / (values[..., 1:] - values[..., :1])
    pinv = (vectors[..., 1:] * inverse_gaps[..., None, :]) @ vectors[..., 1:].mT
    return Scaled(X.reshape(*batch, 4, 4), sigma.reshape(*batch, 8), *(p.reshape(*batch, 4, 4) for p in pinv))
