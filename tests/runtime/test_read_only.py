"""No array of a result can be written to, however deep it lies."""

import numpy as np
import pytest
from fixtures.commands import MODEL
from fixtures.pictures import simulated_rig
from support import writable

import uq_handeye as uq
from uq_handeye.core.read_only import read_only
from uq_handeye.fit.diagnostics.shifted_rows import find_shift
from uq_handeye.fit.diagnostics.split_half import split_fit
from uq_handeye.fit.graph.robust import robust_fit


@pytest.fixture(scope="module")
def poses():
    return uq.simulate(15, noise=MODEL, seed=3)


def test_what_is_made_read_only():
    array = np.zeros(3)
    frozen = read_only((array, {"a": array}, [array], None, 1.5))
    assert writable(frozen) == ["[2][0]"] and array.flags.writeable
    array[0] = 1  # no copy
    assert frozen[0][0] == frozen[1]["a"][0] == 1


@pytest.mark.filterwarnings("ignore")
def test_a_calibration(poses, tmp_path):
    for result in (
        uq.calibrate(poses, noise=MODEL),
        uq.calibrate(poses),
        uq.calibrate(poses, noise=MODEL, method="park"),
    ):
        assert writable(result) == []
        with pytest.raises(ValueError, match="read-only"):
            result.X[0, 3] = 0.0
        with pytest.raises(ValueError, match="read-only"):
            result.covariance *= 4.0
    for part in (result := uq.calibrate(poses, noise=MODEL)).diagnostics, result.covariances, result.budget:
        assert writable(part) == []
    assert writable(result.split_half) == writable(result.uncertainty_at([0, 0, 0.5])) == []
    result.to_json(tmp_path / "result.json")
    stored = uq.Calibration.from_json(tmp_path / "result.json")
    assert writable(stored) == [] and writable(stored.diagnostics) == writable(stored.covariances) == []


def test_other_results(poses):
    few = {"trials": 100, "seed": 1}
    results = {
        "monte_carlo": uq.monte_carlo(poses, noise=MODEL, method="4dpa", workers=1, **few),
        "plan": uq.plan(poses, noise=MODEL, k=2, sample=20),
        "compare": uq.compare(poses, noise=MODEL, methods=["park", "4dpa"]),
        "efficient": uq.efficient(poses, MODEL),
        "robust": robust_fit(poses, MODEL),
        "split": split_fit(uq.efficient(poses, MODEL), poses, "interleaved"),
        "estimate": uq.estimate_noise(poses),
        "motions": uq.relative_motions(poses),
        "poses": poses,
    }
    assert {name for name, result in results.items() if writable(result)} == set()


@pytest.mark.filterwarnings("ignore")
def test_a_camera(rng):
    board = uq.Board(5, 4, 0.04)
    assert writable(uq.calibrate_camera(simulated_rig(board, rng, n=6)[1], model="pinhole")) == []


def test_a_shift(poses):
    many = uq.simulate(40, noise=MODEL, seed=3)
    shift = find_shift(uq.PosePairs(many.robot[:-1], many.camera[1:]))
    assert shift is not None and writable(shift) == []
