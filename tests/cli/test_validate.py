"""``uq-handeye validate`` as a user meets it: exit status, stdout, stderr, and what is left in the folder."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest
from fixtures.trials import NOISE

from uq_handeye import read_poses, simulate
from uq_handeye.cli import app as cli
from uq_handeye.cli.commands import validate as cli_validate
from uq_handeye.read import write_pose_file
from uq_handeye.trials.validation.monte_carlo.chunks import Work
from uq_handeye.trials.validation.monte_carlo.crew import WorkersLostError
from uq_handeye.trials.validation.monte_carlo.run import monte_carlo

OPTIONS = ("--robot-noise", "0.02deg,0.05mm", "--camera-noise", "0.1deg,0.5mm")
PROGRAM = "from uq_handeye.cli.app import main; main()"


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    poses = simulate(10, noise=NOISE, seed=3)
    write_pose_file(folder / "robot.csv", poses.robot)
    write_pose_file(folder / "camera.csv", poses.camera)
    return folder


@pytest.fixture
def run(session, capsys, monkeypatch):
    """``run("...")`` gives exit status, stdout and stderr of validate on the files of the session."""
    monkeypatch.chdir(session)

    def call(*arguments, files=("robot.csv", "camera.csv")):
        with warnings.catch_warnings(), pytest.raises(SystemExit) as end:
            cli.main(["validate", *files, *map(str, arguments)])
        return end.value.code, *capsys.readouterr()

    return call


def expected(session, **options):
    return monte_carlo(read_poses(session / "robot.csv", session / "camera.csv"), noise=NOISE, **options)


@pytest.mark.slow
def test_text(run, session):
    status, out, err = run(*OPTIONS, "--trials", 1000, "--seed", 4)
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "The covariance of efficient is consistent with this noise, as far as 1,000"
    assert len(lines) <= 30 and max(map(len, lines)) <= 80
    words = " ".join(lines)
    assert "Monte Carlo of gripper_T_camera by efficient: 1,000 trials, seed 4." in words
    assert "It cannot" not in words and "Monte Carlo cannot tell whether the noise is right. On these data" in words
    summary = expected(session, method="efficient", trials=1000, seed=4).summary()
    tables = [text.partition("1 sigma")[2].partition("\n\n")[0] for text in (out, summary)]
    assert tables[0] == tables[1] and len(tables[0].splitlines()) == 7
    everything = run(*OPTIONS, "--trials", 1000, "--seed", 4, "-v")[1]
    assert "Likelihood ratio" in everything and "Likelihood ratio" not in out


@pytest.mark.slow
def test_json_figure_and_folder(run, session, tmp_path):
    arguments = (*OPTIONS, "--trials", 1500, "--method", "4dpa", "--json", "-o", tmp_path / "run")
    status, out, err = run(*arguments, "--figure", tmp_path / "figure.svg")
    assert (status, err) == (0, "")
    data = json.loads(out)
    assert json.loads((tmp_path / "run" / "result.json").read_text()) == data
    assert data["covariance"] == expected(session, trials=1500).covariance.tolist()
    assert "<svg" in (tmp_path / "figure.svg").read_text()
    status, out, err = run(*arguments)
    assert status == 2 and "is not empty" in err and "--resume" in err
    status, out, err = run(*arguments, "--resume")
    again = json.loads(out)
    assert (status, again["resumed"], again["covariance"]) == (0, 1500, data["covariance"])


@pytest.mark.slow
def test_several_methods(run, tmp_path):
    options = ("--trials", 300, "--method", "4dpa,park", "--method", "Efficient", "--workers", 1)
    status, out, err = run(*OPTIONS, *options, "-o", tmp_path / "run", "--figure", tmp_path / "f.png")
    assert (status, err) == (0, "")
    assert re.findall(r"Monte Carlo of gripper_T_camera by (\w+): 300 trials, seed 0", out) == [
        "4dpa",
        "park",
        "efficient",
    ]
    assert sorted(os.listdir(tmp_path / "run")) == ["4dpa", "efficient", "park"]
    assert sorted(os.listdir(tmp_path)) == ["f-4dpa.png", "f-efficient.png", "f-park.png", "run"]
    status, out, _ = run(*OPTIONS, *options, "--json")
    assert [part["method"] for part in json.loads(out)["methods"]] == ["4dpa", "park", "efficient"]


@pytest.mark.slow
def test_noise_from_the_data_and_covariance_of_each(run):
    status, out, _ = run("--trials", 500, "--covariance", "each", "--json")
    data = json.loads(out)
    assert (status, data["noise_estimated"], data["tested"], data["origin"]) == (0, True, "each", "fit to the data")


@pytest.mark.slow
def test_digits(run):
    status, out, err = run(*OPTIONS, "--digits", 1, "--trials", 10_000, "--method", "4dpa")
    assert (status, err) == (0, "")
    assert "NOT COMPLETE: all trials done, but not stable: 1 block of trials, 11 are needed." in " ".join(out.split())


@pytest.mark.slow
def test_all_cores_unless_told(run, monkeypatch):
    asked = []

    def instead(*args, workers, **kwargs):
        asked.append(workers)
        return monte_carlo(*args, **kwargs)

    monkeypatch.setattr("uq_handeye.trials.validation.monte_carlo.run.monte_carlo", instead)
    run(*OPTIONS, "--trials", 100)
    run(*OPTIONS, "--trials", 100, "--workers", 3)
    assert asked == [cli_validate.cores(), 3]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--method", "best"), "--method to name methods among efficient, ml, tsai"),
        (("--method", ","), "--method to name methods"),
        (("--covariance", "mine"), "--covariance to be model or each"),
        (("--trials", "1"), "`trials` to be an integer of at least 2"),
        (("--trials", "many"), "--trials"),
        (("--workers", "0"), "`workers`"),
        (("--resume",), "--resume needs the folder"),
        (("-o", "robot.csv"), "expected a folder, got a file"),
        (("--figure", "figure.txt"), ".png or .svg"),
        (("--figure", "nowhere/figure.png"), "there is no folder nowhere; make it first"),
    ],
    ids=str,
)
def test_bad_usage_is_one_line(run, arguments, words):
    status, out, err = run(*OPTIONS, "--trials", 100, *arguments)
    assert status == 2 and words in err and len(err.splitlines()) == 1 and "Traceback" not in err
    assert out == ""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of distributed
def test_a_scheduler_that_is_not_there(run, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("uq_handeye.core.executors.MAX_WAIT_S", 0.5)
    status, out, err = run(*OPTIONS, "--scheduler", "tcp://127.0.0.1:9")
    assert (status, out) == (2, "") and "Cannot reach the Dask scheduler" in err.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_ctrl_c_prints_what_is_done_and_can_be_resumed(session, tmp_path, workers):
    """SIGINT to the whole group, as a terminal sends it: no worker may complain."""
    # what a shell starts in the background ignores SIGINT, and so would all that it starts
    program = f"import signal; signal.signal(signal.SIGINT, signal.default_int_handler); {PROGRAM}"
    command = [sys.executable, "-c", program, "validate", "robot.csv", "camera.csv", *OPTIONS, "--method", "4dpa"]
    command += ["--seed", "5", "-o", str(tmp_path / "run"), "--workers", str(workers)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [*command, "--trials", "100000000"],
        cwd=session,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        end = time.monotonic() + 120
        while len(list(tmp_path.glob("run/chunks/*.npz"))) < 2 and time.monotonic() < end:
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert (process.returncode, err) == (130, "uq-handeye: interrupted\n")
    assert out.splitlines()[0].startswith("NOT COMPLETE: interrupted.")
    done = int(re.search(r": ([\d,]+) trials", out)[1].replace(",", ""))
    left = json.loads((tmp_path / "run" / "result.json").read_text())
    assert done >= 1000 and (left["trials"], left["complete"]) == (done, False)
    with np.load(tmp_path / "run" / "chunks" / "000000.npz") as file:
        np.testing.assert_array_equal(file["errors"], expected(session, trials=1000, seed=5).errors)


def test_ctrl_c_before_there_is_anything_to_print(run, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(signal, "signal", lambda *_: None)  # of this process
    for place in (
        "uq_handeye.cli.pose_files.PoseFiles.read",
        "uq_handeye.trials.validation.monte_carlo.run.experiment",
    ):
        with monkeypatch.context() as context:
            context.setattr(place, interrupted)
            assert run(*OPTIONS, "--trials", 100) == (130, "", "uq-handeye: interrupted\n")
    with monkeypatch.context() as context:  # and when the summary is made
        context.setattr("uq_handeye.trials.validation.monte_carlo.run.MonteCarlo.document", interrupted)
        assert run(*OPTIONS, "--trials", 100) == (130, "", "uq-handeye: interrupted\n")


@pytest.mark.slow
def test_workers_that_are_lost_are_exit_status_1(run, monkeypatch, tmp_path):
    def lost(self, index):
        if index == 2:
            raise WorkersLostError("6 worker processes were lost,\nthe last one by signal 9")
        return ordinary(self, index)

    ordinary = Work.compute
    monkeypatch.setattr(Work, "compute", lost)
    options = (*OPTIONS, "--trials", 3000, "--method", "4dpa,park", "--workers", 1)
    status, out, err = run(*options, "-o", tmp_path / "run")
    assert (
        status == 1 and "2,000 trials" in out and "NOT COMPLETE: 6 worker processes were lost" in " ".join(out.split())
    )
    assert err == (
        "uq-handeye: error: the run by 4dpa is not complete: 6 worker processes were lost, the last one by signal 9; "
        "--resume goes on.\n"
    )
    status, out, err = run(*options, "--json")
    assert status == 1 and json.loads(out)["methods"][0]["trials"] == 2000 and "-o DIR" in err
    monkeypatch.setattr(Work, "compute", ordinary)
    assert run(*options, "-o", tmp_path / "run", "--resume")[::2] == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("more", [(), ("--resume",)])
def test_several_methods_do_not_go_into_the_run_of_one(run, tmp_path, more):
    options = (*OPTIONS, "--trials", 100, "-o", tmp_path / "run")
    assert run(*options, "--method", "park")[0] == 0
    status, out, err = run(*options, "--method", "park,4dpa", *more)
    assert (status, out) == (2, "") and "holds the run of one method" in err
    written = ["chunks", "manifest.json", "result.json"] + [f"validation.{kind}" for kind in ("csv", "png", "svg")]
    assert sorted(os.listdir(tmp_path / "run")) == written
