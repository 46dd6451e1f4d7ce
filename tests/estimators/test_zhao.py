"""zhao: linear programs for the least absolute residuals, and their covariance."""

import numpy as np
import pytest
from scipy.optimize import linprog, minimize
from scipy.spatial.transform import Rotation
from support import (
    assert_same_covariance,
    difference,
    exact_motions,
    is_consistent,
    jacobian,
    left_matrix,
    moved,
    nees,
    noisy_motions,
    random_covariance,
    right_matrix,
    rotations,
)

from uq_handeye.errors import DegenerateMotionError, InputError, NotConvergedError
from uq_handeye.methods import zhao
from uq_handeye.model.errors.models import PairNoise

METHOD = zhao.METHOD
WIDE = {"smallest": np.deg2rad(1.0), "largest": np.deg2rad(179.0)}


def dual(T):
    q = Rotation.from_matrix(T[..., :3, :3]).as_quat(canonical=True, scalar_first=True)
    t = np.concatenate([np.zeros((*T.shape[:-2], 1)), T[..., :3, 3]], axis=-1)
    return q, 0.5 * (left_matrix(t) @ q[..., None])[..., 0]


def residuals(A, B, X):
    (a, a_dual), (b, b_dual), (q, q_dual) = dual(A), dual(B), dual(X)
    E, F = left_matrix(a) - right_matrix(b), left_matrix(a_dual) - right_matrix(b_dual)
    return np.concatenate([E @ q, F @ q + E @ q_dual], axis=-1).reshape(-1)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_noise_free(rng, unit):
    for _ in range(100):
        X, A, B = exact_motions(rng, int(rng.integers(2, 21)), **WIDE)
        for T in (X, A, B):
            T[..., :3, 3] *= unit
        assert np.abs(difference(METHOD(A, B), X) / np.repeat([1.0, unit], 3)).max() < 1e-9


def test_from_afar_and_past_outliers(rng):
    """The programs find X where the start is wrong: one motion in ten is, the others are exact."""
    X, A, B = exact_motions(rng, 40)
    A[:4] = moved(A[:4], 0.3 * rng.normal(size=(4, 6)))
    estimate = METHOD.estimate(A, B)
    assert estimate.converged and estimate.iterations > 1
    np.testing.assert_allclose(estimate.X, X, atol=1e-12)


def test_derivatives_of_the_residuals(rng):
    X, A, B = noisy_motions(rng, 5)
    at = zhao.Residuals(A, B, None)
    r, J = at.at(X)
    np.testing.assert_allclose(np.abs(r), np.abs(residuals(A, B, X)), atol=1e-14)
    by_X = jacobian(lambda xi: np.array([at.at(moved(X, e))[0] for e in xi]), 6)
    np.testing.assert_allclose(J, by_X, atol=1e-10)

    def of_data(xi):
        return np.array([zhao.Residuals(moved(A, e[:6]), moved(B, e[6:]), None).at(X)[0] for e in xi])

    np.testing.assert_allclose(at.by_data(X, slice(None)).reshape(40, 12), jacobian(of_data, 12), atol=1e-10)


def test_linear_program_is_the_textbook_one(rng):
    """The primal program with its 2m inequalities, with and without an active trust region."""
    J, r = rng.normal(size=(40, 6)), rng.normal(size=40)
    for trust in (1.0, 0.01):
        rows = np.block([[J, -np.eye(40)], [-J, -np.eye(40)]])
        cost = np.concatenate([np.zeros(6), np.ones(40)])
        bounds = [(-trust, trust)] * 6 + [(0, None)] * 40
        primal = linprog(cost, A_ub=rows, b_ub=np.concatenate([-r, r]), bounds=bounds)
        np.testing.assert_allclose(zhao._linear_program(r, J, trust), primal.x[:6], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [0.05, 1.0, 20.0])
def test_is_a_minimum(rng, unit):
    """No lower value nearby, by searches without derivatives, in any unit of length; and six residuals vanish."""
    _, A, B = noisy_motions(rng, 6, sd=0.02)
    for T in (A, B):
        T[..., :3, 3] *= unit
    scale = np.repeat([1.0, unit], 3)
    found = METHOD(A, B)

    def cost(xi):
        return np.abs(residuals(A, B, moved(found, scale * xi))).sum()

    lowest = cost(np.zeros(6))
    for size in (1e-6, 1e-3, 0.1):
        assert all(cost(xi) >= lowest for xi in size * rng.normal(size=(300, 6)))
        options = {"initial_simplex": size * rng.normal(size=(7, 6)), "maxiter": 400}
        assert minimize(cost, np.zeros(6), method="Nelder-Mead", options=options).fun >= lowest * (1 - 1e-12)
    assert np.sum(np.abs(residuals(A, B, found)) < 1e-10 * unit) >= 6


def test_batch_equals_loop(rng):
    _, A, B = noisy_motions(rng, 5, shape=(2, 3))
    whole = METHOD.estimate(A, B)
    for k in np.ndindex(2, 3):
        np.testing.assert_allclose(whole.X[k], METHOD(A[k], B[k]), atol=1e-12)


def test_no_iterations_no_answer(rng, monkeypatch):
    monkeypatch.setattr(zhao, "MAX_STEPS", 1)
    _, A, B = noisy_motions(rng, 5)
    with pytest.raises(NotConvergedError, match="'zhao' did not converge"):
        METHOD(A, B)


def test_parallel_axes_are_degenerate(rng):
    X, _, B = exact_motions(rng, 4)
    B[:, :3, :3] = rotations(np.array([0.0, 0.0, 1.0]) * rng.uniform(0.3, 2.0, (4, 1)))
    with pytest.raises(DegenerateMotionError):
        METHOD(X @ B @ np.linalg.inv(X), B)


def test_too_many_pairs(rng, monkeypatch):
    monkeypatch.setattr(zhao, "MAX_PAIRS_OF_PROGRAM", 5)
    _, A, B = noisy_motions(rng, 6)
    with pytest.raises(InputError, match="at most 5 motions with method 'zhao'"):
        METHOD(A, B)


def test_has_no_derivatives(rng):
    X, A, B = noisy_motions(rng, 6)
    with pytest.raises(InputError, match="no derivatives but"):
        METHOD.solver.derivatives(A[None], B[None], None, X[None])


# --------------------------------------------------------------------------------------------------- covariance


def pair_factors(noise_A, noise_B, N):
    """The factors of independent pairs as if they were shared: z holds the twelve errors of every pair."""
    L = np.zeros((N, 12, N, 12))
    for k in range(N):
        L[k, :6, k, :6], L[k, 6:, k, 6:] = np.linalg.cholesky(noise_A), np.linalg.cholesky(noise_B)
    return L.reshape(N, 12, 12 * N)


def test_both_forms_of_noise_agree(rng, monkeypatch):
    X, A, B = exact_motions(rng, 40)
    noise = random_covariance(rng), random_covariance(rng)
    L = pair_factors(*noise, 40)
    monkeypatch.setattr(zhao, "ROWS", 48)  # several blocks, the last not full
    shared = METHOD.covariance(A, B, X, lambda pairs: L[pairs]).value
    # an arcsine next to 1 makes 1e-8 of rounding
    assert_same_covariance(shared, METHOD.covariance(A, B, X, PairNoise(*noise)).value, 1e-6)


def test_noise_of_the_size_of_sampled_signs(rng):
    """The middle of the sandwich is the covariance of ``sum x_i sign(r_i)``, drawn."""
    X, A, B = exact_motions(rng, 10)
    noise = PairNoise(random_covariance(rng), random_covariance(rng))
    at = zhao.Residuals(A, B, None)
    _, J = at.at(X)
    rows = zhao._independent_rows(at, X, noise)
    middle = zhao._independent_scores(J.reshape(10, 8, 6), zhao._unit_rows(rows, np.einsum("mrk,mrk->mr", rows, rows)))
    signs = np.sign(np.einsum("mrk,tmk->tmr", rows, rng.normal(size=(20000, 10, 12)))).reshape(20000, 80)
    sampled = np.cov((signs @ J).T)
    sd = np.sqrt(np.diag(middle))
    np.testing.assert_allclose(sampled / np.outer(sd, sd), middle / np.outer(sd, sd), atol=0.05)


@pytest.mark.statistical
def test_covariance_of_pair_noise_is_true_in_millimetres(rng):
    """Take metres; pairs of poses are in `test_statistics_of_methods.py`."""
    trials, N, unit = 300, 60, 1000.0
    X, A, B = exact_motions(rng, N)
    for T in (X, A, B):
        T[..., :3, 3] *= unit
    sd = 1e-3 * np.repeat([1.0, unit], 3)
    errors = sd * rng.normal(size=(2, trials, N, 6))
    found = METHOD(moved(A, errors[0]), moved(B, errors[1]))
    covariance = METHOD.covariance(A, B, X, PairNoise(np.diag(sd**2), np.diag(sd**2))).value
    xi = difference(found, X)
    assert is_consistent(xi, covariance), nees(xi, covariance).mean()
    assert not is_consistent(xi, 0.8 * covariance) and not is_consistent(xi, 1.25 * covariance)


@pytest.mark.slow
def test_residuals_without_variance(rng):
    """Noise of translations alone: the rotation is exact, and the covariance says so."""
    trials, N = 200, 30
    X, A, B = exact_motions(rng, N)
    sd = np.array([0.0, 0.0, 0.0, 1e-3, 1e-3, 1e-3])
    covariance = METHOD.covariance(A, B, X, PairNoise(B=np.diag(sd**2))).value
    xi = difference(METHOD(np.tile(A, (trials, 1, 1, 1)), moved(B, sd * rng.normal(size=(trials, N, 6)))), X)
    assert np.abs(xi[:, :3]).max() < 1e-12 and np.abs(covariance[:3, :3]).max() < 1e-20
    assert is_consistent(xi[:, 3:], covariance[3:, 3:])


def test_no_noise_no_covariance(rng):
    X, A, B = exact_motions(rng, 10)
    np.testing.assert_array_equal(METHOD.covariance(A, B, X, PairNoise(A=np.zeros((6, 6)))).value, np.zeros((6, 6)))
