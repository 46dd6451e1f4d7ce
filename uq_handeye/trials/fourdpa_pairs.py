r"""Trials of 4DPA in its limit on motions with noise of their own: hardly slower than the random numbers.

Model: true motions ``A_i X = X B_i``; measured ``R = exp([theta]x) R_true``, ``t = t_true + tau`` with
``xi = (theta, tau) = L z``, z standard normal, independent from motion to motion (rad, m). X of T2 (`procrustes`) needs
of each motion only u and w. With the quaternion ``q = (q_0, q_v)`` of R

    u = vee(R) / 2 = 2 q_0 q_v
    w = (t + R^T t) / 2 = q_0 (q_0 t - q_v x t) + (q_v . t) q_v
    q = cos(s/2) q_true + sin(s/2) / (s/2) g,    g = (0, theta/2) q_true,    s/2 = |theta|/2 = |g|

where g and tau, all that is linear in z, come from one small matrix product per motion; exact for any angle. The
moments ``H = sum u v^T`` and ``K = sum (u z^T + w v^T)`` over the motions give X; B is turned by the true R_X, so that
the rotation nearest to H is the rotation error ``exp([theta_X]x)`` itself. Trials are the last axis of all arrays; a
block of them stays in cache.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..errors import InputError
from ..noise import PairNoise
from ..procrustes import solve_moments
from ..scratch import scratch
from ..se3 import Array, logarithm, skew

# Motions of both sides in all trials of a block, and the fewest trials worth a call.
BLOCK, FEWEST = 16_384, 32
# Determinant of H over that of the matrix of equal singular values and equal norm, below which the SVD decides.
FLAT = 1e-4
# Squared half angles up to which so many terms of the series leave out less than 1e-11 of the noise itself.
SERIES = ((1e-5, 2), (5e-3, 4))

# (-1)^k / (2k + 1)! and (-1)^k / (2k)!
_SINC = [(-1) ** k / math.factorial(2 * k + 1) for k in range(4)]
_COSINE = [(-1) ** k / math.factorial(2 * k) for k in range(5)]
_FEATURES = 7
_ROOT = math.sqrt(2.0)
# Cofactor (i, j) is the product of two entries less that of two others.
_COFACTORS = np.array(
    [[3 * ((i + p) % 3) + (j + q) % 3 for i in range(3) for j in range(3)] for p, q in ((1, 1), (2, 2), (1, 2), (2, 1))]
)


def fourdpa_on_drawn(
    A: Array, B: Array, X: Array, noise: PairNoise, rng: np.random.Generator, trials: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Errors xi (trials, 6) of 4DPA's X on so many draws, and which trials determine it (the others are rows of 0).

    A, B (N, 4, 4) are true motions that fit X (4, 4). Numbers depend on the generator and on N alone.
    """
    N = len(A)
    R_X = X[:3, :3]
    turned = np.zeros_like(B)
    turned[:, :3, :3] = R_X @ B[:, :3, :3] @ R_X.T
    turned[:, :3, 3] = B[:, :3, 3] @ R_X.T
    turned[:, 3, 3] = 1.0
    sides = np.stack([A, turned])
    q = Rotation.from_matrix(sides[..., :3, :3].reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(2, N, 4)
    # with sqrt(2) q and t / 2, u and w need no further factors
    constant = np.concatenate([_ROOT * q, 0.5 * sides[..., :3, 3]], axis=-1).transpose(2, 0, 1)[..., None]
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = R_X
    L_A, L_B = noise.factors
    linear = np.stack([_linear(q[0], L_A), _linear(q[1], None if L_B is None else both @ L_B)])
    moments = np.empty((2, 3, 3, trials))
    pairs = max(1, min(N, BLOCK // (2 * FEWEST)))
    step = max(FEWEST, BLOCK // (2 * N))
    for first in range(0, trials, step):
        last = min(first + step, trials)
        total = moments[..., first:last]
        total[:] = 0.0
        for start in range(0, N, pairs):
            part = slice(start, start + pairs)
            _add_moments(total, constant[:, :, part], linear[:, part], rng)
    return errors_by_moments(moments, N, X[:3, 3])


def _linear(q: Array, L: Array | None) -> Array:
    """``(sqrt(2) g, tau / 2)`` of motions with quaternions (N, 4) as matrices (N, 7, 6) times z."""
    F = np.zeros((len(q), _FEATURES, 6))
    if L is None:
        return F
    F[:, 0, :3] = -q[:, 1:]
    F[:, 1:4, :3] = q[:, :1, None] * np.eye(3) - skew(q[:, 1:])  # theta x q_v = -[q_v]x theta
    F[:, :4, :3] *= 0.5 * _ROOT
    F[:, 4:, 3:] = 0.5 * np.eye(3)
    return F @ L


def _add_moments(total: Array, constant: Array, linear: Array, rng: np.random.Generator) -> None:
    """H and K (2, 3, 3, m) of one draw of some motions, added to ``total``.

    ``constant`` (7, 2, N, 1) holds sqrt(2) q and t / 2 of the true motions, ``linear`` (2, N, 7, 6) what multiplies z.
    """
    N, m = linear.shape[1], total.shape[-1]
    z = scratch("z", 2, N, 6, m)
    rng.standard_normal(out=z)
    features = scratch("features", _FEATURES, 2, N, m)
    np.matmul(linear, z, out=features.transpose(1, 2, 0, 3))
    q, t = features[:4], features[4:]
    work = scratch("work", 12, 2, N, m)
    half, sinc, cosine, products = work[0], work[1], work[2], work[3:7]

    np.multiply(q, q, out=products)
    np.add.reduce(products, axis=0, out=half)
    half *= 0.5
    _sinc_and_cosine(half, sinc, cosine)
    q *= sinc
    np.multiply(constant[:4], cosine, out=products)
    q += products
    t += constant[4:]

    scalar, vector = q[0], q[1:]
    uw = work[6:].reshape(2, 3, 2, N, m)
    u, w = uw
    products, dot = work[1:4], work[4]
    np.multiply(vector, t, out=products)
    np.add.reduce(products, axis=0, out=dot)
    _cross(vector, t, u, products)  # u is not needed yet
    np.multiply(t, scalar, out=w)
    w -= u
    w *= scalar
    np.multiply(vector, dot, out=products)
    w += products
    np.multiply(vector, scalar, out=u)

    total += np.einsum("sknm,lnm->sklm", uw[:, :, 0], u[:, 1])
    total[1] += np.einsum("knm,lnm->klm", u[:, 0], w[:, 1])


def _sinc_and_cosine(square: Array, sinc: Array, cosine: Array) -> None:
    """``sin(h)/h`` and ``cos h`` of ``h^2``, into the arrays given."""
    largest = square.max()
    terms = next((count for limit, count in SERIES if largest < limit), 0)
    if not terms:
        h = np.sqrt(square + 1e-300)
        np.divide(np.sin(h), h, out=sinc)
        np.cos(h, out=cosine)
        return
    for out, series in ((sinc, _SINC[:terms]), (cosine, _COSINE[: terms + 1])):
        np.multiply(square, series[-1], out=out)
        for coefficient in series[-2:0:-1]:
            out += coefficient
            out *= square
        out += series[0]


def _cross(x: Array, y: Array, out: Array, work: Array) -> None:
    """``x x y`` of components along the first axis."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(x[i], y[j], out=out[k])
        np.multiply(x[j], y[i], out=work[k])
    out -= work


def errors_by_moments(moments: Array, N: int, t_X: Array) -> tuple[Array, NDArray[np.bool_]]:
    """xi (T, 6) from the moments H and K (2, 3, 3, T) of N motions, and which trials determine it."""
    H, K = moments
    T = H.shape[-1]
    errors, ok = np.zeros((T, 6)), np.ones(T, dtype=bool)
    size = np.sqrt(np.einsum("ijt,ijt->t", H, H) / 3.0)
    regular = _determinant(H) > FLAT * size**3
    if regular.all():
        return _by_polar(H / size, K, size, t_X), ok
    if regular.any():
        errors[regular] = _by_polar(H[..., regular] / size[regular], K[..., regular], size[regular], t_X)
    rest = np.flatnonzero(~regular)
    full = np.zeros((len(rest), 6, 6))
    full[:, :3, :3], full[:, :3, 3:] = H[..., rest].transpose(2, 0, 1), K[..., rest].transpose(2, 0, 1)
    try:
        X = solve_moments(4 * full, N)
    except InputError:  # one by one, as some leave X open
        X = np.broadcast_to(np.eye(4), (len(rest), 4, 4)).copy()
        for k, trial in enumerate(rest):
            try:
                X[k] = solve_moments(4 * full[k], N)
            except InputError:
                ok[trial] = False
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
        if moved < 1e-9:  # the next step would be of the order of its square
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
