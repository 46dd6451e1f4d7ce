r"""Rigid motions as matrices, with the error convention of the toolkit.

Model: a pose ``T = [[R, t], [0, 1]]`` in SE(3), arrays ``(..., 4, 4)`` in float64. The one error convention
inside the toolkit is ``xi = (theta, tau)``, rotation first, **left** rotation, **additive** translation:

    R = exp([theta]x) R_hat,   t = t_hat + tau                         (radians and the length unit of t)

Here are the skew matrix, the SO(3) Jacobian and the derivatives of composed poses in the convention above;
vectors and quaternions of rotations are in `rotations`, Euler angles and means are left to SciPy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .rotations import matrices, vectors

Array = NDArray[np.float64]


# Beyond this angle (rad) the axial vector of a rotation loses digits.
NEAR_HALF_TURN = 2.5


def skew(v: ArrayLike) -> Array:
    """``[v]x`` with ``[v]x y = v x y`` (3); shapes ``(..., 3) -> (..., 3, 3)``."""
    v = np.asarray(v, dtype=float)
    S: Array = np.zeros((*v.shape, 3))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    S[..., 2, 1], S[..., 1, 2] = x, -x
    S[..., 0, 2], S[..., 2, 0] = y, -y
    S[..., 1, 0], S[..., 0, 1] = z, -z
    return S


def vee(M: ArrayLike) -> Array:
    """``(M32 - M23, M13 - M31, M21 - M12)``: *twice* the axial vector of M; ``(..., 3, 3) -> (..., 3)``."""
    M = np.asarray(M, dtype=float)
    return np.stack([M[..., 2, 1] - M[..., 1, 2], M[..., 0, 2] - M[..., 2, 0], M[..., 1, 0] - M[..., 0, 1]], axis=-1)


def pose(R: ArrayLike, t: ArrayLike) -> Array:
    """Return the poses (..., 4, 4) of rotations (..., 3, 3) and translations (..., 3)."""
    T = np.zeros((*np.shape(t)[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def inverse(T: Array) -> Array:
    """``inv(T) = [[R^T, -R^T t], [0, 1]]``; ``(..., 4, 4) -> (..., 4, 4)``."""
    result = np.zeros_like(T)
    R_transposed = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, :3] = R_transposed
    result[..., :3, 3:] = -R_transposed @ T[..., :3, 3:]
    result[..., 3, 3] = 1.0
    return result


def logarithm(R: Array) -> Array:
    """Rotation vectors (..., 3) of rotations (..., 3, 3).

    ``angle / sin(angle)`` times the axial vector, which keeps the digits of small angles; near half a turn `vectors`.
    """
    axial = 0.5 * vee(R)
    sine = np.sqrt((axial * axial).sum(axis=-1))
    angle = np.arctan2(sine, 0.5 * (R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2] - 1.0))
    if angle.max(initial=0.0) > NEAR_HALF_TURN:
        return vectors(R)
    # sin(angle) / angle is 1 to rounding where angle^2 / 6 is
    ratio = np.divide(angle, sine, out=np.ones_like(sine), where=sine > 1e-12)
    return np.asarray(axial * ratio[..., None])


def left_jacobian(theta: ArrayLike) -> Array:
    r"""Left Jacobian of SO(3): ``exp(theta + d) = exp(J(theta) d) exp(theta)`` to first order in d.

    ``J = I + (1 - cos a)/a^2 [theta]x + (a - sin a)/a^3 [theta]x^2``, ``a = |theta|`` (rad). Written with
    ``sinc`` and, below 0.5 rad, the power series of the second coefficient, whose closed form cancels
    there. Shapes ``(..., 3) -> (..., 3, 3)``. Source: J. Sola et al., arXiv:1812.01537, eq. (145).
    """
    theta = np.asarray(theta, dtype=float)
    a2 = np.sum(theta * theta, axis=-1)
    a = np.sqrt(a2)
    first = 0.5 * np.sinc(a / (2 * np.pi)) ** 2  # (1 - cos a)/a^2 = 2 sin^2(a/2)/a^2
    safe = np.where(a > 0.5, a, 1.0)
    series = 1 / 6 - a2 / 120 * (1 - a2 / 42 * (1 - a2 / 72 * (1 - a2 / 110 * (1 - a2 / 156))))
    second = np.where(a > 0.5, (safe - np.sin(safe)) / safe**3, series)
    S = skew(theta)
    return np.asarray(np.eye(3) + first[..., None, None] * S + second[..., None, None] * (S @ S))


def block(a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike) -> Array:
    """``[[a, b], [c, d]]`` of 3x3 blocks with broadcast leading axes; a scalar 0 stands for a zero block."""
    parts = [np.asarray(part, dtype=float) for part in (a, b, c, d)]
    shape = np.broadcast_shapes(*(part.shape[:-2] for part in parts))
    result = np.zeros((*shape, 6, 6))
    result[..., :3, :3], result[..., :3, 3:] = parts[0], parts[1]
    result[..., 3:, :3], result[..., 3:, 3:] = parts[2], parts[3]
    return result


def inverse_jacobian(T: Array) -> Array:
    """``d xi(inv T) / d xi(T)``, 6x6: ``theta' = -R^T theta``, ``tau' = -R^T (tau + [t]x theta)``."""
    R_transposed = np.swapaxes(T[..., :3, :3], -1, -2)
    return -block(R_transposed, 0.0, R_transposed @ skew(T[..., :3, 3]), R_transposed)


def difference(T: Array, base: Array) -> Array:
    """``xi = (theta, tau)`` (..., 6) with ``T = perturb(base, xi)``; (..., 4, 4) both."""
    theta = logarithm(T[..., :3, :3] @ base[..., :3, :3].mT)
    return np.concatenate([theta, T[..., :3, 3] - base[..., :3, 3]], axis=-1)


def perturb(T: Array, xi: Array) -> Array:
    """``(exp([theta]x) R, t + tau)`` for ``xi = (theta, tau)``; (..., 4, 4), (..., 6) broadcast."""
    shape = np.broadcast_shapes(T.shape[:-2], xi.shape[:-1])
    result = np.array(np.broadcast_to(T, (*shape, 4, 4)))
    result[..., :3, :3] = matrices(xi[..., :3]) @ T[..., :3, :3]
    result[..., :3, 3] += xi[..., 3:]
    return result
