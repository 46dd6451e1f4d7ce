"""Choice of the scaling factor d of 4DPA (section III-D and Table V).

Rigs are drawn at random: 60 pairs, angles from 0.4 to 2.6 rad about axes of any direction, normal translations that
are scaled to a root mean square of 1 mm, 1 m, 10 m and 100 m over all A and B of a rig, the same rigs for each length.
At every d from 1e1 to 1e8 m, half a decade apart, X comes from the paper's route, (51), (33)-(35) and back, and its
covariance from (39)-(48), (53)-(59) with the sum over independent pairs, once by the derivatives of X and once as
printed, that of the octonion (48) first and from it that of X; in double and in single precision: data, images, sums,
eigenvectors, everything (`single_precision`). Reference is the toolkit's limit d to infinity (T2, T3) in double
precision, on the same data (in single precision: after their rounding), and the true X. Data are exact, or carry noise
of 1 mrad and a thousandth of the length per axis of every A and B, for which also the covariance is. 200 rigs (quick:
8), seed 2019. The paper's Table V is of a trajectory whose data are not published; here X is known.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

import uq_handeye as uq
from studies.common.geometries import random_transforms
from studies.common.study import Study
from studies.scaling_factor import single_precision as route
from studies.scaling_factor.curves import CLAIMED, LENGTHS, NOISE, PRECISIONS, SCALES
from studies.scaling_factor.figures import figures
from studies.scaling_factor.findings import findings
from uq_handeye.core.geometry.se3 import Array, inverse, logarithm, perturb
from uq_handeye.core.progress import progress_bar

SEED = 2019
PAIRS = 60


class Rigs(NamedTuple):
    """True X (T, 4, 4), A and B (T, N, 4, 4); the root mean square translation of A and B is 1 in each rig."""

    X: Array
    A: Array
    B: Array


def rigs(trials: int, rng: np.random.Generator) -> Rigs:
    X, B = random_transforms(rng, (trials,)), random_transforms(rng, (trials, PAIRS))
    A = X[:, None] @ B @ inverse(X)[:, None]
    length = np.sqrt(np.mean([(T[..., :3, 3] ** 2).sum(axis=-1) for T in (A, B)], axis=(0, 2)))
    for T in (X, A, B):
        T[..., :3, 3] /= length.reshape(-1, *[1] * (T.ndim - 2))
    return Rigs(X, A, B)


def scaled(T: Array, length: float) -> Array:
    """The same with translations times ``length``."""
    T = T.copy()
    T[..., :3, 3] *= length
    return T


def cells(trials: int) -> Iterator[dict[str, object]]:
    """One row per precision, noise, length and d; d is empty for the limit."""
    rng = np.random.default_rng(SEED)
    exact = rigs(trials, rng)
    noisy = Rigs(exact.X, *(perturb(T, NOISE * rng.standard_normal((*T.shape[:2], 6))) for T in exact[1:]))
    for noise, data in (("none", exact), ("1 mrad, length / 1000", noisy)):
        for length in LENGTHS:
            truth, A, B = (scaled(T, length) for T in data)
            deviations = NOISE * np.repeat([1.0, length], 3)
            variances = np.diag(deviations**2)
            for precision, dtype in PRECISIONS.items():
                given = (A.astype(dtype), B.astype(dtype))
                as_double = (given[0].astype(np.float64), given[1].astype(np.float64))
                reference = uq.solve(*as_double)
                exact_S = uq.propagate(*as_double, uq.PairNoise(variances, variances), X=reference)
                whitener = np.linalg.inv(np.linalg.cholesky(exact_S))
                about = {"precision": precision, "noise": noise, "length_m": length}
                for d in (None, *SCALES):
                    if d is None:
                        X = route.limit(*given)
                        S = printed = route.limit_covariance(*given, X, deviations)
                    else:
                        octonion = route.problem_2(*given, d)
                        X = route.remapped(octonion, d)
                        linear = route.linear(*given, octonion, d, deviations)
                        S, printed = linear.covariance(), linear.printed()
                    assert X.dtype == S.dtype == printed.dtype == dtype
                    yield about | {"d_m": d} | scores(X, (S, printed), reference, whitener, truth, A, B)


def scores(
    X: route.Real,
    covariances: tuple[route.Real, route.Real],
    reference: Array,
    whitener: Array,
    truth: Array,
    A: Array,
    B: Array,
) -> dict[str, float]:
    """Score X (T, 4, 4) and its covariance (T, 6, 6) in two orders of work: distance from the limit (medians),
    error, (62), and how many keep the claim.
    """
    X = X.astype(np.float64)
    apart = [
        float(np.median(np.abs(np.linalg.eigvalsh(whitener @ S.astype(np.float64) @ whitener.mT) - 1).max(axis=1)))
        for S in covariances
    ]
    off, error = (
        np.concatenate([logarithm(X[:, :3, :3] @ T[:, :3, :3].mT), X[:, :3, 3] - T[:, :3, 3]], axis=1)
        for T in (reference, truth)
    )
    residual = A @ X[:, None] - X[:, None] @ B
    distance = np.linalg.norm(error[:, 3:], axis=1)
    return {
        "rotation_from_limit_rad": float(np.median(np.linalg.norm(off[:, :3], axis=1))),
        "translation_from_limit_m": float(np.median(np.linalg.norm(off[:, 3:], axis=1))),
        "covariance_from_limit": apart[0],
        "printed_covariance_from_limit": apart[1],
        "rotation_error_median_rad": float(np.median(np.linalg.norm(error[:, :3], axis=1))),
        "translation_error_median_m": float(np.median(distance)),
        "rotation_error_rms_rad": float(np.sqrt((error[:, :3] ** 2).sum(axis=1).mean())),
        "translation_error_rms_m": float(np.sqrt((distance**2).mean())),
        "translation_error_largest_m": float(distance.max()),
        "within_claim": int((distance <= CLAIMED).sum()),
        "error_62": float(np.mean(np.sqrt((residual**2).sum(axis=(1, 2, 3))) / PAIRS)),
        "rigs": len(X),
        "pairs": PAIRS,
    }


def measure(full: bool) -> dict[str, pd.DataFrame]:
    trials = 200 if full else 8
    total = 2 * len(LENGTHS) * len(PRECISIONS) * (1 + len(SCALES))
    rows = []
    with progress_bar("d", total, "cells") as advance:
        for row in cells(trials):
            rows.append(row)
            advance(1)
    return {"accuracy": pd.DataFrame(rows)}


STUDY = Study("scaling_factor", measure, findings, figures)
