"""The dual bound: tight at the global minimum, below every other one, from which the bound leads to the best."""

import os

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.core.geometry.nearest_rotation import nearest_rotation
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.fit.diagnostics.optimality import PROVEN, Isotropic, _constraints, prove
from uq_handeye.fit.graph.fit import fit
from uq_handeye.fit.graph.graph import Graph
from uq_handeye.fit.graph.noise import given_noise
from uq_handeye.fit.graph.start import start_of
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
SIZE = ("0.5mrad", "0.3mm")
TWO_AXES = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
NEAR_AXES = [[1.0, 0.0, 0.0], [1.0, 0.2, 0.0]]


def fitted(cameras, targets, seed, **given):
    exact, truth = simulate_rig(cameras, targets, seed=seed, **given)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), SIZE)
    rig = with_noise(exact, noise, [SEED, seed])
    graph = Graph.of(rig)
    return rig, fit(graph, given_noise(rig, graph, noise), start_of(graph)[0]), truth


def test_constraints_vanish_on_rotations_alone():
    rng = np.random.default_rng(1)
    A = _constraints()
    for R in nearest_rotation(rng.normal(size=(20, 3, 3)))[0]:
        d = np.append((R - np.eye(3)).reshape(-1), 1.0)
        np.testing.assert_allclose(np.einsum("p,kpq,q->k", d, A, d), 0, atol=1e-12)
        mirrored = np.append((-R - np.eye(3)).reshape(-1), 1.0)
        assert np.abs(np.einsum("p,kpq,q->k", mirrored, A, mirrored)).max() > 0.5
    assert np.linalg.matrix_rank(A.reshape(len(A), -1)) == len(A) == 20


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "place"), [(1, "arm"), (1, "world"), (2, "arm"), (2, "world"), (5, "arm"), (5, "world")]
)
def test_simulated_rigs_are_proven(count, place):
    """Up to ten unknown poses."""
    cameras = {f"c{k}": place for k in range(count)}
    targets = {f"t{k}": "arm" if place == "world" else "world" for k in range(count)}
    rig, found, _ = fitted(cameras, targets, 5, n_poses=15)
    optimality, better = prove(rig, found)
    assert optimality.proven and better is None
    assert optimality.gap < 1e-7
    assert optimality.distance < 2


@pytest.mark.slow
@pytest.mark.parametrize("axes", [TWO_AXES, NEAR_AXES])
@pytest.mark.parametrize(
    ("cameras", "targets"),
    [
        ({"c": "arm"}, {"t": "world"}),
        ({"c": "world", "d": "world"}, {"t": "arm"}),
        ({"c": "arm", "d": "world"}, {"t": "world", "u": "world"}),
    ],
)
def test_every_planted_minimum_is_rejected_and_left(cameras, targets, axes):
    planted = 0
    for seed in range(3):
        _, found, _ = fitted(cameras, targets, seed, n_poses=12, axes=axes)
        problem = Isotropic.of_fit(found)
        best = problem.value(problem.minimum(found.at))
        rng = np.random.default_rng([SEED, seed])
        for _ in range(10):
            start = found.at.copy()
            start[:, :3, :3] = nearest_rotation(rng.normal(size=(len(start), 3, 3)))[0]
            at, gap, better = problem.globally(start)
            value = problem.value(at)
            assert value > best * (1 - 1e-9)
            if value < best * (1 + 1e-6):
                assert gap < PROVEN
                continue
            planted += 1
            assert gap > PROVEN
            assert better is not None
            assert problem.value(better) < best * (1 + 1e-6)
    assert planted or axes is TWO_AXES


@pytest.mark.slow
def test_a_fit_in_a_local_minimum_is_left_for_the_global_one(monkeypatch):
    """The start of `calibrate_rig` is planted: the estimate is the same as from its own start."""
    exact, _ = simulate_rig({"c": "arm"}, {"t": "world"}, n_poses=12, axes=NEAR_AXES, seed=0)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), SIZE)
    rig = with_noise(exact, noise, [SEED, 0])
    right = calibrate_rig(rig, noise, robust=False)
    assert right.optimality.proven and right.optimality.rejected == 0
    graph = Graph.of(rig)
    problem = Isotropic.of(graph, right.poses, np.full((graph.E, 2), 4e-6), np.ones(graph.E, dtype=bool))
    rng, left = np.random.default_rng(SEED), 0
    for _ in range(12):
        start = right.poses.copy()
        start[:, :3, :3] = nearest_rotation(rng.normal(size=(len(start), 3, 3)))[0]
        planted = problem.minimum(start)
        if problem.value(planted) < 1.01 * problem.value(right.poses):
            continue
        monkeypatch.setattr(
            "uq_handeye.calibration.calibrate_rig.start_of", lambda g, s, at=planted: (at, np.ones(g.E, dtype=bool))
        )
        found = calibrate_rig(rig, noise, robust=False)
        left += 1
        assert found.optimality.proven
        # two steps of `efficient` from two starts agree far below the standard deviations
        np.testing.assert_allclose(found.poses[0], right.poses[0], atol=0.2 * right.cameras["c"].std.min())
    assert left


@pytest.mark.slow
def test_two_arms_are_not_proven_unless_the_base_is_known():
    exact, truth = simulate_rig({"c1": "a"}, {"t1": "b"}, arms=("a", "b"), n_poses=30, seed=4)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), SIZE)
    rig = with_noise(exact, noise, [SEED, 1])
    found = calibrate_rig(rig, noise)
    assert not found.optimality.proven
    assert "that of b is estimated" in " ".join(found.text(verbose=True).split())
    assert found.to_dict()["optimality"]["proven"] is False
    known = uq.Rig(rig.arms, rig.cameras, rig.targets, rig.views, {"b": (truth["b"], 1e-8 * np.eye(6))})
    assert calibrate_rig(known, noise).optimality.proven


@pytest.mark.parametrize("place", ["arm", "world"])
def test_the_linear_start_is_right_on_exact_poses(place):
    """Rotations of all cameras and targets by one eigenvector."""
    targets = {"t1": "arm" if place == "world" else "world", "t2": "arm" if place == "world" else "world"}
    rig, truth = simulate_rig({"c1": place, "c2": place}, targets, n_poses=8, seed=3)
    graph = Graph.of(rig)
    at = start_of(graph)[0]
    off = inverse(np.array([truth[name] for name in graph.names])) @ at
    np.testing.assert_allclose(off, np.tile(np.eye(4), (graph.m, 1, 1)), atol=1e-9)
