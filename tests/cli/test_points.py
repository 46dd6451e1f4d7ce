"""Command ``points``: summary, JSON, folder, refusals in one line."""

import json

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.point_sets import rig
from support import SEED


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("points")
    y, p, _ = rig(np.random.default_rng(SEED), 8, 5, 1e-4, 5e-4)
    lines = [f"{i},{j},{','.join(map(str, y[i, j]))}" for i in range(8) for j in range(5)]
    (folder / "points.csv").write_text("\n".join(["pose,point,x,y,z", *lines, ""]))
    (folder / "target.csv").write_text(
        "\n".join(["point,x,y,z", *(f"{j},{','.join(map(str, p[j]))}" for j in range(5)), ""])
    )
    (folder / "single.csv").write_text("timestamp,x,y,z\n0,0.1,0.2,0.8\n1,0.2,0.2,0.9\n2,0.1,0.1,0.9\n")
    return folder


def test_summary_json_and_folder(folder):
    points, target, out = (str(folder / name) for name in ("points.csv", "target.csv", "out"))
    done = run("points", points, "--target", target, "-o", out)
    assert done.returncode == 0 and "8 poses of a target from 40 points" in done.stdout
    assert f"calibrate robot.csv {out}" in done.stdout and "axial" in done.stdout
    names = {"camera.csv", "points_covariance.npz", "points.json", "points.csv", "target.csv", "residuals.png"}
    assert {path.name for path in (folder / "out").iterdir()} == names
    done = run("points", points, "--target", target, "--noise", "0.1mm,0.5mm", "--json")
    found = json.loads(done.stdout)
    assert found["noise"]["axial"] == 5e-4 and found["noise"]["given"] and found["target"]["points"] == 5
    assert np.array(found["covariance"]).shape == (8, 6, 6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["single.csv", "--target", "target.csv"], "One point per pose gives no pose"),
        (["points.csv", "--units", "mm", "--target", "target.csv"], "--target-units"),
        (["points.csv"], "--target is missing"),
        (["points.csv", "--target", "target.csv", "--noise", "soft"], "--noise"),
        (["points.csv", "--target", "target.csv", "--units", "miles"], "--units"),
        (["nothing.csv", "--target", "target.csv"], "there is no such file"),
        (["points.csv", "--target", "single.csv"], "do not fit the target"),
    ],
)
def test_refusals(arguments, words, folder, monkeypatch):
    monkeypatch.chdir(folder)
    done = run("points", *arguments)
    assert (
        done.returncode == 2 and words in done.stderr and done.stderr.splitlines()[-1].startswith("uq-handeye: error: ")
    )
