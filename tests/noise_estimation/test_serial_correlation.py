"""Errors of neighbouring poses that are correlated: found, told apart, and in the covariance of X.

The simulator here shares nothing with the estimate but the convention of errors: poses of the true rig, of which the
camera or the target moves by a random walk, or whose noise is an autoregressive process.
"""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2
from support import assert_same_covariance, difference, nees

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.geometry.se3 import inverse, perturb
from uq_handeye.likelihood.constraint import constraint_of
from uq_handeye.likelihood.gauss_helmert import fit_efficient
from uq_handeye.likelihood.starts import start_of
from uq_handeye.noise.estimate import Component, NoiseEstimate
from uq_handeye.noise_estimation.estimate import choose_source
from uq_handeye.noise_estimation.serial_correlation import account_for_correlation, times_of

DATA = os.environ.get("UQ_HANDEYE_DATA")
SETUPS = ("eye-in-hand", "eye-to-hand")
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
# Both sides together, per axis.
SIZES = np.repeat(np.sqrt(np.diag(NOISE.robot)[::3] + np.diag(NOISE.camera)[::3]), 3)


def drifting(n, setup, what, seed, step=1 / 3):
    """Poses whose camera or target walks by ``step`` of the noise from pose to pose; None: neither."""
    rng = np.random.default_rng([seed, n])
    truth = uq.simulate(n, setup=setup, seed=[seed, 1]).truth
    G = truth.robot if setup == "eye-in-hand" else inverse(truth.robot)
    walk = np.cumsum(step * SIZES * rng.standard_normal((n, 6)), axis=0)
    walk -= walk[0]  # the truth is X and W at the first pose
    X = perturb(np.broadcast_to(truth.X, (n, 4, 4)), walk * (what == "camera"))
    W = perturb(np.broadcast_to(truth.W, (n, 4, 4)), walk * (what == "target"))
    noise = [rng.standard_normal((n, 6)) * np.sqrt(np.diag(S)) for S in (NOISE.robot, NOISE.camera)]
    robot, camera = perturb(truth.robot, noise[0]), perturb(inverse(G @ X) @ W, noise[1])
    return uq.PosePairs(robot, camera, setup, np.arange(float(n)), truth)


def autoregressive(n, setup, side, seed, coefficient=0.9):
    """Poses whose noise of robot or camera is correlated in time, a random order of views."""
    rng = np.random.default_rng([seed, n])
    truth = uq.simulate(n, setup=setup, seed=[seed, 1]).truth
    parts = {}
    for name in ("robot", "camera"):
        z = rng.standard_normal((n, 6))
        if name == side:
            z[1:] *= np.sqrt(1 - coefficient**2)
            z = lfilter([1.0], [1.0, -coefficient], z, axis=0)
        size = np.sqrt(np.diag(NOISE.camera if name == side else NOISE.robot))  # the correlated one is the larger
        parts[name] = perturb(getattr(truth, name), z * size)
    return uq.PosePairs(parts["robot"], parts["camera"], setup, np.arange(float(n)), truth)


def both_fits(poses):
    """Return the fits with noise of independent poses, and with what neighbours have in common (None where nothing
    was found).
    """
    constraint = constraint_of(poses, None)
    at = start_of(poses, constraint, None)
    noise = choose_source(poses, constraint, None).find(at).noise
    part = Component("rotation, robot and camera together", "rad", float(SIZES[0]), 0.0, None, "estimated")
    estimate = NoiseEstimate(noise, (part,), (), np.zeros(3), np.zeros((3, 3)), 6.0 * poses.n - 12)
    fit = fit_efficient(constraint, estimate.noise, at)
    found = account_for_correlation(fit, poses, estimate.noise, estimate)
    return fit, None if found is None else fit_efficient(constraint, found.noise, fit.unknowns), found


def mean_d2(sets):
    """(independent, with correlation), the share of sets in which it was found, and what was found."""
    squares, ways = [], []
    for poses in sets:
        fit, wider, found = both_fits(poses)
        pair = [nees(difference(of.X, poses.truth.X)[None], of.covariance_X)[0] for of in (fit, wider or fit)]
        squares.append(pair)
        ways.append(None if found is None else found.correlation.way)
    return *np.mean(squares, axis=0), np.mean([way is not None for way in ways]), ways


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize(
    ("n", "sets", "least", "most"), [(8, 120, 9.0, 12.0), (15, 120, 15.0, 9.0), (40, 40, 40.0, 9.0)]
)
def test_a_drifting_camera_is_in_the_covariance(setup, n, sets, least, most):
    independent, correlated, found, _ = mean_d2(drifting(n, setup, "camera", seed) for seed in range(sets))
    assert independent > least
    assert 4.0 < correlated < most
    assert found > 0.6


@pytest.mark.parametrize(("setup", "n", "sets"), [("eye-in-hand", 15, 100), ("eye-to-hand", 40, 40)])
def test_a_drifting_target_does_no_harm(setup, n, sets):
    _, correlated, found, ways = mean_d2(drifting(n, setup, "target", seed) for seed in range(sets))
    assert 3.5 < correlated < 9.0
    assert found > 0.6
    if n == 40:
        assert ways.count("target") > 0.9 * sets


@pytest.mark.parametrize("setup", SETUPS)
def test_independent_poses_stay_as_they_are(setup):
    _, correlated, found, _ = mean_d2(drifting(15, setup, None, seed) for seed in range(300))
    assert 5.4 < correlated < 7.0  # the mean of 300 chi-square(6) lies within 0.6 of 6
    assert found < 0.45
    independent, correlated, found, _ = mean_d2(drifting(40, setup, None, seed) for seed in range(100))
    assert found < 0.06
    assert abs(correlated - independent) < 0.3


@pytest.mark.parametrize(("setup", "side"), [("eye-in-hand", "robot"), ("eye-to-hand", "camera")])
def test_noise_that_is_correlated_in_time(setup, side):
    """1,000 poses, AR(1) with the coefficient 0.9."""
    independent, correlated, found, ways = mean_d2(autoregressive(1000, setup, side, seed) for seed in range(25))
    assert independent > 14.0
    assert 4.0 < correlated < 8.0
    assert found == 1.0
    assert ways.count(f"{side} noise") > 20


def test_the_process_is_recovered():
    _, _, found = both_fits(autoregressive(1000, "eye-in-hand", "camera", 3))
    c = found.correlation
    np.testing.assert_allclose(c.length, -1 / np.log(0.9), rtol=0.2)
    np.testing.assert_allclose([c.rotation, c.translation], np.sqrt(np.diag(NOISE.camera)[[0, 3]]), rtol=0.2)
    assert not c.drift
    assert c.odds > 1e6
    _, _, found = both_fits(drifting(200, "eye-in-hand", "camera", 3))
    c = found.correlation
    assert c.drift and c.way == "camera"
    steps = np.sqrt(2.0 / c.length) * np.array([c.rotation, c.translation])  # of the walk
    np.testing.assert_allclose(steps, SIZES[[0, 3]] / 3, rtol=0.35)
    own = np.sqrt(found.noise.robot[0, 0] + found.noise.camera.own[0, 0, 0])
    np.testing.assert_allclose(own, SIZES[0], rtol=0.15)


def test_the_order_is_that_of_time():
    """Rows in any order give the same, and poses whose order is lost show nothing."""
    poses = drifting(60, "eye-in-hand", "camera", 1)
    order = np.random.default_rng(0).permutation(60)
    one, other = both_fits(poses)[1], both_fits(poses.rows(order))[1]
    np.testing.assert_allclose(other.covariance_X, one.covariance_X, rtol=1e-3)
    without = uq.PosePairs(poses.robot[order], poses.camera[order])
    assert both_fits(without)[2] is None
    np.testing.assert_array_equal(times_of(poses.rows(order)), order)
    fast = uq.PosePairs(poses.robot, poses.camera, timestamps=np.append(0.1 * np.arange(59.0), 7.0))
    np.testing.assert_allclose(times_of(fast), np.append(np.arange(59.0), 70.0), rtol=1e-9)


# ------------------------------------------------------------------------------------------------------ calibrate


@pytest.fixture(scope="module")
def moved():
    """A calibration of 20 poses whose camera moves a lot, and the same with independent poses."""
    poses = drifting(20, "eye-in-hand", "camera", 3, step=0.6)
    return [quietly(poses, correlation=wanted) for wanted in ("auto", "none")]


def quietly(poses, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return uq.calibrate(poses, shared=[], **options)


def test_calibrate_says_it_and_has_it_in_the_number(moved):
    result, independent = moved
    correlation = result.noise_estimate.correlation
    assert correlation.way == "camera" and correlation.drift and independent.noise_estimate.correlation is None
    told = [finding for finding in result.findings if finding.code == "noise_estimation.correlated"]
    assert len(told) == 1 and told[0].severity == "caution"
    assert "the camera drifts against the gripper" in str(told[0])
    ratio = np.linalg.solve(independent.covariance, result.covariance)
    np.testing.assert_allclose(told[0].values["growth"], np.sqrt(np.trace(ratio) / 6), rtol=1e-6)
    assert (result.std > 1.3 * independent.std).all()
    assert result.reference.dof < 0.5 * independent.reference.dof
    assert {"drift of the camera, rotation", "drift of the camera, translation"} < {
        part.name for part in result.noise_estimate.components
    }
    shares = result.analysis.budget.shares[result.analysis.budget.sources.index("drift of the camera")]
    assert (shares[:6] > 0.5).all()
    np.testing.assert_allclose(result.analysis.budget.covariance[:6, :6], result.covariance, rtol=1e-6, atol=1e-12)
    text = result.summary(verbose=True)
    assert "drift of the camera, translation" in text and text.count("drift of the camera") > 2
    stated = next(f for f in result.noise_estimate.findings if f.code == "noise_estimation.told_by_data")
    whole = result.noise_estimate["rotation, robot and camera together"]
    assert stated.values["components"][0]["value"] == whole.value  # beside the drift, not before it


def test_files_keep_it(moved, tmp_path):
    result, _ = moved
    result.to_json(tmp_path / "result.json")
    again = uq.Calibration.from_json(tmp_path / "result.json")
    assert again.to_json() == result.to_json()
    assert again.noise_estimate.correlation == result.noise_estimate.correlation
    assert again.noise.camera.serial.name == "drift of the camera"
    assert again.summary() == result.summary()


def test_what_is_made_of_the_noise_has_the_drift(moved):
    """Trials of Monte Carlo drift as the poses did, and sigma points agree with the first order."""
    result, independent = moved
    run = uq.monte_carlo(result.data, noise=result.noise, trials=1500, method="efficient", seed=1)
    assert run.consistency.consistent, run.summary()
    assert_same_covariance(run.covariance, result.covariance, 0.15)
    with pytest.raises(AssertionError):
        assert_same_covariance(run.covariance, independent.covariance, 0.15)
    points = quietly(result.data, covariance="sigma-points")
    np.testing.assert_allclose(points.std, result.std, rtol=0.02)


def test_other_covariances_and_noise_that_is_given_are_as_before(moved):
    result, _ = moved
    for kind in ("sandwich", "hac"):
        one, other = (quietly(result.data, covariance=kind, correlation=of) for of in ("auto", "none"))
        np.testing.assert_array_equal(one.covariance, other.covariance)
        assert one.noise_estimate.correlation is None
    one, other = (quietly(result.data, noise=NOISE, correlation=of) for of in ("auto", "none"))
    np.testing.assert_array_equal(one.covariance, other.covariance)
    assert any(finding.code == "diagnostics.correlated" for finding in one.findings)  # tested, no more
    with pytest.raises(InputError, match="Expected `correlation` to be one of auto, none, got 'ar1'"):
        uq.calibrate(result.data, correlation="ar1")


def test_a_wrong_pose_is_left_out_of_a_drifting_set():
    poses = drifting(30, "eye-in-hand", "camera", 5)
    camera = np.array(poses.camera)
    camera[11] = perturb(camera[11], np.array([0.3, 0.0, 0.0, 0.0, 0.2, 0.0]))
    result = quietly(uq.PosePairs(poses.robot, camera, poses.setup, poses.timestamps))
    assert list(result.table.flagged) == [11]
    without = quietly(poses.rows(np.arange(30) != 11))  # whose neighbours are then one step apart, not two
    assert_same_covariance(result.covariance, without.covariance, 0.05)
    assert (np.abs(difference(result.X, without.X)) < 0.1 * without.std).all()
    assert result.noise_estimate.correlation.way == "camera"


@pytest.mark.skipif(DATA is None, reason="UQ_HANDEYE_DATA is not set")
def test_two_halves_of_a_real_recording_agree():
    folder = Path(DATA) / "ethz_robot_arm_sync"
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    first, last = (quietly(poses.rows(rows)) for rows in np.array_split(np.arange(poses.n), 2))
    apart = difference(first.X, last.X)
    assert np.linalg.norm(apart[3:]) > 5e-3  # 0.3 mm are stated for independent poses
    assert apart @ np.linalg.solve(first.covariance + last.covariance, apart) < chi2(6).isf(1e-3)
    first, last = (quietly(poses.rows(rows), correlation="none") for rows in np.array_split(np.arange(poses.n), 2))
    apart = difference(first.X, last.X)
    assert apart @ np.linalg.solve(first.covariance + last.covariance, apart) > 100
