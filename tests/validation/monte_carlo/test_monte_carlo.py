"""monte_carlo(): true covariances pass, wrong ones do not, and the numbers are those of an independent simulator."""

import json
import re

import numpy as np
import pytest
from fixtures.trials import NOISE, assert_same, pairs_problem
from scipy import stats
from support import (
    SEED,
    assert_same_covariance,
    difference,
    draw,
    is_consistent,
    moved,
    nees,
    whitened_eigenvalues,
)

import uq_handeye as uq
from uq_handeye import InputError
from uq_handeye.model.poses.pose_pairs import Truth
from uq_handeye.trials.simulation import run as trials_module
from uq_handeye.trials.validation.monte_carlo import chunks
from uq_handeye.trials.validation.monte_carlo import run as module
from uq_handeye.trials.validation.monte_carlo.run import MonteCarlo, monte_carlo


@pytest.fixture(scope="module")
def problem():
    return pairs_problem()


@pytest.fixture(scope="module")
def poses():
    return uq.simulate(15, noise=NOISE, seed=SEED)


@pytest.fixture(scope="module")
def ten_thousand(problem):
    return monte_carlo(problem[0], noise=problem[1], seed=SEED)


def own_errors(motions, noise, rng, trials):
    """The same experiment once more, with nothing of the package but `solve`."""
    X = uq.solve(motions.A, motions.B)
    A = moved(motions.A, draw(rng, noise.A, (trials, motions.N)))
    B = moved(motions.B, draw(rng, noise.B, (trials, motions.N)))
    return difference(uq.solve(A, B), X)


# ------------------------------------------------------------------------------------------------------- statistics


def test_fields(ten_thousand):
    result = ten_thousand
    assert isinstance(result, MonteCarlo)
    assert result.errors.shape == (10_000, 6) and (result.trials, result.failures, result.kept) == (10_000, 0, 10_000)
    np.testing.assert_allclose(result.covariance, np.cov(result.errors.T), rtol=1e-9)
    np.testing.assert_allclose(result.bias, result.errors.mean(axis=0), rtol=1e-9)
    d2 = nees(result.errors, result.predicted)
    assert result.mean_nees == pytest.approx(d2.mean(), rel=1e-12)
    assert result.nees["joint"][0] == result.mean_nees
    assert result.nees["rotation"][0] == pytest.approx(
        nees(result.errors[:, :3], result.predicted[:3, :3]).mean(), rel=1e-9
    )
    for level, share in result.coverage.items():
        assert share == (d2 <= stats.chi2.ppf(level, 6)).mean()
    np.testing.assert_allclose(result.eigenvalues, whitened_eigenvalues(result.covariance, result.predicted))
    assert (result.complete, result.reason) == (True, "all trials done")
    assert result.method == "4dpa" and result.seconds > 0 and result.rate > 0


def test_the_first_order_covariance_is_found_true(ten_thousand, problem):
    assert ten_thousand.consistent and is_consistent(ten_thousand.errors, ten_thousand.predicted)
    assert_same_covariance(ten_thousand.predicted, uq.propagate(*problem), 1e-9)


def test_the_numbers_of_an_independent_simulator(ten_thousand, problem, rng):
    """Two-sample tests: of the NEES, and of every component (Kolmogorov and Smirnov), and of the covariances."""
    other = own_errors(*problem, rng, 6_000)
    one = ten_thousand.errors
    P = ten_thousand.predicted
    tests = [stats.ks_2samp(nees(one, P), nees(other, P))]
    tests += [stats.ks_2samp(one[:, k], other[:, k]) for k in range(6)]
    assert min(test.pvalue for test in tests) > 0.001 / 7
    eigenvalues = whitened_eigenvalues(np.cov(other.T), ten_thousand.covariance)
    assert np.abs(eigenvalues - 1).max() < 4 * np.sqrt(2 / 6_000 + 2 / 10_000) * 1.5  # six at once


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.9, 1.1])
@pytest.mark.parametrize("part", [slice(6), slice(3), slice(3, 6)], ids=["all", "rotation", "translation"])
def test_standard_deviations_10_percent_off_are_rejected(problem, ten_thousand, factor, part):
    scale = np.ones(6)
    scale[part] = factor
    wrong = ten_thousand.predicted * scale * scale[:, None]
    result = monte_carlo(problem[0], noise=problem[1], seed=SEED, covariance=wrong)
    assert not result.consistent and result.tested == "given"
    assert ("too small" if factor < 1 else "too large") in result.verdict
    np.testing.assert_array_equal(result.errors, ten_thousand.errors)


@pytest.mark.parametrize("method", ["4dpa", "efficient", "ml", "park", "daniilidis", "shah", "nguyen"])
def test_every_kind_of_method_on_poses(poses, method):
    result = monte_carlo(poses, noise=NOISE, method=method, trials=2_000, seed=SEED)
    assert result.trials == 2_000 and result.failures < 20 and result.frame == "gripper_T_camera"
    assert (
        result.consistency.nees_interval[0, 0] - 0.15 < result.mean_nees < result.consistency.nees_interval[0, 1] + 0.15
    )


def test_pairs_taken_as_independent_are_rejected(poses):
    """Some calibrations take all pairs of the same poses as independent (T4)."""
    motions = uq.relative_motions(poses, "all")
    wrong = uq.propagate(motions, NOISE, X=poses.truth.X, kind="pairs")
    result = monte_carlo(poses, noise=NOISE, covariance=wrong, trials=1_000, seed=SEED)
    assert result.mean_nees > 20 and "too small" in result.verdict


@pytest.mark.slow
def test_the_covariance_of_each_trial(problem):
    result = monte_carlo(*problem[:1], noise=problem[1], covariance="each", trials=2_000, seed=SEED)
    assert result.tested == "each" and result.consistency.own and result.consistent
    assert_same_covariance(result.predicted, uq.propagate(*problem), 0.05)  # their mean
    again = monte_carlo(problem[0], noise=problem[1], covariance=result.predicted, trials=2_000, seed=SEED)
    assert result.mean_nees != again.mean_nees


@pytest.mark.slow
def test_real_data_are_simulated_around_their_fit(poses):
    measured = uq.PosePairs(poses.robot, poses.camera)
    result = monte_carlo(measured, noise=NOISE, method="efficient", trials=2_000, seed=SEED)
    assert result.origin == "fit to the data" and result.consistent
    np.testing.assert_allclose(result.experiment.X, uq.maximum_likelihood(measured, NOISE).X, atol=1e-9)
    estimated = monte_carlo(measured, method="efficient", trials=200, seed=SEED)
    assert estimated.noise_estimated and isinstance(estimated.noise, uq.PoseNoise)


def test_trials_that_fail_are_counted_and_left_out(problem, monkeypatch):
    """Every tenth trial is made to fail."""
    ordinary = trials_module.run

    def sometimes(*args, **kwargs):
        found = ordinary(*args, **kwargs)
        ok = np.arange(len(found.ok)) % 10 > 0
        return found._replace(ok=ok, errors=np.where(ok[:, None], found.errors, 0.0))

    whole = monte_carlo(problem[0], noise=problem[1], trials=3_000, seed=SEED)
    monkeypatch.setattr(chunks, "run", sometimes)
    result = monte_carlo(problem[0], noise=problem[1], trials=3_000, seed=SEED)
    assert (result.trials, result.failures, result.kept) == (3_000, 300, 2_700)
    np.testing.assert_array_equal(result.errors, whole.errors[np.arange(3_000) % 10 > 0])
    np.testing.assert_allclose(result.covariance, np.cov(result.errors.T), rtol=1e-9)
    monkeypatch.setattr(
        chunks, "run", lambda *args, **kwargs: ordinary(*args, **kwargs)._replace(ok=np.zeros(1000, bool))
    )
    nothing = monte_carlo(problem[0], noise=problem[1], trials=1_000, seed=SEED)
    assert nothing.failures == 1_000 and nothing.covariance is None and nothing.consistent is None
    json.loads(nothing.to_json())
    assert nothing.summary() and repr(nothing)


# ------------------------------------------------------------------------------------------------- the same numbers


def test_the_first_trials_of_a_longer_run(problem, ten_thousand):
    shorter = monte_carlo(problem[0], noise=problem[1], trials=3_000, seed=SEED)
    np.testing.assert_array_equal(shorter.errors, ten_thousand.errors[:3_000])
    other = monte_carlo(problem[0], noise=problem[1], trials=3_000, seed=SEED + 1)
    assert not np.isin(other.errors, ten_thousand.errors).any()


def test_only_the_first_errors_are_kept_but_all_count(problem, ten_thousand, monkeypatch):
    monkeypatch.setattr(module, "KEPT", 2_500)
    result = monte_carlo(problem[0], noise=problem[1], seed=SEED)
    assert result.kept == 2_500 and result.trials == 10_000
    np.testing.assert_array_equal(result.errors, ten_thousand.errors[:2_500])
    np.testing.assert_array_equal(result.covariance, ten_thousand.covariance)


def test_chunks_get_smaller_where_the_problem_is_large(poses):
    sizes = {}
    for n in (15, 60, 200):
        many = uq.simulate(n, noise=NOISE, seed=SEED)
        for method in ("4dpa", "park"):
            sizes[n, method] = chunks.chunk_size(chunks.Experiment(many, many.truth.X, many.truth.W, NOISE, method))
    assert sizes == {
        (15, "4dpa"): 1000,
        (15, "park"): 1000,
        (60, "4dpa"): 1000,
        (60, "park"): 100,
        (200, "4dpa"): 1000,
        (200, "park"): 10,
    }


# ---------------------------------------------------------------------------------------------------------- digits


@pytest.mark.slow
def test_it_stops_once_the_digits_are_stable(problem):
    result = monte_carlo(problem[0], noise=problem[1], digits=1, seed=SEED)
    assert result.complete and result.reason == "stable to 1 digit" and result.stability.stable
    assert 110_000 <= result.trials < 1_000_000 and result.trials % 10_000 == 0
    assert_same_covariance(result.covariance, result.predicted, 0.03)
    assert_same(monte_carlo(problem[0], noise=problem[1], digits=1, seed=SEED, workers=2), result)


@pytest.mark.slow
def test_digits_that_are_not_reached_are_said(problem):
    result = monte_carlo(problem[0], noise=problem[1], digits=3, trials=20_000, seed=SEED)
    assert not result.complete and result.reason.startswith("all trials done, but not stable: 2 blocks of trials")


# ------------------------------------------------------------------------------------------------------- interrupts


def test_an_interrupt_keeps_what_is_done(problem, ten_thousand, monkeypatch):
    ordinary, calls = trials_module.run, []

    def interrupted(*args, **kwargs):
        calls.append(1)
        if len(calls) == 5:
            raise KeyboardInterrupt
        return ordinary(*args, **kwargs)

    monkeypatch.setattr(chunks, "run", interrupted)
    result = monte_carlo(problem[0], noise=problem[1], seed=SEED)
    assert (result.complete, result.reason, result.trials) == (False, "interrupted", 4_000)
    np.testing.assert_array_equal(result.errors, ten_thousand.errors[:4_000])
    assert "NOT COMPLETE: interrupted" in result.summary() and "incomplete" in repr(result)
    calls[:] = [1] * 4
    with pytest.raises(KeyboardInterrupt):
        monte_carlo(problem[0], noise=problem[1], seed=SEED)


# ----------------------------------------------------------------------------------------------------------- output


@pytest.mark.slow
def test_json_table_figure_and_text(ten_thousand, tmp_path):
    text = ten_thousand.to_json(tmp_path / "result.json")
    assert text == (tmp_path / "result.json").read_text() and not re.search(r"NaN|Infinity", text)
    data = json.loads(text)
    assert data["covariance"] == ten_thousand.covariance.tolist() and data["consistent"] is True
    table = ten_thousand.to_dataframe()
    assert len(table) == 6 and not table.isna().any(axis=None)
    np.testing.assert_allclose(table["std_sampled"], np.sqrt(np.diag(ten_thousand.covariance)))
    assert ((table["ratio_low"] < 1.01) & (table["ratio_high"] > 0.99)).all()
    assert repr(ten_thousand) == "MonteCarlo(4dpa, 10,000 trials, consistent)"
    assert "mean NEES" in ten_thousand.summary()
    ten_thousand.figure(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=r"named .png or .svg"):
        ten_thousand.figure(tmp_path / "figure.docx")


@pytest.mark.parametrize("trials", [2, 10])
def test_very_few_trials(problem, trials):
    result = monte_carlo(problem[0], noise=problem[1], trials=trials, seed=SEED)
    assert result.errors.shape == (trials, 6)
    assert result.covariance is not None
    json.loads(result.to_json())
    assert result.summary() and len(result.to_dataframe()) == 6


def test_numpy_integers(problem):
    asked = {"trials": np.int64(10_000), "seed": np.int32(SEED), "workers": np.uint8(1), "digits": np.int64(1)}
    result = monte_carlo(problem[0], noise=problem[1], **asked)
    assert result.trials == 10_000 and result.seed == SEED and json.loads(result.to_json())["stability"]["digits"] == 1


@pytest.mark.slow
@pytest.mark.parametrize("variance", [1e-60, 1e-8, 1e60])
def test_errors_that_are_exactly_zero_in_some_directions(poses, variance, tmp_path):
    """Translations alone are noisy, so that rotations are found exactly."""
    noise = uq.PoseNoise(robot=np.diag([0.0, 0, 0, 1e-8, 1e-8, 1e-8]))
    result = monte_carlo(poses, noise=noise, covariance=variance * np.eye(6), trials=300, seed=SEED)
    assert not result.consistent and result.summary() and json.loads(result.to_json())
    result.figure(tmp_path / "figure.png")


@pytest.mark.slow
def test_how_arrays_lie_in_memory_changes_nothing(poses):
    def turned(a):
        return np.ascontiguousarray(a.swapaxes(-1, -2)).swapaxes(-1, -2)

    given = np.diag([1e-6, 2e-6, 1e-6, 1e-6, 3e-6, 1e-6]) + 1e-7
    reference = monte_carlo(uq.PosePairs(poses.robot, poses.camera), noise=NOISE, covariance=given, trials=500)
    for change in (turned, np.asfortranarray, lambda a: np.repeat(a, 2, axis=-1)[..., ::2]):
        data = uq.PosePairs(change(poses.robot), change(poses.camera))
        noise = uq.PoseNoise(change(NOISE.robot), change(NOISE.camera))
        assert_same(monte_carlo(data, noise=noise, covariance=change(given), trials=500), reference)
        simulated = uq.PosePairs(poses.robot, poses.camera, truth=Truth(*map(change, poses.truth)))
        for method in ("efficient", "4dpa"):
            found, expected = (monte_carlo(d, noise=NOISE, method=method, trials=500) for d in (simulated, poses))
            assert_same(found, expected)


# ------------------------------------------------------------------------------------------------------------ errors


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"trials": 1}, "`trials` to be an integer of at least 2, got 1"),
        ({"trials": 1e4}, "`trials` to be an integer"),
        ({"trials": 10**13}, "`trials` to be at most 1,000,000,000,000"),
        ({"seed": -1}, "`seed` to be an integer of at least 0"),
        ({"seed": None}, "`seed` to be an integer"),
        ({"workers": 0}, "`workers` to be an integer of at least 1"),
        ({"workers": True}, "`workers` to be an integer"),
        ({"covariance": "own"}, "`covariance` to be None, 'each' or a"),
        ({"covariance": np.eye(3)}, "`covariance` to have shape"),
        ({"covariance": np.diag([1.0, 1, 1, 1, 1, 0])}, "positive definite"),
        ({"covariance": 1e-300 * np.eye(6)}, "`covariance` in rad.2 and m.2, got 1e-300, which is too small"),
        ({"covariance": 1e300 * np.eye(6)}, "got 1e[+]300, which is too large"),
        ({"digits": 7}, "`digits` to be a whole number from 1 to 4"),
        ({"digits": 2, "trials": 9_000}, "at least 10,000 with `digits`"),
        ({"method": "best"}, "`method` to be one of"),
        ({"resume": True}, "Expected a `directory`"),
    ],
    ids=str,
)
def test_wrong_arguments(problem, arguments, words):
    with pytest.raises(InputError, match=words):
        monte_carlo(problem[0], noise=problem[1], **arguments)
