"""Second solutions of the poses of small tags: decided by the other poses, and named among finished poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.fit.diagnostics.pose_ambiguity import CODE
from uq_handeye.model.camera.adjustment.two_minima import both_minima, flipped
from uq_handeye.model.poses.residuals import rotation_angles

pytestmark = pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")  # of outliers
F, CENTRE, SIZE = 900.0, (639.5, 479.5), (1280, 960)
ROBOT = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1e-6deg", "1e-6mm"))
KNOWN = {"fx": F, "fy": F, "cx": CENTRE[0], "cy": CENTRE[1]}


def seen_tag(seed, n=20, side=0.02, noise=0.3):
    """Return poses with truth, and the camera that saw a tag of 30 pixels."""
    poses = uq.simulate(n_poses=n, noise=ROBOT, seed=seed)
    points, C = uq.Board(1, 1, side, "apriltag").points, poses.truth.camera
    at = points @ C[:, :3, :3].mT + C[:, None, :3, 3]
    pixels = F * at[..., :2] / at[..., 2:] + CENTRE
    pixels += noise * np.random.default_rng([seed, 7]).normal(size=pixels.shape)
    row = np.repeat(np.arange(n), 4)
    corners = uq.Corners(row, np.tile(points, (n, 1)), pixels.reshape(-1, 2), image_size=SIZE)
    cam = uq.calibrate_camera(corners, model="pinhole", intrinsics=KNOWN, exact=True, shape="flat")
    return poses, uq.PosePairs(poses.robot, cam.poses, poses.setup, camera_calibration=cam)


def nearer_to_the_other(camera, truth):
    """Return how many poses are nearer to the flipped truth than to the truth."""
    other = flipped(truth, np.zeros(3))
    right, wrong = (rotation_angles(camera[:, :3, :3].mT @ T[:, :3, :3]) for T in (truth, other))
    return int((wrong < right).sum())


def error(result, X):
    turn = Rotation.from_matrix(result.X[:3, :3] @ X[:3, :3].T).as_rotvec()
    return np.concatenate([turn, result.X[:3, 3] - X[:3, 3]])


@pytest.mark.statistical
def test_the_other_poses_decide_and_the_covariance_is_consistent():
    """A third of 8 x 20 poses is flipped by its own corners, 2 % in the end; d^2/6 of X is 1 on average."""
    before, after, d2 = [], [], []
    noise = uq.PoseNoise(robot=ROBOT.robot)
    for seed in range(8):
        truth, poses = seen_tag(seed)
        found = uq.resolve_pose_ambiguity(poses)
        before.append(nearer_to_the_other(poses.camera, truth.truth.camera))
        after.append(nearer_to_the_other(found.camera, truth.truth.camera))
        np.testing.assert_array_equal(found.camera, found.camera_calibration.poses)
        result = uq.calibrate(found, noise=noise, shared=[])
        e = error(result, truth.truth.X)
        d2.append(e @ np.linalg.solve(result.covariance, e) / 6)
    assert np.mean(before) > 4 and np.mean(after) < 0.8
    assert 0.5 < np.mean(d2) < 1.6  # sqrt(2 / 6 / 8) is 0.2


@pytest.mark.slow
def test_it_is_counted_once():
    _, poses = seen_tag(1)
    found = uq.resolve_pose_ambiguity(poses)
    assert uq.resolve_pose_ambiguity(found) is found
    (finding,) = [one for one in uq.calibrate(found).findings if one.code == CODE]
    assert finding.severity == "note" and 10 < finding.values["count"] <= finding.values["n"] == 20
    assert str(finding).startswith(f"{finding.values['count']} of 20 poses of the target had a second solution")


def test_pictures_that_decide_alone_are_left_as_they_are():
    _, poses = seen_tag(2, side=0.2, noise=0.05)
    assert uq.resolve_pose_ambiguity(poses) is poses
    assert not both_minima(poses.camera_calibration.bundle, poses.camera_calibration.corners).doubtful.any()


def test_both_minima_predict_the_same_corners_of_a_far_tag():
    poses = uq.simulate(n_poses=5, seed=4).camera
    far = poses.copy()
    far[:, :3, 3] *= 1e3
    other = flipped(far, np.zeros(3))
    np.testing.assert_allclose(np.linalg.det(other[:, :3, :3]), 1.0)
    points = uq.tag_points(0.1)
    pixels = [(at := points @ T[:, :3, :3].mT + T[:, None, :3, 3])[..., :2] / at[..., 2:] for T in (far, other)]
    np.testing.assert_allclose(pixels[0], pixels[1], atol=1e-6)  # of 1e-4
    np.testing.assert_allclose(flipped(other, np.zeros(3)), far, atol=1e-12 * far.max())


@pytest.mark.slow
@pytest.mark.parametrize("with_views", [False, True])
def test_flipped_poses_of_another_program_are_named(with_views):
    truth, poses = seen_tag(5, side=0.03, noise=0.2)
    cam = uq.resolve_pose_ambiguity(poses).camera_calibration
    minima, camera = both_minima(cam.bundle, cam.corners), cam.poses.copy()
    same = np.abs(minima.poses[0] - camera).max(axis=(1, 2)) < 1e-4
    turned = np.argsort(np.abs(camera[:, 2, 2]))[:3]  # the most tilted
    camera[turned] = np.where(same[:, None, None], minima.poses[1], minima.poses[0])[turned]
    given = uq.PosePairs(truth.robot, camera)
    noise = uq.camera_noise(given, uq.tag_points(0.03), (F, F, *CENTRE)) if with_views else None
    result = uq.calibrate(given, noise=noise)
    (finding,) = [one for one in result.findings if one.code == "input_checks.flipped_poses"]
    assert finding.values["rows"] == sorted(turned.tolist())
    assert "fit if the target is flipped" in str(finding) and str(finding) in result.warnings
    assert all(one.code != "input_checks.angles_disagree" for one in result.findings)


@pytest.mark.slow
def test_a_pose_at_the_camera_stays_as_it_is():
    poses = np.stack([np.eye(4)] * 2)
    poses[1, :3, 3] = (0.1, 0.0, 1.0)
    assert np.allclose(np.linalg.det(flipped(poses, np.zeros(3))[:, :3, :3]), 1.0)
    good = uq.simulate(20, noise=uq.PoseNoise.isotropic(robot=("0.03deg", "0.2mm"), camera=("0.1deg", "1mm")), seed=2)
    camera = good.camera.copy()
    camera[[0, 7]] = np.eye(4)  # the first row of odometry, a detection that was lost
    with pytest.warns(uq.InputWarning, match="rejected"):
        result = uq.calibrate(uq.PosePairs(good.robot, camera, good.setup))
    assert {0, 7} <= set(result.table.rejected)


def test_outliers_that_are_not_flipped_are_not_named():
    truth, poses = seen_tag(6, side=0.2, noise=0.05)
    camera = poses.camera.copy()
    camera[[3, 8]] = camera[[8, 3]]
    result = uq.calibrate(uq.PosePairs(truth.robot, camera))
    assert {3, 8} <= set(result.table.flagged)
    assert all(one.code != "input_checks.flipped_poses" for one in result.findings)


def test_a_single_tag_does_not_calibrate_a_camera():
    _, poses = seen_tag(1)
    with pytest.raises(uq.InputError, match=r"4 points, such as .* give its fx, fy, cx, cy"):
        uq.calibrate_camera(poses.camera_calibration.corners, model="pinhole")
