"""The study of shared poses: its data, its two covariances and its verdicts."""

import numpy as np
import pytest
from fixtures.study_tables import quick_tables

import uq_handeye as uq
from studies import shared_poses
from studies.shared_poses import BOARD, NOISES, RANDOM, sequence, stated, trial_statistics
from studies.shared_poses.findings import findings, inside, slope
from uq_handeye.trials.simulation.experiment import experiment

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tables():
    return quick_tables("shared_poses")


@pytest.mark.parametrize("kind", [BOARD, RANDOM])
def test_poses_are_exact_and_the_first_of_one_sequence(kind):
    few, many = sequence(kind, 2, 10), sequence(kind, 2, 31)
    np.testing.assert_array_equal(few.robot, many.robot[:10])
    np.testing.assert_array_equal(few.camera, many.camera[:10])
    closed = many.robot @ many.truth.X @ many.camera
    np.testing.assert_allclose(closed, np.broadcast_to(many.truth.W, closed.shape), atol=1e-12)
    assert few.setup == "eye-in-hand"


def test_noise_is_one_mrad_and_one_mm():
    assert NOISES["camera"].robot is None and NOISES["robot"].camera is None
    for noise in (NOISES["camera"].camera, NOISES["robot"].robot, NOISES["both"].robot, NOISES["both"].camera):
        np.testing.assert_allclose(noise, 1e-6 * np.eye(6))


def test_covariances_are_what_the_library_states():
    data = sequence(BOARD, 0, 12)
    for way in shared_poses.WAYS:
        found = stated(experiment(data, NOISES["both"], pairs=way))
        motions = uq.relative_motions(data, way)
        for name, kind in (("pairs independent", "pairs"), ("pose-aware", "poses")):
            expected = uq.propagate(motions, NOISES["both"], X=data.truth.X, kind=kind)
            np.testing.assert_allclose(found[name], expected, rtol=1e-6, atol=1e-12)


def test_disjoint_pairs_share_nothing():
    found = stated(experiment(sequence(RANDOM, 0, 21), NOISES["both"], pairs="disjoint"))
    np.testing.assert_allclose(found["pairs independent"], found["pose-aware"], rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize(("way", "true"), [("disjoint", True), ("consecutive", False), ("all", False)])
def test_31_poses(way, true):
    """Only disjoint pairs may be taken as independent."""
    at = experiment(sequence(BOARD, 0, 31), NOISES["camera"], pairs=way)
    line = trial_statistics(at, 1500, np.eye(6), np.random.default_rng(5))
    assert line["NEES from"] < line["NEES, pose-aware"] < line["NEES to"]
    assert (line["NEES from"] < line["NEES, pairs independent"] < line["NEES to"]) == true
    P, S = stated(at).values()
    expected = np.trace(np.linalg.solve(P, S))
    error = 4 * line["error of NEES, pairs independent"]
    assert line["NEES, pairs independent"] == pytest.approx(expected, abs=error)
    assert {"disjoint": 6.0, "consecutive": 8.7, "all": 88}[way] == pytest.approx(expected, rel=0.05)


def test_slope_of_a_power_law():
    n = np.array([10, 20, 50, 100])
    assert slope(n, 3.0 * n**0.7)[0] == pytest.approx(0.7)
    noisy = 3.0 * n * np.exp([0.02, -0.02, 0.02, -0.02])
    exponent, half = slope(n, noisy)
    assert abs(exponent - 1) < half < 0.2


def test_the_verdict_follows_the_tables(tables):
    said = findings(tables)
    assert "disjoint pairs: true in 9 of 9" in said and "all pairs: true in 0 of 9" in said
    assert "pose-aware covariance** is true in 27 of 27" in said and "Outside in all: 0." in said


def test_findings_say_the_opposite_of_opposite_tables(tables):
    sampled = tables["sampled"].copy()
    one = sampled.copy()
    one.loc[0, "NEES, pose-aware"] = 9.0
    assert "Outside in all: 1; chance explains that" in findings({"sampled": one, "predicted": tables["predicted"]})
    sampled["NEES, pairs independent"] = 6.0
    sampled["NEES, pose-aware"] = 2.0 * sampled["poses"]
    predicted = tables["predicted"].assign(NEES=6.0)
    said = findings({"sampled": sampled, "predicted": predicted})
    assert "all pairs: true in 9 of 9" in said and "pose-aware covariance** is true in 0 of 27" in said
    assert "**more than chance explains**" in said and "holds in 0 of 12" in said
    assert inside(sampled, "NEES, pairs independent") == len(sampled)
