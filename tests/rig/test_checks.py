"""Checks, sizes and the tolerance sentence of a rig, which are those of one camera."""

import re
from dataclasses import replace

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.calibration.tolerance import MET
from uq_handeye.core.geometry.se3 import difference, inverse
from uq_handeye.findings import CHECKS, MINIMUM
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

NOISE = dict.fromkeys(("arm", "left", "right"), ("0.5mrad", "0.3mm"))


@pytest.fixture(scope="module")
def rig():
    exact, _ = simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=30, seed=3)
    return with_noise(exact, NOISE, 3)


@pytest.fixture(scope="module")
def result(rig):
    return uq.calibrate(rig, noise=NOISE)


def status_of(result, name):
    return next(check.status for check in result.checks if check.name == name)


def test_checks_are_those_of_one_camera_and_the_proof(result):
    assert [check.name for check in result.checks] == [*CHECKS, MINIMUM]
    assert {check.name for check in result.checks if check.status == "not run"} == {"neighbours", "shared errors"}
    assert result.status == "ok" and result.doubts == ()


def test_sizes_are_of_the_worst_direction(result):
    turns, shifts = zip(*(one.sizes for one in result.cameras.values()), strict=True)
    S = [one.covariance for one in result.cameras.values()]
    np.testing.assert_allclose(turns, [np.sqrt(np.linalg.eigvalsh(one[:3, :3])[-1]) for one in S])
    np.testing.assert_allclose(shifts, [np.sqrt(np.linalg.eigvalsh(one[3:, 3:])[-1]) for one in S])
    assert "(1 sigma, worst direction)" in result.headline


def test_the_tolerance_that_is_stated_is_met_and_no_smaller_one(result):
    size = float(re.search(r"a tolerance of ([\d.]+) mm", result.suits).group(1))
    ahead = {name: one.distance for name, one in result.points_ahead.items()}
    for factor, met in ((1.0, True), (0.9, False)):
        words = {name: result.verdicts(f"{factor * size}mm", at=far)[name] for name, far in ahead.items()}
        assert all(one.word == "PASS" for one in words.values()) is met
        assert (min(one.probability for one in words.values()) >= MET) is met


def test_rejected_views_are_a_caution_with_their_poses(rig):
    poses = rig.views[1].poses.copy()
    poses[[4, 9], :3, 3] += 0.05
    wrong = replace(rig, views=(rig.views[0], replace(rig.views[1], poses=poses)))
    result = uq.calibrate(wrong, noise=NOISE)
    check = next(one for one in result.checks if one.name == "outliers")
    assert check.text == "2 of 60 views rejected: board by right at 4, 9"
    assert check.status == result.status == "caution" and result.usable


def test_noise_that_is_too_small_fails_its_check_and_no_tolerance_is_shown(rig):
    noise = dict.fromkeys(NOISE, ("0.42mrad", "0.25mm"))
    result = uq.calibrate(rig, noise=noise)
    assert result.usable and status_of(result, "noise level") == "failed" and result.status == "caution"
    assert "no tolerance is shown to be met: check failed: noise level" in result.suits
    assert {one.word for one in result.verdicts("10mm").values()} == {"NOT SHOWN"}


@pytest.fixture(scope="module")
def about_one_axis():
    exact, truth = simulate_rig(
        {"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=20, axes=np.eye(3)[:1], seed=1
    )
    return uq.calibrate(with_noise(exact, NOISE, 1), noise=NOISE), truth


def test_motions_about_one_axis_leave_a_translation_open_and_nothing_else(about_one_axis):
    result, truth = about_one_axis
    assert result.open.shape == (1, 18) and (result.open.reshape(3, 6)[:, :3] == 0.0).all()
    turn, shift = result.cameras["left"].sizes
    assert turn < 1e-3 and np.isinf(shift)
    relative = result.relative("left", "right")  # what is open moves both alike
    assert not len(relative.open)
    xi = difference(relative.pose, inverse(truth["left"]) @ truth["right"])
    assert xi @ np.linalg.solve(relative.covariance, xi) < 25
    assert status_of(result, "motion") == "caution" and "another axis" in result.advice


def test_a_plan_closes_what_is_open(about_one_axis):
    plan = uq.plan(about_one_axis[0], k=2)
    assert len(plan.open_directions) == 2 and plan.worst[0, 1] > 0.1 and plan.worst[-1, 1] < 2e-3
    assert "leave directions of left, right open" in plan.summary()


def test_three_poses_test_nothing(rig):
    kept = replace(rig, views=tuple(replace(view, poses=view.poses[:3], at=view.at[:3]) for view in rig.views))
    result = uq.calibrate(kept, noise=NOISE)
    assert {status_of(result, name) for name in ("input", "outliers", "residuals", "two halves")} == {"not run"}
