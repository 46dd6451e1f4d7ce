"""Errors of arms as columns: gauge, unit, order of the rows, few poses; named arms and their elbow."""

import time

import numpy as np
import pytest

from uq_handeye.errors import InputError
from uq_handeye.kinematics.arms.known_arms import known_arm
from uq_handeye.kinematics.chain import Kinematics
from uq_handeye.kinematics.gravity import spread_postures
from uq_handeye.shared_errors import population
from uq_handeye.shared_errors.population import ARMS, gauge_columns, population_columns, truncated


def poses_of(name, n, seed=0):
    arm, rng = known_arm(name), np.random.default_rng(seed)
    q = arm.usual.mean(axis=1) + rng.uniform(-0.5, 0.5, (n, len(arm.usual)))
    return Kinematics.from_name(name).poses(q), q


def moments(K):
    flat = K.reshape(-1, K.shape[-1])
    return flat @ flat.T


def workspace_of(known):
    """Columns (A, c, 6, n) over the workspace by which they were made, and the gauge's."""
    q = known.stack.workspace(population.WORKSPACE)
    frames = known.stack.frames(q)
    B = gauge_columns(frames.tip)
    F = np.concatenate([known.stack.columns(q, frames), B], axis=1)
    return (known.mixing @ F.reshape(len(F), F.shape[1], -1)).reshape(len(F), -1, *F.shape[2:]), B


def test_constant_base_and_flange_are_annihilated_over_the_workspace():
    K, B = workspace_of(population.population())
    weight = np.repeat([population.LEVER, 1.0], 3)[:, None]
    A = len(K)
    K, B = ((x * weight).reshape(A, x.shape[1], -1) for x in (K, B))
    inside = np.linalg.norm(B @ K.mT, axis=(1, 2)) / (np.linalg.norm(B, axis=(1, 2)) * np.linalg.norm(K, axis=(1, 2)))
    assert inside.max() < 1e-12


def test_the_unit_is_the_rms_position_error_over_the_workspace():
    known = population.population()
    K, _ = workspace_of(known)
    rms = np.sqrt((K[:, :, 3:] ** 2).sum(axis=(1, 2, 3)) / population.WORKSPACE)
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


@pytest.mark.parametrize("name", ["irb120", "ur5e", "panda"])
def test_errors_over_all_of_the_workspace_have_the_unit(name):
    """Poses over the whole workspace of an arm: the RMS of the mixture is near 1, whatever the scale of the poses."""
    arm = known_arm(name)
    q = np.random.default_rng(1).uniform(*arm.usual.T, (80, len(arm.usual)))
    T = Kinematics.from_name(name).poses(q)
    K = population_columns(T)
    assert 0.7 < np.sqrt((K[:, 3:] ** 2).sum(axis=(1, 2)).mean()) < 1.4
    doubled = T.copy()
    doubled[:, :3, 3] *= 2
    twice = population_columns(doubled, rank=400)
    K = population_columns(T, rank=400)
    error, same = moments(K)[3::6, 3::6], moments(twice)[3::6, 3::6]
    assert np.abs(error - same).max() < 0.02 * np.abs(error).max()


def test_the_order_of_the_rows_changes_nothing():
    T, _ = poses_of("kr6r900", 40)
    order = np.random.default_rng(0).permutation(40)
    K, permuted = population_columns(T), population_columns(T[order])
    np.testing.assert_allclose(moments(permuted), moments(K[order]), rtol=0, atol=1e-9 * np.abs(moments(K)).max())


@pytest.mark.parametrize("n", [1, 3, 8, 150])
def test_any_number_of_poses(n):
    T, _ = poses_of("irb120", n)
    K = population_columns(T)
    assert K.shape[:2] == (n, 6) and 1 <= K.shape[2] <= min(6 * n, population.RANK) and np.isfinite(K).all()


def test_poses_that_no_arm_reaches_have_columns():
    T = np.tile(np.eye(4), (10, 1, 1))
    T[:, :3, 3] = 1e-3 * np.random.default_rng(0).normal(size=(10, 3))
    assert np.isfinite(population_columns(T)).all()
    T[:, :3, 3] = 0.0
    assert np.isfinite(population_columns(T)).all()


def test_some_arms_can_be_left_out():
    T, _ = poses_of("ur5e", 20)
    without = population_columns(T, arms=tuple(name for name in ARMS if name != "ur5e"))
    assert np.abs(moments(without) - moments(population_columns(T))).max() > 1e-3


def test_a_truncation_keeps_the_second_moment():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(300, 400)) * np.exp(-0.1 * np.arange(400))
    rows = rows @ np.linalg.qr(rng.normal(size=(400, 400)))[0]
    kept = truncated(rows, 60)
    assert kept.shape[1] < 60
    assert (rows**2).sum() - (kept**2).sum() < 1.1e-3 * (rows**2).sum()
    np.testing.assert_allclose(kept @ kept.T, rows @ rows.T, atol=2e-3 * np.linalg.norm(rows, 2) ** 2)


def test_an_arm_outside_the_population_is_covered():
    """Errors of an arm whose family is left out lie in the columns as their size says: mean d^2 of coverage tests."""
    T, q = poses_of("hc10", 30)
    K = population_columns(T)
    chain = Kinematics.from_name("hc10")
    own = np.concatenate([block.F * size for block, size in zip(arm_columns(chain, q), SIZES, strict=True)], axis=2)
    rms = np.sqrt(
        sum(((block.rms * size) ** 2).sum() for block, size in zip(arm_columns(chain, q), SIZES, strict=True))
    )
    own = own / rms * 0.6e-3
    weight = np.tile([1 / 0.2e-3] * 3 + [1 / 0.2e-3] * 3, 30)[:, None]
    S = (0.6e-3 * weight * K.reshape(180, -1)) @ (0.6e-3 * weight * K.reshape(180, -1)).T + np.eye(180)
    true = (weight * own.reshape(180, -1)) @ (weight * own.reshape(180, -1)).T + np.eye(180)
    assert 0.7 < np.trace(np.linalg.solve(S, true)) / 180 < 1.5


SIZES = (0.6e-3, 0.3e-3, 0.25e-3, 0.12e-3, 0.3e-3)


# Named arms


@pytest.mark.parametrize("name", ["irb120", "ur5e", "panda"])
def test_columns_of_a_named_arm_have_no_base_and_flange_over_the_workspace(name):
    chain = Kinematics.from_name(name)
    q = spread_postures(chain.limits, np.ones(chain.n_joints, dtype=bool), population.WORKSPACE)
    blocks = arm_columns(chain, q)
    F = np.concatenate([block.F for block in blocks], axis=2)
    tip = np.moveaxis(chain.poses(q)[:, :3], 0, -1)[None]
    B = np.moveaxis(gauge_columns(tip)[0], (0, 2), (2, 0))
    weight = np.repeat([population.LEVER, 1.0], 3)[:, None]
    F, B = ((x * weight).reshape(-1, x.shape[-1]) for x in (F, B))
    assert np.linalg.norm(B.T @ F) < 1e-10 * np.linalg.norm(B) * np.linalg.norm(F)
    rms = np.sqrt((F.reshape(-1, 6, F.shape[1])[:, 3:] ** 2).sum(axis=(0, 1)) / len(q))
    np.testing.assert_allclose(np.concatenate([block.rms for block in blocks]), rms, rtol=1e-9)
    # All of the first joint's geometry, and offset and axial length of the last, are base and flange.
    names = [name for block in blocks for name in block.names]
    gauge = [error.name for error in chain.errors if error.gauge]
    assert not set(names) & set(gauge)
    # Also gone: sag of the first and last joint, and of the second what commutes with the first.
    assert len(names) == len(chain.errors) - len(gauge) - 4


def test_the_gauge_moves_only_base_and_flange():
    chain = Kinematics.from_name("ur5e")
    _, q = poses_of("ur5e", 30)
    free, plain = arm_columns(chain, q), arm_columns(chain, q, "none")
    tip = np.moveaxis(chain.poses(q)[:, :3], 0, -1)[None]
    B = np.moveaxis(gauge_columns(tip)[0], (0, 2), (2, 0)).reshape(-1, 12)
    for one, other in zip(free, plain, strict=True):
        index = [other.names.index(name) for name in one.names]
        difference = (one.F - other.F[..., index]).reshape(180, -1)
        left = difference - B @ np.linalg.lstsq(B, difference, rcond=None)[0]
        assert np.abs(left).max() < 1e-9


@pytest.mark.parametrize("name", ["panda", "iiwa7", "gen3", "xarm7"])
def test_the_elbow_moves_and_the_tip_stays(name):
    chain = Kinematics.from_name(name)
    T, q = poses_of(name, 20)
    v = null_directions(chain, q)
    assert np.abs(chain.jacobian(q) @ v[..., None]).max() < 1e-12
    moved = elbow_postures(chain, q, 0.3)
    np.testing.assert_allclose(chain.poses(moved), T, atol=1e-6)
    size = np.linalg.norm(moved - q, axis=1)
    assert np.median(size) == pytest.approx(0.3, rel=0.1)


def test_an_unknown_elbow_adds_to_the_columns():
    chain = Kinematics.from_name("panda")
    _, q = poses_of("panda", 15)
    known, unknown = arm_columns(chain, q), arm_columns(chain, q, elbow_sd=0.3)
    for one, other in zip(known, unknown, strict=True):
        assert one.group == other.group and len(other.names) == other.F.shape[-1] == len(other.rms)
        assert 0.5 < (other.F**2).sum() / (one.F**2).sum() < 2.0
        assert (other.rms**2).sum() == pytest.approx((one.rms**2).sum())
        # the known elbow's errors are not outside of what is said now
        S = moments(other.F) + 1e-2 * np.eye(90)
        assert np.trace(np.linalg.solve(S, moments(one.F))) / 90 < 3.0
    # As sd goes to 0, nothing is added.
    for one, other in zip(known, arm_columns(chain, q, elbow_sd=1e-6), strict=True):
        assert np.abs(moments(other.F) - moments(one.F)).max() < 5e-3 * np.abs(moments(one.F)).max()
    with pytest.raises(InputError, match="no elbow"):
        arm_columns(Kinematics.from_name("ur5e"), np.zeros((3, 6)), elbow_sd=0.1)
    with pytest.raises(InputError, match="shape"):
        arm_columns(chain, np.zeros((3, 6)))


def test_time(capsys):
    T, _ = poses_of("irb120", 60)
    population_columns(T)
    start = time.process_time()
    for _ in range(5):
        population_columns(T)
    with capsys.disabled():
        print(f"\npopulation_columns of 60 poses: {200 * (time.process_time() - start):.0f} ms CPU")
