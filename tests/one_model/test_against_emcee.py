"""Sizes and poses sampled together by emcee, with the density written out by dense algebra, against the engine."""

import numpy as np
import pytest
from support import SEED

import uq_handeye as uq
from studies.one_model.sampled import chain_of, density_of
from uq_handeye.fit.graph.constraint import constraint_of
from uq_handeye.fit.graph.engine import LatentModel
from uq_handeye.fit.graph.integration import integrate
from uq_handeye.fit.graph.mode import find_mode
from uq_handeye.model.errors.sizes import Size
from uq_handeye.model.errors.term import Component

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
UNIT = np.repeat([1e-3, 5e-4], 3)  # rad, m
WALKERS, STEPS = 60, 4000


def model_of(rng):
    poses = uq.simulate(7, noise=NOISE, seed=SEED)
    constraint = constraint_of(poses, None)
    linear = constraint.linearise(constraint.complete(poses.truth.X), constraint.first, constraint.second)
    columns = UNIT[:, None] * np.cos(rng.normal(size=(7, 1, 3)) + rng.normal(size=(6, 3)))
    parts = (
        Component("turn", "camera", Size(1e-3, 3.0), block=np.eye(6)[:, :3]),
        Component("shift", "camera", Size(4e-4, 3.0), block=np.eye(6)[:, 3:]),
        Component("arm", "robot", Size(0.6, 3.0), columns=columns, block=0.1 * np.diag(UNIT)),
    )
    return LatentModel.of(linear, parts), dict(zip(("robot", "camera"), linear.sides, strict=True))


@pytest.mark.slow
def test_sizes_and_poses_sampled_together_agree_with_the_mixture():
    rng = np.random.default_rng([SEED, 4])
    model, sides = model_of(rng)
    mixture = integrate(model, [find_mode(model)])
    unit = np.sqrt(np.diag(mixture.covariance))
    p, k = model.p, len(model.medians)
    first = np.concatenate([rng.normal(size=(WALKERS, p)), mixture.mean_theta + 0.3 * rng.normal(size=(WALKERS, k))], 1)
    chain, effective = chain_of(density_of(model, sides, mixture.mean, unit), first, STEPS, SEED)
    assert effective > 1500
    flat = chain.reshape(-1, p + k)
    spread = flat.std(axis=0)
    # Measured: means within 0.03, standard deviations of the mixture 5 % larger, as 32 points are few; chance is 0.03.
    assert np.abs(flat[:, :p].mean(axis=0)).max() < 0.12
    np.testing.assert_allclose(spread[:p], 1.0, atol=0.1)
    sd = np.sqrt(np.diag(mixture.covariance_theta))
    assert np.abs((flat[:, p:].mean(axis=0) - mixture.mean_theta) / sd).max() < 0.2
    np.testing.assert_allclose(spread[p:], sd, rtol=0.1)
