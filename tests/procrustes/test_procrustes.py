"""4DPA: registration, orthonormalisation, X in the limit and at finite d, and what cannot be solved."""

import numpy as np
import pytest
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import RigidTransform, Rotation
from support import (
    difference,
    exact_motions,
    exact_poses,
    holds_for,
    jacobian,
    left_matrix,
    moved,
    noisy_motions,
    random_transforms,
    right_matrix,
    rotations,
    transforms,
)

import uq_handeye as uq
from uq_handeye.core.geometry.checks import CHUNK
from uq_handeye.methods import limit as procrustes
from uq_handeye.methods import scaled as finite_scale

SEEDS = st.integers(0, 2**32 - 1)


def error(X, reference):
    """Largest of the rotation (rad) and the translation (m) that part two poses."""
    return np.abs(difference(X, reference)).max()


def random_rotation(rng, n):
    Q, R = np.linalg.qr(rng.normal(size=(n, n)))
    Q *= np.sign(np.diag(R))
    Q[:, 0] *= np.linalg.det(Q)
    return Q


def small_rotations(rng, n, size, count):
    """exp of random elements of so(n) of the given Frobenius norm."""
    S = rng.normal(size=(count, n, n))
    S -= S.swapaxes(1, 2)
    return np.stack([expm(size * s / np.linalg.norm(s)) for s in S])


# ------------------------------------------------------------------------------- Sub-problem 1, Problem 1


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_orthonormalise_is_a_rotation_and_keeps_rotations(rng, n):
    M = rng.normal(size=(2, 20, n, n))
    R = uq.orthonormalise(M)
    np.testing.assert_allclose(R @ R.mT, np.broadcast_to(np.eye(n), R.shape), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(R), 1, rtol=1e-13)
    np.testing.assert_allclose(uq.orthonormalise(R), R, rtol=0, atol=1e-14)
    np.testing.assert_allclose(uq.orthonormalise(M[1, 7]), R[1, 7], rtol=0, atol=1e-14)


@pytest.mark.slow
@holds_for(seed=SEEDS, n=st.sampled_from([2, 3, 4, 5]), log_noise=st.floats(-6, 0))
def test_orthonormalise_is_nearest(seed, n, log_noise):
    """No rotation near or far is nearer in the Frobenius norm; determinants of both signs."""
    rng = np.random.default_rng(seed)
    M = random_rotation(rng, n) + 10**log_noise * rng.normal(size=(n, n))
    if seed % 3 == 0:
        M[:, 0] *= -1
    R = uq.orthonormalise(M)
    best = np.linalg.norm(R - M)
    others = [turn @ R for size in (1e-4, 1e-2, 0.3) for turn in small_rotations(rng, n, size, 5)]
    others += [random_rotation(rng, n) for _ in range(10)]
    assert min(np.linalg.norm(other - M) for other in others) >= best - 1e-13


def test_orthonormalise_against_scipy(rng):
    """For n = 3: the rotation of SciPy that aligns the columns."""
    for M in rng.normal(size=(20, 3, 3)):
        if np.linalg.det(M) > 0:
            aligned, _ = Rotation.align_vectors(M.T, np.eye(3))
            np.testing.assert_allclose(uq.orthonormalise(M), aligned.as_matrix(), rtol=0, atol=1e-13)


def test_orthonormalise_refuses():
    with pytest.raises(uq.InputError, match=r"`matrix` to have shape \(\.\.\., n, n\), got \(3, 4\)"):
        uq.orthonormalise(np.zeros((3, 4)))
    with pytest.raises(uq.InputError, match="`matrix`"):
        uq.orthonormalise(np.zeros((0, 0)))
    with pytest.raises(uq.InputError, match="`matrix` to be finite"):
        uq.orthonormalise([[1.0, np.nan], [0.0, 1.0]])


def cost(R, t, U, V):
    return np.sum((U @ R.mT + t - V) ** 2)


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_register_recovers(rng, n):
    R, t = random_rotation(rng, n), 10 * rng.normal(size=n)
    U = rng.normal(size=(n + 3, n)) + 5
    found_R, found_t = uq.register(U, U @ R.T + t)
    np.testing.assert_allclose(found_R, R, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found_t, t, rtol=0, atol=1e-12)


@pytest.mark.parametrize("mirror", [False, True])
def test_register_against_scipy(rng, mirror):
    U = rng.normal(size=(30, 3)) * [1, 2, 3]
    V = U @ random_rotation(rng, 3).T + rng.normal(size=3) + 0.3 * rng.normal(size=U.shape)
    if mirror:
        V[:, 0] *= -1  # no rotation fits well
    R, t = uq.register(U, V)
    reference, _ = Rotation.align_vectors(V - V.mean(axis=0), U - U.mean(axis=0))
    np.testing.assert_allclose(R, reference.as_matrix(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(t, V.mean(axis=0) - reference.apply(U.mean(axis=0)), rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("n", [3, 4])
@pytest.mark.parametrize("mirror", [False, True])
def test_register_is_optimal(rng, n, mirror):
    """Against search: 4,000 rotations at random and as many near the solution, each with its best t.

    Then the stationarity that an optimum must have: the derivative of the cost by so(n) is zero.
    """
    U = rng.normal(size=(12, n)) * np.arange(1, n + 1)
    V = U @ random_rotation(rng, n).T + rng.normal(size=n) + 0.2 * rng.normal(size=U.shape)
    if mirror:
        V[:, -1] *= -1
    R, t = uq.register(U, V)
    best = cost(R, t, U, V)
    others = np.stack([random_rotation(rng, n) for _ in range(4000)])
    for size in (1e-5, 1e-3, 0.1, 1.0):
        others = np.concatenate([others, small_rotations(rng, n, size, 500) @ R])
    offsets = V.mean(axis=0) - others @ U.mean(axis=0)
    costs = np.sum((U @ others.mT + offsets[:, None] - V) ** 2, axis=(1, 2))
    assert costs.min() > best * (1 - 1e-12)
    pairs = [(i, j) for i in range(n) for j in range(i)]

    def turned(x):
        S = np.zeros((len(x), n, n))
        for k, (i, j) in enumerate(pairs):
            S[:, i, j], S[:, j, i] = x[:, k], -x[:, k]
        return np.array([[cost(expm(s) @ R, V.mean(axis=0) - expm(s) @ R @ U.mean(axis=0), U, V)] for s in S])

    gradient = jacobian(turned, len(pairs))
    assert np.abs(gradient).max() < 1e-9 * np.sum(V**2)
    for shift in 0.01 * rng.normal(size=(20, n)):
        assert cost(R, t + shift, U, V) > best


def test_register_batch_is_a_loop(rng):
    U, V = rng.normal(size=(2, 2, 3, 9, 4))
    R, t = uq.register(U, V)
    assert R.shape == (2, 3, 4, 4)
    for k in np.ndindex(2, 3):
        one = uq.register(U[k], V[k])
        np.testing.assert_allclose(R[k], one[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(t[k], one[1], rtol=0, atol=1e-12)


@pytest.mark.slow
@holds_for(seed=SEEDS, n=st.sampled_from([2, 3, 4]))
def test_register_moves_with_its_points(seed, n):
    rng = np.random.default_rng(seed)
    U, V = rng.normal(size=(2, 10, n))
    V += 2 * U
    P, Q, a, b = random_rotation(rng, n), random_rotation(rng, n), *rng.normal(size=(2, n))
    R, t = uq.register(U, V)
    R2, t2 = uq.register(U @ Q.T + a, V @ P.T + b)
    np.testing.assert_allclose(R2, P @ R @ Q.T, rtol=0, atol=1e-10)
    np.testing.assert_allclose(t2, P @ t + b - R2 @ a, rtol=0, atol=1e-10)


def test_register_degenerate(rng):
    for n in (3, 4):
        spanning = rng.normal(size=(9, n - 1)) @ rng.normal(size=(n - 1, n))  # n - 1 directions suffice
        R, t = uq.register(spanning, spanning)
        np.testing.assert_allclose(R, np.eye(n), rtol=0, atol=1e-10)
        np.testing.assert_allclose(t, 0, rtol=0, atol=1e-10)
        for points in (
            rng.normal(size=(9, n - 2)) @ rng.normal(size=(n - 2, n)),
            np.tile(rng.normal(size=n), (9, 1)),
            rng.normal(size=(1, n)),
            rng.normal(size=(n - 1, n)),  # n - 1 points span n - 2 directions about their mean
        ):
            with pytest.raises(uq.InputError, match=f"span at least {n - 1} directions"):
                uq.register(points, points)


def test_register_of_mirrored_points(rng):
    """A reflection has a unique nearest rotation unless its last two singular values are equal."""
    U = rng.normal(size=(30, 4)) * [4, 3, 2, 1]
    uq.register(U, U * [1, 1, 1, -1])
    cross = np.concatenate([np.eye(4), -np.eye(4)])
    R, _ = uq.register(cross, cross)
    np.testing.assert_allclose(R, np.eye(4), rtol=0, atol=1e-14)
    with pytest.raises(uq.InputError):
        uq.register(cross, cross * np.array([1, 1, 1, -1]))


def test_register_refuses(rng):
    for shape in ((5, 1), (0, 4), (4, 0)):
        with pytest.raises(uq.InputError):
            uq.register(np.ones(shape), np.ones(shape))
    with pytest.raises(uq.InputError, match="`U`"):
        uq.register([["a", "b"]], [["a", "b"]])
    U = rng.normal(size=(9, 4))
    with pytest.raises(uq.InputError, match=r"same shape .* got \(9, 4\) and \(8, 4\)"):
        uq.register(U, U[:8])
    with pytest.raises(uq.InputError, match="same shape"):
        uq.register(U[0], U[0])
    for bad in (np.nan, np.inf):
        V = U.copy()
        V[3, 2] = bad
        with pytest.raises(uq.InputError, match="to be finite"):
            uq.register(U, V)
        with pytest.raises(uq.InputError, match="to be finite"):
            uq.register(V, U)


# ------------------------------------------------------------------------------------- solve: exact data


@holds_for(seed=SEEDS, N=st.integers(2, 40), log_angle=st.floats(-2.5, 0), log_length=st.floats(-3, 3))
def test_exact_on_exact_motions(seed, N, log_angle, log_length):
    """Angles of 0.003 to 3 rad, lengths of 1 mm to 1 km; two motions suffice."""
    rng = np.random.default_rng(seed)
    largest, length = 3 * 10**log_angle, 10**log_length
    X, A, B = exact_motions(rng, N, smallest=0.5 * largest, largest=largest, length=length)
    xi = difference(uq.solve(A, B), X)
    u = logarithms_of(A)
    u = np.sin(np.linalg.norm(u, axis=1))[:, None] * u / np.linalg.norm(u, axis=1)[:, None]
    s = np.linalg.eigvalsh(u.T @ u)
    condition = np.sqrt(s[2] / (s[0] + s[1])) / min(largest, np.pi - largest)  # of M, and of vee near 0 and pi
    assert np.abs(xi[:3]).max() < 1e-14 * condition * (s[2] / (s[0] + s[1])) ** 0.5
    assert np.abs(xi[3:]).max() < 1e-13 * (length + 1) * condition**2


def logarithms_of(T):
    return Rotation.from_matrix(T[..., :3, :3]).as_rotvec()


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("pairs", ["consecutive", "disjoint", "all"])
def test_exact_on_exact_poses(rng, setup, pairs):
    X, robot, camera = exact_poses(rng, 9, setup)
    motions = uq.relative_motions(uq.PosePairs(robot, camera, setup), pairs)
    assert error(uq.solve(motions.A, motions.B), X) < 1e-13
    assert error(uq.solve(RigidTransform.from_matrix(motions.A), motions.B.tolist()), X) < 1e-13


@pytest.mark.parametrize("angle", [1e-4, 1e-3, 1e-2, 0.1, 1, np.pi - 0.1, np.pi - 1e-2, np.pi - 1e-3])
def test_every_angle(rng, angle):
    """All motions by one angle, small or near pi: rounding of u, eps / sin(angle), turns the translations of A
    and B, which t_X multiplies by 1 / sin(angle) once more."""
    X, A, B = exact_motions(rng, 20, smallest=angle, largest=angle)
    xi = np.abs(difference(uq.solve(A, B), X))
    assert xi[:3].max() < 3e-15 / np.sin(angle)
    assert xi[3:].max() < 3e-15 / np.sin(angle) ** 2


@pytest.mark.parametrize("X", [np.eye(4), np.diag([1.0, -1, -1, 1]), np.diag([-1.0, -1, 1, 1])])
def test_special_X(rng, X):
    B = random_transforms(rng, (10,))
    assert error(uq.solve(X @ B @ X.T, B), X) < 1e-13
    assert error(uq.solve(X @ B @ X.T, B, scale=1e5), X) < 1e-8


def test_result_is_a_pose(rng):
    for scale in (None, 1e2, 1e4):
        _, A, B = noisy_motions(rng, 10, 0.1, (50,))
        X = uq.solve(A, B, scale=scale)
        np.testing.assert_allclose(X[:, :3, :3] @ X[:, :3, :3].mT, np.tile(np.eye(3), (50, 1, 1)), atol=1e-14)
        np.testing.assert_allclose(np.linalg.det(X), 1, rtol=1e-13)
        np.testing.assert_array_equal(X[:, 3], np.tile([0, 0, 0, 1.0], (50, 1)))


# ---------------------------------------------------------------------------- solve: what it solves, T2


def loop_uw(T):
    R, t = T[:3, :3], T[:3, 3]
    S = 0.5 * (R - R.T)
    return np.array([S[2, 1], S[0, 2], S[1, 0]]), 0.5 * (t + R.T @ t)


def loop_T2(A, B):
    """T2 word by word, pair by pair, the rotation by SciPy's Wahba solver."""
    (u, w), (v, z) = (np.array([loop_uw(T) for T in side]).swapaxes(0, 1) for side in (A, B))
    R = Rotation.align_vectors(u, v)[0].as_matrix()
    M, b = np.zeros((3, 3)), np.zeros(3)
    for k in range(len(A)):
        p, q = R @ v[k], R @ z[k]
        M += u[k] @ p * np.eye(3) - 0.5 * (np.outer(u[k], p) + np.outer(p, u[k]))
        b += np.cross(w[k], p) + np.cross(u[k], q)
    return transforms(R, -np.linalg.solve(M, b))


@pytest.mark.slow
@holds_for(seed=SEEDS, N=st.integers(3, 30), log_sd=st.floats(-4, -0.5))
def test_limit_against_T2_pair_by_pair(seed, N, log_sd):
    _, A, B = noisy_motions(np.random.default_rng(seed), N, 10**log_sd)
    reference = loop_T2(A, B)
    sizes = np.linalg.svd(sum(np.outer(loop_uw(a)[0], loop_uw(b)[0]) for a, b in zip(A, B, strict=True)))[1]
    assert error(uq.solve(A, B), reference) < 1e-11 * sizes[0] / (sizes[1] - sizes[2] + 1e-3 * sizes[0])


def test_limit_against_T2_without_a_proper_fit(rng):
    """Inverted B: the best fit is a reflection (det H < 0), and the branch diag(1, 1, -1) must hold."""
    for _ in range(20):
        _, A, B = noisy_motions(rng, 10, 0.05)
        B = np.linalg.inv(B)
        u, v = (np.array([loop_uw(T)[0] for T in side]) for side in (A, B))
        assert np.linalg.det(u.T @ v) < 0
        R = Rotation.align_vectors(u, v)[0].as_matrix()
        np.testing.assert_allclose(uq.solve(A, B)[:3, :3], R, rtol=0, atol=1e-10)


# --------------------------------------------------------------------------- the paper's route, rebuilt here


def paper_image(T, d, sign):
    """(49) for sign +1, (51) for sign -1."""
    R, t = T[:3, :3], T[:3, 3]
    return np.block([[R, t[:, None] / d], [sign * (t @ R)[None] / d, np.ones((1, 1))]])


# R_L(e_a) R_R(e_b) for all a, b
BASIS = left_matrix(np.eye(4))[:, None] @ right_matrix(np.eye(4))


def paper_route(A, B, d, sign=-1):
    """(29)-(35): sixteen matrices J_jk read off the bilinear form, F11 = sum J J^T, F22 = sum J^T J, eigenvectors.

    Gives the rotation on SO(4) and X = (R4[:3, :3], d R4[:3, 3]) without orthonormalisation. Nothing of the package
    is used.
    """
    F11, F22 = np.zeros((2, 4, 4))
    for a, b in zip(A, B, strict=True):
        E, Z = paper_image(a, d, sign), paper_image(b, d, sign)
        residual = E @ BASIS - BASIS @ Z  # (E R - R Z)[k, j] = q_L^T J_jk q_R, R = R_L(q_L) R_R(q_R)
        for j in range(4):
            for k in range(4):
                J = residual[:, :, k, j]
                F11 += J @ J.T
                F22 += J.T @ J
    q_L, q_R = np.linalg.eigh(F11)[1][:, 0], np.linalg.eigh(F22)[1][:, 0]
    R4 = left_matrix(q_L) @ right_matrix(q_R)
    R4 = R4 * np.sign(R4[3, 3])
    return R4, transforms(R4[:3, :3], d * R4[:3, 3])


def test_quaternion_matrices_of_the_reference(rng):
    """The reference itself: products of SciPy's rotations."""
    one, two = Rotation.random(2, rng=rng)
    q, r = one.as_quat(scalar_first=True), two.as_quat(scalar_first=True)
    product = (one * two).as_quat(scalar_first=True)
    for found in (left_matrix(q) @ r, right_matrix(r) @ q):
        assert abs(found @ product) == pytest.approx(1, abs=1e-14)


@pytest.mark.parametrize("scale", [1e3, 1e4, 1e5])
@pytest.mark.parametrize("sd", [0.0, 0.01, 0.1])
def test_finite_scale_is_the_paper(rng, scale, sd):
    """To what orthonormalising changes, |t_X|^2/d^2, and rounding, eps d: below 1e-6, 1e-8 and 1e-8 here."""
    _, A, B = noisy_motions(rng, 20, sd) if sd else exact_motions(rng, 20)
    _, reference = paper_route(A, B, scale)
    X = uq.solve(A, B, scale=scale)
    length = np.linalg.norm(reference[:3, 3])
    relative = np.abs(X - reference)[:3] / np.array([1, 1, 1, length])
    assert relative.max() < 2 * (length / scale) ** 2 + 1e-13 * scale / min(length, 1)


@pytest.mark.parametrize("scale", [10.0, 1e3])
def test_octonion_is_the_paper(rng, scale):
    """sigma before any remapping, at a d so small that every term in 1/d counts."""
    _, A, B = noisy_motions(rng, 20, 0.05)
    sigma = finite_scale.solve_scaled(A, B, scale).sigma
    R4, _ = paper_route(A, B, scale)
    np.testing.assert_allclose(np.linalg.norm(sigma[:4]), np.sqrt(0.5), rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(sigma[4:]), np.sqrt(0.5), rtol=1e-14)
    np.testing.assert_allclose(2 * left_matrix(sigma[:4]) @ right_matrix(sigma[4:]), R4, rtol=0, atol=1e-9)
    assert sigma[0] >= 0


def test_pseudo_inverses(rng):
    """Pseudo-inverses that the covariance needs: (F - lambda I)^+ annihilates q and inverts beside it."""
    _, A, B = noisy_motions(rng, 20, 0.05, (3,))
    solution = finite_scale.solve_scaled(A, B, 10.0)
    for k in range(3):
        F11 = np.zeros((4, 4))
        for a, b in zip(A[k], B[k], strict=True):
            residual = paper_image(a, 10.0, -1) @ BASIS - BASIS @ paper_image(b, 10.0, -1)
            F11 += np.einsum("abkj,cbkj->ac", residual, residual)
        values = np.linalg.eigvalsh(F11)
        np.testing.assert_allclose(
            solution.pinv_L[k], np.linalg.pinv(F11 - values[0] * np.eye(4), rcond=1e-9), rtol=1e-8, atol=1e-12
        )
        q = np.sqrt(2) * solution.sigma[k]
        np.testing.assert_allclose(solution.pinv_L[k] @ q[:4], 0, atol=1e-12)
        np.testing.assert_allclose(solution.pinv_R[k] @ q[4:], 0, atol=1e-12)


# ------------------------------------------------------------------------ the limit and finite d, T2


def test_truncation_falls_as_one_over_d_squared(rng):
    """The measure of "the limit of the paper's route is T2"."""
    _, A, B = noisy_motions(rng, 20, 0.02, (20,))
    limit = uq.solve(A, B)
    errors = np.array([error(uq.solve(A, B, scale=d), limit) for d in (50, 500, 5000)])
    np.testing.assert_allclose(np.log10(errors[:2] / errors[1:]), 2, rtol=0, atol=0.02)
    assert errors[0] > 1e-6  # truncation, not rounding


def F1_limit(A, B):
    """T2 for the map (49): (t - R^T t)/2 stands in the place of w and z."""

    def without(T):
        other = T.copy()  # its w is (t - R^T t)/2: solve (I + R^T) t' = (I - R^T) t
        R_T = T[:, :3, :3].mT
        other[:, :3, 3] = np.linalg.solve(np.eye(3) + R_T, (np.eye(3) - R_T) @ T[:, :3, 3:])[..., 0]
        return other

    return loop_T2(without(A), without(B))


def test_F1_loses_the_translation(rng):
    """F1 F1^T = I + 2 t/d off the diagonal: the nearest rotation on SO(4) holds no translation at all.

    So (49) in Problem 2, rebuilt here, gives the same rotation as (51) and a translation that is wrong at any d,
    without noise; which is why `solve` has no F1.
    """
    X, A, B = exact_motions(rng, 20)
    for d in (1e2, 1e4, 1e5):
        _, found = paper_route(A, B, d, sign=1)
        assert np.abs(found - X)[:3, :3].max() < 5 / d**2 + 1e-11
        assert np.abs(found - X)[:3, 3].max() > 0.05
        assert error(uq.solve(A, B, scale=d), X) < 5 / d**2 + 1e-14 * d
        nearest = uq.orthonormalise(uq.so4_from_se3(X, d, "F1"))
        assert np.abs(d * nearest[:3, 3]).max() < 10 / d
    _, A, B = noisy_motions(rng, 20, 0.02)
    errors = []
    for d in (50, 500):
        _, found = paper_route(A, B, d, sign=1)
        errors.append(np.abs(found - F1_limit(A, B))[:3].max())
    assert np.log10(errors[0] / errors[1]) == pytest.approx(2, abs=0.02)


def test_rounding_grows_with_d(rng):
    """Rounding makes d a compromise: at 1e8 the digits of the translation are lost to eps d."""
    _, A, B = noisy_motions(rng, 20, 0.02, (20,))
    limit = uq.solve(A, B)
    errors = [error(uq.solve(A, B, scale=d), limit) for d in (1e4, 1e5, 1e8)]
    assert errors[0] < 5e-8
    assert errors[1] < 1e-9
    assert 100 * errors[1] < errors[2] < 1e-5


def test_rotation_does_not_depend_on_translations(rng):
    """Not "simultaneous" in the limit; at finite d the dependence falls as 1/d^2."""
    _, A, B = noisy_motions(rng, 20, 0.02)
    other = A.copy()
    other[:, :3, 3] += rng.normal(size=(20, 3))
    np.testing.assert_array_equal(uq.solve(A, B)[:3, :3], uq.solve(other, B)[:3, :3])
    changes = [np.abs(uq.solve(A, B, scale=d)[:3, :3] - uq.solve(other, B, scale=d)[:3, :3]).max() for d in (50, 500)]
    assert np.log10(changes[0] / changes[1]) == pytest.approx(2, abs=0.05)


# ---------------------------------------------------------------------------------------- equivariance

# 4DPA in the limit is equivariant with noise too, not only where its answer is exact.
NOISY = {"seed": SEEDS, "N": st.integers(3, 20), "log_sd": st.floats(-4, -1)}


def noisy(seed, N, log_sd):
    rng = np.random.default_rng(seed)
    _, A, B = noisy_motions(rng, N, 10**log_sd)
    H = sum(np.outer(loop_uw(a)[0], loop_uw(b)[0]) for a, b in zip(A, B, strict=True))
    s = np.linalg.svd(H)[1]
    return rng, A, B, uq.solve(A, B), 1e-12 * (s[0] / (s[1] + np.sign(np.linalg.det(H)) * s[2])) ** 2


@pytest.mark.slow
@holds_for(**NOISY)
def test_frames_of_A_and_B_are_free(seed, N, log_sd):
    """(P A P^-1, Q B Q^-1) has the solution P X Q^-1: gripper and camera frames may be chosen at will."""
    rng, A, B, X, tolerance = noisy(seed, N, log_sd)
    P, Q = random_transforms(rng, (2,), length=2)
    moved_X = uq.solve(P @ A @ np.linalg.inv(P), Q @ B @ np.linalg.inv(Q))
    assert error(moved_X, P @ X @ np.linalg.inv(Q)) < 100 * tolerance
    only_A = uq.solve(P @ A @ np.linalg.inv(P), B)
    assert error(only_A, P @ X) < 100 * tolerance


@pytest.mark.slow
@holds_for(**NOISY)
def test_roles_of_A_and_B_are_free(seed, N, log_sd):
    """A X = X B and B X^-1 = X^-1 A: the paper's naming gives the inverse of our X."""
    _, A, B, X, tolerance = noisy(seed, N, log_sd)
    assert error(uq.solve(B, A), np.linalg.inv(X)) < 10 * tolerance


@pytest.mark.slow
@holds_for(**NOISY)
def test_order_and_sense_of_the_pairs_are_free(seed, N, log_sd):
    rng, A, B, X, tolerance = noisy(seed, N, log_sd)
    order = rng.permutation(N)
    assert error(uq.solve(A[order], B[order]), X) < tolerance
    A, B = A.copy(), B.copy()
    back = rng.random(N) < 0.5
    A[back], B[back] = np.linalg.inv(A[back]), np.linalg.inv(B[back])
    assert error(uq.solve(A, B), X) < tolerance


@pytest.mark.slow
@holds_for(**NOISY, log_unit=st.floats(-3, 3))
def test_units_are_free(seed, N, log_sd, log_unit):
    _, A, B, X, tolerance = noisy(seed, N, log_sd)
    unit = 10**log_unit
    A, B = A.copy(), B.copy()
    A[:, :3, 3] *= unit
    B[:, :3, 3] *= unit
    scaled = uq.solve(A, B)
    np.testing.assert_array_equal(scaled[:3, :3], X[:3, :3])
    np.testing.assert_allclose(scaled[:3, 3] / unit, X[:3, 3], rtol=0, atol=tolerance)
    # at finite d, d is a length too
    one, other = uq.solve(A, B, scale=1e3 * unit), uq.solve(*noisy(seed, N, log_sd)[1:3], scale=1e3)
    np.testing.assert_allclose(one[:3, 3] / unit, other[:3, 3], rtol=0, atol=1e3 * tolerance)


@pytest.mark.slow
@holds_for(**NOISY, repeat=st.integers(2, 5))
def test_repeating_all_pairs_changes_nothing(seed, N, log_sd, repeat):
    _, A, B, X, tolerance = noisy(seed, N, log_sd)
    assert error(uq.solve(np.tile(A, (repeat, 1, 1)), np.tile(B, (repeat, 1, 1))), X) < tolerance


def test_half_turns_count_nothing(rng):
    """Pairs of exactly 180 degrees, even contradicting ones, leave X as it is."""
    _, A, B = noisy_motions(rng, 10, 0.05)
    half = np.stack([np.diag(d) for d in ([1.0, -1, -1, 1], [-1.0, 1, -1, 1], [-1.0, -1, 1, 1])])
    half_A, half_B = half.copy(), half[[1, 2, 0]].copy()
    half_A[:, :3, 3], half_B[:, :3, 3] = 5 * rng.normal(size=(2, 3, 3))
    X = uq.solve(A, B)
    more = uq.solve(np.concatenate([half_A, A]), np.concatenate([half_B, B]))
    assert error(more, X) < 1e-14
    # The last word is the weight sin^2: the same contradiction 1 degree off counts, a little.
    off = half_A @ transforms(rotations(np.deg2rad(1) * np.eye(3)), np.zeros((3, 3)))
    off_B = half_B @ transforms(rotations(np.deg2rad(1) * np.eye(3)), np.zeros((3, 3)))
    assert error(uq.solve(np.concatenate([off, A]), np.concatenate([off_B, B])), X) > 1e-5


# ------------------------------------------------------------------------------ batches, chunks, threads


@pytest.mark.parametrize("scale", [None, 1e3])
def test_batch_is_a_loop(rng, scale):
    _, A, B = noisy_motions(rng, 7, 0.02, (2, 3))
    X = uq.solve(A, B, scale=scale)
    assert X.shape == (2, 3, 4, 4)
    for k in np.ndindex(2, 3):
        assert error(X[k], uq.solve(A[k], B[k], scale=scale)) < 1e-11


@pytest.mark.parametrize("scale", [None, 1e3])
def test_leading_axes_broadcast(rng, scale):
    _, A, B = noisy_motions(rng, 7, 0.02, (2, 3))
    for a, b in ((A, B[0, 1]), (A[0, 1], B), (A[:, :1], B[:1])):
        X = uq.solve(a, b, scale=scale)
        full = uq.solve(*(np.array(np.broadcast_to(T, (2, 3, 7, 4, 4))) for T in (a, b)), scale=scale)
        np.testing.assert_allclose(X, full, rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [None, 1e3])
@pytest.mark.parametrize("shape", [(), (3,)])
@pytest.mark.parametrize("extra", [-1, 0, 1])
def test_chunks_are_seamless(rng, scale, shape, extra):
    """X of many pairs is X of the moments of all its pieces; the last piece has one pair for extra = 1.

    Every piece but the last holds contradicting data of small weight, so that losing any piece shows.
    """
    N = CHUNK + extra
    _, A, B = noisy_motions(rng, N, 0.1, shape)
    A[..., -1, :3, 3] += 1e3  # lost last pairs would show
    X = uq.solve(A, B, scale=scale)
    order = rng.permutation(N)
    assert error(X, uq.solve(A[..., order, :, :], B[..., order, :, :], scale=scale)) < 1e-10
    without = uq.solve(A[..., :-1, :, :], B[..., :-1, :, :], scale=scale)
    assert np.abs(X[..., :3, 3] - without[..., :3, 3]).min() > 1e-6
    if scale is None:
        reference = np.stack(
            [loop_free_T2(a, b) for a, b in zip(*(T.reshape(-1, N, 4, 4) for T in (A, B)), strict=True)]
        )
        assert error(X.reshape(-1, 4, 4), reference) < 1e-12


def loop_free_T2(A, B):
    """T2 in one piece."""

    def uw(T):
        S = 0.5 * (T[:, :3, :3] - T[:, :3, :3].mT)
        return np.stack([S[:, 2, 1], S[:, 0, 2], S[:, 1, 0]], axis=1), 0.5 * (
            T[:, :3, 3] + np.einsum("nji,nj->ni", T[:, :3, :3], T[:, :3, 3])
        )

    (u, w), (v, z) = uw(A), uw(B)
    U, _, Vt = np.linalg.svd(u.T @ v)
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    p, q = v @ R.T, z @ R.T
    M = np.sum(u * p) * np.eye(3) - 0.5 * (u.T @ p + p.T @ u)
    return transforms(R, -np.linalg.solve(M, np.sum(np.cross(w, p) + np.cross(u, q), axis=0)))


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(), (7,), (3 * CHUNK // 10,)])
@pytest.mark.parametrize("cores", [1, 2, 3])
def test_threads_are_seamless(rng, monkeypatch, shape, cores):
    """More than MIN_PAIRS_FOR_THREADS pairs in few or many problems: the same as each problem on its own."""
    monkeypatch.setattr(procrustes, "cores", lambda: cores)
    T = shape[0] if shape else 1
    N = procrustes.MIN_PAIRS_FOR_THREADS // T + 21
    _, A, B = noisy_motions(rng, N, 0.1, shape)
    X = uq.solve(A, B).reshape(-1, 4, 4)
    for k in {0, 1 % T, T // 2, T - 1}:
        one = loop_free_T2(A.reshape(-1, N, 4, 4)[k], B.reshape(-1, N, 4, 4)[k])
        assert error(X[k], one) < 1e-12


def test_results_repeat_to_the_last_bit(rng, monkeypatch):
    """Threads add in a fixed order."""
    monkeypatch.setattr(procrustes, "cores", lambda: 3)
    _, A, B = noisy_motions(rng, procrustes.MIN_PAIRS_FOR_THREADS + 1, 0.1)
    first = uq.solve(A, B)
    for _ in range(3):
        np.testing.assert_array_equal(uq.solve(A, B), first)


def test_input_is_left_alone(rng):
    _, A, B = noisy_motions(rng, 7, 0.02)
    copies = A.copy(), B.copy()
    for scale in (None, 1e4):
        uq.solve(A, B, scale=scale)
        np.testing.assert_array_equal(A, copies[0])
        np.testing.assert_array_equal(B, copies[1])
    A.flags.writeable = B.flags.writeable = False
    uq.solve(A, B)


# ------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize("scale", [None, 1e4])
@pytest.mark.parametrize("side", ["A", "B"])
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        ((3, 0, 0, np.nan), "finite"),
        ((3, 0, 3, np.nan), "finite"),
        ((3, 0, 3, np.inf), "finite"),
        ((3, 1, 1, 2.0), "rotation"),
        ((3, 3, 3, 0.0), "last row"),
    ],
)
def test_bad_matrices_are_named(rng, scale, side, spoil, message):
    _, A, B = exact_motions(rng, 7)
    motions = {"A": A.copy(), "B": B.copy()}
    motions[side][spoil[:3]] = spoil[3]
    with pytest.raises(uq.InputError, match=rf"`{side}`\[3\].*{message}|{message}.*`{side}`\[3\]"):
        uq.solve(motions["A"], motions["B"], scale=scale)


@pytest.mark.parametrize("scale", [None, 1e4])
def test_bad_matrices_are_named_in_any_chunk_and_problem(rng, scale):
    _, A, B = exact_motions(rng, CHUNK + 5)
    B[CHUNK + 3, 0, 0] += 0.1
    with pytest.raises(uq.InputError, match=rf"`B`\[{CHUNK + 3}\] to hold a rotation"):
        uq.solve(A, B, scale=scale)
    _, A, B = exact_motions(rng, 7, (2, 3))
    A[1, 2, 5, 0, 0] += 0.1
    with pytest.raises(uq.InputError, match=r"`A`\[1, 2, 5\] to hold a rotation"):
        uq.solve(A, B, scale=scale)


@pytest.mark.parametrize("scale", [None, 1e4])
def test_left_handed_motions(rng, scale):
    _, A, B = exact_motions(rng, 7)
    with pytest.raises(uq.InputError, match="left-handed"):
        uq.solve(A, B * np.array([-1, 1, 1, 1.0]), scale=scale)


def test_four_decimals_are_used(rng):
    X, A, B = exact_motions(rng, 50)
    assert error(uq.solve(A.round(4), B.round(4)), X) < 2e-4


def test_wrong_shapes_and_arguments(rng):
    _, A, B = exact_motions(rng, 7)
    for bad, message in (
        ((A[0], B[0]), r"`A` to have shape \(\.\.\., N, 4, 4\), got \(4, 4\)"),
        ((A, B[:, :3]), r"`B` to have shape \(\.\.\., N, 4, 4\), got \(7, 3, 4\)"),
        ((A, B[:6]), "same number of motions, got 7 and 6"),
        ((A[:1], B[:1]), "at least 2 motions to determine X, got 1"),
        ((A[:0], B[:0]), "at least 2 motions to determine X, got 0"),
        (
            (np.stack([A] * 2), np.stack([B] * 3)),
            r"leading axes .* broadcast, got \(2, 7, 4, 4\) and \(3, 7, 4, 4\)",
        ),
    ):
        with pytest.raises(uq.InputError, match=message):
            uq.solve(*bad)
    with pytest.raises(uq.InputError, match=r"Expected `method` to be one of tsai, .*, got 'nobody'"):
        uq.solve(A, B, method="nobody")
    for scale in (0, -1.0, np.nan, np.inf, [1e4]):
        with pytest.raises(uq.InputError, match="`scale` to be a positive number or None"):
            uq.solve(A, B, scale=scale)


def test_input_of_the_wrong_type_is_an_InputError(rng):
    _, A, B = exact_motions(rng, 7)
    for scale in ("1e4", [1e4], np.array([1e4])):
        with pytest.raises(uq.InputError, match="`scale`"):
            uq.solve(A, B, scale=scale)
    for bad in ("motions.csv", [np.eye(4), np.eye(3)], None, object()):
        with pytest.raises(uq.InputError, match="`A`"):
            uq.solve(bad, B)
        with pytest.raises(uq.InputError, match="`B`"):
            uq.solve(A, bad)


@pytest.mark.parametrize("scale", [None, 1e4])
def test_overflow_is_refused(rng, scale):
    _, A, B = exact_motions(rng, 7)
    A[:, :3, 3] *= 1e200
    B[:, :3, 3] *= 1e200
    with pytest.raises(uq.InputError, match=r"translation of `A`\[0\]"):
        uq.solve(A, B, scale=scale)


# ------------------------------------------------------------------------------------ degenerate motions

AXIS = np.array([0.6, -0.48, 0.64])


def planar(rng, N=6, noise=0.0):
    """Motions about one axis, with translations in all directions."""
    X = random_transforms(rng)
    A = transforms(rotations(AXIS * rng.uniform(0.4, 2, (N, 1))), rng.normal(size=(N, 3)))
    B = np.linalg.inv(X) @ A @ X
    return X, moved(A, noise * rng.normal(size=(N, 6))), B


def translations(rng, N=6):
    T = transforms(np.tile(np.eye(3), (N, 1, 1)), rng.normal(size=(N, 3)))
    X = random_transforms(rng)
    return X, T, np.linalg.inv(X) @ T @ X


def half_turns(rng, N=6):
    X = random_transforms(rng)
    axis = rng.normal(size=(N, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    R = 2 * axis[:, :, None] * axis[:, None, :] - np.eye(3)
    A = transforms(R, rng.normal(size=(N, 3)))
    return X, A, np.linalg.inv(X) @ A @ X


def normal_equations(A, B, X):
    """f and h of T2, zero at 4DPA's solution."""
    R, t = X[:3, :3], X[:3, 3]
    f, h = np.zeros((2, 3))
    for a, b in zip(A, B, strict=True):
        (u, w), (v, z) = loop_uw(a), loop_uw(b)
        p, q = R @ v, R @ z
        f += np.cross(u, p)
        h += np.cross(u, np.cross(t, p)) + np.cross(w, p) + np.cross(u, q)
    return np.concatenate([f, h])


def test_parallel_axes(rng):
    X, A, B = planar(rng)
    with pytest.raises(uq.DegenerateMotionError, match=r"parallel to \(0.600, -0.480, 0.640\)") as caught:
        uq.solve(A, B)
    directions = caught.value.directions
    assert directions.shape == (2, 6)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-14)
    # the axis of the lost rotation and the lost translation along it
    np.testing.assert_allclose(np.abs(directions[0, :3] @ AXIS) / np.linalg.norm(directions[0, :3]), 1, rtol=1e-12)
    along = directions[1]
    np.testing.assert_allclose(along[:3], 0, atol=1e-12)
    np.testing.assert_allclose(np.abs(along[3:] @ AXIS), 1, rtol=1e-12)
    # Moving X along the axis by any length solves A X = X B as well as X itself.
    for length in (-3, 0.1, 50):
        other = moved(X, length * along)
        np.testing.assert_allclose(A @ other, other @ B, rtol=0, atol=1e-13 * (1 + abs(length)))


def test_parallel_axes_directions_are_those_of_infinite_variance(rng):
    """The variance of a^T xi is infinite if and only if a is not orthogonal to what 4DPA's equations leave open.

    That null space is spanned by (0, axis) and (axis, tau0): the rest of the translation follows the lost rotation.
    The directions named must see all of it.
    """
    X, A, B = planar(rng)
    with pytest.raises(uq.DegenerateMotionError) as caught:
        uq.solve(A, B)
    np.testing.assert_allclose(normal_equations(A, B, X), 0, atol=1e-13)
    J = jacobian(lambda xi: np.stack([normal_equations(A, B, moved(X, x)) for x in xi]), 6)
    _, s, Vt = np.linalg.svd(J)
    assert s[4] < 1e-9 * s[3]  # rank 4
    seen = caught.value.directions @ Vt[4:].T
    assert np.linalg.svd(seen)[1].min() > 0.1
    np.testing.assert_allclose(Vt[4:, :3] - np.outer(Vt[4:, :3] @ AXIS, AXIS), 0, atol=1e-9)
    assert np.abs(np.cross(Vt[4:, 3:], AXIS)).max() > 0.05  # tau0 is not along the axis


def test_nearly_parallel_axes_are_solved(rng):
    """A spread of the axes of 1e-3 rad is information, if little; 1e-7 is not."""
    X = random_transforms(rng)
    for spread, solvable in ((1e-2, True), (1e-3, True), (1e-7, False)):
        axes = AXIS + spread * rng.normal(size=(20, 3))
        A = transforms(rotations(axes * rng.uniform(0.4, 2, (20, 1))), rng.normal(size=(20, 3)))
        B = np.linalg.inv(X) @ A @ X
        if solvable:
            assert error(uq.solve(A, B), X) < 1e-12 / spread**2
        else:
            with pytest.raises(uq.DegenerateMotionError, match="parallel"):
                uq.solve(A, B)


def turned_by(rng, angle, N=6):
    X = random_transforms(rng)
    A = random_transforms(rng, (N,), angle, angle)
    return X, A, np.linalg.inv(X) @ A @ X


NO_ROTATION = {
    "pure translation": translations,
    "half turns": half_turns,
    "no motion": lambda rng: (None, np.tile(np.eye(4), (6, 1, 1)), np.tile(np.eye(4), (6, 1, 1))),
    "angles of 1e-9": lambda rng: turned_by(rng, 1e-9),
    "angles of 180 degrees but 1e-9": lambda rng: turned_by(rng, np.pi - 1e-9),
}


@pytest.mark.parametrize("kind", NO_ROTATION)
def test_no_rotation(rng, kind):
    _, A, B = NO_ROTATION[kind](rng)
    with pytest.raises(uq.DegenerateMotionError, match="0 or 180 degrees") as caught:
        uq.solve(A, B)
    np.testing.assert_array_equal(np.linalg.matrix_rank(caught.value.directions), 6)


@pytest.mark.parametrize("kind", ["parallel axes", *NO_ROTATION])
@pytest.mark.parametrize("scale", [1e2, 1e3, 1e4, 1e5])
def test_degenerate_at_finite_scale(rng, kind, scale):
    """The same motions determine as little of the translation at finite d."""
    _, A, B = planar(rng) if kind == "parallel axes" else NO_ROTATION[kind](rng)
    with pytest.raises(uq.DegenerateMotionError):
        uq.solve(A, B, scale=scale)


@pytest.mark.parametrize("scale", [None, 1e4])
def test_one_degenerate_problem_among_many_is_named(rng, scale):
    _, A, B = exact_motions(rng, 6, (2, 3))
    A[1, 2], B[1, 2] = np.eye(4), np.eye(4)
    with pytest.raises(uq.DegenerateMotionError, match=r"\(problem \(1, 2\)\)"):
        uq.solve(A, B, scale=scale)


def test_the_same_motion_twice_is_one_motion(rng):
    _, A, B = exact_motions(rng, 1)
    with pytest.raises(uq.DegenerateMotionError, match="parallel"):
        uq.solve(np.tile(A, (4, 1, 1)), np.tile(B, (4, 1, 1)))


def test_mirrored_axes(rng):
    """B inverted, with axes alike in all directions: H = -c I, M has the eigenvalues 0, 0, 2c."""
    turns = transforms(rotations(np.concatenate([np.eye(3), -np.eye(3)])), np.zeros((6, 3)))
    with pytest.raises(uq.DegenerateMotionError, match="mirrored") as caught:
        uq.solve(turns, np.linalg.inv(turns))
    assert np.linalg.matrix_rank(caught.value.directions) == len(caught.value.directions) == 4


def test_mirrored_axes_with_a_preferred_one_are_not_called_parallel():
    turns = transforms(rotations(np.arcsin([0.9, 0.3, 0.3])[:, None] * np.eye(3)), np.zeros((3, 3)))
    with pytest.raises(uq.DegenerateMotionError) as caught:
        uq.solve(turns, np.linalg.inv(turns))
    assert "parallel" not in str(caught.value)
    assert len(caught.value.directions) == 2  # the eigenvalues of M are 0, s1 - s2, s1 + s2
    np.testing.assert_allclose(np.abs(caught.value.directions).max(axis=0), [1, 0, 0, 1, 0, 0], atol=1e-12)


def test_degenerate_is_an_input_error():
    """One handler catches both."""
    assert issubclass(uq.DegenerateMotionError, uq.InputError)
    assert issubclass(uq.InputError, ValueError)


# ----------------------------------------------------------------------------------- maps to SO(4)


@pytest.mark.parametrize(("mapping", "sign", "order"), [("F2", -1, 2), ("F1", 1, 1)])
def test_maps_and_back(rng, mapping, sign, order):
    T = random_transforms(rng, (3, 5))
    for d in (1e2, 1e3):
        image = uq.so4_from_se3(T, d, mapping)
        for k in np.ndindex(3, 5):
            np.testing.assert_allclose(image[k], paper_image(T[k], d, sign), rtol=0, atol=1e-15)
        assert error(uq.se3_from_so4(image, d), T) < 1e-12
    # how far from SO(4), and how far back from its nearest rotation: 1/d^2 for F2
    off = [np.abs(E @ E.mT - np.eye(4)).max() for E in (uq.so4_from_se3(T, d, mapping) for d in (1e2, 1e3))]
    assert np.log10(off[0] / off[1]) == pytest.approx(order, abs=0.05)
    back = [error(uq.se3_from_so4(uq.orthonormalise(uq.so4_from_se3(T, d, "F2")), d), T) for d in (1e2, 1e3)]
    assert np.log10(back[0] / back[1]) == pytest.approx(2, abs=0.05)


def test_maps_refuse(rng):
    T = random_transforms(rng)
    for call in (uq.so4_from_se3, uq.se3_from_so4, finite_scale.octonion):
        for scale in (0, -1, np.nan, np.inf):
            with pytest.raises(uq.InputError, match="`scale` to be a positive number"):
                call(T, scale)
    with pytest.raises(uq.InputError, match="`mapping`"):
        uq.so4_from_se3(T, 1e4, "F0")
    with pytest.raises(uq.InputError, match="`T` to hold a rotation"):
        uq.so4_from_se3(np.diag([2.0, 2, 2, 1]), 1e4)
    with pytest.raises(uq.InputError, match=r"`R4` to have shape \(\.\.\., 4, 4\), got \(3, 3\)"):
        uq.se3_from_so4(np.eye(3), 1e4)
    for at in ((0, 0), (0, 3)):
        R4 = np.eye(4)
        R4[at] = np.nan
        with pytest.raises(uq.InputError, match="finite"):
            uq.se3_from_so4(R4, 1e4)


@pytest.mark.parametrize("scale", [1e1, 1e2, 1e3, 1e4])
def test_octonion(rng, scale):
    """R_L(q_L) R_R(q_R) is the rotation on SO(4) nearest to the F2 image, hence the image to |t|^2/d^2."""
    X = random_transforms(rng, (4, 25), 0, np.pi)
    sigma = finite_scale.octonion(X, scale)
    np.testing.assert_allclose(np.sum(sigma[..., :4] ** 2, axis=-1), 0.5, rtol=1e-14)
    np.testing.assert_allclose(np.sum(sigma[..., 4:] ** 2, axis=-1), 0.5, rtol=1e-14)
    R4 = 2 * left_matrix(sigma[..., :4]) @ right_matrix(sigma[..., 4:])
    image = uq.so4_from_se3(X, scale)
    np.testing.assert_allclose(R4, uq.orthonormalise(image), rtol=0, atol=1e-13)
    size = 1 + np.abs(X[..., :3, 3]).max()
    np.testing.assert_allclose(R4, image, rtol=0, atol=2 * size**2 / scale**2 + 1e-14)
    assert (sigma[..., 0] >= 0).all()
    assert (R4[..., 3, 3] > 0).all()


def test_octonion_is_that_of_the_solution(rng):
    """The octonion of X is sigma of Problem 2, sign and all, up to 1/d^2."""
    _, A, B = noisy_motions(rng, 10, 0.02, (30,))
    for scale in (1e2, 1e3):
        solution = finite_scale.solve_scaled(A, B, scale)
        np.testing.assert_allclose(finite_scale.octonion(solution.X, scale), solution.sigma, rtol=0, atol=20 / scale**2)
