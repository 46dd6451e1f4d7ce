"""Each command once, on small data: exit status, and a word of what it prints. Other tests look at what it does."""

import numpy as np
import pytest
from fixtures.commands import MODEL, NOISE, run
from fixtures.streams import motion, streams
from support import SEED

import uq_handeye as uq
from uq_handeye.cli import app
from uq_handeye.read import write_pose_file

FILES = ("robot.csv", "camera.csv")
# Arguments, exit status and words; commands that need pictures, bags or a browser refuse what is missing or wrong.
CALLS = {
    "calibrate": ((*FILES, *NOISE), 0, "gripper_T_camera"),
    "live": (("session", "--tolerance", "soft"), 2, "tolerance"),
    "demo": ((), 0, "demo_report.html"),
    "camera": (("nothing.png", "--board", "9x6", "--square", "20mm"), 2, "nothing.png"),
    "scene": (("nothing*.png",), 2, "nothing"),
    "points": (("nothing.csv", "--target", "nothing.csv"), 2, "nothing.csv"),
    "sync": (("timed_robot.csv", "timed_camera.csv"), 0, "offset"),
    "bag": (("nothing.bag",), 2, "nothing.bag"),
    "view": (("nothing.json",), 2, "nothing.json"),
    "report": (("result.json", "report.html", "--no-compare"), 0, "report.html"),
    "export": (("result.json", "x.urdf"), 0, "x.urdf"),
    "predict": (("result.json", "--robot", "robot.csv", "--camera"), 0, "mm"),
    "check": (("result.json", "new_robot.csv", "new_camera.csv"), 0, "UNCHANGED"),
    "update": (("result.json", "new_robot.csv", "new_camera.csv"), 0, "gripper_T_camera"),
    "diff": (("result.json", "new_result.json"), 0, "mm"),
    "verify": (("result.json", "nothing.csv"), 2, "nothing.csv"),
    "certificate": (("result.json", "certificate.json"), 0, "certificate.json"),
    "plan": ((*FILES, *NOISE, "-k", 1), 0, "1 more pose"),
    "compare": ((*FILES, *NOISE, "--methods", "park,shah"), 0, "park"),
    "validate": ((*FILES, *NOISE, "--method", "4dpa", "--trials", 100, "--workers", 1), 0, "100 trials"),
    "cross-check": ((*FILES, *NOISE, "--trials", 100, "--no-posterior", "--workers", 1), 0, "trials"),
    "posterior": ((*FILES, *NOISE, "--samples", 400, "--walkers", 32), 0, "Posterior"),
    "simulate": (("-o", "again", "--poses", 5), 0, "again"),
    "codegen": (("--list",), 0, "solve_4dpa"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Poses, other poses of the same rig, streams of poses with times, and results."""
    folder = tmp_path_factory.mktemp("every")
    poses = uq.simulate(24, noise=MODEL, seed=3)
    for name, rows in (("", slice(12)), ("new_", slice(12, 24))):
        write_pose_file(folder / f"{name}robot.csv", poses.robot[rows])
        write_pose_file(folder / f"{name}camera.csv", poses.camera[rows])
        found = uq.calibrate(uq.PosePairs(poses.robot[rows], poses.camera[rows]), noise=MODEL)
        found.to_json(folder / f"{name}result.json")
    rng = np.random.default_rng(SEED)
    *_, robot, camera = streams(rng, motion(rng, 6.0), 0.02, 6.0)
    for name, stream in (("robot", robot), ("camera", camera)):
        write_pose_file(folder / f"timed_{name}.csv", stream.poses, stream.timestamps)
    return folder


@pytest.mark.parametrize("command", CALLS)
def test_each_command(folder, command):
    arguments, status, words = CALLS[command]
    done = run(command, *arguments, cwd=folder)
    assert done.returncode == status, done.stdout + done.stderr
    assert words in done.stdout + done.stderr


def test_all_commands_are_here():
    assert set(CALLS) == {name for group in app.COMMANDS.values() for name in group}
