"""Covariances that come with poses in files: columns of CSV, and messages of ROS."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import random_covariance

import uq_handeye as uq
from uq_handeye.core.geometry.conventions import CovarianceReading
from uq_handeye.formats.columns import covariance_columns
from uq_handeye.read import pose_text

N = 6


@pytest.fixture
def poses():
    return uq.simulate(N, seed=4)


@pytest.fixture
def S(rng):
    return random_covariance(rng, shape=(N,))


def csv(T, columns, numbers, scale=1.0):
    """Pose file with further columns."""
    T = T.copy()
    T[:, :3, 3] *= scale
    lines = pose_text(T).splitlines()
    rows = [f"{line},{','.join(map(repr, row))}" for line, row in zip(lines[1:], numbers.tolist(), strict=True)]
    return "\n".join([f"{lines[0]},{','.join(columns)}", *rows, ""])


def read(tmp_path, poses, text, name="camera.csv", **options):
    uq.write_pose_file(tmp_path / "robot.csv", poses.robot)
    (tmp_path / name).write_text(text)
    return uq.read_poses(tmp_path / "robot.csv", tmp_path / name, **options)


def notes_of(found):
    return " ".join(note for source in found.sources for note in source.notes)


UPPER = np.triu_indices(6)
ROS = [f"pose.covariance[{k}]" for k in range(36)]
AXES = ("x", "y", "z", "roll", "pitch", "yaw")


@pytest.mark.parametrize(
    ("columns", "convention", "upper"),
    [
        ([f"cov_{k}" for k in range(36)], "toolkit", False),
        ([f"covariance{k + 1}" for k in range(36)], "toolkit", False),
        ([f"cov_{k}" for k in range(21)], "toolkit", True),
        ([f"cov_{i}{j}" for i, j in zip(*UPPER, strict=True)], "toolkit", True),
        ([f"cov_{i + 1}{j + 1}" for i in range(6) for j in range(6)], "toolkit", False),
        (ROS, "ros", False),
        ([f"field.pose.covariance{k}" for k in range(36)], "ros", False),
        ([f"cov_{AXES[i]}_{AXES[j]}" for i, j in zip(*UPPER, strict=True)], "ros", True),
    ],
)
def test_columns_of_a_table(tmp_path, poses, S, columns, convention, upper):
    numbers = uq.to_convention(S, poses.camera, convention)
    found = read(tmp_path, poses, csv(poses.camera, columns, numbers[:, *UPPER] if upper else numbers.reshape(N, 36)))
    np.testing.assert_allclose(found.camera_covariance.own, S, rtol=1e-8, atol=1e-15)
    assert found.camera_read_as == CovarianceReading(convention)
    assert found.camera_known
    assert not found.intrinsics_covered
    assert f"covariances of the poses, read as {convention}" in notes_of(found)
    np.testing.assert_array_equal(
        found.rows(np.array([1, 4])).camera_covariance.own, found.camera_covariance.own[[1, 4]]
    )


def test_other_columns_are_no_covariance():
    assert covariance_columns([f"cov_{k}" for k in range(20)]) is None
    assert covariance_columns([f"cov_{k}" for k in (*range(20), 40)]) is None
    assert covariance_columns(["cov_x_x", "cov_y_y"]) is None
    assert covariance_columns(["recovery_1", "x"]) is None


def test_convention_unit_and_direction(tmp_path, poses, S):
    """Inverse poses in mm, with the information matrix of gtsam in mm of the inverse pose."""
    inverse = np.linalg.inv(poses.camera)
    of_inverse = uq.covariance_of_inverse(poses.camera, S)
    in_mm = np.diag([1, 1, 1, 1e3, 1e3, 1e3])
    numbers = np.linalg.inv(in_mm @ uq.to_convention(of_inverse, inverse, "gtsam") @ in_mm)
    text = csv(inverse, [f"cov_{k}" for k in range(36)], numbers.reshape(N, 36), 1e3)
    how = {"units": (None, "mm"), "camera_frame": "target_T_camera"}
    found = read(tmp_path, poses, text, covariance_convention="gtsam,information", **how)
    np.testing.assert_allclose(found.camera, poses.camera, atol=1e-9)
    np.testing.assert_allclose(found.camera_covariance.own, S, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("unknown", [0.0, -1.0])
def test_unknown_covariances_are_not_used(tmp_path, poses, S, unknown):
    numbers = uq.to_convention(S, poses.camera, "ros").reshape(N, 36)
    numbers[2] = 0.0
    numbers[2, 0] = unknown
    found = read(tmp_path, poses, csv(poses.camera, ROS, numbers))
    assert found.camera_covariance is None
    assert "not known for every pose" in notes_of(found)


def test_numbers_that_are_no_covariance(tmp_path, poses, S):
    numbers = S.copy()
    numbers[:, 0, 1] += 1.0
    text = csv(poses.camera, ROS, numbers.reshape(N, 36))
    found = read(tmp_path, poses, text)
    assert found.camera_covariance is None
    assert "covariances are not used" in notes_of(found)
    with pytest.raises(uq.InputError, match=r"camera\.csv` to be symmetric"):
        read(tmp_path, poses, text, covariance_convention="ros")
    with pytest.raises(uq.InputError, match="Unknown convention"):
        read(tmp_path, poses, text, covariance_convention="tf")


def echoed(T, numbers):
    """Messages as ros2 topic echo prints them."""
    text = ""
    for k, (pose, S) in enumerate(zip(T, numbers, strict=True)):
        q = Rotation.from_matrix(pose[:3, :3]).as_quat()
        fields = [
            (name, "xyzw"[: len(values)], values) for name, values in (("position", pose[:3, 3]), ("orientation", q))
        ]
        text += f"header:\n  stamp:\n    sec: {k}\n    nanosec: 0\n  frame_id: camera\npose:\n  pose:\n"
        for name, axes, values in fields:
            text += f"    {name}:\n" + "".join(
                f"      {a}: {v!r}\n" for a, v in zip(axes, values.tolist(), strict=True)
            )
        text += "  covariance:\n" + "".join(f"  - {x!r}\n" for x in S.ravel().tolist()) + "---\n"
    return text


def test_messages_of_ros(tmp_path, poses, S):
    numbers = uq.to_convention(S, poses.camera, "ros")
    found = read(tmp_path, poses, echoed(poses.camera, numbers), "camera.txt", pair="rows")
    np.testing.assert_allclose(found.camera_covariance.own, S, rtol=1e-8, atol=1e-15)
    assert found.camera_read_as.convention == "ros"
    unknown = read(tmp_path, poses, echoed(poses.camera, 0 * numbers), "camera.txt", pair="rows")
    assert unknown.camera_covariance is None


def test_lines_of_ros_csv(tmp_path, poses, S):
    numbers = uq.to_convention(S, poses.camera, "ros").reshape(N, 36)
    q = Rotation.from_matrix(poses.camera[:, :3, :3]).as_quat()
    table = np.hstack([poses.camera[:, :3, 3], q, numbers])
    text = "".join(f"{k},0,camera,{','.join(map(repr, row))}\n" for k, row in enumerate(table.tolist()))
    found = read(tmp_path, poses, text, "camera.txt", pair="rows")
    np.testing.assert_allclose(found.camera_covariance.own, S, rtol=1e-8, atol=1e-15)


@pytest.mark.slow
def test_they_are_used_and_stored(tmp_path):
    """The covariance is that of the camera poses, the robot's noise is estimated, and the result remembers both."""
    S = np.tile(np.diag([1e-6, 4e-6, 2e-6, 1e-7, 3e-7, 9e-7]), (20, 1, 1))
    noise = uq.PoseNoise(np.diag([1e-7] * 3 + [2.5e-9] * 3), S)
    poses = uq.simulate(20, noise=noise, seed=3)
    numbers = uq.to_convention(S, poses.camera, "ros").reshape(20, 36)
    data = read(tmp_path, poses, csv(poses.camera, ROS, numbers))
    result = uq.calibrate(data, shared=[])
    np.testing.assert_allclose(result.noise.camera.own, S, rtol=1e-8)
    assert result.noise_estimate.camera_known
    again = type(result).from_dict(json.loads(result.to_json()))
    assert again.data.camera_read_as == CovarianceReading("ros")
    first = uq.calibrate(data)
    assert {error.name for error in first.shared} >= {"focal length"}
    updated = uq.update(uq.calibrate(data[:14]), data[14:])
    assert updated.data.camera_read_as == CovarianceReading("ros")
    assert {error.name for error in updated.shared} == {error.name for error in first.shared}
