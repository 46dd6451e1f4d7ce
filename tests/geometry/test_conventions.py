"""Covariances in other conventions: each defined by perturbing a pose in that convention, and as its library has it."""

import json

import numpy as np
import pytest
from fixtures.pages import ROOT
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from support import (
    difference,
    jacobian,
    logarithms,
    moved,
    random_covariance,
    random_transforms,
    rotations,
    transforms,
)

import uq_handeye as uq
from uq_handeye.core.geometry.conventions import CONVENTIONS, CovarianceReading, same_class

# Measured with the libraries themselves by studies/conventions/measure.py.
MEASURED = json.loads((ROOT / "studies/conventions/measured.json").read_text(encoding="utf-8"))
COORDINATES = [name for name in CONVENTIONS if name != "paper"]


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
    "jaxlie": lambda T, eta: T @ expm(twist(True, eta)),
    "small-gicp": lambda T, eta: T @ expm(twist(False, eta)),
    "open3d": lambda T, eta: expm(twist(False, eta)) @ T,
    "pytransform3d": lambda T, eta: expm(twist(False, eta)) @ T,
    "pypose": lambda T, eta: expm(twist(True, eta)) @ T,
    "napa": lambda T, eta: moved(T, np.roll(eta, 3, axis=-1)),
    "symforce": lambda T, eta: apart(T[..., :3, :3] @ rotations(eta[..., :3]), T[..., :3, 3] + eta[..., 3:]),
    "calibsense": lambda T, eta: apart(T[..., :3, :3] @ rotations(-eta[..., :3]), T[..., :3, 3] - eta[..., 3:]),
    # the vector part of a quaternion, translation in the child
    "g2o": lambda T, eta: T @ apart(by_vector_part(eta[..., 3:]), eta[..., :3]),
    "pycolmap": lambda T, eta: apart(by_vector_part(eta[..., :3]) @ T[..., :3, :3], T[..., :3, 3] + eta[..., 3:]),
    "opencv": lambda T, eta: apart(rotations(logarithms(T[..., :3, :3]) + eta[..., :3]), T[..., :3, 3] + eta[..., 3:]),
    # left rotation of dcm_CW, the inverse rotation
    "factorama": lambda T, eta: apart(
        np.swapaxes(rotations(eta[..., 3:]) @ np.swapaxes(T[..., :3, :3], -1, -2), -1, -2),
        T[..., :3, 3] + eta[..., :3],
    ),
    "mrpt": lambda T, eta: apart(
        Rotation.from_euler("ZYX", Rotation.from_matrix(T[..., :3, :3]).as_euler("ZYX") + eta[..., 3:]).as_matrix(),
        T[..., :3, 3] + eta[..., :3],
    ),
}


def apart(R, t):
    return transforms(R, np.broadcast_to(t, (*R.shape[:-2], 3)))


def by_vector_part(q):
    """Rotations whose quaternion has the vector part q."""
    w = np.sqrt(1 - (q * q).sum(axis=-1, keepdims=True))
    return Rotation.from_quat(np.concatenate([q, w], axis=-1)).as_matrix()


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


def whitened_off(S, expected):
    """Largest deviation from 1 of the eigenvalues of S over what is expected."""
    L = np.linalg.cholesky(expected)
    return np.abs(np.linalg.eigvalsh(np.linalg.solve(L, np.linalg.solve(L, S).T)) - 1).max()


def of_inverse(S, T):
    """Covariance of the inverse pose, by differences."""
    inverse = np.linalg.inv(T)
    J = jacobian(lambda xi: difference(np.linalg.inv(moved(T, xi)), np.broadcast_to(inverse, (len(xi), 4, 4))), 6)
    return J @ S @ J.T, inverse


@pytest.mark.parametrize("name", MEASURED)
def test_a_library_has_its_own_convention_and_no_other(name):
    T, S, reported = (np.array(MEASURED[name][key]) for key in ("T", "toolkit", "library"))
    carried = MEASURED[name].get("of_inverse")
    for other in COORDINATES:
        off = whitened_off(reported, uq.to_convention(S, T, other))
        if carried is not None:  # what the library gives to the inverse pose
            off = max(off, whitened_off(carried, uq.to_convention(*of_inverse(S, T), other)))
        if other in same_class(name):
            assert off < 2e-6, other
            np.testing.assert_allclose(
                uq.from_convention(reported, T, other), S, rtol=1e-5, atol=1e-6 * np.abs(S).max()
            )
        else:
            assert off > 0.2, other


def test_versions_of_the_table_are_those_measured():
    for name, entry in MEASURED.items():
        version = entry["version"].rpartition(" ")[2]
        assert ".".join(version.split(".")[:2]) in CONVENTIONS[name].source, name


@pytest.mark.parametrize("name", CONVENTIONS)
def test_information_pixels_and_the_inverse_pose(name, rng):
    T, S = random_transforms(rng, (4,)), random_covariance(rng, shape=(4,))
    for k in range(4):
        expected = uq.to_convention(*of_inverse(S[k], T[k]), name)
        np.testing.assert_allclose(uq.to_convention(S[k], T[k], name, of="inverse"), expected, rtol=1e-6, atol=1e-11)
    numbers = uq.to_convention(S, T, name, of="inverse")
    np.testing.assert_allclose(uq.from_convention(numbers, T, name, of="inverse"), S, rtol=1e-7, atol=1e-14)
    if name != "paper":
        L = uq.to_convention(S, T, name, information=True)
        np.testing.assert_allclose(L @ uq.to_convention(S, T, name), np.tile(np.eye(6), (4, 1, 1)), atol=1e-6)
        np.testing.assert_allclose(uq.from_convention(L, T, name, information=True), S, rtol=1e-6, atol=1e-14)
    if CONVENTIONS[name].has_noise:
        with pytest.raises(uq.InputError, match=f"no `pixel_sd` beside the convention '{name}'"):
            uq.from_convention(numbers, T, name, pixel_sd=0.3)
    else:
        scaled = uq.from_convention(numbers, T, name, of="inverse", pixel_sd=0.3)
        np.testing.assert_allclose(scaled, 0.09 * S, rtol=1e-7, atol=1e-14)


def test_a_joint_covariance(rng):
    T, S = random_transforms(rng, (3,)), random_covariance(rng, 18)
    joint = uq.to_convention(S, T, "manif")
    np.testing.assert_allclose(joint[6:12, 6:12], uq.to_convention(S[6:12, 6:12], T[1], "manif"), rtol=1e-9)
    np.testing.assert_allclose(uq.from_convention(joint, T, "manif"), S, rtol=1e-8, atol=1e-16)
    L = np.linalg.inv(joint)
    np.testing.assert_allclose(uq.from_convention(L, T, "manif", information=True), S, rtol=1e-5, atol=1e-12)


def test_one_covariance_for_many_poses_differs_by_pose(rng):
    T, S = random_transforms(rng, (3,)), random_covariance(rng)
    found = uq.from_convention(S, T, "gtsam")
    np.testing.assert_allclose(found[2], uq.from_convention(S, T[2], "gtsam"), rtol=1e-12)
    assert np.abs(found[0] - found[1]).max() > 1e-8


def test_yaw_and_roll_at_a_pitch_of_90_deg_have_no_covariance():
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("ZYX", [0.3, np.pi / 2, 0.1]).as_matrix()
    with pytest.raises(uq.InputError, match="pitch that is not 90 deg"):
        uq.to_convention(np.eye(6), T, "mrpt")


@pytest.mark.parametrize("text", ["gtsam", "g2o,information", "toolkit,inverse", "pycolmap,information,pixel_sd=0.3"])
def test_a_reading_as_text(text):
    assert CovarianceReading.parse(text).words == text


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


POSE = np.eye(4)
POSES = np.tile(POSE, (4, 1, 1))
SINGULAR = np.diag([1.0, 1, 1, 1, 1, 0])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: uq.to_convention(np.eye(6), POSE, "tf"),
            r"Unknown convention 'tf'; expected one of toolkit, ros",
        ),
        (lambda: uq.to_convention(np.eye(6), POSE, "gtsm"), "Did you mean 'gtsam'"),
        (lambda: uq.from_convention(np.eye(3), POSE, "ros"), r"shape \(\.\.\., 6, 6\), got \(3, 3\)"),
        (lambda: uq.from_convention(np.eye(12), POSE, "ros"), r"got \(12, 12\)"),
        (lambda: uq.from_convention(np.triu(np.ones((6, 6))), POSE, "ros"), "symmetric"),
        (lambda: uq.from_convention(np.ones((6, 6)) - 2 * np.eye(6), POSE, "ros"), ">= 0"),
        (lambda: uq.from_convention(3 * np.ones((6, 6)) - 2 * np.eye(6), POSE, "ros"), "semidefinite"),
        (
            lambda: uq.from_convention(np.tile(np.eye(6), (3, 1, 1)), POSES, "ros"),
            "one for each",
        ),
        (lambda: uq.from_convention(SINGULAR, POSE, "g2o", information=True), "singular"),
        (lambda: uq.from_convention(np.eye(6), POSE, "opencv", pixel_sd=0.2), "factor of their own"),
        (lambda: uq.from_convention(np.eye(6), POSE, "pycolmap", pixel_sd=-1), "above 0 px"),
        (lambda: uq.from_convention(np.eye(6), POSE, "ros", of="target"), "`of` to be one of pose, inverse"),
        (lambda: CovarianceReading.parse("gtsam,twice"), "got 'twice'"),
        (lambda: CovarianceReading.parse("gtsam,pixel_sd=much"), "number of pixels"),
    ],
)
def test_what_is_refused(call, message):
    with pytest.raises(uq.InputError, match=message):
        call()
