"""Scale of camera poses as a start, when it is not known: a robust estimate from smallest subsets.

``R_G t_X + s R_G R_X t_C - t_W = -t_G`` is linear in (t_X, s, t_W) once R_X is known, and R_X follows from rotations,
which have no scale. Residuals are in metres of the robot, so that a small scale is no way out.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array, inverse
from ...core.limits import MAJORITY
from ...methods.limit import solve_limit
from .consensus import determined, robust_variance

# Subsets of this many poses are drawn, this many times.
POSES, SUBSETS = 5, 400
# Subsets are judged by at most this many poses.
JUDGES = 300
# Poses up to this many times the robust standard deviation are used at the end.
WITHIN_SD = 4.0


def start_scale(G: Array, C: Array, seed: int = 0) -> float | None:
    """Metres of the robot poses G (n, 4, 4) per unit of the camera poses C; None where they do not determine it.

    ``G X C = W``; for eye-to-hand G are the inverse robot poses.
    """
    n = len(G)
    if n < POSES + 1:
        return None
    unit = float(np.sqrt(np.mean(C[:, :3, 3] ** 2)))
    if unit <= 0:
        return None
    subsets = np.argsort(np.random.default_rng(seed).random((SUBSETS, n)), axis=1)[:, :POSES]
    judges = np.unique(np.linspace(0, n - 1, min(n, JUDGES)).round().astype(np.intp))
    best: tuple[float, Array] | None = None
    for rows in (subsets, np.arange(n)[None]):  # of few poses, and of all
        found = _solved(G[rows], C[rows], unit)
        if found is None:
            continue
        R, x = found
        squares = _squares(G[judges], C[judges], R, x, unit)  # (t, n, 2)
        level = np.quantile(squares, MAJORITY, axis=1)
        cost = np.log(np.maximum(level, 1e-24)).sum(axis=-1)
        k = int(np.argmin(cost))
        if best is None or cost[k] < best[0]:
            best = float(cost[k]), squares[k]
    if best is None:
        return None
    limits = [WITHIN_SD**2 * 3.0 * robust_variance(column, 3) + 1e-24 for column in best[1].T]
    kept = judges[(best[1] <= limits).all(axis=-1)]
    if len(kept) < POSES + 1 or (last := _solved(G[kept][None], C[kept][None], unit)) is None:
        return None
    scale = float(last[1][0, 3]) / unit
    return scale if scale > 0 else None


def _solved(G: Array, C: Array, unit: float) -> tuple[Array, Array] | None:
    """R_X (t, 3, 3) and (t_X, s, t_W) (t, 7) of sets of poses (t, m, 4, 4), s in 1 / ``unit``."""
    m = G.shape[1]
    i = np.arange(m)
    j = (i + max(1, m // 3)) % m
    A, B = inverse(G)[:, j] @ G[:, i], C[:, j] @ inverse(C)[:, i]
    if not (usable := determined(A, B)).any():
        return None
    G, C = G[usable], C[usable]
    R = solve_limit(A[usable], B[usable])[:, :3, :3]
    M, right = _rows(G, C, R, unit)
    M, right = M.reshape(len(G), -1, 7), right.reshape(len(G), -1, 1)
    H = M.mT @ M + 1e-12 * np.eye(7)
    return R, np.asarray(np.linalg.solve(H, M.mT @ right)[..., 0], dtype=float)


def _rows(G: Array, C: Array, R: Array, unit: float) -> tuple[Array, Array]:
    R_G = G[..., :3, :3]
    seen = R_G @ R[:, None] @ C[..., :3, 3:] / unit
    R_G = np.broadcast_to(R_G, (*seen.shape[:2], 3, 3))
    return np.concatenate([R_G, seen, np.broadcast_to(-np.eye(3), R_G.shape)], axis=-1), -G[..., :3, 3]


def _squares(G: Array, C: Array, R: Array, x: Array, unit: float) -> Array:
    """(t, n, 2) squared residuals of rotation and translation."""
    M, right = _rows(G[None], C[None], R, unit)
    shift = (M @ x[:, None, :, None])[..., 0] - right
    turned = G[:, :3, :3] @ R[:, None] @ C[:, :3, :3]
    mean = np.linalg.svd(turned.mean(axis=1))
    off = turned - (mean[0] @ mean[2])[:, None]
    return np.stack([0.5 * (off**2).sum(axis=(-1, -2)), (shift**2).sum(axis=-1)], axis=-1)
