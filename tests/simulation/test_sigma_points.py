"""Sigma points: the rule on polynomials with known moments, first order to the last digit, Monte Carlo beyond it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import (
    SEED,
    assert_same_covariance,
    exact_motions,
    exact_poses,
    is_consistent,
    random_covariance,
    whitened_eigenvalues,
)

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.errors import InputError, NotConvergedError
from uq_handeye.trials.simulation import sigma_points as module
from uq_handeye.trials.simulation.experiment import experiment
from uq_handeye.trials.simulation.run import run
from uq_handeye.trials.simulation.sigma_points import cubature, radial_rule, sigma_points, sigma_points_of

PAIRS, POSES = 20, 10


def deviations(rotation, translation):
    return np.diag(np.repeat([rotation, translation], 3) ** 2)


def pair_problem(method, sd, seed=0, star=False):
    """Motions without noise, and noise on both sides; ``star``: nearly one common translation."""
    rng = np.random.default_rng([70, seed] if star else [SEED, seed])  # where it ends depends on the geometry
    X, A, B = exact_motions(rng, PAIRS)
    if star:
        B[:, :3, 3] = [0.3, 0.0, 0.4] + 0.01 * rng.normal(size=(PAIRS, 3))
        A = X @ B @ np.linalg.inv(X)
        noise = uq.PairNoise(deviations(sd, 1e-4), deviations(sd, 1e-4))
    else:
        noise = uq.PairNoise(random_covariance(rng, sd=sd), random_covariance(rng, shape=(PAIRS,), sd=sd))
    return experiment(uq.Motions(A, B), noise, method)


def pose_problem(method, sd, joint, setup="eye-in-hand"):
    rng = np.random.default_rng([SEED, 1])
    X, robot, camera = exact_poses(rng, POSES, setup)
    G = robot if setup == "eye-in-hand" else inverse(robot)
    truth = uq.model.poses.pose_pairs.Truth(X, G[0] @ X @ camera[0], robot, camera)
    S = random_covariance(rng, 6 * POSES, sd=sd) if joint else random_covariance(rng, sd=sd)
    noise = uq.PoseNoise(random_covariance(rng, shape=(POSES,), sd=sd), S)
    return experiment(uq.PosePairs(robot, camera, setup, truth=truth), noise, method)


def mean_square(trials):
    errors = trials.errors[trials.ok]
    return errors.T @ errors / len(errors)


# ------------------------------------------------------------------------------------------------------ the rule


@pytest.mark.parametrize("D", [1, 2, 3, 12, 720])
def test_the_radii_have_the_moments_of_gaussian_vectors(D):
    radii, weights = radial_rule(D)
    for power, moment in ((0, 1), (2, D), (4, D * (D + 2)), (6, D * (D + 2) * (D + 4))):
        assert_allclose(weights @ radii**power, moment, rtol=1e-12)


def polynomial(rng, D):
    """Linear, quadratic and cubic forms of z with two components: mean, and mean square by its orders 2, 4 and 6."""
    g, H = rng.normal(size=(2, D)), rng.normal(size=(2, D, D))
    H = H + np.swapaxes(H, 1, 2)
    a = rng.normal(size=(2, D))

    def function(z):
        quadratic = np.einsum("aij,mi,mj->ma", H, z, z) / 2
        return z @ g.T + quadratic + (z @ a.T) ** 3, np.ones(len(z), dtype=bool)

    mean = np.trace(H, axis1=1, axis2=2) / 2
    aa = a @ a.T
    # E (a z)^3 (b z)^3 = 9 |a|^2 |b|^2 (a b) + 6 (a b)^3, E (g z) (a z)^3 = 3 (g a) |a|^2
    cross = 3 * (g @ a.T) * np.diag(aa)
    fourth = np.einsum("aij,bji->ab", H, H) / 2 + np.outer(mean, mean) + cross + cross.T
    sixth = 9 * np.outer(np.diag(aa), np.diag(aa)) * aa + 6 * aa**3
    return function, mean, (g @ g.T, fourth, sixth)


def test_polynomials_are_integrated_exactly_in_the_mean_over_the_matrices():
    D = 4
    function, mean, orders = polynomial(np.random.default_rng(SEED), D)
    rng = np.random.default_rng([SEED, 2])
    found = [cubature(function, D, rng, rounds=20) for _ in range(400)]
    for one in found[:5]:  # the quadratic part of the mean by any matrix
        assert_allclose(one.mean, mean, rtol=1e-9)
    squares = np.array([one.mean_square for one in found])
    error = squares.std(axis=0) / np.sqrt(len(squares))
    assert (np.abs(squares.mean(axis=0) - sum(orders)) < 4.5 * error).all()
    # what a single radius sqrt(D) would give is noticed
    single = orders[0] + orders[1] * D / (D + 2) + orders[2] * D**2 / ((D + 2) * (D + 4))
    assert (np.abs(squares.mean(axis=0) - single).diagonal() > 10 * error.diagonal()).all()


def test_the_known_first_order_stands_in_for_the_directions_left_out(monkeypatch):
    monkeypatch.setattr(module, "DIRECTIONS", 5)
    rng = np.random.default_rng([SEED, 3])
    g = rng.normal(size=(2, 40))

    def linear(z):
        return z @ g.T, np.ones(len(z), dtype=bool)

    found = cubature(linear, 40, rng, rounds=2, first_order=g @ g.T)
    assert found.evaluations == 2 * 2 * 4 * 5
    assert_allclose(found.mean_square, g @ g.T, rtol=1e-10)


# --------------------------------------------------------------------------------------------------- first order


@pytest.mark.parametrize("method", ["4dpa", "efficient", "ml", "nguyen"])
def test_tiny_noise_on_motions_gives_the_first_order_covariance(method):
    problem = pair_problem(method, 1e-6)
    found = sigma_points_of(problem, rounds=1)  # any matrix will do
    assert_same_covariance(found.covariance, problem.predicted(), 1e-8)
    assert found.failures == 0
    with pytest.raises(AssertionError):
        assert_same_covariance((1 + 1e-7) * found.covariance, problem.predicted(), 1e-8)


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("method", ["4dpa", "efficient", "ml"])
def test_tiny_noise_on_poses_gives_the_first_order_covariance(method, joint):
    problem = pose_problem(method, 1e-6, joint, setup="eye-to-hand" if joint else "eye-in-hand")
    found = sigma_points_of(problem, rounds=1)
    assert found.dimensions == 12 * POSES
    assert_same_covariance(found.covariance, problem.predicted(), 1e-8)


@pytest.mark.parametrize("method", ["park", "shah"])
def test_published_methods_agree_to_the_digits_of_the_delta_method(method):
    """Their own covariance is made of numerical derivatives."""
    problem = pose_problem(method, 1e-6, joint=False)
    assert_same_covariance(sigma_points_of(problem, rounds=1).covariance, problem.predicted(), 1e-5)


def test_many_poses_use_some_directions_only(monkeypatch):
    monkeypatch.setattr(module, "MOST", 100)
    problem = pose_problem("4dpa", 1e-6, joint=True)
    assert_same_covariance(sigma_points_of(problem).covariance, problem.predicted(), 1e-6)


# --------------------------------------------------------------------------------------------- beyond first order


def has_mean_square(trials, covariance, points):
    """Return whether each whitened component of the errors has the mean square 1, by the scatter of both, tails or
    not.
    """
    z = np.linalg.solve(np.linalg.cholesky(covariance), trials.errors[trials.ok].T)
    error = (z**2).std(axis=1) * np.sqrt(1 / z.shape[1] + (1 / points if points else 0))
    return bool((np.abs((z**2).mean(axis=1) - 1) < 4.5 * error).all())


@pytest.mark.parametrize(("method", "sd"), [("4dpa", 0.4), ("park", 0.1), ("efficient", 0.05)])
def test_large_noise_gives_the_moments_of_monte_carlo(method, sd, monkeypatch):
    problem = pair_problem(method, sd, star=True)
    trials = run(problem, np.random.default_rng([SEED, 4]), 3000)
    assert not has_mean_square(trials, problem.predicted(), 0)
    found = sigma_points_of(problem, seed=SEED)
    assert has_mean_square(trials, found.mean_square, found.evaluations / 2)
    assert not has_mean_square(trials, found.mean_square / 1.5, found.evaluations / 2)
    bias = (found.bias - trials.errors.mean(axis=0)) / found.std
    assert np.abs(bias).max() < 0.12
    assert np.abs(found.bias / found.std).max() > 0.15  # which there is
    monkeypatch.setattr(module, "MOST", 100)
    found = sigma_points_of(problem, seed=SEED)
    assert has_mean_square(trials, found.mean_square, found.evaluations / 4)


def test_they_hold_where_first_order_fails():
    """The NEES of new trials holds at noise where the error still is nearly Gaussian."""
    problem = pair_problem("4dpa", 0.3, seed=5, star=True)
    trials = run(problem, np.random.default_rng([SEED, 6]), 1000)
    assert not is_consistent(trials.errors, problem.predicted())
    found = sigma_points_of(problem)
    assert is_consistent(trials.errors, found.mean_square)
    assert not is_consistent(trials.errors, found.mean_square / 1.21)  # deviations too small by 10 %


def along_axes(function, D):
    """The mean square by the plain rule: Q = I, one radius."""
    z = np.sqrt(D) * np.concatenate([np.eye(D), -np.eye(D)])
    values, _ = function(z)
    return values.T @ values / len(values)


def test_points_along_the_axes_miss_products_of_errors():
    def product(z):
        return z[:, :1] * z[:, 1:2], np.ones(len(z), dtype=bool)

    assert along_axes(product, 50) == 0
    found = [cubature(product, 50, np.random.default_rng([SEED, k])).mean_square.item() for k in range(20)]
    assert_allclose(np.mean(found), 1, atol=4.5 * np.std(found) / np.sqrt(20))


def test_points_along_the_axes_are_worse_than_first_order():
    """They move one motion by 15 standard deviations, so that what is quadratic in it is far too large."""
    problem = pair_problem("4dpa", 0.1, star=True)
    trials = run(problem, np.random.default_rng([SEED, 7]), 4000)
    axes = along_axes(module._function(problem), 12 * PAIRS)

    def worst(covariance):
        return np.abs(np.log(whitened_eigenvalues(mean_square(trials), covariance))).max()

    assert worst(sigma_points_of(problem).mean_square) < 0.12 < worst(axes)
    assert worst(problem.predicted()) < worst(axes)


# ------------------------------------------------------------------------------------------------- what is refused


def test_real_data_are_taken_as_fitted():
    noise = uq.PoseNoise.isotropic(camera=("5mrad", "2mm"))
    poses = uq.simulate(n_poses=15, noise=noise, seed=SEED)
    seen = uq.PosePairs(poses.robot, poses.camera)
    at_fit, at_truth = (sigma_points(data, noise=noise, method="4dpa") for data in (seen, poses))
    assert np.abs(np.log(whitened_eigenvalues(at_fit.covariance, at_truth.covariance))).max() < 0.2
    assert np.abs(at_fit.covariance - at_truth.covariance).max() > 0


def test_the_seed_decides_the_numbers():
    problem = pair_problem("4dpa", 0.1)
    one, same, other = (sigma_points_of(problem, rounds=1, seed=seed).covariance for seed in (1, 1, 2))
    assert (one == same).all() and (one != other).any()


def test_points_without_an_estimate_are_said():
    problem = pair_problem("nguyen", 0.3, star=True)
    with pytest.raises(NotConvergedError, match=r"At \d+ of \d+ sigma points method 'nguyen'") as raised:
        sigma_points_of(problem, rounds=1)
    partial = raised.value.partial
    assert 0 < partial.failures < partial.evaluations
    assert np.isfinite(partial.covariance).all()


def test_wrong_arguments_are_named():
    problem = pair_problem("4dpa", 0.01)
    for rounds in (0, 1.5, True):
        with pytest.raises(InputError, match="`rounds`"):
            sigma_points_of(problem, rounds=rounds)
    with pytest.raises(InputError, match="`seed`"):
        sigma_points_of(problem, seed=-1)


class TestInCalibrate:
    NOISE = uq.PoseNoise.isotropic(robot=("0.3deg", "1mm"), camera=("2deg", "5mm"))

    def poses(self):
        """Without the truth, which a result must not know."""
        poses = uq.simulate(15, noise=self.NOISE, seed=SEED)
        return uq.PosePairs(poses.robot, poses.camera)

    @pytest.mark.parametrize("method", ["efficient", "ml", "4dpa", "park", "shah"])
    def test_the_covariance_is_the_mean_square_around_the_fit(self, method):
        poses = self.poses()
        result = uq.calibrate(poses, noise=self.NOISE, method=method, covariance="sigma-points")
        expected = sigma_points(poses, noise=self.NOISE, method=method)
        assert_same_covariance(result.covariance, expected.mean_square, 1e-9)
        first_order = uq.calibrate(poses, noise=self.NOISE, method=method)
        np.testing.assert_array_equal(result.X, first_order.X)
        assert np.abs(whitened_eigenvalues(result.covariance, first_order.covariance) - 1).max() > 1e-4
        assert result.W is not None and result.covariance_W is None
        assert "beyond first order, of the noise given" in result.summary(verbose=True)

    def test_the_truth_of_simulated_poses_is_not_used(self):
        poses = self.poses()
        known = uq.simulate(15, noise=self.NOISE, seed=SEED)
        one, other = (uq.calibrate(p, noise=self.NOISE, covariance="sigma-points").covariance for p in (poses, known))
        np.testing.assert_array_equal(one, other)

    def test_of_motions_and_of_small_noise(self):
        noise = uq.PairNoise(A=1e-10 * np.eye(6), B=1e-8 * np.eye(6))
        motions = uq.relative_motions(uq.simulate(12, seed=SEED), "consecutive")
        result = uq.calibrate(motions, noise=noise, covariance="sigma-points")
        assert_same_covariance(result.covariance, uq.calibrate(motions, noise=noise).covariance, 1e-4)

    def test_from_a_file(self, tmp_path):
        result = uq.calibrate(self.poses(), noise=self.NOISE, covariance="sigma-points")
        result.to_json(tmp_path / "result.json")
        assert uq.Calibration.from_json(tmp_path / "result.json").covariance_kind == "sigma-points"
        assert "beyond first order, of the noise given" in result.summary(verbose=True)

    def test_refused_with_a_kind_of_first_order(self):
        with pytest.raises(uq.InputError, match="first order only"):
            uq.calibrate(self.poses(), noise=self.NOISE, kind="pairs", covariance="sigma-points")
