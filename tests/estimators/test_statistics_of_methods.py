"""Do the covariances of all methods tell the truth? Each against its own Monte Carlo, at small noise.

Judged as in `tests/propagation/test_statistics.py`; the covariance is the one predicted at the data without noise. It
must be rejected when it is 10 % off in standard deviation, and so must pairs taken as independent that share poses.
"""

import functools
from itertools import product

import numpy as np
import pytest
from support import SEED, difference, draw, exact_motions, is_consistent, moved, random_covariance

import uq_handeye as uq
from uq_handeye.methods.noise_transport import noise_of_pairs

pytestmark = pytest.mark.statistical

FAST = [name for name, method in uq.METHODS.items() if name not in ("heller", "zhao")]
SETUPS = ("eye-in-hand", "eye-to-hand")


def trials_of(name):
    return 2000 if name in FAST else 300


@functools.cache
def pairs():
    rng = np.random.default_rng([SEED, 60])
    X, A, B = exact_motions(rng, 60)
    noise = uq.PairNoise(random_covariance(rng, sd=3e-4), random_covariance(rng, sd=3e-4))
    a, b = (moved(T, draw(rng, S, (2000, 60))) for T, S in ((A, noise.A), (B, noise.B)))
    return X, A, B, a, b, noise


@functools.cache
def poses(setup):
    noise = uq.PoseNoise.isotropic(robot=("0.1mrad", "0.1mm"), camera=("0.4mrad", "0.4mm"))
    drawn = uq.simulate(15, noise=noise, setup=setup, trials=2000, seed=SEED % 1000)
    exact = uq.relative_motions(uq.PosePairs(drawn.truth.robot, drawn.truth.camera, setup), "all")
    return drawn.truth.X, exact, uq.relative_motions(drawn, "all"), noise


def judge(errors, covariance):
    assert is_consistent(errors, covariance)
    assert not is_consistent(errors, 1.2**2 * covariance) and not is_consistent(errors, covariance / 1.2**2)


def requires(name):
    if name == "heller":
        pytest.importorskip("cvxpy")
    return uq.METHODS[name]


@pytest.mark.parametrize("name", uq.METHODS)
def test_noise_on_pairs(name):
    method = requires(name)
    X, A, B, a, b, noise = pairs()
    count = trials_of(name)
    estimate = method.estimate(a[:count], b[:count], noise if method.weighted else None)
    assert estimate.converged.all()
    judge(difference(estimate.X, X), uq.propagate(A, B, noise, method=name))


@pytest.mark.parametrize(  # zhao takes long, and its pairs are alike: those of inverse robot poses
    ("name", "setup"), [case for case in product(uq.METHODS, SETUPS) if case != ("zhao", "eye-to-hand")]
)
def test_noise_on_poses_all_pairs(name, setup):
    method = requires(name)
    X, exact, drawn, noise = poses(setup)
    count = trials_of(name)
    weights = noise_of_pairs(exact, noise) if method.weighted else None
    estimate = method.estimate(drawn.A[:count], drawn.B[:count], weights)
    assert estimate.converged.all()
    errors = difference(estimate.X, X)
    judge(errors, uq.propagate(exact, noise, method=name))
    assert not is_consistent(errors, uq.propagate(exact, noise, method=name, kind="pairs"))
