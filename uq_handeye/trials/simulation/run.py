"""Trials of 4DPA in its limit on motions with noise of their own: hardly slower than the random numbers.

Model: true motions ``A_i X = X B_i``; measured ``R = exp([theta]x) R_true``, ``t = t_true + tau`` with
``xi = (theta, tau) = L z``, z standard normal, independent from motion to motion (rad, m). X of T2 (`procrustes`) needs
of each motion only u and w, from its quaternion and translation. The moments ``H = sum u v^T`` and
``K = sum (u z^T + w v^T)`` over the motions give X; B is rotated by the true R_X, so that the rotation nearest to H is
the rotation error ``exp([theta_X]x)`` itself. Arrays are (component, pairs, trials): whole rows of equal components,
trials last, which NumPy handles fastest and to which what is constant over pairs or over trials is broadcast; a block
of trials stays in cache. Quaternions are ``(w, x, y, z)``. What is not positive or not finite comes out as NaN or
infinity in its own trial only.

Trials of any method: noise drawn on exact data, X estimated from each draw, and its error.

Work goes in blocks of a fixed number of trials, so that memory is bounded and the numbers depend on the generator
only. 4DPA on motions has an engine of its own (`fourdpa_on_drawn`); every other method runs on leading batch axes.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, block, difference, logarithm, skew
from ...core.runtime.read_only import scratch
from ...errors import InputError
from ...fit.likelihood.constraint import constraint_of, covariances_of
from ...fit.likelihood.gauss_helmert import CLOSED_FORM_STEPS, ESTIMATORS, MOST_STEPS, fit_data
from ...methods.estimators.registry import METHODS, ROBOT_WORLD_METHODS
from ...methods.procrustes.limit import solve_moments
from ...methods.procrustes.scaled import solve_4dpa
from ...methods.propagation.all_pairs import solve_all_pairs
from ...methods.propagation.noise_transport import covariance_of_poses
from ...methods.propagation.propagate import propagate_and_check
from ...model.noise.models import PairNoise, with_prior
from ...model.poses.pose_pairs import PosePairs
from .experiment import Experiment, motions_of
from .rig import disturbed

# Motions of one side in all trials of a block, and the fewest trials worth a call.
MOTIONS, FEWEST = 8192, 32
# Determinant of H over that of the matrix of equal singular values and equal norm, below which the SVD decides.
FLAT = 1e-4
# Cofactor (i, j) is the product of two entries less that of two others.
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
    """Errors xi (trials, 6) of 4DPA's X on so many draws, and which trials determine it (the others are rows of 0).

    A, B (N, 4, 4) are true motions that fit X (4, 4). Numbers depend on the generator and on N only.
    """
    N = len(A)
    L_A, L_B = noise.factors
    true_A, true_B = Side.of(A, None, L_A), Side.of(B, X[:3, :3], L_B)
    moments = np.zeros((2, 3, 3, trials))
    pairs = max(1, min(N, MOTIONS // FEWEST))
    step = max(FEWEST, MOTIONS // N)
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


# ---------------------------------------------------------------------------- motions by components


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


# Poses or motions of all trials of a block together.
BLOCK = 16_384


class Trials(NamedTuple):
    """Errors ``xi = (theta, tau)`` of X in each trial; those that failed have a row of zeros and are not ``ok``."""

    errors: Array  # (m, 6)
    ok: NDArray[np.bool_]  # (m,)
    covariances: Array | None = None  # (m, 6, 6), each trial's own; identity where it is not ok


class Estimates(NamedTuple):
    """X of some trials (m, 4, 4), whether they converged, and each one's covariance (m, 6, 6) if asked for."""

    X: Array
    ok: NDArray[np.bool_]
    covariances: Array | None


def run(experiment: Experiment, rng: np.random.Generator, trials: int, each: bool = False) -> Trials:
    """Draw the noise ``trials`` times and run the method on each draw.

    Parameters
    ----------
    experiment : Experiment
    rng : numpy Generator
    trials : int
    each : bool
        Also the first-order covariance that each trial would report of itself.

    Returns
    -------
    Trials

    Raises
    ------
    InputError
        The method cannot be run on such data at all, or has no covariance.
    """
    noise = experiment.noise
    if experiment.plain_motions and noise.prior is None and not each:
        return Trials(*fourdpa_on_drawn(*experiment.sides, experiment.X, noise, rng, trials))  # type: ignore[arg-type]
    step = max(1, BLOCK // experiment.size)
    parts = []
    for first in range(0, trials, step):
        problem, batch = experiment, (min(step, trials - first),)
        if noise.prior is not None:  # its means are measured, too
            drawn = noise.prior.drawn(experiment.X, experiment.W, batch, rng)
            problem = replace(experiment, noise=with_prior(noise, drawn))
        pairs = zip(experiment.sides, covariances_of(noise), strict=True)
        one, other = (disturbed(T, S, batch, rng) for T, S in pairs)
        parts.append(estimates(problem, one, other, each))
    return errors_of(experiment, _joined(parts))


def errors_of(experiment: Experiment, found: Estimates) -> Trials:
    """``(log(R_hat R^T), t_hat - t)`` of the estimates."""
    errors = difference(found.X, experiment.X)
    errors[~found.ok] = 0.0
    return Trials(errors, found.ok, found.covariances)


def _joined(parts: list[Estimates]) -> Estimates:
    X, ok, covariances = zip(*parts, strict=True)
    return Estimates(
        np.concatenate(X), np.concatenate(ok), None if covariances[0] is None else np.concatenate(covariances)
    )


def estimates(experiment: Experiment, first: Array, second: Array, each: bool) -> Estimates:
    """The method on disturbed poses or motions (m, n, 4, 4) of robot and camera.

    A method refuses a whole batch for one bad trial; the batch is then halved until that one is alone.
    """
    try:
        return _estimates(experiment, first, second, each)
    except (InputError, np.linalg.LinAlgError):
        m, prior = len(first), experiment.noise.prior
        if m == 1:
            true_first, true_second = experiment.sides
            _estimates(
                experiment, true_first[None], true_second[None], each
            )  # raises where it is no matter of the draw
            return Estimates(np.eye(4)[None], np.zeros(1, dtype=bool), np.eye(6)[None] if each else None)
    found = []
    for part in (slice(m // 2), slice(m // 2, m)):
        problem = experiment
        if prior is not None:  # with the means as they were drawn in these trials
            problem = replace(experiment, noise=with_prior(experiment.noise, prior.rows(part)))
        found.append(estimates(problem, first[part], second[part], each))
    return _joined(found)


def _estimates(experiment: Experiment, first: Array, second: Array, each: bool) -> Estimates:
    method, noise = experiment.method, experiment.noise
    every = np.ones(len(first), dtype=bool)
    data = experiment.measured(first, second)
    if method in ESTIMATORS:
        steps = CLOSED_FORM_STEPS if method == "efficient" else MOST_STEPS
        found = fit_data(data, constraint_of(data, noise), noise, steps)
        return Estimates(found.X, np.asarray(found.converged), found.covariance_X if each else None)
    poses = data.poses
    if poses is not None and method in ROBOT_WORLD_METHODS:
        both = ROBOT_WORLD_METHODS[method]
        if not each:
            return Estimates(both(poses).X, every, None)
        single = (PosePairs(*sides, poses.setup) for sides in zip(first, second, strict=True))  # no leading axes
        own = [covariance_of_poses(both.sensitivities(one)[0], noise) for one in single]  # type: ignore[arg-type]
        return Estimates(both(poses).X, every, np.stack(own))
    if poses is not None and experiment.everything is not None and not each:
        return Estimates(solve_all_pairs(poses), every, None)
    motions = motions_of(data, experiment.choice)
    if method == "4dpa":
        X, ok = solve_4dpa(motions.A, motions.B, experiment.scale), every
    else:
        estimate = METHODS[method].estimate(motions.A, motions.B, experiment.weights)
        X, ok = estimate.X, np.asarray(estimate.converged)
    if not each:
        return Estimates(X, ok, None)
    return Estimates(X, ok, propagate_and_check(motions, noise=noise, X=X, method=method, scale=experiment.scale)[0])
