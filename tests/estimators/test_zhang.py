"""zhang: two steps in turn, which end at a constrained minimum."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from support import (
    difference,
    exact_motions,
    jacobian,
    left_matrix,
    moved,
    noisy_motions,
    right_matrix,
    rotations,
    transforms,
)

from uq_handeye.errors import DegenerateMotionError, NotConvergedError
from uq_handeye.methods import heller, zhang

METHOD = zhang.ZHANG
WIDE = {"smallest": np.deg2rad(1.0), "largest": np.deg2rad(179.0)}


def dual(T):
    q = Rotation.from_matrix(T[..., :3, :3]).as_quat(canonical=True, scalar_first=True)
    t = np.concatenate([np.zeros((*T.shape[:-2], 1)), T[..., :3, 3]], axis=-1)
    return q, 0.5 * (left_matrix(t) @ q[..., None])[..., 0]


def squares(A, B, X):
    (a, a_dual), (b, b_dual), (q, q_dual) = dual(A), dual(B), dual(X)
    E, F = left_matrix(a) - right_matrix(b), left_matrix(a_dual) - right_matrix(b_dual)
    return np.sum((E @ q) ** 2) + np.sum((F @ q + E @ q_dual) ** 2)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_noise_free(rng, unit):
    for _ in range(200):
        X, A, B = exact_motions(rng, int(rng.integers(2, 21)), **WIDE)
        for T in (X, A, B):
            T[..., :3, 3] *= unit
        estimate = METHOD.estimate(A, B)
        assert estimate.converged and estimate.iterations <= 10
        assert np.abs(difference(estimate.X, X) / np.repeat([1.0, unit], 3)).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("unit", [0.05, 1.0, 20.0])
def test_is_a_minimum(rng, unit):
    """Against descents from many poses, in any unit of length."""
    _, A, B = noisy_motions(rng, 5, sd=0.05)
    for T in (A, B):
        T[..., :3, 3] *= unit
    scale = np.repeat([1.0, unit], 3)

    def cost(xi, start):
        return squares(A, B, moved(start, scale * xi)) / unit**2

    found = METHOD(A, B)
    for k in range(6):
        start = transforms(rotations(rng.normal(size=3)), unit * rng.normal(size=3)) if k else found
        result = minimize(cost, np.zeros(6), (start,), method="BFGS", options={"gtol": 1e-10})
        assert cost(np.zeros(6), found) <= result.fun * (1 + 1e-9)
        if k == 0:
            np.testing.assert_allclose(result.x, 0.0, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_agrees_with_heller(rng, unit):
    pytest.importorskip("cvxpy")
    _, A, B = noisy_motions(rng, 8, sd=0.02, shape=(50,))
    for T in (A, B):
        T[..., :3, 3] *= unit
    xi = difference(METHOD(A, B), heller.HELLER(A, B)) / np.repeat([1.0, unit], 3)
    np.testing.assert_allclose(xi, 0.0, atol=1e-10)


def test_few_iterations(rng):
    """The alternation takes a handful of steps at 1 mrad and 1 mm, at any length."""
    for unit in (1.0, 1000.0):
        _, A, B = noisy_motions(rng, 20, sd=1e-3, shape=(50,))
        for T in (A, B):
            T[..., :3, 3] *= unit
        assert METHOD.estimate(A, B).iterations.max() <= 8


def test_derivatives_are_those_of_the_estimate(rng):
    _, A, B = noisy_motions(rng, 6, sd=1e-2)
    X = METHOD(A, B)
    block = METHOD.solver.derivatives(A[None], B[None], None, X[None])(slice(0, 1))
    F = block.block(A[None], B[None], slice(0, 6))  # (2, 6, 6, 1, 6)
    for side, name in enumerate("AB"):
        for pair in range(6):

            def of_error(xi, name=name, pair=pair):
                data = {"A": np.tile(A, (len(xi), 1, 1, 1)), "B": np.tile(B, (len(xi), 1, 1, 1))}
                data[name][:, pair] = moved(data[name][:, pair], xi)
                return difference(METHOD(data["A"], data["B"]), X)

            np.testing.assert_allclose(F[side, :, :, 0, pair], jacobian(of_error, 6), atol=1e-6)


def test_batch_equals_loop(rng):
    _, A, B = noisy_motions(rng, 5, sd=0.03, shape=(2, 4))
    whole = METHOD.estimate(A, B)
    for k in np.ndindex(2, 4):
        alone = METHOD.estimate(A[k], B[k])
        np.testing.assert_allclose(whole.X[k], alone.X, atol=1e-12)


def test_no_iterations_no_answer(rng, monkeypatch):
    monkeypatch.setattr(zhang, "MAX_STEPS", 2)
    _, A, B = noisy_motions(rng, 5, sd=0.05, shape=(3,))
    estimate = METHOD.estimate(A, B)
    assert not estimate.converged.any() and (estimate.iterations == 2).all()
    with pytest.raises(NotConvergedError, match="'zhang' did not converge on 3 of 3"):
        METHOD(A, B)


@pytest.mark.slow
def test_what_has_converged_is_stationary(rng):
    """Also on wild data: a step of Newton's method from there leads nowhere."""
    _, A, B = noisy_motions(rng, 3, sd=0.1, shape=(200,), smallest=0.02, largest=0.06)
    estimate = METHOD.estimate(A, B)
    done = estimate.converged
    assert 0 < done.sum() < 200  # such data bring out both
    moments = METHOD.solver.moments(A[done], B[done], None)
    again = METHOD.solver.nearby(moments, 3, estimate.X[done])
    np.testing.assert_allclose(difference(again, estimate.X[done]), 0.0, atol=1e-9)


def test_parallel_axes_are_degenerate(rng):
    X, _, B = exact_motions(rng, 4)
    B[:, :3, :3] = rotations(np.array([0.0, 0.0, 1.0]) * rng.uniform(0.3, 2.0, (4, 1)))
    with pytest.raises(DegenerateMotionError):
        METHOD(X @ B @ np.linalg.inv(X), B)


def test_half_turns_take_the_sign_from_the_others(rng):
    X, _, B = exact_motions(rng, 6)
    B[:2, :3, :3] = rotations(np.pi * np.eye(3)[:2])
    np.testing.assert_allclose(METHOD(X @ B @ np.linalg.inv(X), B), X, atol=1e-9)
