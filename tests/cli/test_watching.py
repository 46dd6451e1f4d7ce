"""`calibrate --watch`: poses that arrive one by one, without waiting for the clock."""

import json
import re
from itertools import islice

import numpy as np
import pytest
from fixtures.commands import run

import uq_handeye as uq
from uq_handeye.cli import watching
from uq_handeye.read import write_pose_file
from uq_handeye.use.live_session.folder import settled

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
KNOWN = ("--robot-noise", "0.02deg,0.05mm", "--camera-noise", "0.1deg,0.5mm")
POSES = uq.simulate(n_poses=14, noise=NOISE, seed=4)


@pytest.fixture
def arriving(monkeypatch):
    """Return a function that lets the steps of a session happen, one after each answer, and then Ctrl-C."""

    def let(steps):
        remaining = iter(steps)
        looks = iter([])

        def pause(_):
            nonlocal looks
            if next(looks, None) is None:
                step = next(remaining, None)
                if step is None:
                    raise KeyboardInterrupt
                step()
                looks = iter([True] * 2)

        monkeypatch.setattr(watching.Watch.run, "__defaults__", (pause,))

    return let


def growing(folder, k):
    """Write the first k poses as growing files; the camera's pose arrives late once."""
    return lambda: (
        write_pose_file(folder / "robot.csv", POSES.robot[:k]),
        write_pose_file(folder / "camera.csv", POSES.camera[: k - (k == 5)]),
    )


@pytest.mark.slow
def test_growing_files_until_the_tolerance_is_met(tmp_path, arriving):
    arriving([growing(tmp_path, k) for k in range(1, 15)])
    done = run("calibrate", "--watch", tmp_path, *KNOWN, "--tolerance", "3mm,0.4deg", "-q", "-o", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    stored = uq.Calibration.from_json(tmp_path / "out" / "result.json")
    assert stored.n_poses < 14 and stored.verdict("3mm,0.4deg").passed
    assert pytest.approx(uq.calibrate(POSES.rows(np.arange(stored.n_poses)), noise=NOISE).X, abs=1e-12) == stored.X
    assert json.loads((tmp_path / "out" / "result.json").read_text())["verdict"]["verdict"] == "PASS"


@pytest.mark.slow
def test_answers_after_each_pose(tmp_path, arriving):
    arriving([growing(tmp_path, k) for k in (1, 2, 4, 5, 6, 9)])
    done = run("calibrate", "--watch", tmp_path, *KNOWN)
    assert done.returncode == 0 and done.stderr == ""
    said = done.stdout.splitlines()
    assert said[0].startswith("Watching ") and said[1].startswith("1 pose: at least 3 are needed")
    starts = [line.partition(":")[0] for line in said if re.match(r"\d+ poses?:", line)]
    assert starts == ["1 pose", "2 poses", "4 poses", "6 poses", "9 poses"]  # with 5 the camera's was not there yet
    assert any(line.startswith("The next pose would gain ") and "base_T_gripper x " in line for line in said)
    assert "Stopped after 9 poses." in said and any("from robot.csv, camera.csv: 9 poses" in line for line in said)


@pytest.mark.slow
def test_a_file_for_each_pose(tmp_path, arriving):
    def both(k):
        text = json.dumps([{"robot": POSES.robot[k].tolist(), "camera": POSES.camera[k].tolist()}])
        return lambda: (tmp_path / f"pose{k}.json").write_text(text)

    arriving([both(k) for k in range(11)])
    done = run("calibrate", "--watch", tmp_path, *KNOWN, "--json", "--no-color")
    found = json.loads(done.stdout)
    assert done.returncode == 0 and found["n_poses"] == 11
    assert found["X"] == pytest.approx(uq.calibrate(POSES.rows(np.arange(11)), noise=NOISE).X, abs=1e-12)


def test_files_that_are_half_written_are_waited_for(tmp_path, arriving):
    def broken():
        text = (tmp_path / "camera.csv").read_text()
        (tmp_path / "camera.csv").write_text(text[: text.rindex(",")])

    arriving([growing(tmp_path, 6), broken, growing(tmp_path, 7)])
    said = run("calibrate", "--watch", tmp_path, *KNOWN).stdout
    assert "Waiting: " in said and "camera.csv" in said and "\n7 poses: " in said


def test_poses_about_one_axis_and_too_few(tmp_path, arriving):
    turns = np.linspace(0, 1.5, 8)
    robot = np.tile(np.eye(4), (8, 1, 1))
    robot[:, :2, :2] = np.moveaxis([[np.cos(turns), -np.sin(turns)], [np.sin(turns), np.cos(turns)]], -1, 0)
    robot[:, 0, 3] = np.linspace(0, 0.4, 8)
    X, W = POSES.truth.X, POSES.truth.W
    camera = np.linalg.inv(robot @ X) @ W
    arriving(
        [lambda: (write_pose_file(tmp_path / "robot.csv", robot), write_pose_file(tmp_path / "camera.csv", camera))]
    )
    done = run("calibrate", "--watch", tmp_path, *KNOWN)
    assert "8 poses: not determined yet: " in done.stdout and "Traceback" not in done.stderr
    arriving([growing(tmp_path, 2)])
    done = run("calibrate", "--watch", tmp_path)
    assert done.returncode == 2 and "No X: the poses that arrived" in done.stderr


def test_options_that_do_not_fit(tmp_path):
    for more, message in (
        (("robot.csv",), "finds the pose files in the folder"),
        (("--pair", "time"), "Remove --pair time"),
        (("--exclude", "3"), "Use them without --watch"),
        (("-o", tmp_path), "-o names the folder that is watched"),
        (("--joints", "q.csv", "--urdf", "a.urdf"), ""),
    ):
        done = run("calibrate", "--watch", tmp_path, *more)
        assert done.returncode == 2 and message in done.stderr and done.stderr.count("\n") == 1
    assert "to name a folder" in run("calibrate", "--watch", tmp_path / "none").stderr


def test_states_are_taken_once_they_stand_still():
    a, b = (("a", 1, 1),), (("a", 2, 2),)
    looks = iter([(), a, b, b, b, a, a])
    assert list(islice(settled(lambda: next(looks), lambda _: None), 2)) == [b, a]
    restless = iter((("a", k, k),) for k in range(99))
    assert next(settled(lambda: next(restless), lambda _: None, max_changes=6)) == (("a", 5, 5),)
