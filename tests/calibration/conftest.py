"""One simulated session, and what calibrate() makes of it with noise given and estimated."""

import pytest
from fixtures.rigs import NOISE, quietly
from support import SEED

import uq_handeye as uq


@pytest.fixture(scope="module")
def poses():
    return uq.simulate(20, noise=NOISE, seed=SEED)


@pytest.fixture(scope="module")
def given(poses):
    return quietly(poses, noise=NOISE)


@pytest.fixture(scope="module")
def estimated(poses):
    return quietly(poses)
