r"""Trials of 4DPA in its limit on motions with noise of their own: hardly slower than the random numbers.

Model: true motions ``A_i X = X B_i``; measured ``R = exp([theta]x) R_true``, ``t = t_true + tau`` with
``xi = (theta, tau) = L z``, z standard normal, independent from motion to motion (rad, m). X of T2 (`procrustes`) needs
of each motion only ``2u = vee(R)`` and ``2w = t + R^T t``. With the true R, t, ``s = |theta|``, ``phi = R^T theta``,
``t' = R^T (t + tau)``, ``a = sin(s)/s``, ``b = (1 - cos(s))/s^2`` and Rodrigues' formula, exactly for any angle

    2u = cos(s) vee(R) + a (tr(R) I - R) theta + b phi x theta
    2w = t + tau + cos(s) t' - a phi x t' + b (phi . t') phi

where everything linear in z comes from one small matrix product per motion. The moments ``H = sum u v^T`` and
``K = sum (u z^T + w v^T)`` over the motions give X; B is turned by the true R_X, so that the rotation nearest to H is
the rotation error ``exp([theta_X]x)`` itself. Trials are the last axis of all arrays; a block of them stays in cache.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..noise import PairNoise
from ..procrustes import solve_moments
from ..scratch import scratch
from ..se3 import Array, logarithm

# Motions of both sides in all trials of a block, and the fewest trials worth a call.
BLOCK, FEWEST = 16_384, 32
# Determinant of H over that of the matrix of equal singular values and equal norm, below which the SVD decides.
FLAT = 1e-4
# Squared angles up to which so many terms of the series of a and b leave out less than 1e-11 of the noise itself.
SERIES = ((3e-5, 2), (2e-2, 5))

# (-1)^k / (2k + 1)! and (-1)^k / (2k + 2)!
_SINC = [(-1) ** k / math.factorial(2 * k + 1) for k in range(5)]
_VERSINE = [(-1) ** k / math.factorial(2 * k + 2) for k in range(5)]
_FEATURES = 15
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
    R, t = np.stack([A, turned])[..., :3, :3], np.stack([A, turned])[..., :3, 3]
    vector = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]])
    constant = np.stack([vector, np.einsum("snji,snj->isn", R, t), t.transpose(2, 0, 1)])[..., None]
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = R_X
    L_A, L_B = noise.factors
    linear = np.stack([_linear(A, L_A), _linear(turned, None if L_B is None else both @ L_B)])
    moments = np.empty((2, 3, 3, trials))
    pairs = max(1, min(N, BLOCK // (2 * FEWEST)))
    step = max(FEWEST, BLOCK // (2 * N))
    for first in range(0, trials, step):
        last = min(first + step, trials)
        total = moments[..., first:last]
        total[:] = 0.0
        for start in range(0, N, pairs):
            part = slice(start, start + pairs)
            _add_moments(total, constant[:, :, :, part], linear[:, part], rng)
    return errors_by_moments(moments, N, X[:3, 3])


def _linear(T: Array, L: Array | None) -> Array:
    """``(theta, phi, (tr(R) I - R) theta, R^T tau, tau)`` as a matrix (N, 15, 6) times z."""
    R = T[:, :3, :3]
    F = np.zeros((len(T), _FEATURES, 6))
    if L is None:
        return F
    F[:, :3, :3] = F[:, 12:, 3:] = np.eye(3)
    F[:, 3:6, :3] = F[:, 9:12, 3:] = R.mT
    F[:, 6:9, :3] = np.trace(R, axis1=1, axis2=2)[:, None, None] * np.eye(3) - R
    return F @ L


def _add_moments(total: Array, constant: Array, linear: Array, rng: np.random.Generator) -> None:
    """H and K (2, 3, 3, m) of one draw of some motions, added to ``total``.

    ``constant`` (3, 3, 2, N, 1) holds vee(R), R^T t and t of the true motions, ``linear`` what multiplies z.
    """
    vector, t_rotated, t = constant
    N, m = linear.shape[1], total.shape[-1]
    z = scratch("z", 2, N, 6, m)
    rng.standard_normal(out=z)
    features = scratch("features", _FEATURES, 2, N, m)
    np.matmul(linear, z, out=features.transpose(1, 2, 0, 3))
    theta, phi, turned, shift, tau = features.reshape(5, 3, 2, N, m)

    work = scratch("work", 7, 3, 2, N, m)
    product, one, scaled, u, w = work[0], work[1], work[2], work[3], work[4]
    np.multiply(theta, theta, out=product)
    square = np.add(product[0], product[1], out=work[5, 0])
    square += product[2]
    a, b, cosine = _coefficients(square, work[5, 1], work[5, 2], work[6, 0])

    turned *= a
    _cross(phi, theta, u, product)
    u *= b
    u += turned
    np.multiply(vector, cosine, out=one)
    u += one

    shift += t_rotated
    np.multiply(phi, shift, out=product)
    dot = np.add(product[0], product[1], out=work[6, 1])
    dot += product[2]
    dot *= b
    _cross(phi, shift, w, product)
    w *= a
    np.subtract(tau, w, out=w)
    np.multiply(shift, cosine, out=scaled)
    w += scaled
    np.multiply(phi, dot, out=scaled)
    w += scaled
    w += t

    H_and_wv = np.einsum("sknm,lnm->sklm", work[3:5, :, 0], u[:, 1])
    total += H_and_wv
    total[1] += np.einsum("knm,lnm->klm", u[:, 0], w[:, 1])


def _coefficients(square: Array, a: Array, b: Array, cosine: Array) -> tuple[Array, Array, Array]:
    """``sin(s)/s``, ``(1 - cos s)/s^2`` and ``cos s`` of ``s^2``, in the arrays given."""
    largest = square.max()
    terms = next((count for limit, count in SERIES if largest < limit), 0)
    if terms:
        for out, series in ((a, _SINC), (b, _VERSINE)):
            np.multiply(square, series[terms - 1], out=out)
            for coefficient in series[terms - 2 : 0 : -1]:
                out += coefficient
                out *= square
            out += series[0]
        np.multiply(b, square, out=cosine)
        np.subtract(1.0, cosine, out=cosine)
        return a, b, cosine
    half = 0.5 * np.sqrt(square + 1e-300)
    sine = np.sin(half) / half
    np.multiply(np.cos(half), sine, out=a)
    np.multiply(0.5 * sine, sine, out=b)
    np.subtract(1.0, b * square, out=cosine)
    return a, b, cosine


def _cross(x: Array, y: Array, out: Array, work: Array) -> None:
    """``x x y`` of components along the first axis."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(x[i], y[j], out=out[k])
        np.multiply(x[j], y[i], out=work[k])
    out -= work


def errors_by_moments(moments: Array, N: int, t_X: Array) -> tuple[Array, NDArray[np.bool_]]:
    """xi (T, 6) from the moments (2, 3, 3, T) of 2u, 2w."""
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
        X = solve_moments(full, 4 * N)
    except InputError:  # one by one, as some leave X open
        X = np.broadcast_to(np.eye(4), (len(rest), 4, 4)).copy()
        for k, trial in enumerate(rest):
            try:
                X[k] = solve_moments(full[k], 4 * N)
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
