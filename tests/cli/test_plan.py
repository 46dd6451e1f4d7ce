"""``uq-handeye plan`` as a user meets it: exit status, stdout, stderr and the file written."""

import json
import warnings

import numpy as np
import pytest
from fixtures.pages import DOCS
from scipy.spatial.transform import Rotation

from uq_handeye import PoseNoise, read_poses, simulate
from uq_handeye.cli import app as cli
from uq_handeye.read import read_pose_file, write_pose_file
from uq_handeye.use.planning.plan import plan

NOISE = ("--robot-noise", "0.02deg,0.05mm", "--camera-noise", "0.1deg,0.5mm")
MODEL = PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    poses = simulate(10, noise=MODEL, seed=3)
    write_pose_file(folder / "robot.csv", poses.robot)
    write_pose_file(folder / "camera.csv", poses.camera)
    write_pose_file(folder / "candidates.csv", simulate(12, seed=4).truth.robot)
    return folder


@pytest.fixture
def run(session, capsys, monkeypatch):
    """``run("...")`` gives exit status, stdout and stderr of plan on the files of the session."""
    monkeypatch.chdir(session)

    def call(*arguments, files=("robot.csv", "camera.csv")):
        with warnings.catch_warnings(), pytest.raises(SystemExit) as end:
            cli.main(["plan", *files, *map(str, arguments)])
        return end.value.code, *capsys.readouterr()

    return call


def test_text_and_file(run, session, tmp_path):
    status, out, err = run(*NOISE, "-k", 3, "-o", tmp_path / "plan")
    assert (status, err) == (0, "")
    found = plan(read_poses(session / "robot.csv", session / "camera.csv"), k=3, noise=MODEL)
    assert out.startswith("3 more poses would bring the translation of gripper_T_camera from ")
    text, _, said = out.partition("\nWrote ")
    assert text == found.to_text() and said.split() == ["next.csv", "and", "plan.json", "to", str(tmp_path / "plan")]
    np.testing.assert_allclose(read_pose_file(tmp_path / "plan" / "next.csv")[1], found.robot, atol=1e-14)
    assert json.loads((tmp_path / "plan" / "plan.json").read_text()) == found.to_dict()
    status, out, err = run(*NOISE, "-k", 3, "--json", "-o", tmp_path / "plan")  # again, into the same folder
    assert (status, json.loads(out), err) == (0, found.to_dict(), "")


@pytest.mark.slow
def test_candidates_of_ones_own(run, session):
    arguments = (*NOISE, "--candidates", "candidates.csv", "--json", "-k", 4)
    data = json.loads(run(*arguments)[1])
    _, robot = read_pose_file(session / "candidates.csv")
    rows = [step["candidate"] for step in data["steps"]]
    assert len(set(rows)) == 4
    assert (data["sampled"], data["n_candidates"]) == (False, 12)
    np.testing.assert_allclose([step["robot"] for step in data["steps"]], robot[rows], atol=1e-12)
    assert run(*arguments)[1] == run(*arguments, "--seed", 5)[1]
    again = json.loads(run(*arguments, "-k", 20, "--repeat")[1])
    assert len(again["steps"]) == 20


@pytest.mark.slow
def test_criteria(run):
    for extra, criterion, head, note in (
        (("--criterion", "point", "--point", "0mm,0mm,300mm"), "point", "error", "of the point (0, 0, 300) mm"),
        (("--criterion", "logdet"), "logdet", "log", "log det: of the covariance of X (rad, m)"),
        (("--length", "300mm"), "trace", "error", "of points 300 mm from the camera"),
    ):
        data = json.loads(run(*NOISE, "--json", *extra)[1])
        assert data["criterion"] == criterion
        assert data["length"] == (0.3 if criterion == "trace" else None)
        assert data["point"] == ([0.0, 0.0, 0.3] if criterion == "point" else None)
        text = run(*NOISE, *extra)[1]
        lines = text.splitlines()
        assert next(line for line in lines if line.startswith("  step")).split()[-1] == head
        before = data["before"]["criterion"]
        shown = f"{before:.2f}" if criterion == "logdet" else f"{1e3 * np.sqrt(before):.2f}"
        assert next(line for line in lines if line.startswith("so far")).split()[-1] == shown
        assert note in " ".join(lines)


def test_units(run, session, tmp_path):
    for name in ("robot", "camera", "candidates"):
        poses = read_pose_file(session / f"{name}.csv")[1]
        poses[:, :3, 3] *= 1000.0
        write_pose_file(tmp_path / f"{name}.csv", poses)
    metres = json.loads(run(*NOISE, "--json", "--candidates", "candidates.csv")[1])
    files = (str(tmp_path / "robot.csv"), str(tmp_path / "camera.csv"))
    given = (*NOISE, "--json", "--candidates", tmp_path / "candidates.csv", "--units", "mm")
    scaled = json.loads(run(*given, files=files)[1])
    assert [step["candidate"] for step in scaled["steps"]] == [step["candidate"] for step in metres["steps"]]
    np.testing.assert_allclose(scaled["X"], metres["X"], atol=1e-12)


@pytest.mark.slow
def test_parallel_axes_are_where_it_helps_most(run, tmp_path):
    poses = simulate(8, tilt=0.0, seed=1)
    write_pose_file(tmp_path / "robot.csv", poses.robot)
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    files = (str(tmp_path / "robot.csv"), str(tmp_path / "camera.csv"))
    status, out, err = run(*NOISE, files=files)
    assert (status, err.count("\n")) == (0, 1)
    assert err.startswith("uq-handeye: warning: The rotation axes of the robot are nearly parallel")
    assert "The 8 poses so far leave gripper_T_camera open: translation along" in out
    assert "CAUTION" in out
    data = json.loads(run(*NOISE, "--json", files=files)[1])
    assert data["prior_std"] == 1.0
    assert len(data["open_directions"]) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["-k", "0"], ["-k", "at least 1"]),
        (["-k", "x"], ["-k", "integer"]),
        (["--sample", "0"], ["--sample", "at least 1"]),
        (["--sample", "1000000"], ["between 1 and 100000"]),
        (["--seed", "-1"], ["--seed", "at least 0"]),
        (["--sample", "3"], ["k = 5 and 3 candidates"]),
        (["--candidates", "no.csv"], ["no.csv", "no such file"]),
        (["--candidates", "candidates.csv", "-k", "13"], ["k = 13 and 12 candidates"]),
        (["--criterion", "magic"], ["trace, logdet, point", "magic"]),
        (["--criterion", "point"], ["go together"]),
        (["--point", "0mm,0mm,1mm"], ["--point needs --criterion point", "got --criterion trace"]),
        (["--criterion", "point", "--point", "1mm,2mm"], ["--point", "X,Y,Z"]),
        (["--criterion", "point", "--point", "1,2,3"], ["unit"]),
        (["--length", "1"], ["unit"]),
        (["--length", "0mm"], ["above 0"]),
        (["--setup", "eye"], ["eye-in-hand"]),
        (["--camera-noise", "1mm,2deg"], ["swapped"]),
        (["--units", "mile"], ["mile"]),
        (["--noise", "no.toml"], ["no.toml", "no such file"]),
        (["--frobnicate"], ["--frobnicate"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_bad_usage(run, arguments, parts):
    status, out, err = run(*NOISE, *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("uq-handeye: error: ")
    for part in parts:
        assert part in err


@pytest.mark.slow
def test_without_noise_it_is_estimated(run):
    status, out, _ = run()
    assert status == 0
    assert "the noise estimated from the poses so far" in " ".join(out.split())


def test_noise_of_motions_is_refused(run, tmp_path):
    file = tmp_path / "noise.toml"
    file.write_text("[A]\nrotation = '0.02deg'\ntranslation = '0.05mm'\n")
    status, _, err = run("--noise", file)
    assert status == 2
    assert "plan needs noise on poses" in err


def test_page_shows_what_is_printed(tmp_path, monkeypatch, capsys):
    """Every line of the example in docs/how-to/plan.md, "..." aside, is printed by its commands."""
    page = (DOCS / "how-to" / "plan.md").read_text()
    commands, shown = (block.strip().splitlines() for block in page.split("```text")[1:3])
    monkeypatch.chdir(tmp_path)
    for command in commands[: commands.index("```")]:
        with warnings.catch_warnings(), pytest.raises(SystemExit) as end:
            cli.main(command.split()[1:])
        assert end.value.code == 0
        printed = capsys.readouterr().out.splitlines()
    for line in shown[: shown.index("```")]:
        assert line in ("...", *printed)


def test_help(run):
    status, out, _ = run("--help", files=())
    assert status == 0
    assert "uq-handeye plan robot.csv" in out
    assert "15 % of its" in run("--help-all", files=())[1]


def test_poses_as_a_controller_writes_them(run, session, tmp_path):
    """A KUKA's numbers are those of the poses, by rotations about single axes."""
    status, out, err = run(*NOISE, "-k", 2, "--as", "kuka", "-o", tmp_path / "plan")
    assert (status, err) == (0, "") and "A to C: base_T_gripper as KUKA writes it" not in out
    assert "X to C: base_T_gripper as KUKA writes it" in " ".join(out.split())
    poses = read_pose_file(tmp_path / "plan" / "next.csv")[1]
    lines = (tmp_path / "plan" / "next.txt").read_text().splitlines()
    for pose, line in zip(poses, lines[1:], strict=True):
        fields = dict(field.split() for field in line.partition("{")[2].rstrip("}").split(","))
        values = {name: float(value) for name, value in fields.items()}
        angles = [values[name] for name in "ABC"]
        about = [Rotation.from_euler(axis, angle, degrees=True) for axis, angle in zip("zyx", angles, strict=True)]
        np.testing.assert_allclose((about[0] * about[1] * about[2]).as_matrix(), pose[:3, :3], atol=1e-12)
        np.testing.assert_allclose([values[axis] / 1e3 for axis in "XYZ"], pose[:3, 3], atol=1e-12)
        assert f"{values['A']:.3f}" in out
