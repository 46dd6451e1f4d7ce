"""Order of camera poses against robot poses, by angles alone.

The angle between two poses is that of both sides, whatever X, W and the scale are. Three camera poses with large angles
are looked for among all triples of robot poses with the same angles; each that fits gives R_X, which assigns the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ...core.geometry.se3 import Array, logarithm

# Median difference of angles (rad) from which on rows do not belong together, and that of rows which do.
DISAGREEMENT, AGREEMENT = np.radians(1.0), np.radians(0.5)
# Triples that are tried at most; fewest poses for an order.
MAX_TRIPLES, MIN_POSES_FOR_ROW_ORDER = 4000, 6
# Share of the rows that must agree for an order.
MIN_SHARE = 0.7


@dataclass(frozen=True)
class RowOrder:
    """Robot row of each camera pose, -1 where none fits."""

    rows: tuple[int, ...]

    @property
    def found(self) -> int:
        """Number of camera poses with a robot row."""
        return sum(row >= 0 for row in self.rows)


def angles_between(R: Array) -> Array:
    """Angles (n, n) between rotations (n, 3, 3), rad."""
    return np.asarray(np.linalg.norm(logarithm(R[:, None].mT @ R[None]), axis=-1))


def angle_disagreement(G: Array, C: Array) -> float:
    """Median over pairs of rows of the difference of the angles of both sides, rad; poses (n, 4, 4) row by row."""
    i, j = np.triu_indices(len(G), 1)
    a, b = angles_between(G[:, :3, :3]), angles_between(C[:, :3, :3].mT)
    return float(np.median(np.abs(a - b)[i, j])) if len(i) else 0.0


def find_order(G: Array, C: Array) -> RowOrder | None:
    """Return the rows of robot poses G (m, 4, 4) that camera poses C (n, 4, 4) belong to; None where no order fits.

    ``G X C = W``; for eye-to-hand G are the inverse robot poses.
    """
    m, n = len(G), len(C)
    if min(m, n) < MIN_POSES_FOR_ROW_ORDER:
        return None
    A, B = angles_between(G[:, :3, :3]), angles_between(C[:, :3, :3].mT)
    first = _triple(B, ())
    second = _triple(B, first)
    # some of them may have a wrong robot pose, or none
    tried = [first, *(_triple(B, (one,)) for one in first), second, *(_triple(B, (*first, one)) for one in second)]
    found = (_by_triple(G, C, A, B, triple) for triple in tried)
    return max((order for order in found if order is not None), key=lambda order: order.found, default=None)


def _by_triple(G: Array, C: Array, A: Array, B: Array, first: tuple[int, int, int]) -> RowOrder | None:
    """Return the order by three camera poses, which some three robot poses resemble."""
    best: tuple[float, NDArray[np.intp], NDArray[np.intp], Array] | None = None
    for triple in _triples_like(A, B[np.ix_(first, first)]):
        R = _rotation(G[triple, :3, :3], C[list(first), :3, :3])
        if R is None:
            continue
        cost = _costs(G, C, R, int(triple[0]), first[0])
        bounded = np.minimum(cost, 4.0 * AGREEMENT)
        rows, columns = linear_sum_assignment(bounded)
        total = float(bounded[rows, columns].sum())
        if best is None or total < best[0]:
            best = total, rows, columns, cost
    if best is None:
        return None
    _, rows, columns, cost = best
    good = cost[rows, columns] < 2.0 * AGREEMENT
    if good.sum() < max(MIN_POSES_FOR_ROW_ORDER, MIN_SHARE * min(len(G), len(C))):
        return None
    order = np.full(len(C), -1)
    order[rows[good]] = columns[good]
    return RowOrder(tuple(int(row) for row in order))


def _triple(B: Array, without: tuple[int, ...]) -> tuple[int, int, int]:
    """Return three poses with large angles between them, the most different from half turns and from each other."""
    n = len(B)
    usable = np.where(np.radians(170.0) > B, B, 0.0)
    usable[list(without)] = 0.0
    usable[:, list(without)] = 0.0
    least = np.minimum(np.minimum(usable[:, :, None], usable[:, None, :]), usable[None])
    sides = np.sort(np.stack(np.broadcast_arrays(B[:, :, None], B[:, None, :], B[None]), axis=-1), axis=-1)
    distinct = np.minimum(sides[..., 1] - sides[..., 0], sides[..., 2] - sides[..., 1])
    i, j, k = np.unravel_index(np.argmax(np.where(least > 0, least + 2.0 * distinct, 0.0)), (n, n, n))
    return int(i), int(j), int(k)


def _triples_like(A: Array, wanted: Array) -> NDArray[np.intp]:
    """Return ordered triples of rows with three angles, (t, 3)."""
    near = 2.0 * AGREEMENT
    i, j = np.nonzero(np.abs(A - wanted[0, 1]) < near)
    third = (np.abs(A[i] - wanted[0, 2]) < near) & (np.abs(A[j] - wanted[1, 2]) < near)
    line, k = np.nonzero(third)
    found = np.stack([i[line], j[line], k], axis=-1)
    found = found[(found[:, 0] != found[:, 1]) & (found[:, 1] != found[:, 2]) & (found[:, 0] != found[:, 2])]
    off = sum(np.abs(A[found[:, a], found[:, b]] - wanted[a, b]) for a, b in ((0, 1), (0, 2), (1, 2)))
    return np.asarray(found[np.argsort(off, kind="stable")[:MAX_TRIPLES]])


def _rotation(G: Array, C: Array) -> Array | None:
    """Return R_X of three pairs of rotations: the axes of the motions of one side from those of the other."""
    a = logarithm(G[0].T @ G[1:])
    b = logarithm(C[0] @ C[1:].mT)
    if np.linalg.norm(np.cross(*b)) < 1e-2 * np.linalg.norm(b[0]) * np.linalg.norm(b[1]):
        return None
    U, _, Vt = np.linalg.svd(a.T @ b + np.outer(np.cross(*a), np.cross(*b)))
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def _costs(G: Array, C: Array, R: Array, g: int, c: int) -> Array:
    """Angles (n, m) between each camera pose and each robot pose, as motions from poses c and g."""
    a = G[g, :3, :3].T @ G[:, :3, :3]
    b = R @ (C[c, :3, :3] @ C[:, :3, :3].mT) @ R.T
    return np.asarray(np.linalg.norm(logarithm(b[:, None].mT @ a[None]), axis=-1))
