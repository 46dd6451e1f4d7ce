"""Sensors: streams of robot and camera, and what is made of clocks that their motion does not tell."""

import logging

import numpy as np
import pytest

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
