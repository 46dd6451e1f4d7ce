"""Deviations of an arm's errors and of the noise beside them, from the residuals."""

import numpy as np
import pytest
from rig_of_arm import ARM, CAMERA, GEOMETRY, JOINT_NOISE, rig

import uq_handeye as uq
from uq_handeye.kinematics.kinematic_errors import DECLARED_AS, JOINT_NOISE_FACTOR, POPULATIONS
from uq_handeye.likelihood.gauss_helmert import efficient

pytestmark = pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")

SD = {"offset_sd": 5e-4, "tilt_sd": 5e-4, "length_sd": 3e-4}


def estimated(found, errors=None, **options):
    options = {"shared": [], "correlation": "none"} | options
    return uq.calibrate(found.poses, kinematics=ARM, kinematic_errors=errors, **options)


def test_declared_errors_beside_known_noise_are_those_of_the_joint_covariance(rng):
    """Two ways to one answer: the arm as an argument, and its covariance as noise."""
    found = rig(rng)
    noise = uq.PoseNoise.isotropic(robot=("0.01deg", "0.05mm"), camera=CAMERA)
    errors = uq.KinematicErrors("declared", joint_sd=JOINT_NOISE, **SD)
    result = estimated(found, errors, noise=noise, robust=False)
    S = ARM.covariance(found.poses.joints, JOINT_NOISE, 5e-4, 3e-4)
    beside = uq.PoseNoise(S.plus(np.broadcast_to(noise.robot, (found.poses.n, 6, 6))), noise.camera)
    fit = efficient(found.poses, beside)
    np.testing.assert_allclose(result.X, fit.X, atol=2e-6)  # derived at the estimate of the errors
    ratio = np.linalg.eigvals(np.linalg.solve(fit.covariance_X, result.covariance)).real
    assert (np.abs(ratio - 1) < 0.02).all()


def test_many_poses_from_everywhere_tell_the_deviations(rng):
    sd = GEOMETRY | {"transmission": 4e-4, "sag": 1e-3}
    found = rig(rng, n=150, spread=1.5, sd=sd)
    population = {DECLARED_AS[group]: value / 4 for group, value in sd.items()}
    result = estimated(found, uq.KinematicErrors(**population))
    parts = {part.name: part for part in result.noise_estimate.components}
    for name, true in (("camera rotation", CAMERA[0]), ("camera translation", CAMERA[1]), ("joint noise", JOINT_NOISE)):
        assert 0.8 * parts[name].low < true < 1.25 * parts[name].high
    for group, true in sd.items():
        assert parts[group].low < 2 * true and true < 2 * parts[group].high
        assert parts[group].value > 1.3 * true / 4  # the least is not what is found
    # the estimates of e are those that were drawn
    fitted, told = result.kinematics, []
    for k in fitted.kept:
        told.append((fitted.e[k] - found.e[k]) / np.sqrt(fitted.covariance[k, k]))
    # columns of neighbouring joints have turns and shifts in common, and the base and flange took a part of each
    assert np.sqrt(np.mean(np.square(told))) < 3


def test_a_local_set_does_not_make_the_arm_better_than_its_population(rng):
    """A few poses see next to nothing of the arm; the likelihood alone would have it exact."""
    found = rig(rng, n=10, spread=0.15)
    result = estimated(found)
    least = POPULATIONS["industrial"]
    for group, name in DECLARED_AS.items():
        assert result.kinematics.sd[group] >= getattr(least, name)
    part = result.noise_estimate["joint noise"]
    assert least.joint_sd / JOINT_NOISE_FACTOR**2 < part.value < least.joint_sd * JOINT_NOISE_FACTOR**2


def test_classes_differ_and_declared_ones_are_taken_as_they_are(rng):
    found = rig(rng, n=10)
    hobby = estimated(found, uq.KinematicErrors("declared", robot_class="hobby"))
    assert hobby.kinematics.sd["joint offsets"] == pytest.approx(POPULATIONS["hobby"].offset_sd)
    alone = estimated(found, uq.KinematicErrors("declared", **SD))
    assert alone.kinematics.sd["sag"] == 0
    assert {error.error for error in alone.shared} == set(GEOMETRY)
    exact = estimated(found, uq.KinematicErrors("exact"))
    assert exact.kinematics.kept.size == 0
    np.testing.assert_allclose(exact.X, uq.calibrate(found.poses, shared=[], correlation="none").X, atol=1e-12)


def test_a_wrong_pose_is_left_out(rng):
    found = rig(rng, n=20)
    camera = found.poses.camera.copy()
    camera[7, :3, 3] += [0.02, -0.03, 0.01]
    poses = uq.PosePairs(found.poses.robot, camera, joints=found.poses.joints)
    result = estimated(found._replace(poses=poses))
    assert list(result.table.rejected) == [7]


@pytest.mark.parametrize("camera", ["given", "geometry"])
def test_a_known_camera_leaves_the_noise_of_the_robot(rng, camera):
    """A covariance of its own, or but for its pixels: the robot's pose noise is found beside that of its joints."""
    found = rig(rng, n=25)
    if camera == "given":
        result = estimated(found, noise=uq.PoseNoise.isotropic(camera=CAMERA))
        assert result.noise_estimate["camera rotation"].status == "given"
    else:
        points = uq.Board(9, 6, "20mm").points
        noise = uq.camera_noise(found.poses, points, (900, 900, 640, 480), intrinsics="exact")
        result = estimated(found, noise=noise)
        assert 0.01 < result.noise_estimate["pixel noise"].value < 2
        assert "robot translation" in [part.name for part in result.noise_estimate.components]
    assert np.isfinite(result.covariance).all()
    assert result.predict_camera(joints=found.near).covariance.shape == (len(found.near), 6, 6)


def test_large_errors_are_derived_at_their_estimate(rng, monkeypatch):
    """20 mrad at 0.5 m: the second order is 0.1 mm, more than what is known of X otherwise."""
    found = rig(rng, n=60, spread=1.2, sd={"joint offsets": 20e-3}, camera=(5e-5, 2e-5), joint_noise=2e-5)
    errors = uq.KinematicErrors(robot_class="cobot")

    def off():
        seen = estimated(found, errors).predict_camera(joints=found.near, new_measurement=False)
        return np.sqrt(np.mean((seen.poses[:, :3, 3] - found.seen(found.near)[:, :3, 3]) ** 2))

    at_the_estimate = off()
    monkeypatch.setattr("uq_handeye.calibration.calibrate.LINEARISED", 0)
    assert at_the_estimate < 1e-4
    assert at_the_estimate < 0.5 * off()
