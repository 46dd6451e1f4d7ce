"""Each method against its own equations, stacked and solved as the publication states them, on noisy motions.

What OpenCV implements is compared with it (test_against_opencv.py); these are the others, and Tsai's without the pairs
that OpenCV drops. Written pair by pair, from SciPy's conversions.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import cross_matrix, difference, left_matrix, noisy_motions, right_matrix, transforms

import uq_handeye as uq


def quaternion(T):
    """(w, x, y, z), w >= 0."""
    return Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True, scalar_first=True)


def best_translation(R, A, B):
    rows = np.concatenate([a[:3, :3] - np.eye(3) for a in A])
    rhs = np.concatenate([R @ b[:3, 3] - a[:3, 3] for a, b in zip(A, B, strict=True)])
    return np.linalg.lstsq(rows, rhs, rcond=None)[0]


def with_translation(R, A, B):
    return transforms(R, best_translation(R, A, B))


def nearest(M):
    U, _, Vt = np.linalg.svd(M)
    return U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt


def tsai(A, B):
    P = [[2 * quaternion(T)[1:] for T in pair] for pair in zip(A, B, strict=True)]
    rows = np.concatenate([cross_matrix(a + b) for a, b in P])
    g = np.linalg.lstsq(rows, np.concatenate([b - a for a, b in P]), rcond=None)[0]
    return with_translation(Rotation.from_quat([1, *g], scalar_first=True).as_matrix(), A, B)


def shiu(A, B):
    """The 9 N equations in the nine entries of R and the N pairs (cos, sin), all unknown."""
    N = len(A)
    rows, rhs = np.zeros((9 * N, 9 + 2 * N)), np.zeros(9 * N)
    for i, pair in enumerate(zip(A, B, strict=True)):
        n, m = (v / np.linalg.norm(v) for v in (quaternion(T)[1:] for T in pair))
        # some rotation that carries m to n, and turns about n
        start = Rotation.align_vectors([n, [0.3, 0.4, 0.5]], [m, [0.5, 0.1, 0.2]], weights=[1e12, 1])[0].as_matrix()
        start = Rotation.align_vectors([n], [start @ m])[0].as_matrix() @ start
        k = slice(9 * i, 9 * i + 9)
        rows[k, :9] = np.eye(9)
        rows[k, 9 + 2 * i] = -((np.eye(3) - np.outer(n, n)) @ start).ravel()
        rows[k, 10 + 2 * i] = -(cross_matrix(n) @ start).ravel()
        rhs[k] = (np.outer(n, n) @ start).ravel()
    return with_translation(nearest(np.linalg.lstsq(rows, rhs, rcond=None)[0][:9].reshape(3, 3)), A, B)


def chou(A, B):
    vectors = [[np.r_[0, quaternion(T)[1:]] for T in pair] for pair in zip(A, B, strict=True)]
    rows = [left_matrix(a) - right_matrix(b) for a, b in vectors]
    q = np.linalg.svd(np.concatenate(rows))[2][-1]
    return with_translation(Rotation.from_quat(q, scalar_first=True).as_matrix(), A, B)


def dual(T):
    q = quaternion(T)
    return q, 0.5 * left_matrix(np.r_[0, T[:3, 3]]) @ q


def pose(q, p):
    t = 2 * (right_matrix(q * [1, -1, -1, -1]) @ p)[1:]
    return transforms(Rotation.from_quat(q, scalar_first=True).as_matrix(), t)


def lu(A, B):
    """Over the stacked rows: q' = -E^+ F q with the three large singular values of E; q minimises what is left."""
    parts = [(dual(a), dual(b)) for a, b in zip(A, B, strict=True)]
    E = np.concatenate([left_matrix(a[0]) - right_matrix(b[0]) for a, b in parts])
    F = np.concatenate([left_matrix(a[1]) - right_matrix(b[1]) for a, b in parts])
    U, s, Vt = np.linalg.svd(E, full_matrices=False)
    U, s, Vt = U[:, :3], s[:3], Vt[:3]
    q = np.linalg.svd(np.concatenate([E, F - U @ (U.T @ F)]))[2][-1]
    p = -Vt.T @ ((U.T @ F @ q) / s)
    return pose(q, p - (p @ q) * q)


def condurache(A, B):
    """The dual matrix times the transposed dual tensor of X is symmetric, in its real and in its dual part."""

    def screws(T):
        twists = Rotation.from_matrix(T[:, :3, :3]).as_rotvec()
        # v = J^-1 t by the integral J = int_0^1 exp(s alpha) ds, Gauss-Legendre
        nodes, weights = np.polynomial.legendre.leggauss(20)
        moments = []
        for alpha, t in zip(twists, T[:, :3, 3], strict=True):
            J = sum(
                0.5 * w * Rotation.from_rotvec(0.5 * (s + 1) * alpha).as_matrix()
                for s, w in zip(nodes, weights, strict=True)
            )
            moments.append(np.linalg.solve(J, t))
        return twists, np.array(moments)

    (a, a_dual), (b, b_dual) = screws(A), screws(B)
    H, K = a.T @ b, a.T @ b_dual + a_dual.T @ b
    R = nearest(H)

    def asymmetry(t):
        M = K @ R.T + H @ (cross_matrix(t) @ R).T
        return (M - M.T)[[2, 0, 1], [1, 2, 0]]

    at_zero = asymmetry(np.zeros(3))
    slope = np.column_stack([asymmetry(e) - at_zero for e in np.eye(3)])
    return transforms(R, np.linalg.solve(slope, -at_zero))


@pytest.mark.slow
@pytest.mark.parametrize("reference", [tsai, shiu, chou, lu, condurache], ids=lambda f: f.__name__)
@pytest.mark.parametrize("N", [2, 3, 30])
def test_against_the_stacked_equations(reference, N, rng):
    for _ in range(5):
        _, A, B = noisy_motions(rng, N, 0.03)
        assert np.abs(difference(uq.solve(A, B, method=reference.__name__), reference(A, B))).max() < 1e-8
