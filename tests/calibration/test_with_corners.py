"""calibrate() on camera poses from corners: their joint covariance, the robot's noise, texts and files."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from support import assert_same_covariance, moved

import uq_handeye as uq
from studies.camera_covariance import ROBOT, error, poses_of, recorded
from uq_handeye.errors import InputError
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.fit.graph.goodness_of_fit import goodness_of_fit
from uq_handeye.fit.graph.noise_of_data import estimate_robot_noise
from uq_handeye.model.errors.error_estimate import IN_NOISE
from uq_handeye.model.errors.joint_covariance import JointCovariance
from uq_handeye.model.errors.keys import CAMERA_EXCESS, PICTURE_SHIFT, TARGET_SCALE
from uq_handeye.model.errors.models import marginals
from uq_handeye.model.errors.sizes import NoisePrior


def calibrate(poses, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.calibrate(poses, **options)


@pytest.fixture(scope="module")
def recording():
    corners, robot, X = recorded(np.random.default_rng(11))
    return poses_of(corners, robot), X


@pytest.fixture(scope="module")
def result(recording):
    return calibrate(recording[0])


def test_nothing_but_poses_from_corners(recording, result):
    poses, X = recording
    assert result.method == "efficient" and isinstance(result.noise.camera, JointCovariance)
    of_corners = result.data.camera_calibration.covariance.shared  # beside them the size of the target is in doubt
    np.testing.assert_array_equal(result.noise.camera.shared[..., : of_corners.shape[-1]], of_corners)
    keys = result.noise.camera.keys[of_corners.shape[-1] :]
    assert [key for key in keys if key.error != CAMERA_EXCESS] == [TARGET_SCALE]
    found = result.noise_estimate
    assert found.from_corners and found["camera rotation"].status == "from corners"
    tiny = {str(CAMERA_EXCESS): "1e-6px", str(PICTURE_SHIFT): "1e-6px"}
    plain = calibrate(poses, shared=[], correlation="none", sizes=tiny)
    beside = calibrate(poses, shared=[], correlation="none")
    alone = estimate_robot_noise(plain.data, plain.data.camera_calibration.covariance, start=plain.X)
    for name in ("robot rotation", "robot translation"):  # the same model, but for what corners of a picture share
        assert plain.noise_estimate[name].size == pytest.approx(alone[name].size, rel=1e-2)
        assert beside.noise_estimate[name].low < alone[name].size < beside.noise_estimate[name].high
    assert result.reference.kind == "t" and np.isfinite(result.reference.dof)
    off = error(result.X, X)
    assert off @ np.linalg.solve(result.covariance, off) < result.quantile(0.9999)
    text = result.summary(verbose=True)
    assert "known from its corners" in text and "come" in text
    assert "Not included: camera model" in text and "camera intrinsics" not in text


@pytest.mark.slow
def test_noise_of_the_robot_alone_is_completed(recording):
    poses, _ = recording
    S = poses.camera_calibration.covariance
    found = calibrate(poses, noise=uq.PoseNoise(ROBOT))
    expected = calibrate(poses, noise=uq.PoseNoise(ROBOT, S))
    assert_same_covariance(found.covariance, expected.covariance, 0.05)  # whose corners are not linearised again
    assert found.noise_estimate is None and "correlated over the poses" in found.summary(verbose=True)
    given = calibrate(poses, noise=uq.PoseNoise(ROBOT, marginals(S)))  # as given
    assert given.noise.camera.shape == (poses.n, 6, 6)
    motions = uq.relative_motions(poses, "all")
    np.testing.assert_allclose(
        calibrate(motions, noise=uq.PoseNoise(ROBOT), method="park").X, calibrate(poses, method="park").X
    )


@pytest.mark.slow
def test_a_data_sheet_of_the_robot(recording):
    found = calibrate(recording[0], prior=NoisePrior(robot=("0.003deg", "0.02mm"), factor=1)).noise_estimate
    assert found["robot rotation"].status == "fixed"
    excess = found["camera beyond its corners"]
    assert excess.unit == "px" and found.tested == (excess.size == 0)
    with pytest.raises(InputError, match="for the robot only"):
        calibrate(recording[0], prior=NoisePrior(camera=("0.1deg", None)))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["4dpa", "park", "li"])
def test_other_methods_get_the_covariance_of_the_same_noise(recording, result, method):
    found = calibrate(recording[0], method=method)
    assert isinstance(found.noise.camera, JointCovariance)
    assert (
        np.linalg.eigvals(np.linalg.solve(result.covariance, found.covariance)).real.min() > 0.9
    )  # not below the bound


@pytest.mark.slow
def test_a_wrong_robot_row_is_found(rng):
    corners, robot, X = recorded(rng)
    robot = robot.copy()
    robot[7] = moved(robot[7], np.array([0, 0.05, 0, 0.02, 0, 0]))
    poses = poses_of(corners, robot)
    found = calibrate(poses)
    assert found.table.flag[7] == "rejected" and [k for k, w in enumerate(found.table.weight) if w == 0] == [7]
    off = error(found.X, X)
    assert off @ np.linalg.solve(found.covariance, off) < found.quantile(0.9999)
    good = calibrate(poses.rows(np.arange(20) != 7))
    assert_same_covariance(calibrate(poses).covariance, good.covariance, 0.5)


@pytest.mark.slow
def test_a_half_turned_board_is_found(rng):
    """Points of one picture numbered from the other corner: the camera is right, that pose is not."""
    corners, robot, X = recorded(rng)
    points = corners.points.copy()
    turned = corners.row == 3
    points[turned] = points.max(axis=0) - points[turned]
    poses = poses_of(replace(corners, points=points), robot)
    found = calibrate(poses)
    assert found.table.flag[3] == "rejected"
    off = error(found.X, X)
    assert off @ np.linalg.solve(found.covariance, off) < found.quantile(0.9999)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["efficient", "ml"])
def test_files_and_reports(recording, tmp_path, method, without_rendering):
    found = calibrate(recording[0], method=method)
    found.to_json(tmp_path / "x.json")
    again = uq.Calibration.from_json(tmp_path / "x.json")
    assert again.summary(verbose=True) == found.summary(verbose=True) and again.to_dict() == found.to_dict()
    np.testing.assert_array_equal(again.noise_estimate.noise.camera.own, found.noise.camera.own)
    found.report(tmp_path / "x.html", comparison=False)
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    assert "from corners" in text and "camera model" in text
    damaged = json.loads((tmp_path / "x.json").read_text())
    del damaged["noise"]["camera"]["own"]
    with pytest.raises(InputError, match="damaged"):
        uq.Calibration.from_dict(damaged)


@pytest.mark.slow
def test_analysis_works_with_it(result):
    assert result.diagnostics.n == 20
    assert [probe.status == IN_NOISE for probe in result.diagnostics.probes] == [
        True,
        True,
        False,
    ]  # its target scale is in doubt
    assert result.split_half.possible and 1e-4 < result.split_half.p_value <= 1
    assert result.covariances["model"] is not None and result.covariances["sandwich"] is not None
    np.testing.assert_allclose(result.budget.covariances.sum(axis=0)[:6, :6], result.covariance, rtol=1e-6, atol=1e-18)
    assert result.fit.rotation_sigma0 == pytest.approx(1, abs=0.5) and result.fit.translation_sigma0 == pytest.approx(
        1, abs=0.5
    )


@pytest.mark.slow
def test_parts_of_the_fit_are_1_where_the_noise_is_right(rng):
    """Mean and spread over many sets, also of residuals that the shared error makes all alike."""
    exact = uq.simulate(20, seed=4)
    own = np.diag([1e-4] * 3 + [1e-4] * 3) ** 2
    S = JointCovariance(np.tile(own, (20, 1, 1)), 5e-3 * rng.normal(size=(20, 6, 3)))
    from uq_handeye.trials.simulation.rig import disturbed

    parts = []
    for _ in range(60):
        poses = uq.PosePairs(disturbed(exact.robot, ROBOT, (), rng), disturbed(exact.camera, S, (), rng))
        fit = goodness_of_fit(efficient(poses, uq.PoseNoise(ROBOT, S)))
        parts.append([fit.rotation_sigma0**2, fit.translation_sigma0**2])
    assert (np.abs(np.mean(parts, axis=0) - 1) < 3.3 * np.std(parts, axis=0) / np.sqrt(60)).all()
    assert (np.std(parts, axis=0) < 0.35).all()


@pytest.mark.slow
def test_residuals_that_contradict_the_corners_are_said(recording):
    """Corners four times better than they are, as the calibration believes: the residuals say so."""
    poses, _ = recording
    seen = poses.camera_calibration
    of = seen.bundle
    bundle = replace(of, own=16.0 * of.own, covariance=16.0 * of.covariance, pixel_noise=4.0 * of.pixel_noise)
    wide = uq.PosePairs(poses.robot, seen.poses, camera_calibration=replace(seen, bundle=bundle))
    found = calibrate(wide)
    assert any("contradict the camera's covariance" in text for text in found.warnings)
    assert not any("contradict the camera's covariance" in text for text in calibrate(poses).warnings)
