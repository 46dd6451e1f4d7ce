"""A camera or a target that moves while the poses are taken: X is stated as of any pose of the session."""

import os

import numpy as np
import pytest
from numpy.polynomial.legendre import legvander

import uq_handeye as uq
from studies.common.scores import errors
from uq_handeye.core.geometry.se3 import perturb

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "20261124"))
MOTION = "motion in the session"
pytestmark = pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")  # halves that moved differ


def walked(rng, n):
    """A random walk by steps of 0.2 mrad and 0.2 mm."""
    return 2e-4 * np.cumsum(rng.standard_normal((n, 6)), axis=0)


def crept(rng, n):
    """A smooth motion by about 1 mrad and 1 mm: a parabola in time."""
    return 1e-3 * legvander(np.linspace(-1.0, 1.0, n), 2)[:, 1:] @ rng.standard_normal((2, 6))


def session(setup, what, rng, motion=walked, noise=1.0, n=40):
    """Poses of a camera or a target that moves (rad, m), and X and W at each of them."""
    truth = uq.simulate(n, setup=setup, seed=rng).truth
    G = truth.robot if setup == "eye-in-hand" else np.linalg.inv(truth.robot)
    walk = motion(rng, n)
    X, W = (np.broadcast_to(T, (n, 4, 4)) for T in (truth.X, truth.W))
    X, W = (perturb(X, walk), W) if what == "camera" else (X, perturb(W, walk))
    seen = np.linalg.inv(G @ X) @ W
    robot = perturb(truth.robot, noise * np.repeat([3e-4, 5e-5], 3) * rng.standard_normal((n, 6)))
    camera = perturb(seen, noise * np.repeat([9e-4, 2e-4], 3) * rng.standard_normal((n, 6)))
    return uq.PosePairs(robot, camera, setup, np.arange(float(n))), X, W


def of_motion(result):
    return dict(zip(result.budget.sources, result.budget.covariances, strict=True))[MOTION]


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("what", ["camera", "target"])
def test_the_motion_stated_is_that_of_the_data(setup, what):
    """The mean square of the motion about its mean, along each axis that it has, where the noise is small; and of the
    camera alone, or of the target.
    """
    poses, X, W = session(setup, what, np.random.default_rng([SEED, 1]), crept, noise=0.02)
    stated = of_motion(uq.calibrate(poses))
    moved, at, still = (X, slice(0, 6), slice(6, 12)) if what == "camera" else (W, slice(6, 12), slice(0, 6))
    xi = errors(moved, moved[0])
    xi = xi - xi.mean(axis=0)
    true = xi.T @ xi / len(xi)
    values, axes = np.linalg.eigh(true)
    along = np.einsum("ik,ij,jk->k", axes, stated[at, at], axes)
    ratio = along[4:] / values[4:]  # six terms of a walk hold most of a parabola
    assert ratio.min() > 0.65 and ratio.max() < 1.15
    assert np.trace(stated[still, still]) < 0.01 * np.trace(true)


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_x_is_stated_for_any_pose_of_the_session(setup):
    """d^2 of X at the first, the last and the mean pose; without the motion the first and the last are far outside."""
    rng, sets = np.random.default_rng([SEED, 2, setup == "eye-to-hand"]), 24
    d2 = np.zeros((sets, 2, 3))
    for k in range(sets):
        poses, X, _ = session(setup, "camera", rng)
        result = uq.calibrate(poses)
        e = errors(X, result.X)
        e = np.array([e[0], e[-1], e.mean(axis=0)])
        for j, C in enumerate((result.covariance, result.covariance - of_motion(result)[:6, :6])):
            d2[k, j] = np.sum(e * np.linalg.solve(C, e.T).T, axis=-1)
    first, last, mean = d2[:, 0].mean(axis=0)
    assert max(first, last) < 10 and 1 < mean < 6  # 4 to 8.6 with four seeds
    assert d2[:, 1, :2].mean() > 12


@pytest.mark.slow
def test_nothing_moves_in_rows_without_a_time():
    poses, _, _ = session("eye-in-hand", "camera", np.random.default_rng([SEED, 3]))
    with pytest.warns(uq.InputWarning, match="Neighbouring residuals are correlated"):
        result = uq.calibrate(uq.PosePairs(poses.robot, poses.camera))
    assert MOTION not in result.budget.sources
    told = next(one for one in result.cautions if one.code == "diagnostics.correlated")
    assert "Add timestamps to the poses" in str(told) and told.remedy.startswith("add timestamps")
    assert "Add timestamps" in uq.Calibration.from_dict(result.to_dict()).summary(verbose=True).replace("\n", " ")
