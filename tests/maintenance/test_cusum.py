"""CUSUM charts: run lengths by Markov chain against simulation, published values and Siegmund's formula."""

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.use.maintenance.cusum import K, cusum, limit_for, run_length, vector_cusum


def siegmund(limit, reference=K):
    b = 2.0 * reference * (limit + 1.166)
    return float((np.exp(b) - b - 1.0) / (2.0 * reference**2))


def simulated(limit, components, rng, runs=1000):
    """Mean run length and its standard error; all runs at once, independent of the package."""
    at, lengths, k = np.zeros((runs, components or 1)), [], 0
    while len(at):
        k += 1
        at = at + rng.standard_normal(at.shape)
        if components is None:
            at = np.maximum(0.0, at - K)
        else:
            at = at * np.maximum(0.0, 1 - K / np.linalg.norm(at, axis=1))[:, None]
        below = np.linalg.norm(at, axis=1) <= limit
        lengths += [k] * int((~below).sum())
        at = at[below]
    return np.mean(lengths), np.std(lengths) / np.sqrt(runs)


@pytest.mark.parametrize("components", [None, 3, 6])
def test_the_run_length_is_that_of_simulated_charts(components, rng):
    limit = limit_for(100.0, components=components)
    assert run_length(limit, components=components) == pytest.approx(100, rel=1e-3)
    mean, error = simulated(limit, components, rng)
    assert abs(mean - 100) < 4 * error
    wrong, error = simulated(0.8 * limit, components, rng)  # another limit is another rate
    assert wrong < 100 - 6 * error


@pytest.mark.parametrize(("p", "limit"), [(2, 5.5), (10, 14.9), (20, 24.7)])
def test_run_lengths_of_vectors_as_published(p, limit):
    """Crosier (1988): K = 0.5, average run length 200."""
    assert run_length(limit, components=p) == pytest.approx(200, rel=0.01)


@pytest.mark.parametrize("limit", [3.0, 4.0, 5.0])
def test_siegmunds_formula_agrees(limit):
    assert run_length(limit) == pytest.approx(siegmund(limit), rel=0.02)


def test_charts_are_their_recursions(rng):
    z = rng.standard_normal(50) + 0.5
    np.testing.assert_allclose(cusum(z), [max(sum(z[j:k] - K) for j in range(k + 1)) for k in range(1, 51)], atol=1e-12)
    # a vector chart of one direction adds up like one of numbers, once it is away from 0
    u = np.full((20, 2), [0.6, 0.8])
    np.testing.assert_allclose(vector_cusum(u), 0.5 * np.arange(1, 21), atol=1e-12)
    assert vector_cusum(np.zeros((3, 2))).tolist() == [0, 0, 0]


def test_refusals():
    for wrong in (0.0, 1e9):
        with pytest.raises(uq.InputError, match="one false alarm in"):
            limit_for(wrong)
