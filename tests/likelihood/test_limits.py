"""Limits of `efficient` and `ml`: tiny and large noise, exact and degenerate data, very few and very many poses."""

import tracemalloc

import numpy as np
import pytest
from fixtures.likelihood_problems import KINDS, distance, problem, reference
from support import (
    assert_same_covariance,
    difference,
    draw,
    exact_motions,
    moved,
    random_covariance,
    random_transforms,
)

import uq_handeye as uq
from uq_handeye.fit.graph.gauss_helmert import MAX_ML_STEPS, Fit, bound, efficient, maximum_likelihood

# ---------------------------------------------------------------------------------------------------- limits


@pytest.mark.parametrize("sd", [1e-6, 1e-9, 1e-12, 1e-15])
@pytest.mark.parametrize("kind", KINDS)
def test_ml_comes_to_an_end_at_any_small_noise(kind, sd, rng):
    """Also where a standard deviation is less than rounding moves X: no step can then be small beside it."""
    given = problem(kind, rng, 12, sd, shape=(20,))
    found = maximum_likelihood(given.data, given.noise)
    assert found.converged.all()
    # rad and m, by rounding through an ill-placed geometry
    assert np.abs(difference(found.X, given.X)).max() < 30 * sd + 1e-13


@pytest.mark.parametrize("kind", KINDS)
def test_ml_on_exact_data(kind, rng):
    given = problem(kind, rng, 6, 1e-3)
    first, second = given.exact
    data = uq.Motions(first, second) if kind == "motions" else uq.PosePairs(first, second, kind)
    found = maximum_likelihood(data, given.noise)
    np.testing.assert_allclose(found.X, given.X, atol=1e-12)
    assert found.iterations == 2 and np.abs(found.residual).max() < 1e-12
    assert_same_covariance(found.covariance_X, bound(data, given.noise, given.X), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["eye-in-hand", "motions"])
def test_ml_converges_at_large_noise(kind, rng):
    """30 mrad and 10 mm on both sides, 300 data sets."""
    S = np.diag(np.repeat([30e-3, 10e-3], 3) ** 2)
    if kind == "motions":
        _, *exact = exact_motions(rng, 30)
        first, second = (moved(T, draw(rng, S, (300, 30))) for T in exact)
        found = maximum_likelihood(uq.Motions(first, second), uq.PairNoise(S, S))
    else:
        poses = uq.simulate(30, noise=uq.PoseNoise(S, S), trials=300, seed=rng)
        found = maximum_likelihood(poses, uq.PoseNoise(S, S))
    assert found.converged.all() and found.iterations < 20


@pytest.mark.slow
def test_not_converged_says_so_and_gives_what_it_has(rng):
    """Poses that have nothing to do with each other: some of the problems have no maximum that is reached."""
    noise = uq.PoseNoise.isotropic(("1mrad", "1mm"), ("1mrad", "1mm"))
    poses = uq.simulate(12, noise=noise, trials=5, seed=rng)
    camera = poses.camera.copy()
    camera[2:] = random_transforms(rng, (3, 12), 2.0, 3.1)
    with pytest.raises(
        uq.NotConvergedError, match=r"did not converge on \d of 5 problems within 50 iter.*too large"
    ) as c:
        maximum_likelihood(uq.PosePairs(poses.robot, camera), noise)
    partial = c.value.partial
    assert isinstance(partial, Fit) and partial.iterations == MAX_ML_STEPS
    assert partial.converged[:2].all() and not partial.converged.all()
    good = maximum_likelihood(uq.PosePairs(poses.robot[:2], poses.camera[:2]), noise)
    assert distance(good, partial.X[:2], partial.W[:2], good.covariance) < 1e-5
    bad = int(np.argmin(partial.converged))
    with pytest.raises(uq.NotConvergedError, match="did not converge within 50 iterations") as c:
        maximum_likelihood(uq.PosePairs(poses.robot[bad], camera[bad]), noise)
    assert not c.value.partial.converged


@pytest.mark.parametrize(
    "noise",
    [
        uq.PoseNoise(camera=np.diag([1e-6] * 3 + [0.0] * 3)),
        uq.PoseNoise(robot=np.diag([0.0] * 3 + [1e-6] * 3)),
        uq.PoseNoise(np.diag([1e-6] * 3 + [0.0] * 3), np.diag([1e-6] * 3 + [0.0] * 3)),
        uq.PoseNoise(camera=np.tile(1e-6 * np.eye(6), (8, 8))),  # one error that all poses share, and none of their own
    ],
)
def test_noise_that_leaves_residuals_exact_is_refused(noise, rng):
    poses = uq.simulate(8, seed=2)
    for function in (efficient, maximum_likelihood, bound):
        with pytest.raises(uq.InputError, match=r"leaves a part of the residuals exact.*or use method '4dpa'"):
            function(poses, noise)


def test_the_other_side_can_make_up_for_exact_components(rng):
    """Rotations of the camera exact, translations of the robot exact: together every residual has noise."""
    noise = uq.PoseNoise(np.diag([1e-6] * 3 + [0.0] * 3), np.diag([0.0] * 3 + [1e-6] * 3))
    poses = uq.simulate(12, noise=noise, seed=rng)
    found = maximum_likelihood(poses, noise)
    assert distance(found, poses.truth.X, poses.truth.W, found.covariance) < 7.5


@pytest.mark.parametrize("method", [efficient, maximum_likelihood])
def test_degenerate_data_are_named(method, rng):
    noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    poses = uq.simulate(12, noise=noise, seed=rng)
    few = uq.PosePairs(poses.robot[:1], poses.camera[:1])
    with pytest.raises(uq.DegenerateMotionError):
        method(few, noise)
    # one rotation axis: the translation of X along it leaves no trace
    X = random_transforms(rng)
    turns = np.zeros((9, 3)) + np.linspace(0.1, 2.0, 9)[:, None] * [0.0, 0.0, 1.0]
    robot = moved(np.broadcast_to(np.eye(4), (9, 4, 4)), np.concatenate([turns, rng.normal(size=(9, 3))], axis=1))
    camera = np.linalg.inv(X) @ np.linalg.inv(robot) @ random_transforms(rng)
    planar = uq.PosePairs(robot, camera)
    for found in (method(planar, noise), method(planar, noise, X)):
        # along z of the gripper, the axis of rotation
        np.testing.assert_allclose(np.abs(found.open_directions_X), [[0, 0, 0, 0, 0, 1]], atol=1e-5)
        assert np.isfinite(found.covariance).all() and (found.covariance_X[5] == 0).all()
    assert (bound(planar, noise, X)[5] == 0).all()


@pytest.mark.parametrize("method", [efficient, maximum_likelihood])
def test_pure_translations_are_named(method, rng):
    """No rotation at all: nothing is known of the translation of X, on motions not even its derivative."""
    X = random_transforms(rng)
    A = np.broadcast_to(np.eye(4), (6, 4, 4)).copy()
    A[:, :3, 3] = rng.normal(size=(6, 3))
    motions = uq.Motions(A, np.linalg.inv(X) @ A @ X)
    noise = uq.PairNoise.isotropic(A=("1mrad", "1mm"))
    found = method(motions, noise, X)
    np.testing.assert_allclose(found.covariance_X[3:, 3:], 0.0, atol=1e-12)
    assert len(found.open_directions) == 3 and np.abs(found.open_directions[:, :3]).max() < 1e-6


def test_three_poses_suffice(rng):
    for kind in KINDS:
        given = problem(kind, rng, 3, 1e-4)
        X, W, covariance, _ = reference(given)
        found = maximum_likelihood(given.data, given.noise)
        assert distance(found, X, W, covariance) < 1e-6
        assert_same_covariance(found.covariance, covariance, 1e-5)


def test_five_thousand_poses(rng):
    """Memory is linear in the poses: a few 6 x 12 matrices each."""
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng))
    peaks = []
    for n in (500, 5000):
        poses = uq.simulate(n, noise=noise, seed=rng)
        tracemalloc.start()
        found = efficient(poses, noise)
        peaks.append(tracemalloc.get_traced_memory()[1] / n)
        tracemalloc.stop()
        assert distance(found, poses.truth.X, poses.truth.W, found.covariance) < 7.5
    assert max(peaks) < 14e3 and peaks[1] < 1.3 * peaks[0]
