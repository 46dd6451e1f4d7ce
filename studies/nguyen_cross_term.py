"""Nguyen and Pham's cross-covariance in the translation stage, derived against published, by Monte Carlo.

    python -m studies.nguyen_cross_term

Prints the tables of docs/explanation/nguyen_pham.md, with a fixed seed, in less than a minute. NEES of t is ``e^T
Sigma_t^-1 e`` of the error of the translation; its mean is 3 if Sigma_t is true. Data sets that did not converge are
left out of it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.geometries import random_transforms
from uq_handeye.estimators.nguyen import nguyen
from uq_handeye.estimators.nguyen_derivatives import NguyenDerivatives
from uq_handeye.estimators.nguyen_descent import Stop
from uq_handeye.estimators.nguyen_stages import CrossTerm, NguyenResult
from uq_handeye.se3 import Array, inverse, perturb

SEED = 2018
KINDS: tuple[CrossTerm, ...] = ("derived", "published")
STOPS: tuple[Stop, ...] = ("scaled", "published")


def noisy(rng: np.random.Generator, T: Array, sd: Array) -> Array:
    return perturb(T, sd * rng.normal(size=(*T.shape[:-2], 6)))


def in_unit(T: Array, unit: float) -> Array:
    T = T.copy()
    T[..., :3, 3] *= unit
    return T


def label(rotation: float, translation: float) -> str:
    return f"{1e3 * rotation:g} mrad, {1e3 * translation:g} mm"


def deviations(rotation: float, translation: float) -> Array:
    """Of xi = (theta, tau), rad and m."""
    return np.repeat([rotation, translation], 3)


def mean_nees(errors: Array, Sigma: Array) -> float:
    return float(np.mean(np.einsum("ti,ti->t", errors, np.linalg.solve(Sigma, errors[:, :, None])[:, :, 0])))


def nees_of_t(result: NguyenResult, X: Array) -> float:
    """NaN if nothing converged."""
    ok = result.converged
    if not ok.any():
        return float("nan")
    return mean_nees((result.X[:, :3, 3] - X[..., :3, 3])[ok], result.Sigma_t[ok])


def nees_of_X(result: NguyenResult, X: Array, A: Array, B: Array, noise: uq.PairNoise) -> float:
    """Of the whole X with its 6x6 covariance from `NguyenDerivatives`; should be 6."""
    derivatives = NguyenDerivatives(result, noise)
    F = derivatives.block(A, B)
    Q = derivatives.weight(A.shape[1])
    Sigma = Q @ sum(
        np.einsum("ijtm,jk,lktm->til", side, S, side, optimize=True)
        for side, S in zip(F, (noise.A, noise.B), strict=True)
        if S is not None
    )
    Sigma = Sigma @ Q.mT
    theta = Rotation.from_matrix(result.X[:, :3, :3] @ X[..., :3, :3].mT).as_rotvec()
    return mean_nees(np.concatenate([theta, result.X[:, :3, 3] - X[..., :3, 3]], axis=1), Sigma)


def own_geometries() -> None:
    print("Each data set with a geometry of its own; equal noise on A and B.\n")
    print(
        "| pairs | noise | data sets | derived: converged | NEES of t | published: converged | NEES of t | NEES of X |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for row, (N, rotation, translation, trials) in enumerate(
        [
            (3, 1e-4, 1e-4, 5000),
            (3, 1e-4, 3e-5, 5000),
            (5, 1e-4, 1e-4, 5000),
            (5, 1e-4, 3e-5, 5000),
            (5, 1e-4, 1e-5, 5000),
            (10, 1e-4, 1e-4, 5000),
            (10, 1e-4, 3e-5, 5000),
            (60, 1e-4, 1e-4, 5000),
            (60, 1e-4, 1e-5, 5000),
        ]
    ):
        rng = np.random.default_rng([SEED, 1, row])
        X, B = random_transforms(rng, (trials, 1)), random_transforms(rng, (trials, N))
        A, X = X @ B @ inverse(X), X[:, 0]
        sd = deviations(rotation, translation)
        noise = uq.PairNoise(np.diag(sd**2), np.diag(sd**2))
        a, b = noisy(rng, A, sd), noisy(rng, B, sd)
        derived, published = (nguyen(a, b, noise, cross_term=kind) for kind in KINDS)
        print(
            f"| {N} | {label(rotation, translation)} | {trials} | {100 * derived.converged.mean():.1f} %"
            f" | {nees_of_t(derived, X):.2f} | {100 * published.converged.mean():.1f} % | {nees_of_t(published, X):.2f}"
            f" | {nees_of_X(derived, X, a, b, noise):.2f} |"
        )


def one_geometry() -> None:
    print("\nOne geometry of 60 pairs, 500 data sets; star: all B have the same translation (0.3, 0, 0.4) m.\n")
    print("| geometry | noise | cross term | stop | converged | mean iterations R, t | NEES of t | NEES of X |")
    print("|---|---|---|---|---|---|---|---|")
    for row, (star, rotation, translation) in enumerate(
        [(False, 1e-3, 1e-3), (False, 1e-2, 1e-4), (True, 1e-3, 1e-4), (True, 1e-2, 1e-4)]
    ):
        rng = np.random.default_rng([SEED, 2, row])
        X, B = random_transforms(rng, ()), random_transforms(rng, (60,))
        if star:
            B[:, :3, 3] = [0.3, 0.0, 0.4]
        A = X @ B @ inverse(X)
        sd = deviations(rotation, translation)
        noise = uq.PairNoise(np.diag(sd**2), np.diag(sd**2))
        a, b = (noisy(rng, np.broadcast_to(T, (500, 60, 4, 4)), sd) for T in (A, B))
        for kind in KINDS:
            for stop in STOPS:
                result = nguyen(a, b, noise, cross_term=kind, stop=stop)
                whole = f"{nees_of_X(result, X, a, b, noise):.2f}" if kind == "derived" else "-"
                of_t = f"{nees_of_t(result, X):.2f}" if result.converged.any() else "-"
                turns, shifts = result.iterations.mean(axis=0)
                print(
                    f"| {'star' if star else 'random'} | {label(rotation, translation)} | {kind} |"
                    f" {stop} | {result.converged.sum()} | {turns:.1f}, {shifts:.1f} | {of_t} | {whole} |"
                )


def units() -> None:
    print("\nUnits: 60 pairs, 150 data sets of one geometry, in metres, millimetres, and nanometres.\n")
    print("| noise | stop | unit | converged | mean iterations R, t |")
    print("|---|---|---|---|---|")
    for row, (rotation, translation) in enumerate([(1e-2, 1e-3), (0.3, 0.1)]):
        rng = np.random.default_rng([SEED, 3, row])
        X, B = random_transforms(rng, ()), random_transforms(rng, (60,))
        A = X @ B @ inverse(X)
        sd = deviations(rotation, translation)
        a, b = (noisy(rng, np.broadcast_to(T, (150, 60, 4, 4)), sd) for T in (A, B))
        for stop in STOPS:
            for name, unit in (("m", 1.0), ("mm", 1e3), ("nm", 1e9)):
                S = np.diag((sd * deviations(1.0, unit)) ** 2)
                result = nguyen(in_unit(a, unit), in_unit(b, unit), uq.PairNoise(S, S), stop=stop)
                turns, shifts = result.iterations.mean(axis=0)
                print(
                    f"| {label(rotation, translation)} | {stop} | {name} | {result.converged.sum()} |"
                    f" {turns:.2f}, {shifts:.2f} |"
                )


def main() -> None:
    own_geometries()
    one_geometry()
    units()


if __name__ == "__main__":
    main()
