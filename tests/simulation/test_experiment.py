"""Experiments to repeat: exact data around the truth or around real data, and the covariance predicted there."""

import numpy as np
import pytest
from support import SEED, assert_same_covariance, difference, exact_motions, moved, random_covariance

import uq_handeye as uq
from uq_handeye.trials.simulation.experiment import experiment

NOISE = uq.PoseNoise.isotropic(robot=("0.3mrad", "0.1mm"), camera=("1mrad", "0.5mm"))


def constraint_error(found):
    """Largest violation of ``G X C = W`` or ``A X = X B``."""
    truth = found.truth
    if isinstance(truth, uq.PosePairs):
        return np.abs(truth.effective_robot @ found.X @ truth.camera - found.W).max()
    return np.abs(truth.A @ found.X - found.X @ truth.B).max()


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_the_truth_of_simulated_poses(setup):
    poses = uq.simulate(15, noise=NOISE, setup=setup, seed=SEED)
    found = experiment(poses, NOISE)
    np.testing.assert_array_equal(found.X, poses.truth.X)
    np.testing.assert_array_equal(found.truth.robot, poses.truth.robot)
    assert constraint_error(found) < 1e-14


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("noise", [NOISE, uq.PoseNoise(robot=NOISE.robot), uq.PoseNoise(camera=NOISE.camera), None])
def test_around_poses_without_truth_the_data_fit_exactly(setup, noise):
    poses = uq.simulate(15, noise=NOISE, setup=setup, seed=SEED)
    real = uq.PosePairs(poses.robot, poses.camera, setup)
    found = experiment(real, noise)
    assert constraint_error(found) < 1e-14
    fitted = uq.maximum_likelihood(real, found.noise)
    np.testing.assert_allclose(found.X, fitted.X, atol=1e-12)
    for true, measured, sd in ((found.truth.robot, poses.robot, 1e-3), (found.truth.camera, poses.camera, 3e-3)):
        assert np.abs(difference(true, measured)).max() < 8 * sd
    if noise is not None and noise.camera is None:
        np.testing.assert_array_equal(found.truth.camera, poses.camera)
    if noise is not None and noise.robot is None:
        np.testing.assert_array_equal(found.truth.robot, poses.robot)


@pytest.mark.parametrize("sides", ["AB", "A", "B"])
def test_around_motions_the_data_fit_exactly(sides):
    rng = np.random.default_rng(SEED)
    _, A, B = exact_motions(rng, 12)
    noise = uq.PairNoise(**{side: random_covariance(rng) for side in sides})
    measured = uq.Motions(
        *(moved(T, 1e-3 * rng.normal(size=(12, 6)) * (side in sides)) for T, side in ((A, "A"), (B, "B")))
    )
    found = experiment(measured, noise)
    assert constraint_error(found) < 1e-13
    np.testing.assert_allclose(found.X, uq.maximum_likelihood(measured, noise).X, atol=1e-12)


def test_noise_of_motions_on_poses_makes_motions_of_the_true_poses():
    poses = uq.simulate(10, noise=NOISE, seed=SEED)
    found = experiment(poses, uq.PairNoise(B=NOISE.camera), pairs="consecutive")
    assert isinstance(found.truth, uq.Motions) and found.truth.N == 9
    np.testing.assert_array_equal(found.X, poses.truth.X)
    assert constraint_error(found) < 1e-14


@pytest.mark.parametrize("method", ["4dpa", "efficient", "ml", "park", "shah", "nguyen"])
def test_predicted_is_what_calibrate_gives_on_the_true_poses(method):
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    found = experiment(poses, NOISE, method)
    result = uq.calibrate(uq.PosePairs(poses.truth.robot, poses.truth.camera), noise=NOISE, method=method)
    assert_same_covariance(found.predicted(), result.covariance, 1e-6)


def test_predicted_of_pairs_and_kinds():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    found = experiment(poses, NOISE, "4dpa", pairs="consecutive")
    motions = uq.relative_motions(uq.PosePairs(poses.truth.robot, poses.truth.camera), "consecutive")
    for kind in (None, "poses", "pairs"):
        assert_same_covariance(found.predicted(kind), uq.propagate(motions, NOISE, X=found.X, kind=kind), 1e-9)
    with pytest.raises(uq.InputError, match="published"):
        experiment(poses, NOISE, "efficient").predicted("pairs")


def test_what_cannot_be_redrawn_is_refused():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    with pytest.raises(uq.InputError, match="`method`"):
        experiment(poses, NOISE, "nobody")
    with pytest.raises(uq.InputError, match="scale"):
        experiment(poses, NOISE, "park", scale=1e4)
    with pytest.raises(uq.InputError, match="batch"):
        experiment(uq.simulate(12, noise=NOISE, seed=SEED, trials=3), NOISE)
    with pytest.raises(uq.InputError, match="PoseNoise"):
        experiment(poses, uq.PairNoise(A=NOISE.robot), "shah")
    with pytest.raises(uq.InputError, match="cover"):
        experiment(poses, uq.PoseNoise(camera=np.tile(NOISE.camera, (5, 1, 1))))
    with pytest.raises(uq.InputError, match="exactly"):
        experiment(uq.simulate(12, seed=SEED), None)
    with pytest.raises(uq.InputError, match="PosePairs or Motions"):
        experiment(3, NOISE)
