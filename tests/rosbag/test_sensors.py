"""Sensors: streams of robot and camera, and what is made of clocks that their motion does not tell."""

import logging

import numpy as np
import pytest
from fixtures.streams import motion, streams, triggered

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.read.rosbag.sensors import Sensors

BOTH = ("robot", "camera")


@pytest.fixture(scope="module")
def few():
    """A dozen poses at rest, half a second apart: too few for an offset."""
    poses = uq.simulate(n_poses=12, seed=3)
    times = 0.5 * np.arange(12.0) + 1e9
    return uq.Stream(times, poses.robot), uq.Stream(times, poses.camera)


def test_stamps_of_one_computer_are_one_clock_where_no_offset_is_found(few, caplog):
    with caplog.at_level(logging.WARNING, "uq_handeye"):
        found = Sensors("cell.mcap", *few, BOTH).synchronised()
    assert (found.offset, found.offset_std, found.poses.n) == (0.0, 0.0, 12)
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "The stamps of the bag are taken as those of one clock" in caplog.text


@pytest.mark.parametrize("recorded", [(), ("robot",)])
def test_clocks_of_files_are_not_taken_as_one(few, recorded):
    with pytest.raises(InputError, match="offset"):
        Sensors("robot.csv and camera.csv", *few, recorded).synchronised()


def test_streams_without_common_time(few, caplog):
    robot, camera = few
    later = uq.Stream(camera.timestamps + 1e6, camera.poses)
    with pytest.raises(InputError, match="in common"):
        Sensors("robot.csv and camera.csv", robot, later).synchronised()
    with caplog.at_level(logging.INFO, "uq_handeye"), pytest.raises(InputError):  # any offset is tried
        Sensors("cell.mcap", robot, later, BOTH).synchronised()
    assert "any clock offset is tried" in caplog.text


def single_poses(n, step, late=0.0, noise=True):
    """Poses that were taken one by one, ``step`` seconds apart, the camera's stamps ``late``."""
    poses = uq.simulate(n_poses=n, seed=4)
    times = step * np.arange(float(n)) + 1.7e9
    return uq.Stream(times, poses.robot), uq.Stream(times + late, poses.camera)


@pytest.mark.parametrize(
    ("step", "late", "words"),
    [(20.0, 0.0, "20 s apart"), (5.0, 0.03, "the robot stood still"), (0.5, 0.03, "the robot stood still")],
)
def test_poses_taken_one_by_one_are_pairs(caplog, step, late, words):
    robot, camera = single_poses(15, step, late)
    lacks = uq.Stream(np.delete(camera.timestamps, 3), np.delete(camera.poses, 3, axis=0))
    with caplog.at_level(logging.INFO, "uq_handeye"):
        found = Sensors("cell.mcap", robot, lacks, BOTH).taken_one_by_one("eye-in-hand")
    assert found is not None and found.n == 14 and found.timing is None
    np.testing.assert_array_equal(found.robot, np.delete(robot.poses, 3, axis=0))
    np.testing.assert_array_equal(found.camera, lacks.poses)
    assert words in caplog.text and "1 of 15 robot poses left out" in caplog.text
    # Clocks of two files need not be one, and stops are averaged on request.
    assert Sensors("robot.csv", robot, camera).taken_one_by_one("eye-in-hand") is None
    assert Sensors("cell.mcap", robot, camera, BOTH, still=True).taken_one_by_one("eye-in-hand") is None


@pytest.mark.parametrize(("step", "late"), [(0.05, 0.0), (5.0, 2.0), (0.8, 0.2)])
def test_other_streams_are_not_taken_one_by_one(step, late):
    assert Sensors("cell.mcap", *single_poses(15, step, late), BOTH).taken_one_by_one("eye-in-hand") is None


@pytest.mark.slow
def test_a_tracked_motion_with_equal_stamps_keeps_its_offset(rng):
    *_, robot, camera = streams(
        rng, motion(rng, 60.0, knot=4.0), 0.0, 60.0, rates=(2.5, 2.5), noise=((1e-4, 5e-5),) * 2
    )
    times = camera.timestamps - camera.timestamps[0] + 1.7e9
    robot = uq.Stream(times[: len(robot)], robot.poses[: len(times)])
    camera = uq.Stream(times[: len(robot)], camera.poses[: len(robot)])
    assert Sensors("cell.mcap", robot, camera, BOTH).taken_one_by_one("eye-in-hand") is None


def test_files_of_single_poses_are_told_to_pair_them():
    with pytest.raises(
        InputError, match=r"taken one by one are paired, not interpolated: by their times \(--pair time\)"
    ):
        uq.synchronise(*single_poses(15, 20.0))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The target is ahead")  # targets anywhere
def test_few_pictures_at_stops_need_no_offset(rng, caplog):
    """Too few for speeds: the stamps are those of one clock, and the robot stood still at each picture."""
    X, robot, camera = triggered(rng, 15)
    with caplog.at_level(logging.INFO, "uq_handeye"):
        found = Sensors("cell.mcap", robot, camera, BOTH).synchronised()
    assert found.offset == 0.0 and found.poses.n == 15
    assert "Every picture was taken while the robot stood still" in caplog.text and not found.warnings
    assert not [record for record in caplog.records if record.levelname == "WARNING"]
    assert np.linalg.norm(uq.calibrate(found.poses).X[:3, 3] - X[:3, 3]) < 5e-3
