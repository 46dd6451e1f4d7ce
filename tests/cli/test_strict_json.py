"""JSON of every command is that of the standard: no NaN, no Infinity, whatever the data leave open."""

import json

import numpy as np
import pytest
from fixtures.commands import MODEL, run

import uq_handeye as uq
from uq_handeye.read import write_pose_file

DATA = {
    "few": uq.simulate(4, noise=MODEL, seed=3),
    "exact": uq.simulate(8, seed=3),
    "usual": uq.simulate(12, noise=MODEL, seed=3),
}
COMMANDS = {
    "calibrate": ("calibrate", "robot.csv", "camera.csv"),
    "plan": ("plan", "robot.csv", "camera.csv", "-k", "1"),
    "compare": ("compare", "robot.csv", "camera.csv", "--methods", "efficient,park"),
    "check": ("check", "old-result/result.json", "new/robot.csv", "new/camera.csv"),
    "update": ("update", "old-result/result.json", "new/robot.csv", "new/camera.csv"),
    "verify": ("verify", "result.json", "--poses", "new/robot.csv", "new/camera.csv"),
    "predict": ("predict", "result.json", "--robot", "new/robot.csv", "--camera"),
    "diff": ("diff", "result.json", "result.json"),
}


def strictly(text):
    def refuse(constant):
        raise AssertionError(f"{constant} in JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope="module", params=DATA)
def session(request, tmp_path_factory):
    folder, poses = tmp_path_factory.mktemp(request.param), DATA[request.param]
    new = uq.simulate(2, noise=MODEL, seed=9)
    (folder / "new").mkdir()
    for where, of in ((folder, poses), (folder / "new", new)):
        write_pose_file(where / "robot.csv", of.robot)
        write_pose_file(where / "camera.csv", of.camera)
    run("calibrate", "robot.csv", "camera.csv", "-q", "-o", "old-result", cwd=folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command(session, command):
    done = run(*COMMANDS[command], "--json", cwd=session)
    if done.returncode == 2:  # refused, in one line
        assert done.stdout.strip() == "" and done.stderr.startswith("uq-handeye: error:")
        assert "internal error" not in done.stderr
        return
    assert isinstance(strictly(done.stdout), dict | list)
    assert np.isfinite(done.returncode)


@pytest.mark.slow
def test_one_new_pose_is_enough(tmp_path):
    """`check --only 3` speaks of that pose, and `calibrate --only` of at least three."""
    for name, of in (("old", uq.simulate(12, noise=MODEL, seed=3)), ("new", uq.simulate(5, noise=MODEL, seed=4))):
        (tmp_path / name).mkdir()
        write_pose_file(tmp_path / name / "robot.csv", of.robot)
        write_pose_file(tmp_path / name / "camera.csv", of.camera)
    assert run("calibrate", "old/robot.csv", "old/camera.csv", "-q", "-o", "old-result", cwd=tmp_path).returncode == 0
    done = run("check", "old-result/result.json", "new/robot.csv", "new/camera.csv", "--only", "3", cwd=tmp_path)
    assert "1 new pose agrees" in done.stdout
    done = run("check", "old-result/result.json", "new/robot.csv", "new/camera.csv", "--exclude", "0-4", cwd=tmp_path)
    assert done.returncode == 2 and "At least 1 is needed" in done.stderr
    done = run("calibrate", "old/robot.csv", "old/camera.csv", "--only", "0,1", cwd=tmp_path)
    assert done.returncode == 2 and "At least 3 are needed" in done.stderr
