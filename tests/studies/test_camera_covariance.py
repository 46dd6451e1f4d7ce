"""The simulated cameras are what they say, and the findings say the opposite where the table does."""

import numpy as np
import pytest
from fixtures.study_tables import quick_tables
from support import mean_interval

from studies.camera_covariance import PIXEL, ROBOT, SIZE, error, findings, poses_of, recorded
from uq_handeye.core.geometry.se3 import inverse

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_without_noise_everything_fits(setup):
    corners, robot, X = recorded(np.random.default_rng(3), setup=setup, pixel=1e-9, robot=None)
    poses = poses_of(corners, robot, setup=setup)
    G = poses.robot if setup == "eye-in-hand" else inverse(poses.robot)
    W = G @ X @ poses.camera
    np.testing.assert_allclose(W, np.broadcast_to(W[0], W.shape), atol=1e-7)
    assert np.abs(error(X, X)).max() == 0


def test_noise_of_corners_and_robot():
    exact, robot, _ = recorded(np.random.default_rng(3), pixel=0.0, robot=None)
    noisy, _, _ = recorded(np.random.default_rng(3), pixel=PIXEL, robot=None)
    assert exact.m == noisy.m  # none is so near the rim here
    deviation = np.std(noisy.pixels - exact.pixels)
    assert deviation == pytest.approx(PIXEL, rel=5 / np.sqrt(4 * exact.m))
    assert exact.pixels.min() >= 0 and (exact.pixels.max(axis=0) <= np.array(SIZE)).all()
    _, moved, _ = recorded(np.random.default_rng(3), pixel=0.0, robot=ROBOT)
    shift = moved[:, :3, 3] - robot[:, :3, 3]
    assert 0.5 < np.sqrt(np.mean(shift**2)) / 2e-5 < 1.5


@pytest.mark.statistical
def test_the_joint_covariance_is_consistent_and_that_of_each_pose_by_itself_is_not():
    rows = quick_tables("camera_covariance")["sets"]
    low, high = mean_interval(len(rows))
    assert len(rows) == 60 and low < rows.joint_d2.mean() < high
    assert rows.independent_d2.mean() > max(high, 20)


def test_the_verdict_follows_the_table():
    rows = quick_tables("camera_covariance")["sets"].copy()
    text = findings({"sets": rows})
    assert "same covariance without correlations between poses, the covariance of X is too small" in text
    assert "joint covariance of the camera poses, the covariance of X is consistent" in text
    rows["joint_d2"], rows["independent_d2"] = 60.0, 0.1
    text = findings({"sets": rows})
    assert "joint covariance of the camera poses, the covariance of X is too small" in text
    assert "without correlations between poses, the covariance of X is too large" in text
