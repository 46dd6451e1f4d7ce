"""Checks, sizes and the tolerance sentence of a rig, which are those of one camera."""

import re
from dataclasses import replace

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.calibration.tolerance import MET
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
