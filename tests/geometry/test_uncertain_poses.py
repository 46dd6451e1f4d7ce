"""Covariances of inverse, relative and fused poses, against differences and against repeated draws."""

import numpy as np
import pytest
from support import difference, draw, jacobian, moved, random_covariance, random_transforms

import uq_handeye as uq


def at(T):
    """One pose for each of the rows that `difference` takes."""
    return lambda rows: np.broadcast_to(T, (len(rows), 4, 4))


def test_of_the_inverse(rng):
    T, S = random_transforms(rng, (3,)), random_covariance(rng, shape=(3,))
    found = uq.covariance_of_inverse(T, S)
    for k in range(3):
        inverse = at(np.linalg.inv(T[k]))
        J = jacobian(lambda xi, k=k, inverse=inverse: difference(np.linalg.inv(moved(T[k], xi)), inverse(xi)), 6)
        np.testing.assert_allclose(found[k], J @ S[k] @ J.T, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(uq.covariance_of_inverse(np.linalg.inv(T), found), S, rtol=1e-9, atol=1e-18)


def test_of_a_relative_pose(rng):
    A, B = random_transforms(rng, (2,))
    S = random_covariance(rng, 12)
    pose, covariance = uq.relative_pose(A, B, S)
    np.testing.assert_allclose(pose, np.linalg.inv(A) @ B, atol=1e-12)
    J = jacobian(lambda xi: difference(np.linalg.inv(moved(A, xi[:, :6])) @ moved(B, xi[:, 6:]), at(pose)(xi)), 12)
    np.testing.assert_allclose(covariance, J @ S @ J.T, rtol=1e-6, atol=1e-12)


def test_shared_errors_cancel(rng):
    """An error of the common parent moves both poses and not the one in the other."""
    A, B = random_transforms(rng, (2,))
    move = random_covariance(rng)
    lever = [np.block([[np.eye(3), np.zeros((3, 3))], [-skew(T[:3, 3]), np.eye(3)]]) for T in (A, B)]
    J = np.vstack(lever)
    joint = J @ move @ J.T
    _, covariance = uq.relative_pose(A, B, joint)
    assert np.abs(covariance).max() < 1e-9 * np.abs(joint).max()
    apart = joint.copy()
    apart[:6, 6:], apart[6:, :6] = 0, 0
    assert np.abs(uq.relative_pose(A, B, apart)[1]).max() > 1e-2 * np.abs(joint).max()


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def test_fusion_of_draws_has_its_covariance(rng):
    T, S1, S2 = random_transforms(rng), random_covariance(rng), random_covariance(rng)
    pairs = zip(moved(T, draw(rng, S1, (100,))), moved(T, draw(rng, S2, (100,))), strict=True)
    found = [uq.fused_pose(one, S1, other, S2) for one, other in pairs]
    expected = np.linalg.inv(np.linalg.inv(S1) + np.linalg.inv(S2))
    np.testing.assert_allclose(found[0][1], expected, rtol=2e-2, atol=1e-2 * np.abs(expected).max())
    xi = difference(np.array([pose for pose, _, _ in found]), at(T)(found))
    squares = np.einsum("ni,ij,nj->n", xi, np.linalg.inv(expected), xi)
    assert abs(squares.mean() - 6) < 4 * np.sqrt(12 / 100)
    assert abs(np.mean([square for _, _, square in found]) - 6) < 4 * np.sqrt(12 / 100)


def test_an_estimate_that_is_much_better_decides(rng):
    T, S = random_transforms(rng), random_covariance(rng)
    other = moved(T, np.full(6, 1e-2))
    pose, covariance, square = uq.fused_pose(T, 1e-8 * S, other, S)
    np.testing.assert_allclose(pose, T, atol=1e-8)
    np.testing.assert_allclose(covariance, 1e-8 * S, rtol=1e-4, atol=1e-16)
    assert square > 100


EYE, UNIT = np.eye(4), np.eye(6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: uq.covariance_of_inverse(EYE, np.eye(3)), "shape"),
        (lambda: uq.covariance_of_inverse(EYE, np.triu(np.ones((6, 6)))), "symmetric"),
        (lambda: uq.relative_pose(EYE, EYE, UNIT), r"\(12, 12\), of A and B"),
        (lambda: uq.relative_pose(EYE, 2 * EYE, np.eye(12)), "`B`"),
        (lambda: uq.fused_pose(EYE, UNIT, EYE, np.diag([1.0, 1, 1, 1, 1, 0])), "`covariance2` to be positive definite"),
    ],
)
def test_what_is_refused(call, message):
    with pytest.raises(uq.InputError, match=message):
        call()
