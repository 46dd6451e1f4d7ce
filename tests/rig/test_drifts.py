"""Rigs with times: a camera or target that creeps is in the covariance, and one that moves in one step is named."""

import os

import numpy as np
import pytest
from scipy.stats import chi2

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import logarithm, perturb
from uq_handeye.fit.graph.drifts import MAX_DRIFT_COLUMNS, drifts_of, times_of
from uq_handeye.fit.graph.graph import Graph
from uq_handeye.model.errors.key import Kind
from uq_handeye.model.shared_errors.assumed import drift_columns
from uq_handeye.trials.simulation.several_cameras import simulate_rig

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
NOISE = {"arm": ("0.3mrad", "0.05mm"), "left": ("2mrad", "0.5mm"), "right": ("2mrad", "0.5mm")}
STEP = np.repeat([0.6e-3, 0.15e-3], 3)  # of a walk, from pose to pose (rad, m)


def drawn(seed, moves=None, n=40):
    """A rig of two cameras on the hand with times, of which the left one moves by errors (n, 6); and its true poses."""
    rig, truth = simulate_rig(
        {"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=n, noise=NOISE, seed=[SEED, seed]
    )
    times = (2.0 * np.arange(n)).tolist()
    poses = {view.camera: np.array(view.poses) for view in rig.views}
    if moves is not None:
        poses["left"] = perturb(poses["left"], moves)
    views = [uq.View(camera, "board", T, at=times) for camera, T in poses.items()]
    return uq.Rig({"arm": uq.ArmPoses(rig.arms["arm"].poses, times)}, rig.cameras, rig.targets, views), truth


def test_drifts_have_few_columns_and_those_of_their_owner():
    graph = Graph.of(rig := drawn(0)[0])
    times = times_of(rig, graph)
    rows = {name: graph.names.index(name) == graph.X for name in ("left", "right")}
    board = {"board": np.ones(graph.E, dtype=bool)}
    found = drifts_of(graph, times, np.unique(times), rows, board)
    assert [one.key.kind for one in found] == [Kind.CAMERA_DRIFT, Kind.CAMERA_DRIFT, Kind.TARGET_DRIFT]
    assert sum(one.count for one in found) <= MAX_DRIFT_COLUMNS
    assert not found[0].columns[rows["right"]].any() and found[0].columns[rows["left"]].any(axis=(1, 2)).all()
    assert drifts_of(graph, times[:5], np.unique(times[:5]), rows, board) == []
    numbers, _ = simulate_rig(rig.cameras, rig.targets, n_poses=8, noise=NOISE)
    assert times_of(numbers, Graph.of(numbers)) is None


def test_few_terms_hold_most_of_the_variance_of_a_walk():
    """One 80 %, two 90 %, four 95 % of the mean variance of a walk of 200 steps from its first pose on."""
    times, T = np.arange(200.0), np.tile(np.eye(4), (200, 1, 1))
    whole = np.mean(np.arange(1, 201))
    for terms, share in ((1, 0.8), (2, 0.9), (4, 0.95)):
        walk = drift_columns(T, times, False, terms=terms).coordinates
        held = np.mean(np.sum((walk - walk[0]) ** 2, axis=1)) / whole
        assert held == pytest.approx(share, abs=0.02), terms


@pytest.mark.statistical
@pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")
def test_a_camera_that_creeps_is_in_the_covariance():
    """d^2 of X at the first pose: without a drift in the model it is 40 and more."""
    squares = {"left": [], "right": []}
    for seed in range(10):
        rng = np.random.default_rng([SEED, 7, seed])
        walk = np.cumsum(rng.normal(size=(40, 6)) * STEP, axis=0)
        rig, truth = drawn(seed, walk - walk[0])
        found = uq.calibrate(rig)
        assert found.usable
        for name, listed in squares.items():
            one = found.cameras[name]
            xi = [logarithm(one.pose[:3, :3] @ truth[name][:3, :3].T), one.pose[:3, 3] - truth[name][:3, 3]]
            listed.append(np.concatenate(xi) @ np.linalg.solve(one.covariance, np.concatenate(xi)))
    # the first pose is an end of the walk, farther from the mean than others: its d^2 may be above 6, far below 40
    assert np.mean(squares["left"]) < 18 and np.mean(squares["right"]) < chi2.ppf(0.999, 60) / 10
    rig, _ = drawn(0, walk - walk[0])
    keys = [part["key"]["kind"] for part in uq.calibrate(rig, correlation="none").components]
    assert not any("drift" in kind.lower() for kind in keys)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")
@pytest.mark.parametrize("shift", [0.003, 0.0])
def test_a_step_is_named_beside_the_drift(shift):
    for seed in range(3):
        moves = np.zeros((25, 6))
        moves[12:, 3:] = shift * np.array([0.6, -0.64, 0.48])
        found = uq.calibrate(drawn(seed, moves, 25)[0])
        moved = [one for one in found.findings if one.code == "rig.moved"]
        assert len(moved) == (shift > 0) and found.usable == (shift == 0)
        assert all(abs(float(one.values["since"]) - 24.0) <= 4.0 for one in moved)
