"""Trials of every method: against an own simulator, with failures, and each trial's own covariance."""

import numpy as np
import pytest
from scipy import stats
from support import (
    CONFIDENCE,
    EQUATION_70,
    SEED,
    assert_same_covariance,
    covers,
    difference,
    draw,
    exact_motions,
    is_consistent,
    moved,
    random_covariance,
)

import uq_handeye as uq
from uq_handeye.errors import DegenerateMotionError
from uq_handeye.trials.simulation.experiment import experiment
from uq_handeye.trials.simulation.run import estimates, run

NOISE = uq.PoseNoise.isotropic(robot=("0.3mrad", "0.1mm"), camera=("1mrad", "0.5mm"))
ON_POSES = [
    "4dpa",
    "efficient",
    "ml",
    "shah",
    "li",
    "nguyen",
    *(name for name in uq.METHODS if name in ("park", "tsai")),
]


def nees(trials, covariance):
    errors = trials.errors[trials.ok]
    if covariance.ndim == 3:
        covariance = covariance[trials.ok]
    return np.einsum("ti,ti->t", errors, np.linalg.solve(covariance, errors[..., None])[..., 0])


def inside(values, k=6):
    low, high = np.array(stats.chi2.interval(CONFIDENCE, k * len(values))) / len(values)
    return low < values.mean() < high


@pytest.mark.statistical
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("method", ON_POSES)
def test_nees_on_poses(method, setup):
    poses = uq.simulate(12, noise=NOISE, setup=setup, seed=SEED)
    found = experiment(poses, NOISE, method)
    trials = run(found, np.random.default_rng(SEED), 2000)
    assert trials.ok.all() and trials.covariances is None
    values = nees(trials, found.predicted())
    assert inside(values)
    assert not inside(values / 1.15**2)


@pytest.mark.statistical
@pytest.mark.parametrize("method", ["4dpa", "efficient", "ml", "park", "nguyen"])
def test_nees_on_motions(method):
    rng = np.random.default_rng(SEED)
    _, A, B = exact_motions(rng, 30)
    noise = uq.PairNoise(A=random_covariance(rng), B=random_covariance(rng))
    data = uq.Motions(moved(A, draw(rng, noise.A, (30,))), moved(B, draw(rng, noise.B, (30,))))
    found = experiment(data, noise, method)
    values = nees(run(found, np.random.default_rng(SEED), 2000), found.predicted())
    assert inside(values)
    assert not inside(values / 1.15**2)


def floor_and(rng, shape=()):
    """Not nearly singular: beside an exact side the residuals have the noise of one side alone."""
    return 1e-8 * np.eye(6) + random_covariance(rng, 6, shape)


@pytest.mark.statistical
@pytest.mark.parametrize("shapes", [((), ()), ((20,), (20,)), (None, ())], ids=["common", "per pair", "exact A"])
def test_covariance_of_each_trial_on_motions_is_true(shapes, rng):
    """NEES and coverage by each trial's own covariance; sampling covariance at the bound; 10 % more is rejected."""
    trials = 6000
    X, A, B = exact_motions(rng, 20)
    noise = uq.PairNoise(*(None if shape is None else floor_and(rng, shape) for shape in shapes))
    found = run(experiment(uq.Motions(A, B), noise, "efficient"), rng, trials, each=True)
    errors, covariances = found.errors, found.covariances
    assert found.ok.all() and is_consistent(errors, covariances) and all(covers(errors, covariances))
    assert not is_consistent(errors, 1.1 * covariances) and not is_consistent(errors, covariances / 1.1)
    # relative deviation of the extreme eigenvalues of a Wishart matrix: 2 sqrt(6 / trials), and then some
    at_truth = uq.bound(uq.Motions(A, B), noise, X)
    assert_same_covariance(errors.T @ errors / trials, at_truth, 4 * np.sqrt(6 / trials))


@pytest.mark.statistical
def test_equation_70(rng):
    """The noise of the paper, 60 pairs."""
    _, A, B = exact_motions(rng, 60)
    problem = experiment(uq.Motions(A, B), uq.PairNoise(*EQUATION_70), "efficient")
    found = run(problem, rng, 1500, each=True)
    assert found.ok.all() and is_consistent(found.errors, found.covariances)


@pytest.mark.statistical
@pytest.mark.parametrize("method", ["4dpa", "efficient", "ml", "shah"])
def test_errors_are_those_of_an_own_simulator(method):
    """Two-sample test of the NEES, and of the covariance, against `calibrate`-like calls on draws made here."""
    rng = np.random.default_rng(SEED)
    joint = uq.PoseNoise(robot=NOISE.robot, camera=random_covariance(rng, 6 * 10, sd=1e-3))
    poses = uq.simulate(10, noise=joint, seed=SEED)
    found = experiment(poses, joint, method)
    T = 1500
    ours = run(found, np.random.default_rng(SEED), T)
    robot = moved(poses.truth.robot, draw(rng, joint.robot, (T, 10)))
    camera = moved(poses.truth.camera, draw(rng, joint.camera, (T,)).reshape(T, 10, 6))
    batch = uq.PosePairs(robot, camera)
    if method == "4dpa":
        motions = uq.relative_motions(batch, "all")
        X = uq.solve(motions.A, motions.B)
    elif method == "shah":
        X = uq.ROBOT_WORLD_METHODS["shah"](batch).X
    else:
        X = (uq.efficient if method == "efficient" else uq.maximum_likelihood)(batch, joint).X
    theirs = difference(X, poses.truth.X)
    predicted = found.predicted()
    d2 = np.einsum("ti,ij,tj->t", theirs, np.linalg.inv(predicted), theirs)
    assert stats.ks_2samp(nees(ours, predicted), d2).pvalue > 1 - CONFIDENCE
    assert stats.ks_2samp(1.15**2 * nees(ours, predicted), d2).pvalue < 1 - CONFIDENCE


@pytest.mark.statistical
@pytest.mark.parametrize("method", ["4dpa", "efficient", "park", "shah"])
def test_each_trial_with_the_covariance_that_calibrate_gives(method):
    poses = uq.simulate(10, noise=NOISE, seed=SEED)
    found = experiment(poses, NOISE, method)
    rng = np.random.default_rng(SEED)
    robot = moved(poses.truth.robot, draw(rng, NOISE.robot, (3, 10)))
    camera = moved(poses.truth.camera, draw(rng, NOISE.camera, (3, 10)))
    each = estimates(found, robot, camera, each=True)
    for k in range(3):
        result = uq.calibrate(uq.PosePairs(robot[k], camera[k]), noise=NOISE, method=method)
        np.testing.assert_allclose(each.X[k], result.X, atol=1e-11)
        np.testing.assert_allclose(each.covariances[k], result.covariance, rtol=1e-6, atol=1e-15)
    count = 200 if method == "shah" else 600  # whose covariance takes longest
    trials = run(found, np.random.default_rng(SEED), count, each=True)
    assert inside(nees(trials, trials.covariances))
    assert not inside(nees(trials, 1.2**2 * trials.covariances))
    assert not inside(nees(trials, trials.covariances / 1.2**2))


def test_a_bad_trial_fails_alone():
    poses = uq.simulate(8, noise=NOISE, seed=SEED)
    found = experiment(poses, NOISE, "park")
    rng = np.random.default_rng(SEED)
    robot = moved(poses.truth.robot, draw(rng, NOISE.robot, (9, 8)))
    camera = moved(poses.truth.camera, draw(rng, NOISE.camera, (9, 8)))
    robot[5], camera[5] = robot[5, :1], camera[5, :1]  # no motion at all
    result = estimates(found, robot, camera, each=True)
    assert result.ok.tolist() == [k != 5 for k in range(9)]
    assert np.isfinite(result.X).all() and np.isfinite(result.covariances).all()
    alone = estimates(found, robot[:5], camera[:5], each=True)
    np.testing.assert_allclose(result.X[:5], alone.X, atol=1e-14)


def test_what_no_draw_can_solve_raises():
    """Motions about one axis: it is the problem, not the draw, and the reason is said."""
    truth = uq.simulate(8, tilt=0, roll="60deg", seed=SEED).truth
    poses = uq.PosePairs(truth.robot, truth.camera, truth=truth)
    with pytest.raises(DegenerateMotionError, match="leave a part of X open"):
        run(experiment(poses, uq.PoseNoise(camera=1e-30 * np.eye(6)), "park"), np.random.default_rng(0), 4)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["4dpa", "efficient", "nguyen"])
def test_same_generator_same_numbers(method):
    poses = uq.simulate(8, noise=NOISE, seed=SEED)
    found = experiment(poses, NOISE, method)
    one, other = (run(found, np.random.default_rng(3), 300) for _ in range(2))
    np.testing.assert_array_equal(one.errors, other.errors)
