"""First-order covariance of a registration, and attitude determination as what 4DPA comes down to.

Model: `studies.registration`. Errors of (R, t): ``R = exp(sum_k omega_k E_k) R_true``, E_k a basis of so(n), in 3-D
that of the rotation vector; ``t = t_true + tau``; rad and m.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.geometries import random_transforms
from studies.common.scores import nees
from studies.registration.forms import CONJUGATE, FORMS, NOISE, POINTS, rotation_of, rotations, textbook_davenport
from uq_handeye.core.geometry.se3 import Array, inverse, skew
from uq_handeye.symbolic import functions as closed_form
from uq_handeye.trials.simulation.rig import disturbed

PAIRS = 60
SCALES = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8)


def generators(n: int) -> Array:
    """A basis (m, n, n) of so(n), m = n (n - 1) / 2; for n = 3 that of the rotation vector."""
    if n == 3:
        return skew(np.eye(3))
    basis = np.zeros((n * (n - 1) // 2, n, n))
    for k, (i, j) in enumerate(combinations(range(n), 2)):
        basis[k, j, i], basis[k, i, j] = 1.0, -1.0
    return basis


def registration_slopes(U: Array, R: Array) -> Array:
    """``d (omega, tau) / d e_i`` (N, m + n, n) by the residual error e_i of point i, at exact data.

    ``R = exp(sum_k omega_k E_k) R_true``, ``t = t_true + tau`` and ``v_i = R u_i + t + e_i``; an error d_i of u_i
    counts as ``e_i = -R d_i``. With ``y_i = R (u_i - mean u)`` and ``G = sum y_i y_i^T``, that ``sum (v - mean v) y^T``
    stays symmetric gives ``Omega G + G Omega = sum (e_i y_i^T - y_i e_i^T)``, linear in omega; in 3-D, with
    ``M = tr(G) I - G``, it reads ``omega = M^-1 sum y_i x e_i``. Then ``tau = mean e - Omega R mean u``.
    """
    N, n = U.shape
    E = generators(n)
    y, centre = (U - U.mean(axis=0)) @ R.T, R @ U.mean(axis=0)
    G = y.T @ y
    left = np.einsum("kab,lab->kl", E, E @ G + G @ E)  # <E_k, E_l G + G E_l>
    right = 2 * np.einsum("kab,ib->kia", E, y)  # <E_k, e y^T - y e^T> = 2 e^T E_k y
    omega = np.linalg.solve(left, right.reshape(len(E), -1)).reshape(len(E), N, n)
    tau = np.eye(n)[:, None] / N - np.einsum("kab,b,kic->aic", E, centre, omega)
    return np.asarray(np.concatenate([omega, tau]).transpose(1, 0, 2))


def registration_covariance(U: Array, R: Array, S_U: Array | None, S_V: Array) -> Array:
    """Covariance of (omega, tau) for independent errors of the points with S_U, S_V (N, n, n); S_U None: exact."""
    D = registration_slopes(U, R)
    S = S_V if S_U is None else S_V + R @ S_U @ R.T
    return np.asarray((D @ S @ D.mT).sum(axis=0))


def by_octonion(U: Array, R: Array, S: Array) -> Array:
    """Covariance of omega (6, 6) in 4-D by the paper: (39), (42) with M = W and the columns of R by (55).

    ``S`` (N, 4, 4) of the residual errors. Independent errors are added point by point, not averaged as (45) has it.
    """
    y = U - U.mean(axis=0)
    H = y.T @ y @ R.T
    values, vectors = np.linalg.eigh(closed_form.W(H))
    sigma = vectors[:, -1]
    pinv = (vectors[:, :-1] / (values[-1] - values[:-1])) @ vectors[:, :-1].T
    # d H = sum (u_i - mean u) e_i^T, the mean of the errors drops out; W is linear in H
    errors = np.zeros((len(U), 4, 4, 4))
    for a in range(4):
        errors[:, a, :, a] = y
    d_sigma = (pinv @ closed_form.W(errors) @ sigma[:, None])[..., 0].transpose(0, 2, 1)  # (N, 8, 4), (39)
    P = np.stack([getattr(closed_form, f"P_{k}")(sigma) for k in range(1, 5)])
    d_R = 2 * np.einsum("cas,isd->iacd", P, d_sigma)  # columns c of R
    E = generators(4)
    d_omega = 0.5 * np.einsum("kab,iacd,bc->ikd", E, d_R, R)  # dR = Omega R, |E|^2 = 2
    return np.asarray((d_omega @ S @ d_omega.mT).sum(axis=0))


def coordinates(turn: Array) -> Array:
    """omega (..., m) of rotations (..., n, n) near 1: of their logarithm to third order."""
    n = turn.shape[-1]
    E = generators(n)
    A = 0.5 * (turn - turn.mT)
    A = A - A @ A @ A / 6.0  # asin of a skew matrix: sinh^-1 in its eigenvalues
    return np.asarray(0.5 * np.einsum("kab,...ab->...k", E, A))


class Noisy(NamedTuple):
    """One geometry with noise on it."""

    U: Array  # (N, n)
    R: Array  # (n, n)
    S_U: Array | None  # (N, n, n)
    S_V: Array
    errors: Array  # (T, m + n): (omega, tau) of registrations


def full_covariances(rng: np.random.Generator, n: int) -> Array:
    """(N, n, n): axes of 1 to 10 mm in all directions, another for each point."""
    Q = rotations(rng, n, POINTS)
    return np.asarray((Q * (1e-3 * 10 ** rng.uniform(0, 1, (POINTS, 1, n))) ** 2) @ Q.mT)


def noisy(rng: np.random.Generator, n: int, full: bool, trials: int) -> Noisy:
    U, R, t = rng.normal(size=(POINTS, n)) + 1.0, rotations(rng, n, 1)[0], rng.normal(size=n)
    S_U = full_covariances(rng, n) if full else None
    S_V = full_covariances(rng, n) if full else np.broadcast_to(NOISE**2 * np.eye(n), (POINTS, n, n))
    sides = []
    for P, S in ((U, S_U), (U @ R.T + t, S_V)):
        noise = 0.0 if S is None else (np.linalg.cholesky(S) @ rng.normal(size=(trials, POINTS, n, 1)))[..., 0]
        sides.append(np.broadcast_to(P, (trials, POINTS, n)) + noise)
    found, shift = uq.register(*sides)
    return Noisy(U, R, S_U, S_V, np.concatenate([coordinates(found @ R.T), shift - t], axis=1))


def whitened(sample: Array, S: Array) -> Array:
    """Eigenvalues of ``L^-1 sample L^-T``, S = L L^T: 1 if both are one."""
    L = np.linalg.cholesky(S)
    half = np.linalg.solve(L, sample)
    return np.linalg.eigvalsh(np.linalg.solve(L, half.mT)).astype(np.float64)


def eigenvalue_interval(freedom: int, trials: int) -> tuple[float, float]:
    """Holds all whitened eigenvalues of a sample of a consistent covariance, but for chance of about 1 in 1,000."""
    spread = np.sqrt(freedom / trials) + 3.0 / np.sqrt(trials)
    return float((1 - spread) ** 2), float((1 + spread) ** 2)


def covariance_rows(rng: np.random.Generator, trials: int) -> Iterator[dict[str, Any]]:
    for n in FORMS:
        for full in (False, True):
            of = noisy(rng, n, full, trials)
            S = registration_covariance(of.U, of.R, of.S_U, of.S_V)
            mean = np.mean([np.trace(C, axis1=1, axis2=2).mean() / n for C in (of.S_V, of.S_U) if C is not None])
            equal = np.broadcast_to(mean * (2 if full else 1) * np.eye(n), (POINTS, n, n))
            tried = {"first order": S}
            if full:
                tried["wrong: equal for all"] = registration_covariance(of.U, of.R, None, equal)
                tried["wrong: one set left out"] = registration_covariance(of.U, of.R, None, of.S_V)
            else:
                tried["wrong: sd 10 % too small"] = 0.81 * S
            sample = of.errors.T @ of.errors / trials
            for name, C in tried.items():
                values, freedom = whitened(sample, C), len(C)
                yield {
                    "n": n,
                    "noise": "full, both sets" if full else "isotropic, one set",
                    "covariance": name,
                    "trials": trials,
                    "components": freedom,
                    "NEES / components": nees(of.errors, C).mean() / freedom,
                    "least whitened eigenvalue": values[0],
                    "largest whitened eigenvalue": values[-1],
                    "by (39)-(48), relative difference": paper_difference(of, C)
                    if (n, name) == (4, "first order")
                    else np.nan,
                    "closed form sigma^2 M^-1, relative difference": closed_form_difference(of, C)
                    if (n, full, name) == (3, False, "first order")
                    else np.nan,
                }


def paper_difference(of: Noisy, S: Array) -> float:
    residual = of.S_V if of.S_U is None else of.S_V + of.R @ of.S_U @ of.R.T
    return float(np.abs(whitened(by_octonion(of.U, of.R, residual), S[:6, :6]) - 1).max())


def closed_form_difference(of: Noisy, S: Array) -> float:
    y = (of.U - of.U.mean(axis=0)) @ of.R.T
    M = (y**2).sum() * np.eye(3) - y.T @ y
    return float(np.abs(whitened(NOISE**2 * np.linalg.inv(M), S[:3, :3]) - 1).max())


def right_angles(rng: np.random.Generator, N: int) -> Array:
    """Motions (N, 4, 4) by 90 degrees about axes uniform on the sphere, translations of 0.5 m per axis."""
    axis = rng.normal(size=(N, 3))
    axis *= 0.5 * np.pi / np.linalg.norm(axis, axis=1, keepdims=True)
    T = np.tile(np.eye(4), (N, 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(axis).as_matrix()
    T[:, :3, 3] = 0.5 * rng.normal(size=(N, 3))
    return T


def quest(directions: Array, deviation: float) -> Array:
    """Shuster and Oh (1981): covariance of attitude from N unit vectors (N, 3) with ``deviation`` (rad) across them."""
    return np.asarray(
        deviation**2 * np.linalg.inv(len(directions) * np.eye(3) - directions.T @ directions), dtype=float
    )


def sines(T: Array) -> Array:
    """u = sin(angle) axis (N, 3) of T2."""
    return 0.5 * np.stack([T[:, k, j] - T[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], axis=-1)


def noisy_pairs(rng: np.random.Generator) -> tuple[Array, Array]:
    """A, B (PAIRS, 4, 4) with 5 mrad and 5 mm on each."""
    X, B = random_transforms(rng, ()), random_transforms(rng, (PAIRS,))
    A = X @ B @ inverse(X)
    S = (5e-3) ** 2 * np.eye(6)
    return disturbed(A, S, (), rng), disturbed(B, S, (), rng)


def problem2_difference(E: Array, Z: Array) -> tuple[float, float]:
    """F11, F22 (35) against ``4 (|E|^2 + |Z|^2) I - 32 (a_0 b_0 I + Davenport)``, relative to the largest entry of what
    is left of them beside the unit matrix; and q_L, q_R converted into 3-D rotations against SciPy's."""
    size = 4 * (np.sum(E**2) + np.sum(Z**2)) * np.eye(4)
    worst, angles = 0.0, 0.0
    for F, (p, q), sign in (
        (closed_form.F11(E, Z), (closed_form.a_left(E), closed_form.a_left(Z)), 1.0),
        (closed_form.F22(E, Z), (closed_form.c_right(E), closed_form.c_right(Z)), -1.0),
    ):
        F = F.sum(axis=0)
        # q_L turns the vector parts of b onto those of a, conj(q_R) those of e onto c
        D = textbook_davenport(q[:, 1:].T @ p[:, 1:])
        if sign < 0:
            D = CONJUGATE @ D @ CONJUGATE
        D = D + (p[:, 0] @ q[:, 0]) * np.eye(4)
        worst = max(worst, float(np.abs(size - 32 * D - F).max() / np.abs(32 * D).max()))
        smallest = np.linalg.eigh(F)[1][:, 0] * np.r_[1.0, sign * np.ones(3)]
        R = rotation_of(smallest)
        other = Rotation.align_vectors(p[:, 1:], q[:, 1:])[0].as_matrix()
        angles = max(angles, float(np.linalg.norm(Rotation.from_matrix(R @ other.T).as_rotvec())))
    return worst, angles


def wahba_rows(rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """4DPA's rotation against Wahba's problem on (u, v) by SciPy, over d; and Problem 2 as Davenport's matrices."""
    A, B = noisy_pairs(rng)
    R = Rotation.align_vectors(sines(A), sines(B))[0].as_matrix()
    for d in (*SCALES, np.inf):
        X = uq.solve(A, B, scale=None if np.isinf(d) else d)
        row = {
            "d": d,
            "pairs": PAIRS,
            "from Wahba on (u, v) (rad)": np.linalg.norm(Rotation.from_matrix(X[:3, :3] @ R.T).as_rotvec()),
        }
        if np.isfinite(d):
            E, Z = (uq.so4_from_se3(T, d) for T in (A, B))
            row["Davenport's matrix, relative difference"], row["q-method, from SciPy (rad)"] = problem2_difference(
                E, Z
            )
        yield row


def quest_rows(rng: np.random.Generator, trials: int) -> Iterator[dict[str, Any]]:
    """QUEST's covariance against 4DPA's rotation block and its Monte Carlo: motions by 90 degrees, and by others."""
    deviation = 1e-3  # rad per axis of the rotation of every A and B
    noise = uq.PairNoise(*(deviation**2 * np.diag([1.0] * 3 + [1e-12] * 3) for _ in range(2)))
    for name in ("90 degrees", "23 to 149 degrees"):
        B = right_angles(rng, PAIRS) if name == "90 degrees" else random_transforms(rng, (PAIRS,))
        X = random_transforms(rng, ())
        A = X @ B @ inverse(X)
        S = uq.propagate(A, B, noise, X=X)[:3, :3]
        u, cosine = sines(A), 0.5 * (np.trace(A[:, :3, :3], axis1=1, axis2=2) - 1)
        # at 90 degrees u moves by deviation / sqrt(2) along each axis perpendicular to it, and so does v
        axis = u / np.linalg.norm(u, axis=1, keepdims=True)
        predicted = quest(axis, deviation)
        # at any angle u moves by deviation sqrt((1 + cos) / 2) along them: Wahba's problem with weights sin^2
        across = np.eye(3) - axis[:, :, None] * axis[:, None, :]
        M_inverse = np.linalg.inv(np.tensordot(1 - cosine**2, across, 1))
        weighted = deviation**2 * M_inverse @ np.tensordot((1 - cosine**2) * (1 + cosine), across, 1) @ M_inverse
        best = deviation**2 * np.linalg.inv(np.tensordot(1 - cosine, across, 1))  # weights 1 / variance of the axes
        e = np.concatenate(
            [
                coordinates(
                    uq.solve(disturbed(A, noise.A, (some,), rng), disturbed(B, noise.B, (some,), rng))[:, :3, :3]
                    @ X[:3, :3].T
                )
                for some in [1000] * (trials // 1000)
            ]
        )
        values = whitened(e.T @ e / len(e), predicted)
        yield {
            "motions": name,
            "pairs": PAIRS,
            "trials": len(e),
            "QUEST from 4DPA's, relative": np.abs(whitened(predicted, S) - 1).max(),
            "weights sin^2 from 4DPA's, relative": np.abs(whitened(weighted, S) - 1).max(),
            "largest sd / best weights": np.sqrt(whitened(S, best)[-1]),
            "NEES / 3 with 4DPA's": nees(e, S).mean() / 3,
            "NEES / 3 with QUEST's": nees(e, predicted).mean() / 3,
            "least whitened eigenvalue": values[0],
            "largest whitened eigenvalue": values[-1],
        }
