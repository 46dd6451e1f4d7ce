"""Command certificate: files by suffix and folder, exit status, one line for bad use."""

import json

import pytest
from fixtures.commands import run
from support import SEED

import uq_handeye as uq

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("certificate")
    uq.calibrate(uq.simulate(n_poses=12, noise=NOISE, seed=SEED), noise=NOISE).to_json(folder / "result.json")
    uq.calibrate(uq.simulate(n_poses=6, seed=SEED)).to_json(folder / "exact.json")
    return folder


@pytest.mark.slow
def test_writes_what_is_asked_for(folder):
    (folder / "cell.toml").write_text('cell = "B7"\nreference = "CMM 12"\n')
    done = run("certificate", "result.json", "c.json", "--about", "cell.toml", cwd=folder)
    assert done.returncode == 0 and done.stderr == ""
    assert "Certificate UQ-" in done.stdout and "Wrote c.json" in done.stdout
    data = json.loads((folder / "c.json").read_text())
    assert data["certified"] and data["about"] == {"cell": "B7", "reference": "CMM 12"}
    other = run("report", "result.json", "c.html", "--certificate", "--about", "cell.toml", cwd=folder)
    assert data["identifier"] in other.stdout
    assert "CMM 12" in (page := (folder / "c.html").read_text()) and data["identifier"] in page


@pytest.mark.slow
def test_exit_status(folder):
    passed = run("certificate", "result.json", "--tolerance", "9mm,3deg", cwd=folder)
    assert passed.returncode == 0 and "PASS" in passed.stdout
    missed = run("certificate", "result.json", "--tolerance", "0.01mm", cwd=folder)
    assert missed.returncode == 5 and "FAIL" in missed.stdout
    refused = run("certificate", "exact.json", "refused.json", cwd=folder)
    assert refused.returncode == 3 and refused.stdout.startswith("NOT CERTIFIED.")
    assert json.loads((folder / "refused.json").read_text())["result"] is None


@pytest.mark.slow
def test_bad_use_is_one_line(folder):
    for arguments, said in (
        (("result.json", "c.txt"), "Expected FILE to be named .html or .pdf or .json"),
        (("none.json",), "no such file"),
        (("result.json", "c.pdf", "--paper", "a3"), "Expected --paper"),
        (("result.json", "--at", "1m"), "--at needs a tolerance"),
        (("result.json", "--about", "colour=red"), "Unknown name 'colour'"),
    ):
        done = run("certificate", *arguments, cwd=folder)
        assert done.returncode == 2 and said in done.stderr and done.stderr.count("\n") == 1, arguments
