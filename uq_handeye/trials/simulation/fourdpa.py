"""Trials of 4DPA in its limit on motions with independent noise, nearly as fast as the random numbers are drawn.

Model: true motions ``A_i X = X B_i``; measured ``R = exp([theta]x) R_true``, ``t = t_true + tau`` with
``xi = (theta, tau) = L z``, z standard normal, independent from motion to motion (rad, m). X of T2 (`methods.limit`)
needs of each motion only u and w, from its quaternion and translation. The moments ``H = sum u v^T`` and
``K = sum (u z^T + w v^T)`` over the motions give X; B is rotated by the true R_X, so that the rotation nearest to H is
the rotation error ``exp([theta_X]x)`` itself. Arrays are (component, pairs, trials): whole rows of equal components,
trials last, which NumPy handles fastest; arrays that are constant over pairs or over trials are broadcast, and a block
of trials stays in cache. Quaternions are ``(w, x, y, z)``. Input that is not positive or not finite gives NaN or
infinity in its own trial only.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.checks import CHUNK
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, block, logarithm, skew
from ...core.rounding import CHAIN_ROUNDING, TINY
from ...core.scratch import scratch
from ...errors import InputError
from ...methods.limit import solve_moments
from ...model.errors.models import PairNoise

# Fewest trials of a block that are worth a call.
MIN_BLOCK_TRIALS = 32
# Cofactor (i, j) is the product of two entries minus that of two others.
_COFACTORS = np.array(
    [[3 * ((i + p) % 3) + (j + q) % 3 for i in range(3) for j in range(3)] for p, q in ((1, 1), (2, 2), (1, 2), (2, 1))]
)
# The series of sin(h)/h in h^2, from its last term on, and h^2 below which what follows is rounding. NumPy's sine and
# cosine take ten times as long.
SINC = [
    (limit, [(-1) ** k / math.factorial(2 * k + 1) for k in reversed(range(terms))])
    for limit, terms in ((3e-5, 3), (0.02, 5))
]


def fourdpa_on_drawn(
    A: Array, B: Array, X: Array, noise: PairNoise, rng: np.random.Generator, trials: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Return errors xi (trials, 6) of 4DPA's X, and which trials determine it (the others are rows of 0).

    A, B (N, 4, 4) are true motions that fit X (4, 4). Numbers depend on the generator and on N only.
    """
    N = len(A)
    L_A, L_B = noise.factors
    true_A, true_B = Side.of(A, None, L_A), Side.of(B, X[:3, :3], L_B)
    moments = np.zeros((2, 3, 3, trials))
    pairs = max(1, min(N, CHUNK // MIN_BLOCK_TRIALS))
    step = max(MIN_BLOCK_TRIALS, CHUNK // N)
    for first in range(0, trials, step):
        H, K = moments[..., first : first + step]
        m = H.shape[-1]
        for start in range(0, N, pairs):
            part = slice(start, min(start + pairs, N))
            drawn = scratch("drawn", 2, 7, part.stop - start, m)
            u, w = halves(*true_A.drawn(part, m, rng, drawn[0]))
            v, z = halves(*true_B.drawn(part, m, rng, drawn[1]))
            H += np.einsum("inm,jnm->ijm", u, v)
            K += np.einsum("inm,jnm->ijm", u, z)
            K += np.einsum("inm,jnm->ijm", w, v)
    return errors_by_moments(moments, N, X[:3, 3])


def errors_by_moments(
    moments: Array, N: int, t_X: Array, min_determinant: float = 1e-4
) -> tuple[Array, NDArray[np.bool_]]:
    """xi (T, 6) from the moments H and K (2, 3, 3, T) of N motions, and which trials determine it.

    Where the determinant of H is below ``min_determinant`` of that of a matrix with the same norm and equal singular
    values, the SVD decides.
    """
    H, K = moments
    T = H.shape[-1]
    errors, ok = np.zeros((T, 6)), np.ones(T, dtype=bool)
    size = np.sqrt(np.einsum("ijt,ijt->t", H, H) / 3.0)
    regular = _determinant(H) > min_determinant * size**3
    if regular.all():
        return _by_polar(H / size, K, size, t_X), ok
    if regular.any():
        errors[regular] = _by_polar(H[..., regular] / size[regular], K[..., regular], size[regular], t_X)
    rest = np.flatnonzero(~regular)
    full = np.zeros((len(rest), 6, 6))
    full[:, :3, :3], full[:, :3, 3:] = H[..., rest].transpose(2, 0, 1), K[..., rest].transpose(2, 0, 1)
    X: Array | None = None
    with suppress(InputError):
        X = solve_moments(4 * full, N)
    if X is None:  # one by one, as some leave X open
        X = np.broadcast_to(np.eye(4), (len(rest), 4, 4)).copy()
        for k, trial in enumerate(rest):
            ok[trial] = False
            with suppress(InputError):
                X[k], ok[trial] = solve_moments(4 * full[k], N), True
    errors[rest, :3] = logarithm(X[:, :3, :3])
    errors[rest, 3:] = X[:, :3, 3] - t_X
    errors[~ok] = 0.0
    return errors, ok


def _determinant(M: Array) -> Array:
    (a, b, c), (d, e, f), (g, h, i) = M
    return np.asarray(a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g))


def _cofactors(M: Array) -> Array:
    """``det(M) M^-T`` of (3, 3, T)."""
    entries = M.reshape(9, -1)
    i, j, k, m = _COFACTORS
    result = entries.take(i, axis=0)
    result *= entries.take(j, axis=0)
    other = entries.take(k, axis=0)
    other *= entries.take(m, axis=0)
    result -= other
    return np.asarray(result.reshape(M.shape))


def _by_polar(H: Array, K: Array, size: Array, t_X: Array) -> Array:
    """xi of trials whose H (scaled by ``size``) has a positive determinant: its polar factor is the rotation (T2)."""
    R = H
    for _ in range(30):  # Newton's iteration for the polar factor, R <- (R + R^-T) / 2: quadratic
        C = _cofactors(R)
        inverse_transposed = C / (R[0] * C[0]).sum(axis=0)
        scale = np.sqrt(np.sqrt((inverse_transposed**2).sum(axis=(0, 1)) / (R**2).sum(axis=(0, 1))))
        new = 0.5 * (scale * R + inverse_transposed / scale)
        moved = np.abs(new - R).max()
        R = new
        if moved < CHAIN_ROUNDING:  # the next step would be of the order of its square
            break
    # H R^T is symmetric and positive; M = tr(H R^T) I - H R^T
    G = np.einsum("ikt,jkt->ijt", H, R)
    G = 0.5 * (G + G.swapaxes(0, 1))
    M = -G
    trace = G[0, 0] + G[1, 1] + G[2, 2]
    for i in range(3):
        M[i, i] += trace
    P = np.einsum("ikt,jkt->ijt", K, R)
    h = np.stack([P[1, 2] - P[2, 1], P[2, 0] - P[0, 2], P[0, 1] - P[1, 0]])
    C = _cofactors(M)
    t = -np.einsum("ijt,it->jt", C, h) / ((M[0] * C[0]).sum(axis=0) * size)
    xi = np.empty((H.shape[-1], 6))
    xi[:, :3] = logarithm(R.transpose(2, 0, 1))
    xi[:, 3:] = t.T - t_X
    return xi


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
        q = Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True).T[..., None]
        t = T[:, :3, 3].T[..., None]
        if turn is not None:
            q[1:], t = (np.einsum("ij,jnm->inm", turn, rows) for rows in (q[1:], t))
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
        sine, cosine = half_turn(np.asarray((rotation * rotation).sum(axis=0)))
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
        return np.where(h > 0, np.sin(h) / np.maximum(h, TINY), 1.0), np.cos(h)
    sine = square * series[0]
    for coefficient in series[1:-1]:
        sine += coefficient
        sine *= square
    sine += series[-1]
    cosine = sine * sine
    cosine *= square
    np.subtract(1.0, cosine, out=cosine)
    return sine, np.sqrt(cosine, out=cosine)
