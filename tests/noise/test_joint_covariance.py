"""A joint covariance kept as blocks and a few common errors: the same numbers as the whole array, in O(n)."""

import tracemalloc
from dataclasses import astuple

import numpy as np
import pytest
from scipy.linalg import block_diag
from support import assert_same_covariance, difference, random_covariance

import uq_handeye as uq
from uq_handeye.errors import InputError, SingularNoiseError
from uq_handeye.fit.diagnostics.budget import budget
from uq_handeye.fit.diagnostics.diagnose import diagnose
from uq_handeye.fit.graph.gauss_helmert import bound, efficient, maximum_likelihood
from uq_handeye.fit.graph.goodness_of_fit import goodness_of_fit
from uq_handeye.fit.graph.robust import pose_distances
from uq_handeye.model.errors.joint_covariance import JointCovariance
from uq_handeye.model.errors.models import noise_from_dict, noise_to_dict
from uq_handeye.model.errors.square_roots import cholesky_of, inverse_blocks, marginals, pulled, weighted, whiten
from uq_handeye.trials.simulation.rig import disturbed

ROBOT = np.diag([1e-4, 1e-4, 1e-4, 2e-4, 2e-4, 2e-4]) ** 2


@pytest.fixture
def structured():
    """Make joint covariances."""

    def make(rng, n, q=4, sd=1e-3):
        return JointCovariance(random_covariance(rng, shape=(n,), sd=sd), 2 * sd * rng.normal(size=(n, 6, q)))

    return make


@pytest.fixture
def both_ways(structured):
    """Poses with joint noise on the camera, and the noise as structure and as array."""

    def make(rng, n=12, setup="eye-in-hand"):
        S = structured(rng, n)
        exact = uq.simulate(n, setup=setup, seed=3)
        camera = disturbed(exact.camera, S, (), rng)
        robot = disturbed(exact.robot, ROBOT, (), rng)
        poses = uq.PosePairs(robot, camera, setup)
        return poses, uq.PoseNoise(ROBOT, S), uq.PoseNoise(ROBOT, np.asarray(S))

    return make


def test_it_multiplies_like_the_array(rng, structured):
    S = structured(rng, 5)
    whole = np.asarray(S)
    assert S.shape == whole.shape == (30, 30) and S.ndim == 2 and len(S) == 30 and S.any()
    x = rng.normal(size=(30, 3))
    np.testing.assert_allclose(S @ x, whole @ x, atol=1e-15)
    np.testing.assert_allclose(S @ x[:, 0], whole @ x[:, 0], atol=1e-15)
    np.testing.assert_allclose(x.T @ S, x.T @ whole, atol=1e-15)
    np.testing.assert_allclose(np.asarray(2.5 * S), 2.5 * whole, atol=1e-18)
    np.testing.assert_allclose(S.blocks, marginals(whole), atol=1e-18)
    index = np.array([3, 1])
    part = whole.reshape(5, 6, 5, 6)[index][:, :, index].reshape(12, 12)
    np.testing.assert_allclose(np.asarray(S.rows(index)), part, atol=1e-18)
    D = rng.normal(size=(5, 6, 6))
    wide = block_diag(*D)
    np.testing.assert_allclose(np.asarray(S.carried(D)), wide @ whole @ wide.T, atol=1e-17)
    alone = structured(rng, 5)
    np.testing.assert_allclose(np.asarray(S.plus(alone)), whole + np.asarray(alone), atol=1e-18)
    np.testing.assert_allclose(np.asarray(alone.plus(S)), whole + np.asarray(alone), atol=1e-18)


def test_the_square_root_is_one(rng, structured):
    S = structured(rng, 7, q=5)
    L, whole = cholesky_of(S), np.asarray(S)
    values = rng.normal(size=(7, 6, 4))
    flat = values.reshape(42, 4)
    white = whiten(L, values).reshape(42, 4)
    np.testing.assert_allclose(white.T @ white, flat.T @ np.linalg.solve(whole, flat), rtol=1e-9)
    solved = pulled(L, whiten(L, values)).reshape(42, 4)
    np.testing.assert_allclose(solved, np.linalg.solve(whole, flat), rtol=1e-8)
    np.testing.assert_allclose(inverse_blocks(L), marginals(np.linalg.inv(whole)), rtol=1e-8)
    w = rng.uniform(0.1, 1.0, 7)
    # what poses share is no error of their own that a weight could enlarge
    expected = whole + block_diag(*(S.own / w[:, None, None] - S.own))
    np.testing.assert_allclose(np.asarray(weighted(S, w)), expected, rtol=1e-9, atol=1e-18)


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("estimate", [efficient, maximum_likelihood])
def test_estimates_are_those_of_the_whole_array(rng, setup, estimate, both_ways):
    poses, noise, dense = both_ways(rng, setup=setup)
    found, expected = estimate(poses, noise), estimate(poses, dense)
    assert_same_covariance(found.covariance, expected.covariance, 1e-7)
    np.testing.assert_allclose(found.X, expected.X, atol=1e-10)
    np.testing.assert_allclose(found.W, expected.W, atol=1e-10)
    for a, b in zip(pose_distances(found), pose_distances(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6)
    np.testing.assert_allclose(*(astuple(goodness_of_fit(of)) for of in (found, expected)), rtol=1e-6)
    parts, whole = budget(found, noise), budget(expected, dense)
    np.testing.assert_allclose(parts.covariance, whole.covariance, rtol=1e-5, atol=1e-16)
    one, other = diagnose(found, poses, noise), diagnose(expected, poses, dense)
    np.testing.assert_allclose(one.influence.share, other.influence.share, rtol=1e-6)
    np.testing.assert_allclose(one.influence.shift_sd, other.influence.shift_sd, rtol=1e-5)
    assert_same_covariance(bound(poses, noise, found.X), bound(poses, dense, found.X), 1e-7)


def test_first_order_covariances_of_other_methods(rng, both_ways):
    poses, noise, dense = both_ways(rng)
    motions = uq.relative_motions(poses, "all")
    for method in ("4dpa", "park", "daniilidis"):
        assert_same_covariance(
            uq.propagate(motions, noise=noise, method=method), uq.propagate(motions, noise=dense, method=method), 1e-9
        )


def test_on_both_sides_and_beside_an_array(rng, structured):
    n = 9
    one, other = structured(rng, n), structured(rng, n, q=2)
    exact = uq.simulate(n, seed=3)
    poses = uq.PosePairs(disturbed(exact.robot, one, (), rng), disturbed(exact.camera, other, (), rng))
    expected = efficient(poses, uq.PoseNoise(np.asarray(one), np.asarray(other))).covariance
    assert_same_covariance(efficient(poses, uq.PoseNoise(one, other)).covariance, expected, 1e-7)
    assert_same_covariance(efficient(poses, uq.PoseNoise(np.asarray(one), other)).covariance, expected, 1e-7)


@pytest.mark.slow
def test_draws_have_the_covariance(rng, structured):
    n = 3
    S = structured(rng, n)
    T = uq.simulate(n, seed=1).camera
    xi = difference(disturbed(T, S, (40_000,), rng), T).reshape(-1, 6 * n)
    assert_same_covariance(np.cov(xi.T), np.asarray(S), 0.07)
    with pytest.raises(AssertionError):  # the errors in common are more than those of each pose
        assert_same_covariance(np.cov(xi.T), np.kron(np.eye(n), np.ones((6, 6))) * np.asarray(S), 0.07)


@pytest.mark.slow
def test_calibrate_validate_and_files_take_it(rng, tmp_path, both_ways):
    poses, noise, dense = both_ways(rng, n=15)
    result, expected = uq.calibrate(poses, noise=noise), uq.calibrate(poses, noise=dense)
    assert_same_covariance(result.covariance, expected.covariance, 1e-6)
    assert result.warnings == expected.warnings
    again = noise_from_dict(noise_to_dict(noise))
    np.testing.assert_array_equal(np.asarray(again.camera), np.asarray(noise.camera))
    result.to_json(tmp_path / "result.json")
    read = uq.Calibration.from_json(tmp_path / "result.json")
    np.testing.assert_array_equal(read.noise.camera.shared, noise.camera.shared)
    for of in (noise, dense):
        run = uq.monte_carlo(poses, noise=of, trials=2000, method="efficient", seed=1)
        assert run.consistency.consistent, run.summary()


def test_what_makes_no_sense_is_refused(rng, structured):
    with pytest.raises(InputError, match=r"Expected `own` \(n, 6, 6\) and `shared` \(n, 6, q\) of one n"):
        JointCovariance(np.zeros((3, 6, 6)), np.zeros((4, 6, 1)))
    with pytest.raises(InputError, match="cover 5 poses, got 4"):
        efficient(uq.simulate(5, seed=0), uq.PoseNoise(camera=structured(rng, 4)))
    with pytest.raises(InputError, match="variances of `camera` to be >= 0"):
        uq.PoseNoise(camera=JointCovariance(np.tile(-np.eye(6), (3, 1, 1)), np.zeros((3, 6, 1))))
    with pytest.raises(InputError, match="finite"):
        uq.PoseNoise(camera=JointCovariance(np.tile(np.eye(6), (3, 1, 1)), np.full((3, 6, 1), np.nan)))
    nothing_of_its_own = JointCovariance(np.zeros((5, 6, 6)), np.ones((5, 6, 2)))
    with pytest.raises(SingularNoiseError):
        efficient(uq.simulate(5, seed=0), uq.PoseNoise(camera=nothing_of_its_own))


def test_a_thousand_poses_take_little_memory(rng, structured):
    n = 1000
    S = structured(rng, n, q=8)
    exact = uq.simulate(n, seed=3)
    poses = uq.PosePairs(exact.robot, disturbed(exact.camera, S, (), rng))
    noise = uq.PoseNoise(ROBOT, S)
    efficient(poses, noise)
    tracemalloc.start()
    efficient(poses, noise)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6, "an array of (6n, 6n) would take 288 MB"
