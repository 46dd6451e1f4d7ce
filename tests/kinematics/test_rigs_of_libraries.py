"""Rigs whose robot poses are those of another library's kinematics, in files as its users write them: X is right.

The poses are stored (`poses_of_libraries.py`): FANUC's by crx-kinematics, at joints as the pendant shows them; those of
Universal Robots by ur-analytic-ik; Franka's by frankik, at the tool point of the hand.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation
from support import CONFIDENCE, SEED, difference

import uq_handeye as uq
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.read import read_poses, write_pose_file

RIGS = json.loads(Path(__file__).with_name("poses_of_libraries.json").read_text(encoding="utf-8"))["rigs"]
# Columns of the joints as the library's users would record them.
COLUMNS = {
    "crx10ia": [f"J{k}" for k in range(1, 7)],
    "ur15": [f"actual_q_{k}" for k in range(6)],
    "panda": [f"q[{k}]" for k in range(7)],
}
CAMERA = (1e-3, 3e-4)  # noise, rad and m
X, W = np.eye(4), np.eye(4)
X[:3, :3], X[:3, 3] = Rotation.from_rotvec([0.2, -0.1, 0.4]).as_matrix(), [0.05, 0.02, 0.08]
W[:3, :3], W[:3, 3] = Rotation.from_rotvec([2.8, 0.3, 0.4]).as_matrix(), [0.8, 0.1, 0.1]


def files(folder, name, rng):
    """Write joints, the library's poses and camera poses with noise."""
    G = np.tile(np.eye(4), (len(RIGS[name]["poses"]), 1, 1))
    G[:, :3] = RIGS[name]["poses"]
    seen = np.linalg.inv(G @ X) @ W
    seen[:, :3, :3] @= Rotation.from_rotvec(CAMERA[0] * rng.normal(size=(len(G), 3))).as_matrix()
    seen[:, :3, 3] += CAMERA[1] * rng.normal(size=(len(G), 3))
    write_pose_file(folder / "camera.csv", seen)
    write_pose_file(folder / "robot.csv", G)
    header = ",".join(COLUMNS[name])
    np.savetxt(folder / "joints.csv", RIGS[name]["joints"], delimiter=",", header=header, comments="", fmt="%.6f")


def calibrated(folder, name, robot=None):
    arm = Kinematics.from_name(name)
    of_arm = {"joints": folder / "joints.csv", "kinematics": arm, "joint_units": "deg"}
    poses = read_poses(robot, folder / "camera.csv", **of_arm)
    noise = uq.PoseNoise.isotropic(None, CAMERA)
    errors = uq.KinematicErrors("exact")
    return uq.calibrate(poses, noise=noise, shared=[], kinematics=arm, kinematic_errors=errors)


def squared_distance(result, true):
    off = difference(true, result.X)
    return off @ np.linalg.solve(result.covariance, off)


@pytest.mark.slow
@pytest.mark.parametrize("beside", [False, True], ids=["joints", "joints beside poses"])
@pytest.mark.parametrize("name", RIGS)
@pytest.mark.filterwarnings("ignore:The target is ahead")  # targets anywhere
def test_x_is_that_of_the_library(tmp_path, name, beside):
    files(tmp_path, name, np.random.default_rng([SEED, 3]))
    result = calibrated(tmp_path, name, tmp_path / "robot.csv" if beside else None)
    true = X
    if name == "panda" and not beside:  # X is then in the flange, which is behind the hand
        T = np.linalg.inv(Kinematics.from_name(name).poses(np.radians(RIGS[name]["joints"][0])))
        true = T @ np.vstack([RIGS[name]["poses"][0], [0, 0, 0, 1]]) @ X
    assert squared_distance(result, true) < stats.chi2.ppf(CONFIDENCE, 6)
    text = " ".join(result.summary().split())
    assert ("gripper frame, 103 mm, 45 deg from that of the model" in text) == (name == "panda" and beside)
    assert ("Joint 3 is read as FANUC's pendant shows it" in text) == (name == "crx10ia")
