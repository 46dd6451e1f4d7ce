"""``check``: answer, exit status, files and refusals."""

import json

import numpy as np
import pytest
from fixtures.commands import MODEL, run

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.read import write_pose_file
from uq_handeye.trials.simulation.rig import RIGS


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    at = tmp_path_factory.mktemp("check")
    old = uq.simulate(15, noise=MODEL, seed=3)
    uq.calibrate(old, noise=MODEL).to_json(at / "result.json")
    moved = perturb(RIGS["eye-in-hand"][0], np.array([0, 0, 0.02, 0.004, 0, 0]))
    for name, poses in (
        ("old", old),
        ("same", uq.simulate(5, noise=MODEL, seed=4)),
        ("one", uq.simulate(1, noise=MODEL, seed=5)),
        ("moved", uq.simulate(5, noise=MODEL, seed=6, X=moved)),
    ):
        write_pose_file(at / f"{name}_robot.csv", poses.robot)
        write_pose_file(at / f"{name}_camera.csv", poses.camera)
    return at


def check(folder, name, *options):
    files = (folder / f"{name}_robot.csv", folder / f"{name}_camera.csv")
    return run("check", folder / "result.json", *files, *options)


def test_unchanged(folder):
    done = check(folder, "same")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("UNCHANGED: 5 new poses agree with the calibration of 15 poses")
    assert "Smallest change of X" in done.stdout
    assert check(folder, "one").returncode == 0


@pytest.mark.slow
def test_changed_with_files(folder):
    done = check(folder, "moved", "-o", folder / "out")
    assert done.returncode == 4
    assert "Cause: the camera moved on the gripper, or the robot's tool frame" in done.stdout
    assert len(done.stdout.splitlines()) <= 14
    lines = [line for line in done.stdout.splitlines() if not line.startswith("Wrote ")]  # its path may be long
    assert max(map(len, lines)) <= 80
    stored = json.loads((folder / "out" / "check.json").read_text())
    assert stored["cause"] == "X"
    assert stored["shift"][2] == pytest.approx(0.02, abs=0.004)
    done = check(folder, "moved", "--json")
    assert done.returncode == 4
    assert json.loads(done.stdout)["p_value"] < 1e-6
    done = check(folder, "moved", "-q")
    assert done.stdout.count("\n") <= 2


@pytest.mark.slow
def test_cannot_tell(folder):
    done = check(folder, "one", "--tolerance", "0.2mm")
    assert done.returncode == 3
    assert done.stdout.startswith("CANNOT TELL")
    done = check(folder, "same", "--units", "camera=mm")
    assert done.returncode == 3
    assert "--units camera=m)" in done.stdout
    done = check(folder, "same", "--only", "0-2")
    assert "3 new poses" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--setup", "eye-to-hand"), "setup"),
        (("--joints", "q.csv"), "holds no joints"),
        (("--board", "9x6"), "--images"),
        (("--level", "2"), "level"),
        (("--tolerance", "fast"), "tolerance"),
    ],
)
def test_refused_in_one_line(folder, options, says):
    done = check(folder, "same", *options)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert says in done.stderr


def test_poses_of_the_calibration_are_no_check(folder):
    done = check(folder, "old")
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "were used by the calibration itself" in done.stderr
    done = run("check", folder / "result.json", folder / "result.json")
    assert done.returncode == 2 and "is a result of uq-handeye; expected poses" in done.stderr


def test_pictures_need_a_camera(folder):
    done = run("check", folder / "result.json", folder / "same_robot.csv", "--images", "x*.png")
    assert done.returncode == 2
    assert "holds no camera" in done.stderr
