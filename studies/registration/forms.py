"""Registration by eigenvectors and by singular value decomposition: agreement, (14) as printed, and time.

Model: `studies.registration`. Points (..., N, n), ``H = sum (u - mean u)(v - mean v)^T`` (15) for v = R u + t.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.symbolic import functions as closed_form

POINTS = 20
NOISE = 5e-3  # m
SVD, SCIPY = "SVD (uq.register)", "SciPy align_vectors, one by one"


def correlation(U: Array, V: Array) -> Array:
    """H (15) of points (..., N, n)."""
    return np.asarray((U - U.mean(axis=-2, keepdims=True)).mT @ (V - V.mean(axis=-2, keepdims=True)))


def by_W(H: Array) -> Array:
    """(24): the eigenvector of the largest eigenvalue of W."""
    return np.asarray(closed_form.sigma_to_R(np.linalg.eigh(closed_form.W(H))[1][..., -1]))


def by_K(H: Array) -> Array:
    """The same from the leading singular vectors of K, which W is made of."""
    left, _, right = np.linalg.svd(closed_form.K(H))
    return np.asarray(closed_form.R_L(left[..., 0]) @ closed_form.R_R(right[..., 0, :]))


def by_KTK(H: Array) -> Array:
    """(26): the eigenvector q_R of the largest eigenvalue of K^T K, and q_L = K q_R."""
    K = closed_form.K(H)
    q_R = np.linalg.eigh(K.mT @ K)[1][..., -1]
    q_L = (K @ q_R[..., None])[..., 0]
    return np.asarray(closed_form.R_L(q_L / np.linalg.norm(q_L, axis=-1, keepdims=True)) @ closed_form.R_R(q_R))


CONJUGATE = np.diag([1.0, -1.0, -1.0, -1.0])


def davenport(H: Array) -> Array:
    """Davenport's matrix (..., 4, 4), scalar part first: ``q^T D q = tr(R H)`` for R(q) in SO(3), H = sum u v^T.

    From K of H bordered with zeros: with q_L = q and q_R = conj(q), (16) turns the last three coordinates.
    """
    bordered = np.zeros((*H.shape[:-2], 4, 4))
    bordered[..., 1:, 1:] = H
    D = closed_form.K(bordered) @ CONJUGATE
    return np.asarray(0.5 * (D + D.mT))


def textbook_davenport(H: Array) -> Array:
    """The same as it is written in attitude determination: B = H^T, ``[[tr B, z^T], [z, B + B^T - tr(B) I]]``."""
    B = H.mT
    trace = np.trace(B, axis1=-2, axis2=-1)[..., None]
    D = np.empty((*H.shape[:-2], 4, 4))
    D[..., 0, 0] = trace[..., 0]
    # R carries u onto v, so that z is that of B^T
    D[..., 0, 1:] = D[..., 1:, 0] = -np.stack(
        [B[..., 1, 2] - B[..., 2, 1], B[..., 2, 0] - B[..., 0, 2], B[..., 0, 1] - B[..., 1, 0]], axis=-1
    )
    D[..., 1:, 1:] = B + B.mT - trace[..., None] * np.eye(3)
    return D


def rotation_of(q: Array) -> Array:
    """(..., 4), scalar first, to (..., 3, 3)."""
    return np.asarray(Rotation.from_quat(q.reshape(-1, 4), scalar_first=True).as_matrix().reshape(*q.shape[:-1], 3, 3))


def by_davenport(H: Array) -> Array:
    """3-D: the q-method."""
    return rotation_of(np.linalg.eigh(davenport(H))[1][..., -1])


def by_bordered_W(H: Array) -> Array:
    """3-D through the 4-D form: W of H bordered with zeros. SO(4) holds diag(-1, reflection) too."""
    bordered = np.zeros((*H.shape[:-2], 4, 4))
    bordered[..., 1:, 1:] = H
    return by_W(bordered)[..., 1:, 1:]


Form = Callable[[Array], Array]
FORMS: dict[int, dict[str, Form]] = {
    4: {"W, 8x8 (24)": by_W, "K, 4x4": by_K, "K^T K (26)": by_KTK},
    3: {"Davenport, 4x4": by_davenport, "W of bordered H": by_bordered_W},
}


def svd(H: Array) -> Array:
    """The textbook: V diag(1, .., det(V U^T)) U^T of H = U S V^T."""
    return uq.orthonormalise(H.mT)


# ------------------------------------------------------------------------------------------------ agreement and time


def rotations(rng: np.random.Generator, n: int, trials: int) -> Array:
    """(trials, n, n), uniform on SO(n)."""
    Q, R = np.linalg.qr(rng.normal(size=(trials, n, n)))
    Q = Q * np.sign(np.diagonal(R, axis1=1, axis2=2))[:, None]
    Q[..., 0] *= np.linalg.det(Q)[:, None]
    return np.asarray(Q)


CASES = {
    "generic": "20 points",
    "n - 1 directions": "all in a plane through 0 (3-D), in a space of 3 dimensions (4-D)",
    "n - 2 directions": "all on a line (3-D), in a plane (4-D)",
    "mirrored": "the second set is a reflection of the first",
    "noise only": "two sets that have nothing to do with each other",
}


def point_sets(rng: np.random.Generator, n: int, case: str, trials: int) -> tuple[Array, Array]:
    U = rng.normal(size=(trials, POINTS, n))
    if case in ("n - 1 directions", "n - 2 directions"):
        U[..., n - int(case[4]) :] = 0.0
        U = U @ rotations(rng, n, trials)  # not along the axes
    R, t = rotations(rng, n, trials), rng.normal(size=(trials, 1, n))
    V = U @ R.mT + t
    if case == "mirrored":
        V[..., 0] *= -1
    elif case == "noise only":
        V = rng.normal(size=V.shape)
    if case == "generic":
        V += NOISE * rng.normal(size=V.shape)
    return U, V


def agreement_rows(rng: np.random.Generator, trials: int) -> Iterator[dict[str, Any]]:
    for n, case in product(FORMS, CASES):
        U, V = point_sets(rng, n, case, trials)
        H = correlation(U, V)
        reference = svd(H)
        cost = np.trace(reference @ H, axis1=1, axis2=2)
        found = {name: form(H) for name, form in FORMS[n].items()}
        if n == 3:
            centred = [P - P.mean(axis=1, keepdims=True) for P in (U, V)]
            with np.errstate(all="ignore"):
                found[SCIPY] = np.array(
                    [align(v, u) for u, v in zip(*centred, strict=True)]  # carries u onto v
                )
        refused = 0
        for k in range(trials):
            try:
                uq.register(U[k], V[k])
            except uq.InputError:
                refused += 1
        for name, R in found.items():
            yield {
                "n": n,
                "points": case,
                "form": name,
                "trials": trials,
                "refused by uq.register": refused,
                "reflections": int((np.linalg.det(R) < 0).sum()),
                "largest difference from SVD": np.abs(R - reference).max(),
                "largest loss of tr(R H), relative": ((cost - np.trace(R @ H, axis1=1, axis2=2)) / np.abs(cost)).max(),
            }


def align(a: Array, b: Array) -> Array:
    """SciPy's rotation that carries b onto a; it warns where it is not unique."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(Rotation.align_vectors(a, b)[0].as_matrix())


def printed_rows(rng: np.random.Generator, trials: int) -> Iterator[dict[str, Any]]:
    """(14) as printed, with H of (15): which rotation it is."""
    for n in FORMS:
        U, V = point_sets(rng, n, "generic", trials)
        left, _, right = np.linalg.svd(correlation(U, V))
        flip = np.ones((trials, n))
        flip[:, -1] = np.linalg.det(left @ right.mT)  # det(U V), as printed
        printed = (left * flip[:, None]) @ right
        R, _ = uq.register(U, V)
        residuals = {}
        for name, turn in (("printed", printed), ("transposed", printed.mT)):
            shift = V.mean(axis=1) - (turn @ U.mean(axis=1)[..., None])[..., 0]
            residuals[name] = np.sqrt(np.mean((U @ turn.mT + shift[:, None] - V) ** 2))
        yield {
            "n": n,
            "trials": trials,
            "det(U V) less det(U V^T)": np.abs(flip[:, -1] - np.linalg.det(left @ right)).max(),
            "RMS residual as printed (m)": residuals["printed"],
            "RMS residual transposed (m)": residuals["transposed"],
            "noise (m)": NOISE,
            "largest difference of the transpose from uq.register": np.abs(printed.mT - R).max(),
        }


def best_time(work: Callable[[], object], repeats: int) -> float:
    """Seconds of the fastest of so many runs."""
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return min(times)


def by_form(form: Form, U: Array, V: Array) -> tuple[Array, Array]:
    """R and t of points (..., N, n) through H."""
    R = form(correlation(U, V))
    return R, V.mean(axis=-2) - (R @ U.mean(axis=-2)[..., None])[..., 0]


def one_by_one(U: Array, V: Array) -> list[Any]:
    """SciPy's rotations, which it has no batch for."""
    return [Rotation.align_vectors(v - v.mean(axis=0), u - u.mean(axis=0)) for u, v in zip(U, V, strict=True)]


def time_rows(rng: np.random.Generator, batches: tuple[int, ...], repeats: int) -> Iterator[dict[str, Any]]:
    """Yield the times from the points to R and t; the one-by-one loop of SciPy over 100 problems at most."""
    for n, batch in product(FORMS, batches):
        U, V = point_sets(rng, n, "generic", batch)
        works: dict[str, Callable[[], object]] = {
            SVD: partial(uq.register, U, V),
            "SVD of H alone": partial(by_form, svd, U, V),
        }
        works |= {name: partial(by_form, form, U, V) for name, form in FORMS[n].items()}
        times = {name: best_time(work, repeats) for name, work in works.items()}
        if n == 3:
            some = min(batch, 100)
            times[SCIPY] = best_time(partial(one_by_one, U[:some], V[:some]), min(repeats, 3)) * batch / some
        for name, seconds in times.items():
            yield {
                "n": n,
                "batch": batch,
                "form": name,
                "time per problem (ms)": 1e3 * seconds / batch,
                "time / SVD": seconds / times[SVD],
            }
