"""The minimum over values and blocks, against the same problem minimised over all unknowns at once by SciPy."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from uq_handeye.model.camera.adjustment.variable_projection import CONVERGED_SHARE, diagonal, minimised, reduced

N, M, F = 5, 20, 3


@dataclass
class Problem:
    """``r_i = exp(T_i v) + x + x^3 - y_i, x = S_i p_i``."""

    T: Any  # (n, m, f)
    S: Any  # (n, m, 6)
    y: Any  # (n, m)
    evaluated: int = 0

    @classmethod
    def random(cls, rng, noise=0.0, f=F):
        problem = cls(0.3 * rng.normal(size=(N, M, f)), 0.3 * rng.normal(size=(N, M, 6)), np.zeros((N, M)))
        truth = rng.normal(size=f), 0.3 * rng.normal(size=(N, 6))
        problem.y = problem.rows(*truth)[0] + noise * rng.normal(size=(N, M))
        return problem, truth

    @property
    def m(self):
        return M

    def rows(self, values, blocks, part=slice(None)):
        self.evaluated += 1
        T, S = self.T[part], self.S[part]
        grown, x = np.exp(T @ values), (S @ blocks[..., None])[..., 0]
        return grown + x + x**3 - self.y[part], grown[..., None] * T, (1 + 3 * x**2)[..., None] * S

    def moved(self, blocks, step):
        return blocks + step

    def jointly(self, values, blocks, prior=None):
        """(values, blocks, cost, normal matrix) by SciPy."""
        f = len(values)

        def residual(x):
            r = self.rows(x[:f], x[f:].reshape(-1, 6))[0].ravel()
            return r if prior is None else np.concatenate([r, prior[1] @ (x[:f] - prior[0])])

        found = least_squares(residual, np.concatenate([values, blocks.ravel()]), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        return found.x[:f], found.x[f:].reshape(-1, 6), 2 * found.cost, found.jac.T @ found.jac


@pytest.mark.parametrize("far", [0.1, 3.0])
@pytest.mark.parametrize("known", [False, True])
def test_it_is_the_minimum_over_everything_at_once(rng, known, far):
    problem, (values, blocks) = Problem.random(rng, 0.05)
    prior = (values + 0.1, 3 * rng.normal(size=(F, F))) if known else None
    found = minimised(problem, values + far * rng.normal(size=F), blocks + far * rng.normal(size=(N, 6)), prior)
    v, p, cost, whole = problem.jointly(values, blocks, prior)
    information = np.linalg.inv(np.linalg.inv(whole)[:F, :F])
    assert found.converged
    normal = found.information + (prior[1].T @ prior[1] if known else 0.0)
    assert found.squares == pytest.approx(cost, rel=1e-10)
    off = found.values - v
    assert off @ information @ off < 2 * CONVERGED_SHARE * cost
    np.testing.assert_allclose(found.blocks, p, atol=1e-5)
    np.testing.assert_allclose(normal, information, rtol=1e-4, atol=1e-4 * np.abs(information).max())
    _, A, B = problem.rows(found.values, found.blocks)
    J, G = reduced(A, B)
    np.testing.assert_allclose(found.G, G, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(found.V, B.mT @ B, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(found.information, np.einsum("nij,nik->jk", J, J), rtol=1e-3)


def test_pictures_taken_one_by_one_are_the_same(rng, monkeypatch):
    problem, (values, blocks) = Problem.random(rng, 0.05)
    whole = minimised(problem, values + 0.1, blocks)
    monkeypatch.setattr("uq_handeye.model.camera.adjustment.variable_projection.MAX_NUMBERS_TOGETHER", 2 * M * (F + 6))
    for part, same in zip(minimised(problem, values + 0.1, blocks), whole, strict=True):
        np.testing.assert_allclose(part, same, rtol=1e-9, atol=1e-9)


def test_the_start_at_the_minimum_costs_one_evaluation(rng):
    problem, start = Problem.random(rng, 0.05)
    found = minimised(problem, *start)
    problem.evaluated = 0
    again = minimised(problem, found.values, found.blocks)
    assert problem.evaluated == again.steps == 1 and again.converged
    np.testing.assert_allclose(again.values, found.values, atol=1e-8)


def test_a_problem_that_is_solved_exactly(rng):
    problem, (values, blocks) = Problem.random(rng)
    found = minimised(problem, values + 0.3, blocks - 0.1)
    assert found.converged
    np.testing.assert_allclose(found.values, values, atol=1e-9)
    np.testing.assert_allclose(found.blocks, blocks, atol=1e-9)


def test_without_values_and_with_blocks_that_nothing_determines(rng):
    problem, (values, blocks) = Problem.random(rng, 0.05, f=0)
    problem.S[2], problem.S[3, :, 1] = 0.0, problem.S[3, :, 0]
    start = blocks + 0.1
    found = minimised(problem, values, start)
    assert found.converged and found.values.shape == (0,) and found.G.shape == (N, 6, 0)
    np.testing.assert_array_equal(found.blocks[2], start[2])
    _, _, cost, _ = problem.jointly(values, blocks)
    assert found.squares == pytest.approx(cost, rel=1e-10)
    assert np.ptp((found.blocks - start)[3, :2]) < 1e-9  # the shortest step of many


def test_values_that_nothing_determines_stay(rng):
    problem, (values, blocks) = Problem.random(rng, 0.05)
    problem.T[..., 1] = 0.0
    found = minimised(problem, values + 0.1, blocks)
    assert found.converged and found.values[1] == values[1] + 0.1


def test_a_step_that_is_never_better_ends(rng):
    """Wrong derivatives, for example, end the search; it stays where it was."""
    problem, (values, blocks) = Problem.random(rng, 0.05)
    problem.rows = lambda *at, true=problem.rows: (lambda r, A, B: (r, -A, -B))(*true(*at))
    found = minimised(problem, values + 0.1, blocks)
    assert found.steps < 100
    np.testing.assert_allclose(found.values, values + 0.1, atol=1e-6)


def test_damped_inverses(rng):
    root = rng.normal(size=(4, 6, 6)) * 10.0 ** rng.uniform(-3, 3, 6)
    H = root.mT @ root
    e, Q = diagonal(H)
    for damping in (0.0, 0.3):
        damped = H + damping * np.einsum("nii->ni", H)[:, None] * np.eye(6)
        inverse = Q @ ((1 / (e + damping))[..., None] * Q.mT)
        np.testing.assert_allclose(inverse @ damped, np.broadcast_to(np.eye(6), (4, 6, 6)), atol=1e-6)


def test_a_start_without_residuals_is_refused(rng):
    problem, (values, blocks) = Problem.random(rng, 0.05)
    problem.y[1, 2] = np.nan
    with pytest.raises(np.linalg.LinAlgError, match="start are not finite"):
        minimised(problem, values, blocks)
