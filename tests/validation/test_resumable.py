"""Runs of several methods: killed at any moment by kill -9 and resumed to the same bits."""

import os
import random
import signal
import time

import pytest
from fixtures.trials import NOISE, poses_of_program, start
from support import SEED

import uq_handeye as uq
from uq_handeye import InputError

OTHER = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.6mm"))
OPTIONS = {"trials": 3000, "seed": SEED}
PROGRAM = """
import sys
import uq_handeye as uq

noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
poses = uq.simulate(12, noise=noise, seed=7)
print("ready", flush=True)
uq.cross_check(poses, noise=noise, directory=sys.argv[1], resume=True, **{options!r})
print("ended", flush=True)
"""


def run(**kept):
    return uq.cross_check(poses_of_program(), noise=NOISE, **OPTIONS, **kept)


def numbers(result):
    """Everything but the time taken."""
    rows = [row.to_dict() | {"seconds": 0} for row in result.rows]
    chain = None if result.posterior is None else result.posterior.chain.tobytes()
    return rows, [run.errors.tobytes() for run in result.runs.values()], chain


def kept(folder):
    return [path for path in folder.rglob("*") if path.suffix in (".npz", ".h5")]


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no kill -9")
def test_killed_at_any_moment_and_resumed(tmp_path):
    reference = run()
    program, folder, clock = tmp_path / "program.py", tmp_path / "run", random.Random(SEED)
    program.write_text(PROGRAM.format(options=OPTIONS))
    for _ in range(2):
        before = len(kept(folder))
        process = start(program, folder)
        try:
            assert process.stdout.readline() == "ready\n"
            while len(kept(folder)) < before + 2 and process.poll() is None:
                time.sleep(0.005)
            time.sleep(clock.uniform(0, 0.1))
            os.killpg(process.pid, signal.SIGKILL)
            assert process.communicate(timeout=60)[0] == "", "it ended before it was killed"
        finally:
            process.kill()
    assert len(kept(folder)) >= 4
    assert numbers(run(directory=folder, resume=True)) == numbers(reference)
    assert not list(folder.rglob(".uq-handeye-*"))


@pytest.mark.slow
def test_another_cross_check_is_refused(tmp_path):
    options = {"noise": NOISE, "posterior": False, "directory": tmp_path / "run"}
    uq.cross_check(poses_of_program(), trials=200, **options)
    more = uq.cross_check(poses_of_program(), trials=300, resume=True, **options)
    assert [run.resumed for run in more.runs.values()] == [0] * 4  # the only chunk was cut short
    with pytest.raises(InputError, match=r"asked for 300 trials: resume it with as many or more, got 200"):
        uq.cross_check(poses_of_program(), trials=200, resume=True, **options)
    with pytest.raises(InputError, match=r"differs in noise sha256"):
        uq.cross_check(poses_of_program(), resume=True, **options | {"noise": OTHER})
    with pytest.raises(InputError, match="a `directory` with resume=True, that of the cross-check"):
        uq.cross_check(poses_of_program(), noise=NOISE, resume=True)


@pytest.mark.slow
def test_a_disk_that_is_full_is_no_row(tmp_path, monkeypatch):
    written = iter(range(100))

    def full(*_):
        if next(written) > 3:  # after two manifests, the result of the first method, and the manifest of the second
            raise OSError(28, "No space left on device")

    options = {"noise": NOISE, "trials": 200, "posterior": False, "directory": tmp_path / "run"}
    uq.cross_check(poses_of_program(), **options)
    for path in kept(tmp_path / "run" / "nguyen"):
        path.unlink()
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"no space left on device\.$"):
        uq.cross_check(poses_of_program(), resume=True, **options)
