"""First-order covariances against derivatives of `solve` itself, pair by pair and pose by pose.

The reference of almost every test is the numerical Jacobian of `uq.solve` by all inputs (central differences of
fourth order, one batched call): it knows nothing of the formulas of T3, T4 or (39)-(48).
"""

import numpy as np
import pytest
from hypothesis import strategies as st
from support import (
    assert_same_covariance,
    cross_matrix,
    difference,
    exact_motions,
    exact_poses,
    holds_for,
    jacobian,
    left_matrix,
    moved,
    noisy_motions,
    random_covariance,
    random_transforms,
    right_matrix,
    rotations,
    transforms,
    whitened_eigenvalues,
)

import uq_handeye as uq
from uq_handeye.core.geometry.checks import CHUNK
from uq_handeye.methods.scaled import solve_scaled

# (scale, relative tolerance): rounding of `solve` at finite d is eps d in the translation, and at d = 1e4 the
# step of 1e-3 divides it; at d = 1e3 the remapping to SE(3) leaves terms of the order of 1/d^2.
SCALES = pytest.mark.parametrize(("scale", "tolerance"), [(None, 1e-8), (1e3, 1e-5), (1e4, 1e-5)])
SETUPS = pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])


def block_diagonal(blocks, n):
    S = np.zeros((n, 6, n, 6))
    S[np.arange(n), :, np.arange(n), :] = blocks
    return S.reshape(6 * n, 6 * n)


def derivative_by_pairs(A, B, of):
    """(D_A, D_B): derivatives of ``of(A, B)`` by the errors of all motions, (k, 6N) each."""
    N = len(A)

    def by_A(xi):
        return of(moved(A, xi.reshape(-1, N, 6)), np.broadcast_to(B, (len(xi), N, 4, 4)))

    def by_B(xi):
        return of(np.broadcast_to(A, (len(xi), N, 4, 4)), moved(B, xi.reshape(-1, N, 6)))

    return jacobian(by_A, 6 * N), jacobian(by_B, 6 * N)


def pose_derivative(A, B, scale=None):
    X = uq.solve(A, B, scale=scale)
    return derivative_by_pairs(A, B, lambda a, b: difference(uq.solve(a, b, scale=scale), X))


def derivative_by_poses(robot, camera, setup, pairs, scale=None):
    """(D_robot, D_camera): derivatives of X by the errors of all poses, (6, 6n) each."""
    n = len(robot)

    def solved(G, C):
        motions = uq.relative_motions(uq.PosePairs(G, C, setup), pairs)
        return uq.solve(motions.A, motions.B, scale=scale)

    X = solved(robot, camera)

    def by_robot(xi):
        return difference(solved(moved(robot, xi.reshape(-1, n, 6)), np.tile(camera, (len(xi), 1, 1, 1))), X)

    def by_camera(xi):
        return difference(solved(np.tile(robot, (len(xi), 1, 1, 1)), moved(camera, xi.reshape(-1, n, 6))), X)

    return jacobian(by_robot, 6 * n), jacobian(by_camera, 6 * n)


def noisy_poses(rng, n, setup="eye-in-hand", sd=0.02):
    _, robot, camera = exact_poses(rng, n, setup)
    return tuple(moved(T, sd * rng.normal(size=(n, 6))) for T in (robot, camera))


# -------------------------------------------------------------------------------------------- pairs, T3


@pytest.mark.slow
@SCALES
@pytest.mark.parametrize("shapes", [((), ()), ((7,), (7,)), ((), (7,)), (None, ()), ((7,), None)], ids=str)
def test_pairs(rng, scale, tolerance, shapes):
    """Noisy data, so that terms that vanish without noise count; full covariances, common or per pair."""
    N = 7
    _, A, B = noisy_motions(rng, N, 0.02)
    S = [None if shape is None else random_covariance(rng, 6, shape) for shape in shapes]
    covariance = uq.propagate(A, B, uq.PairNoise(*S), scale=scale)
    reference = sum(
        D @ block_diagonal(side, N) @ D.T
        for D, side in zip(pose_derivative(A, B, scale), S, strict=True)
        if side is not None
    )
    assert_same_covariance(covariance, reference, tolerance)
    np.testing.assert_array_equal(
        covariance, uq.propagate(uq.Motions(A, B), uq.PairNoise(*S), scale=scale, kind="pairs")
    )


def loop_T3(A, B, X, S_A, S_B):
    """T3 word by word, pair by pair, in plain matrices; for any X, with M of the symmetric part."""
    R, t = X[:3, :3], X[:3, 3]
    G, h_theta = np.zeros((3, 3)), np.zeros((3, 3))
    S = np.zeros((6, 6))
    for a, b, s_a, s_b in zip(A, B, S_A, S_B, strict=True):
        parts = []
        for T in (a, b):
            R_T, t_T = T[:3, :3], T[:3, 3]
            K = 0.5 * (R_T - R_T.T)
            u, w = np.array([K[2, 1], K[0, 2], K[1, 0]]), 0.5 * (t_T + R_T.T @ t_T)
            du = np.hstack([0.5 * (np.trace(R_T) * np.eye(3) - R_T), np.zeros((3, 3))])
            dw = np.hstack([0.5 * R_T.T @ cross_matrix(t_T), 0.5 * (np.eye(3) + R_T.T)])
            parts.append((u, w, du, dw))
        (u, w, du, dw), (v, z, dv, dz) = parts
        p, q, dp, dq = R @ v, R @ z, R @ dv, R @ dz
        cu, cw, cp, cq, ct = (cross_matrix(x) for x in (u, w, p, q, t))
        G += np.outer(u, p)
        # h = u x (t x p) + w x p + u x q
        h_p, h_q = cu @ ct + cw, cu
        h_theta += -h_p @ cp - h_q @ cq
        F_A = np.vstack([-cp @ du, -cross_matrix(np.cross(t, p)) @ du - cp @ dw - cq @ du])
        F_B = np.vstack([cu @ dp, h_p @ dp + h_q @ dq])
        S += F_A @ s_a @ F_A.T + F_B @ s_b @ F_B.T
    M_inverse = np.linalg.inv(np.trace(G) * np.eye(3) - 0.5 * (G + G.T))
    Q = np.block([[-M_inverse, np.zeros((3, 3))], [M_inverse @ h_theta @ M_inverse, -M_inverse]])
    return Q @ S @ Q.T


@pytest.mark.slow
@holds_for(seed=st.integers(0, 2**32 - 1), N=st.integers(3, 12), log_sd=st.floats(-4, -1.5), away=st.floats(0, 0.02))
def test_pairs_against_T3_pair_by_pair(seed, N, log_sd, away):
    """Equality at the solution, and at another X given by the user."""
    rng = np.random.default_rng(seed)
    X, A, B = noisy_motions(rng, N, 10**log_sd)
    noise = uq.PairNoise(random_covariance(rng, 6, (N,)), random_covariance(rng, 6, (N,)))
    for at in (None, moved(X, away * rng.normal(size=6))):
        reference = loop_T3(A, B, uq.solve(A, B) if at is None else at, noise.A, noise.B)
        assert_same_covariance(uq.propagate(A, B, noise, X=at), reference, 1e-6)


@pytest.mark.parametrize("angle", [1e-3, 0.03, 1.0, np.pi / 2, np.pi - 0.03, np.pi - 1e-3])
def test_pairs_at_every_angle(rng, angle):
    _, A, B = noisy_motions(rng, 8, 1e-3 * np.sin(angle), smallest=angle, largest=angle)
    S = random_covariance(rng)
    reference = loop_T3(A, B, uq.solve(A, B), [S] * 8, [S] * 8)
    assert_same_covariance(uq.propagate(A, B, uq.PairNoise(S, S)), reference, 1e-10 / np.sin(angle) ** 2)


@SCALES
def test_X_given_is_X_solved(rng, scale, tolerance):
    _, A, B = noisy_motions(rng, 7, 0.02)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    given = uq.propagate(A, B, noise, X=uq.solve(A, B, scale=scale), scale=scale)
    assert_same_covariance(given, uq.propagate(A, B, noise, scale=scale), tolerance)
    truth, A, B = exact_motions(rng, 7)
    given = uq.propagate(A, B, noise, X=truth, scale=scale)
    assert_same_covariance(given, uq.propagate(A, B, noise, scale=scale), tolerance)


def test_a_wrong_covariance_is_noticed(rng):
    """The judge of this file: 1 % in one standard deviation, a lost correlation, a lost side."""
    _, A, B = noisy_motions(rng, 7, 0.02)
    S = random_covariance(rng)
    covariance = uq.propagate(A, B, uq.PairNoise(S, S))
    stretched = covariance * np.where(np.arange(6) == 4, 1.01, 1) * np.where(np.arange(6) == 4, 1.01, 1)[:, None]
    uncorrelated = covariance.copy()
    uncorrelated[:3, 3:] = uncorrelated[3:, :3] = 0
    for wrong in (stretched, uncorrelated, uq.propagate(A, B, uq.PairNoise(S))):
        with pytest.raises(AssertionError):
            assert_same_covariance(wrong, covariance, 1e-3)


def test_linear_in_the_noise_and_additive(rng):
    _, A, B = noisy_motions(rng, 7, 0.02)
    S, other = random_covariance(rng), random_covariance(rng, 6, (7,))
    both = uq.propagate(A, B, uq.PairNoise(S, other))
    parts = uq.propagate(A, B, uq.PairNoise(A=S)) + uq.propagate(A, B, uq.PairNoise(B=other))
    assert_same_covariance(both, parts, 1e-10)
    assert_same_covariance(uq.propagate(A, B, uq.PairNoise(9 * S, 9 * other)), 9 * both, 1e-10)


def test_singular_noise(rng):
    """Noise in one coordinate only: rank one per pair, still the sum of its parts."""
    _, A, B = noisy_motions(rng, 7, 0.02)
    parts = []
    for k in range(6):
        S = np.zeros((6, 6))
        S[k, k] = 1e-6
        parts.append(uq.propagate(A, B, uq.PairNoise(A=S)))
    assert_same_covariance(sum(parts), uq.propagate(A, B, uq.PairNoise(A=1e-6 * np.eye(6))), 1e-9)
    # An exactly known A and B carry nothing.
    np.testing.assert_array_equal(uq.propagate(A, B, uq.PairNoise(A=np.zeros((6, 6)))), np.zeros((6, 6)))
    # Translation noise does not reach the rotation.
    assert np.abs(parts[4][:3]).max() == 0


def test_more_data_averages(rng):
    """k copies of each pair with independent noise: the covariance falls as 1/k."""
    _, A, B = noisy_motions(rng, 7, 0.02)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    nine = uq.propagate(np.tile(A, (9, 1, 1)), np.tile(B, (9, 1, 1)), noise)
    assert_same_covariance(9 * nine, uq.propagate(A, B, noise), 1e-10)


def test_frame_of_A(rng):
    """(P A P^-1, B, P X): the covariance moves as the error of P X does."""
    _, A, B = noisy_motions(rng, 7, 0.02)
    S = random_covariance(rng)
    P = random_transforms(rng)
    R = P[:3, :3]
    J = np.block([[R, np.zeros((3, 3))], [np.zeros((3, 3)), R]])  # left rotation, additive translation
    only_B = uq.PairNoise(B=S)
    moved_frame = uq.propagate(P @ A @ np.linalg.inv(P), B, only_B)
    assert_same_covariance(moved_frame, J @ uq.propagate(A, B, only_B) @ J.T, 1e-9)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
@SCALES
def test_units_are_free(rng, scale, tolerance, unit):
    _, A, B = noisy_motions(rng, 7, 0.02)
    S = random_covariance(rng)
    U = np.diag([1, 1, 1, unit, unit, unit])
    other = A.copy(), B.copy()
    for T in other:
        T[:, :3, 3] *= unit
    there = uq.propagate(*other, uq.PairNoise(U @ S @ U, U @ S @ U), scale=scale and scale * unit)
    assert_same_covariance(there, U @ uq.propagate(A, B, uq.PairNoise(S, S), scale=scale) @ U, tolerance)


# -------------------------------------------------------------------------------------- poses, T4 and T4b

CUSTOM = [[0, 4], [4, 2], [1, 0], [3, 1], [2, 4], [0, 4]]


@pytest.mark.slow
@SETUPS
@pytest.mark.parametrize("pairs", ["consecutive", "all", "disjoint", CUSTOM], ids=str)
@pytest.mark.parametrize("kind", ["common", "per pose", "joint", "joint, strongly correlated", "mixed"])
def test_poses(rng, setup, pairs, kind):
    """Every way to give the noise, every way to pair, both setups, against derivatives through the pairs."""
    n = 6
    robot, camera = noisy_poses(rng, n, setup)
    common, per_pose = random_covariance(rng), random_covariance(rng, 6, (n,))
    joint = random_covariance(rng, 6 * n)
    shared = np.tile(random_covariance(rng, sd=3e-3), (n, n)) + block_diagonal(random_covariance(rng, sd=1e-4), n)
    S_G, S_C = {
        "common": (common, common),
        "per pose": (per_pose, per_pose[::-1]),
        "joint": (joint, joint[::-1, ::-1]),
        "joint, strongly correlated": (shared, shared),
        "mixed": (per_pose, joint),
    }[kind]
    motions = uq.relative_motions(uq.PosePairs(robot, camera, setup), pairs)
    D_G, D_C = derivative_by_poses(robot, camera, setup, pairs)

    def whole(S):
        return S if S.shape == (6 * n, 6 * n) else block_diagonal(S, n)

    by_robot, by_camera = D_G @ whole(S_G) @ D_G.T, D_C @ whole(S_C) @ D_C.T
    assert_same_covariance(uq.propagate(motions, uq.PoseNoise(S_G, S_C)), by_robot + by_camera, 1e-7)
    assert_same_covariance(uq.propagate(motions, uq.PoseNoise(robot=S_G)), by_robot, 1e-7)
    assert_same_covariance(uq.propagate(motions, noise=uq.PoseNoise(camera=S_C), kind="poses"), by_camera, 1e-7)


@SETUPS
@pytest.mark.parametrize("scale", [1e3, 1e4])
def test_poses_at_finite_scale(rng, setup, scale):
    n = 6
    robot, camera = noisy_poses(rng, n, setup)
    motions = uq.relative_motions(uq.PosePairs(robot, camera, setup), "all")
    S_G, S_C = random_covariance(rng, 6, (n,)), random_covariance(rng, 6 * n)
    D_G, D_C = derivative_by_poses(robot, camera, setup, "all", scale)
    reference = D_G @ block_diagonal(S_G, n) @ D_G.T + D_C @ S_C @ D_C.T
    assert_same_covariance(uq.propagate(motions, uq.PoseNoise(S_G, S_C), scale=scale), reference, 1e-5)


@SETUPS
@pytest.mark.parametrize("joint", [False, True])
def test_poses_taken_as_if_each_pair_had_its_own(rng, setup, joint):
    """kind="pairs" with PoseNoise is T3 with the covariance of each A_ij and B_ij."""
    n = 6
    robot, camera = noisy_poses(rng, n, setup)
    poses = uq.PosePairs(robot, camera, setup)
    motions = uq.relative_motions(poses, "all")
    S_G = random_covariance(rng, 6, (n,))
    S_C = random_covariance(rng, 6 * n) if joint else random_covariance(rng, 6, (n,))
    own = S_C.reshape(n, 6, n, 6)[np.arange(n), :, np.arange(n), :] if joint else S_C
    S_A, S_B = np.zeros((2, motions.N, 6, 6))
    for k, pair in enumerate(motions.pairs):

        def both(xi, k=k, pair=pair):  # robot i, robot j, camera i, camera j
            G = moved(robot[pair], xi.reshape(-1, 4, 6)[:, :2])
            C = moved(camera[pair], xi.reshape(-1, 4, 6)[:, 2:])
            one = uq.relative_motions(uq.PosePairs(G, C, setup), [[0, 1]])
            return np.concatenate([difference(one.A[:, 0], motions.A[k]), difference(one.B[:, 0], motions.B[k])], 1)

        J = jacobian(both, 24)
        S_A[k] = J[:6, :12] @ block_diagonal(S_G[pair], 2) @ J[:6, :12].T
        S_B[k] = J[6:, 12:] @ block_diagonal(own[pair], 2) @ J[6:, 12:].T
    covariance = uq.propagate(motions, uq.PoseNoise(S_G, S_C), kind="pairs")
    reference = uq.propagate(motions.A, motions.B, uq.PairNoise(S_A, S_B))
    assert_same_covariance(covariance, reference, 1e-7)
    # and it is not what the shared poses give
    shared = uq.propagate(motions, uq.PoseNoise(S_G, S_C))
    assert whitened_eigenvalues(shared, covariance).max() > 1.2


def test_disjoint_pairs_share_nothing(rng):
    robot, camera = noisy_poses(rng, 8)
    motions = uq.relative_motions(uq.PosePairs(robot, camera), "disjoint")
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng, 6, (8,)))
    assert_same_covariance(uq.propagate(motions, noise, kind="pairs"), uq.propagate(motions, noise), 1e-12)


def test_a_joint_covariance_of_independent_poses_is_the_independent_one(rng):
    robot, camera = noisy_poses(rng, 6)
    motions = uq.relative_motions(uq.PosePairs(robot, camera), "all")
    S = random_covariance(rng, 6, (6,))
    one = uq.propagate(motions, uq.PoseNoise(camera=S))
    assert_same_covariance(uq.propagate(motions, uq.PoseNoise(camera=block_diagonal(S, 6))), one, 1e-10)


@SETUPS
def test_a_common_error_of_the_base_cancels(rng, setup):
    """All robot poses turned and moved together by exp(zeta): no motion changes, nor does X (eye-in-hand).

    For eye-to-hand the base is X's own frame, and X moves with it.
    """
    robot, camera = noisy_poses(rng, 6, setup)
    motions = uq.relative_motions(uq.PosePairs(robot, camera, setup), "all")
    zeta = np.vstack([np.eye(6)] * 6)  # one twist for all poses, as (theta, tau + theta x t)
    for k in range(6):
        zeta[6 * k + 3 : 6 * k + 6, :3] = -cross_matrix(robot[k, :3, 3])
    covariance = uq.propagate(motions, uq.PoseNoise(robot=1e-6 * zeta @ zeta.T))
    if setup == "eye-in-hand":
        assert np.abs(covariance).max() < 1e-18
    else:
        motion = np.eye(6)
        motion[3:, :3] = -cross_matrix(uq.solve(motions.A, motions.B)[:3, 3])
        assert_same_covariance(covariance, 1e-6 * motion @ motion.T, 1e-9)


# ----------------------------------------------------------------------------------------- batches, chunks


@pytest.mark.parametrize("scale", [None, 1e3])
def test_batch_of_pairs_is_a_loop(rng, scale):
    _, A, B = noisy_motions(rng, 7, 0.02, (2, 3))
    for noise in (uq.PairNoise(random_covariance(rng), random_covariance(rng, 6, (7,))),):
        batch = uq.propagate(A, B, noise, scale=scale)
        assert batch.shape == (2, 3, 6, 6)
        at_X = uq.propagate(A, B, noise, scale=scale, X=uq.solve(A, B, scale=scale))
        mixed = uq.propagate(A, B[0, 1], noise, scale=scale)
        common_X = uq.propagate(A, B, noise, scale=scale, X=uq.solve(A[0, 0], B[0, 0]))
        for k in np.ndindex(2, 3):
            assert_same_covariance(batch[k], uq.propagate(A[k], B[k], noise, scale=scale), 1e-9)
            assert_same_covariance(at_X[k], batch[k], 1e-5)
            assert_same_covariance(mixed[k], uq.propagate(A[k], B[0, 1], noise, scale=scale), 1e-9)
            one = uq.propagate(A[k], B[k], noise, scale=scale, X=uq.solve(A[0, 0], B[0, 0]))
            assert_same_covariance(common_X[k], one, 1e-9)


@pytest.mark.slow
@SETUPS
@pytest.mark.parametrize("kind", ["poses", "pairs"])
@pytest.mark.parametrize("scale", [None, 1e3])
def test_batch_of_poses_is_a_loop(rng, setup, kind, scale):
    _, robot, camera = exact_poses(rng, 5, setup)
    robot, camera = (moved(T, 0.02 * rng.normal(size=(2, 3, 5, 6))) for T in (robot, camera))
    for noise in (
        uq.PoseNoise(random_covariance(rng), random_covariance(rng, 6, (5,))),
        uq.PoseNoise(camera=random_covariance(rng, 30)),
    ):
        batch = uq.propagate(
            uq.relative_motions(uq.PosePairs(robot, camera, setup), "all"), noise, kind=kind, scale=scale
        )
        assert batch.shape == (2, 3, 6, 6)
        for k in np.ndindex(2, 3):
            motions = uq.relative_motions(uq.PosePairs(robot[k], camera[k], setup), "all")
            assert_same_covariance(batch[k], uq.propagate(motions, noise, kind=kind, scale=scale), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("extra", [0, 1])
def test_many_pairs_are_the_loop_over_pairs(rng, extra):
    """Across the chunk boundary, with covariances that differ from pair to pair."""
    N = CHUNK + extra
    _, A, B = noisy_motions(rng, N, 0.02)
    S_A, S_B = random_covariance(rng, 6, (2, N))
    S_A[-1] *= 1e8  # the last pair shows
    noise = uq.PairNoise(S_A, S_B)
    reference = loop_T3(A, B, uq.solve(A, B), S_A, S_B)
    assert_same_covariance(uq.propagate(A, B, noise), reference, 1e-9)
    S_A[-1] *= 0.9
    assert whitened_eigenvalues(uq.propagate(A, B, uq.PairNoise(S_A, S_B)), reference).min() < 0.99


def test_many_problems_are_a_loop(rng):
    """More problems than fit one block of trials."""
    T = CHUNK // 7 + 2
    _, A, B = noisy_motions(rng, 7, 0.02, (T,))
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng, 6, (7,)))
    batch = uq.propagate(A, B, noise)
    for k in (0, 1, T // 2, T - 3, T - 2, T - 1):
        assert_same_covariance(batch[k], uq.propagate(A[k], B[k], noise), 1e-9)


@pytest.mark.slow
def test_many_poses(rng):
    """All pairs of so many poses that they take several chunks: sums over shared poses run across them."""
    n = int(np.sqrt(2 * CHUNK)) + 30
    robot, camera = noisy_poses(rng, n)
    motions = uq.relative_motions(uq.PosePairs(robot, camera), "all")
    assert motions.N > CHUNK
    S = random_covariance(rng, 6, (n,))
    covariance = uq.propagate(motions, uq.PoseNoise(camera=S))
    # Derivatives by the poses, in chunks of the user's making: a joint covariance with one pose's noise each.
    parts = np.zeros((6, 6))
    for k in range(0, n, 40):
        some = np.zeros_like(S)
        some[k : k + 40] = S[k : k + 40]
        parts += uq.propagate(motions, uq.PoseNoise(camera=some))
    assert_same_covariance(covariance, parts, 1e-9)
    X = uq.solve(motions.A, motions.B)
    for k in (0, n - 1):  # and by differences for the first and the last pose
        only = np.zeros_like(S)
        only[k] = S[k]

        def solved(xi, k=k, X=X):
            C = np.tile(camera, (len(xi), 1, 1, 1))
            C[:, k] = moved(camera[k], xi)
            m = uq.relative_motions(uq.PosePairs(np.tile(robot, (len(xi), 1, 1, 1)), C), "all")
            return difference(uq.solve(m.A, m.B), X)

        D = jacobian(solved, 6, step=0.05)
        one = uq.propagate(motions, uq.PoseNoise(camera=only))
        scale = np.sqrt(np.diag(one))
        np.testing.assert_allclose(one / scale / scale[:, None], D @ S[k] @ D.T / scale / scale[:, None], atol=1e-3)


# ----------------------------------------------------------------------- finite d: the octonion, (39)-(59)


def test_paper_route_tends_to_the_limit(rng):
    """T3: relative difference 7e-7 at d = 1e3, falling as 1/d^2 until rounding takes over at about 1e4."""
    _, A, B = noisy_motions(rng, 20, 0.01)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    limit = uq.propagate(A, B, noise)

    def off(d):
        return np.abs(whitened_eigenvalues(uq.propagate(A, B, noise, scale=d), limit) - 1).max()

    far, near = off(1e2), off(1e3)
    assert np.log10(far / near) == pytest.approx(2, abs=0.05)
    assert near < 2e-5
    assert off(1e4) < 1e-6
    assert off(1e5) < 1e-4
    assert off(1e6) < 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("scale", [3.0, 30.0, 300.0])
@pytest.mark.parametrize("sides", ["A", "B", "AB"])
def test_octonion_covariance(rng, scale, sides):
    """All of (48), at d so small that terms in 1/d count: by differences of sigma itself."""
    N = 7
    _, A, B = noisy_motions(rng, N, 0.02)
    S = {side: random_covariance(rng, 6, (N,) if side == "A" else ()) for side in sides}
    found = uq.octonion_covariance(A, B, uq.PairNoise(**S), scale=scale)
    sigma = solve_scaled(A, B, scale).sigma
    np.testing.assert_array_equal(found.sigma, sigma)
    D = dict(zip("AB", derivative_by_pairs(A, B, lambda a, b: solve_scaled(a, b, scale).sigma), strict=True))
    reference = sum(D[side] @ block_diagonal(S[side], N) @ D[side].T for side in sides)
    # Rank 6: the norms of q_L and q_R are fixed. Compare on the tangent space, whitened.
    tangent = np.zeros((8, 6))
    tangent[:4, :3] = np.linalg.svd(sigma[None, :4])[2][1:].T
    tangent[4:, 3:] = np.linalg.svd(sigma[None, 4:])[2][1:].T
    assert_same_covariance(tangent.T @ found.covariance @ tangent, tangent.T @ reference @ tangent, 1e-7)
    size = np.abs(found.covariance).max()
    np.testing.assert_allclose(found.covariance[:4] @ tangent, reference[:4] @ tangent, rtol=0, atol=1e-8 * size)
    for half in (slice(0, 4), slice(4, 8)):  # sigma^T Sigma = 0, quaternion by quaternion
        np.testing.assert_allclose(found.covariance[:, half] @ sigma[half], 0, rtol=0, atol=1e-12 * size)
    # The cross block (46)-(47) is not small, and without it the whole is noticeably wrong.
    split = found.covariance.copy()
    split[:4, 4:] = split[4:, :4] = 0
    eigenvalues = whitened_eigenvalues(tangent.T @ split @ tangent, tangent.T @ reference @ tangent)
    assert np.abs(eigenvalues - 1).max() > 0.1


def test_octonion_covariance_batches(rng):
    _, A, B = noisy_motions(rng, 7, 0.02, (2, 3))
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng, 6, (7,)))
    for literal in (False, True):
        batch = uq.octonion_covariance(A, B, noise, scale=10, literal=literal)
        assert batch.sigma.shape == (2, 3, 8)
        for k in np.ndindex(2, 3):
            one = uq.octonion_covariance(A[k], B[k], noise, scale=10, literal=literal)
            np.testing.assert_allclose(batch.sigma[k], one.sigma, rtol=0, atol=1e-12)
            np.testing.assert_allclose(batch.covariance[k], one.covariance, rtol=1e-8, atol=1e-14)


def test_octonion_covariance_refuses(rng):
    _, A, B = exact_motions(rng, 7)
    with pytest.raises(uq.InputError, match="`noise` to be PairNoise, got PoseNoise"):
        uq.octonion_covariance(A, B, uq.PoseNoise(np.eye(6)))
    with pytest.raises(uq.InputError, match="`A` to cover 7 motions, got 6"):
        uq.octonion_covariance(A, B, uq.PairNoise(random_covariance(rng, 6, (6,))))


def test_paper_covariances_are_moments_of_the_matrix(rng):
    """(53)-(59) at small d: <dR4 dR4^T>, Sigma_t and the cross terms, from differences of R4(sigma)."""
    d = 3.0
    sigma = rng.normal(size=8)
    sigma[:4] /= np.sqrt(2) * np.linalg.norm(sigma[:4])
    sigma[4:] /= np.sqrt(2) * np.linalg.norm(sigma[4:])
    S = random_covariance(rng, 8)
    for half in (slice(0, 4), slice(4, 8)):
        P = np.eye(8)
        P[half, half] -= 2 * np.outer(sigma[half], sigma[half])
        S = P @ S @ P.T

    def columns(x):
        s = sigma + x
        return np.swapaxes(2 * left_matrix(s[:, :4]) @ right_matrix(s[:, 4:]), -1, -2)

    D = jacobian(columns, 8).reshape(4, 4, 8)  # [i] = d c_i / d sigma
    found = uq.paper_covariances(sigma, S, d)
    np.testing.assert_allclose(found.R4, sum(c @ S @ c.T for c in D), rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(found.R, found.R4[:3, :3])
    np.testing.assert_allclose(found.t, d**2 * (D[3] @ S @ D[3].T)[:3, :3], rtol=1e-8, atol=1e-14)
    for i in range(3):
        np.testing.assert_allclose(found.R_t[i], d * (D[i] @ S @ D[3].T)[:3, :3], rtol=1e-8, atol=1e-14)


@pytest.mark.parametrize("scale", [1e3, 1e4])
def test_paper_covariances_against_propagate(rng, scale):
    """(58) is tr(Sigma_theta) I - Sigma_theta, (59) the block of the 6x6, (55) its cross block."""
    _, A, B = noisy_motions(rng, 10, 0.02)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    sigma, S = uq.octonion_covariance(A, B, noise, scale=scale)
    found = uq.paper_covariances(sigma, S, scale)
    covariance = uq.propagate(A, B, noise)
    X = uq.solve(A, B)
    theta = covariance[:3, :3]
    tolerance = 100 / scale**2 + 1e-7
    assert_same_covariance(found.R, np.trace(theta) * np.eye(3) - theta, tolerance, 1e-6)
    assert_same_covariance(0.5 * np.trace(found.R) * np.eye(3) - found.R, theta, 10 * tolerance, 1e-6)
    assert_same_covariance(found.t, covariance[3:, 3:], tolerance, 1e-6)
    # <dR_column_i dt^T> = -[R_column_i]x <theta tau^T>
    for i in range(3):
        wanted = -cross_matrix(X[:3, i]) @ covariance[:3, 3:]
        np.testing.assert_allclose(found.R_t[i], wanted, rtol=0, atol=tolerance * np.abs(covariance).max())


def test_so4_covariance(rng):
    """(65)-(66) to first order: against differences of F2(X, d), at a d so small that every term counts."""
    d = 2.0
    X, S = random_transforms(rng, (3,)), random_covariance(rng, 6, (3,))
    found = uq.so4_covariance(X, S, d)
    for k in range(3):
        D = jacobian(lambda xi, k=k: uq.so4_from_se3(moved(X[k], xi), d), 6).reshape(4, 4, 6)
        reference = np.einsum("ijx,xy,kjy->ik", D, S[k], D)
        assert_same_covariance(found[k], reference, 1e-8)
        np.testing.assert_allclose(uq.so4_covariance(X[k], S[k], d), found[k], rtol=1e-14)


@pytest.mark.parametrize("scale", [1e2, 1e3])
def test_paper_covariances_against_so4_covariance(rng, scale):
    """Two ways to <dR4 dR4^T>: through sigma, and from the 6x6 of X. Equal up to 1/d relative to each entry."""
    _, A, B = noisy_motions(rng, 10, 0.02)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    found = uq.paper_covariances(*uq.octonion_covariance(A, B, noise, scale=scale), scale).R4
    reference = uq.so4_covariance(uq.solve(A, B, scale=scale), uq.propagate(A, B, noise, scale=scale), scale)
    unit = np.array([1, 1, 1, scale])  # the last row is of order 1/d
    np.testing.assert_allclose(
        found * unit * unit[:, None], reference * unit * unit[:, None], rtol=0, atol=20 * np.abs(found).max() / scale
    )
    assert_same_covariance(found[:3, :3], reference[:3, :3], 100 / scale**2)


# --------------------------------------------------------------------------------- the literal form of (45)

# (70): covariances of the rotation vector (rad^2) and the translation (m^2).
SIGMA_RB = 1e-5 * np.array(
    [[4.15625, -2.88693, -0.60653], [-2.88693, 32.0952, -0.14482], [-0.60653, -0.14482, 1.43937]]
)
SIGMA_TB = 1e-5 * np.array(
    [[19.52937, 2.12627, -1.06675], [2.12627, 4.44314426, 0.38679], [-1.06675, 0.38679, 2.13070]]
)
EQUATION_70 = uq.PairNoise(
    A=1e-10 * np.eye(6),
    B=np.block([[SIGMA_RB, np.zeros((3, 3))], [np.zeros((3, 3)), SIGMA_TB]]),
)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [None, 1e4])
def test_literal_form_at_equation_70(rng, scale):
    """60 pairs, the noise of (70): (45) predicts standard deviations too small by far, in every direction.

    The mean derivative of N pairs makes the variance N times too small even where all derivatives are alike; motions
    about many axes cancel besides. Measured over 200 random geometries: standard deviations 15 to 2,000 times
    too small, median 72. That the sum over pairs is the right one is confirmed by Monte Carlo in
    test_statistics.py.
    """
    ratios, largest = [], []
    for _ in range(20):
        _, A, B = exact_motions(rng, 60)
        literal = uq.propagate(A, B, EQUATION_70, kind="literal", scale=scale)
        true = uq.propagate(A, B, EQUATION_70)
        ratios.append(np.sqrt(np.diag(true) / np.diag(literal)))
        largest.append(whitened_eigenvalues(literal, true).max())
    assert max(largest) < 1 / 60
    assert np.min(ratios) > np.sqrt(60)
    assert 30 < np.median(ratios) < 200


def test_literal_form_is_45(rng):
    """``D Sigma_b D^T`` with the mean of d sigma / d b_i over pairs and the mean covariance of b, by differences.

    b = (vec E, vec Z) has 32 entries; sigma as a function of them comes from an eigenvalue problem rebuilt here.
    """
    N, d = 5, 10.0
    _, A, B = noisy_motions(rng, N, 0.02)
    noise = uq.PairNoise(random_covariance(rng, 6, (N,)), random_covariance(rng))
    basis = left_matrix(np.eye(4))[:, None] @ right_matrix(np.eye(4))
    found = uq.octonion_covariance(A, B, noise, scale=d, literal=True)

    def octonions(images):  # (T, N, 2, 4, 4): E and Z, free to leave SO(4)
        residual = images[:, :, None, None, 0] @ basis - basis @ images[:, :, None, None, 1]
        q_L = np.linalg.eigh(np.einsum("tnabkj,tncbkj->tac", residual, residual))[1][..., 0]
        q_R = np.linalg.eigh(np.einsum("tnabkj,tnackj->tbc", residual, residual))[1][..., 0]
        q = np.stack([q_L, q_R], axis=1) / np.sqrt(2)
        q *= np.sign(np.sum(q * found.sigma.reshape(2, 4), axis=-1, keepdims=True))
        return q.reshape(-1, 8)

    images = np.stack([uq.so4_from_se3(T, d) for T in (A, B)], axis=1)
    np.testing.assert_allclose(octonions(images[None])[0], found.sigma, rtol=0, atol=1e-10)
    D = jacobian(lambda x: octonions(images + x.reshape(-1, N, 2, 4, 4)), 32 * N).reshape(8, N, 32)
    S_b = np.zeros((32, 32))
    for k in range(N):
        J = np.zeros((32, 12))
        for side, T in enumerate((A, B)):
            rows, columns = slice(16 * side, 16 * side + 16), slice(6 * side, 6 * side + 6)
            J[rows, columns] = jacobian(lambda xi, T=T, k=k: uq.so4_from_se3(moved(T[k], xi), d), 6).reshape(16, 6)
        S = np.zeros((12, 12))
        S[:6, :6], S[6:, 6:] = noise.A[k], noise.B
        S_b += J @ S @ J.T / N
    mean = D.mean(axis=1)
    reference = mean @ S_b @ mean.T
    size = np.sqrt(np.diag(reference))
    np.testing.assert_allclose(
        found.covariance / size / size[:, None], reference / size / size[:, None], rtol=0, atol=1e-7
    )


def test_literal_form_does_not_see_more_data_rightly(rng):
    """N copies of each pair: the truth falls as 1/N, (45) as 1/N^2."""
    N = 6
    _, A, B = noisy_motions(rng, 3, 0.02)
    many = np.tile(A, (N, 1, 1)), np.tile(B, (N, 1, 1))
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    assert_same_covariance(
        uq.propagate(*many, noise, kind="literal") * N**2, uq.propagate(A, B, noise, kind="literal"), 1e-4
    )
    assert_same_covariance(uq.propagate(*many, noise) * N, uq.propagate(A, B, noise), 1e-9)


def test_literal_form_claims_exact_knowledge(rng):
    """On noise-free data (45) has rank 4 of 6.

    Its mean derivative is that of the mean images, theta = M^-1 [u_mean]x (..): u_mean^T M theta has no variance at
    all, and a combination of rotation and translation has none either.
    """
    _, A, B = exact_motions(rng, 60)
    S = A[:, :3, :3] - A[:, :3, :3].mT
    u = 0.5 * np.stack([S[:, 2, 1], S[:, 0, 2], S[:, 1, 0]], axis=1)
    known = (np.sum(u**2) * np.eye(3) - u.T @ u) @ u.mean(axis=0)
    known /= np.linalg.norm(known)
    true = uq.propagate(A, B, EQUATION_70)[:3, :3]
    assert known @ true @ known > 0.01 * np.trace(true)
    for scale in (1e2, 1e3):
        literal = uq.propagate(A, B, EQUATION_70, kind="literal", scale=scale)
        sd = np.sqrt(np.diag(literal))
        eigenvalues = np.linalg.eigvalsh(literal / sd / sd[:, None])
        assert np.abs(eigenvalues[:2]).max() < 1e-9
        assert eigenvalues[2] > 1e-4
        theta = literal[:3, :3]
        assert known @ theta @ known < 100 / scale**2 * np.trace(theta)


def test_literal_form_is_the_octonions(rng):
    """propagate(kind="literal") and octonion_covariance(literal=True) are one thing."""
    _, A, B = noisy_motions(rng, 10, 0.02)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng, 6, (10,)))
    sigma, S = uq.octonion_covariance(A, B, noise, scale=1e3, literal=True)
    found = uq.paper_covariances(sigma, S, 1e3)
    literal = uq.propagate(A, B, noise, scale=1e3, kind="literal")
    assert_same_covariance(found.t, literal[3:, 3:], 1e-5, 1e-6)
    theta = literal[:3, :3]
    assert_same_covariance(found.R, np.trace(theta) * np.eye(3) - theta, 1e-4, 1e-6)
    # None is the paper's d, 1e4
    assert_same_covariance(
        uq.propagate(A, B, noise, kind="literal"), uq.propagate(A, B, noise, kind="literal", scale=1e4), 1e-6
    )


# ---------------------------------------------------------------------------------------- what is refused


def degenerate(rng, kind, N=6):
    X = random_transforms(rng)
    turns = {
        "parallel axes": rng.uniform(0.4, 2, (N, 1)) * [0.6, -0.48, 0.64],
        "pure translation": np.zeros((N, 3)),
        "half turns": np.pi * np.tile(np.eye(3), (N // 3, 1)),
    }[kind]
    A = transforms(rotations(turns), rng.normal(size=(N, 3)))
    return X, A, np.linalg.inv(X) @ A @ X


@pytest.mark.parametrize("kind", ["parallel axes", "pure translation", "half turns"])
@pytest.mark.parametrize("scale", [None, 1e3, 1e4])
@pytest.mark.parametrize("given", [False, True])
def test_degenerate_motions(rng, kind, scale, given):
    X, A, B = degenerate(rng, kind)
    noise = uq.PairNoise.isotropic(A=(1e-3, 1e-3))
    with pytest.raises(uq.DegenerateMotionError) as caught:
        uq.propagate(A, B, noise, X=X if given else None, scale=scale)
    directions = caught.value.directions
    rank = np.linalg.matrix_rank(directions)
    assert rank == (2 if kind == "parallel axes" else 6)
    if kind == "parallel axes":
        lost = directions @ np.array([0.6, -0.48, 0.64, 0, 0, 0]), directions @ np.array([0, 0, 0, 0.6, -0.48, 0.64])
        assert np.abs(lost[0]).max() > 0.1
        assert np.abs(lost[1]).max() > 0.1
    assert "problem" not in str(caught.value)


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("scale", [None, 1e3])
@pytest.mark.parametrize(
    ("at", "value", "message"),
    [((3, 0, 3), np.nan, "finite"), ((3, 0, 0), 1.5, "rotation"), ((3, 3, 3), 1000.0, "last row")],
)
def test_bad_motions(rng, given, scale, at, value, message):
    X, A, B = exact_motions(rng, 7)
    noise = uq.PairNoise.isotropic(A=(1e-3, 1e-3))
    B = B.copy()
    B[at] = value
    with pytest.raises(uq.InputError, match=message) as caught:
        uq.propagate(A, B, noise, X=X if given else None, scale=scale)
    assert "`B`[3]" in str(caught.value)


def test_refuses(rng):
    X, A, B = exact_motions(rng, 7)
    motions = uq.Motions(A, B)
    noise = uq.PairNoise.isotropic(A=(1e-3, 1e-3))
    pose_noise = uq.PoseNoise.isotropic(camera=(1e-3, 1e-3))
    poses = uq.relative_motions(uq.PosePairs(A, B))
    for call, message in (
        (lambda: uq.propagate(A, B), "`noise` to be PairNoise or PoseNoise, got NoneType"),
        (lambda: uq.propagate(A, B, np.eye(6)), "`noise` to be PairNoise or PoseNoise, got ndarray"),
        (lambda: uq.propagate(motions, B, noise), "no `B` beside Motions"),
        (lambda: uq.propagate(motions, noise, noise), "`B`"),
        (lambda: uq.propagate(A, B, pose_noise), "PoseNoise needs Motions that were made from poses"),
        (lambda: uq.propagate(motions, pose_noise), "PoseNoise needs Motions that were made from poses"),
        (lambda: uq.propagate(A, B, noise, kind="poses"), r"`kind` with PairNoise to be .* got 'poses'"),
        (lambda: uq.propagate(poses, pose_noise, kind="literal"), "`kind` with PoseNoise to be .* got 'literal'"),
        (lambda: uq.propagate(A, B, noise, kind="all"), "got 'all'"),
        (lambda: uq.propagate(A, B, uq.PairNoise(A=np.tile(np.eye(6), (6, 1, 1)))), "cover 7 motions, got 6"),
        (lambda: uq.propagate(poses, uq.PoseNoise(np.tile(np.eye(6), (6, 1, 1)))), "cover 7 poses, got 6"),
        (lambda: uq.propagate(poses, uq.PoseNoise(camera=np.eye(48))), "`camera` to cover 7 poses, got 8"),
        (lambda: uq.propagate(A[:1], B[:1], noise), "at least 2 motions"),
        (lambda: uq.propagate(A, B[:6], noise), "same number of motions"),
        (lambda: uq.propagate(A, B, noise, X=2 * X), "`X`"),
        (lambda: uq.propagate(A, B, noise, X=X[:3]), r"`X` to have shape \(\.\.\., 4, 4\)"),
        (lambda: uq.propagate(A, B, noise, X=np.stack([X] * 3)), "`X`"),
        (lambda: uq.propagate(A, B, noise, scale=0), "`scale` to be a positive number"),
        (lambda: uq.propagate(A, B, noise, scale=-1.0), "`scale` to be a positive number"),
        (lambda: uq.propagate(A, B, noise, scale=0, kind="literal"), "`scale` to be a positive number"),
    ):
        with pytest.raises(uq.InputError, match=message):
            call()
