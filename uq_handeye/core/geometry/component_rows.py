"""Rotations and triangular matrices of many motions in many trials, component by component.

Arrays are (component, pairs, trials): whole rows of equal components, trials last, which NumPy handles fastest and to
which what is constant over pairs or over trials is broadcast. Quaternions are ``(w, x, y, z)``, rotation vectors in
rad. Nothing is checked here: what is not positive or not finite comes out as NaN or infinity in its own trial only.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..runtime.workspace import scratch
from .se3 import Array, block, skew

# The series of sin(h)/h in h^2, from its last term on, and h^2 below which what follows is rounding. NumPy's sine and
# cosine take ten times as long.
SINC = [
    (limit, [(-1) ** k / math.factorial(2 * k + 1) for k in reversed(range(terms))])
    for limit, terms in ((3e-5, 3), (0.02, 5))
]


def rows_of(T: Array, turn: Array | None) -> tuple[Array, Array]:
    """Quaternions (4, n, m) and translations (3, n, m) of (n, m, 4, 4), in a frame rotated by ``turn``."""
    q = Rotation.from_matrix(T[..., :3, :3].reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(*T.shape[:-2], 4)
    q, t = np.ascontiguousarray(np.moveaxis(q, -1, 0)), np.ascontiguousarray(np.moveaxis(T[..., :3, 3], -1, 0))
    if turn is not None:
        q[1:], t = (np.einsum("ij,jnm->inm", turn, rows) for rows in (q[1:], t))
    return q, t


class Side(NamedTuple):
    """True motions of one side and their errors: ``q = cos(h) q_true + sin(h)/h g``, ``g = (0, theta/2) q_true``.

    ``h = |theta|/2 = |g|``, so that g and tau, linear in what is drawn, are all that it takes; exact for any angle.
    """

    q: Array  # (4, N, 1)
    t: Array  # (3, N, 1)
    linear: Array | None  # (N, 7, 6): g and tau from standard normals; None: exact

    @classmethod
    def of(cls, T: Array, turn: Array | None, L: Array | None) -> Side:
        """Return the side of motions (N, 4, 4) whose covariances are L L^T, in a frame rotated by ``turn``."""
        q, t = rows_of(T[:, None], turn)
        if L is None:
            return cls(q, t, None)
        if turn is not None:
            L = block(turn, 0.0, 0.0, turn) @ L
        F = np.zeros((len(T), 7, 6))
        vector = q[1:, :, 0].T
        F[:, 0, :3] = -0.5 * vector
        F[:, 1:4, :3] = 0.5 * (q[0, :, :, None] * np.eye(3) - skew(vector))
        F[:, 4:, 3:] = np.eye(3)
        return cls(q, t, F @ L)

    def drawn(self, pairs: slice, m: int, rng: np.random.Generator, out: Array) -> tuple[Array, Array]:
        """Measured quaternions (4, n, m) and translations (3, n, m) of n pairs in m trials, in ``out`` (7, n, m)."""
        q, t = self.q[:, pairs], self.t[:, pairs]
        if self.linear is None:
            out[:4], out[4:] = q, t
            return out[:4], out[4:]
        z = scratch("normals", q.shape[1], 6, m)
        rng.standard_normal(out=z)
        np.matmul(self.linear[pairs], z, out=out.transpose(1, 0, 2))
        rotation, translation = out[:4], out[4:]
        sine, cosine = half_turn(_squares(rotation))
        rotation *= sine
        rotation += cosine * q
        translation += t
        return rotation, translation


def halves(q: Array, t: Array) -> tuple[Array, Array]:
    """u and w of T2, (3, n, m).

    ``u = vee(R)/2 = 2 q_0 q_v`` and ``w = (t + R^T t)/2 = q_0 (q_0 t - q_v x t) + (q_v . t) q_v``.
    """
    scalar, vector = q[0], q[1:]
    w = cross(t, vector)
    w += t * scalar
    w *= scalar
    along = vector * t
    w += (along[0] + along[1] + along[2]) * vector
    u = vector * scalar
    u *= 2.0
    return u, w


def _squares(rows: Array) -> Array:
    """Sums of squares over the components."""
    products = rows * rows
    return np.asarray(np.add.reduce(products, axis=0))


def cross(x: Array, y: Array) -> Array:
    """``x x y`` of rows (3, n, m)."""
    result = np.empty((3, *x.shape[1:]))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(x[j], y[k], out=result[i])
        result[i] -= x[k] * y[j]
    return result


def half_turn(square: Array) -> tuple[Array, Array]:
    """``sin(h)/h`` and ``cos(h)`` of ``h^2``, (n, m)."""
    largest = square.max()
    series = next((series for limit, series in SINC if largest < limit), None)
    if series is None:
        h = np.sqrt(square)
        return np.where(h > 0, np.sin(h) / np.maximum(h, 1e-150), 1.0), np.cos(h)
    sine = square * series[0]
    for coefficient in series[1:-1]:
        sine += coefficient
        sine *= square
    sine += series[-1]
    cosine = sine * sine
    cosine *= square
    np.subtract(1.0, cosine, out=cosine)
    return sine, np.sqrt(cosine, out=cosine)


def turned(q: Array, theta: Array) -> Array:
    """``exp(theta) q`` (4, n, m)."""
    sine, cosine = half_turn(0.25 * _squares(theta))
    sine *= 0.5
    d = theta * sine
    result = np.empty_like(q)
    np.multiply(cosine, q[0], out=result[0])
    for k in range(3):
        result[0] -= d[k] * q[1 + k]
    vector = result[1:]
    np.multiply(cosine, q[1:], out=vector)
    vector += cross(d, q[1:])
    d *= q[0]
    vector += d
    return result


def logarithm(q: Array, out: Array) -> None:
    """Rotation vectors of quaternions of either sign: ``2 atan(|v|/w) v/|v|``."""
    size = np.sqrt(_squares(q[1:]))
    np.maximum(size, 1e-150, out=size)
    ratio = size / q[0]
    np.arctan(ratio, out=ratio)
    ratio /= size
    ratio *= 2.0
    np.multiply(q[1:], ratio, out=out)


def matrix_less_one(q: Array, out: Array) -> None:
    """``R - I`` (3, 3, n, m) of quaternions."""
    w, x, y, z = q * math.sqrt(2.0)
    xx, yy, zz = x * x, y * y, z * z
    for i, (p, r) in enumerate(((yy, zz), (xx, zz), (xx, yy))):
        np.add(p, r, out=out[i, i])
        np.negative(out[i, i], out=out[i, i])
    for i, j, p, r, s in ((0, 1, x, y, z), (2, 0, x, z, y), (1, 2, y, z, x)):
        one, other = p * r, w * s
        np.subtract(one, other, out=out[i, j])
        np.add(one, other, out=out[j, i])


def quaternion(theta: Array) -> Array:
    """(4, 1, m) of rotation vectors (3, m)."""
    sine, cosine = half_turn(0.25 * _squares(theta[:, None]))
    return np.concatenate([cosine[None], 0.5 * sine * theta[:, None]])


def composed(p: Array, q: Array) -> Array:
    """The product ``p q``."""
    result = np.empty_like(q)
    result[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    result[1:] = p[0] * q[1:] + q[0] * p[1:] + cross(p[1:], q[1:])
    return result


def matrix(q: Array) -> Array:
    """R (3, 3, m) of quaternions (4, 1, m)."""
    R = np.empty((3, 3, *q.shape[1:]))
    matrix_less_one(q, R)
    for i in range(3):
        R[i, i] += 1.0
    return R[:, :, 0]


def rotated(R: Array, rows: Array) -> Array:
    """R (3, 3, m) times rows (3, n, m)."""
    return np.asarray(np.einsum("ikm,knm->inm", R, rows))


def times(S: Array, pairs: slice, rows: Array) -> Array:
    """``S rows`` for S (6, 6) or (N, 6, 6), rows (6, n, m)."""
    result = np.empty_like(rows)
    # pair by pair also where S is common: of one large product OpenBLAS would make threads
    np.matmul(S if S.ndim == 2 else S[pairs], rows.swapaxes(0, 1), out=result.swapaxes(0, 1))
    return result


def skew_product(v: Array, rows: Array, out: Array) -> None:
    """``[v]x rows`` for v (3, n, m), rows (3, 3, n, m)."""
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(v[j], rows[k], out=out[i])
        out[i] -= v[k] * rows[j]


class Triangle(NamedTuple):
    """A lower triangle L, 3x3: entries below the diagonal, and the inverses of those on it."""

    l10: Array
    l20: Array
    l21: Array
    i0: Array
    i1: Array
    i2: Array

    @classmethod
    def of(cls, S: Array) -> Triangle:
        """``S = L L^T``, from the lower triangle of S (3, 3, n, m); NaN where S is not positive."""
        i0 = 1.0 / np.sqrt(S[0, 0])
        l10, l20 = S[1, 0] * i0, S[2, 0] * i0
        i1 = 1.0 / np.sqrt(S[1, 1] - l10 * l10)
        l21 = (S[2, 1] - l20 * l10) * i1
        i2 = 1.0 / np.sqrt(S[2, 2] - l20 * l20 - l21 * l21)
        return cls(l10, l20, l21, i0, i1, i2)

    def solve(self, rows: Array) -> None:
        """``L^-1 rows`` in place, (3, ..., n, m)."""
        first, second, third = rows
        first *= self.i0
        second -= self.l10 * first
        second *= self.i1
        third -= self.l20 * first
        third -= self.l21 * second
        third *= self.i2

    def solve_transposed(self, rows: Array) -> None:
        """``L^-T rows`` in place."""
        first, second, third = rows
        third *= self.i2
        second -= self.l21 * third
        second *= self.i1
        first -= self.l10 * second
        first -= self.l20 * third
        first *= self.i0

    def times(self, rows: Array, out: Array) -> None:
        """``L rows``."""
        np.divide(rows[0], self.i0, out=out[0])
        np.divide(rows[1], self.i1, out=out[1])
        out[1] += self.l10 * rows[0]
        np.divide(rows[2], self.i2, out=out[2])
        out[2] += self.l20 * rows[0]
        out[2] += self.l21 * rows[1]
