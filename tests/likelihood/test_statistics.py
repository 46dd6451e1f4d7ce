"""Do `efficient` and `ml` reach the bound, and is their covariance true? Monte Carlo at every row of T5's tables.

`efficient` runs on all trials. `ml` runs on an eighth of them, and what it does better or worse there is taken off the
figures of all: the two differ so little that this difference is known as well as from all.
Each judgement must also reject a wrong covariance. NEES = e^T Sigma^-1 e has the mean 6 if Sigma is true; of 4,000
trials it scatters by sqrt(12 / 4000) = 0.055, so that 5.8 to 6.2 are 3.6 deviations.
"""

import functools
from typing import NamedTuple

import numpy as np
import pytest
import support
from support import SEED, covers, difference, draw, exact_motions, exact_poses, is_consistent, moved, nees

import uq_handeye as uq
from uq_handeye.fit.graph.constraint import constraint_of
from uq_handeye.fit.graph.gauss_helmert import bound, efficient, fit, maximum_likelihood
from uq_handeye.fit.graph.starts import start_of

pytestmark = pytest.mark.statistical

TRIALS, OF_ML = 4000, 500
BLOCK = 250  # trials at a time, for the memory
NEES = 5.8, 6.2
DEVIATIONS = 0.95, 1.05  # of the bound's


def diagonal(*deviations):
    """Milliradians and millimetres."""
    return np.diag((1e-3 * np.array(deviations)) ** 2)


def both(rotation, translation):
    S = diagonal(*[rotation] * 3, *[translation] * 3)
    return uq.PairNoise(S, S)


ON_POSES = {
    "camera isotropic": uq.PoseNoise(camera=diagonal(1, 1, 1, 1, 1, 1)),
    "camera weak in depth and tilt": uq.PoseNoise(
        diagonal(0.1, 0.1, 0.1, 0.1, 0.1, 0.1), diagonal(3, 3, 0.5, 0.3, 0.3, 3)
    ),
    "robot dominates": uq.PoseNoise(diagonal(1, 1, 1, 1, 1, 1), diagonal(0.2, 0.2, 0.2, 0.2, 0.2, 0.2)),
}
ON_PAIRS = {
    "random, 1 mrad, 1 mm": both(1, 1),
    "random, 10 mrad, 0.1 mm": both(10, 0.1),
    "star, 1 mrad, 0.1 mm": both(1, 0.1),
    "star, 10 mrad, 0.1 mm": both(10, 0.1),
    "(70)": uq.PairNoise(*support.EQUATION_70),
}


class Sample(NamedTuple):
    errors: np.ndarray  # (TRIALS, p) of `efficient`, p = 6 or, with W, 12
    covariances: np.ndarray  # (TRIALS, p, p)
    ml_errors: np.ndarray  # (OF_ML, p), of the first trials
    ml_covariances: np.ndarray
    one_step: np.ndarray  # (BLOCK, 6)
    one_step_covariances: np.ndarray
    bound: np.ndarray  # (6, 6)


@functools.cache
def sample(name):
    rng = np.random.default_rng([SEED, 5, [*ON_POSES, *ON_PAIRS].index(name)])
    if name in ON_POSES:
        noise, n, setup = ON_POSES[name], 31, "eye-to-hand" if name == "robot dominates" else "eye-in-hand"
        X, *exact = exact_poses(rng, n, setup)
        W = (np.linalg.inv(exact[0]) if setup == "eye-to-hand" else exact[0])[0] @ X @ exact[1][0]
        covariances = noise.robot, noise.camera
        as_data = functools.partial(uq.PosePairs, setup=setup)
        least = bound(as_data(*exact), noise, X)
    else:
        noise, n, W = ON_PAIRS[name], 60, None
        X, *exact = exact_motions(rng, n)
        if name.startswith("star"):  # nearly a common translation
            exact[1][:, :3, 3] = [0.3, 0.0, 0.4] + 1e-2 * rng.normal(size=(n, 3))
            exact[0] = X @ exact[1] @ np.linalg.inv(X)
        covariances, as_data = (noise.A, noise.B), uq.Motions
        least = bound(uq.Motions(*exact), noise, X)

    def errors(found):
        e = difference(found.X, X)
        return e if W is None else np.concatenate([e, difference(found.W, W)], axis=-1)

    two, most, one = [], [], None
    for done in range(0, TRIALS, BLOCK):
        data = as_data(
            *(
                np.broadcast_to(T, (BLOCK, *T.shape)) if S is None else moved(T, draw(rng, S, (BLOCK, n)))
                for T, S in zip(exact, covariances, strict=True)
            )
        )
        found = efficient(data, noise)
        two.append((errors(found), found.covariance))
        if done < OF_ML:
            found = maximum_likelihood(data, noise)
            most.append((errors(found), found.covariance))
        if one is None:
            constraint = constraint_of(data, noise)
            one = fit(constraint, noise, start_of(data, constraint, None), steps=1)
    return Sample(
        *(np.concatenate(parts) for method in (two, most) for parts in zip(*method, strict=True)),
        difference(one.X, X),
        one.covariance_X,
        least,
    )


@pytest.fixture(params=[*ON_POSES, *ON_PAIRS])
def drawn(request):
    return sample(request.param)


BLOCKS = {"X": slice(0, 6), "W": slice(6, 12), "X and W": slice(0, 12)}


def blocks(drawn):
    return BLOCKS if drawn.errors.shape[1] == 12 else {"X": BLOCKS["X"]}


def mean_nees(drawn, part, scale=1.0):
    """Return the mean NEES of `efficient` and of `ml`; of X and W together, twelve numbers, as if of six."""
    distances = nees(drawn.errors[:, part], scale * drawn.covariances[:, part, part])
    better = nees(drawn.ml_errors[:, part], scale * drawn.ml_covariances[:, part, part]) - distances[:OF_ML]
    return 6 / (part.stop - part.start) * np.array([distances.mean(), distances.mean() + better.mean()])


def test_mean_nees(drawn):
    for part in blocks(drawn).values():
        found = mean_nees(drawn, part)
        assert NEES[0] < found.min() and found.max() < NEES[1], found


def test_deviations_are_those_of_the_bound(drawn):
    """Each of the six, by the scatter about the truth."""
    limit = np.sqrt(np.diag(drawn.bound))
    of_efficient, of_ml, alike = (
        np.sqrt(np.mean(e[:, :6] ** 2, axis=0)) / limit for e in (drawn.errors, drawn.ml_errors, drawn.errors[:OF_ML])
    )
    for ratio in (of_efficient, of_efficient * of_ml / alike):
        assert DEVIATIONS[0] < ratio.min() and ratio.max() < DEVIATIONS[1], ratio


def test_sampling_covariance_is_the_bound(drawn):
    """Whitened eigenvalues in every direction, not only along the axes, are within what 4,000 trials spread
    (Wishart).
    """
    eigenvalues = support.whitened_eigenvalues(np.cov(drawn.errors[:, :6].T), drawn.bound)
    spread, margin = np.sqrt(6 / TRIALS), 5 * TRIALS ** (-2 / 3) + 0.02  # and 1 % of deviation for second order
    assert (1 - spread) ** 2 - margin < eigenvalues[0]
    assert eigenvalues[-1] < (1 + spread) ** 2 + margin


def test_coverage(drawn):
    """The 50 to 99 % ellipsoids of X, of W and of both hold as many trials as they say."""
    for part in blocks(drawn).values():
        assert covers(drawn.errors[:, part], drawn.covariances[:, part, part]) == [True] * 5
        assert covers(drawn.ml_errors[:, part], drawn.ml_covariances[:, part, part]) == [True] * 5


def test_unbiased(drawn):
    """The mean error of X and W is that of chance: Hotelling, less than 5 deviations in whitened length."""
    mean = drawn.errors.mean(axis=0)
    p = len(mean)
    assert TRIALS * mean @ np.linalg.solve(drawn.covariances.mean(axis=0), mean) < p + 5 * np.sqrt(2 * p)


@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_five_percent_off_is_rejected(drawn, factor):
    """The interval that the estimate passes rejects it; 10 % off is also rejected by every ellipsoid."""
    for part in blocks(drawn).values():
        found = mean_nees(drawn, part, factor**2)
        assert not (found > NEES[0]).any() or not (found < NEES[1]).any()
        twice = drawn.covariances[:, part, part] * (2 * factor - 1) ** 2
        assert not all(covers(drawn.errors[:, part], twice))
        assert not is_consistent(drawn.errors[:, part], twice)


@pytest.mark.parametrize("name", ["random, 10 mrad, 0.1 mm", "star, 10 mrad, 0.1 mm"])
def test_one_step_is_rejected_where_rotation_noise_moves_the_lever(name):
    """Its derivatives are those of noisy data: biased, and with too small a covariance. The second step cures it."""
    drawn = sample(name)
    low, high = support.mean_interval(BLOCK)
    found = nees(drawn.one_step, drawn.one_step_covariances).mean()
    assert found > 1.1 * high
    assert low < nees(drawn.errors[:BLOCK], drawn.covariances[:BLOCK]).mean() < high


def test_one_step_is_enough_at_small_noise():
    drawn = sample("camera isotropic")
    assert is_consistent(drawn.one_step, drawn.one_step_covariances)


def test_joint_noise():
    """An error that all camera poses share beside their own (T4b): true covariance, and a false one without it."""
    rng = np.random.default_rng([SEED, 4])
    n, trials = 10, 600
    X, robot, camera = exact_poses(rng, n)
    own, shared = diagonal(0.3, 0.3, 0.3, 0.2, 0.2, 0.2), diagonal(0.1, 0.1, 0.1, 0.1, 0.1, 3)
    noise = uq.PoseNoise(diagonal(*[0.1] * 6), np.kron(np.eye(n), own) + np.kron(np.ones((n, n)), shared))
    xi = draw(rng, own, (trials, n)) + draw(rng, shared, (trials, 1))
    data = uq.PosePairs(moved(robot, draw(rng, noise.robot, (trials, n))), moved(camera, xi))
    found = efficient(data, noise)
    errors = difference(found.X, X)
    assert is_consistent(errors, found.covariance_X)
    least = np.sqrt(np.diag(bound(uq.PosePairs(robot, camera), noise, X)))
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / least
    assert ratio.min() > 0.89 and ratio.max() < 1.11  # 600 trials: 3 % each
    apart = efficient(data, uq.PoseNoise(noise.robot, own + shared))
    worse = difference(apart.X, X)
    assert not is_consistent(worse, apart.covariance_X)
    assert (np.sqrt(np.mean(worse**2, axis=0)) / least).max() > 1.15
