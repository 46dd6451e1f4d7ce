"""Data, noise (63) and (64), methods and scores of the study `figures_3_4`.

Model: ``A_i X = X B_i``, errors of X as ``xi = (theta, tau)``: left rotation in rad, additive translation in m.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import uq_handeye as uq
from studies.common.geometries import random_transforms
from uq_handeye.core.geometry.nearest_rotation import orthonormalise
from uq_handeye.core.geometry.se3 import Array, inverse, logarithm
from uq_handeye.fit.graph.gauss_helmert import efficient

LEVELS = 10.0 ** np.arange(-6.0, -0.75, 0.5)
KINDS = ("rotation", "translation")  # Figs. 3 and 4
SCALES = {"4dpa, d = 1e3": 1e3, "4dpa, d = 1e4": 1e4, "4dpa, d = 1e5": 1e5, "4dpa, d = 1e6": 1e6}  # m
FINITE = tuple(SCALES)
LIMIT = "4dpa"
OPTIMISING = ("heller", "zhang", "zhao")  # of the paper's comparison
PAPER = ("tsai", "chou", "park", "daniilidis", "andreff", *OPTIMISING, *SCALES)
OURS = ("gwak", "condurache", "nguyen", "efficient", LIMIT)
METHODS = (*PAPER, *OURS)
TOLD = 1e-3  # deviation that is assumed where there is no noise, by that of the other kind (m per rad, rad per m)


class Data(NamedTuple):
    X: Array  # (T, 4, 4)
    A: Array  # (T, N, 4, 4), with noise
    B: Array


def exact(repeats: int, pairs: int, rng: np.random.Generator) -> Data:
    X, B = random_transforms(rng, (repeats,)), random_transforms(rng, (repeats, pairs))
    return Data(X, X[:, None] @ B @ inverse(X)[:, None], B)


def disturbed(data: Data, kind: str, level: float, rng: np.random.Generator) -> Data:
    """(63) or (64) on A and on B; ``level`` is the paper's Error_R or Error_t (m)."""
    sides = []
    for T in data[1:]:
        T = T.copy()
        if kind == "rotation":
            noise = rng.standard_normal((*T.shape[:-2], 3, 3))
            T[..., :3, :3] = orthonormalise(T[..., :3, :3] + level * noise)
        else:
            T[..., :3, 3] += level * rng.standard_normal((*T.shape[:-2], 3))
        sides.append(T)
    return Data(data.X, *sides)


def assumed(kind: str, level: float) -> uq.PairNoise:
    """Return the noise of (63) or (64) as it is given to methods that weight by noise."""
    deviation = level / np.sqrt(2.0) if kind == "rotation" else level
    both = (deviation, TOLD * deviation) if kind == "rotation" else (TOLD * deviation, deviation)
    S = np.diag(np.repeat(both, 3) ** 2)
    return uq.PairNoise(S, S)


def estimated(method: str, A: Array, B: Array, noise: uq.PairNoise) -> tuple[Array, NDArray[np.bool_]]:
    """X (T, 4, 4), and whether each converged."""
    if method in SCALES:
        return uq.solve(A, B, scale=SCALES[method]), np.ones(len(A), dtype=bool)
    if method == "efficient":
        return efficient(uq.Motions(A, B), noise).X, np.ones(len(A), dtype=bool)
    found = uq.METHODS[method]
    estimate = found.estimate(A, B, noise if found.weighted else None)
    return estimate.X, estimate.converged


def scores(X: Array, ok: NDArray[np.bool_], data: Data, least: Array) -> dict[str, float]:
    """Over the repeats that converged; ``least`` (T,) is the smallest (62) that any X has, that of `gwak`."""
    theta = logarithm(X[:, :3, :3] @ data.X[:, :3, :3].mT)[ok]
    tau = np.asarray((X - data.X)[ok, :3, 3])
    of_62 = error_62(X, data)[ok]
    excess = 100 * (of_62 / least[ok] - 1)
    count = int(ok.sum())
    row: dict[str, float] = {"repeats": len(ok), "converged": count}
    row |= {"error_62": of_62.mean(), "error_62_min": of_62.min(), "error_62_max": of_62.max()}
    row |= {"excess_percent": excess.mean(), "excess_se_percent": excess.std(ddof=1) / np.sqrt(count)}
    for name, error in (("rotation_rms_rad", theta), ("translation_rms_m", tau)):
        squares = np.asarray((error**2).mean(axis=1))
        rms = np.sqrt(squares.mean())
        row |= {name: rms, f"{name}_se": squares.std(ddof=1) / np.sqrt(count) / (2 * max(rms, 1e-300))}
    return row


def error_62(X: Array, data: Data) -> Array:
    """(62) of X (T, 4, 4) on the noisy motions."""
    residual = data.A @ X[:, None] - X[:, None] @ data.B
    return np.asarray(np.sqrt((residual**2).sum(axis=(1, 2, 3))) / data.A.shape[1])
