"""``uq-handeye cross-check`` as a user meets it: exit status, stdout, stderr, files, and Ctrl-C."""

import json
import os
from pathlib import Path

import pytest
from fixtures.trials import NOISE

from uq_handeye import simulate
from uq_handeye.cli import app as cli
from uq_handeye.read import write_pose_file
from uq_handeye.trials.validation.cross_check import rows as cross_check_rows

OPTIONS = ("--robot-noise", "0.02deg,0.05mm", "--camera-noise", "0.1deg,0.5mm", "--workers", "1")


@pytest.fixture
def run(tmp_path, capsys, monkeypatch):
    """``run("...")`` gives exit status, stdout and stderr of cross-check on the files of a session."""
    poses = simulate(10, noise=NOISE, seed=3)
    write_pose_file(tmp_path / "robot.csv", poses.robot)
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        with pytest.raises(SystemExit) as end:
            cli.main(["cross-check", "robot.csv", "camera.csv", *OPTIONS, *map(str, arguments)])
        return end.value.code, *capsys.readouterr()

    return call


@pytest.fixture
def pressed(monkeypatch):
    """Ctrl-C during the trials of a method."""
    real = cross_check_rows.monte_carlo

    def during(name):
        def monte_carlo(*args, method, **kwargs):
            if method == name:
                raise KeyboardInterrupt
            return real(*args, method=method, **kwargs)

        monkeypatch.setattr(cross_check_rows, "monte_carlo", monte_carlo)

    return during


@pytest.mark.slow
def test_text_and_files(run):
    status, out, err = run("--trials", 300, "--no-posterior", "-o", "found")
    assert (status, err) == (0, "")
    assert (
        out.startswith("All 7 relations that could be judged hold: the covariances are those that")
        and "300 trials, seed 0" in out
    )
    assert sorted(os.listdir("found")) == [*(f"cross_check.{kind}" for kind in ("csv", "json", "png", "svg")), "run"]
    again = run("--trials", 300, "--no-posterior", "-o", "found")
    assert again[0] == 2 and "go on with the run in it by resume=True (--resume)" in again[2]
    assert run("--trials", 300, "--no-posterior", "-o", "found", "--resume")[0] == 0


@pytest.mark.slow
def test_ctrl_c_prints_what_there_is(run, pressed):
    pressed("efficient")
    status, out, err = run("--trials", 1000)
    assert (status, err) == (130, "uq-handeye: interrupted\n")
    first = (
        "NOT COMPLETE (interrupted). Trials, of 1,000 asked: 4dpa 1,000, nguyen 1,000, efficient 0, ml 0. No posterior."
    )
    assert " ".join(out.split()).startswith(first)
    status, out, _ = run("--trials", 1000, "--json", "-o", "found")
    data = json.loads(out)
    assert (status, data["complete"], data["reason"]) == (130, False, "interrupted")
    assert json.loads(Path("found/cross_check.json").read_text()) == data


def test_ctrl_c_before_the_first_trial(run, pressed):
    pressed("4dpa")
    assert run("--trials", 1000) == (130, "", "uq-handeye: interrupted\n")
