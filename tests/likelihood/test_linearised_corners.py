"""Corners linearised again at the estimate of X, against least squares of the corners over everything at once."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from support import assert_same_covariance, difference, moved

import uq_handeye as uq
from studies.camera_covariance import ROBOT, SIZE, adjusted_at_once, poses_of, recorded
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.model.camera.adjustment.bundle import poses_only
from uq_handeye.model.camera.adjustment.linearised import linearised, with_pictures
from uq_handeye.model.camera.calibrate import calibrate_camera

pytestmark = pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")


def rig(rng, n=12, model="pinhole", setup="eye-in-hand", pixel=0.2):
    corners, measured, X = recorded(rng, n, model=model, setup=setup, pixel=pixel)
    return poses_of(corners, measured, model, setup), X


def distance(xi, covariance):
    return float(np.sqrt(xi @ np.linalg.solve(covariance, xi)))


def at_the_pictures(poses):
    return efficient(poses, uq.PoseNoise(ROBOT, poses.camera_calibration.covariance))


def test_at_their_own_minimum_nothing_changes(rng):
    seen = rig(rng)[0].camera_calibration
    bundle = seen.bundle
    again = linearised(bundle, seen.corners, np.array(bundle.parameters), bundle.poses)
    np.testing.assert_allclose(again.poses, bundle.poses, atol=1e-7)
    np.testing.assert_allclose(again.own, bundle.own, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(again.by_parameters, bundle.by_parameters, rtol=1e-6, atol=1e-9)


def test_the_measured_pose_is_that_of_the_pictures_wherever_it_is_linearised(rng):
    """About other intrinsics and poses the minimum at the pictures' intrinsics is met to second order."""
    seen = rig(rng, pixel=1e-3)[0].camera_calibration
    bundle, step, off = seen.bundle, np.array([1.0, 1.0, 0.5, -0.5]), []  # fx, fy, cx, cy in pixels
    for factor in (8.0, 4.0):
        parameters = np.array(bundle.parameters)
        parameters[bundle.free] += factor * step
        other = replace(bundle, parameters=parameters)
        poses = poses_only(other, seen.corners, bundle.poses, bundle.used, bundle.weights).poses
        again = linearised(bundle, seen.corners, parameters, poses)
        off.append(np.linalg.norm(difference(again.poses, bundle.poses)))
        first = np.linalg.norm(difference(poses, bundle.poses))
        assert off[-1] < 0.1 * first
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.3)


def test_the_pictures_of_a_part(rng):
    seen = rig(rng)[0].camera_calibration
    rows = np.array([1, 4, 7])
    part = seen.select(rows).bundle
    moved_part = replace(part, poses=moved(part.poses, np.tile([1e-3, 0, 0, 0, 0, 1e-3], (3, 1))), own=2.0 * part.own)
    whole = with_pictures(seen.bundle, seen.corners, rows, moved_part)
    np.testing.assert_array_equal(whole.poses[rows], moved_part.poses)
    np.testing.assert_array_equal(whole.own[[0, 4]], [seen.bundle.own[0], moved_part.own[1]])
    np.testing.assert_array_equal(whole.residuals, seen.bundle.residuals)
    np.testing.assert_array_equal(np.delete(whole.poses, rows, axis=0), np.delete(seen.bundle.poses, rows, axis=0))


@pytest.mark.slow
@pytest.mark.parametrize(("setup", "seed"), [("eye-in-hand", 1), ("eye-to-hand", 1), ("eye-to-hand", 3)])
def test_x_is_that_of_everything_at_once(setup, seed):
    """A pixel of noise: about the minimum of the pictures X is 0.1 to 0.4 standard deviations off, now below 0.06."""
    poses, _ = rig(np.random.default_rng(seed), setup=setup, pixel=1.0)
    before = at_the_pictures(poses)
    found = uq.calibrate(poses, noise=uq.PoseNoise(ROBOT), robust=False)
    X, covariance = adjusted_at_once(poses, ROBOT, before)
    assert distance(difference(found.X, X), covariance) < 0.06 < distance(difference(before.X, X), covariance)
    assert_same_covariance(found.covariance, covariance, 0.05)


@pytest.mark.slow
def test_the_joint_covariance_is_that_of_everything_to_first_order(rng):
    poses, _ = rig(rng, 15, "brown")
    fit = at_the_pictures(poses)
    X, covariance = adjusted_at_once(poses, ROBOT, fit)
    assert distance(difference(X, fit.X), covariance) < 0.1
    assert_same_covariance(covariance, fit.covariance_X, 0.05)


@pytest.mark.slow
def test_excluded_poses_stay_as_the_pictures_have_them():
    poses, X = rig(np.random.default_rng(3), setup="eye-to-hand", pixel=1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        found = uq.calibrate(poses, noise=uq.PoseNoise(ROBOT), exclude=[2, 5])
    before, after = poses.camera_calibration.bundle, found.data.camera_calibration.bundle
    np.testing.assert_array_equal(after.poses[[2, 5]], before.poses[[2, 5]])
    assert (after.poses[3] != before.poses[3]).any()
    np.testing.assert_array_equal(after.parameters, before.parameters)
    xi = difference(found.X, X)
    assert xi @ np.linalg.solve(found.covariance, xi) < 22.5


@pytest.mark.slow
def test_known_intrinsics_are_kept(rng):
    corners, robot, _ = recorded(rng, 12, pixel=1.0)
    k = poses_of(corners, robot).camera_calibration.intrinsics
    fixed = {name: (k[name], 0.0) for name in ("cx", "cy")} | {name: (k[name], 1e-3) for name in ("fx", "fy")}
    seen = calibrate_camera(corners, SIZE, "pinhole", intrinsics=fixed)
    poses = uq.PosePairs(robot, seen.poses, camera_calibration=seen)
    found = uq.calibrate(poses, noise=uq.PoseNoise(ROBOT), robust=False)
    np.testing.assert_array_equal(found.data.camera_calibration.bundle.parameters, seen.bundle.parameters)
    fit = at_the_pictures(poses)
    assert_same_covariance(found.covariance, fit.covariance_X, 0.1)
