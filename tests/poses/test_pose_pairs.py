"""PosePairs: validated once, never changed."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from support import exact_poses, random_transforms

from uq_handeye.core.geometry.frames import SETUPS
from uq_handeye.errors import InputError
from uq_handeye.model.poses.pose_pairs import PosePairs


@pytest.fixture
def pair(rng):
    return random_transforms(rng, (5,)), random_transforms(rng, (5,))


def test_holds_what_it_was_given(pair):
    robot, camera = pair
    poses = PosePairs(robot, RigidTransform.from_matrix(camera), timestamps=[0, 1, 2.5, 3, 4])
    np.testing.assert_array_equal(poses.robot, robot)
    np.testing.assert_allclose(poses.camera, camera, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(poses.timestamps, [0, 1, 2.5, 3, 4])
    assert poses.n == len(poses) == 5
    assert poses.setup == "eye-in-hand"
    assert repr(poses) == "PosePairs(5 poses, eye-in-hand)"


def test_some_of_the_poses(pair):
    poses = PosePairs(*pair, timestamps=[0, 1, 2.5, 3, 4])
    for index, rows in ((slice(3), [0, 1, 2]), (slice(None, None, -2), [4, 2, 0]), (-1, [4]), ([1, 3], [1, 3])):
        some = poses[index]
        np.testing.assert_array_equal(some.camera, poses.camera[rows])
        np.testing.assert_array_equal(some.timestamps, poses.timestamps[rows])
    assert len(poses[np.arange(5) > 2]) == 2 and [one.n for one in poses] == [1] * 5
    with pytest.raises(IndexError):
        poses[5]
    with pytest.raises(InputError, match="got PosePairs, which hold two"):
        np.asarray(poses)


def test_is_frozen_and_a_copy(pair):
    robot, camera = pair
    times = np.arange(5.0)
    poses = PosePairs(robot, camera, timestamps=times)
    before = robot.copy()
    robot[0] = 0
    times[0] = -7
    np.testing.assert_array_equal(poses.robot, before)
    assert poses.timestamps[0] == 0
    for array in (poses.robot, poses.camera, poses.timestamps):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        poses.setup = "eye-to-hand"


@pytest.mark.parametrize("setup", SETUPS)
def test_closes_the_loop(rng, setup):
    """``effective_robot X camera`` is the same for every pose, for either setup."""
    X, robot, camera = exact_poses(rng, 6, setup)
    poses = PosePairs(robot, camera, setup)
    W = poses.effective_robot @ X @ poses.camera
    np.testing.assert_allclose(W, np.broadcast_to(W[0], W.shape), rtol=0, atol=1e-13)
    other = PosePairs(robot, camera, next(s for s in SETUPS if s != setup))
    W = other.effective_robot @ X @ other.camera
    assert np.abs(W - W[0]).max() > 0.1


def test_batches(rng):
    poses = PosePairs(random_transforms(rng, (3, 2, 5)), random_transforms(rng, (3, 2, 5)), timestamps=range(5))
    assert poses.n == 5
    assert poses.effective_robot.shape == (3, 2, 5, 4, 4)


def test_refuses_setup(pair):
    with pytest.raises(InputError, match="`setup` to be one of eye-in-hand, eye-to-hand, got 'eye_in_hand'"):
        PosePairs(*pair, "eye_in_hand")


def test_refuses_different_numbers(pair):
    with pytest.raises(InputError, match=r"same number of poses, got shapes \(5, 4, 4\) and \(4, 4, 4\)"):
        PosePairs(pair[0], pair[1][:4])


def test_timestamps_need_not_be_in_order(pair):
    """Poses are paired by position; their times are kept as given."""
    poses = PosePairs(*pair, timestamps=[3, 1, 4, 1.5, 9])
    np.testing.assert_array_equal(poses.timestamps, [3, 1, 4, 1.5, 9])


@pytest.mark.parametrize("name", ["robot", "camera"])
def test_names_the_bad_pose(pair, name):
    poses = dict(zip(("robot", "camera"), pair, strict=True))
    poses[name][3, :3, 0] *= -1
    with pytest.raises(InputError, match=rf"`{name}`\[3\].*left-handed"):
        PosePairs(**poses)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0, 1, 2, 3], r"`timestamps` to be 5 finite numbers, got shape \(4,\)"),
        ([[0, 1, 2, 3, 4]], r"5 finite numbers, got shape \(1, 5\)"),
        ([0, 1, 2, 3, np.nan], "5 finite numbers"),
        ([0, 1, 2, np.inf, np.inf], "5 finite numbers"),
        ([0, 1, 1, 2, 3], "timestamp of its own for every pose, got 1.0 for poses 1 and 2"),
        ([0, 1, 2, 3, 2], "timestamp of its own for every pose, got 2.0 for poses 2 and 4"),
        ([7, 5, 9, 5, 7], "timestamp of its own for every pose"),
    ],
)
def test_refuses_timestamps(pair, times, message):
    with pytest.raises(InputError, match=message):
        PosePairs(*pair, timestamps=times)
