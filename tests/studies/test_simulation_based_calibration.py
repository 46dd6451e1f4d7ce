"""The study of the posterior's probabilities: what is drawn, and that its test can fail both ways."""

import numpy as np
import pandas as pd
import pytest

import uq_handeye as uq
from studies.common.scores import errors
from studies.simulation_based_calibration import BINS, CASES, band, figures, findings, problem, ranks, told, verdicts
from uq_handeye.fit.graph.constraint import covariances_of

pytestmark = pytest.mark.slow


def table(counts, wrong):
    rows = [
        {"case": "a case", "wrong_on_purpose": wrong, "quantity": name, "problems": 100, "bin": k + 1, "ranks": n}
        for name in ("theta_x", "distance")
        for k, n in enumerate(counts)
    ]
    return pd.DataFrame(rows)


EVEN, SKEW = [5] * BINS, [0] * (BINS - 1) + [100]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_data_are_of_the_model(case, rng):
    X, data, log_scales = problem(case, rng)
    assert np.any(log_scales != 0) == case.scales
    off = data.A @ X - X @ data.B if isinstance(data, uq.Motions) else np.diff(data.robot @ X @ data.camera, axis=0)
    assert 0 < np.abs(off).max() < 0.5


def test_what_the_sampler_is_told():
    for case in CASES:
        for found, S in zip(covariances_of(told(case)), covariances_of(case.noise), strict=True):
            np.testing.assert_allclose(found, case.told**2 * S)
    assert [case.wrong for case in CASES].count(True) == 2


def test_noise_has_the_covariance_of_the_case(rng):
    case = CASES[0]
    exact = case._replace(noise=uq.PairNoise(1e-24 * np.eye(6), case.noise.B), n=4000)
    X, data, _ = problem(exact, rng)
    xi = errors(data.B, np.linalg.inv(X) @ data.A @ X)
    np.testing.assert_allclose(np.cov(np.linalg.solve(np.linalg.cholesky(case.noise.B), xi.T)), np.eye(6), atol=0.1)


@pytest.mark.parametrize(
    ("counts", "wrong", "said"),
    [
        (EVEN, False, "in 1 of 1 cases in which the sampler is told the truth"),
        (SKEW, False, "in 0 of 1 cases in which the sampler is told the truth"),
        (EVEN, True, "0 of 1 cases that are wrong on purpose are rejected"),
        (SKEW, True, "1 of 1 cases that are wrong on purpose are rejected"),
    ],
)
def test_verdicts_follow_the_ranks(counts, wrong, said):
    found = table(counts, wrong)
    assert said in findings({"ranks": found})
    assert verdicts(found)["uniform"].all() == (counts is EVEN)


def test_the_band_holds_uniform_ranks(rng):
    half = band(100)
    counts = rng.multinomial(100, np.full(BINS, 1 / BINS), size=2000)
    apart = np.abs(np.cumsum(counts, axis=1) / 100 - np.arange(1, BINS + 1) / BINS)
    assert np.mean((apart <= half + 1e-12).all(axis=1)) == pytest.approx(0.99, abs=0.01)
    assert set(figures({"ranks": table(EVEN, False)})) == {"ranks"}


def test_every_problem_is_ranked_once():
    found = ranks(CASES[0], 1, 7)
    assert (found.groupby("quantity")["ranks"].sum() == 1).all() and found["quantity"].nunique() == 7
