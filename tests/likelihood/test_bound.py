"""The Cramer-Rao bound: at what it is taken, and that no method is below it."""

import numpy as np
import pytest
from fixtures.likelihood_problems import KINDS
from support import (
    assert_same_covariance,
    difference,
    exact_motions,
    jacobian,
    moved,
    random_covariance,
    whitened_eigenvalues,
)

import uq_handeye as uq
from uq_handeye.fit.graph.gauss_helmert import bound, maximum_likelihood

# ----------------------------------------------------------------------------------------------------- bound


def test_bound_at_truth_at_a_given_X_and_at_neither(rng):
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng))
    for setup in KINDS[:2]:
        poses = uq.simulate(15, noise=noise, setup=setup, seed=rng)
        truth = poses.truth
        at_truth = bound(poses, noise)
        exact = uq.PosePairs(truth.robot, truth.camera, setup)
        assert_same_covariance(bound(exact, noise, truth.X), at_truth, 1e-9)
        assert_same_covariance(bound(exact, noise), at_truth, 1e-9)
        assert_same_covariance(bound(uq.relative_motions(poses, "all"), noise), at_truth, 1e-9)
        bare = uq.PosePairs(poses.robot, poses.camera, setup)
        np.testing.assert_array_equal(bound(bare, noise), maximum_likelihood(bare, noise).covariance_X)
        for near in (bound(bare, noise), bound(bare, noise, truth.X)):
            assert_same_covariance(near, at_truth, 0.05)
        assert np.abs(whitened_eigenvalues(1.1 * at_truth, at_truth) - 1).min() > 0.05


def test_bound_of_motions(rng):
    """X given, on exact motions: the inverse of the Fisher information summed up pair by pair."""
    X, A, B = exact_motions(rng, 12)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng, 6, (12,)))

    def residual(kind):
        def of(x):
            a, b, at = A, B, X
            if kind == "X":
                at = moved(X, x)[:, None]
            elif kind == "A":
                a = moved(A, x[:, None])
            else:
                b = moved(B, x[:, None])
            return difference(a @ at, at @ b)

        return jacobian(of, 6).reshape(12, 6, 6)

    J, D_A, D_B = (residual(kind) for kind in "XAB")
    S = D_A @ noise.A @ D_A.mT + D_B @ noise.B @ D_B.mT
    expected = np.linalg.inv(np.sum(J.mT @ np.linalg.solve(S, J), axis=0))
    assert_same_covariance(bound(uq.Motions(A, B), noise, X), expected, 1e-8)
    assert_same_covariance(bound(uq.Motions(A, B), noise), expected, 1e-8)


@pytest.mark.parametrize("method", ["4dpa", "park", "daniilidis", "nguyen", "andreff"])
def test_no_method_is_below_the_bound(method, rng):
    """Predicted covariances of published estimators, independent pairs: no direction has less variance."""
    X, A, B = exact_motions(rng, 25)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    predicted = uq.propagate(uq.Motions(A, B), noise=noise, method=method, X=X)
    smallest = whitened_eigenvalues(predicted, bound(uq.Motions(A, B), noise, X))[0]
    assert smallest > 1 - 1e-6


def test_no_combination_of_pairs_is_below_the_bound_on_poses(rng):
    for setup in KINDS[:2]:
        noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng))
        poses = uq.simulate(12, setup=setup, seed=rng)
        least = bound(poses, noise)
        for pairs in ("consecutive", "all"):
            predicted = uq.propagate(uq.relative_motions(poses, pairs), noise=noise)
            assert whitened_eigenvalues(predicted, least)[0] > 1 - 1e-6


def test_bound_refuses_what_does_not_fit(rng):
    poses = uq.simulate(8, seed=rng)
    with pytest.raises(uq.InputError, match="`X` to have shape"):
        bound(poses, uq.PoseNoise(camera=np.eye(6)), np.eye(3))
    with pytest.raises(uq.InputError, match="`camera` to cover 8 poses, got 7"):
        bound(poses, uq.PoseNoise(camera=np.eye(42)))
    with pytest.raises(uq.InputError, match="give the Motions"):
        bound(poses, uq.PairNoise(A=np.eye(6)))


@pytest.mark.parametrize("function", [uq.efficient, uq.maximum_likelihood, uq.bound])
@pytest.mark.parametrize("noise", [None, "1mm", np.eye(6)])
def test_noise_and_data_of_a_wrong_type(function, noise):
    with pytest.raises(uq.InputError, match=f"`noise` to be PoseNoise or PairNoise, got {type(noise).__name__}"):
        function(uq.simulate(5, seed=1), noise)
    with pytest.raises(uq.InputError, match="`data` to be PosePairs or Motions, got ndarray"):
        function(np.eye(4), uq.PoseNoise(camera=1e-6 * np.eye(6)))
