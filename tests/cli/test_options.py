"""Options that the commands have in common: groups of options, names that are completed, pairing, the warnings of
calibrate.
"""

import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pytest
import typer
from fixtures.commands import NOISE, run, write_session

import uq_handeye as uq
from uq_handeye.cli import app as cli
from uq_handeye.cli import names as cli_names
from uq_handeye.cli.commands import export as cli_files
from uq_handeye.cli.options import choices, parameters_of, with_messages, without_options
from uq_handeye.cli.values import methods_of, one_of
from uq_handeye.core.geometry.conventions import CONVENTIONS
from uq_handeye.core.geometry.frames import SETUPS
from uq_handeye.core.presentation.units import LENGTH_UNITS
from uq_handeye.fit.graph.gauss_helmert import ESTIMATORS
from uq_handeye.fit.graph.request import COVARIANCES
from uq_handeye.formats.controllers.forms import CONTROLLERS
from uq_handeye.formats.export import FORMATS as EXPORTED
from uq_handeye.methods.registry import METHODS, ROBOT_WORLD_METHODS
from uq_handeye.read import FORMATS, pose_text, write_pose_file

TAKES_POSES = ("calibrate", "compare", "plan", "validate", "posterior", "cross-check")


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    scaled = write_session(folder).camera.copy()
    scaled[:, :3, 3] *= 1e3
    write_pose_file(folder / "millimetres.csv", scaled)
    return folder


# --------------------------------------------------------------------------------------------- names, completion


def test_names_are_those_of_the_registries():
    assert tuple(ESTIMATORS) == cli_names.AT_THE_BOUND
    assert tuple(METHODS) == cli_names.PUBLISHED
    assert tuple(ROBOT_WORLD_METHODS) == cli_names.ROBOT_WORLD
    assert tuple(SETUPS) == cli_names.SETUP_NAMES
    assert cli_names.COVARIANCE_NAMES == COVARIANCES
    assert set(cli_names.FORMAT_NAMES) == set(FORMATS)
    assert tuple(CONTROLLERS) == cli_names.CONTROLLER_NAMES
    assert tuple(CONVENTIONS) == cli_names.CONVENTION_NAMES
    assert set(cli_names.UNITS) <= set(LENGTH_UNITS)
    assert set(cli_files.EXPORT_NAMES) == set(EXPORTED)


def test_choices_complete_the_last_of_a_list():
    complete = choices(("park", "tsai", "park2"))
    assert complete("pa") == ["park", "park2"]
    assert complete("tsai,p") == ["tsai,park", "tsai,park2"]
    assert complete("x") == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("calib", ["calibrate"]),
        ("calibrate --setup eye-t", ["eye-to-hand"]),
        ("calibrate --method eff", ["efficient"]),
        ("compare --methods tsai,pa", ["tsai,park"]),
        ("validate --pair a", ["async"]),
        ("plan --format easy", ["easy_handeye", "easy_handeye2"]),
        ("export --format urd", ["urdf"]),
        ("calibrate --robot-fr", ["--robot-frame"]),
    ],
)
def test_a_shell_completes(words, expected):
    environment = {
        **os.environ,
        "_UQ_HANDEYE_COMPLETE": "complete_bash",
        "COMP_WORDS": f"uq-handeye {words}",
        "COMP_CWORD": str(len(words.split())),
    }
    command = [sys.executable, "-m", "uq_handeye"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout.split()) == (0, expected)


@pytest.mark.slow
def test_help_and_completion_load_nothing_that_takes_long():
    """Modules that `import uq_handeye` itself loads are not counted."""
    program = (
        "import sys, uq_handeye; before = set(sys.modules)\n"
        "from uq_handeye.cli.app import main\n"
        "try: main(['calibrate', '--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted({name.split('.')[0] for name in set(sys.modules) - before}))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    loaded = set(eval(done.stdout.splitlines()[-1]))
    assert not loaded & {"pandas", "matplotlib", "sympy", "emcee", "scipy", "numpy", "yaml", "jinja2"}


@pytest.mark.slow
def test_a_calibration_loads_nothing_that_it_does_not_need(tmp_path):
    """Each of these takes as long to import as NumPy or the poses to be calibrated."""
    write_session(tmp_path)
    program = (
        "import sys\nfrom uq_handeye.cli.app import main\n"
        "try: main(['calibrate', 'robot.csv', 'camera.csv'])\nexcept SystemExit: pass\n"
        "print(sorted(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=True
    )
    loaded = set(eval(done.stdout.splitlines()[-1]))
    assert not loaded & {"scipy.spatial", "scipy.sparse", "scipy.optimize", "pydantic", "pandas", "jinja2"}


# -------------------------------------------------------------------------------------------- groups of options


def test_parameters_that_are_made_of_others_spread():
    def pair(first: int, second: int = 2) -> tuple[int, int]:
        return first, second

    @with_messages
    def command(both: Annotated["tuple[int, int]", pair], third: int = 3) -> tuple[int, ...]:
        """Help."""
        return (*both, third)

    given = {"quiet": False, "verbose": False, "log_file": None, "no_color": False}
    assert command(first=1, second=5, third=7, **given) == (1, 5, 7)
    assert command.__doc__ == "Help."
    app = typer.Typer()
    app.command()(command)
    assert app(["1", "--second", "4"], standalone_mode=False) == (1, 4, 3)


def test_every_command_that_takes_poses_has_the_same_options():
    helps = {name: run(name, "--help-all").stdout for name in TAKES_POSES}
    for option in (
        *("--setup", "--format", "--units", "--rotation"),
        *("--quaternion", "--robot-frame", "--camera-frame", "--pair"),
        *("--time-tolerance", "--offset", "--robot-noise", "--camera-noise", "--noise", "--quiet", "--log-file"),
    ):
        for name, text in helps.items():
            assert f"{option} " in text, (name, option)


def test_one_of_and_methods_of():
    assert one_of("ROWS", "--pair", ("rows", "time")) == "rows"
    assert methods_of("Tsai, park,,tsai", "--methods", ("tsai", "park")) == ["tsai", "park"]
    with pytest.raises(uq.InputError, match=r"got 'row'. Did you mean rows\?"):
        one_of("row", "--pair", ("rows", "time"))
    with pytest.raises(uq.InputError, match=r"got 'x'\.$"):
        one_of("x", "--pair", ("rows", "time"))
    with pytest.raises(uq.InputError, match="one method among"):
        methods_of("tsai,park", "--reference", ("tsai", "park"), most=1)


# ------------------------------------------------------------------------------------------ files and pairing


@pytest.mark.slow
def test_options_reach_the_reader(session, tmp_path):
    """Inverted frames, quaternions with the scalar first, units and formats give the X of the plain files."""
    poses = uq.read_poses(session / "robot.csv", session / "camera.csv")
    expected = json.loads(run("calibrate", "robot.csv", "camera.csv", *NOISE, "--json", cwd=session).stdout)["X"]
    lines = pose_text(np.linalg.inv(poses.robot)).splitlines()
    fields = [line.split(",") for line in lines[1:]]
    rows = [" ".join([f[0], *(repr(100 * float(x)) for x in f[1:4]), f[7], *f[4:7]]) for f in fields]
    (tmp_path / "robot.txt").write_text("\n".join(rows) + "\n")
    np.save(tmp_path / "camera.npy", np.linalg.inv(poses.camera))
    for options in (("--units", "robot=cm", "--quaternion", "robot=wxyz"), ("--units", "robot=cm,camera=m")):
        order = () if "--quaternion" in options else ("--quaternion", "robot=wxyz")
        frames = ("--robot-frame", "gripper_T_base", "--camera-frame", "target_T_camera")
        formats = ("--format", "robot=tum,camera=npy")
        done = run(
            "calibrate", "robot.txt", "camera.npy", *NOISE, *options, *order, *frames, *formats, "--json", cwd=tmp_path
        )
        np.testing.assert_allclose(json.loads(done.stdout)["X"], expected, atol=1e-9)


def test_pairing_by_time(session, tmp_path):
    poses = uq.read_poses(session / "robot.csv", session / "camera.csv")
    times = np.arange(12.0)
    write_pose_file(tmp_path / "robot.csv", poses.robot, timestamps=times)
    write_pose_file(tmp_path / "camera.csv", poses.camera[1:], timestamps=times[1:] + 0.1)
    refused = run("calibrate", "robot.csv", "camera.csv", *NOISE, "--pair", "time", cwd=tmp_path)
    assert refused.returncode == 2
    done = run("calibrate", "robot.csv", "camera.csv", *NOISE, "--pair", "time", "--time-tolerance", 0.2, cwd=tmp_path)
    assert done.returncode == 0 and ": 11 poses" in done.stdout


# -------------------------------------------------------------------------------- the same warnings as calibrate

QUICK = {
    "validate": ("--trials", 50, "--workers", 1, "--method", "4dpa"),
    "plan": ("-k", 1, "--sample", 20),
    "cross-check": ("--trials", 200, "--workers", 1, "--no-posterior"),
    "posterior": ("--samples", 200, "--walkers", 32, "--max-steps", 10),
}


@pytest.mark.slow
@pytest.mark.parametrize("files", [("camera.csv", "robot.csv"), ("robot.csv", "millimetres.csv")])
@pytest.mark.parametrize("noise", [NOISE, ()])
def test_what_calibrate_warns_of_every_command_warns_of(session, files, noise):
    said = run("calibrate", *files, *noise, "--json", cwd=session).stderr.splitlines()
    warned = [line for line in said if line.startswith("uq-handeye: warning: ")]
    assert warned
    for name in ("validate", "cross-check", "posterior"):  # plan looks at the input alone
        done = run(name, *files, *noise, *QUICK[name], cwd=session)
        if name != "posterior" and done.returncode == 0:  # its text has the checks
            assert "calibrate warns:" in " ".join(done.stdout.split()), name
            assert re.search(" (input|residuals) ", done.stdout), name
        else:
            assert set(warned) <= set(done.stderr.splitlines()), name


@pytest.mark.slow
def test_good_files_are_not_warned_of(session):
    for name in ("validate", "plan", "cross-check"):
        done = run(name, "robot.csv", "camera.csv", *NOISE, *QUICK[name], cwd=session)
        assert (done.returncode, done.stderr) == (0, ""), name


def test_the_commands():
    names = [command.name for command in cli.app.registered_commands]
    of_a_result = {"report", "export", "predict", "check", "update", "diff", "verify", "certificate", "view"}
    assert set(TAKES_POSES) | of_a_result | {
        "demo",
        "camera",
        "scene",
        "points",
        "simulate",
        "sync",
        "bag",
        "codegen",
        "live",
    } == set(names)


# ------------------------------------------------------------------------------------- options in docstrings

WAYS = ("rows", "time")


@dataclass(frozen=True)
class Base:
    """Options of a test.

    Options (Pose files):
      * --way HOW <WAYS>: Pairing, one of {WAYS}. It
        goes on here.
      as_json, is no entry
    """

    way: str | None = None


@dataclass(frozen=True)
class More(Base):
    """Further options.

    Options:
      as_json = --json: One object.
      -n, --count N <one|two>: How many.
    """

    as_json: bool = False
    count: int = 3


def test_options_are_declared_in_docstrings(monkeypatch):
    monkeypatch.setattr(Base, "__doc__", Base.__doc__.replace("      as_json, is no entry\n", ""))
    way, as_json, count = (parameter.annotation.__metadata__[0] for parameter in parameters_of(More))
    assert (way.default, way.metavar, str(way.rich_help_panel)) == ("--way", "HOW", "Pose files")
    assert way.help == "Pairing, one of rows, time. It goes on here." and way.rich_help_panel.common
    assert way.autocompletion("t") == ["time"] and count.autocompletion("") == ["one", "two"]
    assert (as_json.default, as_json.metavar, count.param_decls) == ("--json", "", ("--count",))
    assert [parameter.default for parameter in parameters_of(More)] == [None, False, 3]
    assert without_options(More.__doc__) == "Further options."


def test_what_a_docstring_declares_wrongly_is_refused(monkeypatch):
    with pytest.raises(TypeError, match=r"expected an option such as .* got .*no entry"):
        parameters_of(Base)
    monkeypatch.setattr(Base, "__doc__", "Options.\n\nOptions:\n  --wya HOW: Pairing.")
    with pytest.raises(TypeError, match="Base has no parameter wya"):
        parameters_of(Base)


@pytest.mark.slow
def test_covariances_in_the_convention_of_a_library(tmp_path):
    R = uq.simulate(12, seed=3).camera[:, :3, :3]
    S = np.zeros((12, 6, 6))
    S[:, :3, :3], S[:, 3:, 3:] = R @ np.diag([1e-6, 3e-6, 6e-6]) @ R.mT, R @ np.diag([1e-7, 2e-7, 5e-7]) @ R.mT
    S = 0.5 * (S + S.mT)
    noise = uq.PoseNoise(np.diag([np.radians(0.02) ** 2] * 3 + [5e-5**2] * 3), S)
    poses = uq.simulate(12, noise=noise, seed=3)
    write_pose_file(tmp_path / "robot.csv", poses.robot)
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    numbers = uq.to_convention(S, poses.camera, "gtsam")
    text = f"[robot]\nrotation = '0.02deg'\ntranslation = '0.05mm'\n[camera]\ncovariance = {numbers.tolist()}\n"
    (tmp_path / "noise.toml").write_text(text)
    command = ["calibrate", "robot.csv", "camera.csv", "--noise", "noise.toml", "--json"]
    done = run(*command, "--covariance-convention", "gtsam", cwd=tmp_path)
    expected = uq.calibrate(poses, noise=noise).covariance
    np.testing.assert_allclose(json.loads(done.stdout)["covariance"], expected, rtol=1e-5, atol=1e-14)
    other = run(*command, cwd=tmp_path)
    assert np.abs(np.array(json.loads(other.stdout)["covariance"]) / expected - 1).max() > 0.01
    wrong = run(*command, "--covariance-convention", "gtsm", cwd=tmp_path)
    assert "--covariance-convention: Unknown convention 'gtsm'" in wrong.stderr
    assert "Did you mean 'gtsam'" in wrong.stderr
    (tmp_path / "noise.toml").write_text(text + "convention = 'gtsam'\n")
    again = json.loads(run(*command, cwd=tmp_path).stdout)
    assert again["covariance"] == json.loads(done.stdout)["covariance"]
    unused = run("calibrate", "robot.csv", "camera.csv", *NOISE, "--covariance-convention", "gtsam", cwd=tmp_path)
    assert "neither a noise file nor the camera poses hold a covariance" in unused.stderr
    refused = run("simulate", "--noise", "noise.toml", "-o", "new", cwd=tmp_path)
    assert "simulate takes covariances as the toolkit has them" in refused.stderr
