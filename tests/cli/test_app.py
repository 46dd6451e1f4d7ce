"""The command as a user meets it: exit status, stdout, stderr and files of calibrate, compare, demo and simulate."""

import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from fixtures.commands import NOISE, run, run_process
from fixtures.pages import ROOT
from matplotlib.figure import Figure

import uq_handeye as uq
from uq_handeye.cli import app as cli

PICTURES = [
    f"{stem}.{kind}" for stem in ("budget", "ellipses", "residuals", "rig", "task_space") for kind in ("png", "svg")
]
EXPORTS = ["x.npz", "x.urdf", "x_opencv.yaml", "x_ros.yaml"]


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    done = run("simulate", "-o", folder, "--poses", 12, *NOISE, "--seed", 3)
    assert done.returncode == 0, done.stderr
    return folder


def test_simulate_writes_what_simulate_makes(session):
    poses = uq.read_poses(session / "robot.csv", session / "camera.csv")
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    expected = uq.simulate(12, noise=noise, seed=3)
    np.testing.assert_allclose(poses.robot, expected.robot, atol=1e-14)
    np.testing.assert_allclose(poses.camera, expected.camera, atol=1e-14)


@pytest.mark.slow
def test_calibrate_prints_and_writes(session, tmp_path):
    out = ("-o", tmp_path / "out", "--figures")
    done = run_process("calibrate", session / "robot.csv", session / "camera.csv", *NOISE, *out)
    assert (done.returncode, done.stderr) == (0, "")
    names = sorted(file.name for file in (tmp_path / "out").iterdir())
    assert names == sorted([*PICTURES, *EXPORTS, "poses.csv", "result.json"])
    result = uq.Calibration.from_json(tmp_path / "out" / "result.json")
    assert done.stdout.startswith(result.summary().split("\n\n")[0]) and "Next: " in done.stdout
    assert "Wrote" in done.stdout
    assert "result.jsonwith15morefiles." in "".join(done.stdout.split())  # however the path is wrapped
    typed = f"uq-handeye calibrate {session / 'robot.csv'} {session / 'camera.csv'} {' '.join(NOISE)} -o {tmp_path}/out"
    typed += " --figures"
    assert result.provenance.command == typed
    lines = (tmp_path / "out" / "poses.csv").read_text().splitlines()
    assert lines[0] == "pose,rotation_deg,translation_mm,distance2,leverage,weight,flag"
    assert "\n".join([*lines, ""]) == result.table.to_dataframe().to_csv(index=False, lineterminator="\n")
    assert (tmp_path / "out" / "ellipses.png").read_bytes()[:4] == b"\x89PNG"
    assert "</svg>" in (tmp_path / "out" / "ellipses.svg").read_text()


def test_json(session):
    done = run("calibrate", session / "robot.csv", session / "camera.csv", *NOISE, "--json", "--pairs", "consecutive")
    data = json.loads(done.stdout)
    assert np.shape(data["X"]) == (4, 4)
    assert np.shape(data["covariance"]) == (6, 6)
    assert data["method"] == "efficient"
    assert data["n_pairs"] == 11
    assert "rotation first" in data["convention"]
    assert (
        json.loads(run("calibrate", *files_of(session), *NOISE, "--json", "--method", "4dpa").stdout)["X"] != data["X"]
    )


def files_of(folder):
    return folder / "robot.csv", folder / "camera.csv"


@pytest.mark.slow
def test_without_noise_it_is_estimated(session):
    """The numbers are those of the function, published methods and their kinds included."""
    files = files_of(session)
    poses = uq.read_poses(*files)
    prior = uq.NoisePrior(robot=(None, "0.05mm"), camera=("0.1deg", None), factor=1.5)
    for options, arguments in (
        ((), {}),
        (("--kind", "pairs"), {"kind": "pairs"}),
        (("--method", "ml", "--no-robust"), {"method": "ml", "robust": False}),
        (
            ("--robot-prior", "?,0.05mm", "--camera-prior", "0.1deg,?", "--prior-factor", "1.5"),
            {"prior": prior},
        ),
        (("--covariance", "bootstrap", "--seed", "5"), {"covariance": "bootstrap", "seed": 5}),
    ):
        done = run("calibrate", *files, *options, "--json")
        assert done.returncode == 0, done.stderr
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            expected = json.loads(uq.calibrate(poses, **arguments).to_json())
        found = json.loads(done.stdout)
        del found["checksum"], expected["checksum"]
        assert found["provenance"].pop("command").startswith("uq-handeye calibrate ")
        expected["provenance"].pop("command")
        assert found == expected
        assert json.loads(done.stdout)["noise_estimate"] is not None
    text = run("calibrate", *files, "-v").stdout
    assert "Noise, estimated from the residuals" in text and "12 poses, eye-in-hand, efficient" in text
    assert max(map(len, text.splitlines())) <= 120


@pytest.mark.slow
def test_robust_flag(session, tmp_path):
    lines = (session / "camera.csv").read_text().splitlines()
    fields = lines[5].split(",")
    fields[1] = repr(float(fields[1]) + 0.1)
    lines[5] = ",".join(fields)
    (tmp_path / "camera.csv").write_text("\n".join(lines) + "\n")
    files = session / "robot.csv", tmp_path / "camera.csv"
    for options in ((), NOISE, (*NOISE, "--robust")):
        done = run("calibrate", *files, *options, "-o", tmp_path / "out")
        assert done.returncode == 0
        assert done.stderr == "" and re.search(r"caution  outliers +1 of 12 poses rejected: 4\n", done.stdout)
        assert (tmp_path / "out" / "poses.csv").read_text().splitlines()[5].endswith(",0.0,rejected")
    plain = run("calibrate", *files, *NOISE, "--no-robust")
    assert "kept, but do not fit: 4" in plain.stdout


@pytest.mark.slow
def test_noise_file_equals_flags(session, tmp_path):
    file = tmp_path / "noise.toml"
    file.write_text(
        "[robot]\nrotation = '0.02deg'\ntranslation = '0.05mm'\n[camera]\nrotation = '0.1deg'\ntranslation = '0.5mm'\n"
    )
    files = session / "robot.csv", session / "camera.csv"
    assert run("calibrate", *files, "--noise", file).stdout == run("calibrate", *files, *NOISE).stdout
    mixed = run("calibrate", *files, "--noise", file, *NOISE)
    assert mixed.returncode == 2
    assert "not both" in mixed.stderr


@pytest.mark.slow
def test_scale_and_units(session, tmp_path):
    files = session / "robot.csv", session / "camera.csv"
    limit, scaled = (
        json.loads(run("calibrate", *files, *NOISE, "--json", *extra).stdout)
        for extra in (("--method", "4dpa"), ("--scale", "1e4"))
    )
    assert (limit["method"], scaled["method"]) == ("4dpa", "4dpa")
    np.testing.assert_allclose(scaled["X"], limit["X"], atol=1e-7)
    assert scaled["scale"] == 1e4
    for file in files:
        text = file.read_text().splitlines()
        rows = [text[0]]
        for line in text[1:]:
            fields = line.split(",")
            rows.append(",".join([fields[0], *(repr(1000 * float(x)) for x in fields[1:4]), *fields[4:]]))
        (tmp_path / file.name).write_text("\n".join(rows))
    millimetres = tmp_path / "robot.csv", tmp_path / "camera.csv"
    done = run("calibrate", *millimetres, *NOISE)
    assert done.returncode == 3 and "--units mm; with --units m" in done.stdout.splitlines()[-1] and done.stderr == ""
    assert "look like millimetres" in run("calibrate", *millimetres, *NOISE, "-v").stdout
    for method in ("4dpa", "efficient"):
        options = (*NOISE, "--json", "--method", method)
        data = json.loads(run("calibrate", *millimetres, "--units", "mm", *options).stdout)
        in_metres = limit if method == "4dpa" else json.loads(run("calibrate", *files, *options).stdout)
        np.testing.assert_allclose(data["X"], in_metres["X"], atol=1e-12)


def broken(session, tmp_path, edit):
    """A copy of the robot file with its lines edited."""
    lines = (session / "robot.csv").read_text().splitlines()
    file = tmp_path / "robot.csv"
    file.write_text("\n".join(edit(lines)) + "\n")
    return file


BAD_FILES = {
    "empty": (lambda lines: [], ["robot.csv", "empty"]),
    "header": (
        lambda lines: ["a,b,c", *(",".join(line.split(",")[:3]) for line in lines[1:])],
        ["robot.csv, line 1", "timestamp,x,y,z,qx,qy,qz,qw", "docs/"],
    ),
    "text": (lambda lines: [*lines[:3], lines[3].replace(",", ",zero,", 1).rsplit(",", 1)[0]], ["line 4", "column x"]),
    "nan": (
        lambda lines: [*lines[:3], re.sub(r",[^,]*$", ",nan", lines[3]), *lines[4:]],
        ["line 4", "column qw", "nan"],
    ),
    "inf": (
        lambda lines: [*lines[:3], re.sub(r",[^,]*$", ",inf", lines[3]), *lines[4:]],
        ["line 4", "column qw", "inf"],
    ),
    "norm": (lambda lines: [*lines[:3], re.sub(r",[^,]*$", ",2", lines[3]), *lines[4:]], ["line 4", "norm"]),
    "rows": (lambda lines: lines[:-1], ["robot.csv", "camera.csv", "11 poses", "12"]),
    # The time of the row before with other numbers; a row that repeats all of it is left out (test_repeated_rows).
    "twice": (
        lambda lines: [*lines[:4], ",".join([lines[3].split(",")[0], *lines[4].split(",")[1:]]), *lines[5:]],
        ["line 5", "timestamp", "repeats"],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD_FILES)
def test_bad_files(session, tmp_path, name):
    edit, parts = BAD_FILES[name]
    out = tmp_path / "out"
    done = run("calibrate", broken(session, tmp_path, edit), session / "camera.csv", *NOISE, "-o", out)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("uq-handeye: error: ")
    for part in parts:
        assert part in done.stderr
    assert not out.exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["missing.csv", "camera.csv"], ["missing.csv", "no such file"]),
        (["robot.csv", "."], ["folder"]),
        ([], ["Missing argument", "ROBOT", "uq-handeye calibrate --help"]),
        (["robot.csv"], ["robot.csv", "the other side"]),
        (["robot.csv", "camera.csv", "--method", "efficent"], ["got 'efficent'", "Did you mean efficient?"]),
        (["robot.csv", "camera.csv", "--robot-nois", "1deg,1mm"], ["--robot-nois", "--robot-noise"]),
        (["robot.csv", "camera.csv", "--pair", "timed"], ["--pair", "rows, time, async", "Did you mean time?"]),
        (["robot.csv", "camera.csv", "--time-tolerance", "1"], ["--time-tolerance needs --pair time"]),
        (["robot.csv", "camera.csv", "--offset", "1"], ["--offset needs --pair async"]),
        (["robot.csv", "camera.csv", "--pair", "async", "--offset", "1s"], ["--offset", "-0.015", "'1s'"]),
        (["robot.csv", "--pair", "async"], ["two streams", "the camera file"]),
        (["robot.csv", "camera.csv", "--format", "cvs"], ["format", "csv", "got 'cvs'"]),
        (["robot.csv", "camera.csv", "--robot-frame", "base"], ["robot_frame", "gripper_T_base"]),
        (["robot.csv", "camera.csv", "--report", "report.doc"], ["--report", ".html or .pdf", "report.doc"]),
        (["robot.csv", "camera.csv", "--report", "nowhere/r.html"], ["there is no folder nowhere"]),
        (["robot.csv", "camera.csv", "--no-compare"], ["--no-compare", "--report FILE"]),
        (["robot.csv", "camera.csv", "--with-cross-check"], ["--with-cross-check", "--report FILE"]),
        (["robot.csv", "camera.csv", "-q", "-v"], ["either --quiet or --verbose"]),
        (["robot.csv", "camera.csv", "--log-file", "nowhere/log"], ["--log-file", "nowhere/log"]),
        (["robot.csv", "camera.csv", "more"], ["more"]),
        (["robot.csv", "camera.csv", "--robot-noise", "1,2"], ["unit", "rad"]),
        (["robot.csv", "camera.csv", "--robot-noise", "1deg"], ["--robot-noise", "0.02deg,0.05mm"]),
        (["robot.csv", "camera.csv", "--robot-noise", "1deg,2parsec"], ["Unknown unit 'parsec'"]),
        (["robot.csv", "camera.csv", "--robot-noise", "1mm,2deg"], ["--robot-noise", "swapped", "2deg,1mm"]),
        (["robot.csv", "camera.csv", "--camera-noise=-1deg,2mm"], [">= 0", "-1deg"]),
        (["robot.csv", "camera.csv", "--setup", "eye"], ["eye-in-hand"]),
        (["robot.csv", "camera.csv", "--pairs", "some"], ["consecutive"]),
        (["robot.csv", "camera.csv", "--method", "magic"], ["magic"]),
        (["robot.csv", "camera.csv", "--scale", "-1"], ["scale"]),
        (["robot.csv", "camera.csv", "--scale", "x"], ["scale"]),
        (["robot.csv", "camera.csv", "--kind", "some"], ["kind", "some"]),
        (["robot.csv", "camera.csv", "--kind", "literal"], ["literal", "'poses' or 'pairs'"]),
        (["robot.csv", "camera.csv", "--kind", "pairs", "--method", "ml"], ["kind='pairs'", "published methods"]),
        (["robot.csv", "camera.csv", "--scale", "1e4", "--method", "ml"], ["scale", "4dpa"]),
        (["robot.csv", "camera.csv", "--robust", "--method", "park"], ["robust", "efficient or ml"]),
        (["robot.csv", "camera.csv", "--covariance", "magic"], ["covariance", "sandwich", "magic"]),
        (["robot.csv", "camera.csv", "--robot-prior", "1mm"], ["--robot-prior", "?,0.05mm"]),
        (["robot.csv", "camera.csv", "--robot-prior", "?,0.05mm", "--prior-factor", "0.5"], ["factor", "0.5"]),
        (["robot.csv", "camera.csv", "--robot-prior", "?,1mm", "--camera-noise", "1deg,1mm"], ["prior", "both given"]),
        (["robot.csv", "camera.csv", "--units", "mile"], ["mile"]),
        (["robot.csv", "camera.csv", "--frobnicate"], ["--frobnicate"]),
        (["robot.csv", "camera.csv", "--noise", "no.toml"], ["no.toml"]),
        (["robot.csv", "camera.csv", *NOISE, "-o", "robot.csv"], ["robot.csv"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_bad_usage(session, arguments, parts):
    done = run("calibrate", *arguments, cwd=session)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    for part in parts:
        assert part in done.stderr


def test_two_poses(session, tmp_path):
    for name in ("robot.csv", "camera.csv"):
        (tmp_path / name).write_text("\n".join((session / name).read_text().splitlines()[:3]) + "\n")
    done = run("calibrate", tmp_path / "robot.csv", tmp_path / "camera.csv")
    assert done.returncode == 2
    assert "At least 3 are needed" in done.stderr


def test_warnings_go_to_stderr_and_leave_json_alone(session):
    done = run("calibrate", session / "camera.csv", session / "robot.csv", "--json")
    assert done.returncode == 0
    assert "uq-handeye: warning: The camera would sit" in done.stderr
    assert len(json.loads(done.stdout)["warnings"]) == done.stderr.count("\n")


@pytest.mark.slow
def test_compare(session, tmp_path):
    files = session / "robot.csv", session / "camera.csv"
    done = run("compare", *files, *NOISE, "-o", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    names = sorted(file.name for file in (tmp_path / "out").iterdir())
    assert names == [f"comparison.{kind}" for kind in ("csv", "json", "png", "svg")]
    data = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert [row["method"] for row in data["methods"]] == ["efficient", *uq.METHODS]
    assert done.stdout.startswith(f"{len(uq.METHODS)} of {len(uq.METHODS)} methods agree with efficient at 95 %.")
    assert data["verdict"] in " ".join(done.stdout.split())
    assert "\x1b" not in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 120
    assert (tmp_path / "out" / "comparison.csv").read_text().count("\n") == len(uq.METHODS) + 2
    assert (tmp_path / "out" / "comparison.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.slow
def test_compare_prints_json_or_csv(session):
    files = session / "robot.csv", session / "camera.csv"
    some = ("--methods", " Park, tsai,,", "--reference", "Chou", "--pairs", "consecutive")
    data = json.loads(run("compare", *files, *some, "--json").stdout)
    assert ([row["method"] for row in data["methods"]], data["n_pairs"]) == (["chou", "park", "tsai"], 11)
    assert data["reference"] == "chou"
    assert data["noise_estimated"] is True
    assert [row["agrees"] for row in data["methods"]] == [
        row["d2"] <= data["agrees_up_to_d2"] for row in data["methods"]
    ]
    assert "noise estimated from them" in " ".join(run("compare", *files, *some).stdout.split())
    rows = run("compare", *files, *some, "--csv").stdout.splitlines()
    assert [row.split(",")[0] for row in rows] == ["method", "chou", "park", "tsai"]
    for arguments, part in (
        (["--json", "--csv"], "not both"),
        (["--methods", "park,magic"], "--methods to name methods among efficient, ml, tsai"),
        (["--methods", " , "], "got ' , '"),
        (["--reference", "magic"], "--reference to name one method among efficient, ml, tsai"),
        (["--reference", "park,tsai"], "got 'park,tsai'"),
        (["--pairs", "some"], "consecutive"),
        (["--robot-noise", "1,2"], "unit"),
    ):
        done = run("compare", *files, *arguments)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
        assert part in done.stderr


@pytest.mark.slow
def test_compare_keeps_its_table_if_every_method_fails(session, tmp_path):
    line = (session / "robot.csv").read_text().splitlines()
    fields = line[1].split(",")
    rows = [",".join([row.split(",")[0], *row.split(",")[1:4], *fields[4:]]) for row in line[1:]]
    (tmp_path / "robot.csv").write_text("\n".join([line[0], *rows]) + "\n")
    done = run("compare", tmp_path / "robot.csv", session / "camera.csv", "-o", tmp_path / "out")
    assert done.returncode == 2
    assert f"None of the {1 + len(uq.METHODS)} methods gave a result" in done.stdout
    assert all(f"\n{name} " in done.stdout for name in uq.METHODS)
    errors = [line for line in done.stderr.splitlines() if not line.startswith("uq-handeye: warning: ")]
    assert errors == ["uq-handeye: error: Every method failed. The table lists the reasons."]
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["comparison.csv", "comparison.json"]


@pytest.mark.slow
def test_compare_prints_its_table_even_if_it_cannot_write(session, tmp_path, monkeypatch):
    def full(*_):
        raise uq.InputError("Cannot write comparison.json: no space left on device.")

    monkeypatch.setattr("uq_handeye.read.write_files", full)
    files = session / "robot.csv", session / "camera.csv"
    done = run("compare", *files, *NOISE, "--methods", "park,tsai", "-o", tmp_path / "out")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "efficient" in done.stdout


def test_no_convergence_is_one_line(monkeypatch, capsys, session):
    def give_up(*_, **__):
        raise uq.NotConvergedError("Method 'gwak' did not converge\nwithin 100 iterations.")

    monkeypatch.setattr("uq_handeye.calibration.calibrate.calibrate", give_up)
    with pytest.raises(SystemExit) as end:
        cli.main(["calibrate", str(session / "robot.csv"), str(session / "camera.csv"), "--method", "gwak"])
    assert end.value.code == 2
    expected = "uq-handeye: error: Method 'gwak' did not converge within 100 iterations.\n"
    assert capsys.readouterr() == ("", expected)


def test_help_names_the_methods():
    for command in ("calibrate", "compare"):
        shown = "".join(run(command, "--help-all").stdout.split())
        assert ",".join(uq.METHODS) in shown


@pytest.mark.slow
def test_pipe_that_closes_early(tmp_path):
    program = "from uq_handeye.cli.app import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", program, "demo", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 0


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_full_disk_behind_stdout():
    program = "from uq_handeye.cli.app import main; main()"
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", program, "demo", "--json"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == "uq-handeye: error: Cannot write the output: No space left on device.\n"


@pytest.mark.slow
def test_figures_are_drawn_when_they_are_asked_for(session, tmp_path):
    out = ("calibrate", *files_of(session), "-o", tmp_path / "out")
    for more, drawn in ((*NOISE, "--figures"), PICTURES), (NOISE, []):
        assert run(*out, *more).returncode == 0
        names = {file.name for file in (tmp_path / "out").iterdir()}
        assert names == {*drawn, *EXPORTS, "poses.csv", "result.json"}
    for command in ("demo", "calibrate robot.csv camera.csv", "update result.json robot.csv camera.csv"):
        done = run(*command.split(), "--figures")
        assert (done.returncode, done.stdout) == (2, "") and "--figures needs -o DIR" in done.stderr


@pytest.mark.slow
def test_old_files_do_not_stay_beside_a_new_result(session, tmp_path, monkeypatch):
    def one(result, *_):
        return {} if result.covariance is None else {"ellipses": Figure(figsize=(1, 1))}

    monkeypatch.setattr("uq_handeye.report.figures.figures", one)

    def written(folder, *options):
        assert run("calibrate", *files_of(folder), *options, "-o", tmp_path / "out", "--figures").returncode == 0
        return sorted(file.name for file in (tmp_path / "out").iterdir())

    assert run("simulate", "-o", tmp_path / "exact", "--poses", 12, "--seed", 3).returncode == 0
    every = {"ellipses.png", "ellipses.svg", *EXPORTS, "poses.csv", "result.json"}
    assert set(written(session)) == every
    for name in (*PICTURES, "notes.txt"):
        (tmp_path / "out" / name).write_text("of an earlier run, or of the user")
    kept = {"notes.txt"}
    assert set(written(session, "--method", "park")) == (every - {"poses.csv"}) | kept
    assert set(written(session, *NOISE)) == every | kept
    assert set(written(tmp_path / "exact")) == {*EXPORTS, "result.json"} | kept  # exact data: no covariance, no table


def test_overflow_and_seed(session):
    files = session / "robot.csv", session / "camera.csv"
    for arguments in (["--robot-noise", "1e200deg,1mm"], ["--camera-noise", "0.1deg,1e160m"], ["-o", ""]):
        done = run("calibrate", *files, *arguments)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "--seed" in run("simulate", "-o", session / "never", "--seed", "-1").stderr


@pytest.mark.slow
def test_help_has_examples():
    assert run().stdout == run("--help").stdout
    assert run("--version").stdout == f"uq-handeye {uq.__version__}\n"
    commands = [command.name for command in cli.app.registered_commands]
    assert len(commands) == 24
    for command in commands:
        done = run(command, "--help")
        assert done.returncode == 0
        assert command in run("--help").stdout


def test_demo_data_are_those_of_the_command_in_their_readme(tmp_path):
    data = ROOT / "uq_handeye" / "data"
    command = re.search(r"uq-handeye simulate -o \S+ (.*)", (data / "README.md").read_text())
    run("simulate", "-o", tmp_path, *command[1].split())
    for name in ("robot", "camera", "truth"):
        made, kept = (np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1) for folder in (tmp_path, data))
        np.testing.assert_allclose(made, kept, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("side", ["robot", "camera"])
def test_noise_of_one_side_alone_leaves_the_other_to_the_data(session, side):
    """Not exact, as which X would seem far too sure; ``exact`` says so where it is meant."""
    files = (session / "robot.csv", session / "camera.csv")
    noise = {"robot": "0.02deg,0.05mm", "camera": "0.1deg,0.5mm"}
    other = "camera" if side == "robot" else "robot"
    given = (f"--{side}-noise", noise[side])
    one, both, exact = (
        json.loads(run("calibrate", *files, *given, *more, "--json").stdout)
        for more in ((), (f"--{other}-noise", noise[other]), (f"--{other}-noise", "exact"))
    )
    sizes = [np.sqrt(np.diag(data["covariance"])[3:].mean()) for data in (one, both, exact)]
    assert 0.5 < sizes[0] / sizes[1] < 2
    if side == "robot":
        assert sizes[2] < 0.3 * sizes[1]
    status = {part["name"]: part["status"] for part in one["noise_estimate"]["components"]}
    assert status[f"{side} rotation"] == status[f"{side} translation"] == "fixed"
    assert exact["noise_estimate"] is None
    refused = run("calibrate", *files, "--robot-noise", "exact", "--camera-noise", "exact")
    assert refused.returncode == 2 and "cannot both be exact" in refused.stderr
    # every other command takes the same noise; a prior beside it contradicts it
    found = json.loads(run("compare", *files, *given, "--methods", "park", "--json").stdout)
    assert found["methods"]
    refused = run("calibrate", *files, *given, f"--{other}-prior", "?,1mm")
    assert refused.returncode == 2 and "both given" in refused.stderr


@pytest.mark.slow
@pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")
@pytest.mark.parametrize("name", ["kuka_1", "nguyen_pham", "synthetic_camera_2"])
def test_real_data(name):
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / name
    done = run("calibrate", folder / "robot.csv", folder / "camera.csv", "--camera-noise", "0.5deg,2mm", "--json")
    assert done.returncode == 0
    data = json.loads(done.stdout)
    if name == "synthetic_camera_2":
        truth = uq.read_pose_file(folder / "truth.csv")[1][0]
        assert np.abs(np.array(data["X"]) - truth).max() < 0.01
