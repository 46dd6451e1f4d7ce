"""Several readings of the rotations of a file: robot and camera decide, and say so; otherwise they are refused."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import SEED

import uq_handeye as uq
from uq_handeye.formats.contents import Reading, Side
from uq_handeye.io.readings import chosen_readings, reading_beside

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
FRAMES = ("base_T_gripper", "camera_T_target")
ALL = (slice(None), slice(None))
READINGS = (
    Reading("ur", "rotvec-rad"),
    Reading("rpy", "xyz-rad"),
    Reading("staubli", "XYZ-deg", "mm"),
    Reading("yaskawa", "xyz-deg", "mm"),
)


def sides(poses, numbers, readings, scale=1.0):
    robot = Side("robot.csv", poses.robot[:, :3, 3] * scale, numbers, readings=readings)
    return [robot, Side("camera.csv", poses.camera[:, :3, 3], poses.camera[:, :3, :3])]


def numbers_of(poses, reading):
    rotation = Rotation.from_matrix(poses.robot[:, :3, :3])
    if reading.rotation.startswith("rotvec"):
        return rotation.as_rotvec()
    sequence, unit = reading.rotation.split("-")
    return rotation.as_euler(sequence, degrees=unit == "deg")


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("meant", READINGS, ids=lambda reading: reading.format)
def test_the_motions_decide(meant, setup):
    poses = uq.simulate(12, noise=NOISE, setup=setup, seed=SEED)
    scale = 1e3 if meant.units == "mm" else 1.0
    chosen = chosen_readings(
        sides(poses, numbers_of(poses, meant), READINGS, scale), (None, None), (None, None), FRAMES, ALL, setup
    )
    assert chosen.sides[0].readings == (meant,)
    assert str(meant) in chosen.notes[0] and chosen.notes[1] == ""


def test_both_sides_may_be_open():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    orders = (Reading("csv", "xyzw"), Reading("csv", "wxyz"))
    robot = Rotation.from_matrix(poses.robot[:, :3, :3]).as_quat(scalar_first=True)
    camera = Rotation.from_matrix(poses.camera[:, :3, :3]).as_quat()
    pair = [
        Side("robot.csv", poses.robot[:, :3, 3], robot, readings=orders),
        Side("camera.csv", poses.camera[:, :3, 3], camera, readings=orders),
    ]
    chosen = chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
    assert [side.readings[0].rotation for side in chosen.sides] == ["wxyz", "xyzw"]


def test_few_poses_or_a_bad_fit_are_refused_with_the_candidates():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    numbers = numbers_of(poses, READINGS[0])
    for pair in (
        [side_of(side, slice(3)) for side in sides(poses, numbers, READINGS)],
        sides(poses, np.random.default_rng(SEED).normal(size=(12, 3)), READINGS),
    ):
        with pytest.raises(uq.InputError, match=r"ur \(rotvec-rad\), rpy .*--robot-format ur") as caught:
            chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
        assert "\n" not in str(caught.value)


def side_of(side, rows):
    return replace(side, translation=side.translation[rows], rotation=side.rotation[rows])


def test_what_was_asked_for_is_not_decided():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    pair = sides(poses, numbers_of(poses, READINGS[0]), READINGS)
    chosen = chosen_readings(pair, (None, None), ("rotvec-rad", None), FRAMES, ALL, "eye-in-hand")
    assert chosen.sides[0] is pair[0] and chosen.notes == ("", "")


def test_another_order_of_angles_is_named():
    """KUKA's angles read as FANUC's: a warning with the option; read right: none."""
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    numbers = numbers_of(poses, Reading("kuka", "ZYX-deg"))
    pair = sides(poses, numbers, (Reading("fanuc", "xyz-deg", "m"),))
    with pytest.warns(uq.InputWarning, match=r"--robot-rotation ZYX-deg"):
        chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
    right = sides(poses, numbers, (Reading("kuka", "ZYX-deg", "m"),))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chosen_readings(right, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")


def test_beside_a_calibrated_camera():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    robot = sides(poses, numbers_of(poses, READINGS[1]), READINGS[:2])[0]
    rows = np.arange(2, 11)
    side, note = reading_beside(robot, poses.camera[rows], rows, None, None, FRAMES[0], "eye-in-hand")
    assert side.readings == (READINGS[1],) and "xyz-rad" in note


def test_numbers_of_rows_beside_times_of_a_clock(tmp_path):
    """Rows numbered 0, 1, 2, ... go with times; numbers that differ still show a lost row."""
    poses = uq.simulate(5, noise=NOISE, seed=SEED)
    uq.io.write_pose_file(tmp_path / "robot.csv", poses.robot, 1.7e9 + 0.7 * np.arange(5))
    uq.io.write_pose_file(tmp_path / "camera.csv", poses.camera)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera.csv").n == 5
    uq.io.write_pose_file(tmp_path / "robot.csv", poses.robot, [0, 1, 2, 4, 5])
    with pytest.raises(uq.InputError, match="same moments"):
        uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera.csv")
