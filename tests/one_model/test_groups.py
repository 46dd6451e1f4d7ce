"""Groups of rows of different sizes: the same numbers as one block of all rows, and as groups of one pose."""

import numpy as np
import pytest

from uq_handeye.fit.graph.engine import LatentModel, Rows
from uq_handeye.model.errors.sizes import Size
from uq_handeye.model.errors.term import Component

RNG = np.random.default_rng(4)
P, M = 12, 3
COMPONENTS = (
    Component("shared", "robot", Size(0.7, 2.0), columns=np.ones((1, 6, M))),
    Component("robot", "robot", Size(1.0, 3.0), block=np.eye(6)),
    Component("camera", "camera", Size(0.5, 4.0), block=np.eye(6)),
)


def rows(n, d):
    """Return n groups of d rows with a robot pose in common and a camera error each."""
    J, r, shared = RNG.normal(size=(n, d, P)), RNG.normal(size=(n, d)), RNG.normal(size=(n, d, M))
    B = RNG.normal(size=(n, d, 6))
    own = np.zeros((n, d, d))
    for k in range(0, d, 6):
        own[:, k : k + 6, k : k + 6] = np.eye(6)
    return Rows(J, r, shared, {1: B @ B.mT, 2: own}, None)


def whole(parts):
    """Return all groups as one block."""
    sizes = [d for part in parts for d in [part.r.shape[1]] * len(part.r)]
    total = sum(sizes)
    blocks = {1: np.zeros((1, total, total)), 2: np.zeros((1, total, total))}
    start = 0
    for part in parts:
        for k in range(len(part.r)):
            place = slice(start, start + part.r.shape[1])
            for c in blocks:
                blocks[c][0, place, place] = part.blocks[c][k]
            start = place.stop
    stacked = [np.concatenate([getattr(p, name).reshape(p.r.size, -1) for p in parts]) for name in ("J", "r", "shared")]
    return LatentModel(stacked[0][None], stacked[1][:, 0][None], COMPONENTS, stacked[2][None], blocks)


THETA = np.log([0.5, 0.8, 0.9])


def model(parts, **more):
    """Return the model of groups of several sizes."""
    first = parts[0]
    return LatentModel(first.J, first.r, COMPONENTS, first.shared, first.blocks, others=tuple(parts[1:]), **more)


@pytest.fixture(scope="module")
def parts():
    return [rows(7, 6), rows(5, 12), rows(2, 24)]


def test_groups_are_one_block_of_all_rows(parts):
    grouped, one = model(parts).at(THETA), whole(parts).at(THETA)
    assert grouped.value == pytest.approx(one.value, rel=1e-12)
    np.testing.assert_allclose(grouped.gradient, one.gradient, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(grouped.information, one.information, rtol=1e-9)
    np.testing.assert_allclose(model(parts).conditional(THETA).covariance, whole(parts).conditional(THETA).covariance)
    np.testing.assert_allclose(model(parts).shares(THETA), whole(parts).shares(THETA), rtol=1e-9)


def test_groups_of_one_pose_are_todays_rows(parts):
    first = parts[0]
    split = [Rows(*(a[k : k + 1] for a in first[:3]), {c: B[k : k + 1] for c, B in first.blocks.items()}, None)
             for k in range(7)]  # fmt: skip
    together, apart = model([first]).at(THETA), model(split).at(THETA)
    assert apart.value == pytest.approx(together.value, rel=1e-13)
    np.testing.assert_allclose(apart.gradient, together.gradient, rtol=1e-10, atol=1e-12)


def test_gradient_is_the_derivative_with_sizes_that_belong_together(parts):
    C = np.log(3.0) ** 2 * (0.2 * np.eye(3) + 0.8)
    together = model(parts, covariance_of_sizes=C)
    step = 1e-5
    slopes = [(together.value(THETA + step * e) - together.value(THETA - step * e)) / (2 * step) for e in np.eye(3)]
    np.testing.assert_allclose(together.at(THETA).gradient, slopes, rtol=1e-6)
    assert abs(together.value(THETA) - model(parts).value(THETA)) > 0.01
