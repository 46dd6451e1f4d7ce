"""4D Procrustes analysis (4DPA) in the limit of an infinite scaling factor: X of A X = X B in closed form.

Equations (n) are those of J. Wu, Y. Sun, M. Wang, M. Liu, "Hand-eye Calibration: 4D Procrustes Analysis
Approach", 2019. Model: ``A_i X = X B_i`` with ``X = gripper_T_camera`` for eye-in-hand
(``base_T_camera`` for eye-to-hand), ``A`` relative motions of the robot, ``B`` of the camera. (The paper's
(6) calls ``A`` the camera and ``B`` the gripper; its X is the inverse of ours, its equation the same.)

The limit d -> infinity of the paper's route (`scaled.py`) is, with ``u = vee(R_A)/2 = sin(angle) axis``,
``w = (t_A + R_A^T t_A)/2``, likewise ``v, z`` of B (T2 in the theory page),

    H = sum u v^T = U S V^T,       R_X = U diag(1, 1, det(U V^T)) V^T
    M = tr(G) I - G,  G = H R_X^T,     t_X = -M^-1 sum (w x R_X v + u x R_X z)

Only the moments ``H`` and ``K = sum (u z^T + w v^T)`` of the pairs enter, so time is linear in N and memory
constant. The rotation does not depend on the translations, and a pair weighs sin^2(angle): motions near
90 degrees count most, motions near 180 degrees count nothing.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import islice, product

import numpy as np

from ..core.geometry.checks import CHUNK, as_transforms, entry_rows, surely_transforms
from ..core.geometry.se3 import Array, skew
from ..core.scratch import scratch
from ..core.threads import cores
from .degeneracy import are_determined, raise_undetermined
from .pairs import pair_blocks, trial_blocks

# Number of pairs above which the moments are summed by several threads.
MIN_PAIRS_FOR_THREADS = 50_000

# Places of the entries (M32, M13, M21) and (M23, M31, M12) of a 4x4 matrix stored as rows.
_UPPER, _LOWER = np.array([9, 2, 4]), np.array([6, 8, 1])
# Twice the axial vector (M32 - M23, M13 - M31, M21 - M12) as a linear function of the entries of a 3x3 matrix.
_AXIAL = skew(np.eye(3)).reshape(3, 9)


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
    """A block of motions that may not be rigid: the whole input must be checked in detail."""


def require_transforms(A: Array, B: Array) -> None:
    """Check the motions in detail and raise the `InputError` that names what is wrong, if anything is."""
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
    threads = min(4, cores()) if T * N >= MIN_PAIRS_FOR_THREADS else 1
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
