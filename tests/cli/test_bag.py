"""Bags on the command line: the listing, the command it prints, and X with its covariance."""

import json
import re
import shlex
import sys

import numpy as np
import pytest
from fixtures.arms import SIX_AXES
from fixtures.bags import START, Writer, pixels_of
from fixtures.commands import run
from fixtures.streams import motion
from support import moved, random_transforms

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import logarithm
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.read import read_stream
from uq_handeye.read.rosbag.streams import read_bag

SIDE, OFFSET = 0.08, 0.03
# Of the robot's poses (rad, m), and of the pixels.
ROBOT, PIXEL = (2e-4, 1e-4), 0.2


@pytest.fixture(name="cell", scope="module")
def fixture_cell(tmp_path_factory):
    """Write a cell that moves: tf of the robot with a static flange, tags by corners, joints; return X and the file."""
    folder, rng = tmp_path_factory.mktemp("bag"), np.random.default_rng(17)
    X, W = random_transforms(rng, (2,))
    sway = motion(rng, 8.0, turn=0.25, shift=0.05)
    face = np.eye(4)
    face[:3, :3], face[:3, 3] = np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.4]
    first = sway(np.zeros(1))[0]
    seen = lambda t: face @ np.linalg.inv(first) @ sway(t)  # noqa: E731
    flange = random_transforms(rng, (1,))[0]
    fast, slow = np.arange(0.0, 8.0, 0.02), np.arange(0.5, 7.5, 0.1)
    G = W @ np.linalg.inv(seen(fast)) @ np.linalg.inv(X) @ np.linalg.inv(flange)
    G = moved(G, rng.normal(size=(len(G), 6)) * np.repeat(ROBOT, 3))
    C = seen(slow)
    visible = (C[:, 2, 3] > 0.2) & (C[:, 2, 2] < -0.5) & (np.abs(C[:, :2, 3]) < 0.2).all(axis=1)
    pixels = pixels_of(C, SIDE, PIXEL, rng)
    with Writer(folder, "mcap") as bag:
        bag.tf(START, ("wrist", "tool0", flange), static=True)
        for t, T in zip(fast, G, strict=True):
            bag.tf(START + OFFSET + t, ("base_link", "wrist", T))
            if round(t * 100) % 8 == 0:
                bag.joints("/joint_states", START + t, ["a", "b"], [t, -t])
        for t, p in zip(slow[visible], pixels[visible], strict=True):
            bag.camera_info("/camera/camera_info", START + t, "cam")
            bag.detections("/detections", START + t, "cam", [(0, p)])
    return X, next(bag.path.glob("*.mcap"))


ASKED = ("--robot", "base_link:tool0", "--camera", "cam:tag36h11_0", "--tag", "80mm")


@pytest.mark.slow
def test_the_listing_and_its_command(cell):
    X, path = cell
    done = run("bag", path)
    assert (done.returncode, done.stderr) == (0, "")
    for words in (
        r"/tf +tf2_msgs/TFMessage +400 +transforms",
        r"base_link:wrist +400 poses",
        r"wrist:tool0 +static",
        r"cam:tag36h11_0 +\d+ detections in /detections",
        r"/camera/camera_info +cam, 1280 x 720 px, fx 900, fy 900, cx 640, cy 360, rectified",
        r"/joint_states +100 rows of a, b",
    ):
        assert re.search(words, done.stdout), words
    command = shlex.split(done.stdout.splitlines()[-1].replace("LENGTH", "80mm"))
    assert command[:2] == ["uq-handeye", "calibrate"] and tuple(command[4:]) == ASKED
    found = run(*command[1:], "--json")
    assert found.returncode == 0, found.stderr
    result = json.loads(found.stdout)
    result_X, covariance = np.array(result["X"]), np.array(result["covariance"])
    error = np.concatenate([logarithm(result_X[:3, :3] @ X[:3, :3].T), result_X[:3, 3] - X[:3, 3]])
    assert error @ np.linalg.solve(covariance, error) < 25  # chi-square of 6, one in 3000
    assert np.abs(error[3:]).max() < 2e-3
    plain = json.loads(run("bag", path, "--json").stdout)
    assert plain["command"].split() == ["uq-handeye", "calibrate", "--bag", str(path), *ASKED[:-1], "LENGTH"]


@pytest.mark.slow
def test_tables_give_the_same_as_the_bag(cell, tmp_path):
    _, path = cell
    done = run("bag", path, *ASKED, "--joints", "/joint_states", "-o", tmp_path)
    assert done.returncode == 0
    said = f"Wrote camera_info.yaml, robot.csv, camera.csv and joints.csv to {tmp_path}"
    assert done.stdout.split() == said.split()
    assert (tmp_path / "joints.csv").read_text().splitlines()[0] == "timestamp,a,b"
    of_bag = read_bag(path, robot=ASKED[1], camera=ASKED[3], tag=SIDE)
    for name, stream in zip(("robot", "camera"), of_bag, strict=True):
        table = read_stream(tmp_path / f"{name}.csv", name)
        np.testing.assert_array_equal(table.timestamps, stream.timestamps)
        np.testing.assert_allclose(table.poses, stream.poses, rtol=0, atol=1e-14)
    half = run("calibrate", "--bag", path, *ASKED[:2], tmp_path / "camera.csv", "--json")  # and a file of the camera
    assert half.returncode == 0 and "base_link" in half.stderr


@pytest.mark.slow
def test_a_robot_whose_clock_starts_at_power_on(cell, tmp_path):
    X, path = cell
    assert run("bag", path, *ASKED[:2], "-o", tmp_path).returncode == 0
    header, *rows = (tmp_path / "robot.csv").read_text().splitlines()
    moved_rows = [f"{float(time) - START + 77!r},{rest}" for time, _, rest in (row.partition(",") for row in rows)]
    (tmp_path / "robot.csv").write_text("\n".join([header, *moved_rows]) + "\n")
    done = run("calibrate", "--bag", path, tmp_path / "robot.csv", *ASKED[2:], "--json")
    assert done.returncode == 0 and "no time in common; any clock offset is tried" in done.stderr
    np.testing.assert_allclose(json.loads(done.stdout)["X"], X, atol=5e-3)


def test_a_bag_that_holds_nothing(tmp_path):
    with Writer(tmp_path, "mcap") as bag:
        pass
    done = run("bag", bag.path)
    assert done.returncode == 2 and "the bag holds no messages" in done.stderr


@pytest.mark.slow
def test_poses_without_a_motion_that_shows_the_offset(tmp_path):
    """Six poses of equal stamps, one by one: pairs without an offset of clocks, and that is said."""
    poses = uq.simulate(6, seed=5)
    with Writer(tmp_path, "mcap") as bag:
        for k in range(6):
            bag.tf(START + k, ("base", "tool0", poses.robot[k]), ("camera", "tag", poses.camera[k]))
    done = run("calibrate", "--bag", bag.path, "--robot", "base:tool0", "--camera", "camera:tag", "--json")
    assert done.returncode == 0 and "those of one stamp are pairs, and no clock offset is estimated" in done.stderr
    np.testing.assert_allclose(json.loads(done.stdout)["X"], poses.truth.X, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--robot", "base_link:tool0"], "--bag needs --camera OPTICAL_FRAME:TARGET. uq-handeye bag "),
        ([], "--bag needs --robot BASE:TOOL and --camera"),
        ([*ASKED, "camera.csv"], "both sides are given twice"),
        ([*ASKED[:4]], "Give the side of its black square, e.g. --tag 40mm"),
        ([*ASKED, "--pair", "time"], "poses of a --bag are interpolated"),
        ([*ASKED, "--units", "robot=mm"], "--units: for pose files, not for --bag"),
        ([*ASKED[:4], "--images", "*.png", "--board", "9x6", "--square", "2cm"], "--images with --bag"),
        (["--robot", "base:tool", *ASKED[2:]], "There is no frame base in the transforms. Did you mean base_link"),
        (["--robot", "/joint_states", *ASKED[2:]], "holds joint values. Give the robot model, --urdf robot.urdf"),
    ],
)
def test_what_does_not_fit_is_one_line(cell, arguments, expected):
    done = run("calibrate", "--bag", cell[1], *arguments)
    assert done.returncode == 2 and expected in done.stderr
    assert done.stderr.splitlines()[-1].startswith("uq-handeye: error:") and "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_bag_in_place_of_pose_files(cell):
    for path in (cell[1], cell[1].parent):
        done = run("calibrate", path, path)
        assert (
            done.returncode == 2 and f"{path} is a ROS bag: give it " in done.stderr and "uq-handeye bag" in done.stderr
        )


@pytest.mark.slow
def test_options_without_a_bag(tmp_path):
    for arguments, expected in (
        (["--camera", "cam:tag"], "--camera needs --bag FILE"),
        (["--still"], "--still needs --bag FILE"),
        (["--robot", "base:tool0"], "names the robot in a bag, or poses beside --joints. Add --bag FILE"),
    ):
        done = run("calibrate", *arguments)
        assert done.returncode == 2 and expected in done.stderr
    for arguments, expected in (
        (["--robot", "base:tool0"], "the tables need a folder. Add -o DIR"),
        (["-o", tmp_path], "-o writes tables. Add --robot, --camera or --joints"),
        (["--tag", "40mm"], "--tag needs --camera"),
    ):
        done = run("bag", "cell.mcap", *arguments)
        assert done.returncode == 2 and expected in done.stderr


def test_without_the_extra_one_line_says_how_to_get_it(cell, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    done = run("bag", cell[1])
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "pip install '.[rosbag]'" in done.stderr


@pytest.mark.slow
def test_joint_values_of_the_bag_with_the_robot_model(tmp_path):
    arm, rng = Kinematics.from_urdf(SIX_AXES, tip="tool0"), np.random.default_rng(2)
    X, W = random_transforms(rng, (2,))
    phase = rng.uniform(0, 6, (2, 6))
    joints = lambda t: 0.5 * np.sin(0.9 * t[:, None] + phase[0]) + 0.2 * np.sin(2.1 * t[:, None] + phase[1])  # noqa: E731
    fast, slow = np.arange(0.0, 6.0, 0.04), np.arange(0.5, 5.5, 0.15)
    C = np.linalg.inv(X) @ np.linalg.inv(arm.poses(joints(slow))) @ W
    C = moved(C, rng.normal(size=(len(C), 6)) * np.repeat((5e-4, 2e-4), 3))
    names = [joint.name for joint in arm.joints]
    (tmp_path / "robot.urdf").write_text(SIX_AXES)
    with Writer(tmp_path, "mcap") as bag:
        for t, q in zip(fast, joints(fast), strict=True):
            bag.joints("/joint_states", START + t - 0.01, ["finger"], [0.02])
            bag.joints("/joint_states", START + t, names[::-1], q[::-1])
        for t, T in zip(slow, C, strict=True):
            bag.pose_stamped("/marker", START + t, "cam", T)
    asked = ("--bag", bag.path, "--camera", "/marker", "--urdf", tmp_path / "robot.urdf", "--tip", "tool0")
    done = run("calibrate", *asked, "--robot", "/joint_states", "--kinematics", "exact", "--json")
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(json.loads(done.stdout)["X"], X, atol=1e-3)
    for spec, words in (
        ("/marker", "does not reach"),  # poses, but not of this arm
        (None, "--urdf, --tip with --bag: add --robot TOPIC"),
    ):
        wrong = run("calibrate", *asked, *(() if spec is None else ("--robot", spec)))
        assert wrong.returncode == 2 and words in wrong.stderr
