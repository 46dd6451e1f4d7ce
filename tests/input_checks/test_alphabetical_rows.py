"""Rows in the alphabetical order of their names: named with the file, and nothing else is blamed."""

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.calibration.report.answer import next_step
from uq_handeye.fit.diagnostics.alphabetical_rows import alphabetical_rows

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def by_name(n, first):
    """The rows in the order of the names ``first``, ``first + 1``, ... as text."""
    return np.array(sorted(range(first, first + n), key=str)) - first


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("file", ["robot", "camera"])
def test_the_file_is_named(file, first, setup):
    poses = uq.simulate(23, noise=NOISE, setup=setup, seed=4)
    rows = {"robot": np.arange(23), "camera": np.arange(23)} | {file: by_name(23, first)}
    found = alphabetical_rows(poses.rows(rows["robot"], rows["camera"]))
    assert found is not None and found.values == {"file": file, "order": (by_name(23, first) + first)[:4].tolist()}


@pytest.mark.parametrize("seed", range(3))
def test_other_orders_are_not(seed):
    poses = uq.simulate(23, noise=NOISE, seed=seed)
    shuffled = np.random.default_rng(seed).permutation(23)
    assert alphabetical_rows(poses) is None and alphabetical_rows(poses.rows(np.arange(23), shuffled)) is None
    assert alphabetical_rows(poses.rows(np.arange(9))) is None  # the same order


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_it_heads_the_result():
    poses = uq.simulate(25, noise=NOISE, seed=4)
    wrong = poses.rows(np.arange(25), by_name(25, 1))
    reason = "the camera rows are in alphabetical order (1, 10, 11, ...)"
    step = "sort the rows of the camera file by number"
    for noise in (None, NOISE):
        result = uq.calibrate(wrong, noise=noise)
        assert result.reasons[0] == reason and next_step(result) == step
    assert not any("belong together" in text for text in result.reasons)
    assert "write the numbers with leading zeros" in " ".join(result.warnings)
