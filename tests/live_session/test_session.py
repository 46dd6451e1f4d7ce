"""A session on disk: bit-equal to `calibrate` on its files, and nothing lost when it is killed."""

import io
import json
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.calibration.tolerance import Tolerance
from uq_handeye.read import write_pose_file
from uq_handeye.use.live_session.folder import Folder
from uq_handeye.use.live_session.json_lines import Lines, pair_of
from uq_handeye.use.live_session.question import Question
from uq_handeye.use.live_session.session import CHOICE, OWN, Session
from uq_handeye.use.live_session.sources import feed

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
POSES = uq.simulate(n_poses=14, noise=NOISE, seed=4)


def line(k, **more):
    return json.dumps({"robot": POSES.robot[k].tolist(), "camera": POSES.camera[k].tolist(), **more}) + "\n"


def taken(folder, n, **how):
    """Return a session with n poses, taken one by one."""
    session = Session(Folder(folder), **how)
    for k in range(n):
        session.add(POSES.robot[k], POSES.camera[k], ask=k >= n - 2)
    return session


@pytest.mark.slow
def test_an_answer_after_each_pose(tmp_path):
    session = Session(Folder(tmp_path / "new"))
    said = [session.add(POSES.robot[k], POSES.camera[k]).lines[0] for k in range(5)]
    assert [text.partition(":")[0] for text in said] == ["1 pose", "2 poses", "3 poses", "4 poses", "5 poses"]
    before, after = session.brought()
    assert after < before and session.curve == [(n, session._sizes[n, ()]) for n in (3, 4, 5)]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_the_same_bits_as_calibrate_on_the_same_files(tmp_path):
    session = taken(tmp_path, 14)
    again = uq.calibrate(uq.read_poses(tmp_path / OWN))
    np.testing.assert_array_equal(session.answer.result.X, again.X)
    np.testing.assert_array_equal(session.answer.result.covariance, again.covariance)
    session.leave_out(3, 5)
    without = uq.calibrate(uq.read_poses(tmp_path / OWN), exclude=[3, 5])
    np.testing.assert_array_equal(session.answer.result.X, without.X)
    session.take_back(3)
    assert session.undo().left_out == (3, 5) and session.undo().left_out == ()
    np.testing.assert_array_equal(session.answer.result.X, again.X)


@pytest.mark.slow
def test_growing_files_of_another_program(tmp_path):
    session = Session(Folder(tmp_path), Question(tolerance=Tolerance.read("5mm,1deg")))
    for k in (2, 9, 14):
        write_pose_file(tmp_path / "robot.csv", POSES.robot[:k])
        write_pose_file(tmp_path / "camera.csv", POSES.camera[: k - (k == 9)])
        session.update()
        assert session.answer.n == k - (k == 9)
    expected = uq.calibrate(uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera.csv"))
    np.testing.assert_array_equal(session.answer.result.X, expected.X)
    assert session.answer.passed and session.answer.ahead is None
    with pytest.raises(uq.InputError, match=r"holds camera\.csv of another program, so no pose is added here"):
        session.add(POSES.robot[0], POSES.camera[0])


@pytest.mark.slow
def test_what_is_left_out_is_remembered(tmp_path):
    taken(tmp_path, 8).leave_out(2)
    session = Session(Folder(tmp_path))
    assert session.update().left_out == (2,) and session.answer.n == 8
    assert session.drop_last().left_out == (2, 7)
    with pytest.raises(uq.InputError, match="between 0 and 7, got 8"):
        session.leave_out(8)
    (tmp_path / CHOICE).write_text('{"left_out": "all"}')
    with pytest.raises(uq.InputError, match="is not the file of a session"):
        Session(Folder(tmp_path))


@pytest.mark.slow
def test_killed_at_once_after_a_pose(tmp_path):
    """Every pose that was answered is there, and a line cut off in the middle is not."""
    program = (
        "import sys, threading\nfrom pathlib import Path\n"
        "from uq_handeye.use.live_session.session import Session\n"
        "from uq_handeye.use.live_session.folder import Folder\n"
        "from uq_handeye.use.live_session.json_lines import Lines\n"
        "session, lines = Session(Folder(Path(sys.argv[1]))), Lines(sys.stdin)\n"
        "while True:\n    print(session.add(*lines.take()).n, flush=True)\n"
    )
    command = [sys.executable, "-W", "ignore", "-c", program, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        for k in range(5):
            process.stdin.write(line(k))
            process.stdin.flush()
            assert int(process.stdout.readline()) == k + 1
        os.kill(process.pid, signal.SIGKILL)
    with open(tmp_path / OWN, "a", encoding="utf-8") as file:
        file.write(line(5)[:200])
    session = Session(Folder(tmp_path))
    assert session.update().n == 5
    assert session.add(POSES.robot[5], POSES.camera[5]).n == 6


@pytest.mark.slow
def test_json_lines(tmp_path):
    text = line(0, timestamp=1.5) + "nonsense\n" + "".join(line(k, timestamp=1.5 + k) for k in range(1, 8))
    session = Session(Folder(tmp_path))
    feed(session, Lines(io.StringIO(text)), threading.Event())
    assert session.answer.n == 8 and session.answer.result is not None
    assert next(iter(session.notes)).startswith("standard input, line 2: expected JSON such as")
    assert session.answer.poses.timestamps.tolist() == [1.5 + k for k in range(8)]


def test_lines_in_other_forms():
    x, y, z = POSES.robot[0][:3, 3]
    pose = {"translation": [1e3 * x, 1e3 * y, 1e3 * z], "rotation": POSES.robot[0][:3, :3].tolist()}
    text = json.dumps({"robot": pose, "camera": pose})
    pair = pair_of(text, "line 1", {"units": ("mm", "mm")})
    np.testing.assert_allclose(pair.robot, POSES.robot[0], atol=1e-12)
    with pytest.raises(uq.InputError, match="line 1: expected one robot and one camera pose"):
        pair_of('{"robot": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}', "line 1")
    with pytest.raises(uq.InputError, match="longer than"):
        pair_of(" " * 200_000, "line 1")


def test_poses_that_are_none(tmp_path):
    session = Session(Folder(tmp_path))
    for robot in (np.eye(3), np.zeros((4, 4)), [[1, 2], [3, 4]]):
        with pytest.raises(uq.InputError, match="robot"):
            session.add(robot, np.eye(4))
    with pytest.raises(uq.InputError, match=r"`time` to be a number of seconds, got nan"):
        session.add(np.eye(4), np.eye(4), float("nan"))
    with pytest.raises(uq.InputError, match="There is no X yet"):
        session.finish()
    assert not (tmp_path / OWN).exists()


@pytest.mark.slow
def test_the_curve_is_filled_up_afterwards(tmp_path):
    session = taken(tmp_path, 12)
    while session.fill():
        pass
    counts = [n for n, _ in session.curve]
    assert counts[0] == 3 and counts[-1] == 12 and 11 in counts and not session.fill()
