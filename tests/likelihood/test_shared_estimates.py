"""Errors that all poses share: as unknowns of a joint fit, and consistent with the errors that are made."""

import warnings

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.fit.diagnostics.resampled import resampled
from uq_handeye.fit.graph.constraint import constraint_of
from uq_handeye.fit.graph.gauss_helmert import efficient, fit
from uq_handeye.fit.graph.own_residuals import own_residuals
from uq_handeye.fit.graph.shared_estimates import _to_unit, estimates_of, posterior_of_fit
from uq_handeye.fit.graph.starts import start_of
from uq_handeye.model.errors.square_roots import cholesky_of, gram, whiten
from uq_handeye.model.shared_errors.in_noise import shared_columns, with_shared

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
SETUPS = ("eye-in-hand", "eye-to-hand")
S = uq.SharedError
ERRORS = {
    "focal length": S.focal_length(1e-3),
    "principal point": S.principal_point(1e-3),
    "target scale": S.target_scale(1e-3),
    "robot scale": S.robot_scale(1e-3),
    "clock offset": S.clock_offset(1e-2),
}


def with_times(poses):
    return uq.PosePairs(poses.robot, poses.camera, poses.setup, timestamps=np.arange(poses.n, dtype=float))


@pytest.mark.parametrize("setup", SETUPS)
def test_the_same_as_one_joint_fit(setup):
    """(X, W, z) with the prior rows, by normal equations, against S + F F^T and what is made of its residuals."""
    poses = with_times(uq.simulate(n_poses=15, noise=NOISE, setup=setup, seed=3))
    errors = list(ERRORS.values())
    noise = with_shared(NOISE, shared_columns(errors, poses))
    constraint = constraint_of(poses, noise)
    found = fit(constraint, noise, start_of(poses, constraint, None), 1)
    linear = found.linear
    F = np.concatenate(
        [linear.sides[("robot", "camera").index(e.side)] @ (e.at(poses) * e.sd) for e in errors], axis=-1
    )
    own = sum(D @ C @ D.mT for D, C in zip(linear.sides, (NOISE.robot, NOISE.camera), strict=True))
    sums = gram(whiten(cholesky_of(own), np.concatenate([linear.J, F, linear.r[..., None]], axis=-1)))
    q = F.shape[-1]
    information = sums[:-1, :-1] + np.diag([0.0] * 12 + [1.0] * q)
    C = np.linalg.inv(information)
    x = -C @ sums[:-1, -1]
    np.testing.assert_allclose(found.covariance, C[:12, :12], rtol=1e-6, atol=1e-12)
    estimates = estimates_of(posterior_of_fit(found, noise, errors), errors, found)
    by_name = {estimate.name: estimate for estimate in estimates}
    ordered = [name for side in ("robot", "camera") for e in errors if e.side == side for name in map(str, e.keys)]
    sd = np.concatenate([e.sd for e in errors])
    names = [name for e in errors for name in map(str, e.keys)]
    assert set(ordered) == set(by_name)
    for k, name in enumerate(names):
        assert by_name[name].estimate == pytest.approx(-sd[k] * x[12 + k], rel=1e-5, abs=1e-9 * sd[k])
        assert by_name[name].sd == pytest.approx(sd[k] * np.sqrt(C[12 + k, 12 + k]), rel=1e-6)
        assert 0 <= by_name[name].share <= 1
    of_poses = own_residuals(found)
    expected = whiten(cholesky_of(own), (linear.r + (np.concatenate([linear.J, F], axis=-1) @ x))[..., None])[..., 0]
    np.testing.assert_allclose(of_poses.e, expected, atol=1e-6)


def drawn(name, setup, count, poses, rng):
    """Poses (count, n, 4, 4) with noise and a draw of the error each."""
    error, n = ERRORS[name], poses.n
    T, C = (np.broadcast_to(of, (count, n, 4, 4)) for of in (poses.truth.robot, poses.truth.camera))
    xi = {side: rng.multivariate_normal(np.zeros(6), getattr(NOISE, side), (count, n)) for side in ("robot", "camera")}
    true = uq.PosePairs(poses.truth.robot, poses.truth.camera, setup, timestamps=np.arange(n, dtype=float))
    made = (rng.normal(size=(count, len(error.sd))) * error.sd) @ error.at(true).swapaxes(1, 2).reshape(
        n, len(error.sd), 6
    ).swapaxes(0, 1).reshape(len(error.sd), n * 6)
    xi[error.side] = xi[error.side] + made.reshape(count, n, 6)
    return perturb(T, xi["robot"]), perturb(C, xi["camera"]), error


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("name", ERRORS)
def test_consistent_where_the_error_is_drawn_from_its_prior(name, setup, rng):
    """NEES over 2,000 draws with the noise given; the covariance without the error is rejected."""
    count = 2000
    poses = uq.simulate(n_poses=15, noise=NOISE, setup=setup, seed=5)
    robot, camera, error = drawn(name, setup, count, poses, rng)
    columns = shared_columns([error], with_times(poses))
    found, plain = (
        efficient(uq.PosePairs(robot, camera, setup), noise) for noise in (with_shared(NOISE, columns), NOISE)
    )
    nees = []
    for of in (found, plain):
        apart = error_of(of.X, poses.truth.X)
        nees.append(float(np.einsum("ti,tij,tj->t", apart, np.linalg.inv(of.covariance_X), apart).mean()))
    spread = 4 * np.sqrt(12 / count)
    assert abs(nees[0] - 6) < spread + 0.1
    assert nees[1] > 6 + 2 * spread or name == "clock offset"


def error_of(X, truth):
    turn = Rotation.from_matrix(truth[:3, :3] @ X[..., :3, :3].mT).as_rotvec()
    return np.concatenate([turn, truth[:3, 3] - X[..., :3, 3]], axis=-1)


@pytest.mark.slow
def test_a_size_is_what_the_data_say_of_it():
    """A target whose size is right keeps a small error, one that is 1 % wrong is found in the tail of its prior."""
    for wrong in (0.0, 0.01):
        poses = uq.simulate(n_poses=20, noise=NOISE, seed=8)
        camera = poses.camera.copy()
        camera[:, :3, 3] *= 1 + wrong
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            found = uq.calibrate(uq.PosePairs(poses.robot, camera))
        scale = next(one for one in found.shared if one.name == "target scale")
        assert abs(scale.estimate - wrong) < 4 * scale.sd and scale.sd < 3e-3
        apart = error_of(found.X, poses.truth.X)
        assert apart @ np.linalg.solve(found.covariance, apart) < found.quantile(0.999)


@pytest.mark.statistical
def test_estimates_of_a_prior_that_is_wrong_stand_out(rng):
    """The p-value is uniform where the prior is right, and small where the error is ten times as large."""
    error = S.target_scale(1e-3)
    p_values = {}
    for size in (1.0, 10.0):
        p_values[size] = []
        for seed in range(200):
            of = uq.simulate(n_poses=20, noise=NOISE, seed=seed)
            camera = of.camera.copy()
            camera[:, :3, 3] *= 1 + size * 1e-3 * rng.normal()
            data = uq.PosePairs(of.robot, camera)
            noise = with_shared(NOISE, shared_columns([error], data))
            fitted = efficient(data, noise)
            of_fit = posterior_of_fit(fitted, noise, [error])
            p_values[size].append(estimates_of(of_fit, [error], fitted)[0].p_value)
    assert stats.kstest(p_values[1.0], "uniform").pvalue > 1e-3
    assert np.mean(np.array(p_values[10.0]) < 1e-3) > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sandwich", "bootstrap"])
def test_covariances_from_residuals_beside_declared_errors(kind):
    """On average they are the model's, in the directions of noise and in those of the declared errors."""
    errors = [ERRORS["focal length"], ERRORS["principal point"], ERRORS["robot scale"]]
    ratios = []
    for seed in range(60):
        poses = uq.simulate(n_poses=30, noise=NOISE, seed=seed)
        noise = with_shared(NOISE, shared_columns(errors, poses))
        found = efficient(poses, noise)
        of_residuals = resampled(poses, "efficient", kind, fit=found, replicates=400).covariance_X
        ratios.append(np.linalg.solve(found.covariance_X, of_residuals))
    mean = np.mean(ratios, axis=0)
    assert 0.85 < np.trace(mean) / 6 < 1.2
    assert np.abs(mean - np.eye(6)).max() < 0.4


def test_columns_that_are_the_same_are_one_for_the_residuals():
    """Errors that no data tell apart, such as two of one effect: the residuals and X are as with one of both sizes."""
    poses = uq.simulate(12, noise=NOISE, seed=3)
    F = np.random.default_rng(1).normal(size=(12, 6, 1))
    twice = uq.SharedError.columns("two", np.concatenate([F, F], axis=-1), 1e-4, "camera")
    once = uq.SharedError.columns("one", F, np.sqrt(2) * 1e-4, "camera")
    found, expected = (uq.calibrate(poses, noise=NOISE, shared=[error]) for error in (twice, once))
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-8)
    np.testing.assert_allclose(found.shared[0].estimate, expected.shared[0].estimate / 2, rtol=1e-6)
    normality = [result.analysis.diagnostics.normality.p_value for result in (found, expected)]
    assert normality[0] == pytest.approx(normality[1], rel=1e-6)


def test_shares_of_a_covariance_that_rounding_leaves_singular():
    """A direction without variance has no share; the others are as they were."""
    moves = np.random.default_rng(0).normal(size=(6, 2))
    inside = _to_unit(moves @ moves.T) @ moves[:, 0]
    assert np.sum(inside**2) == pytest.approx(1.0)
