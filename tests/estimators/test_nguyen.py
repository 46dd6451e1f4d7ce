"""Nguyen and Pham's method against a literal form of its equations, Monte Carlo sampling, and numerical derivatives."""

import functools

import numpy as np
import pytest
import support
from scipy import stats
from support import (
    SEED,
    assert_same_covariance,
    cross_matrix,
    difference,
    draw,
    exact_motions,
    is_consistent,
    jacobian,
    logarithms,
    mean_interval,
    moved,
    nees,
    noisy_motions,
    random_covariance,
    random_transforms,
    rotation_vectors,
    rotations,
    transforms,
)

import uq_handeye as uq
from uq_handeye.core.geometry import packed3x3 as rows
from uq_handeye.core.geometry.se3 import left_jacobian
from uq_handeye.methods import nguyen_stages
from uq_handeye.methods.nguyen import NguyenDerivatives, covariances_at, nguyen

EQUATION_70 = uq.PairNoise(*support.EQUATION_70)


def isotropic(rotation, translation):
    S = np.diag([rotation**2] * 3 + [translation**2] * 3)
    return uq.PairNoise(S, S)


def sampled(rng, A, B, noise, trials):
    """Noisy copies of A and B, (N, 4, 4) or (trials, N, 4, 4)."""
    return [
        np.broadcast_to(T, (trials, *T.shape[-3:])) if S is None else moved(T, draw(rng, S, (trials, T.shape[-3])))
        for T, S in ((A, noise.A), (B, noise.B))
    ]


def random_problems(rng, trials, N):
    """One X and one set of motions for each trial."""
    X, B = random_transforms(rng, (trials, 1)), random_transforms(rng, (trials, N))
    return X[:, 0], X @ B @ np.linalg.inv(X), B


def along(T, lengths):
    """T with its translations in another unit."""
    return transforms(T[..., :3, :3], T[..., :3, 3] * lengths)


# ------------------------------------------------------------------------------ the equations of T6, pair by pair


def literal(A, B, noise, cross_term="derived", steps=60):
    """Both stages as partitioned Gauss-Newton over X and the latent of every pair, with no closed form in them."""
    N = len(A)
    S_A, S_B = (np.broadcast_to(S, (N, 6, 6)) for S in (noise.A, noise.B))
    alpha, beta = logarithms(A[:, :3, :3]), logarithms(B[:, :3, :3])
    S = np.zeros((N, 6, 6))
    for k in range(N):
        for first, vector, covariance in ((0, beta[k], S_B[k]), (3, alpha[k], S_A[k])):
            J = np.linalg.inv(left_jacobian(vector))
            S[k, first : first + 3, first : first + 3] = J @ covariance[:3, :3] @ J.T
    measured = np.concatenate([beta, alpha], axis=1)
    U, _, Vt = np.linalg.svd(alpha.T @ beta)
    R, latent = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt, beta.copy()
    for _ in range(steps):
        model = np.concatenate([latent, latent @ R.T], axis=1)
        by_X = [np.vstack([np.zeros((3, 3)), -cross_matrix(R @ b)]) for b in latent]
        by_latent = [np.vstack([np.eye(3), R])] * N
        theta, update, Sigma_R, Y, V = partitioned(measured - model, S, by_X, by_latent)
        latent = latent + update
        R = rotations(theta) @ R
    a = latent @ R.T
    refined = rotations(a)
    joint = np.zeros((N, 6, 6))  # of (phi, q)
    for k in range(N):
        J, G = left_jacobian(a[k]), -cross_matrix(a[k])
        with_R = (Sigma_R @ G.T - Sigma_R @ Y[k] @ R.T) @ J.T  # Cov(theta_R, phi)
        mixed = G @ Sigma_R @ Y[k] @ R.T
        own = G @ Sigma_R @ G.T - mixed - mixed.T + R @ (Y[k].T @ Sigma_R @ Y[k] + np.linalg.inv(V[k])) @ R.T
        cross = cross_matrix(R @ B[k, :3, 3])
        joint[k, :3, :3] = J @ own @ J.T
        joint[k, 3:, 3:] = S_A[k, 3:, 3:] + R @ S_B[k, 3:, 3:] @ R.T + cross @ Sigma_R @ cross.T
        joint[k, 3:, :3] = -cross @ with_R if cross_term == "derived" else cross_matrix(R @ A[k, :3, 3]) @ with_R
        joint[k, :3, 3:] = joint[k, 3:, :3].T
    q = B[:, :3, 3] @ R.T - A[:, :3, 3]
    t, latent = np.zeros(3), refined
    for _ in range(steps):
        residual = np.concatenate(
            [logarithms(refined @ np.swapaxes(latent, -1, -2)), q - (latent - np.eye(3)) @ t], axis=1
        )
        by_X = [np.vstack([np.zeros((3, 3)), L - np.eye(3)]) for L in latent]
        by_latent = [np.vstack([np.eye(3), -cross_matrix(L @ t)]) for L in latent]
        step, update, Sigma_t, _, _ = partitioned(residual, joint, by_X, by_latent)
        t, latent = t + step, rotations(update) @ latent
    assert np.linalg.norm(theta) < 1e-12
    assert np.linalg.norm(step) < 1e-12
    return transforms(R, t), Sigma_R, Sigma_t


def partitioned(residual, S, by_X, by_latent):
    """One step: the step of X, of the latents, the covariance of X, Y_k and V_k (T6)."""
    U, e, Y, V, rest = np.zeros((3, 3)), np.zeros(3), [], [], []
    reduced = np.zeros((3, 3))
    for r, covariance, a, b in zip(residual, S, by_X, by_latent, strict=True):
        weight = np.linalg.inv(covariance)
        V.append(b.T @ weight @ b)
        W = a.T @ weight @ b
        Y.append(W @ np.linalg.inv(V[-1]))
        U += a.T @ weight @ a
        reduced += Y[-1] @ W.T
        e += a.T @ weight @ r - Y[-1] @ b.T @ weight @ r
        rest.append((b.T @ weight @ r, W))
    Sigma = np.linalg.inv(U - reduced)
    step = Sigma @ e
    update = np.stack([np.linalg.solve(v, e_b - W.T @ step) for v, (e_b, W) in zip(V, rest, strict=True)])
    return step, update, Sigma, Y, V


@pytest.mark.slow
@pytest.mark.parametrize("cross_term", ["derived", "published"])
@pytest.mark.parametrize("sd", [1e-3, 3e-2])
def test_eliminated_latents_give_the_literal_estimate(rng, cross_term, sd):
    """Eight pairs, a full covariance for each; at 30 mrad and 30 mm the terms of second order count."""
    X, A, B = exact_motions(rng, 8)
    noise = uq.PairNoise(random_covariance(rng, shape=(8,), sd=sd), random_covariance(rng, shape=(8,), sd=sd))
    a, b = (T[0] for T in sampled(rng, A, B, noise, 1))
    result = nguyen(a, b, noise, cross_term=cross_term)
    if cross_term == "published" and not result.converged:
        pytest.skip("with its cross-covariance these data have no positive definite weights")
    expected, Sigma_R, Sigma_t = literal(a, b, noise, cross_term)
    assert result.converged
    error = difference(result.X, expected)
    assert nees(error[None, :3], Sigma_R) < 1e-14
    assert nees(error[None, 3:], Sigma_t) < 1e-14
    assert_same_covariance(result.Sigma_R, Sigma_R, 1e-6)
    assert_same_covariance(result.Sigma_t, Sigma_t, 1e-6)
    assert nees(difference(result.X, X)[None, :3], Sigma_R) < stats.chi2.ppf(1 - 1e-6, 3)


# -------------------------------------------------------------------------------------------- without noise, batches


@pytest.mark.parametrize("noise", [None, EQUATION_70], ids=["no model", "(70)"])
def test_exact_data(rng, noise):
    """Motions of 1 to 179 degrees, and the small-angle branches on their own."""
    for smallest, largest in ((1, 179), (1, 5), (25, 35), (55, 60), (150, 179)):
        X, A, B = exact_motions(rng, 30, smallest=np.deg2rad(smallest), largest=np.deg2rad(largest))
        result = nguyen(A, B, noise)
        assert result.converged
        assert np.abs(result.X - X).max() < 1e-11
        assert (result.iterations <= 3).all()


@pytest.mark.parametrize("angle", np.logspace(-6, 0, 13))
def test_small_angles(rng, angle):
    X, A, B = exact_motions(rng, 20, smallest=angle, largest=1.5 * angle)
    result = nguyen(A, B)
    assert result.converged
    assert np.abs(result.X - X).max() < 1e-14 / angle


def test_jacobians(rng):
    """J_l, its inverse and the exponential in rows, across the switches of their series."""
    for angle in (*np.logspace(-12, 0, 25), 0.4999, 0.5001, 2.0, 3.1, 4.0):
        v = rotation_vectors(rng, (7,), angle, angle)
        last = v.T[None]
        R, J = rows.exponential(last)
        inverse = rows.inverse_jacobian(last, (last**2).sum(axis=1))
        np.testing.assert_allclose(np.moveaxis(J[0], 2, 0), left_jacobian(v), atol=1e-14)
        np.testing.assert_allclose(np.moveaxis(R[0], 2, 0), rotations(v), atol=1e-14)
        np.testing.assert_allclose(np.moveaxis(rows.rotation(last)[0], 2, 0), rotations(v), atol=1e-14)
        np.testing.assert_allclose(
            np.moveaxis(inverse[0], 2, 0) @ left_jacobian(v), np.tile(np.eye(3), (7, 1, 1)), atol=1e-13
        )


@pytest.mark.slow
def test_axes_that_noise_turned_round(rng):
    """A third of the motions turn by 179.9 degrees: at 1 degree of noise, B's axis often has the other sign."""
    X, A, B = exact_motions(rng, 60)
    turned = random_transforms(rng, (20,), np.deg2rad(179.9), np.deg2rad(179.9))
    A[:20], B[:20] = X @ turned @ np.linalg.inv(X), turned
    noise = isotropic(np.deg2rad(1.0), 1e-3)
    a, b = sampled(rng, A, B, noise, 1000)
    u, v = logarithms(a[:, :20, :3, :3]), logarithms(b[:, :20, :3, :3]) @ X[:3, :3].T
    assert np.mean(np.sum(u * v, axis=-1) < 0) > 0.3
    result = nguyen(a, b, noise)
    assert result.converged.all()
    error = difference(result.X, X)
    assert 2.5 < nees(error[:, :3], result.Sigma_R).mean() < 3.5


@pytest.mark.slow
def test_batch_is_a_loop(rng):
    """Leading axes broadcast; damped, early and late problems do not disturb each other; N and blocks do not matter."""
    noise = uq.PairNoise(random_covariance(rng, shape=(9,), sd=0.1), random_covariance(rng, shape=(9,), sd=0.1))
    _, A, B = noisy_motions(rng, 9, sd=0.1, shape=(300, 2))
    whole = nguyen(A, B[:, :1], noise)
    assert len(set(map(tuple, whole.iterations.reshape(-1, 2)))) > 5
    for i, j in ((0, 0), (0, 1), (150, 0), (299, 1)):
        single = nguyen(A[i, j], B[i, 0], noise)
        assert single.X.shape == (4, 4)
        assert single.Sigma_R.shape == single.Sigma_t.shape == (3, 3)
        assert single.converged == whole.converged[i, j]
        np.testing.assert_array_equal(single.iterations, whole.iterations[i, j])
        for name in ("X", "Sigma_R", "Sigma_t", "length"):
            np.testing.assert_allclose(getattr(single, name), getattr(whole, name)[i, j], rtol=1e-9, atol=1e-11)


# ---------------------------------------------------------------------------------------------------- Monte Carlo


@functools.cache
def at_equation_70():
    rng = np.random.default_rng([SEED, 70, 1])
    X, A, B = exact_motions(rng, 60)
    parts = [nguyen(*sampled(rng, A, B, EQUATION_70, 2000), EQUATION_70) for _ in range(5)]
    assert all(part.converged.all() for part in parts)
    X_all, Sigma_R, Sigma_t = (np.concatenate([part[i] for part in parts]) for i in range(3))
    return difference(X_all, X), Sigma_R, Sigma_t


@pytest.mark.statistical
def test_nees_at_equation_70():
    """10,000 trials at 18 mrad and 14 mm, each judged by its own covariances: 3 within 0.1, second order included."""
    errors, Sigma_R, Sigma_t = at_equation_70()
    for error, Sigma in ((errors[:, :3], Sigma_R), (errors[:, 3:], Sigma_t)):
        assert 2.9 < nees(error, Sigma).mean() < 3.1
        assert not is_consistent(error, Sigma * 1.1**2)
        assert not is_consistent(error, Sigma / 1.1**2)


@pytest.mark.statistical
@pytest.mark.parametrize("exact", ["A", "B", None])
def test_nees_with_exact_motions(rng, exact):
    """One robot or camera without error, and both with full covariances of each pair's own."""
    X, A, B = exact_motions(rng, 40)
    covariances = {name: random_covariance(rng, shape=(40,), sd=1e-3) for name in "AB" if name != exact}
    noise = uq.PairNoise(**covariances)
    result = nguyen(*sampled(rng, A, B, noise, 4000), noise)
    assert result.converged.all()
    assert is_consistent(difference(result.X, X)[:, :3], result.Sigma_R)


def whole_covariance(result, A, B, noise, block=None):
    """The 6x6 covariance from `NguyenDerivatives`, and F and Q themselves."""
    N = A.shape[-3]
    A, B = A.reshape(-1, N, 4, 4), B.reshape(-1, N, 4, 4)
    derivatives = NguyenDerivatives(result, noise)
    slices = [slice(i, i + (block or N)) for i in range(0, N, block or N)]
    F = np.concatenate([derivatives.block(A[:, pairs], B[:, pairs], pairs) for pairs in slices], axis=-1)
    Q = derivatives.weight(N)
    Sigma = 0.0
    for side, S in zip(F, (noise.A, noise.B), strict=True):
        if S is not None:
            Sigma = Sigma + np.einsum("ijtm,mjk,lktm->til", side, np.broadcast_to(S, (N, 6, 6)), side, optimize=True)
    return Q @ Sigma @ Q.mT, F, Q


@pytest.mark.statistical
def test_nees_of_the_whole_covariance(rng):
    """Rotation and translation together, with the error of R that all pairs share: 6, also where Sigma_t is far off.

    All B have nearly the same translation, so that the error of R moves all q_k together, which Sigma_t does not know.
    """
    X, A, B = exact_motions(rng, 40)
    B[:, :3, 3] = 0.05 * B[:, :3, 3] + [0.3, 0.0, 0.4]
    A = X @ B @ np.linalg.inv(X)
    noise = isotropic(1e-3, 1e-4)
    a, b = sampled(rng, A, B, noise, 3000)
    result = nguyen(a, b, noise)
    errors = difference(result.X, X)
    assert is_consistent(errors[:, :3], result.Sigma_R)
    assert nees(errors[:, 3:], result.Sigma_t).mean() > 4.5
    Sigma, _, _ = whole_covariance(result, a, b, noise)
    assert is_consistent(errors, Sigma)
    assert is_consistent(errors[:, 3:], Sigma[:, 3:, 3:])
    assert not is_consistent(errors, 1.1**2 * Sigma)
    np.testing.assert_allclose(Sigma[:, :3, :3], result.Sigma_R, rtol=1e-6, atol=1e-14)


@pytest.mark.slow
def test_cross_covariance_of_q_and_refined_rotation(rng):
    """The samples themselves: Cov(q_k, phi_k) of each pair is the derived one, and not the published one."""
    X, A, B = exact_motions(rng, 4)
    noise = uq.PairNoise(random_covariance(rng, shape=(4,), sd=1e-4), random_covariance(rng, shape=(4,), sd=1e-4))
    trials = 20_000
    a, b = sampled(rng, A, B, uncorrelated(noise), trials)
    result = nguyen(a, b, noise)
    data, refined = stages(a, b, noise, result)
    moved_data = nguyen_stages.translation_data(data, result.X[:, :3, :3], refined, result.Sigma_R, "derived")
    q = np.moveaxis(moved_data.q, 2, 1)
    R_A = np.moveaxis(refined.R_A, 3, 1)
    phi = logarithms(R_A @ A[:, :3, :3].mT)
    dq = q - (B[:, :3, 3] @ X[:3, :3].T - A[:, :3, 3])
    found = np.einsum("tki,tkj->kij", dq, phi) / trials
    spread = np.sqrt(np.einsum("tki,tki,tkj,tkj->kij", dq, dq, phi, phi) / trials**2)
    exact = nguyen(A, B, noise)
    distance = {}
    for cross_term in ("derived", "published"):
        data, refined = stages(A[None], B[None], noise, exact)
        predicted = nguyen_stages.translation_data(
            data, exact.X[None, :3, :3], refined, exact.Sigma_R[None], cross_term
        )
        distance[cross_term] = np.abs(found - np.moveaxis(predicted.S_q_phi[0], 2, 0)) / spread
    assert distance["derived"].max() < stats.norm.ppf(1 - 0.0005 / 36)
    assert distance["published"].max() > 30


def uncorrelated(noise):
    """Without the correlation of rotation and translation within a motion, which the method ignores."""
    mask = np.kron(np.eye(2), np.ones((3, 3)))
    return uq.PairNoise(noise.A * mask, noise.B * mask)


def stages(A, B, noise, result):
    """Inner data of the first stage at a result for motions (T, N, 4, 4)."""
    R = result.X.reshape(-1, 4, 4)[:, :3, :3]
    data = nguyen_stages.measured(A, B, noise, np.ones(len(A)))
    turn = nguyen_stages.at_rotation(data, R)
    return data, nguyen_stages.refined_rotations(data.S_a, *turn[3:])


@pytest.mark.statistical
def test_the_derived_cross_term_is_right(rng):
    """Five pairs, 0.1 mrad and 0.03 mm, a geometry of its own for each of 6,000 trials: NEES of t.

    Few pairs, so that the error of R is a good part of that of a pair, and translations more accurate than what the
    rotations say of them.
    """
    X, A, B = random_problems(rng, 6000, 5)
    noise = isotropic(1e-4, 3e-5)
    a, b = sampled(rng, A, B, noise, 6000)
    derived, published = (nguyen(a, b, noise, cross_term=kind) for kind in ("derived", "published"))
    assert derived.converged.all()
    low, high = mean_interval(6000, 3)
    # One per cent more than 3 is the error of R that all pairs share and Sigma_t takes as independent.
    assert low < nees(difference(derived.X, X)[:, 3:], derived.Sigma_t).mean() < 1.04 * high
    ok = published.converged
    assert ok.mean() < 0.95
    assert nees(difference(published.X, X)[ok, 3:], published.Sigma_t[ok]).mean() > 1.3 * high


# -------------------------------------------------------------------------------------------- stopping, convergence


def in_unit(A, B, noise, unit):
    scale = np.array([1, 1, 1, unit, unit, unit])
    S = [None if S is None else S * scale * scale[:, None] for S in (noise.A, noise.B)]
    return along(A, unit), along(B, unit), uq.PairNoise(*S)


@pytest.mark.slow
def test_scaled_stop_has_no_unit(rng):
    """Metres, millimetres, nanometres: the same iterations and, up to rounding, the same estimate."""
    _, A, B = exact_motions(rng, 20)
    noise = isotropic(0.1, 0.05)
    a, b = sampled(rng, A, B, noise, 150)
    for model in (noise, None):
        metres = nguyen(a, b, model)
        assert metres.converged.all()
        for unit in (1e3, 1e9):
            *data, scaled_noise = in_unit(a, b, noise, unit)
            other = nguyen(*data, model and scaled_noise)
            np.testing.assert_array_equal(other.iterations, metres.iterations)
            np.testing.assert_allclose(other.X[:, :3, :3], metres.X[:, :3, :3], atol=1e-12)
            np.testing.assert_allclose(other.X[:, :3, 3] / unit, metres.X[:, :3, 3], atol=1e-11)
            np.testing.assert_allclose(other.Sigma_t / unit**2, metres.Sigma_t, rtol=1e-8, atol=1e-12)


@pytest.mark.slow
def test_published_stop_has_a_unit(rng):
    """150 data sets with much noise, 10 iterations at most: most converge in metres, few of the same in millimetres."""
    _, A, B = exact_motions(rng, 60)
    noise = isotropic(0.3, 0.1)
    a, b = sampled(rng, A, B, noise, 150)
    metres = nguyen(a, b, noise, stop="published")
    millimetres = nguyen(*in_unit(a, b, noise, 1e3), stop="published")
    assert metres.converged.sum() > 110
    assert millimetres.converged.sum() < 15
    assert millimetres.iterations.max() == 10
    assert nguyen(a, b, noise).converged.sum() >= metres.converged.sum()


def test_both_stops_agree_where_both_end(rng):
    _, A, B = exact_motions(rng, 60)
    a, b = sampled(rng, A, B, EQUATION_70, 50)
    scaled, published = (nguyen(a, b, EQUATION_70, stop=stop) for stop in ("scaled", "published"))
    assert published.converged.all()
    assert nees(difference(published.X, scaled.X)[:, 3:], scaled.Sigma_t).max() < 1e-5


def test_the_minimum_is_reached_when_told_so(rng):
    """Gradient of the first sum of squares by differences at 0.2 rad, where steps have to be damped now and then."""
    _, A, B = random_problems(rng, 500, 6)
    noise = isotropic(0.2, 0.1)
    a, b = sampled(rng, A, B, noise, 500)
    result = nguyen(a, b, noise)
    assert result.converged.mean() > 0.99
    data = nguyen_stages.measured(a, b, noise, np.ones(500))
    steps = np.concatenate([1e-5 * np.eye(3), -1e-5 * np.eye(3)])
    values = np.stack([nguyen_stages.at_rotation(data, rotations(s) @ result.X[:, :3, :3])[0] for s in steps])
    gradient = ((values[:3] - values[3:]) / 2e-5).T
    F = np.linalg.inv(result.Sigma_R)
    assert nees(gradient[result.converged], F[result.converged]).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("translation", [1e-3, 1e-4, 1e-5])
def test_accurate_translations_converge(rng, translation):
    """10 mrad, all B with nearly the same translation or with any: nothing fails with the derived cross-covariance."""
    X, A, B = random_problems(rng, 500, 60)
    B[:250, :, :3, 3] = 0.02 * B[:250, :, :3, 3] + [0.3, 0.0, 0.4]
    A = X[:, None] @ B @ np.linalg.inv(X[:, None])
    noise = isotropic(1e-2, translation)
    result = nguyen(*sampled(rng, A, B, noise, 500), noise)
    assert result.converged.all()
    assert result.iterations.max() < 40


@pytest.mark.slow
def test_not_converged_is_said(rng):
    """One iteration is not enough; a published cross-covariance that is impossible gives no covariance."""
    _, A, B = random_problems(rng, 500, 5)
    noise = isotropic(1e-4, 1e-5)
    a, b = sampled(rng, A, B, noise, 500)
    first = nguyen(a, b, noise, max_iterations=1)
    assert not first.converged.any()
    assert (first.iterations == 1).all()
    assert nguyen(a, b, noise).converged.all()
    for stop in ("scaled", "published"):
        published = nguyen(a, b, noise, cross_term="published", stop=stop)
        lost = np.isnan(published.Sigma_t).any(axis=(1, 2))
        assert lost.mean() > 0.3
        assert not published.converged[lost].any()
        assert (np.linalg.eigvalsh(published.Sigma_t[published.converged]) > 0).all()
        assert np.isfinite(published.X).all()


# -------------------------------------------------------------------------------------------------- derivatives of X


@pytest.mark.parametrize("cross_term", ["derived", "published"])
@pytest.mark.parametrize("model", ["per pair", "one", "A exact", "none"])
def test_derivatives(rng, model, cross_term):
    """All 12 N inputs of noise-free data by central differences of the estimate, in standard deviations."""
    N = 5
    _, A, B = exact_motions(rng, N)
    S = random_covariance(rng, shape=(2, N), sd=1e-3)
    noise = {
        "per pair": uq.PairNoise(S[0], S[1]),
        "one": uq.PairNoise(S[0, 0], S[1, 0]),
        "A exact": uq.PairNoise(B=S[1]),
        "none": None,
    }[model]
    result = nguyen(A, B, noise, cross_term=cross_term)
    truth = noise or uq.PairNoise(S[0], S[1])

    def estimate(x):
        x = x.reshape(-1, 2, N, 6)
        return difference(nguyen(moved(A, x[:, 0]), moved(B, x[:, 1]), noise, cross_term=cross_term).X, result.X)

    numerical = jacobian(estimate, 12 * N, step=1e-4).reshape(6, 2, N, 6)
    derivatives = NguyenDerivatives(result, noise, cross_term=cross_term)
    F = np.concatenate([derivatives.block(A[None, k], B[None, k], k) for k in (slice(0, 2), slice(2, 5))], axis=-1)
    analytic = np.einsum("ij,sjkn->sikn", derivatives.weight(N)[0], F[:, :, :, 0]).transpose(1, 0, 3, 2)
    L = np.zeros((2, N, 6, 6))
    for side, factor in enumerate(truth.factors):
        if factor is not None:
            L[side] = factor
    whitened = [np.einsum("asni,snij->asnj", D, L).reshape(6, -1) for D in (analytic, numerical)]
    deviation = np.sqrt((whitened[1] ** 2).sum(axis=1, keepdims=True))
    assert np.abs((whitened[0] - whitened[1]) / deviation).max() < 1e-6


def test_covariances_at_a_known_X(rng):
    """They are the estimate's at the estimate, but for the latents of the second stage: second order."""
    _, A, B = noisy_motions(rng, 9, sd=1e-4, shape=(300,))
    noise = isotropic(1e-4, 1e-4)
    for model in (noise, None):
        result = nguyen(A, B, model)
        again = covariances_at(A, B, result.X, model)
        np.testing.assert_allclose(again.Sigma_R, result.Sigma_R, rtol=1e-6, atol=1e-9 * result.Sigma_R.max())
        np.testing.assert_allclose(again.Sigma_t, result.Sigma_t, rtol=1e-2, atol=1e-3 * result.Sigma_t.max())
        np.testing.assert_array_equal(again.length, result.length)
        assert again.X.shape == (300, 4, 4)


def test_blocks_of_pairs_and_trials(rng):
    """The covariance does not depend on how the pairs are cut, and trials are taken by slice."""
    _, A, B = noisy_motions(rng, 7, shape=(3,))
    noise = uq.PairNoise(random_covariance(rng, shape=(7,)), random_covariance(rng, shape=(7,)))
    result = nguyen(A, B, noise)
    whole, _, _ = whole_covariance(result, A, B, noise)
    cut, _, _ = whole_covariance(result, A, B, noise, block=3)
    np.testing.assert_allclose(cut, whole, rtol=1e-9, atol=1e-20)
    some = NguyenDerivatives(result, noise, slice(1, 3))
    assert some.block(A[1:3], B[1:3]).shape == (2, 6, 6, 2, 7)
    assert some.weight(7).shape == (2, 6, 6)


# ------------------------------------------------------------------------------------------------------- bad input


def test_parallel_axes(rng):
    X = random_transforms(rng)
    vectors = rng.uniform(0.5, 2.0, (10, 1)) * np.array([0.6, 0.0, 0.8])
    B = transforms(rotations(vectors), rng.normal(size=(10, 3)))
    A = X @ B @ np.linalg.inv(X)
    with pytest.raises(uq.DegenerateMotionError, match=r"parallel to \(") as caught:
        nguyen(A, B)
    axis = X[:3, :3] @ [0.6, 0.0, 0.8]
    expected = np.zeros((2, 6))
    expected[0, :3] = expected[1, 3:] = axis
    np.testing.assert_allclose(np.abs(np.sum(caught.value.directions * expected, axis=1)), 1.0, atol=1e-9)
    good = exact_motions(rng, 10)
    with pytest.raises(uq.DegenerateMotionError, match=r"problem \(1,\)"):
        nguyen(np.stack([good[1], A]), np.stack([good[2], B]))


def test_no_rotation(rng):
    B = transforms(np.tile(np.eye(3), (5, 1, 1)), rng.normal(size=(5, 3)))
    with pytest.raises(uq.DegenerateMotionError, match="none of them rotates") as caught:
        nguyen(B, B)
    assert caught.value.directions.shape == (6, 6)


def test_mirrored_axes(rng):
    _, A, B = exact_motions(rng, 10)
    mirrored = transforms(rotations(logarithms(B[:, :3, :3]) * [1, 1, -1]), B[:, :3, 3])
    vectors = np.concatenate([np.eye(3), -np.eye(3)])
    A, mirrored = (transforms(rotations(v), np.zeros(3)) for v in (vectors, -vectors))
    with pytest.raises(uq.DegenerateMotionError, match="mirrored"):
        nguyen(A, mirrored)


@pytest.mark.parametrize(("part", "what"), [(slice(0, 3), "rotation"), (slice(3, 6), "translation")])
def test_singular_noise(rng, part, what):
    """One of the two may be singular, not both."""
    _, A, B = exact_motions(rng, 10)
    regular = 1e-6 * np.eye(6)
    singular = regular.copy()
    singular[part.start, part.start] = 0.0
    for noise in (uq.PairNoise(singular, regular), uq.PairNoise(regular, singular), uq.PairNoise(B=regular)):
        assert nguyen(A, B, noise).converged
    nothing = np.zeros((6, 6))
    nothing[3:, 3:] = 1e-6 * np.eye(3)
    with pytest.raises(uq.InputError, match=r"`noise`.*rotation"):
        nguyen(A, B, uq.PairNoise(nothing, nothing))
    if what == "translation":
        with pytest.raises(uq.InputError, match=r"`noise`.*translation"):
            nguyen(A, B, uq.PairNoise(B=np.diag([1e-6] * 3 + [0.0] * 3)))


def test_very_unequal_noise(rng):
    """A factor 1e3 between the deviations of the axes: the inverse by cofactors would lose its digits."""
    X, A, B = exact_motions(rng, 20)
    noise = uq.PairNoise(B=np.diag([1e-10, 1e-14, 1e-16, 1e-10, 1e-14, 1e-16]))
    a, b = sampled(rng, A, B, noise, 500)
    result = nguyen(a, b, noise)
    assert result.converged.all()
    assert is_consistent(difference(result.X, X)[:, :3], result.Sigma_R)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cross_term": "right"}, "Expected `cross_term`"),
        ({"stop": "never"}, "Expected `stop`"),
        ({"max_iterations": 0}, "Expected `max_iterations`"),
        ({"noise": uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))}, "PoseNoise"),
        ({"noise": uq.PairNoise(A=np.tile(np.eye(6), (4, 1, 1)))}, "Expected the covariance `A` to cover 10 motions"),
        ({"A": np.eye(4)}, "Expected `A`"),
        ({"B": np.full((10, 4, 4), np.nan)}, "finite"),
    ],
)
def test_input_errors(rng, change, message):
    _, A, B = exact_motions(rng, 10)
    with pytest.raises(uq.InputError, match=message):
        nguyen(**({"A": A, "B": B} | change))
