"""The start of the time offset: correlation of angular speeds, in good and in bad conditions."""

import numpy as np
import pytest
from fixtures.streams import motion, some, streams
from support import SEED, random_transforms, rotations, transforms

from uq_handeye import InputError
from uq_handeye.read.synchronisation.correlation import best_correlation, speeds_of

OFFSET = 0.317


def correlated(robot, camera, low=-5.0, high=5.0, max_gap=0.2):
    return best_correlation((robot.timestamps, robot.poses), (camera.timestamps, camera.poses), low, high, max_gap)


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("rates", [(100.0, 20.0), (20.0, 100.0), (30.0, 30.0), (125.0, 7.0)])
def test_the_peak_is_at_the_offset(setup, rates):
    """robot_time = camera_time + offset, whatever X, W and the rates: to a third of the coarser interval."""
    rng = np.random.default_rng(SEED)
    for offset in (OFFSET, -OFFSET):
        _, _, robot, camera = streams(rng, motion(rng, 20.0), offset, 20.0, rates=rates, setup=setup)
        found = correlated(robot, camera)
        assert found.found
        assert abs(found.peaks[0] - offset) < 0.33 / min(rates)
        assert found.heights[0] > 0.8


def test_a_fifth_of_wrong_detections():
    rng = np.random.default_rng(SEED)
    _, _, robot, camera = streams(rng, motion(rng, 20.0), OFFSET, 20.0)
    wrong = rng.choice(len(camera), len(camera) // 5, replace=False)
    poses = camera.poses.copy()
    poses[wrong] = random_transforms(rng, (len(wrong),))
    found = correlated(robot, type(camera)(camera.timestamps, poses))
    assert found.found and abs(found.peaks[0] - OFFSET) < 0.05


def test_gaps_are_left_out():
    rng = np.random.default_rng(SEED)
    _, _, robot, camera = streams(rng, motion(rng, 20.0), OFFSET, 20.0)
    keep = (camera.timestamps < 6) | (camera.timestamps > 11)
    found = correlated(robot, some(camera, keep))
    assert found.found and abs(found.peaks[0] - OFFSET) < 0.03
    assert np.isnan(found.camera.speed).any()


@pytest.mark.slow
def test_motions_that_have_nothing_in_common_are_not_taken_for_it():
    """Chance gives a peak that counts in fewer than 1 of 20 cases (4 of 60 at most, by the binomial distribution)."""
    rng = np.random.default_rng(SEED)
    wrong = 0
    for _ in range(60):
        _, _, robot, _ = streams(rng, motion(rng, 15.0), 0.0, 15.0, rates=(50.0, 20.0))
        _, _, _, camera = streams(rng, motion(rng, 15.0), 0.0, 15.0, rates=(50.0, 20.0))
        wrong += correlated(robot, camera).found
    assert wrong <= 4


def test_a_periodic_motion_has_a_peak_for_every_period():
    def pose(t):
        a = np.pi * np.asarray(t)
        return transforms(
            rotations(np.stack([0.5 * np.sin(a), 0.4 * np.sin(a + 1), 0.3 * np.cos(a)], axis=-1)),
            np.stack([0.1 * np.sin(a), 0.1 * np.cos(a), 0.6 + 0.0 * a], axis=-1),
        )

    rng = np.random.default_rng(SEED)
    _, _, robot, camera = streams(rng, pose, OFFSET, 20.0)
    found = correlated(robot, camera)
    assert len(found.peaks) >= 5
    distance = (np.array(found.peaks) - OFFSET) % 1.0  # speeds have half the period of the motion
    assert np.minimum(distance, 1 - distance).max() < 0.03


def test_no_speed_no_peak():
    rng = np.random.default_rng(SEED)
    _, _, robot, camera = streams(rng, motion(rng, 10.0), OFFSET, 10.0)
    still = type(robot)(robot.timestamps, np.tile(robot.poses[:1], (len(robot), 1, 1)))
    assert not correlated(still, camera).found
    assert not correlated(robot, some(camera, slice(0, 5))).found
    assert not correlated(robot, camera, low=50.0, high=60.0).found  # nothing in common there


def test_a_grid_that_is_too_long_is_refused():
    rng = np.random.default_rng(SEED)
    times = np.append(np.arange(0, 1, 0.01), 1e6)
    with pytest.raises(InputError, match="Cut it"):
        speeds_of(times, random_transforms(rng, (len(times),)), 0.01, 0.1, 0.05)
