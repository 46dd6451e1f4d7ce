"""Rotation vectors, quaternions and matrices against SciPy and mpmath, through every branch and near half turns."""

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import SEED

from uq_handeye.core.geometry.rotations import matrices, matrices_of_quaternions, quaternions, vectors

# From below the last digit to half a turn, on both sides of it as near as floats go, and beyond a whole turn.
ANGLES = np.concatenate(
    [[0.0], np.logspace(-300, -9, 9), np.logspace(-8, np.log10(3.1), 30), np.pi - np.logspace(-16, -2, 15),
     np.pi + np.logspace(-15, 0, 8), [2 * np.pi - 1e-9, 7.0, 100.0]]
)  # fmt: skip


def axes() -> np.ndarray:
    """Unit vectors: along the axes, between them, and random ones."""
    some = np.random.default_rng(SEED).normal(size=(6, 3))
    all_of = np.concatenate([np.eye(3), -np.eye(3), [[1, 1, 0], [0, -1, 1], [1, 1, 1], [1, 1e-9, 0]], some])
    return all_of / np.linalg.norm(all_of, axis=1, keepdims=True)


THETA = (ANGLES[:, None, None] * axes()).reshape(-1, 3)


def test_matrices_of_vectors():
    R = matrices(THETA)
    np.testing.assert_allclose(R, Rotation.from_rotvec(THETA).as_matrix(), rtol=0, atol=1e-15 * max(1, ANGLES.max()))
    np.testing.assert_allclose(R @ R.mT, np.broadcast_to(np.eye(3), R.shape), rtol=0, atol=2e-15)


@pytest.mark.parametrize("angle", [1e-12, 1e-5, 0.3, 2.5, np.pi - 1e-9, np.pi])
def test_a_matrix_to_thirty_digits(angle):
    theta = angle * axes()[-1]
    with mpmath.workdps(30):
        x, y, z = map(mpmath.mpf, theta.tolist())
        exact = mpmath.expm(mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
        off = [abs(exact[i, j] - mpmath.mpf(float(matrices(theta)[i, j]))) for i in range(3) for j in range(3)]
    assert max(off) < 6e-16
    # the skew part keeps its relative digits
    assert float(matrices(theta)[2, 1] - matrices(theta)[1, 2]) == pytest.approx(
        2 * np.sin(angle) * theta[0] / angle, rel=1e-13, abs=1e-15
    )


def test_vectors_of_matrices():
    theta = THETA[np.linalg.norm(THETA, axis=1) < np.pi - 1e-13]
    found = vectors(matrices(theta))
    np.testing.assert_allclose(found, theta, rtol=0, atol=1e-15)
    small = np.linalg.norm(theta, axis=1) < 1e-3
    np.testing.assert_allclose(
        np.linalg.norm(found[small], axis=1), np.linalg.norm(theta[small], axis=1), rtol=1e-14, atol=0
    )
    R = matrices(THETA)
    theirs = Rotation.from_matrix(R).as_rotvec()
    sign = np.where((vectors(R) * theirs).sum(axis=1) < 0, -1.0, 1.0)[:, None]  # at half a turn either one
    np.testing.assert_allclose(vectors(R) * sign, theirs, rtol=0, atol=1e-14)


def test_quaternions_and_matrices():
    R = matrices(THETA).reshape(-1, 2, 3, 3)
    q = quaternions(R)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, rtol=1e-15)
    theirs = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat().reshape(q.shape)
    np.testing.assert_allclose(np.abs((q * theirs).sum(axis=-1)), 1.0, rtol=1e-15)
    np.testing.assert_allclose(matrices_of_quaternions(q), R, rtol=0, atol=2e-15)
    np.testing.assert_allclose(matrices_of_quaternions(-3.0 * q), R, rtol=0, atol=2e-15)


def test_a_batch_is_its_parts_and_none_is_none():
    np.testing.assert_array_equal(matrices(THETA)[5], matrices(THETA[5]))
    assert vectors(np.empty((0, 3, 3))).shape == (0, 3)
    assert quaternions(np.empty((2, 0, 3, 3))).shape == (2, 0, 4)
