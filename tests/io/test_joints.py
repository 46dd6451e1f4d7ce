"""Joint files as robot poses, and beside robot poses: rows, times, what is left out and what is refused."""

import numpy as np
import pytest
from fixtures.arms import SIX_AXES, motion
from support import random_transforms

import uq_handeye as uq
from uq_handeye.errors import InputError, InputWarning
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.read import read_poses, read_stream, write_pose_file

ARM = Kinematics.from_urdf(SIX_AXES)


def write_joints(file, q, times=None):
    names = list(ARM.names)
    columns = [names, *q.tolist()] if times is None else [["timestamp", *names], *np.column_stack([times, q]).tolist()]
    file.write_text(
        "\n".join(",".join(value if isinstance(value, str) else repr(value) for value in row) for row in columns) + "\n"
    )


@pytest.fixture
def cell(tmp_path, rng):
    """Files of one moment each, and the joints; timestamps only where asked for."""
    q = rng.uniform(-1.2, 1.2, (8, 6))
    robot, X, W = ARM.poses(q), random_transforms(rng), random_transforms(rng)
    camera = np.linalg.inv(robot @ X) @ W

    def make(joint_rows=slice(None), robot_rows=slice(None), camera_rows=slice(None), times=None, late=0.0):
        own = np.arange(8.0) if times is None else times
        write_joints(tmp_path / "joints.csv", q[joint_rows], None if times is None else own[joint_rows] + late)
        write_pose_file(tmp_path / "robot.csv", robot[robot_rows], own[robot_rows])
        write_pose_file(tmp_path / "camera.csv", camera[camera_rows], own[camera_rows])
        return tmp_path

    return make, q


def read(folder, robot=None, **options):
    robot = None if robot is None else folder / robot
    return read_poses(robot, folder / "camera.csv", joints=folder / "joints.csv", kinematics=ARM, **options)


def test_poses_are_those_of_the_joints(cell):
    make, q = cell
    poses = read(make())
    np.testing.assert_array_equal(poses.joints, q)
    np.testing.assert_allclose(poses.robot, ARM.poses(q), rtol=0, atol=1e-14)
    assert [source.name for source in poses.sources] == ["joints.csv", "camera.csv"]
    assert poses.sources[0].format == "joints" and len(poses.sources[0].sha256) == 64


def test_camera_may_be_in_other_units(cell, tmp_path):
    make, q = cell
    make()
    read(tmp_path)
    poses = read(tmp_path, units=("mm", "m"), robot_frame="gripper_T_base")  # neither is of joints
    np.testing.assert_allclose(poses.robot, ARM.poses(q), rtol=0, atol=1e-14)
    np.testing.assert_allclose(read(tmp_path, units="mm").camera[:, :3, 3] * 1e3, poses.camera[:, :3, 3])


def test_rows_pair_by_time_as_those_of_a_robot_file(cell):
    make, q = cell
    times = 100.0 + np.arange(8.0)
    folder = make(camera_rows=[5, 1, 2, 7], times=times)
    poses = read(folder, pair="time")
    np.testing.assert_array_equal(poses.joints, q[[1, 2, 5, 7]])
    np.testing.assert_array_equal(poses.timestamps, times[[1, 2, 5, 7]])


def test_another_number_of_rows_names_the_joint_file(cell):
    make, _ = cell
    with pytest.raises(InputError, match=r"joints.csv has 8 .* and .*camera.csv has 6"):
        read(make(camera_rows=slice(6)))
    with pytest.raises(InputError, match=r"robot.csv has 8 poses and .*joints.csv has 7 rows"):
        read(make(joint_rows=slice(7)), "robot.csv")


def test_beside_robot_poses_row_by_row(cell):
    make, q = cell
    poses = read(make(), "robot.csv")
    np.testing.assert_array_equal(poses.joints, q)
    assert [source.name for source in poses.sources] == ["robot.csv", "camera.csv", "joints.csv"]


def test_beside_robot_poses_by_time(cell):
    """Timestamps that are not those of the row: joints of the nearest; a pose without is left out, and said so."""
    make, q = cell
    times = 100.0 + np.arange(8.0)
    poses = read(make(joint_rows=[0, 1, 2, 4, 5, 6, 7][::-1], times=times, late=0.001), "robot.csv")
    kept = [0, 1, 2, 4, 5, 6, 7]
    np.testing.assert_array_equal(poses.joints, q[kept])
    np.testing.assert_allclose(poses.robot, ARM.poses(q[kept]), rtol=0, atol=1e-12)
    assert "1 pairs without joints" in " ".join(poses.sources[0].notes)
    both = read(make(joint_rows=slice(1, 8), camera_rows=slice(6), times=times), "robot.csv", pair="time")
    np.testing.assert_array_equal(both.joints, q[1:6])


def test_times_that_differ_a_little_are_said(cell):
    make, q = cell
    with pytest.warns(InputWarning, match="robot.csv and .*joints.csv are paired by their order"):
        poses = read(make(times=np.arange(8.0), late=0.01), "robot.csv")
    np.testing.assert_array_equal(poses.joints, q)


def test_times_of_another_clock_are_refused(cell):
    make, _ = cell
    with pytest.raises(InputError, match=r"0 of 8 poses have joints in .*joints.csv"):
        read(make(times=np.arange(8.0), late=1e6), "robot.csv")


def test_a_file_of_both_sides_with_joints_beside(cell, tmp_path):
    make, q = cell
    folder = make()
    poses = read(folder)
    np.savez(folder / "both.npz", robot=poses.robot, camera=poses.camera)
    found = read_poses(folder / "both.npz", joints=folder / "joints.csv", kinematics=ARM)
    np.testing.assert_array_equal(found.joints, q)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"joints": "joints.csv"}, "Expected `kinematics` beside `joints`"),
        ({"kinematics": ARM}, "Expected `joints` beside `kinematics`"),
        ({"joints": "joints.csv", "kinematics": "arm.urdf"}, "to be Kinematics, got str"),
        ({}, "Expected joints and kinematics, or a file of robot poses"),
        ({"joints": "joints.csv", "kinematics": ARM, "camera": None}, "Expected a camera"),
    ],
)
def test_refuses_half_of_an_arm(cell, options, message):
    folder = cell[0]()
    options = {name: folder / value if name == "joints" else value for name, value in options.items()}
    with pytest.raises(InputError, match=message):
        read_poses(None, **{"camera": folder / "camera.csv", **options})


# ---------------------------------------------------------------------------------------------------------- streams


@pytest.fixture
def stream_files(tmp_path, rng):
    times = np.arange(0.0, 4.0, 0.02)
    q = 0.3 * np.sin(times[:, None] * rng.uniform(0.5, 1.5, 6)) + np.linspace(0, 0.5, 6)
    write_joints(tmp_path / "joints.csv", q, times)
    return tmp_path, times, q


def test_a_stream_of_joints(stream_files):
    folder, times, q = stream_files
    stream = read_stream(None, "robot", joints=folder / "joints.csv", kinematics=ARM)
    np.testing.assert_array_equal(stream.joints, q)
    np.testing.assert_array_equal(stream.timestamps, times)
    np.testing.assert_allclose(stream.poses, ARM.poses(q), rtol=0, atol=1e-14)
    assert stream.source.name == "joints.csv"


def test_joints_are_interpolated_at_the_times_of_the_robot(stream_files):
    """Not outside of their times, nor across a gap; robot poses there are left out."""
    folder, times, q = stream_files
    keep = (times < 2.0) | (times > 2.5)
    write_joints(folder / "joints.csv", q[keep], times[keep])
    wanted = np.arange(-0.5, 4.5, 0.033)
    write_pose_file(folder / "robot.csv", np.tile(np.eye(4), (len(wanted), 1, 1)), wanted)
    stream = read_stream(folder / "robot.csv", "robot", joints=folder / "joints.csv", kinematics=ARM)
    inside = (wanted >= 0) & (wanted <= times[-1]) & ~((wanted > 1.98) & (wanted < 2.52))
    np.testing.assert_allclose(stream.timestamps, wanted[inside])
    expected = np.stack([np.interp(wanted[inside], times, column) for column in q.T], axis=-1)
    np.testing.assert_allclose(stream.joints, expected, rtol=0, atol=1e-12)
    assert "are outside of the times of" in stream.source.notes[-1]


def test_streams_need_times_and_a_robot(stream_files):
    folder, _, q = stream_files
    with pytest.raises(InputError, match="of the robot, not of the camera"):
        read_stream(None, "camera", joints=folder / "joints.csv", kinematics=ARM)
    with pytest.raises(InputError, match="Expected a file of poses"):
        read_stream(None, "robot")
    write_joints(folder / "joints.csv", q)
    with pytest.raises(InputError, match=r"joints.csv has no timestamps"):
        read_stream(None, "robot", joints=folder / "joints.csv", kinematics=ARM)
    write_pose_file(folder / "robot.csv", np.tile(np.eye(4), (3, 1, 1)))
    with pytest.raises(InputError, match=r"joints.csv has no timestamps: joints and robot poses of streams"):
        read_stream(folder / "robot.csv", "robot", joints=folder / "joints.csv", kinematics=ARM)


@pytest.mark.slow
def test_synchronised_joints_move_the_chain_to_the_poses(stream_files, rng):
    folder, times, q = stream_files
    X, W = random_transforms(rng), motion((0.1, 0.2, 0.3), (0.5, 0.1, 0.0))
    seen = times[5:-5:4] + 0.007
    at = np.stack([np.interp(seen, times, column) for column in q.T], axis=-1)
    camera = uq.Stream(seen - 0.3, np.linalg.inv(ARM.poses(at) @ X) @ W)
    robot = read_stream(None, "robot", joints=folder / "joints.csv", kinematics=ARM)
    with pytest.warns(InputWarning, match="Interpolation of the robot misses"):  # there is no noise here
        poses = uq.synchronise(robot, camera, offset=0.3).poses
    np.testing.assert_allclose(poses.joints, at, rtol=0, atol=1e-9)
    np.testing.assert_allclose(poses.robot, ARM.poses(poses.joints), rtol=0, atol=2e-4)
