"""Residuals of a comparison leave out the errors that the calibration estimates, whoever is compared."""

import numpy as np
import pytest
from fixtures.rigs import NOISE, quietly

import uq_handeye as uq
from uq_handeye.report.comparison.compare import compare_result


@pytest.fixture(scope="module")
def scaled():
    """Poses of a target 2 % larger than given."""
    poses = uq.simulate(25, noise=NOISE, seed=3)
    camera = poses.camera.copy()
    camera[:, :3, 3] *= 1.02
    return uq.PosePairs(poses.robot, camera)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_the_best_fit_looks_best(scaled, tmp_path):
    """The X of methods that take up the wrong size fits the measured translations better, and is worse."""
    result = quietly(scaled)
    found = uq.compare(scaled, methods=["park", "shah"], timed=False)
    own, *others = (row.residuals.translation_rms for row in found.rows)
    assert own == pytest.approx(result.residuals.translation_rms, rel=1e-9) and min(others) > 1.2 * own
    result.save(tmp_path / "result.json")
    stored = compare_result(uq.load(tmp_path / "result.json")).comparison
    again = [next(row for row in stored.rows if row.method == name) for name in ("efficient (this result)", "park")]
    expected = own, others[0]
    np.testing.assert_allclose([row.residuals.translation_rms for row in again], expected, rtol=0.02)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_one_number_of_poses_that_are_right_and_scaled(scaled):
    poses = uq.simulate(25, noise=NOISE, seed=3)
    right, wrong = quietly(uq.PosePairs(poses.robot, poses.camera)), quietly(scaled)
    assert wrong.residuals.translation_rms == pytest.approx(right.residuals.translation_rms, rel=0.15)
