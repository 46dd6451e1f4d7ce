"""Joints and a chain beside the folder of a calibrated camera, and beside pictures."""

import json

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.pictures import simulated_rig, write_pictures
from scipy import stats
from scipy.spatial.transform import Rotation
from support import CONFIDENCE, SEED, difference

from uq_handeye.model.camera.corners_file import corners_text
from uq_handeye.model.camera.description import Board
from uq_handeye.read import read_poses

pytestmark = pytest.mark.slow

FAR = stats.chi2.ppf(CONFIDENCE, 6)
NAMES = ("x", "y", "z", "yaw", "pitch", "roll")
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1", "yaw": "0 0 1", "pitch": "0 1 0", "roll": "1 0 0"}
LIMIT = "<limit lower='-5' upper='5'/>"
# A gantry with a wrist: its joints are known for any pose.
GANTRY = "".join(
    [
        "<robot name='gantry'><link name='base'/>",
        *(
            f"<link name='{name}_link'/><joint name='{name}' type='{'prismatic' if k < 3 else 'continuous'}'>"
            f"<parent link='{'base' if k == 0 else NAMES[k - 1] + '_link'}'/><child link='{name}_link'/>"
            f"<axis xyz='{AXES[name]}'/>{LIMIT if k < 3 else ''}</joint>"
            for k, name in enumerate(NAMES)
        ),
        "</robot>",
    ]
)
CHAIN = ("--joints", "joints.csv", "--urdf", "gantry.urdf", "--kinematics", "exact", "--json")


def write_arm(folder, robot):
    turns = Rotation.from_matrix(robot[:, :3, :3]).as_euler("ZYX")
    rows = np.column_stack([robot[:, :3, 3], turns]).tolist()
    (folder / "joints.csv").write_text("\n".join([",".join(NAMES), *(",".join(map(repr, row)) for row in rows)]) + "\n")
    (folder / "gantry.urdf").write_text(GANTRY)


def squared_distance(done, X):
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    xi = difference(X, np.array(found["X"]))
    return xi @ np.linalg.solve(np.array(found["covariance"]), xi), found


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """The folder camera of uq-handeye camera, joints.csv, and X."""
    folder = tmp_path_factory.mktemp("gantry")
    poses, corners = simulated_rig(Board(9, 6, 0.02), np.random.default_rng([SEED, 10]), n=16)
    (folder / "corners.csv").write_text(corners_text(corners, np.ones(corners.m, dtype=bool)))
    write_arm(folder, poses.robot)
    command = ("camera", "corners.csv", "--image-size", "640x480", "--model", "pinhole", "-o", "camera")
    assert run(*command, cwd=folder).returncode == 0
    return folder, poses.truth.X


@pytest.mark.slow
def test_folder_of_a_camera(table):
    folder, X = table
    d2, found = squared_distance(run("calibrate", "camera", *CHAIN, cwd=folder), X)
    assert d2 < FAR and found["n_poses"] == 16
    assert found["provenance"]["sources"][0]["name"] == "joints.csv"


@pytest.mark.slow
def test_rows_of_the_joints_are_those_of_the_pictures(table, tmp_path):
    folder, _ = table
    rows = (folder / "joints.csv").read_text().splitlines()
    (tmp_path / "joints.csv").write_text("\n".join(rows[:-3]) + "\n")
    done = run("calibrate", folder / "camera", "--joints", "joints.csv", "--urdf", folder / "gantry.urdf", cwd=tmp_path)
    assert done.returncode == 2
    assert "joints.csv has 13 rows and" in done.stderr and "16 pictures" in done.stderr


@pytest.mark.slow
def test_joints_travel_with_the_corners(table):
    from uq_handeye import Kinematics

    folder, _ = table
    arm = Kinematics.from_urdf(folder / "gantry.urdf")
    poses = read_poses(None, folder / "camera", joints=folder / "joints.csv", kinematics=arm)
    np.testing.assert_allclose(arm.poses(poses.joints), poses.robot, rtol=0, atol=1e-12)
    some = poses.rows(np.arange(0, 16, 3))
    np.testing.assert_allclose(arm.poses(some.joints), some.robot, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_pictures_and_joints_alone(tmp_path):
    """No file of poses at all: pictures, a board, joints and an arm."""
    pytest.importorskip("cv2")
    poses = write_pictures(tmp_path, Board(9, 6, 0.02), np.random.default_rng([SEED, 11]), n=8)
    write_arm(tmp_path, poses.robot)
    board = ("--images", "img/*.png", "--board", "9x6", "--square", "20mm", "--model", "pinhole")
    d2, found = squared_distance(run("calibrate", *board, *CHAIN, cwd=tmp_path), poses.truth.X)
    assert d2 < FAR and found["n_poses"] == 8
    timed = [line.split(",", 1) for line in (tmp_path / "robot.csv").read_text().splitlines()]
    (tmp_path / "alone.csv").write_text("".join(f"{pose}\n" for _, pose in timed))
    alone = run("calibrate", "alone.csv", *board, *CHAIN, cwd=tmp_path)  # ROBOT, as CAMERA are the pictures
    assert squared_distance(alone, poses.truth.X)[0] == pytest.approx(d2, rel=1e-3)
    # Beside timestamps camera and target may drift.
    both = squared_distance(run("calibrate", "robot.csv", *board, *CHAIN, cwd=tmp_path), poses.truth.X)[1]
    drifts = {part["name"] for part in both["noise_estimate"]["of_model"] if part["name"].startswith("drift")}
    assert drifts == {"drift of the camera", "drift of the target"}
    apart = difference(np.array(both["X"]), np.array(found["X"]))
    assert apart @ np.linalg.solve(np.array(both["covariance"]), apart) < 1.0
