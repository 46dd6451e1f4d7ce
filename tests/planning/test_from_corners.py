"""The next poses are seen by the camera that was calibrated from the poses so far: they share its errors."""

from dataclasses import replace

import numpy as np
import pytest
from support import assert_same_covariance

import uq_handeye as uq
from studies.camera_covariance import ROBOT, poses_of, recorded
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.model.errors.models import marginals
from uq_handeye.use.planning.plan import plan

pytestmark = pytest.mark.filterwarnings("ignore:The target would sit")


@pytest.fixture(scope="module", params=["eye-in-hand", "eye-to-hand"])
def poses(request):
    corners, robot, _ = recorded(np.random.default_rng(7), setup=request.param)
    return poses_of(corners, robot, setup=request.param)


def test_errors_ahead_are_those_of_the_calibration(poses):
    """The errors at the poses so far, where all corners count, are those of the bundle."""
    seen = poses.camera_calibration
    shared = seen.covariance.shared
    full = np.bincount(seen.corners.picture) == 54
    ahead = seen.shared_ahead(seen.poses, shared)
    np.testing.assert_allclose(ahead[full], shared[full], atol=1e-6 * np.abs(shared).max())
    with pytest.raises(uq.InputError, match="those of the camera's calibration"):
        seen.shared_ahead(seen.poses, np.random.default_rng(1).normal(size=shared.shape))


def test_what_is_known_before_is_what_efficient_says(poses):
    noise = uq.PoseNoise(ROBOT, poses.camera_calibration.covariance)
    found = plan(poses, k=1, noise=noise, sample=20, shared=[])
    at = efficient(poses, noise)
    np.testing.assert_allclose(np.diag(found.covariance_before), np.diag(at.covariance_X), rtol=0.05)
    same = plan(poses, k=1, noise=uq.PoseNoise(ROBOT), sample=20, shared=[])  # of the corners as well
    assert_same_covariance(same.covariances[0], found.covariances[0], 0.05)  # the corners linearised again


@pytest.mark.slow
def test_the_error_of_the_intrinsics_does_not_average_out(poses):
    """Poses taken again and again: of independent errors the variance falls as 1 / n, of the intrinsics' it stays."""
    S = poses.camera_calibration.covariance
    joint = uq.PoseNoise(ROBOT, S)
    found = plan(poses, poses.robot, k=60, noise=joint, repeat=True, shared=[])
    alone = uq.PosePairs(poses.robot, poses.camera, poses.setup)
    independent = plan(alone, poses.robot, k=60, noise=uq.PoseNoise(ROBOT, marginals(S)), repeat=True)
    left = np.trace(found.covariances[-1][3:, 3:]) / np.trace(found.covariance_before[3:, 3:])
    fallen = np.trace(independent.covariances[-1][3:, 3:]) / np.trace(independent.covariance_before[3:, 3:])
    assert fallen < 0.4 and left > 1.1 * fallen
    estimated = plan(poses, k=2, sample=20)
    assert estimated.noise_estimated and np.linalg.eigvalsh(estimated.covariances).min() > 0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*outlier")
def test_a_pose_that_does_not_belong_is_left_out_of_noise_and_poses(poses):
    robot = poses.robot.copy()
    robot[3, :3, 3] += 0.05
    found = plan(replace(poses, robot=robot), k=1, sample=20)
    assert found.n_poses == poses.n - 1
    without = plan(poses.rows(np.arange(poses.n) != 3), k=1, sample=20)
    np.testing.assert_allclose(np.diag(found.covariance_before), np.diag(without.covariance_before), rtol=0.2)
