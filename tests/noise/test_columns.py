"""Columns that are made from their factors some rows at a time are those of the arrays."""

from __future__ import annotations

import tracemalloc
import warnings

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.model.errors.columns import (
    MANY_POSES,
    Columns,
    Products,
    against,
    carried_sum,
    second_moment,
    squares,
    times,
)
from uq_handeye.model.errors.joint_covariance import JointCovariance

N = MANY_POSES + 50


@pytest.fixture
def both(rng):
    """Columns of two sides with everything that can happen to them, and the same as an array."""
    G, P = rng.normal(size=(N, 6, 5)), Products(rng.normal(size=(N, 3)), rng.normal(size=(N, 6, 2)))
    scale, M, H = rng.normal(size=11), rng.normal(size=(11, 4)), rng.normal(size=(N, 6, 2))
    D_R, D_C, L = rng.normal(size=(3, N, 6, 6))
    F = Columns.of([G, P], scale).turned(M).carried(D_R).beside(Columns.of([H]).scaled(2.0).carried(D_C)).carried(L)
    products = np.stack([P.coordinates[:, j, None, None] * P.blocks for j in range(3)], axis=2).reshape(N, 6, 6)
    of_robot = D_R @ (np.concatenate([G, products], axis=-1) * scale @ M)
    return F, L @ np.concatenate([of_robot, D_C @ (2.0 * H)], axis=-1)


def test_rows_and_products_are_those_of_the_array(both, rng):
    F, whole = both
    M, values, D = rng.normal(size=(6, 3)), rng.normal(size=(N, 6, 2)), rng.normal(size=(N, 6, 6))
    some, numbers = np.arange(0, N, 7), np.array([1, 3, 5])
    for found, expected in (
        (F.array(), whole),
        (F.rows(some), whole[some]),
        (F.kept(some).array(), whole[some]),
        (F.some(numbers).array(), whole[..., numbers]),
        (times(F, M), whole @ M),
        (times(F, M[:, 0]), whole @ M[:, 0]),
        (against(F, values), against(whole, values)),
        (squares(F, M), squares(whole, M)),
        (second_moment(F), second_moment(whole)),
        (carried_sum(D, F), carried_sum(D, whole)),
    ):
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_a_covariance_of_many_poses_whitens_as_that_of_arrays(both, rng):
    F, whole = both
    A = rng.normal(size=(N, 6, 6))
    own, values = A @ A.mT + np.eye(6), rng.normal(size=(N, 6, 2))
    S, T = JointCovariance(own, F), JointCovariance(own, whole)
    for found, expected in (
        (S.factor.whiten(values), T.factor.whiten(values)),
        (S.factor.pull(values), T.factor.pull(values)),
        (S.factor.inverse_blocks(), T.factor.inverse_blocks()),
        (S.factor.log_determinant(), T.factor.log_determinant()),
        (S @ values.reshape(6 * N, 2), T @ values.reshape(6 * N, 2)),
        (S.weighted(np.full(N, 2.0)).blocks, T.weighted(np.full(N, 2.0)).blocks),
        ((4.0 * S.rows(np.arange(0, N, 2))).shared, 2.0 * whole[::2]),
    ):
        assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_many_poses_are_whitened_in_place(both, rng):
    """The values over the blocks, and no further array of all poses beside them; those given stay as they are."""
    factor = JointCovariance(np.tile(np.eye(6), (N, 1, 1)), both[0]).factor
    values = rng.normal(size=(N, 6, 40))
    before = values.copy()
    for whitened in (factor.whiten, factor.pull):
        tracemalloc.start()
        whitened(values)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 2.6 * values.nbytes  # 3.5 where two more are made at once
        np.testing.assert_array_equal(values, before)


def test_the_columns_of_one_error_do_not_keep_those_of_others():
    poses = uq.simulate(n_poses=30, seed=1)
    columns = uq.SharedError.focal_length().bound(poses).factor_at(poses)
    assert columns.shape == (30, 6, 1) and columns.base is None


@pytest.mark.slow
def test_columns_of_many_poses_are_not_held_in_every_form():
    """173 columns of 6,000 poses take 50 MB; the measured and corrected poses, S and its factors would hold twenty."""
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    drawn = uq.simulate(n_poses=6_000, noise=noise, seed=1)
    poses = uq.PosePairs(drawn.robot, drawn.camera, drawn.setup, timestamps=np.arange(6_000.0))
    tracemalloc.start()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        uq.calibrate(poses)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 600e6
