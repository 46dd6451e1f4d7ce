"""Errors of arms as columns: gauge, unit, order of the rows, few poses; named arms and their elbow."""

import time

import numpy as np
import pytest

from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.model.kinematics.known_arms import known_arm
from uq_handeye.model.shared_errors import population
from uq_handeye.model.shared_errors.population import (
    ARMS,
    BoundPopulation,
    gauge_columns,
    truncated,
)

N_POSTURES = 400  # the default of `ArmPopulation.of`


def poses_of(name, n, seed=0):
    arm, rng = known_arm(name), np.random.default_rng(seed)
    q = arm.usual.mean(axis=1) + rng.uniform(-0.5, 0.5, (n, len(arm.usual)))
    return Kinematics.from_name(name).poses(q), q


def moments(K):
    flat = K.reshape(-1, K.shape[-1])
    return flat @ flat.T


def workspace_of(known):
    """Columns (A, c, 6, n) over the workspace by which they were made, and the gauge's."""
    q = known.stack.workspace(N_POSTURES)
    frames = known.stack.frames(q)
    B = gauge_columns(frames.tip)
    F = np.concatenate([known.stack.columns(q, frames), B], axis=1)
    K = (known.mixing @ F.reshape(len(F), F.shape[1], -1)).reshape(len(F), -1, *F.shape[2:])
    return K, B


def test_constant_base_and_flange_are_annihilated_over_the_workspace():
    K, B = workspace_of(population.population())
    weight = np.repeat([0.3, 1.0], 3)[:, None]
    A = len(K)
    K, B = ((x * weight).reshape(A, x.shape[1], -1) for x in (K, B))
    inside = np.linalg.norm(B @ K.mT, axis=(1, 2)) / (np.linalg.norm(B, axis=(1, 2)) * np.linalg.norm(K, axis=(1, 2)))
    assert inside.max() < 1e-12


@pytest.mark.slow
def test_the_unit_is_the_rms_position_error_over_the_workspace():
    known = population.population()
    K, _ = workspace_of(known)
    rms = np.sqrt((K[:, :, 3:] ** 2).sum(axis=(1, 2, 3)) / N_POSTURES)
    np.testing.assert_allclose(rms, 1.0, atol=2e-3)  # what the truncation within an arm leaves out
    # Other postures, drawn errors.
    rng = np.random.default_rng(0)
    q = rng.uniform(*np.moveaxis(known.stack.limits, -1, 0)[..., None], (len(K), 7, 300))
    frames = known.stack.frames(q)
    F = np.concatenate([known.stack.columns(q, frames), gauge_columns(frames.tip)], axis=1)
    K = (known.mixing @ F.reshape(len(F), F.shape[1], -1)).reshape(len(F), -1, 6, 300)
    z = rng.normal(size=(len(K), 200, K.shape[1]))
    error = np.einsum("azc,acin->azin", z, K[:, :, 3:])
    assert 0.9 < (error**2).sum(axis=2).mean() < 1.1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["irb120", "ur5e", "panda"])
def test_errors_over_all_of_the_workspace_have_the_unit(name):
    """Poses over the whole workspace of an arm: the RMS of the mixture is near 1, whatever the scale of the poses."""
    arm = known_arm(name)
    q = np.random.default_rng(1).uniform(*arm.usual.T, (80, len(arm.usual)))
    T = Kinematics.from_name(name).poses(q)
    K = BoundPopulation.of(T).here
    assert 0.7 < np.sqrt((K[:, 3:] ** 2).sum(axis=(1, 2)).mean()) < 1.4
    doubled = T.copy()
    doubled[:, :3, 3] *= 2
    twice = BoundPopulation.of(doubled, rank=400).here
    K = BoundPopulation.of(T, rank=400).here
    error, same = moments(K)[3::6, 3::6], moments(twice)[3::6, 3::6]
    assert np.abs(error - same).max() < 0.02 * np.abs(error).max()


def test_the_order_of_the_rows_changes_nothing():
    T, _ = poses_of("kr6r900", 40)
    order = np.random.default_rng(0).permutation(40)
    K, permuted = BoundPopulation.of(T).here, BoundPopulation.of(T[order]).here
    np.testing.assert_allclose(moments(permuted), moments(K[order]), rtol=0, atol=1e-9 * np.abs(moments(K)).max())


@pytest.mark.parametrize("reach", [None, 1.3])
def test_base_and_flange_are_as_uncertain_as_their_frames(reach):
    """The last twelve columns are constant motions of base and flange, in the unit of the others, at any poses."""
    T, _ = poses_of("ur5e", 20)
    bound = BoundPopulation.of(T, reach)
    length = reach or np.linalg.norm(T[:, :3, 3], axis=1).max()
    moments = population.population().frames[bound.kept].mean(axis=0)
    np.testing.assert_allclose(bound.frames @ bound.frames.T * np.outer(*[np.tile([length] * 3 + [1.0] * 3, 2)] * 2),
                               moments, rtol=1e-6, atol=1e-9 * moments.max())  # fmt: skip
    other, _ = poses_of("ur5e", 5, seed=1)
    for at, K in ((T, bound.here), (other, bound.columns(other))):
        tip = at[None, :, :3].transpose(0, 2, 3, 1)
        B = gauge_columns(tip)[0].transpose(2, 1, 0)  # (n, 6, 12)
        np.testing.assert_allclose(K[..., -12:], B @ bound.frames, atol=1e-12)


@pytest.mark.parametrize("n", [1, 3, 8, 150])
def test_any_number_of_poses(n):
    T, _ = poses_of("irb120", n)
    K = BoundPopulation.of(T).here
    assert K.shape[:2] == (n, 6) and 1 <= K.shape[2] <= min(6 * n, 32) + 12 and np.isfinite(K).all()


def test_poses_that_no_arm_reaches_have_columns():
    T = np.tile(np.eye(4), (10, 1, 1))
    T[:, :3, 3] = 1e-3 * np.random.default_rng(0).normal(size=(10, 3))
    assert np.isfinite(BoundPopulation.of(T).here).all()
    T[:, :3, 3] = 0.0
    assert np.isfinite(BoundPopulation.of(T).here).all()


def test_some_arms_can_be_left_out():
    T, _ = poses_of("ur5e", 20)
    without = BoundPopulation.of(T, arms=tuple(name for name in ARMS if name != "ur5e")).here
    assert np.abs(moments(without) - moments(BoundPopulation.of(T).here)).max() > 1e-3


def test_a_truncation_keeps_the_second_moment():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(300, 400)) * np.exp(-0.1 * np.arange(400))
    rows = rows @ np.linalg.qr(rng.normal(size=(400, 400)))[0]
    sketch = rng.normal(size=(300, 72))
    U, energy = truncated(rows, sketch, 60)
    kept = U * np.sqrt(energy)
    assert kept.shape[1] < 60
    assert (rows**2).sum() - (kept**2).sum() < 1.1e-3 * (rows**2).sum()
    np.testing.assert_allclose(kept @ kept.T, rows @ rows.T, atol=2e-3 * np.linalg.norm(rows, 2) ** 2)


def test_a_truncation_does_not_depend_on_the_basis_of_the_columns():
    """The eigenvectors of an arm's errors have signs of rounding: other ones on another processor."""
    rng = np.random.default_rng(0)
    rows, sketch = rng.normal(size=(90, 120)) * 0.95 ** np.arange(120), rng.normal(size=(90, 44))
    turned = rows @ np.linalg.qr(rng.normal(size=(120, 120)))[0]
    one, other = (U * np.sqrt(energy) for U, energy in (truncated(of, sketch, 32) for of in (rows, turned)))
    np.testing.assert_allclose(one @ one.T, other @ other.T, atol=1e-10 * np.linalg.norm(rows, 2) ** 2)


def test_time(capsys):
    T, _ = poses_of("irb120", 60)
    BoundPopulation.of(T)
    start = time.process_time()
    for _ in range(5):
        BoundPopulation.of(T)
    with capsys.disabled():
        print(f"\npopulation at 60 poses: {200 * (time.process_time() - start):.0f} ms CPU")
