"""``update`` and ``diff``: answers, files and refusals."""

import json

import numpy as np
import pytest
from fixtures.commands import MODEL, run

import uq_handeye as uq
from uq_handeye.read import write_pose_file


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    at = tmp_path_factory.mktemp("update")
    poses = uq.simulate(18, noise=MODEL, seed=3)
    uq.calibrate(poses.rows(np.arange(15)), noise=MODEL).to_json(at / "result.json")
    wrong = poses.camera.copy()
    wrong[:, 2, 3] += 0.02
    for name, robot, camera in (
        ("new", poses.robot[15:], poses.camera[15:]),
        ("moved", poses.robot[15:], wrong[15:]),
    ):
        write_pose_file(at / f"{name}_robot.csv", robot)
        write_pose_file(at / f"{name}_camera.csv", camera)
    return at


def update(folder, name, *options):
    files = (folder / f"{name}_robot.csv", folder / f"{name}_camera.csv")
    return run("update", folder / "result.json", *files, *options)


@pytest.mark.slow
def test_update_and_difference(folder):
    done = update(folder, "new", "-o", folder / "new")
    assert (done.returncode, done.stderr) == (0, "")
    assert (
        "18 poses, eye-in-hand" in done.stdout and "Updated by 3 new poses beside 15: translation of X" in done.stdout
    )
    stored = uq.Calibration.from_json(folder / "new" / "result.json")
    assert [part["poses"] for part in stored.provenance.options["together"]] == [15, 3]
    assert stored.provenance.command.startswith("uq-handeye update")
    done = run("diff", folder / "result.json", folder / "new" / "result.json", "-o", folder / "diff")
    assert done.returncode == 2 and "15 poses in common" in done.stderr and "uq-handeye update" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    files = (folder / "new_robot.csv", folder / "new_camera.csv")
    assert run("calibrate", *files, "-o", folder / "second").returncode in (0, 3)
    done = run("diff", folder / "result.json", folder / "second" / "result.json", "-o", folder / "diff")
    assert (done.returncode, done.stderr) == (0, "")
    assert "Assumed: independent errors" in " ".join(done.stdout.split())
    lines = done.stdout.splitlines()
    assert len(lines) <= 14
    assert max(len(line) for line in lines if not line.startswith("Wrote ")) <= 80  # its path may be long
    assert json.loads((folder / "diff" / "diff.json").read_text())["how"] == "posterior"


@pytest.mark.slow
def test_refusals_are_one_line(folder):
    refused = update(folder, "moved")
    assert refused.returncode == 2 and "something has changed" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
    assert update(folder, "moved", "--although-changed", "-q").returncode in (0, 3)
    named = run("diff", folder / "result.json", folder / "result.json", "--same", "lens")
    assert named.returncode == 2 and "robot, camera, target, got 'lens'" in named.stderr
