"""Errors that pass on from pose to pose: what their process is, and time and memory in proportion to n."""

import tracemalloc

import numpy as np
import pytest
from support import assert_same_covariance, random_covariance

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.likelihood.gauss_helmert import efficient
from uq_handeye.likelihood.robust import pose_distances
from uq_handeye.noise.joint_covariance import JointCovariance
from uq_handeye.noise.serial_errors import SerialErrors
from uq_handeye.noise.square_roots import cholesky_of, inverse_blocks, log_determinant, pulled, weighted, whiten

EYE = np.eye(6)


def errors(rng, n, length=4.0, lead=()):
    time = rng.permutation(np.cumsum(rng.uniform(0.2, 2.0, n)))
    return SerialErrors(time, rng.normal(size=(*lead, n, 6, 6)), random_covariance(rng, sd=1.0), length)


def covariance_of(serial):
    """Return the covariance by its definition, block by block."""
    correlation = np.exp(-np.abs(serial.time[:, None] - serial.time) / serial.length)
    H, P = serial.by_state, serial.state
    whole = np.einsum("...iab,ij,bc,...jdc->...iajd", H, correlation, P, H)
    return whole.reshape(*H.shape[:-3], 6 * serial.n, 6 * serial.n)


@pytest.mark.parametrize("lead", [(), (3,), (2, 2)])
@pytest.mark.parametrize("length", [0.05, 4.0, 1e4])
def test_square_root_and_products_are_those_of_the_array(rng, lead, length):
    n = 7
    serial, own = errors(rng, n, length, lead), random_covariance(rng, shape=(*lead, n), sd=1.0)
    S = JointCovariance(own, np.zeros((n, 6, 0)), serial=serial)
    whole = covariance_of(serial)
    values = rng.normal(size=(n, 6, 5))
    flat = values.reshape(6 * n, 5)
    np.testing.assert_allclose(serial.times(flat), whole @ flat, atol=1e-12 * np.abs(whole).max() * n)
    np.testing.assert_allclose(np.asarray(JointCovariance(0 * own, S.shared, serial=serial)), whole, atol=1e-12)
    whole = np.asarray(S)
    L = cholesky_of(S)
    solved = np.linalg.solve(whole, np.broadcast_to(flat, (*lead, 6 * n, 5)))
    scale = np.abs(solved).max()
    np.testing.assert_allclose(
        pulled(L, whiten(L, values)).reshape(*lead, 6 * n, 5), solved, atol=1e-9 * scale
    )  # fmt: skip
    np.testing.assert_allclose(log_determinant(L), np.linalg.slogdet(whole)[1], atol=1e-9)
    blocks = np.linalg.inv(whole).reshape(*lead, n, 6, n, 6)
    expected = np.moveaxis(blocks[..., np.arange(n), :, np.arange(n), :], 0, -3)
    np.testing.assert_allclose(inverse_blocks(L), expected, atol=1e-9 * np.abs(expected).max())


def test_a_row_is_whitened_by_those_before_it_alone(rng):
    """Whitened rows are in the order of time: what comes later cannot change what came before."""
    n = 6
    serial = errors(rng, n)
    L = cholesky_of(JointCovariance(np.tile(EYE, (n, 1, 1)), np.zeros((n, 6, 0)), serial=serial))
    values = rng.normal(size=(n, 6, 1))
    changed = np.array(values)
    last = serial.order[-1]
    changed[last] += 1.0
    one, other = whiten(L, values), whiten(L, changed)
    others = np.arange(n) != last
    np.testing.assert_array_equal(one[others], other[others])
    assert np.abs(one[last] - other[last]).max() > 0.1


def test_draws_have_the_covariance_and_a_long_process_is_a_random_walk(rng):
    serial = errors(rng, 4)
    drawn = serial.draw((60_000,), rng).reshape(-1, 24)
    assert_same_covariance(np.cov(drawn.T), covariance_of(serial), 0.06)
    n = 40
    walk = SerialErrors(np.arange(float(n)), np.tile(EYE, (n, 1, 1)), EYE, 1e3 * n)
    steps = np.diff(walk.draw((2000,), rng), axis=-2)
    expected = 2.0 / walk.length
    np.testing.assert_allclose(steps.var(), expected, rtol=0.02)
    assert abs(np.mean(steps[:, 1:] * steps[:, :-1])) < 0.02 * expected


def test_a_pose_of_no_weight_is_left_out_and_keeps_its_neighbours_correlated(rng):
    n = 20
    poses = uq.simulate(n, seed=2, noise=uq.PoseNoise.isotropic(camera=("1mrad", "1mm")))
    H = np.tile(EYE, (n, 1, 1))
    own = np.tile(1e-6 * EYE, (n, 1, 1))
    S = JointCovariance(own, np.zeros((n, 6, 0)), serial=SerialErrors(np.arange(20.0), H, 4e-6 * EYE, 8.0))
    w = np.ones(n)
    w[[3, 4, 11]] = 0.0
    kept = w > 0
    values = rng.normal(size=(n, 6, 3))
    L, alone = cholesky_of(weighted(S, w)), cholesky_of(S.rows(kept))
    by_all = values[kept].reshape(-1, 3).T @ pulled(L, whiten(L, values * kept[:, None, None]))[kept].reshape(-1, 3)
    by_kept = values[kept].reshape(-1, 3).T @ pulled(alone, whiten(alone, values[kept])).reshape(-1, 3)
    np.testing.assert_allclose(by_all, by_kept, rtol=1e-5, atol=1e-3)
    distances, leverage = pose_distances(efficient(poses, uq.PoseNoise(camera=S)))
    assert np.isfinite(distances).all() and abs(leverage.sum() - 1) < 1e-9


def test_files_and_refusals(rng):
    serial = errors(rng, 3)
    again = SerialErrors.from_dict(serial.to_dict())
    np.testing.assert_array_equal(again.by_state, serial.by_state)
    np.testing.assert_array_equal(again.time, serial.time)
    assert again.length == serial.length
    with pytest.raises(InputError, match=r"Expected serial errors as `time` \(n,\)"):
        SerialErrors(np.arange(4.0), serial.by_state, serial.state, 1.0)
    with pytest.raises(InputError, match="`length` above 0"):
        SerialErrors(serial.time, serial.by_state, serial.state, 0.0)
    with pytest.raises(InputError, match="Expected `serial` errors of 4 poses, got those of 3"):
        JointCovariance(np.zeros((4, 6, 6)), np.zeros((4, 6, 0)), serial=serial)
    S = JointCovariance(np.zeros((3, 6, 6)), np.zeros((3, 6, 0)), serial=serial)
    with pytest.raises(InputError, match="serial errors on one side"):
        S.plus(S)


def test_ten_thousand_poses_take_little_memory():
    n = 10_000
    poses = uq.simulate(n, seed=2, noise=uq.PoseNoise.isotropic(camera=("1mrad", "1mm")))
    H = np.tile(EYE, (n, 1, 1))
    serial = SerialErrors(np.arange(float(n)), H, 1e-6 * EYE, 9.5)
    noise = uq.PoseNoise(camera=JointCovariance(1e-6 * H, np.zeros((n, 6, 0)), serial=serial))
    tracemalloc.start()
    efficient(poses, noise)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 400e6, "an array of (6n, 6n) would take 29 GB"
