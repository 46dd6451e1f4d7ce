r"""Rigid motions as matrices: what SciPy lacks, and the checks at the door.

Model: a pose ``T = [[R, t], [0, 1]]`` in SE(3), arrays ``(..., 4, 4)`` in float64. The one error convention
inside the toolkit is ``xi = (theta, tau)``, rotation first, **left** rotation, **additive** translation:

    R = exp([theta]x) R_hat,   t = t_hat + tau                         (radians and the length unit of t)

Everything that SciPy's ``Rotation`` and ``RigidTransform`` do (exponentials, logarithms, means) is left to
them; here are the skew matrix, the SO(3) Jacobian, the derivatives of composed poses in the convention
above, and the validation of input matrices.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ..errors import InputError

Array = NDArray[np.float64]

# max |R^T R - I| of an accepted rotation. A matrix printed with four decimals (entries within 5e-5, so
# |R^T R - I| <= 2 sqrt(3) 5e-5) passes; accepted matrices are used as they are.
ORTHOGONALITY_TOLERANCE = 2e-4

# Translations beyond this overflow when multiplied.
TOO_LONG = 1e75

# Beyond this angle (rad) the axial vector of a rotation loses digits.
NEAR_HALF_TURN = 2.5

# Pairs or poses that are looked at together: small enough for the cache, large enough for NumPy.
CHUNK = 8192


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

    ``angle / sin(angle)`` times the axial vector, which keeps the digits of small angles; SciPy's near half a turn.
    """
    axial = 0.5 * vee(R)
    sine = np.sqrt((axial * axial).sum(axis=-1))
    angle = np.arctan2(sine, 0.5 * (R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2] - 1.0))
    if angle.max(initial=0.0) > NEAR_HALF_TURN:
        return np.asarray(Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1]))
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


def as_numbers(value: Any, name: str) -> Array:
    """``value`` as a float64 array, or an `InputError` that names it."""
    if isinstance(value, np.ndarray) and np.iscomplexobj(value):
        raise InputError(f"Expected `{name}` to hold real numbers, got complex ones.")
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"Expected `{name}` to be an array of numbers of one shape, got {type(value).__name__}."
        ) from error


def as_transforms(value: Any, name: str, stack: bool = True) -> Array:
    """``value`` as checked float64 matrices ``(..., N, 4, 4)`` (or ``(..., 4, 4)`` if not ``stack``).

    Takes arrays or a SciPy ``RigidTransform``. Raises `InputError` naming ``name``, the shape or the first
    offending entry.
    """
    T = as_numbers(value.as_matrix() if hasattr(value, "as_matrix") else value, name)
    wanted = "(..., N, 4, 4)" if stack else "(..., 4, 4)"
    if T.ndim < (3 if stack else 2) or T.shape[-2:] != (4, 4):
        raise InputError(f"Expected `{name}` to have shape {wanted}, got {T.shape}.")
    flat = T.reshape(-1, 4, 4)
    if T.ndim == 2 and _surely_transform(T.tolist()):
        return T
    with np.errstate(over="ignore", invalid="ignore"):  # of huge numbers, which are refused
        for start in range(0, len(flat), CHUNK):
            chunk = flat[start : start + CHUNK]
            rows = entry_rows(chunk)
            if not surely_transforms(rows):
                _explain(flat, start, start + len(chunk), T.shape[:-2], name)
    return T


def entry_rows(*stacks: Array, out: Array | None = None) -> Array:
    """Stacks (n, 4, 4), joined, as (4, 4, m): whole rows of equal entries, which NumPy handles fastest."""
    m = sum(len(T) for T in stacks)
    rows = np.empty((16, m)) if out is None else out
    end = 0
    for T in stacks:
        start, end = end, end + len(T)
        rows[:, start:end] = T.reshape(-1, 16).T
    return rows.reshape(4, 4, m)


def surely_transforms(rows: Array) -> bool:
    """Whether every ``rows[:, :, k]`` of (4, 4, m) is in SE(3) to about 1e-5, with finite translations.

    |R|^2 = 3 and det R = 1 hold together only for rotations: the squared singular values then have
    arithmetic and geometric mean 1, so all are 1. To second order |R|^2 - 2 det R - 1 = 2 |E|^2 - tr(E)^2
    for R = Q (I + E) with E symmetric. Sufficient, not necessary (`as_transforms` takes a second, entry by
    entry look at what fails here), and false if there is a NaN. Overwrites the corner ``rows[3, 3]`` by its
    deviation from 1.
    """
    R = rows[:3, :3]
    squares = np.einsum("ijm,ijm->m", R, R)
    (a, b, c), (d, e, f), (g, h, i) = R
    determinant = a * (e * i - f * h)
    determinant += b * (f * g - d * i)
    determinant += c * (d * h - e * g)
    squares -= 3.0
    determinant -= 1.0
    rows[3, 3] -= 1.0
    last = rows[3].ravel()
    return bool(
        squares.dot(squares) + determinant.dot(determinant) < 1e-18
        and last.dot(last) < 1e-9
        and np.abs(rows[:3, 3]).max(initial=0.0) < TOO_LONG
    )


def _surely_transform(rows: list[list[float]]) -> bool:
    """`surely_transforms` of one matrix in plain numbers: calls of NumPy would take ten times as long."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z), (j, k, m, n) = rows
    squares = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i - 3.0
    determinant = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) - 1.0
    last = j * j + k * k + m * m + (n - 1.0) * (n - 1.0)
    # products, not powers: those of huge numbers are infinite, powers raise
    return squares * squares + determinant * determinant < 1e-18 and last < 1e-9 and abs(x) + abs(y) + abs(z) < TOO_LONG


def _explain(flat: Array, start: int, stop: int, shape: tuple[int, ...], name: str) -> None:
    """Raise the `InputError` that says which matrix in ``start:stop`` is not a pose, and why."""
    for k in range(start, stop):
        T = flat[k]
        at = f"`{name}`[{', '.join(str(i) for i in np.unravel_index(k, shape))}]" if shape else f"`{name}`"
        if not np.isfinite(T).all():
            raise InputError(f"Expected {at} to be finite, got NaN or infinity.")
        if np.abs(T[:3, 3]).max() > TOO_LONG:
            raise InputError(f"Expected the translation of {at} to be below {TOO_LONG:g}, got {T[:3, 3].tolist()}.")
        if np.abs(T[3] - [0, 0, 0, 1]).max() >= ORTHOGONALITY_TOLERANCE:
            raise InputError(f"Expected the last row of {at} to be [0, 0, 0, 1], got {T[3].tolist()}.")
        R = T[:3, :3]
        error = np.abs(R.T @ R - np.eye(3)).max()
        determinant = np.linalg.det(R)
        if determinant < -0.5 and error < 0.1:
            raise InputError(
                f"Expected {at} to hold a rotation, got a left-handed matrix (determinant {determinant:.3f}): "
                "an axis is mirrored."
            )
        if error >= ORTHOGONALITY_TOLERANCE or determinant < 0.5:
            raise InputError(
                f"Expected {at} to hold a rotation, got a matrix that is not orthogonal "
                f"(max |R^T R - I| = {error:.2g}, determinant {determinant:.3g})."
            )


def perturb(T: Array, xi: Array) -> Array:
    """``(exp([theta]x) R, t + tau)`` for ``xi = (theta, tau)``; (..., 4, 4), (..., 6) broadcast."""
    shape = np.broadcast_shapes(T.shape[:-2], xi.shape[:-1])
    result = np.array(np.broadcast_to(T, (*shape, 4, 4)))
    turn = Rotation.from_rotvec(xi[..., :3].reshape(-1, 3)).as_matrix().reshape(*xi.shape[:-1], 3, 3)
    result[..., :3, :3] = turn @ T[..., :3, :3]
    result[..., :3, 3] += xi[..., 3:]
    return result
