"""Consistency of the standard deviation of the offset and of the covariance of X that includes it, on simulated
streams with known truth.
"""

import numpy as np
import pytest
from fixtures.streams import motion, pose_noise, streams
from scipy import stats
from support import CONFIDENCE, SEED, difference, is_consistent, mean_interval, moved, nees

import uq_handeye as uq
from uq_handeye.fit.graph.gauss_helmert import efficient, offset_sensitivity

pytestmark = pytest.mark.statistical

SETS, DURATION = 200, 4.0
FEWER = 30


@pytest.fixture(scope="module")
def sets():
    """Return z of the offset, xi of X and covariances of SETS short recordings with fast rotations, where the
    offset matters.
    """
    rng = np.random.default_rng(SEED)
    z, xi, known, whole = [], [], [], []
    for k in range(SETS):
        setup = ("eye-in-hand", "eye-to-hand")[k % 2]
        offset = rng.uniform(-0.3, 0.3)
        pose = motion(rng, DURATION, knot=2.0, drift=1.5)
        X, _, robot, camera = streams(rng, pose, offset, DURATION, setup=setup)
        sync = uq.synchronise(robot, camera, setup=setup, noise=pose_noise())
        fit = efficient(sync.poses, sync.noise)
        move = sync.offset_std * offset_sensitivity(fit, sync.poses.timing)[:6]
        z.append((sync.offset - offset) / sync.offset_std)
        xi.append(difference(fit.X, X))
        known.append(fit.covariance_X)
        whole.append(fit.covariance_X + np.outer(move, move))
    return tuple(np.array(part) for part in (z, xi, known, whole))


def test_the_deviation_of_the_offset_is_true(sets):
    z = sets[0]
    low, high = mean_interval(SETS, 1)
    assert low < np.mean(z**2) < high
    assert abs(z.mean()) < stats.norm.ppf(0.5 + CONFIDENCE / 2) / np.sqrt(SETS)
    for wrong in (0.7, 1.4):  # the test can tell
        assert not low < np.mean((z / wrong) ** 2) < high


def test_the_covariance_of_X_is_marginal_over_the_offset(sets):
    _, xi, known, whole = sets
    assert is_consistent(xi, whole), nees(xi, whole).mean()
    assert not is_consistent(xi, known)  # as if the offset were known
    assert nees(xi, known).mean() > nees(xi, whole).mean() + 2


def test_errors_that_last_make_the_deviation_larger():
    """Detections whose error is correlated from frame to frame: the model alone would claim half the deviation."""
    rng = np.random.default_rng(SEED)
    honest, model = [], []
    for _ in range(FEWER):
        _, _, robot, camera = streams(rng, motion(rng, 8.0), 0.1, 8.0, noise=((1e-5, 1e-5), (1e-5, 1e-5)))
        errors = np.zeros((len(camera), 6))
        fresh = rng.normal(size=errors.shape) * np.repeat([1e-3, 5e-4], 3)
        for k in range(len(errors)):
            errors[k] = 0.9 * errors[k - 1] + np.sqrt(1 - 0.9**2) * fresh[k] if k else fresh[k]
        sync = uq.synchronise(robot, uq.Stream(camera.timestamps, moved(camera.poses, errors)))
        honest.append((sync.offset - 0.1) / sync.offset_std)
        model.append((sync.offset - 0.1) / sync.model_std)
    low, high = mean_interval(FEWER, 1)
    assert low < np.mean(np.square(honest)) < high
    assert np.mean(np.square(model)) > high


def test_jitter_of_the_timestamps_is_in_the_deviation():
    """Times that are wrong by 0.5 ms, each by itself: an error of about the size of the noise, along the path."""
    rng = np.random.default_rng(SEED)
    z = []
    for _ in range(FEWER):
        _, _, robot, camera = streams(rng, motion(rng, 6.0), 0.1, 6.0)
        jittered = uq.Stream(camera.timestamps + 5e-4 * rng.normal(size=len(camera)), camera.poses)
        sync = uq.synchronise(robot, jittered)
        z.append((sync.offset - 0.1) / sync.offset_std)
    low, high = mean_interval(FEWER, 1)
    assert low < np.mean(np.square(z)) < high
