"""Pictures of different noise count accordingly: X is better for it, and its covariance true."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support import CONFIDENCE, SEED, mean_interval

import uq_handeye as uq
from studies.camera_covariance import ROBOT, SIZE, error, poses_of, recorded
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.model.camera.adjustment.bundle import adjust
from uq_handeye.model.camera.adjustment.picture_weights import common_variance, picture_weights
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.report.text import noise_words

SETS = 60


def uneven(rng, n=20, spread=0.8):
    """Pixel noise (n, 1, 1) of the pictures, log-normal about 0.2."""
    return 0.2 * np.exp(spread * rng.normal(size=(n, 1, 1)))


def distances(spread, sets=SETS):
    """d^2 and error of the translation (mm) of ``sets`` cameras, with weights of the pictures and without."""
    found = []
    for k in range(sets):
        rng = np.random.default_rng([SEED, k])
        corners, robot, X = recorded(rng, pixel=uneven(rng, spread=spread))
        poses = poses_of(corners, robot)
        seen = poses.camera_calibration
        same = adjust(seen.bundle.unknowns, seen.corners, (seen.bundle.parameters, seen.poses))
        F = same.by_parameters @ np.linalg.cholesky(same.covariance)
        row = []
        for of, covariance in (
            (poses, seen.covariance),
            (uq.PosePairs(poses.robot, same.poses), uq.JointCovariance(same.own, F)),
        ):
            fit = efficient(of, uq.PoseNoise(ROBOT, covariance))
            e = error(fit.X, X)
            row.append((e @ np.linalg.solve(fit.covariance_X, e), 1e3 * np.linalg.norm(e[3:])))
        found.append(row)
    return np.moveaxis(found, 0, -1)


@pytest.mark.statistical
def test_uneven_pictures_are_weighed_and_equal_ones_lose_nothing():
    low, high = mean_interval(SETS)
    (d2, mm), (_, equal_weights) = distances(0.8)
    assert 0.8**2 * low < d2.mean() < high  # quiet pictures are taken as a little noisier: a careful covariance
    assert np.sqrt(np.mean(mm**2)) < 0.7 * np.sqrt(np.mean(equal_weights**2))
    (equal_d2, equal_mm), (_, same_mm) = distances(0.0)
    assert low < equal_d2.mean() < high
    assert np.sqrt(np.mean(equal_mm**2)) < 1.05 * np.sqrt(np.mean(same_mm**2))


def test_the_weights_are_those_of_the_noise_up_to_the_median(rng):
    noise = uneven(rng, spread=1.0)
    corners, _, _ = recorded(rng, pixel=noise)
    cam = calibrate_camera(corners, SIZE, "pinhole")
    weights, true = cam.bundle.weights, noise.ravel()[: corners.n]
    assert (weights == weights.max()).sum() == corners.n // 2  # a good picture counts for no more than the median one
    noisy = true > 1.2 * np.median(true)
    ratio = cam.bundle.picture_noise[noisy] / true[noisy]
    assert np.exp(np.std(np.log(ratio))) < 1.2 and 0.85 < np.median(ratio) < 1.2
    assert (cam.bundle.picture_noise[~noisy] > 0.8 * true[~noisy]).all()
    # s is the root mean square over all corners still, and the weights do not change it
    assert cam.pixel_noise == pytest.approx(
        np.sqrt(np.sum(cam.bundle.residuals[cam.bundle.used] ** 2) / cam.bundle.freedom), rel=0.1
    )
    assert "Pictures differ, from" in noise_words(cam)


def test_pictures_that_differ_by_chance_alone_count_alike(rng):
    even, _, _ = recorded(rng)
    cam = calibrate_camera(even, SIZE, "pinhole")
    assert cam.bundle.weights.min() > 0.9 * cam.bundle.weights.max()
    assert "differ" not in noise_words(cam)


@pytest.mark.slow
def test_few_corners_are_shrunk_to_the_common_noise(rng):
    """A picture that fits perfectly by chance counts for no more, one that fits badly for a little less."""
    corners, _, _ = recorded(rng)
    cam = calibrate_camera(corners, SIZE, "pinhole")
    first = corners.picture == 0
    for factor, least in ((0.0, 0.99), (2.0, 0.2)):
        residuals = cam.bundle.residuals.copy()
        residuals[first] *= factor
        weights = picture_weights(replace(cam.bundle, residuals=residuals), corners)
        assert least < weights[0] / np.median(weights[1:]) < 1.01
    same = picture_weights(replace(cam.bundle, residuals=np.zeros_like(residuals)), corners)
    np.testing.assert_array_equal(same, np.ones(corners.n))


@pytest.mark.parametrize("nu", [3.0, 30.0, np.inf])
def test_the_common_variance_and_its_spread_are_found(nu):
    """Mean and spread of scaled inverse chi-square variances, from 2000 of them."""
    rng = np.random.default_rng([SEED, 40])
    m = rng.integers(20, 110, 2000).astype(float)
    v = 0.04 * np.ones(2000) if nu == np.inf else 0.04 * nu / rng.chisquare(nu, 2000)
    common, found = common_variance(v * rng.chisquare(m) / m, m)
    assert common == pytest.approx(0.04, rel=0.05)
    assert found > 400 if nu == np.inf else found == pytest.approx(nu, rel=0.15)


@pytest.mark.slow
def test_a_folder_keeps_the_weights(rng, tmp_path, without_rendering):
    corners, _, _ = recorded(rng, pixel=uneven(rng))
    cam = calibrate_camera(corners, SIZE, "pinhole")
    cam.write(tmp_path / "camera")
    np.testing.assert_array_equal(uq.read_camera(tmp_path / "camera").bundle.weights, cam.bundle.weights)
    assert cam.select(np.array([2, 5])).bundle.weights.tolist() == cam.bundle.weights[[2, 5]].tolist()


def shifted(corners, rng, pixels):
    """Add errors that all corners of a picture share."""
    shift = pixels * rng.normal(size=(corners.picture.max() + 1, 2))
    return replace(corners, pixels=corners.pixels + shift[corners.picture])


@pytest.mark.statistical
@pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")
def test_what_corners_of_a_picture_share_is_carried_beside_a_known_robot():
    """An exact robot shows it, residuals within the pictures do not: without it d^2 is 116."""
    shift, usual = "shift of each picture", "camera beyond its corners"
    exact = uq.NoisePrior(robot=(0.0, 0.0), factor=1)
    found, pixels = [], []
    for k in range(12):
        rng = np.random.default_rng([SEED, 31, k])
        corners, robot, X = recorded(rng, pixel=0.03, robot=None)
        result = uq.calibrate(poses_of(shifted(corners, rng, 0.025), robot), prior=exact, shared=[])
        e = error(result.X, X)
        found.append(e @ np.linalg.solve(result.covariance, e))
        pixels.append([result.noise_estimate[name].size for name in (shift, usual)])
    low, high = stats.chi2.interval(CONFIDENCE, 6 * 12)
    assert low < np.sum(found) < high
    assert np.median(pixels, axis=0) == pytest.approx([0.025, 0.008], rel=0.3)
    assert not [one for one in result.findings if one.code == "noise_estimation.camera_excess"]  # as usual
    result = uq.calibrate(poses_of(shifted(corners, rng, 0.3), robot), prior=exact, shared=[])
    said = [one for one in result.findings if one.code == "noise_estimation.camera_excess"]
    assert said[0].severity == "caution" and "the corners of one picture share errors" in str(said[0])
    again = uq.Calibration.from_dict(json.loads(result.to_json()))
    assert again.noise_estimate.to_dict() == result.noise_estimate.to_dict()
    assert not result.noise_estimate.tested and result.fit.p_value is None


@pytest.mark.slow
def test_a_known_robot_asks_for_nothing_where_corners_are_independent():
    """A component more costs little: the covariance stays what it is."""
    known = uq.NoisePrior(robot=(5e-5, 2e-5), factor=1)
    growth = []
    for k in range(12):
        corners, robot, _ = recorded(np.random.default_rng([SEED, 32, k]))
        poses = poses_of(corners, robot)
        result = uq.calibrate(poses, prior=known, shared=[])
        plain = efficient(poses, uq.PoseNoise(ROBOT, poses.camera_calibration.covariance))
        growth.append(np.trace(np.linalg.solve(plain.covariance_X, result.covariance)) / 6)
    assert 0.95 < np.mean(growth) < 1.2
