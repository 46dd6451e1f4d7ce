"""Scores of successive checks: independent and standard normal, though all share the calibration's error."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from uq_handeye.model.posterior.rows import NewRows
from uq_handeye.use.maintenance.cusum import Innovations, scores_of
from uq_handeye.use.maintenance.series_alarm import shifts_since

CHECKS, POSES, P = 4, 2, 8


@pytest.fixture
def design(rng):
    """Posterior, columns by u and own noise of each check, columns of a shift."""
    state = SimpleNamespace(A=rng.standard_normal((12, P)), points=None)
    V = [1.5 * rng.standard_normal((POSES, 6, P)) for _ in range(CHECKS)]
    roots = [np.eye(6) + 0.2 * rng.standard_normal((POSES, 6, 6)) for _ in range(CHECKS)]
    C = [np.eye(6) + 0.3 * rng.standard_normal((POSES, 6, 6)) for _ in range(CHECKS)]
    return state, V, roots, C


def series(design, rng, size=1.0, shift=None, since=0):
    state, V, roots, C = design
    u = size * rng.standard_normal(P)
    found = []
    for k in range(CHECKS):
        own = roots[k] @ (size * rng.standard_normal((POSES, 6, 1)))
        r = (V[k] @ u) + own[..., 0] + (0 if shift is None or k < since else C[k] @ shift)
        found.append(NewRows(r, V[k], roots[k] @ roots[k].mT, state))
    return found


def test_the_innovations_are_the_joint_covariance_in_steps(design, rng):
    evidence = series(design, rng)
    parts = (np.concatenate([getattr(of, name) for of in evidence]) for name in ("r", "by_unit", "own"))
    joint = NewRows(*parts, design[0])
    e = Innovations(evidence).whitened([of.r.reshape(-1, 1) for of in evidence])
    assert sum(float(part[:, 0] @ part[:, 0]) for part in e) == pytest.approx(joint.d2, rel=1e-9)


@pytest.mark.statistical
def test_scores_are_independent_and_standard_normal(design, rng):
    runs = 200
    C = {"X": design[3]}
    found = [scores_of(series(design, rng), C) for _ in range(runs)]
    u = np.array([of.by_cause["X"] for of in found]).reshape(runs, -1)
    S = u.T @ u / runs
    tolerance = 4.5 / np.sqrt(runs)
    assert np.abs(S - np.eye(len(S))).max() < tolerance * np.sqrt(2)
    p = np.array([of.p_values for of in found])
    assert kstest(p.ravel(), "uniform").pvalue > 1e-3
    assert np.abs(np.corrcoef(p.T) - np.eye(CHECKS)).max() < tolerance
    # each check by itself, as if the others were of another calibration: correlated
    alone = np.array([[of.d2 for of in series(design, rng)] for _ in range(runs)])
    assert np.abs(np.corrcoef(alone.T) - np.eye(CHECKS)).max() > 1.5 * tolerance


@pytest.mark.statistical
def test_the_common_size_of_estimated_noise_is_in_the_scores(design, rng):
    """The size is unknown by a chi-square of nu degrees of freedom, and the same in all checks."""
    runs, nu = 200, 20.0
    p, naive, u = [], [], []
    for _ in range(runs):
        evidence = series(design, rng, size=float(np.sqrt(nu / rng.chisquare(nu))))
        of = scores_of(evidence, {"X": design[3]}, nu)
        p.append(of.p_values)
        u.append(of.by_cause["X"])
        naive.append(scores_of(evidence, {}).p_values)
    p, u = np.array(p), np.array(u)
    assert kstest(p.ravel(), "uniform").pvalue > 1e-3
    assert np.abs(np.corrcoef(p.T) - np.eye(CHECKS)).max() < 4.5 / np.sqrt(runs)
    assert np.mean(np.sum(u**2, axis=-1)) == pytest.approx(6.0, abs=4 * np.sqrt(12 / (runs * CHECKS)))
    naive = np.array(naive)
    assert np.corrcoef(naive.T)[0, 1] > 4.5 / np.sqrt(runs)
    assert kstest(naive.ravel(), "uniform").pvalue < 1e-3


def test_a_shift_is_estimated_from_its_start_on(design, rng):
    shift = np.array([3.0, 0, 0, 0, -2.0, 0])
    evidence = series(design, rng, shift=shift, since=2)
    found = shifts_since(evidence, design[3], range(CHECKS))
    assert max(range(CHECKS), key=lambda j: found[j].gain) == 2
    e = found[2].estimate - shift
    assert e @ np.linalg.solve(found[2].covariance, e) < 30
    assert found[2].gain > found[0].gain
