"""Predictions at other joints: whether their covariance is true, and what they refuse."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fixtures.arms import SIX_AXES, motion
from fixtures.pictures import camera_to_board, seen_corners
from fixtures.rigs import quietly
from fixtures.rigs_on_arms import ARM, CAMERA, CENTRE, GEOMETRY, JOINT_NOISE, rig, squares
from scipy.spatial.transform import RigidTransform

import uq_handeye as uq
from studies.one_model.rigs import arm_set
from uq_handeye.core.geometry.se3 import inverse, logarithm
from uq_handeye.errors import InputError

DECLARED = uq.KinematicErrors(
    "declared",
    offset_sd=GEOMETRY["joint offsets"],
    tilt_sd=GEOMETRY["joint tilts"],
    length_sd=GEOMETRY["link lengths"],
    joint_sd=JOINT_NOISE,
)
NOISE = uq.PoseNoise.isotropic(camera=CAMERA)
WITHIN_95 = 12.592

# some of so many draws look odd, and say so
pytestmark = pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")


def calibrated(found, errors=DECLARED, **options):
    return uq.calibrate(
        found.poses, noise=NOISE, kinematics=ARM, kinematic_errors=errors, robust=False, shared=[], **options
    )


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_predicted_camera_poses_are_as_uncertain_as_stated(rng, setup):
    draws, near, far, wrong = 40, [], [], []
    for k in range(draws):
        found = rig(rng, setup)
        result = calibrated(found)
        for joints, into in ((found.near, near), (found.far, far)):
            into.append(squares(result.predict_camera(joints=joints, new_measurement=False), found.seen(joints)))
        if k < 20:
            plain = uq.calibrate(found.poses, noise=NOISE, robust=False, shared=[])
            prediction = plain.predict_camera(robot=ARM.poses(found.far), new_measurement=False)
            wrong.append(squares(prediction, found.seen(found.far)))
    # one arm a draw: its predictions share their errors, so that a draw counts once
    for d2 in (near, far):
        of_draw = np.mean(d2, axis=1) / 6
        assert abs(of_draw.mean() - 1) < 4 * of_draw.std() / np.sqrt(draws)
        inside = (np.array(d2) < WITHIN_95).mean(axis=1)
        assert abs(inside.mean() - 0.95) < 4 * inside.std() / np.sqrt(draws) + 0.01
    assert np.mean(wrong) / 6 > 3  # without the arm the same test fails


@pytest.mark.slow
def test_the_physical_flange_needs_the_columns_of_its_frames(rng):
    def square(result, X):
        off = np.concatenate([logarithm(result.X[:3, :3] @ X[:3, :3].T), result.X[:3, 3] - X[:3, 3]])
        return off @ np.linalg.solve(result.covariance, off)

    physical = replace(DECLARED, flange="physical")
    draws = 60
    rigs = [rig(rng) for _ in range(draws)]
    nees = np.array([square(calibrated(found, physical), found.X) for found in rigs])
    assert abs(nees.mean() - 6) < 4 * np.sqrt(12 / draws)
    assert np.mean([square(calibrated(found), found.X) for found in rigs[:20]]) > 9


def test_a_new_measurement_adds_joint_and_camera_noise(rng):
    found = rig(rng)
    result = calibrated(found)
    at = {"joints": found.near}
    mean, new = (result.predict_camera(**at, new_measurement=wanted).covariance for wanted in (False, True))
    more = np.linalg.eigvalsh(new - mean)
    assert (more > 0).all()
    # the camera's own noise is all but the joints' share
    assert (np.diagonal(new - mean, axis1=-2, axis2=-1) > np.repeat(np.square(CAMERA), 3)).all()


def test_points_agree_with_the_camera_poses(rng):
    """A point of the target, seen where the camera should see it, lies where W puts it; and as uncertain as that is."""
    found = rig(rng)
    result = calibrated(found)
    seen = result.predict_camera(joints=found.far, new_measurement=False)
    points = result.predict(seen.poses[:, :3, 3], found.far)
    np.testing.assert_allclose(points.points, np.broadcast_to(result.W[:3, 3], points.points.shape), atol=1e-12)


def test_without_an_arm_predictions_go_by_robot_poses(rng):
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.05deg", "0.2mm"))
    poses = uq.simulate(n_poses=25, noise=noise, seed=int(rng.integers(1000)))
    result = uq.calibrate(poses, noise=noise)
    seen = result.predict_camera(robot=poses.robot)
    nominal = inverse(result.X) @ inverse(poses.robot) @ result.W
    np.testing.assert_allclose(seen.poses, nominal, atol=1e-12)
    for given in (poses.robot, poses.robot.tolist(), RigidTransform.from_matrix(poses.robot)):
        np.testing.assert_allclose(result.predict_camera(given).poses, seen.poses, atol=1e-12)
    with pytest.raises(InputError, match="once"):
        result.predict_camera(poses.robot, robot=poses.robot)
    with pytest.raises(InputError, match="got PosePairs"):
        result.predict_camera(poses)
    with pytest.raises(InputError, match="knows no joints"):
        result.predict_camera(joints=np.zeros(6))
    with pytest.raises(InputError, match=r"predict_camera\(joints=q\)"):
        result.predict_camera(np.zeros(6))


@pytest.mark.slow
def test_a_new_measurement_shares_the_intrinsics_of_the_calibration(rng):
    """Poses by the estimated intrinsics err with them as X does: taken as independent d^2 is 5 times too large."""
    board, size, draws = uq.Board(9, 6, 0.03), (900, 900), 14
    robot = uq.PoseNoise.isotropic(robot=("0.01deg", "0.02mm"))
    squared, stored = [], []
    for k in range(draws):
        poses = uq.simulate(n_poses=30, noise=robot, seed=k)
        rows, points, pixels = seen_corners(board.points, camera_to_board(poses.truth.camera, board), rng, noise=0.3)
        first = rows < 12
        options = {"model": "pinhole", "shape": "flat"}
        camera, new = (
            uq.Corners(rows[of] - rows[of][0], points[of], pixels[of] + 150, image_size=size) for of in (first, ~first)
        )
        camera = uq.calibrate_camera(camera, **options)
        new = uq.calibrate_camera(new, intrinsics=dict(camera.intrinsics), exact=True, **options)
        pairs = uq.PosePairs(poses.robot[:12], camera.poses, camera_calibration=camera)
        result = uq.calibrate(pairs, noise=robot, robust=False, shared=[])
        squared.append(squares(result.predict_camera(robot=poses.robot[12:]), new.poses).mean() / 6)
        with pytest.raises(InputError, match="corners"):
            replace(result, data=None).predict_camera(robot=poses.robot[12:])
        alone = replace(result, data=None, joint_posterior=without_intrinsics(result.posterior))
        stored.append(squares(alone.predict_camera(robot=poses.robot[12:]), new.poses).mean() / 6)
    assert abs(np.mean(squared) - 1) < 4 * np.std(squared) / np.sqrt(draws) + 0.05
    assert np.mean(stored) > 2


def without_intrinsics(posterior):
    kept = [k for k, name in enumerate(posterior.names) if not name.startswith("intrinsics")]
    both = [*range(12), *(12 + k for k in kept)]
    names = tuple(posterior.names[k] for k in kept)
    return type(posterior)(names, posterior.estimate[kept], posterior.covariance[np.ix_(both, both)])


@pytest.mark.slow
def test_a_file_predicts_the_same(rng, tmp_path):
    found = rig(rng)
    result = calibrated(found)
    result.to_json(tmp_path / "result.json")
    again = uq.Calibration.from_json(tmp_path / "result.json")
    one, other = (of.predict_camera(joints=found.far) for of in (result, again))
    np.testing.assert_allclose(one.poses, other.poses, atol=1e-13)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9, atol=1e-20)
    data = json.loads((tmp_path / "result.json").read_text())
    data["kinematics"]["e"] = data["kinematics"]["e"][:-1]
    with pytest.raises(InputError, match="damaged"):
        uq.Calibration.from_dict(data)


@pytest.mark.slow
def test_poses_of_another_arm_are_refused(rng):
    found = rig(rng)
    other = uq.Kinematics.from_urdf(SIX_AXES.replace('xyz="0 0 0.27"', 'xyz="0 0 0.7"'))
    with pytest.raises(InputError, match="another arm"):
        uq.calibrate(found.poses, noise=NOISE, kinematics=other)


@pytest.mark.slow
def test_what_does_not_fit_is_refused(rng):
    found = rig(rng)
    result = calibrated(found)
    for joints in (np.zeros(5), "home", np.full(6, np.nan)):
        with pytest.raises(InputError, match="joints"):
            result.predict_camera(joints=joints)
    with pytest.raises(InputError, match="does not reach 1 of 1 robot poses"):
        result.predict_camera(robot=np.eye(4))
    with pytest.raises(InputError, match="points"):
        result.predict([0, 0], found.near)
    for noise in (-np.eye(3), np.eye(2), np.zeros((5, 3, 3))):
        with pytest.raises(InputError, match="points_covariance"):
            result.predict([[0, 0, 0.3]], found.near, points_covariance=noise)
    with pytest.raises(InputError, match="kinematics"):
        uq.calibrate(found.poses, noise=NOISE, joints=found.poses.joints)
    with pytest.raises(InputError, match="efficient or ml"):
        uq.calibrate(found.poses, noise=NOISE, method="tsai", kinematics=ARM)
    with pytest.raises(InputError, match=r"\(20, 6\)"):
        uq.calibrate(found.poses, noise=NOISE, joints=np.zeros((19, 6)), kinematics=ARM)


def test_no_joints_make_no_predictions(rng):
    result = calibrated(rig(rng))
    assert result.predict_camera(joints=np.zeros((0, 6))).covariance.shape == (0, 6, 6)
    assert result.predict([0, 0, 0.3], np.zeros((0, 6))).covariance.shape == (0, 3, 3)


@pytest.mark.slow
def test_the_controller_may_have_a_base_and_a_tool_of_its_own(rng):
    """The same rig, told in the frames of the controller: the same camera poses are predicted."""
    found = rig(rng, n=25)
    base, tool = motion((0, 0, np.pi), (0.1, -0.2, 0.4)), motion((0.1, -0.2, 0.3), (0.01, 0.02, 0.15))
    poses = uq.PosePairs(base @ found.poses.robot @ tool, found.poses.camera, joints=found.poses.joints)
    errors = replace(DECLARED, flange="physical")  # that of the workspace is fitted to what the tool adds, too
    one, other = (calibrated(of, errors) for of in (found, found._replace(poses=poses)))
    np.testing.assert_allclose(other.X, inverse(tool) @ one.X, atol=1e-6)
    for joints in (found.near, found.far):
        a, b = one.predict_camera(joints=joints), other.predict_camera(joints=joints)
        np.testing.assert_allclose(a.poses, b.poses, atol=1e-6)
        ratio = np.linalg.eigvals(np.linalg.solve(a.covariance, b.covariance)).real
        assert (np.abs(ratio - 1) < 5e-3).all()


@pytest.mark.slow
def test_a_controller_that_knows_its_arm_better_says_where_it_is(rng):
    """Poses by the controller's own calibration: they are needed beside the joints, and improve what is predicted."""
    found = rig(rng, sd={group: 6 * sd for group, sd in GEOMETRY.items()})
    known = 0.9 * found.e
    poses = uq.PosePairs(ARM.poses(found.poses.joints, known), found.poses.camera, joints=found.poses.joints)
    result = calibrated(found._replace(poses=poses))
    with pytest.raises(InputError, match="expected `robot`"):
        result.predict_camera(joints=found.far)
    seen = result.predict_camera(joints=found.far, robot=ARM.poses(found.far, known), new_measurement=False)
    assert squares(seen, found.seen(found.far)).mean() / 6 < 4
    off = np.linalg.norm(seen.poses[:, :3, 3] - found.seen(found.far)[:, :3, 3], axis=-1)
    assert np.sqrt(np.mean(off**2)) < 2e-3


def test_joints_in_degrees_are_refused(rng):
    result = calibrated(rig(rng))
    with pytest.raises(InputError, match="in degrees"):
        result.predict_camera(joints=np.rad2deg(CENTRE))


@pytest.mark.slow
def test_a_calibrated_pose_is_never_less_certain_than_one_far_away():
    """Two arms of which nothing is known, and one without errors."""
    for arm, accuracy in (("ur5", 0.6e-3), ("panda", 2e-3), ("irb120", 0.0)):
        drawn = arm_set(arm, accuracy, np.random.default_rng(3), n=30)
        at, far = drawn.poses.robot, drawn.far.robot
        away = np.linalg.norm(far[:, None, :3, 3] - at[:, :3, 3], axis=-1).min(axis=1)
        far = far[away > 0.25]
        result = quietly(drawn.poses)
        near, other = (
            np.linalg.norm(result.predict_camera(robot=G, new_measurement=False).std[:, 3:], axis=-1) for G in (at, far)
        )
        assert len(far) > 3 and near.max() < other.min()


@pytest.mark.slow
def test_joints_make_predictions_better():
    """Far from the calibrated poses, of arms of 2 mm: nearer to the truth than without them, and not less certain."""
    off, stated = np.empty((3, 2)), np.empty((3, 2))
    for k, arm in enumerate(("ur5", "irb120", "kr6_r900")):
        drawn = arm_set(arm, 2e-3, np.random.default_rng(k), n=30, spread="anywhere")
        told = {"kinematics": uq.Kinematics.from_urdf(drawn.urdf), "joints": drawn.joints}
        for j, (options, at) in enumerate(
            (({}, {"robot": drawn.far.robot}), (told, {"joints": drawn.far.joints, "robot": drawn.far.robot}))
        ):
            ahead = quietly(drawn.poses, **options).predict_camera(**at, new_measurement=False)
            away = ahead.poses[:, :3, 3] - drawn.far.seen[:, :3, 3]
            off[k, j] = np.sqrt(np.mean(away**2))
            stated[k, j] = np.sqrt(np.mean(ahead.std[:, 3:] ** 2))
    assert (off[:, 1] < off[:, 0]).all() and (stated[:, 1] < stated[:, 0]).all()


@pytest.mark.slow
def test_poses_of_seven_axes_leave_the_elbow_open():
    """An arm of 2 mm, known by its joints, at other poses without joints: less certain, and nearly as far off."""
    drawn = arm_set("panda", 2e-3, np.random.default_rng(1), n=30, spread="anywhere")
    result = quietly(drawn.poses, kinematics=uq.Kinematics.from_urdf(drawn.urdf), joints=drawn.joints)
    far = drawn.far
    by_joints, by_poses = (
        result.predict_camera(**at, new_measurement=False) for at in ({"joints": far.joints}, {"robot": far.robot})
    )
    assert np.median(by_poses.std[:, 3:]) > 3 * np.median(by_joints.std[:, 3:])
    off = far.seen[:, :3, 3] - by_poses.poses[:, :3, 3]
    assert np.sqrt(np.mean(off**2)) < 1.5 * np.sqrt(np.mean(by_poses.std[:, 3:] ** 2))


def test_a_calibration_without_covariance_asks_for_the_noise():
    poses = uq.simulate(n_poses=12, seed=1)
    with pytest.raises(uq.InputError, match=r"with a covariance, got one without: .* Calibrate with `noise`"):
        uq.calibrate(poses).predict_camera(poses.robot)
