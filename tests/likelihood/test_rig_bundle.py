"""Bundle adjustment of everything on the corners, and that the joint covariance is the same to first order."""

import os
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares
from support import assert_same_covariance, difference, moved, whitened_eigenvalues

import uq_handeye as uq
from studies.camera_covariance import ROBOT, SIZE, poses_of, recorded
from uq_handeye.errors import InputError
from uq_handeye.fit.likelihood.constraint import Unknowns
from uq_handeye.fit.likelihood.gauss_helmert import efficient
from uq_handeye.fit.likelihood.rig_bundle import Agreement, adjust_rig
from uq_handeye.fit.likelihood.robust import robust_fit
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.corners import Corners

needs_data = pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")


def rig(rng, n=12, model="pinhole", setup="eye-in-hand", robot=ROBOT):
    corners, measured, X = recorded(rng, n, model=model, setup=setup, robot=robot)
    return poses_of(corners, measured, model, setup), X


def joint_fit(poses, robot):
    return efficient(poses, uq.PoseNoise(robot, poses.camera_calibration.covariance))


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("robot", [ROBOT, None], ids=["noisy robot", "exact robot"])
@pytest.mark.parametrize("model", ["pinhole", "brown"])
def test_the_joint_covariance_is_the_bundle_to_first_order(rng, model, robot, setup):
    poses, X = rig(rng, 15, model, setup, robot)
    fit = joint_fit(poses, robot)
    bundle = adjust_rig(poses, robot, fit.unknowns)
    off = difference(bundle.X, fit.X)
    assert off @ np.linalg.solve(fit.covariance_X, off) < 0.1**2
    assert_same_covariance(bundle.covariance_X, fit.covariance_X, 0.05)
    assert_same_covariance(bundle.covariance_W, fit.covariance_W, 0.05)
    error = difference(bundle.X, X)
    assert error @ np.linalg.solve(bundle.covariance_X, error) < 27.9  # 99.99 %
    low, high = bundle.dof + np.array([-4, 4]) * np.sqrt(2 * bundle.dof)
    assert low < bundle.chi2 < high


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The target would sit")
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_errors_that_all_robot_poses_share_are_unknowns(rng, setup):
    """The robot's scale, 0.5 % off: found, and X as `efficient` with the same joint noise has it."""
    poses, X = rig(rng, 15, setup=setup)
    longer = poses.robot.copy()
    longer[:, :3, 3] *= 1.005
    poses = replace(poses, robot=longer)
    scale = uq.SharedError.robot_scale(0.01)
    F = scale.at(poses) * 0.01
    robot = uq.JointCovariance(np.tile(ROBOT, (poses.n, 1, 1)), F)
    fit = joint_fit(poses, robot)
    bundle = adjust_rig(poses, robot, fit.unknowns)
    off = difference(bundle.X, fit.X)
    assert off @ np.linalg.solve(fit.covariance_X, off) < 0.15**2
    assert_same_covariance(bundle.covariance_X, fit.covariance_X, 0.05)
    error = difference(bundle.X, X)
    assert error @ np.linalg.solve(bundle.covariance_X, error) < 27.9  # 99.99 %
    without = difference(adjust_rig(poses, ROBOT, fit.unknowns).X, X)
    assert without @ np.linalg.solve(bundle.covariance_X, without) > 100
    assert len(bundle.covariance) == 12 + poses.camera_calibration.bundle.free.sum() + 1
    found = uq.calibrate(poses, method="bundle", noise=uq.PoseNoise(robot), robust=False)
    np.testing.assert_allclose(found.agreement.eigenvalues, 1, atol=0.05)


@pytest.mark.slow
def test_it_is_the_minimum_over_everything_at_once(rng):
    """The same objective, written down once more and minimised over all unknowns without eliminating any."""
    n = 6
    poses, _ = rig(rng, n)
    seen = poses.camera_calibration
    fit = joint_fit(poses, ROBOT)
    bundle = adjust_rig(poses, ROBOT, fit.unknowns)
    sd = np.sqrt(np.diag(ROBOT))

    def residuals(x):
        X, W = moved(fit.X, x[:6]), moved(fit.W, x[6:12])
        f, c = x[12:14] * seen.bundle.parameters[:2], x[14:16]
        u = x[16:].reshape(n, 6)
        C = np.linalg.inv(moved(poses.robot, -u * sd) @ X) @ W
        at = (C[seen.corners.picture, :3, :3] @ seen.corners.points[..., None])[..., 0]
        at = at + C[seen.corners.picture, :3, 3]
        pixels = f * at[:, :2] / at[:, 2:] + c
        noise = seen.bundle.picture_noise[seen.corners.picture]
        return np.concatenate([((pixels - seen.corners.pixels) / noise[:, None]).ravel(), u.ravel()])

    start = np.concatenate([np.zeros(12), [1, 1], seen.bundle.parameters[2:4], np.zeros(6 * n)])
    found = least_squares(residuals, start, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-12)
    assert 2 * found.cost == pytest.approx(bundle.chi2, rel=1e-8)
    unit = np.linalg.norm(found.jac, axis=0)
    covariance = np.linalg.inv(found.jac.T @ found.jac / np.outer(unit, unit)) / np.outer(unit, unit)
    off = difference(bundle.X, moved(fit.X, found.x[:6])) / np.sqrt(np.diag(bundle.covariance_X))
    assert np.abs(off).max() < 1e-3
    assert_same_covariance(bundle.covariance_X, covariance[:6, :6], 1e-3)
    np.testing.assert_allclose(bundle.robot, moved(poses.robot, -found.x[16:].reshape(n, 6) * sd), atol=1e-7)
    np.testing.assert_allclose(bundle.parameters[:2], found.x[12:14] * seen.bundle.parameters[:2], rtol=1e-6)


@pytest.mark.slow
def test_a_wrong_robot_pose_is_left_out(rng):
    """The result is as without that pose, but its corners still inform the intrinsics."""
    corners, robot, X = recorded(rng, 15)
    robot = robot.copy()
    robot[4] = moved(robot[4], np.array([0.1, 0, 0, 0.05, 0, 0]))
    poses = poses_of(corners, robot)
    noise = uq.PoseNoise(ROBOT, poses.camera_calibration.covariance)
    found = robust_fit(poses, noise)
    assert found.rejected.tolist() == [4]
    bundle = adjust_rig(poses, ROBOT, found.fit.unknowns, found.weights)
    error = difference(bundle.X, X)
    assert error @ np.linalg.solve(bundle.covariance_X, error) < 27.9
    off = difference(bundle.X, found.fit.X)
    assert off @ np.linalg.solve(found.fit.covariance_X, off) < 0.1**2
    assert_same_covariance(bundle.covariance_X, found.fit.covariance_X, 0.05)
    assert bundle.dof == adjust_rig(poses, ROBOT, found.fit.unknowns).dof - 6


@pytest.mark.slow
def test_known_intrinsics_are_kept(rng):
    corners, robot, _ = recorded(rng, 12)
    free = poses_of(corners, robot).camera_calibration
    k = free.intrinsics
    fixed = {name: (k[name], 0.0) for name in ("cx", "cy")} | {name: (k[name], 1e-3) for name in ("fx", "fy")}
    seen = calibrate_camera(corners, SIZE, "pinhole", intrinsics=fixed)
    poses = uq.PosePairs(robot, seen.poses, camera_calibration=seen)
    fit = joint_fit(poses, ROBOT)
    bundle = adjust_rig(poses, ROBOT, fit.unknowns)
    assert bundle.covariance.shape == (14, 14)
    np.testing.assert_allclose(np.sqrt(np.diag(bundle.covariance)[12:]), 1e-3, rtol=0.02)
    np.testing.assert_allclose(bundle.parameters[:2], [k["fx"], k["fy"]], atol=1e-2)
    np.testing.assert_array_equal(bundle.parameters[2:], [k["cx"], k["cy"]])
    assert_same_covariance(bundle.covariance_X, fit.covariance_X, 0.03)


def test_agreement(rng):
    covariance = np.diag([1.0, 4, 9, 1, 1, 1]) * 1e-8
    X0 = np.eye(4)
    X = moved(X0, np.array([1e-4, 0, 0, 0, 0, 2e-4]))
    other = covariance.copy()
    other[1, 1] *= 1.2
    found = Agreement.of(X, other, X0, covariance)
    assert found.distance == pytest.approx(np.sqrt(5), rel=1e-6)
    np.testing.assert_allclose(found.by_component, [1, 0, 0, 0, 0, 2], atol=1e-6)
    np.testing.assert_allclose(found.eigenvalues, np.sort(whitened_eigenvalues(other, covariance)), rtol=1e-9)
    assert "2.2 standard deviations" in found.sentence and "1.000 to 1.200 times" in found.sentence
    assert Agreement.from_dict(found.to_dict()).to_dict() == found.to_dict()
    with pytest.raises(InputError, match=r"shape \(6,\)"):
        Agreement.from_dict(found.to_dict() | {"eigenvalues": [1.0]})


def test_what_makes_no_sense_is_refused(rng):
    poses, _ = rig(rng, 6)
    at = Unknowns(np.eye(4), np.eye(4))
    with pytest.raises(InputError, match="with a `camera_calibration`"):
        adjust_rig(uq.PosePairs(poses.robot, poses.camera), ROBOT, at)
    with pytest.raises(InputError, match="joint covariance"):
        adjust_rig(poses, np.eye(36), at)
    with pytest.raises(InputError, match="cover 6 poses, got 5"):
        adjust_rig(poses, np.tile(ROBOT, (5, 1, 1)), at)


@pytest.mark.slow
@needs_data
@pytest.mark.parametrize("name", ["synthetic_camera_2", "kuka_1"])
def test_on_recorded_corners(name):
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / name
    table = pd.read_csv(folder / "corners.csv")
    size = (1920, 1080) if name == "synthetic_camera_2" else (1928, 1208)
    model = "pinhole" if name == "synthetic_camera_2" else "brown"
    corners = Corners(table.row.to_numpy(), table[["x", "y", "z"]].to_numpy(), table[["u", "v"]].to_numpy())
    seen = calibrate_camera(corners, size, model)
    robot = uq.read_poses(folder / "robot.csv", folder / "camera.csv").robot
    poses = uq.PosePairs(robot, seen.poses, camera_calibration=seen)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        result = uq.calibrate(poses, method="bundle")
        known = uq.calibrate(poses, method="bundle", noise=uq.PoseNoise(robot=result.noise.robot))
    # By the same noise they are one estimate: 0.007 and 0.011 deviations apart.
    assert known.agreement.distance < 0.05
    np.testing.assert_allclose(known.agreement.eigenvalues, 1.0, atol=0.01)
    # Where the noise is estimated, `efficient` counts what corners of a picture share (0.01 px, and 0.23 px of kuka_1),
    # which the bundle takes as independent from corner to corner.
    assert result.agreement.distance < {"synthetic_camera_2": 0.05, "kuka_1": 0.3}[name]
    np.testing.assert_allclose(result.agreement.eigenvalues, 1.0, atol=0.05)
    if name == "synthetic_camera_2":
        error = difference(result.X, np.diag([1.0, -1, -1, 1]))
        assert np.linalg.norm(error[3:]) < 0.15e-3
        assert error @ np.linalg.solve(result.covariance, error) < 12.6
