"""Rig files: what is read, matching by timestamps, one line for what is wrong, the command."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.cli.app import main
from uq_handeye.rig.simulation import simulate_rig

RIG = """
[arms.arm]
poses = "robot.csv"
noise = ["0.5mrad", "0.3mm"]
[cameras.left]
on = "arm"
noise = ["0.5mrad", "0.3mm"]
[cameras.front]
on = "world"
noise = ["0.5mrad", "0.3mm"]
[targets.board]
on = "world"
[[views]]
camera = "left"
target = "board"
file = "left.csv"
[[views]]
camera = "front"
target = "board"
file = "front.csv"
"""


def write(path, names, poses):
    rows = np.column_stack([names, poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()])
    np.savetxt(path, rows, delimiter=",", header="timestamp,x,y,z,qx,qy,qz,qw", comments="", fmt="%.15g")


@pytest.fixture
def folder(tmp_path):
    noise = dict.fromkeys(("arm", "left", "front"), ("0.5mrad", "0.3mm"))
    rig, truth = simulate_rig({"left": "arm", "front": "world"}, {"board": "world"}, n_poses=20, noise=noise, seed=1)
    order = np.random.default_rng(0).permutation(20)
    write(tmp_path / "robot.csv", np.arange(20.0)[order], rig.arms["arm"].poses[order])  # rows in another order
    for view in rig.views:
        write(tmp_path / f"{view.camera}.csv", np.array(view.at, dtype=float)[:15], view.poses[:15])
    (tmp_path / "rig.toml").write_text(RIG)
    return tmp_path, truth


def test_rows_match_by_time_whatever_their_order(folder, capsys):
    path, truth = folder
    rig, noise = uq.read_rig(path / "rig.toml")
    result = uq.calibrate_rig(rig, noise)
    np.testing.assert_allclose(result.cameras["left"].X, truth["left"], atol=5e-3)
    assert result.dof == 6 * 30 - 18
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(path / "rig.toml"), "-o", str(path / "out")])
    assert ended.value.code == 0
    assert "world_T_front" in capsys.readouterr().out
    stored = json.loads((path / "out" / "rig.json").read_text())
    np.testing.assert_allclose(stored["cameras"]["left"]["pose"], result.cameras["left"].X, atol=1e-12)


def test_nearest_times_need_a_tolerance(folder):
    path, _ = folder
    text = (path / "left.csv").read_text().splitlines()
    text[1] = text[1].replace("0,", "0.01,", 1)
    (path / "left.csv").write_text("\n".join(text))
    with pytest.raises(uq.InputError, match=r"left\.csv names robot pose 0\.01, which the files of the arm 'arm'"):
        uq.read_rig(path / "rig.toml")
    (path / "rig.toml").write_text("tolerance = 0.02\n" + RIG)
    assert uq.read_rig(path / "rig.toml")[0].views[0].at[0] == 0.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('camera = "front"', 'camera = "back"', r"rig\.toml: front\.csv names the camera 'back'"),
        ('on = "world"\n[[views]]', 'on = ["arm", "world"]\n[[views]]', "'board' is on two things"),
        ("[cameras.front]", "[cameras.left]", r"rig\.toml: expected TOML"),
        ("noise", "nose", "got 'nose'"),
        ('on = "arm"', 'on = "robot"', "is on 'robot', which is none of world, arm"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_name_in_the_file(folder, old, new, message):
    path, _ = folder
    (path / "rig.toml").write_text(RIG.replace(old, new, 1))
    with pytest.raises(uq.InputError, match=message) as caught:
        uq.read_rig(path / "rig.toml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "option",
    [
        "--tolerance 1mm", "--seed 3", "--covariance jackknife", "--no-robust", "--prior-x x", "--report x.html",
        "--size robot accuracy=1mm", "--images x*.png", "--urdf arm.urdf",
    ],
)  # fmt: skip
def test_options_beside_a_rig_file_are_refused(folder, option, capsys):
    path, _ = folder
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(path / "rig.toml"), *option.split(" ", 1)])
    assert ended.value.code == 2 and capsys.readouterr().err
