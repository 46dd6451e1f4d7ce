"""Directions that motions about one axis, or about none, leave open: named, and the rest with a covariance that is
right.
"""

import numpy as np
import pytest
from fixtures.few_axes import CLOSED, COUNT, KINDS, NOISE, rig, squared
from numpy.testing import assert_allclose
from scipy import stats
from support import SEED, difference, moved, rotation_vectors, rotations, transforms

import uq_handeye as uq
from uq_handeye.fit.graph.gauss_helmert import efficient, maximum_likelihood
from uq_handeye.fit.graph.open_directions import rig_units

SETUPS = ("eye-in-hand", "eye-to-hand")


def mean_is(squares, dof, factor=1.0):
    """Return whether the mean of chi-square variables, times a factor, can be that of ``dof`` (99.9 %)."""
    m = len(squares)
    low, high = stats.chi2.ppf([0.0005, 0.9995], m * dof) / m
    return low < factor * np.mean(squares) < high


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "setup"),
    [("scara", "eye-in-hand"), ("scara", "eye-to-hand"), ("vehicle", "eye-in-hand"), ("gantry", "eye-to-hand")],
)
def test_the_covariance_of_the_rest_is_right_and_no_other(kind, setup):
    rng = np.random.default_rng([SEED, 14])
    squares = []
    for _ in range(100):
        data = rig(kind, 15, rng, setup)
        found = efficient(data, NOISE)
        assert len(found.open_directions) == COUNT[kind]
        squares.append(squared(found, data.truth, CLOSED[kind]))
    dof = len(CLOSED[kind])
    assert mean_is(squares, dof)
    assert not mean_is(squares, dof, 1.5)
    assert not mean_is(squares, dof, 1 / 1.5)


@pytest.mark.slow
@pytest.mark.parametrize("method", [efficient, maximum_likelihood])
@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("kind", KINDS)
def test_the_basis_is_what_does_not_change_the_residuals(kind, setup, method):
    """A reference of its own: moving X and W along the basis leaves exact poses of the kind closed."""
    rng = np.random.default_rng([SEED, 15])
    data = rig(kind, 20, rng, setup)
    found = method(data, NOISE)
    basis = found.open_directions
    assert basis.shape == (COUNT[kind], 12)
    U = basis * rig_units(found.lever, 12)
    assert_allclose(U @ U.T, np.eye(len(U)), atol=1e-9)
    truth = data.truth
    G = truth.robot if setup == "eye-in-hand" else np.linalg.inv(truth.robot)
    step = 1e-4
    before = G @ found.X @ truth.camera
    for u in basis:  # G X C = W to second order in the step, but for the error of the axis
        loop = G @ moved(found.X, step * u[:6]) @ truth.camera
        error = difference(loop, moved(before, np.broadcast_to(step * u[6:], (20, 6))))
        assert np.abs(error).max() < 5e-3 * step * max(1.0, 1 / float(found.lever))
    loop = G @ moved(found.X, step * np.eye(6)[0]) @ truth.camera  # a rotation about x is seen
    error = difference(loop, before)
    assert np.abs(error - error.mean(axis=0)).max() > 0.05 * step


@pytest.mark.parametrize("kind", ["scara", "gantry"])
def test_the_covariance_is_the_limit_of_a_weak_prior_on_the_rest(kind):
    """A reference of its own: a prior along the open directions changes nothing of the others."""
    data = rig(kind, 20, np.random.default_rng([SEED, 16]))
    found = efficient(data, NOISE)
    weak = np.full(6, np.inf)
    weak[[5] if kind == "scara" else [3, 4, 5]] = 1e-6
    closed = efficient(data, uq.PoseNoise(NOISE.robot, NOISE.camera, prior=uq.PosePrior.of((found.X, np.diag(weak)))))
    columns = np.ix_(CLOSED[kind], CLOSED[kind])
    assert closed.open is None
    assert_allclose(found.covariance_X[columns], closed.covariance_X[columns], rtol=2e-2, atol=1e-3 * np.diag(
        closed.covariance_X)[CLOSED[kind]].min())  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
def test_a_prior_of_a_millimetre_closes_it(setup):
    rng = np.random.default_rng([SEED, 17])
    squares = []
    for _ in range(200):
        data = rig("scara", 15, rng, setup)
        measured = data.truth.X.copy()
        measured[2, 3] += 1e-3 * rng.normal()
        prior = uq.PosePrior.of((measured, np.diag([np.inf] * 5 + [1e-6])))
        found = efficient(data, uq.PoseNoise(NOISE.robot, NOISE.camera, prior=prior))
        assert found.open is None
        squares.append(squared(found, data.truth, list(range(6))))
    assert mean_is(squares, 6)
    assert not mean_is(squares, 6, 1.5)
    assert not mean_is(squares, 6, 1 / 1.5)


@pytest.mark.slow
@pytest.mark.parametrize("noise", ["3deg", "1deg", "0.1deg"])
def test_ordinary_rigs_are_not_open(noise):
    """Few poses and large noise do not make a robot that turns about many axes look like one that cannot."""
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=(noise, "5mm"))
    for seed in range(30):
        assert efficient(uq.simulate(n_poses=5 + seed % 6, noise=noise, seed=seed), noise).open is None


def test_axes_that_differ_by_20_degrees_determine_all(rng):
    n = 12
    axis = np.where(np.arange(n)[:, None] % 2, [[0.0, 0.0, 1.0]], [[np.sin(0.35), 0.0, np.cos(0.35)]])
    X, W = (transforms(rotations(rotation_vectors(rng, ())), 0.3 * rng.normal(size=3)) for _ in range(2))
    G = transforms(rotations(axis * rng.uniform(-1.5, 1.5, (n, 1))), 0.3 * rng.normal(size=(n, 3)))
    C = np.linalg.inv(G @ X) @ W
    data = uq.PosePairs(moved(G, 1e-4 * rng.normal(size=(n, 6))), moved(C, 1e-3 * rng.normal(size=(n, 6))))
    noise = uq.PoseNoise.isotropic(robot=(1e-4, 1e-4), camera=(1e-3, 1e-3))
    assert efficient(data, noise).open is None


def test_no_motion_at_all_is_refused():
    data = rig("gantry", 8, np.random.default_rng([SEED, 18]))
    still = uq.PosePairs(*(np.repeat(T[:1], 8, axis=0) for T in (data.robot, data.camera)))
    with pytest.raises(uq.DegenerateMotionError, match="nothing of X"):
        efficient(still, NOISE)


@pytest.mark.slow
def test_a_result_with_a_prior_is_tested_and_one_with_open_directions_is_not():
    data = rig("scara", 15, np.random.default_rng([SEED, 21]))
    with pytest.warns(uq.InputWarning, match="leave open"):
        found = uq.calibrate(data, noise=NOISE)
    for method in ("efficient", "4dpa"):
        with pytest.raises(uq.DegenerateMotionError, match="leave a part of X open") as refused:
            uq.monte_carlo(found, method=method, trials=50)
        assert_allclose(np.abs(refused.value.directions), [[0, 0, 0, 0, 0, 1]], atol=1e-6)
    with pytest.raises(uq.DegenerateMotionError, match="leave a part of X open"):
        uq.cross_check(found, trials=100, posterior=False)
    with pytest.warns(uq.InputWarning, match="nearly parallel"):
        closed = uq.calibrate(data, noise=NOISE, prior_X=(data.truth.X, np.diag([np.inf] * 5 + [1e-6])))
    tested = uq.monte_carlo(closed, method="efficient", trials=300)
    assert tested.consistent and tested.failures == 0
    with pytest.raises(uq.InputError, match="take no prior"):
        uq.cross_check(closed, trials=100, posterior=False)


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("noise", [NOISE, None])
def test_a_robot_that_keeps_its_orientation_exactly(rng, setup, noise):
    """The rounding of equal rotations was taken for a motion, and the start was light years away."""
    data = rig("gantry", 15, rng, setup)
    robot = data.robot.copy()
    robot[:, :3, :3] = robot[0, :3, :3]
    with pytest.warns(uq.InputWarning):
        found = uq.calibrate(uq.PosePairs(robot, data.camera, setup), noise=noise)
    assert found.opened is not None and len(found.opened.basis) == 3
    assert {one.severity for one in found.findings} == {"caution"}  # a length that is open is not judged
    assert squared(found, data.truth, CLOSED["gantry"]) < stats.chi2.ppf(0.9999, 3)
