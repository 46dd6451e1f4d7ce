"""Frames, topics and joints that no robot has: escaped, bounded, and never a loop that does not end."""

import json
import time

import numpy as np
import pytest
from fixtures.bags import KINDS, START, Writer
from fixtures.commands import run

import uq_handeye as uq

pytestmark = pytest.mark.slow

POSES = uq.simulate(12, seed=1)
F = ("--robot", "base:tool0", "--camera", "camera:tag0")


def bag_of(folder, kind, fill):
    with Writer(folder, kind) as bag:
        fill(bag)
    return bag.path


def cell(bag, tool="tool0"):
    for k in range(12):
        bag.tf(START + k, ("base", tool, POSES.robot[k]), ("camera", "tag0", POSES.camera[k]))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["to\x1b[31mol\n0", "\u202etool0", "t" * 5000])
def test_names_are_escaped_and_cut(tmp_path, name):
    path = bag_of(tmp_path, "mcap", lambda bag: cell(bag, name))
    for done in (run("bag", path), run("calibrate", "--bag", path, *F)):
        assert not set("\x1b\u202e") & set(done.stdout + done.stderr)
        assert all(len(line) < 400 for line in (done.stdout + done.stderr).splitlines())
    shown = next(one["child"] for one in json.loads(run("bag", path, "--json").stdout)["transforms"])
    done = run("calibrate", "--bag", path, "--robot", f"base:{shown}", "--camera", "camera:tag0", "--json")
    assert done.returncode in (0, 5, 6) and json.loads(done.stdout)["n_poses"] == 12  # as listed, so it is given


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_frame_in_itself_and_a_joint_twice(tmp_path, kind):
    def fill(bag):
        cell(bag)
        bag.tf(START, ("base", "base", np.eye(4)))
        bag.joints("/joints", START, ["a", "a"], [0.1, 0.2])

    done = run("bag", bag_of(tmp_path, kind, fill))
    assert done.returncode == 0
    assert "expected transforms between two frames" in done.stdout and "expected each joint once" in done.stdout


@pytest.mark.slow
def test_long_chains_and_many_frames(tmp_path):
    """A chain of 3,000 frames took a minute."""
    T = POSES.robot

    def chain(bag):
        for k in range(3):
            bag.tf(START + k, *[(f"f{i}", f"f{i + 1}", T[k]) for i in range(3000)])

    path = bag_of(tmp_path, "ros1", chain)
    start = time.process_time()
    assert "Next:" in run("bag", path).stdout
    assert time.process_time() - start < 10
    (tmp_path / "many").mkdir()
    path = bag_of(tmp_path / "many", "ros1", lambda bag: bag.tf(START, *[("base", f"f{i}", T[0]) for i in range(6000)]))
    done = run("bag", path)
    assert done.returncode == 2 and "at most 5000 pairs of frames" in done.stderr
