r"""Views in which another program took the points of a symmetric target in another order, found by the robot poses.

A rectangular grid without marks, such as a symmetric grid of circles, can be read from its four corners, along its rows
or its columns. A reading that is turned by half a turn is the same grid turned about its normal. One that is mirrored
fits the pixels of a flat target as well: its pose is that of the grid turned by half a turn about an axis in its plane,
and faces away. Pose i is so ``C_i Q_i`` with a rotation Q_i of the group of the rectangle,

    1,  R_z(180),  R_x(180),  R_y(180)

or of the square, which has R_z(90), R_z(-90) and half turns about both diagonals in addition. With ``E_i X C_i = W``

    angle(E_i^-1 E_j) = angle(C_i Q_i^-1 Q_j C_j^-1)

whatever X and the middle of the target are. The estimate is the set of Q_i with the smallest sum of the differences of
both sides, each limited (`board_rotation`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.rounding import SOLUTION_ROUNDING
from ...findings import Finding
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.residuals import rotation_angles
from .agreement import agreement
from .board_rotation import DECISIVE_DIFFERENCE_RAD, MAX_ANGLE_DIFFERENCE_RAD
from .consistency import MAX_MISFIT_SHARE
from .covariance_convention import MAX_POSES

# Fewest poses whose readings are looked for: fewer fit by chance.
MIN_POSES_FOR_ORDER = 8
# Mean difference of the angles that poses may leave as they are read, and share of them that may be undecided.
MAX_MEAN_DIFFERENCE_RAD, MAX_UNDECIDED_SHARE = np.radians(2.0), 0.2

HALF, MIRRORED, QUARTER = "half", "mirrored", "quarter"
_HALF_TURNS = [np.diag([-1.0, -1, 1]), np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1])]
RECTANGLE = np.array([np.eye(3), *_HALF_TURNS])
_QUARTER_TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
SQUARE = np.array([*RECTANGLE, *(RECTANGLE @ _QUARTER_TURN)])
KINDS = ("", HALF, MIRRORED, MIRRORED, QUARTER, QUARTER, MIRRORED, MIRRORED)


def reordered_views(poses: PosePairs, rejected: NDArray[np.bool_] | None = None) -> Finding | None:
    """Return a finding if the target of some views is turned or mirrored, and all views agree with the robot then.

    ``rejected`` are the poses that a fit left out: where these are the views, X is that of the others.
    """
    if poses.n < MIN_POSES_FOR_ORDER or poses.camera.ndim != 3:
        return None
    E, C = poses.effective_robot[:, :3, :3], poses.camera[:, :3, :3]
    read, decided = max((_read(E, C, group) for group in (RECTANGLE, SQUARE)), key=lambda found: found[1].sum())
    if decided.mean() < 1.0 - MAX_UNDECIDED_SHARE or not read.any():
        return None
    rows: dict[str, object] = {
        kind: [k for k, element in enumerate(read.tolist()) if KINDS[element] == kind]
        for kind in (HALF, MIRRORED, QUARTER)
    }
    left_out = rejected is not None and bool(rejected[read > 0].all())
    if not left_out and not _agrees(poses.rows(np.flatnonzero(read == 0))):
        return None  # something else is wrong, too, such as the setup
    return Finding("input_checks.board_order", "caution" if left_out else "failure", rows | {"rejected": left_out})


def _agrees(poses: PosePairs) -> bool:
    """Return whether robot and camera agree in rotation and translation, as the files are read."""
    G = poses.effective_robot
    found, travel = agreement(G, poses.camera, scale_free=False), np.linalg.norm(np.std(G[:, :3, 3], axis=0))
    return found is not None and found.distance <= MAX_MISFIT_SHARE * float(travel)


def _read(E: Array, C: Array, group: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the element of the group (n,) by which each pose is turned, the commonest one 0, and of which poses (n,)
    it is clear; others have 0.
    """
    n, ratio = len(C), _ratios(group)
    some = np.unique(np.linspace(0, n - 1, min(n, MAX_POSES)).astype(int))
    joint = _labels(_costs(E[some], C[some], E[some], C[some], group), ratio)
    each = _costs_of(_costs(E, C, E[some], C[some], group), ratio, joint) / len(some)
    best, next_best = np.sort(each, axis=1)[:, :2].T
    decided = (best < MAX_MEAN_DIFFERENCE_RAD) & (next_best > np.maximum(best + DECISIVE_DIFFERENCE_RAD, 2.0 * best))
    labels = each.argmin(axis=1)
    labels = ratio[labels, np.bincount(labels).argmax()]
    return np.where(decided, labels, 0), decided


def _ratios(group: Array) -> NDArray[np.intp]:
    """Return the numbers (g, g) of the elements ``a b^-1`` of a group."""
    quotients = group[:, None] @ group.mT
    ratio: NDArray[np.intp] = np.einsum("abij,cij->abc", quotients, group).argmax(axis=-1)
    return ratio


def _costs_of(cost: Array, ratio: NDArray[np.intp], labels: NDArray[np.intp]) -> Array:
    """Return the cost (n, g) of each element for pose i, the others (m,) as ``labels`` say; ``cost`` (n, m, g)."""
    index = ratio[:, labels].T[None]  # (1, m, g)
    return np.asarray(np.take_along_axis(cost, np.broadcast_to(index, cost.shape), axis=2).sum(axis=1))


def _costs(E: Array, C: Array, E_others: Array, C_others: Array, group: Array) -> Array:
    """Return how badly ``Q_i Q_j^-1`` of a group fits pose i and another one j, (n, m, g)."""
    robot = rotation_angles(E[:, None].mT @ E_others)
    camera = rotation_angles((C[:, None] @ group)[:, None] @ C_others[:, None].mT)
    return np.asarray(np.minimum(np.abs(robot[..., None] - camera), MAX_ANGLE_DIFFERENCE_RAD))


def _labels(cost: Array, ratio: NDArray[np.intp]) -> NDArray[np.intp]:
    """Label all poses as they fit one of them, for several such starts; then one after the other as they fit all."""
    every, best = np.arange(len(cost)), (np.inf, np.zeros(len(cost), dtype=np.intp))
    for first in np.unique(np.linspace(0, len(cost) - 1, min(len(cost), 12)).astype(int)):
        labels = cost[:, first].argmin(axis=1).astype(np.intp)
        for _ in range(200):  # rounds at most, each reads one pose again
            each = _costs_of(cost, ratio, labels)
            gain = each[every, labels] - each.min(axis=1)
            worst = int(np.argmax(gain))
            if gain[worst] <= SOLUTION_ROUNDING:
                break
            labels[worst] = each[worst].argmin()
        total = float(each[every, labels].sum())
        if total < best[0]:
            best = total, labels
    return best[1]
