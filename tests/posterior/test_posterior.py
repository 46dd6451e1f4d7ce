"""The joint posterior: its mixture against draws from it, its update against Bayes, its file."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import kstest

import uq_handeye as uq
from uq_handeye.fit.graph.posterior import Posterior, SizePoints
from uq_handeye.fit.graph.rows import NewRows
from uq_handeye.model.errors.keys import ROBOT_ACCURACY, ROBOT_ROTATION, TARGET_SCALE, VIEW
from uq_handeye.model.errors.sizes import Size
from uq_handeye.model.errors.term import ErrorTerm

D, Q, M, K = 6, 3, 4, 6
N = 12 + Q


def spd(rng, n, scale=1.0):
    A = rng.standard_normal((n, n + 4))
    return scale * A @ A.T / n


@pytest.fixture
def posterior(rng):
    """A mixture of Gaussians that differ much."""
    w = rng.uniform(0.5, 1.0, D)
    w /= w.sum()
    C = np.array([spd(rng, N, rng.uniform(0.3, 3.0)) for _ in range(D)])
    m = 0.5 * rng.standard_normal((D, N))
    P = np.tensordot(w, C, axes=1) + (w * m.T) @ m
    back = np.linalg.inv(np.linalg.cholesky(P))
    points = SizePoints((VIEW, ROBOT_ACCURACY), rng.standard_normal((D, 2)), w, m @ back.T, back @ C @ back.T)
    noise = (ErrorTerm(ROBOT_ROTATION, "robot", Size(0.5), block=np.eye(6)),)
    bound = tuple(np.tile(np.eye(4), (2, 5, 1, 1)))
    keys = (VIEW.number(1), TARGET_SCALE, ROBOT_ACCURACY.number(1))
    return Posterior(keys, rng.standard_normal(Q), P, points=points, noise=noise, bound=bound), C, m


def rows_of(of, rng, r=None):
    B = rng.standard_normal((M, K, N))
    own_at = np.array([[spd(rng, K, size) for _ in range(M)] for size in rng.uniform(0.3, 2.0, D)])
    own = np.tensordot(of.points.weights, own_at, axes=1)
    return B, own_at, NewRows(np.zeros((M, K)) if r is None else r, B @ of.A, own, of, own_at=own_at)


@pytest.mark.statistical
def test_d2_has_the_distribution_of_the_mixture(posterior, rng):
    of, C, m = posterior
    B, own_at, rows = rows_of(of, rng)
    flat, runs = B.reshape(M * K, N), 4000
    white = np.linalg.inv(np.linalg.cholesky(rows.covariance))
    which = rng.choice(D, runs, p=of.points.weights)
    d2 = np.empty(runs)
    roots = [np.linalg.cholesky(flat @ C[d] @ flat.T + block_diag(*own_at[d])) for d in range(D)]
    for k, d in enumerate(which):
        d2[k] = np.sum((white @ (flat @ m[d] + roots[d] @ rng.standard_normal(M * K))) ** 2)
    p = np.array([rows.test.reference.p_value(x) for x in d2])
    assert kstest(p, "uniform").statistic < 0.04
    assert abs(np.mean(p < 0.05) - 0.05) < 0.02
    as_one = np.array([type(rows.test.reference).given(M * K).p_value(x) for x in d2])
    # one Gaussian does not have it: of uniform numbers the statistic is above 0.05 with a probability of 4e-9
    assert kstest(as_one, "uniform").statistic > 0.05
    assert rows.test.reference.weight @ (rows.test.reference.scale * rows.test.reference.dof) == pytest.approx(
        d2.mean(), rel=0.05
    )


def test_known_sizes_are_chi_square(posterior, rng):
    of = Posterior(posterior[0].keys, posterior[0].estimate, posterior[0].covariance)
    assert NewRows(
        np.ones((2, 6)), rng.standard_normal((2, 6, N)), np.array([np.eye(6)] * 2), of
    ).test.reference.noise_given


def test_absorbing_is_bayes_at_known_sizes(posterior, rng):
    of = replace(posterior[0], points=None, noise=())
    B = rng.standard_normal((M, K, N))
    rows = NewRows(3.0 * rng.standard_normal((M, K)), B @ of.A, np.array([spd(rng, K) for _ in range(M)]), of)
    after, move = of.absorb(rows)
    flat, r = B.reshape(M * K, N), rows.r.ravel()
    gain = of.covariance @ flat.T @ np.linalg.inv(flat @ of.covariance @ flat.T + block_diag(*rows.own))
    np.testing.assert_allclose(move, gain @ r, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(after.covariance, of.covariance - gain @ flat @ of.covariance, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(after.estimate, of.estimate + move[12:])


def test_it_comes_back_from_its_text(posterior, rng):
    of = replace(posterior[0], points=None)
    again = Posterior.from_dict(json.loads(json.dumps(of.to_dict())))
    np.testing.assert_array_equal(again.covariance, of.covariance)
    assert again.keys == of.keys and again.noise[0].key == of.noise[0].key
    assert again.noise[0].size == of.noise[0].size
    np.testing.assert_array_equal(again.noise[0].block, of.noise[0].block)
    np.testing.assert_array_equal(again.bound[0], of.bound[0])
    wrong = of.to_dict()
    wrong["noise"][0]["block"] = [[1.0, 2.0]]
    with pytest.raises(uq.InputError, match=r"posterior\.noise\.block to be numbers of shape"):
        Posterior.from_dict(wrong)


def test_owners_and_blocks(posterior):
    of = posterior[0]
    assert of.numbers == {VIEW: (0,), TARGET_SCALE: (1,), ROBOT_ACCURACY: (2,)}
    assert of.owned_by(["target", "robot"]).tolist() == [1, 2]
    np.testing.assert_array_equal(of.covariance_of("W"), of.covariance[6:12, 6:12])
    with pytest.raises(uq.InputError, match="out of X, W"):
        of.block("V")
    F = np.ones((2, 3, N))
    np.testing.assert_allclose(of.predict(F, np.eye(3)), F @ of.covariance @ F.mT + np.eye(3))
    with pytest.raises(uq.InputError, match="functions"):
        of.predict(np.ones((3, 4)))


def test_a_calibration_has_it_and_states_the_same_covariance():
    poses = uq.simulate(n_poses=20, noise=uq.PoseNoise.isotropic(camera=("1mrad", "0.5mm")), seed=3)
    result = uq.calibrate(poses)
    of = result.posterior
    np.testing.assert_allclose(of.covariance[:6, :6], result.covariance, rtol=1e-6, atol=1e-18)
    np.testing.assert_allclose(of.covariance[6:12, 6:12], result.covariance_W, rtol=1e-6, atol=1e-18)
    whole = of.points.weights @ (
        of.points.covariances + of.points.means[:, :, None] * of.points.means[:, None]
    ).reshape(len(of.points.weights), -1)
    whole = whole.reshape(len(of.covariance), -1)
    assert np.abs(whole[12:, 12:] - np.eye(len(whole) - 12)).max() < 1e-6
    assert np.abs(whole - np.eye(len(whole))).max() < 0.2
