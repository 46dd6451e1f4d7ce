"""Joint values that travel with the poses of the robot."""

import dataclasses

import numpy as np
import pytest
from fixtures.streams import motion, streams
from support import random_transforms

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.model.poses.pose_pairs import joint_values_at


@pytest.fixture
def poses(rng):
    return uq.PosePairs(random_transforms(rng, (5,)), random_transforms(rng, (5,)), joints=rng.normal(size=(5, 7)))


def test_joints_are_a_frozen_copy(rng):
    joints = rng.normal(size=(5, 2))
    poses = uq.PosePairs(random_transforms(rng, (5,)), random_transforms(rng, (5,)), joints=joints)
    kept = joints.copy()
    joints[0] = 0
    np.testing.assert_array_equal(poses.joints, kept)
    with pytest.raises(ValueError, match="read-only"):
        poses.joints[0] = 1
    assert dataclasses.replace(poses, joints=None).joints is None


@pytest.mark.parametrize("index", [np.array([3, 0]), np.array([True, False, False, True, True])])
def test_rows_take_joints_of_robot_rows(poses, index):
    assert poses.rows(index).joints.tolist() == poses.joints[index].tolist()
    moved = poses.rows(np.array([0, 1]), np.array([1, 2]))
    np.testing.assert_array_equal(moved.joints, poses.joints[:2])


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (np.zeros((4, 7)), r"shape \(5, L\).*got \(4, 7\)"),
        (np.zeros(5), r"got \(5,\)"),
        (np.zeros((5, 0)), r"got \(5, 0\)"),
        (np.full((5, 2), np.nan), "finite `joints`, got nan in pose 0, joint 0"),
        ("elbow", "joints"),
    ],
)
def test_refuses_other_joints(poses, joints, message):
    with pytest.raises(InputError, match=message):
        uq.PosePairs(poses.robot, poses.camera, joints=joints)
    with pytest.raises(InputError, match=message):
        uq.Stream(np.arange(5.0), poses.robot, joints=joints)


def test_interpolates_each_joint_on_its_own():
    found = joint_values_at(np.array([0.0, 2.0]), np.array([[0.0, 1.0], [4.0, -1.0]]), np.array([0.5, 2.0]))
    np.testing.assert_allclose(found, [[1.0, 0.5], [4.0, -1.0]])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Interpolation of the camera")
@pytest.mark.parametrize("rates", [(200.0, 20.0), (40.0, 60.0)], ids=["robot interpolated", "camera interpolated"])
def test_synchronised_joints_are_those_at_the_time_of_the_pose(rng, rates):
    """Joints are linear in time here, so that interpolation is exact; the offset given is exact as well."""
    _, _, robot, camera = streams(rng, motion(rng, 20.0), 0.35, 20.0, rates=rates)
    order = rng.permutation(len(robot))
    slope, start = np.array([0.1, -0.4]), np.array([1.0, 0.0])
    times = robot.timestamps[order]
    robot = uq.Stream(times, robot.poses[order], joints=times[:, None] * slope + start)
    found = uq.synchronise(robot, camera, offset=0.35).poses
    expected = (found.timestamps + 0.35)[:, None] * slope + start
    np.testing.assert_allclose(found.joints, expected, rtol=0, atol=1e-9)
    assert uq.synchronise(uq.Stream(times, robot.poses), camera, offset=0.35).poses.joints is None


@pytest.mark.slow
def test_stops_take_the_mean_of_their_joints(rng):
    """Five stops: the joints of each are constant but for noise."""
    poses = random_transforms(rng, (5,))
    X, W = random_transforms(rng), random_transforms(rng)
    robot_times, camera_times = np.arange(0.0, 5.0, 0.01), np.arange(0.0, 5.0, 0.05)
    at = np.minimum(robot_times.astype(int), 4)
    camera = np.linalg.inv(X) @ np.linalg.inv(poses[np.minimum(camera_times.astype(int), 4)]) @ W
    joints = at[:, None] * [1.0, 2.0]
    robot = uq.Stream(robot_times, poses[at], joints=joints)
    found = uq.synchronise(robot, uq.Stream(camera_times, camera), offset=0.0, still=True).poses
    np.testing.assert_allclose(found.joints, np.arange(5)[:, None] * [1.0, 2.0], rtol=0, atol=1e-12)
