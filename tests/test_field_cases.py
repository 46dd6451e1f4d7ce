"""Files in the structure in which people have them: each is read and right, or refused with the true reason."""

import json
import os
import shlex
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uq_handeye.cli.app import main

CASES = Path(os.environ.get("UQ_HANDEYE_DATA", "")) / "field_cases"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CASES.is_dir(), reason="UQ_HANDEYE_DATA is not set, or has no field_cases"),
]
HAND = "--setup eye-to-hand"
# Folder, command, largest error (mm, deg), and words that the output has.
RIGHT = [
    ("01", "robot_rvec_t.txt camera_rvec_t.txt", 1.0, 0.1, ["rotation before translation", "next best"]),
    ("02", "robot camera.csv", 1.5, 0.15, ["xyz-deg, mm, rotation before translation"]),
    ("03", "TransformPairs.yml", 1.0, 0.1, ["robot poses from T1"]),
    ("05", "robot_data.yaml marker_data.yaml", 1.5, 0.15, []),
    ("06", "hand_eye.csv", 1.2, 0.12, ["xyz-deg"]),
    ("07", "robot_poses.yaml camera.csv", 1.2, 0.12, ["lengths in mm"]),
    ("08", "odometry.csv camera.csv", 1.2, 0.12, []),
    ("09", "robot_poses.npz camera.csv", 1.2, 0.12, ["robot_pose_read_from_robot"]),
    ("11", f"pose camera.csv {HAND}", 2.0, 0.1, ["xyzw", "11, 5"]),
    ("12", "location.txt camera_18mm.csv", 8.0, 0.7, ["xyz-rad, mm"]),
    ("13", f"end2base_xyzrxryrz.csv board2cam_xyzrxryrz.csv {HAND}", 0.7, 0.07, ["xyz-deg", "26 of 220"]),
    ("15", "gimbal.csv camera.csv", 3.0, 0.1, []),
    ("24", "robot.csv camera.csv", 1.5, 0.15, ["X is the identity"]),
    ("26", "robot_25.csv camera_25.csv", 7.0, 0.4, ["rotate more"]),
]
REFUSED = [
    ("11", "pose camera.csv", 3, ["the setup seems to be eye-to-hand"]),
    ("12", "location.txt camera_25mm.csv", 3, ["xyz-rad, mm", "0.718 times as large"]),
    ("25", "robot_same.csv camera.csv", 3, ["robot poses are all the same"]),
    ("25", "robot_same_noheader.txt camera_noheader.txt", 2, ["all 25 poses are the same"]),
    ("25", "robot_24.csv camera.csv", 2, ["row 9 (line 11", "has no partner"]),
]
ALL = "--known 'target x = 31mm +- 1mm' --known 'target y = -22mm +- 1mm' --known 'target z = 50mm +- 1mm'"


def _run(number, command, output, monkeypatch, capsys):
    """Return status, printed text and X of a command in the folder of a case."""
    (folder,) = CASES.glob(f"{number}_*")
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit) as done:
        main(["calibrate", *shlex.split(command), "-o", str(output)])
    said = capsys.readouterr()
    result = output / "result.json"
    X = np.array(json.loads(result.read_text())["X"]) if result.is_file() else None
    return done.value.code, " ".join((said.out + said.err).split()), X, folder


def _error(X, folder):
    """Return the distance (mm) and the angle (deg) of X from the truth of a case."""
    row = np.loadtxt(folder / "truth.csv", delimiter=",", skiprows=1, ndmin=2)[0]
    turn = Rotation.from_quat(row[4:8]).as_matrix().T @ X[:3, :3]
    return 1e3 * np.linalg.norm(X[:3, 3] - row[1:4]), np.degrees(np.linalg.norm(Rotation.from_matrix(turn).as_rotvec()))


@pytest.mark.parametrize(("number", "command", "mm", "deg", "words"), RIGHT, ids=lambda value: str(value)[:30])
def test_files_are_read_and_x_is_right(number, command, mm, deg, words, tmp_path, monkeypatch, capsys):
    status, text, X, folder = _run(number, command, tmp_path, monkeypatch, capsys)
    assert status == 0, text
    move, turn = _error(X, folder)
    assert move < mm and turn < deg
    assert [word for word in words if word not in text] == []


@pytest.mark.parametrize(("number", "command", "status", "words"), REFUSED, ids=lambda value: str(value)[:30])
def test_files_are_refused_with_the_reason(number, command, status, words, tmp_path, monkeypatch, capsys):
    found, text, _, _ = _run(number, command, tmp_path, monkeypatch, capsys)
    assert found == status
    assert [word for word in words if word not in text] == []


@pytest.mark.parametrize("files", ["imu.csv camera.csv", "imu_q.csv camera_q.csv", "rotonly.npz"])
def test_rotations_alone(files, tmp_path, monkeypatch, capsys):
    status, text, X, folder = _run("14", files, tmp_path, monkeypatch, capsys)
    assert status == 6 and "no positions were given" in text
    assert _error(X, folder)[1] < 0.12


def test_a_gantry_and_what_is_known_of_its_target(tmp_path, monkeypatch, capsys):
    files = f"gantry_robot.csv gantry_cam.csv {HAND}"
    status, text, X, folder = _run("16", files, tmp_path / "a", monkeypatch, capsys)
    assert status == 6 and "--known" in text and _error(X, folder)[1] < 0.12
    one = f"{files} --known 'target z = 50mm +- 1mm'"
    status, _, X, folder = _run("16", one, tmp_path / "b", monkeypatch, capsys)
    assert status == 6 and abs(1e3 * X[2, 3] - 1230.0) < 3.0 and _error(X, folder)[1] < 0.12
    status, _, X, folder = _run("16", f"{files} {ALL}", tmp_path / "c", monkeypatch, capsys)
    move, turn = _error(X, folder)
    assert status == 0 and move < 3.0 and turn < 0.12
