"""Files that are read and written back lose nothing of another process."""

import os
import subprocess
import sys

import numpy as np
import pytest
from fixtures.commands import MODEL, run, write_session

import uq_handeye as uq
from uq_handeye.core.files.locks import held, locked
from uq_handeye.errors import InputError
from uq_handeye.read import write_pose_file
from uq_handeye.use.maintenance.log import read_checks

ADDS = """
import pathlib, sys
from uq_handeye.core.files.locks import held

file = pathlib.Path(sys.argv[1])
for _ in range(50):
    with held(file):
        file.write_text(str(int(file.read_text()) + 1))
"""
SILENT = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
HOLDS = """
import sys, time
from uq_handeye.core.files.locks import held

with held(sys.argv[1]):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.mark.slow
def test_no_change_is_lost(tmp_path):
    file = tmp_path / "number"
    file.write_text("0")
    processes = [subprocess.Popen([sys.executable, "-c", ADDS, file]) for _ in range(4)]
    assert [process.wait(60) for process in processes] == [0] * 4
    assert file.read_text() == "200" and os.listdir(tmp_path) == ["number"]


def test_the_lock_of_a_killed_process_is_in_nobodys_way(tmp_path):
    file = tmp_path / "a.csv"
    with subprocess.Popen([sys.executable, "-c", HOLDS, file], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"held\n"
        with pytest.raises(InputError, match=r"a\.csv is in use by another run: wait for its end\.$"), held(file, 0.1):
            pass
        process.kill()
    assert os.listdir(tmp_path) == [".uq-handeye-a.csv.lock"]
    with held(file, 0.0):
        assert os.listdir(tmp_path) == [".uq-handeye-a.csv.lock"]
    assert os.listdir(tmp_path) == []


def test_links_have_the_lock_of_their_file_and_pipes_none(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there" / "a.csv")
    with held(tmp_path / "link"), pytest.raises(InputError, match="in use"), locked(tmp_path / "there" / "a.csv"):
        pass
    with held("/dev/null"):
        assert not os.path.lexists("/dev/.uq-handeye-null.lock")
    with pytest.raises(InputError, match="no folder"), held(tmp_path / "missing" / "a.csv"):
        pass


PLAIN = """
import sys
import uq_handeye.report.figures
from uq_handeye.cli.app import main

uq_handeye.report.figures.figures = lambda *_: {}  # they take long
main(sys.argv[1:])
"""


def at_once(commands):
    """Run commands of the program at once; return their exit statuses."""
    running = [subprocess.Popen([sys.executable, "-c", PLAIN, *map(str, c)], **SILENT) for c in commands]
    return [process.wait(120) for process in running]


@pytest.mark.slow
def test_checks_and_updates_at_once(tmp_path):
    truth = write_session(tmp_path, 20)
    for name, rows in (("old", np.arange(14)), *((f"new{k}", np.array([14 + 2 * k, 15 + 2 * k])) for k in range(3))):
        for side in ("robot", "camera"):
            write_pose_file(tmp_path / f"{side}_{name}.csv", getattr(truth, side)[rows])
    result = tmp_path / "result.json"
    uq.calibrate(truth.rows(np.arange(14)), noise=MODEL, shared=[]).to_json(result)
    news = [(tmp_path / f"robot_new{k}.csv", tmp_path / f"camera_new{k}.csv") for k in range(3)]
    log = tmp_path / "log.csv"
    assert set(at_once([("check", result, *new, "--log", log) for new in news])) <= {0, 3}
    assert len(read_checks(log)) == 3
    assert at_once([("update", result, *new, "-o", tmp_path) for new in news[:2]]) == [0, 0]
    assert uq.Calibration.from_json(result).n_poses == 18
    with held(result):
        assert run("update", result, *news[2], "-q").returncode == 0  # which replaces nothing
    assert not list(tmp_path.glob(".uq-handeye-*"))
