"""Covariances of camera poses in bags: read, carried to the pairs, and inverted with their poses."""

import numpy as np
import pytest
from fixtures.bags import START, Writer
from fixtures.commands import run
from support import random_covariance

import uq_handeye as uq
from uq_handeye.core.geometry.conventions import CovarianceReading
from uq_handeye.model.poses.stream import Stream
from uq_handeye.read.camera_covariance import read_again, with_covariance
from uq_handeye.read.rosbag.sensors import Sensors
from uq_handeye.read.rosbag.streams import read_bag

N = 8


@pytest.fixture(scope="module")
def cell():
    poses = uq.simulate(N, seed=5)
    return poses, random_covariance(np.random.default_rng(2), shape=(N,), sd=3e-4)


def written(folder, poses, numbers, kind="mcap"):
    """A bag of poses two seconds apart, the camera's with covariances."""
    with Writer(folder, kind) as bag:
        for k in range(N):
            bag.pose_stamped("/tcp", START + 2 * k, "base", poses.robot[k])
            bag.pose_with_covariance("/board", START + 2 * k, "camera", poses.camera[k], numbers[k])
    return bag.path


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_topic_with_covariances(tmp_path, cell, kind):
    poses, S = cell
    path = written(tmp_path, poses, uq.to_convention(S, poses.camera, "ros"), kind)
    robot, camera = read_bag(path, robot="/tcp", camera="/board")
    assert robot.covariance is None
    np.testing.assert_allclose(camera.covariance, S, rtol=1e-9, atol=1e-16)
    pairs = Sensors("cell", robot, camera, ("robot", "camera")).taken_one_by_one("eye-in-hand")
    np.testing.assert_allclose(pairs.camera_covariance.own, S, rtol=1e-9, atol=1e-16)
    assert pairs.camera_read_as == CovarianceReading("ros")
    _, inverse = read_bag(path, robot="/tcp", camera="/board", camera_frame="target_T_camera")
    of_inverse = uq.covariance_of_inverse(poses.camera, S)
    np.testing.assert_allclose(inverse.covariance, of_inverse, rtol=1e-8, atol=1e-15)
    assert inverse.read_as == CovarianceReading("ros", inverse=True)


def test_unknown_covariances(tmp_path, cell):
    poses, S = cell
    numbers = uq.to_convention(S, poses.camera, "ros")
    numbers[3] = 0.0
    _, camera = read_bag(written(tmp_path, poses, numbers), robot="/tcp", camera="/board")
    assert camera.covariance is None
    assert "not known for every pose" in " ".join(camera.source.notes)


def test_numbers_are_read_again_in_another_convention(cell):
    poses, S = cell
    numbers = uq.to_convention(S, poses.camera, "gtsam")
    as_ros = uq.from_convention(numbers, poses.camera, "ros")
    stream = Stream(poses.timestamps, poses.camera, None, None, as_ros, CovarianceReading("ros"))
    pairs = with_covariance(poses, stream)
    assert read_again(pairs, None) is pairs
    again = read_again(pairs, CovarianceReading("gtsam"))
    np.testing.assert_allclose(again.camera_covariance.own, S, rtol=1e-8, atol=1e-15)
    assert again.camera_read_as == CovarianceReading("gtsam")


def test_poses_that_are_not_those_of_the_stream_get_none(cell):
    poses, S = cell
    stream = Stream(poses.timestamps, poses.camera, None, None, S, CovarianceReading("ros"))
    assert with_covariance(poses.rows(np.array([5, 2])), stream).camera_covariance.n == 2
    moved = poses.camera.copy()
    moved[1, 0, 3] += 1e-6
    other = uq.PosePairs(poses.robot, moved, timestamps=poses.timestamps)
    assert with_covariance(other, stream).camera_covariance is None
    late = uq.PosePairs(poses.robot, poses.camera, timestamps=poses.timestamps + 1e-3)
    assert with_covariance(late, stream).camera_covariance is None


@pytest.mark.slow
def test_by_the_command(tmp_path, cell):
    poses, _ = cell
    S = np.tile(np.diag([1e-6, 4e-6, 2e-6, 1e-7, 3e-7, 9e-7]), (N, 1, 1))
    poses = uq.simulate(N, noise=uq.PoseNoise(np.diag([1e-8] * 3 + [1e-9] * 3), S), seed=5)
    path = written(tmp_path, poses, uq.to_convention(S, poses.camera, "ros"))
    done = run("calibrate", "--bag", path, "--robot", "/tcp", "--camera", "/board", "-v", "--json", cwd=tmp_path)
    assert done.returncode in (0, 6), done.stderr
    assert '"camera_read_as": "ros"' in done.stdout
