"""Rigs with wrong robot rows, wrong or exchanged views: these are left out, and the poses are as accurate as stated."""

import os
import warnings

import numpy as np
import pytest
from scipy.stats import chi2

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import inverse, logarithm, perturb
from uq_handeye.fit.diagnostics.exchanged_views import exchanged
from uq_handeye.fit.graph import weights
from uq_handeye.fit.graph.fit import fit
from uq_handeye.trials.simulation.several_cameras import simulate_rig

pytestmark = pytest.mark.filterwarnings("ignore:The views of the cameras left and right:uq_handeye.InputWarning")
SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
HAND = ({"left": "arm", "right": "arm"}, {"board": "world"})
CELL = ({"left": "world", "right": "world"}, {"board": "arm"})
NOISE = {"arm": ("0.3mrad", "0.2mm"), "left": ("1mrad", "0.5mm"), "right": ("1mrad", "0.5mm")}


def knocked(T, rows, rng):
    """Poses of which some are elsewhere: by 14 degrees and 5 cm."""
    axes = rng.normal(size=(len(rows), 3))
    turns = np.radians(14) * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    found = T.copy()
    found[rows] = perturb(found[rows], np.concatenate([turns, 0.05 * rng.normal(size=turns.shape)], axis=1))
    return found


def robot_rows(rig, rows, rng):
    return uq.Rig({"arm": knocked(rig.arms["arm"].poses, rows, rng)}, rig.cameras, rig.targets, rig.views)


def with_poses(rig, poses):
    views = [uq.View(view.camera, view.target, C, view.at) for view, C in zip(rig.views, poses, strict=True)]
    return uq.Rig(rig.arms, rig.cameras, rig.targets, views)


def both_cameras(rig, rows, rng):
    return with_poses(rig, [knocked(view.poses, rows, rng) for view in rig.views])


def views_exchanged(rig, rows, rng):
    left, right = (view.poses.copy() for view in rig.views)
    left[rows], right[rows] = right[rows].copy(), left[rows].copy()
    return with_poses(rig, [left, right])


def exchanged_of_a_pair(rig, rows, rng):
    """Exchanged views of cameras that are parallel, 10 cm apart: they are wrong in translation only."""
    left, right = (view.poses.copy() for view in rig.views)
    left[rows, 0, 3] += 0.1
    right[rows, 0, 3] -= 0.1
    return with_poses(rig, [left, right])


def one_camera(rig, rows, rng):
    return with_poses(rig, [rig.views[0].poses, knocked(rig.views[1].poses, rows, rng)])


@pytest.mark.parametrize(
    ("places", "n", "wrong", "count"),
    [
        (HAND, 40, robot_rows, 2),
        (HAND, 20, both_cameras, 3),
        (HAND, 20, views_exchanged, 6),
        (HAND, 20, exchanged_of_a_pair, 3),
        pytest.param(HAND, 20, exchanged_of_a_pair, 6, marks=pytest.mark.slow),
        (CELL, 20, views_exchanged, 3),
        (CELL, 20, views_exchanged, 6),
        pytest.param(CELL, 20, both_cameras, 3, marks=pytest.mark.slow),
        pytest.param(CELL, 20, one_camera, 8, marks=pytest.mark.slow),
    ],
)
def test_what_is_wrong_is_left_out(places, n, wrong, count):
    for k in range(3):
        rng = np.random.default_rng([SEED, k])
        exact, truth = simulate_rig(*places, n_poses=n, seed=k, noise=NOISE)
        rows = rng.choice(n, count, replace=False)
        found = uq.calibrate(wrong(exact, rows, rng))
        left_out = {int(at) for _, at in found.rejected_poses} | {int(at) for *_, at in found.rejected}
        assert left_out == set(rows.tolist())
        xi = np.concatenate(
            [
                np.concatenate([logarithm(T[:3, :3] @ truth[name][:3, :3].T), T[:3, 3] - truth[name][:3, 3]])
                for T, name in zip(found.poses, found.names, strict=True)
            ]
        )
        assert xi @ np.linalg.solve(found.covariance, xi) < chi2.ppf(1 - 1e-4, len(xi))


@pytest.mark.slow
def test_a_camera_of_which_most_poses_are_wrong_is_not_usable():
    """Its views are rejected, or its noise is named: never usable in silence."""
    noise = dict.fromkeys(("arm", "left", "right"), ("0.5mrad", "0.3mm"))
    cameras = {"left": "arm", "right": "arm"}
    for draw in (2,):  # the noise would explain all views
        rig, _ = simulate_rig(cameras, {"board": "world"}, n_poses=20, noise=noise, seed=[100, draw])
        assert not any(one.code == "rig.noisy_camera" for one in uq.calibrate(rig).findings)
        rng = np.random.default_rng([7, draw])
        poses = np.array(rig.views[1].poses)
        for row in rng.choice(20, 14, False):
            xi = rng.normal(size=(2, 3))
            xi *= np.array([[np.radians(14)], [0.05]]) / np.linalg.norm(xi, axis=1, keepdims=True)
            poses[row] = perturb(poses[row][None], xi.reshape(1, 6))[0]
        views = [rig.views[0], uq.View("right", "board", poses, rig.views[1].at)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = uq.calibrate(uq.Rig(rig.arms, rig.cameras, rig.targets, views))
        assert not found.usable and "right" in found.reasons[0]


def relative_poses(n, noise, baseline, rng):
    D = np.tile(np.eye(4), (n, 1, 1))
    D[:, 0, 3] = baseline
    return perturb(D, noise * rng.normal(size=(n, 6)))


def test_exchanged_views_are_found_without_a_fit():
    rng = np.random.default_rng([SEED, 5])
    for n, count in ((6, 1), (12, 5), (20, 9), (400, 3)):
        D, rows = relative_poses(n, 1e-3, 0.1, rng), rng.choice(n, count, replace=False)
        assert not exchanged(D, 0.5).any()
        D[rows] = inverse(D[rows])
        assert np.flatnonzero(exchanged(D, 0.5)).tolist() == sorted(rows.tolist())
    # views that do not agree, one camera twice
    assert not exchanged(perturb(D, rng.normal(size=(400, 6))), 0.5).any()
    assert not exchanged(relative_poses(20, 0.0, 0.0, rng), 0.5).any()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize(("count", "severity"), [(3, "caution"), (8, "failure")])
@pytest.mark.parametrize("wrong", [exchanged_of_a_pair, views_exchanged])
def test_exchanged_views_are_named(wrong, count, severity):
    """Half of the views are exchanged: the names of the cameras are not sure.

    Whether such views have an estimate depends on rounding; the finding is there in either case.
    """
    rig, _ = simulate_rig(*HAND, n_poses=15, seed=3, noise=NOISE)
    if wrong is exchanged_of_a_pair:
        left = rig.views[0].poses
        right = left.copy()
        right[:, 0, 3] += 0.1
        rig = with_poses(rig, [left, perturb(right, 1e-3 * np.random.default_rng(4).normal(size=(15, 6)))])
    rows = np.random.default_rng([SEED, 6]).choice(15, count, replace=False)
    try:
        result = uq.calibrate(wrong(rig, rows, None))
        findings, usable = result.findings, result.usable
    except uq.NotConvergedError as error:
        findings, usable = error.findings, False
    found = next(one for one in findings if one.code == "rig.exchanged_views")
    named = set(range(15)) - set(rows.tolist()) if 2 * count > 15 else set(rows.tolist())
    assert found.severity == severity and set(found.values["rows"]) == named
    assert usable == (severity == "caution")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize("places", [HAND, CELL])
def test_noise_that_is_refuted_is_said_to_be_that_of_its_camera(places):
    """The clock of a camera is off while the robot moves: its views scatter by more than was given."""
    larger = NOISE | {"right": ("8mrad", "4mm")}
    rig, _ = simulate_rig(*places, n_poses=14, seed=[SEED, 8], noise=larger)
    result = uq.calibrate(rig, noise=NOISE)
    (found,) = result.findings
    assert not result.usable and found.code == "rig.noise_too_small"
    first = found.values["larger"][0]
    assert first["name"] == "right" and 4.0 < first["times"] < 16.0 and "right" in found.phrase


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_a_robot_of_which_most_poses_are_wrong_is_not_usable():
    rig, _ = simulate_rig(*HAND, n_poses=12, seed=[SEED, 9], noise=NOISE)
    rows = np.flatnonzero(np.arange(12) % 3)
    result = uq.calibrate(robot_rows(rig, rows, np.random.default_rng([SEED, 9])))
    assert not result.usable and [one.code for one in result.findings if one.severity == "failure"]


@pytest.mark.filterwarnings("ignore:Camera right with board:uq_handeye.InputWarning")
def test_a_file_of_another_unit_is_refused_after_few_fits(monkeypatch):
    """Fits to views that contradict each other do not converge, and each of them takes all of its steps."""
    exact, _ = simulate_rig(*HAND, n_poses=20, seed=SEED, noise=NOISE)
    left, right = (view.poses.copy() for view in exact.views)
    right[:, :3, 3] *= 100.0
    calls = []
    monkeypatch.setattr(weights, "fit", lambda *values: calls.append(1) or fit(*values))
    with pytest.raises((uq.InputError, uq.NotConvergedError)) as refused:
        uq.calibrate(with_poses(exact, [left, right]), noise=NOISE)
    assert len(calls) < 60
    assert any("right is in cm" in str(one) and one.severity == "failure" for one in refused.value.findings)
