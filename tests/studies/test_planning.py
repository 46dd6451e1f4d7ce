"""The study of planning: what it scores, and that its findings follow the tables."""

import numpy as np
import pytest
from fixtures.study_tables import quick_tables

from studies.planning import findings, of_degenerate, of_random, of_subsets
from studies.planning.sessions import against_all_subsets, degenerate, spread, worst_rotation, worst_translation
from uq_handeye.trials.simulation.rig import RIGS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tables():
    return {name: table for name, table in quick_tables("planning").items() if name != "real"}


def test_worst_axes_are_in_mm_and_degrees():
    S = np.diag([1, 4, 1, 9, 1, 1]) * 1e-6
    assert worst_translation(S) == pytest.approx(3) and worst_rotation(S) == pytest.approx(np.degrees(2e-3))


def test_open_is_not_a_number():
    assert spread(np.array([np.inf, np.inf, 1.0]), "mm") == {"median_mm": None, "least_mm": 1.0, "largest_mm": None}


@pytest.mark.parametrize("setup", RIGS)
def test_degenerate_starts_turn_about_one_axis(setup, rng):
    poses = degenerate(rng, setup, 60.0)
    turns = poses.robot[1:, :3, :3] @ poses.robot[0, :3, :3].T
    np.testing.assert_allclose(turns[:, 2], np.broadcast_to([0, 0, 1], (7, 3)), atol=1e-12)
    X, W = RIGS[setup]
    G = poses.robot if setup == "eye-in-hand" else np.linalg.inv(poses.robot)
    np.testing.assert_allclose(G @ X @ poses.camera, np.broadcast_to(W, (8, 4, 4)), atol=1e-12)


def test_no_choice_beats_the_best_subset():
    rows = list(against_all_subsets(3))
    assert all(row["mean_gap"] >= 0 and row["at_the_optimum"] <= 3 for row in rows)


def test_planned_poses_are_better_than_random_ones(tables):
    table = tables["random"].set_index("more_poses")["translation_sd_mm"]
    assert table["5 planned"] < 0.9 * table["5 at random"] < 0.9 * table["none"]
    assert findings(tables).count("| --- |") >= 4


def test_findings_turn_with_the_tables(tables):
    true = tables["random"].assign(mean_nees=6.0)
    assert "consistent in 3 of 3 rows" in of_random(true)[-1]
    assert "consistent in 0 of 3 rows" in of_random(true.assign(mean_nees=60.0))[-1]
    subsets = tables["subsets"]
    assert "finds the optimum in 100.0 %" in of_subsets(subsets.assign(at_the_optimum=subsets["sessions"]))[-1]
    assert "finds the optimum in 0.0 %" in of_subsets(subsets.assign(at_the_optimum=0))[-1]
    left = tables["degenerate"]
    assert "X is determined in 0 of" in of_degenerate(left.assign(left_open=left["sessions"]))[-1]
