r"""Rotations as vectors, quaternions and matrices, for arrays of any leading shape.

A rotation by the angle a about the unit vector u is the vector ``theta = a u``, the quaternion (x, y, z, w)
``(u sin(a/2), cos(a/2))`` and the matrix ``R = exp([theta]x)``:

    R = cos(a) + sin(a)/a [theta]x + (1 - cos(a))/a^2 theta theta^T,     (1 - cos(a))/a^2 = (sin(a/2) / (a/2))^2 / 2

Both factors are written with ``sinc``, which keeps their digits at small angles. The vector of a matrix is taken by way
of the quaternion, ``a = 2 atan2(|v|, |w|)``, which also keeps them near 180 deg, where the skew part of R is zero.

`Rotation` is that of SciPy, with Euler angles, products and means. Importing it costs as much as all of NumPy, since it
brings the sparse matrices along: here it is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation as Rotation
else:

    class _OnDemand:
        """Stand-in for the class of SciPy with the same constructors."""

        def __getattr__(self, name: str):
            from scipy.spatial.transform import Rotation

            return getattr(Rotation, name)

    Rotation = _OnDemand()


def matrices(theta: ArrayLike) -> Array:
    """Return ``exp([theta]x)`` (..., 3, 3) of rotation vectors (..., 3), rad."""
    theta = np.asarray(theta, dtype=float)
    angle = np.sqrt((theta * theta).sum(axis=-1))
    first = np.sinc(angle / np.pi)[..., None, None]
    second = 0.5 * np.sinc(angle / (2.0 * np.pi))[..., None, None] ** 2
    x, y, z = np.moveaxis(theta, -1, 0)
    S = np.zeros((*theta.shape, 3))
    S[..., 2, 1], S[..., 1, 2] = x, -x
    S[..., 0, 2], S[..., 2, 0] = y, -y
    S[..., 1, 0], S[..., 0, 1] = z, -z
    R = first * S + second * (theta[..., :, None] * theta[..., None, :])
    for k in range(3):
        R[..., k, k] += np.cos(angle)
    return np.asarray(R)


def vectors(R: Array) -> Array:
    """Return the rotation vectors (..., 3) of matrices (..., 3, 3): rad, at most half a turn."""
    q = quaternions(R)
    v, w = np.where(q[..., 3:] < 0.0, -q, q)[..., :3], np.abs(q[..., 3])
    sine = np.sqrt((v * v).sum(axis=-1))
    angle = 2.0 * np.arctan2(sine, w)
    return np.asarray(v * np.divide(angle, sine, out=np.full(sine.shape, 2.0), where=sine > 0.0)[..., None])


def quaternions(R: Array) -> Array:
    """Return unit quaternions (..., 4), (x, y, z, w), of matrices (..., 3, 3); of either sign.

    By the largest of the four numbers, of which one is at least a half.
    """
    x, y, z = (R[..., k, k] for k in range(3))
    squares = np.stack([1 + x - y - z, 1 - x + y - z, 1 - x - y + z, 1 + x + y + z], axis=-1)  # 4 q_k^2
    products = np.empty((*R.shape[:-2], 4, 4))  # 4 q_j q_k
    for k in range(4):
        products[..., k, k] = squares[..., k]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[..., i, j] = products[..., j, i] = R[..., i, j] + R[..., j, i]
        products[..., k, 3] = products[..., 3, k] = R[..., j, i] - R[..., i, j]
    largest = np.argmax(squares, axis=-1)[..., None, None]
    q = np.take_along_axis(products, largest, axis=-2)[..., 0, :]
    return np.asarray(q / np.sqrt((q * q).sum(axis=-1, keepdims=True)))


def matrices_of_quaternions(q: ArrayLike) -> Array:
    """Return the matrices (..., 3, 3) of quaternions (..., 4), (x, y, z, w), of any length but 0."""
    given = np.asarray(q, dtype=float)
    unit = given / np.sqrt((given * given).sum(axis=-1, keepdims=True))
    products = 2.0 * unit[..., :, None] * unit[..., None, :]
    R = np.empty((*unit.shape[:-1], 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        R[..., i, i] = 1.0 - products[..., j, j] - products[..., k, k]
        R[..., i, j] = products[..., i, j] - products[..., k, 3]
        R[..., j, i] = products[..., i, j] + products[..., k, 3]
    return R
