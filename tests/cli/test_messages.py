"""Messages of a command beside its result: notes, warnings, errors, colours, progress, the log file, exit statuses."""

import json
import logging
import os
import re
import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest
from fixtures.commands import NOISE, run, run_as_on_terminal, run_on_terminal, run_process, write_session

import uq_handeye as uq
from uq_handeye import InputWarning
from uq_handeye.cli.messages import Messages, messages, styled, terminal_width, withheld

YELLOW, RED, BOLD = "\x1b[33m", "\x1b[31m", "\x1b[1m"
LOG = logging.getLogger("uq_handeye")


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    write_session(folder)
    return folder


@pytest.fixture
def talkative(monkeypatch):
    """`calibrate` that logs, warns and then goes on."""
    ordinary = uq.calibrate

    def calibrate(*args, **kwargs):
        LOG.debug("a detail")
        LOG.info("a finding")
        warnings.warn("a doubt", uq.InputWarning, stacklevel=1)
        warnings.warn("a doubt", uq.InputWarning, stacklevel=1)
        return ordinary(*args, **kwargs)

    monkeypatch.setattr("uq_handeye.calibration.calibrate.calibrate", calibrate)


@pytest.fixture
def broken(monkeypatch):
    """`calibrate` with a fault."""

    def calibrate(*_, **__):
        raise ZeroDivisionError("one\nby zero")

    monkeypatch.setattr("uq_handeye.calibration.calibrate.calibrate", calibrate)


# -------------------------------------------------------------------------------------------- what is said where


def test_notes_and_warnings_stand_on_stderr_each_once(session, talkative):
    done = run("calibrate", "robot.csv", "camera.csv", *NOISE, "--json", cwd=session)
    assert done.stderr == "uq-handeye: note: a finding\nuq-handeye: warning: a doubt\n"
    assert json.loads(done.stdout)["method"] == "efficient"


@pytest.mark.slow
@pytest.mark.parametrize("quiet", ["-q", "--quiet"])
@pytest.mark.parametrize("before", [True, False])
def test_quiet_before_or_after_the_command(session, talkative, quiet, before):
    command = ("calibrate", "robot.csv", "camera.csv", *NOISE)
    done = run(*((quiet, *command) if before else (*command, quiet)), cwd=session)
    assert (done.returncode, done.stderr) == (0, "")
    assert np.loadtxt(done.stdout.splitlines()).shape == (4, 4)
    wrong = run("calibrate", "robot.csv", "nothing.csv", quiet, cwd=session)
    assert wrong.returncode == 2 and "no such file" in wrong.stderr


@pytest.mark.slow
@pytest.mark.parametrize("before", [True, False])
def test_verbose_says_what_is_done_and_how_long_it_takes(session, talkative, before):
    command = ("calibrate", "robot.csv", "camera.csv", *NOISE)
    done = run(*(("-v", *command) if before else (*command, "--verbose")), cwd=session)
    lines = done.stderr.splitlines()
    assert "uq-handeye: a detail" in lines and "uq-handeye: 12 pairs of poses, eye-in-hand" in lines
    assert any(re.fullmatch(r"uq-handeye: calibrating: done in \d+\.\d\d s", line) for line in lines)


def test_log_file_has_everything_and_is_appended_to(session, talkative, tmp_path):
    log = tmp_path / "run.log"
    run("calibrate", "robot.csv", "camera.csv", *NOISE, "--log-file", log, "-q", cwd=session)
    run("--log-file", log, "calibrate", "robot.csv", "nothing.csv", cwd=session)
    text = log.read_text()
    assert all(re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} [A-Z]+ ", line) for line in text.splitlines())
    for part in (
        f"DEBUG uq-handeye {uq.__version__}: uq-handeye calibrate robot.csv camera.csv",
        "DEBUG a detail",
        "INFO a finding",
        "WARNING a doubt",
        "nothing.csv (in ",
        "ERROR Cannot read nothing.csv",
    ):
        assert part in text


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
def test_a_log_file_that_cannot_be_written_does_not_end_the_run(session):
    done = run("calibrate", "robot.csv", "camera.csv", *NOISE, "--log-file", "/dev/full", cwd=session)
    assert done.returncode == 0 and done.stdout.startswith("gripper_T_camera")
    assert "warning: Cannot write the log file /dev/full any more" in done.stderr and done.stderr.count("\n") == 1


@pytest.mark.slow
def test_nothing_of_a_run_stays_behind(session, talkative):
    before = list(LOG.handlers), LOG.level, LOG.propagate, warnings.showwarning, list(warnings.filters)
    run("calibrate", "robot.csv", "camera.csv", "-v", "--no-color", cwd=session)
    assert (list(LOG.handlers), LOG.level, LOG.propagate, warnings.showwarning, list(warnings.filters)) == before


# ------------------------------------------------------------------------------------------------ exit statuses


def test_an_internal_error_is_one_line_and_status_1(session, broken, tmp_path):
    done = run("calibrate", "robot.csv", "camera.csv", cwd=session)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    for part in ("uq-handeye: error: internal error: ZeroDivisionError: one by zero", "--log-file", "report it"):
        assert part in done.stderr
    verbose = run("calibrate", "robot.csv", "camera.csv", "-v", cwd=session)
    assert verbose.returncode == 1 and "Traceback (most recent call last)" in verbose.stderr
    kept = run("calibrate", "robot.csv", "camera.csv", "--log-file", tmp_path / "log", cwd=session)
    assert kept.stderr.count("\n") == 1 and "the log file has the details" in kept.stderr
    assert "Traceback (most recent call last)" in (tmp_path / "log").read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["calibrat"], ["No such command 'calibrat'", "Did you mean 'calibrate'"]),
        (["--verison"], ["--verison", "--version"]),
        (
            ["calibrate", "robot.csv", "camera.csv", "--methd", "park"],
            ["--method", "(see uq-handeye calibrate --help)"],
        ),
        (["calibrate", "robot.csv", "camera.csv", "--seed", "x"], ["--seed", "integer"]),
        (["calibrate", "empty.csv", "camera.csv"], ["empty.csv", "empty"]),
        (["calibrate", "binary.csv", "camera.csv"], ["binary.csv"]),
        (["compare", "robot.csv", "camera.csv", "--json", "--csv"], ["either --json or --csv"]),
        (["compare", "robot.csv", "camera.csv", "--methods", "prak"], ["Did you mean park?"]),
        (["validate", "robot.csv", "camera.csv", "--method", "eficient"], ["Did you mean efficient?"]),
        (["export", "nothing.json", "x.urdf"], ["nothing.json", "o such file"]),
        (["export", "robot.csv", "x.urdf"], ["robot.csv", "not JSON"]),
        (["export", "robot.csv", "x.urdf", "--format", "udrf"], ["Did you mean urdf?"]),
        (["report", "nothing.json", "r.html"], ["nothing.json", "o such file"]),
        (["report", "nothing.json", "r.txt"], [".html or .pdf", "r.txt"]),
        (["report", "nothing.json", "folder.html"], ["folder.html", "it is a folder"]),
        (["sync", "robot.csv"], ["the camera file"]),
        (["sync", "robot.csv", "camera.csv", "--interpolation", "linear"], ["so4, geodesic", "linear"]),
        (["simulate", "-o", "robot.csv"], ["robot.csv", "expected a folder"]),
        (["calibrate", "robot.csv", "camera.csv", "-o", "robot.csv/x"], ["robot.csv/x", "robot.csv is a file"]),
        (["simulate", "-o", "sim", "--poses", "1000000001"], ["--poses", "from 1 to 1000000", "1000000001"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_bad_input_is_one_line_and_status_2(session, arguments, parts):
    (session / "empty.csv").write_text("")
    (session / "binary.csv").write_bytes(bytes(range(256)))
    (session / "folder.html").mkdir(exist_ok=True)
    done = run(*arguments, cwd=session)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert done.stderr.startswith("uq-handeye: error: ") and "Traceback" not in done.stderr
    for part in parts:
        assert part in done.stderr


@pytest.mark.slow
def test_ctrl_c_while_the_program_is_being_loaded():
    """An import that is interrupted, as by a key at that moment."""
    program = (
        "import sys, builtins\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'uq_handeye.cli.pose_files': raise KeyboardInterrupt\n"
        "from uq_handeye.__main__ import main\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "uq-handeye: interrupted\n")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "status", "said"),
    [
        (NOISE, 0, "Next: take more poses"),
        ((*NOISE, "--tolerance", "5mm,1deg"), 0, "PASS: X lies within 5 mm and 1 deg with a probability of"),
        ((*NOISE, "--tolerance", "5mm", "--at", "0.5m"), 0, "PASS: a point 0.5 m ahead of the camera lies within 5 mm"),
        ((*NOISE, "--tolerance", "0.001mm"), 5, "FAIL: X lies within 0.001 mm"),
        ((*NOISE, "--tolerance", "1mm,0.1deg"), 5, "NOT SHOWN: X lies within 1 mm and 0.1 deg with a probability of"),
        ((*NOISE, "--camera-frame", "target_T_camera"), 3, "NOT USABLE: the camera file seems inverse, or the set"),
        (
            ("--camera-frame", "target_T_camera", "--tolerance", "9mm"),
            3,
            "Next: run again without --camera-frame; or, if the camera is fixed, with --setup eye-to-hand.",
        ),
    ],
    ids=str,
)
def test_the_outcome_of_calibrate(session, tmp_path, options, status, said):
    """The status with each way to print; findings are on stdout or on stderr, and nothing is there twice."""
    files = ("calibrate", "robot.csv", "camera.csv", *options)
    done = run(*files, cwd=session)
    assert done.returncode == status and said in " ".join(done.stdout.split())
    assert done.stdout.count("\n") <= 26 and max(map(len, done.stdout.splitlines())) <= 80
    refused = "NOT USABLE" in done.stdout and "gripper_T_camera" not in done.stdout  # no X at all
    notes = done.stderr.count("uq-handeye: note: ")  # the frame is one of two that fit, unless the setup is said
    assert (
        notes == ("--camera-frame" in options)
        and done.stderr.count("\n") == refused + notes
        and ("error: " in done.stderr) == refused
    )
    quiet = run(*files, "-q", cwd=session)
    assert quiet.returncode == status and (quiet.stderr == "") == (status != 3)
    assert np.loadtxt(quiet.stdout.splitlines()).shape == (4, 4) if not refused else quiet.stdout == ""
    found = run(*files, "--json", cwd=session)
    data = json.loads(found.stdout)
    assert found.returncode == status and data["headline"] in " ".join(done.stdout.split())
    if "--tolerance" in options and status != 3:
        assert said.startswith(data["verdict"]["verdict"]) and data["verdict"]["sentence"].startswith(said)


@pytest.mark.slow
def test_a_stored_result_meets_a_tolerance_or_not(session, tmp_path):
    stored = tmp_path / "result.json"
    stored.write_text(
        run("calibrate", "robot.csv", "camera.csv", *NOISE, "--json", "--tolerance", "1m", cwd=session).stdout
    )
    assert run("report", stored).stdout == uq.Calibration.from_json(stored).summary()
    assert "Uncertainty budget" in run("report", stored, "-v").stdout
    for tolerance, status, word in (("5mm", 0, "PASS"), ("0.001mm", 5, "FAIL")):
        done = run("report", stored, "--tolerance", tolerance)
        assert done.returncode == status and done.stdout.splitlines()[2].startswith(f"{word}: ")
    for wrong in (("--tolerance", "5"), ("--tolerance", "mm"), ("--at", "1m"), ("--tolerance", "1deg", "--at", "1m")):
        done = run("report", stored, *wrong)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr


@pytest.mark.slow
def test_the_demo_writes_its_report_and_ends_with_the_truth(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(uq.Calibration, "report", lambda self, path, **_: asked.append(path))
    done = run("demo", cwd=tmp_path)
    lines = done.stdout.splitlines()
    assert (done.returncode, done.stderr, [str(path) for path in asked]) == (0, "", ["demo_report.html"])
    assert len(lines) <= 26 and "Wrote demo_report.html." in lines
    assert re.fullmatch(r"Truth: X is off by 0\.\d+ mm and 0\.\d+ deg, inside its 95 % ellipsoid\.", lines[-1])
    run("demo", "--report", "mine.html", cwd=tmp_path)
    run("demo", "-q", cwd=tmp_path)
    run("demo", "--json", cwd=tmp_path)
    assert [str(path) for path in asked[1:]] == ["mine.html"]


# -------------------------------------------------------------------------------------------- colours, progress


@pytest.mark.slow
def test_colours_on_a_terminal_only(session):
    swapped = ("calibrate", "camera.csv", "robot.csv")
    status, seen = run_on_terminal(*swapped, cwd=session)
    assert status in (0, 3) and f"{YELLOW}caution\x1b[0m  " in seen and BOLD in seen
    assert run_as_on_terminal(*swapped, cwd=session) == (status, seen.replace("\r\n", "\n"))
    assert f"{RED}uq-handeye: error: " in run_as_on_terminal("calibrate", "nothing.csv", "robot.csv", cwd=session)[1]
    for environment in ({"NO_COLOR": "1"}, {"TERM": "dumb"}, {"NO_COLOR": "1", "FORCE_COLOR": "1"}):
        assert "\x1b" not in run_as_on_terminal(*swapped, cwd=session, **environment)[1]
    assert "\x1b" not in run_as_on_terminal(*swapped, "--no-color", cwd=session)[1]
    piped = run_process(*swapped, cwd=session)
    assert "caution" in piped.stdout and piped.stderr == "" and "\x1b" not in piped.stdout
    forced = run_process(*swapped, "--json", cwd=session, FORCE_COLOR="1")
    assert f"{YELLOW}uq-handeye: warning: " in forced.stderr
    assert "\x1b" not in forced.stdout and json.loads(forced.stdout)


@pytest.mark.slow
def test_colours_of_help():
    assert "\x1b[" in run_on_terminal("calibrate", "--help")[1]
    assert "\x1b[" not in run_as_on_terminal("calibrate", "--help", NO_COLOR="1")[1]
    assert "\x1b[" not in run_as_on_terminal("calibrate", "--help", "--no-color")[1]
    assert "\x1b[" not in run_process("calibrate", "--help", GITHUB_ACTIONS="true").stdout
    assert "\x1b[" in run_process("--help", FORCE_COLOR="1").stdout


@pytest.mark.slow
def test_progress_on_a_terminal_only(session):
    command = ("validate", "robot.csv", "camera.csv", *NOISE, "--method", "4dpa", "--workers", 1, "--trials", 3_000)
    status, seen = run_on_terminal(*command, cwd=session)
    assert status == 0 and "trials" in seen and "/3,000 trials" in seen
    for environment, more in (({"TERM": "dumb"}, ()), ({}, ("-q",))):
        assert "/3,000 trials" not in run_as_on_terminal(*command, *more, cwd=session, **environment)[1]
    piped = run_process(*command, cwd=session, FORCE_COLOR="1")
    assert piped.stderr == "" and "/3,000 trials" not in piped.stdout


@pytest.mark.slow
def test_a_report_that_is_being_written_says_so_on_a_terminal(session, tmp_path):
    report = ("--report", tmp_path / "r.html", "--no-compare")
    status, seen = run_as_on_terminal("calibrate", "robot.csv", "camera.csv", *NOISE, *report, cwd=session)
    assert status == 0 and "writing " in seen and "gripper_T_camera from robot.csv" in seen


@pytest.mark.slow
def test_ctrl_c_before_the_first_trial(session):
    # what a shell starts in the background ignores SIGINT, and so would all that it starts
    program = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program += "; from uq_handeye.__main__ import main; main()"
    command = [sys.executable, "-c", program, "validate", "robot.csv", "camera.csv", *NOISE, "--trials", "100000000"]
    process = subprocess.Popen(
        [*command, "-v"], cwd=session, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        while "calibrating" not in (line := process.stderr.readline()):
            assert line, "it ended before it was interrupted"
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=30)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 130
    assert err.splitlines()[-1] == "uq-handeye: interrupted" and "Traceback" not in err


def test_the_same_warning_is_given_once(capsys):
    with messages("uq-handeye", no_color=True):
        for _ in range(2):
            warnings.warn("Something looks wrong.", InputWarning, stacklevel=1)
    assert capsys.readouterr().err.count("Something looks wrong.") == 1


def test_a_warning_that_the_result_shows_is_not_given_beside_it(capsys, tmp_path):
    log = tmp_path / "log"
    with messages("uq-handeye", no_color=True):
        Messages(log_file=log).apply()
        with withheld() as shown:
            for text in ("Shown.", "Not shown.", "Not shown."):
                warnings.warn(text, InputWarning, stacklevel=1)
            shown.append("Shown.")
        with pytest.raises(ZeroDivisionError), withheld():
            _warn_and_fail()
    assert capsys.readouterr().err == "uq-handeye: warning: Not shown.\nuq-handeye: warning: The reason.\n"
    assert [line.split("WARNING ")[1] for line in log.read_text().splitlines() if "WARNING" in line] == [
        "Shown.",
        "Not shown.",
        "The reason.",
    ]


def _warn_and_fail():
    warnings.warn("The reason.", InputWarning, stacklevel=1)
    raise ZeroDivisionError


def test_text_is_wrapped_to_the_terminal_or_to_80_columns(monkeypatch, capsys):
    for given, width in (("100", 100), ("300", 118), ("10", 40), ("wide", 80), (None, 80)):
        monkeypatch.delenv("COLUMNS", raising=False)
        if given is not None:
            monkeypatch.setenv("COLUMNS", given)
        assert terminal_width() == width, given


def test_roles_are_styled_only_where_there_are_colours(monkeypatch, capsys):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    assert styled("ok", "ok") == "ok"
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert styled("ok", "ok") == "\x1b[32mok\x1b[0m" and styled("X", "answer") == "\x1b[1mX\x1b[0m"
    assert styled("ok", "heading") == "ok"
    with messages("uq-handeye", no_color=True):
        assert styled("ok", "ok") == "ok"


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments", [["calibrate", "robot.csv", "camera.csv", *NOISE], ["export", "r.json", "x.urdf"]]
)
def test_a_closed_standard_output_is_one_line_and_status_2(session, arguments):
    result = run("calibrate", "robot.csv", "camera.csv", *NOISE, "--json", cwd=session).stdout
    (session / "r.json").write_text(result)
    program = f"import os, sys; os.close(1); sys.stdout = None; from uq_handeye.cli.app import main; main({arguments})"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=session, stderr=subprocess.PIPE, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "the standard output is closed" in done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="file names are text here")
def test_file_names_that_are_no_utf_8(session):
    name = os.fsdecode(b"bad\xff.csv")
    (session / name).write_bytes((session / "robot.csv").read_bytes())
    done = run("calibrate", name, "camera.csv", *NOISE, "--json", "--log-file", "odd.log", cwd=session)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["provenance"]["command"].startswith("uq-handeye calibrate 'bad\\udcff.csv'")
    assert "bad\\udcff.csv" in (session / "odd.log").read_text()


@pytest.fixture
def keyboard():
    """Ctrl-C as in a program of its own; a run that was interrupted ignores it from then on."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_that_a_library_turns_into_an_error_of_its_own(session, monkeypatch, keyboard):
    def calibrate(*_, **__):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ValueError("a library's") from None

    monkeypatch.setattr("uq_handeye.calibration.calibrate.calibrate", calibrate)
    hook = sys.unraisablehook
    done = run("calibrate", "robot.csv", "camera.csv", cwd=session)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "uq-handeye: interrupted\n")
    assert sys.unraisablehook is hook


def test_ctrl_c_within_a_finaliser_is_not_lost(session, monkeypatch, keyboard):
    class Fragile:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    waited = []

    def calibrate(*_, **__):
        one = Fragile()
        del one
        while len(waited) < 500:  # where Ctrl-C arrives once more
            waited.append(time.sleep(0.01))

    monkeypatch.setattr("uq_handeye.calibration.calibrate.calibrate", calibrate)
    done = run("calibrate", "robot.csv", "camera.csv", cwd=session)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "uq-handeye: interrupted\n")
    assert len(waited) < 500
