"""heller: the global minimum of the dual-quaternion equations, with a certificate."""

import sys

import numpy as np
import pytest
from scipy.optimize import minimize
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

from uq_handeye.errors import DegenerateMotionError, MissingExtraError, NotConvergedError
from uq_handeye.methods import heller

METHOD = heller.HELLER
WIDE = {"smallest": np.deg2rad(1.0), "largest": np.deg2rad(179.0)}


def quaternion(R):
    """(w, x, y, z), w >= 0, as the eigenvector of a matrix of the entries: no SciPy."""
    K = np.empty((*R.shape[:-2], 4, 4))
    a, b, c = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    trace = np.trace(R, axis1=-2, axis2=-1)
    K[..., 1:, 1:] = R + np.swapaxes(R, -1, -2) - trace[..., None, None] * np.eye(3)
    K[..., 0, 0] = trace
    K[..., 0, 1:] = K[..., 1:, 0] = np.stack([a, b, c], axis=-1)
    q = np.linalg.eigh(K)[1][..., -1]
    return q * np.where(q[..., :1] < 0, -1.0, 1.0)


def dual(T):
    q = quaternion(T[..., :3, :3])
    t = np.concatenate([np.zeros((*T.shape[:-2], 1)), T[..., :3, 3]], axis=-1)
    return q, 0.5 * (left_matrix(t) @ q[..., None])[..., 0]


def residuals(A, B, X):
    """``q_A q - q q_B`` and its dual part, eight per pair."""
    (a, a_dual), (b, b_dual), (q, q_dual) = dual(A), dual(B), dual(X)
    E = left_matrix(a) - right_matrix(b)
    F = left_matrix(a_dual) - right_matrix(b_dual)
    return np.concatenate([E @ q, F @ q + E @ q_dual], axis=-1)


def test_residuals_of_this_file(rng):
    X, A, B = exact_motions(rng, 5)
    assert np.abs(residuals(A, B, X)).max() < 1e-14


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_noise_free(rng, unit):
    pytest.importorskip("cvxpy")
    for _ in range(100):
        X, A, B = exact_motions(rng, int(rng.integers(2, 21)), **WIDE)
        for T in (X, A, B):
            T[..., :3, 3] *= unit
        estimate = METHOD.estimate(A, B)
        assert estimate.converged
        assert np.abs(difference(estimate.X, X) / np.repeat([1.0, unit], 3)).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("unit", [0.05, 1.0, 20.0])
def test_is_the_global_minimum(rng, unit):
    """Against a descent from many poses, in any unit of length."""
    pytest.importorskip("cvxpy")
    _, A, B = noisy_motions(rng, 4, sd=0.1)
    for T in (A, B):
        T[..., :3, 3] *= unit
    scale = np.repeat([1.0, unit], 3)

    def cost(xi, start):
        return np.sum(residuals(A, B, moved(start, scale * xi)) ** 2) / unit**2

    found = METHOD(A, B)
    lowest = cost(np.zeros(6), found)
    for _ in range(6):
        start = transforms(rotations(rng.normal(size=3)), unit * rng.normal(size=3))
        result = minimize(cost, np.zeros(6), (start,), method="BFGS", options={"gtol": 1e-9})
        assert lowest <= result.fun * (1 + 1e-9)
    best = minimize(cost, np.zeros(6), (moved(found, 0.05 * scale),), method="BFGS", options={"gtol": 1e-10})
    np.testing.assert_allclose(
        difference(moved(moved(found, 0.05 * scale), scale * best.x), found) / scale, 0, atol=1e-5
    )


@pytest.mark.slow
def test_hard_problems_are_certified(rng):
    """Two motions and much noise, where W has nearly equal minima."""
    pytest.importorskip("cvxpy")
    _, A, B = noisy_motions(rng, 2, sd=0.01, shape=(300,), smallest=0.3, largest=1.0)
    for T in (A, B):
        T[..., :3, 3] *= 1000.0
    assert METHOD.estimate(A, B).converged.all()


@pytest.mark.slow
def test_derivatives_are_those_of_the_estimate(rng):
    pytest.importorskip("cvxpy")
    _, A, B = noisy_motions(rng, 6, sd=1e-2)
    X = METHOD(A, B)
    block = METHOD.solver.derivatives(A[None], B[None], None, X[None])(slice(0, 1))
    F = block.block(A[None], B[None], slice(0, 6))  # (2, 6, 6, 1, 6)
    for side, name in enumerate("AB"):
        for pair in (0, 3):

            def of_error(xi, name=name, pair=pair):
                data = {"A": np.tile(A, (len(xi), 1, 1, 1)), "B": np.tile(B, (len(xi), 1, 1, 1))}
                data[name][:, pair] = moved(data[name][:, pair], xi)
                return difference(METHOD(data["A"], data["B"]), X)

            np.testing.assert_allclose(F[side, :, :, 0, pair], jacobian(of_error, 6), atol=1e-6)


def test_batch_equals_loop(rng):
    pytest.importorskip("cvxpy")
    _, A, B = noisy_motions(rng, 5, shape=(2, 3))
    whole = METHOD.estimate(A, B)
    assert whole.X.shape == (2, 3, 4, 4) and whole.converged.shape == (2, 3)
    for k in np.ndindex(2, 3):
        np.testing.assert_allclose(whole.X[k], METHOD(A[k], B[k]), atol=1e-12)


def test_no_iterations_no_answer(rng, monkeypatch):
    pytest.importorskip("cvxpy")
    monkeypatch.setattr(heller, "MAX_STEPS", 1)
    _, A, B = noisy_motions(rng, 5)
    assert not METHOD.estimate(A, B).converged
    with pytest.raises(NotConvergedError, match="'heller' did not converge"):
        METHOD(A, B)


def test_no_certificate_no_answer(rng, monkeypatch):
    """Another stationary point than the lowest does not pass."""
    pytest.importorskip("cvxpy")
    _, A, B = noisy_motions(rng, 4)
    G, _ = heller.scaled_gram(METHOD.solver.moments(A[None], B[None], None)[0], 4)
    q = np.linalg.eigh(G[0, :4, :4])[1][:, -1]  # a rotation that fits worst
    monkeypatch.setattr(heller, "_relaxed", lambda program, G: (np.stack([np.append(q, np.zeros(4))] * 2), True))
    with pytest.raises(NotConvergedError):
        METHOD(A, B)


def test_parallel_axes_are_degenerate(rng):
    pytest.importorskip("cvxpy")
    X, _, B = exact_motions(rng, 4)
    B[:, :3, :3] = rotations(np.array([0.0, 0.0, 1.0]) * rng.uniform(0.3, 2.0, (4, 1)))
    with pytest.raises(DegenerateMotionError):
        METHOD(X @ B @ np.linalg.inv(X), B)


@pytest.mark.parametrize("name", ["cvxpy", "clarabel"])
def test_missing_extra(rng, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    heller._program.cache_clear()
    _, A, B = exact_motions(rng, 3)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[sdp\]'"):
        METHOD(A, B)
    heller._program.cache_clear()


def test_metadata():
    assert METHOD.extra == "sdp" and METHOD.form == "convex program" and METHOD.structure == "simultaneous"
