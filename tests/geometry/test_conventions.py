"""Covariances in other conventions: each defined by perturbing a pose in that convention and sampling nothing."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from support import difference, jacobian, moved, random_covariance, random_transforms

import uq_handeye as uq
from uq_handeye.core.geometry.conventions import CONVENTIONS


def twist(rho_first, xi):
    """The 4x4 matrix of a twist given as (rotation, translation) or (translation, rotation)."""
    theta, rho = (xi[..., 3:], xi[..., :3]) if rho_first else (xi[..., :3], xi[..., 3:])
    result = np.zeros((*xi.shape[:-1], 4, 4))
    result[..., 2, 1], result[..., 0, 2], result[..., 1, 0] = np.moveaxis(theta, -1, 0)
    result -= np.swapaxes(result, -1, -2)
    result[..., :3, 3] = rho
    return result


# What each convention says the pose with the coordinates eta is, in terms of the matrix exponential on SE(3).
PERTURBED = {
    "toolkit": moved,
    "ros": lambda T, eta: moved(T, np.roll(eta, 3, axis=-1)),
    "se3-left": lambda T, eta: expm(twist(False, eta)) @ T,
    "se3-right": lambda T, eta: T @ expm(twist(False, eta)),
    "gtsam": lambda T, eta: T @ expm(twist(False, eta)),
    "manif": lambda T, eta: T @ expm(twist(True, eta)),
    "sophus": lambda T, eta: T @ expm(twist(True, eta)),
}


def test_every_convention_has_a_definition():
    assert {*PERTURBED, "paper"} == set(CONVENTIONS)


@pytest.mark.parametrize("name", PERTURBED)
def test_covariance_follows_the_definition(name, rng):
    T, S = random_transforms(rng), random_covariance(rng)
    # d xi / d eta by differences of poses perturbed as the other library does; the covariance of xi is J S' J^T
    J = jacobian(lambda eta: difference(PERTURBED[name](T, eta), np.broadcast_to(T, (len(eta), 4, 4))), 6)
    other = uq.to_convention(S, T, name)
    whitened = np.linalg.solve(np.linalg.cholesky(S), J)
    np.testing.assert_allclose(whitened @ other @ whitened.T, np.eye(6), atol=1e-8)
    np.testing.assert_allclose(uq.from_convention(other, T, name), S, rtol=1e-9, atol=1e-20)


def test_batch(rng):
    T, S = random_transforms(rng, (3, 2)), random_covariance(rng, shape=(3, 2))
    for name in CONVENTIONS:
        batch = uq.to_convention(S, T, name)
        assert batch.shape == (3, 2, 6, 6)
        np.testing.assert_allclose(batch[2, 1], uq.to_convention(S[2, 1], T[2, 1], name), rtol=1e-12)


def test_sigma_R_of_the_paper(rng):
    """(56): Sigma_R = <dR dR^T>, by sampling, against tr(Sigma_theta) I - Sigma_theta."""
    S = random_covariance(rng, 3, sd=1e-3)
    n = 200_000
    theta = rng.multivariate_normal(np.zeros(3), S, n)
    R = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    dR = Rotation.from_rotvec(theta).as_matrix() @ R - R
    sampled = np.einsum("nij,nkj->ik", dR, dR) / n
    expected = uq.paper_from_theta(S)
    L = np.linalg.cholesky(expected)
    whitened = np.linalg.solve(L, np.linalg.solve(L, sampled).T)
    assert np.abs(np.linalg.eigvalsh(whitened) - 1).max() < 8 / np.sqrt(n)  # chi-square spread of a variance
    L = np.linalg.cholesky(S)
    wrong = np.linalg.eigvalsh(np.linalg.solve(L, np.linalg.solve(L, sampled).T))
    assert np.abs(wrong - 1).max() > 0.2  # Sigma_theta itself is not it
    np.testing.assert_allclose(uq.theta_from_paper(expected), S, rtol=1e-12, atol=1e-20)


def test_wrong_names_and_shapes():
    with pytest.raises(uq.InputError, match=r"Unknown convention 'tf'; expected one of toolkit, ros"):
        uq.to_convention(np.eye(6), np.eye(4), "tf")
    with pytest.raises(uq.InputError, match=r"`covariance` to have shape \(\.\.\., 6, 6\), got \(3, 3\)"):
        uq.from_convention(np.eye(3), np.eye(4), "ros")
