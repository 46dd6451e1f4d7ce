"""``uq-handeye posterior`` as a user meets it: exit status, stdout, stderr and the files written."""

import json
import warnings

import numpy as np
import pytest

from uq_handeye import PoseNoise, read_poses, simulate
from uq_handeye.cli import app as cli
from uq_handeye.read import write_pose_file
from uq_handeye.trials.validation.posterior.sample import sample_posterior

NOISE = ("--robot-noise", "0.02deg,0.05mm", "--camera-noise", "0.1deg,0.5mm")
MODEL = PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
SHORT = ("--samples", 400, "--walkers", 32)
FILES = ["chain.h5", "corner.png", "corner.svg", "posterior.json"]


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    poses = simulate(8, noise=MODEL, seed=3)
    write_pose_file(folder / "robot.csv", poses.robot)
    write_pose_file(folder / "camera.csv", poses.camera)
    (folder / "pairs.toml").write_text(
        '[A]\nrotation = "0.02deg"\ntranslation = "0.05mm"\n[B]\nrotation = "0.1deg"\ntranslation = "0.5mm"\n'
    )
    return folder


@pytest.fixture
def run(session, capsys, monkeypatch):
    """``run("...")`` gives exit status, stdout and stderr of posterior on the files of the session."""
    monkeypatch.chdir(session)

    def call(*arguments):
        with warnings.catch_warnings(), pytest.raises(SystemExit) as end:
            cli.main(["posterior", "robot.csv", "camera.csv", *map(str, arguments)])
        return end.value.code, *capsys.readouterr()

    return call


@pytest.fixture(scope="module")
def expected(session):
    return sample_posterior(
        read_poses(session / "robot.csv", session / "camera.csv"), MODEL, samples=400, walkers=32, seed=2
    )


@pytest.mark.slow
def test_text(run, expected):
    status, out, err = run(*NOISE, *SHORT, "--seed", 2)
    assert (status, err) == (0, "")
    assert out.startswith("Posterior of gripper_T_camera, Gaussian likelihood, flat prior on X, noise given.")
    assert out.split("seed 2")[0] == expected.summary().split("seed 2")[0]


@pytest.mark.slow
def test_json(run, expected):
    status, out, err = run(*NOISE, *SHORT, "--seed", 2, "--json")
    assert (status, err) == (0, "")
    np.testing.assert_array_equal(json.loads(out)["covariance"], expected.covariance)


@pytest.mark.slow
def test_stopped_and_resumed(run, expected, tmp_path):
    folder = tmp_path / "new" / "out"
    status, out, err = run(*NOISE, *SHORT, "--seed", 2, "-o", folder, "--max-steps", 20)
    assert (status, out) == (2, "")
    assert "has not converged" in err and "--resume" in err
    assert [path.name for path in folder.iterdir()] == ["chain.h5"]
    status, out, err = run(*NOISE, *SHORT, "--seed", 2, "-o", folder)
    assert status == 2 and "exists" in err and "--resume" in err
    status, out, err = run(*NOISE, *SHORT, "--seed", 1, "-o", folder, "--resume")
    assert status == 2 and "another run, which differs in seed (2, now 1)" in err
    status, out, err = run(*NOISE, *SHORT, "--seed", 2, "-o", folder, "--resume", "--json")
    assert (status, err) == (0, "")
    assert sorted(path.name for path in folder.iterdir()) == FILES
    values = json.loads(out)
    assert values == json.loads((folder / "posterior.json").read_text())
    np.testing.assert_array_equal(values["covariance"], expected.covariance)


@pytest.mark.slow
def test_noise_on_motions_and_options(run):
    status, out, err = run("--noise", "pairs.toml", "--pairs", "consecutive", "--student-t", 6, "--scales", *SHORT)
    assert status == 0
    assert all(line.startswith("uq-handeye: warning: ") for line in err.splitlines())
    assert "Student-t (6 degrees of freedom) likelihood" in out
    assert "Noise of A: " in out and "Noise of B: " in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--resume",), "-o DIR"),
        (("--samples", 5), "`samples`"),
        (("--student-t", 0.1), "`student_t`"),
        (("--seed", -1), "`seed`"),
        (("-o", ""), "-o"),
    ],
)
def test_one_line_of_error(run, arguments, words):
    status, out, err = run(*NOISE, *arguments)
    assert (status, out) == (2, "")
    assert words in err and err.count("\n") == 1
