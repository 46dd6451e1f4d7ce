r"""Half turns of boards that look the same after one, told by the robot poses.

Of a board with the symmetry Q (a turn by 360/K degrees about its middle) picture i shows ``C_i Q^l_i`` with an unknown
number l_i. With ``E_i X C_i Q^l_i = W`` and ``angle`` that of a rotation, for all pairs of poses

    angle(E_i^-1 E_j) = angle(C_i Q^(l_i - l_j) C_j^-1)

whatever X is. Taken are the l with the smallest sum of the differences of both sides, each counted as at most MOST.

Consistency of two lists of poses with one X, computed quickly: to compare readings of the same files.
"""

from __future__ import annotations

import logging
import warnings
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, inverse, skew
from ...errors import DegenerateMotionError, InputError, InputWarning
from ...methods.procrustes.limit import solve_limit
from ...model.camera.board import Board, listed
from ...model.camera.result import CameraCalibration
from ...model.poses.motions import pose_residuals
from ...model.poses.pose_pairs import PosePairs

_log = logging.getLogger("uq_handeye")

MOST = np.radians(20.0)
# A turn is told where any other would fit worse by this much per pair, on average, and twice as badly.
TOLD = np.radians(1.0)
STARTS, ROUNDS = 20, 50


def resolve_board_rotation(poses: PosePairs, board: Board) -> PosePairs:
    """Return the poses with the board rotated in every picture as the robot poses show; see the module.

    ``poses`` come from a calibrated camera (``poses.camera_calibration``) and ``board`` is what it saw. The turn that
    most pictures have stays; poses, corners and covariance of the others are carried over, intrinsics do not change.

    Raises `InputError` for poses that are not of a calibrated camera.

    Warns
    -----
    InputWarning
        Pictures whose rotation the robot poses do not show.
    """
    seen, K = poses.camera_calibration, board.symmetry_order
    if seen is None:
        raise InputError("Expected `poses` of a calibrated camera (camera_calibration), got others.")
    if K == 1 or poses.n < 2:
        return poses
    cost = _costs(poses.effective_robot, poses.camera, K)
    labels = _labels(cost)
    labels = (labels - np.bincount(labels, minlength=K).argmax()) % K
    names = seen.corners.names
    if doubtful := [names[k] for k in np.flatnonzero(~_told(cost, labels)).tolist()]:
        warnings.warn(
            f"The robot poses do not show which way up the {board} is in {listed(doubtful)}: leave these out, or use "
            "a board without this symmetry.",
            InputWarning,
            stacklevel=2,
        )
    if labels.any():
        turned = [names[k] for k in np.flatnonzero(labels).tolist()]
        _log.info("the board is the other way up in %d of %d pictures: %s", len(turned), poses.n, listed(turned))
    found = _turned(seen, board, 2 * np.pi / K * labels.astype(float))
    return replace(poses, camera=found.poses, camera_calibration=found)


def _turned(seen: CameraCalibration, board: Board, angle: Array) -> CameraCalibration:
    """Rotate the points of picture k by an angle about the middle of the board, ``D_k``, so that ``C'_k = C_k
    D_k^-1``: an error (theta, tau) of C is ``(theta, tau + theta x R t)`` of C', t that of ``D_k^-1``.
    """
    corners, bundle = seen.corners, seen.bundle
    D = np.zeros((len(angle), 4, 4))
    D[:, :3, :3], D[:, 3, 3] = _turn(angle), 1.0
    middle = board.points.mean(axis=0)
    D[:, :3, 3] = middle - D[:, :3, :3] @ middle
    back = inverse(D)
    poses = bundle.poses @ back
    J = np.zeros((len(angle), 6, 6))
    J[:] = np.eye(6)
    J[:, 3:, :3] = -skew((bundle.poses[:, :3, :3] @ back[:, :3, 3, None])[..., 0])
    points = (D[corners.picture, :3, :3] @ corners.points[..., None])[..., 0] + D[corners.picture, :3, 3]
    own = J @ bundle.own @ J.mT
    return replace(
        seen,
        corners=replace(corners, points=points),
        bundle=replace(bundle, poses=poses, own=0.5 * (own + own.mT), by_parameters=J @ bundle.by_parameters),
    )


def _turn(angle: Array) -> Array:
    """Rotations (..., 3, 3) about z."""
    R = np.zeros((*np.shape(angle), 3, 3))
    R[..., 0, 0] = R[..., 1, 1] = np.cos(angle)
    R[..., 1, 0] = np.sin(angle)
    R[..., 0, 1] = -R[..., 1, 0]
    R[..., 2, 2] = 1.0
    return R


def _costs(E: Array, C: Array, K: int) -> Array:
    """(n, n, K): how badly ``l_i - l_j = k`` fits."""
    robot = _angles(np.swapaxes(E[:, None, :3, :3], -1, -2) @ E[None, :, :3, :3])
    cost = np.empty((len(E), len(E), K))
    for k in range(K):
        # The points turn by k, so the pose by -k: camera_T_board' = camera_T_board Q^-k.
        Q = _turn(np.asarray(-2 * np.pi * k / K))
        camera = _angles((C[:, :3, :3] @ Q)[:, None] @ np.swapaxes(C[None, :, :3, :3], -1, -2))
        cost[..., k] = np.minimum(np.abs(robot - camera), MOST)
    cost[np.arange(len(E)), np.arange(len(E))] = 0.0
    return cost


def _angles(R: Array) -> Array:
    return np.asarray(np.arccos(np.clip(0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0), -1.0, 1.0)))


def _of_each(cost: Array, labels: NDArray[np.intp]) -> Array:
    """(n, K): the cost of each label of pose i, all others as they are."""
    own = np.arange(cost.shape[2])
    index = (own[None, None, :] - labels[None, :, None]) % cost.shape[2]
    return np.asarray(np.take_along_axis(cost, np.broadcast_to(index, cost.shape), axis=2).sum(axis=1))


def _labels(cost: Array) -> NDArray[np.intp]:
    """Label all poses as they fit one of them, for several such starts; then one after the other as they fit all."""
    n = len(cost)
    best: tuple[float, NDArray[np.intp]] | None = None
    for first in np.unique(np.linspace(0, n - 1, min(n, STARTS)).astype(int)):
        labels = cost[:, first].argmin(axis=1).astype(np.intp)
        for _ in range(ROUNDS):
            each = _of_each(cost, labels)
            gain = each[np.arange(n), labels] - each.min(axis=1)
            worst = int(np.argmax(gain))
            if gain[worst] <= 1e-12:
                break
            labels[worst] = each[worst].argmin()
        total = float(_of_each(cost, labels)[np.arange(n), labels].sum())
        if best is None or total < best[0] - 1e-12:
            best = total, labels
    assert best is not None
    return best[1]


def _told(cost: Array, labels: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(n,) whether the next best turn of a pose fits worse by `TOLD` per pair, and twice as badly."""
    n = len(cost)
    each = _of_each(cost, labels) / (n - 1)
    chosen = each[np.arange(n), labels].copy()
    each[np.arange(n), labels] = np.inf
    best_other = each.min(axis=1)
    return np.asarray(best_other > np.maximum(chosen + TOLD, 2.0 * chosen))


# Rotation residual (rad) beyond which another reading of the files is looked for.
LARGE_ROTATION = np.radians(2.0)
# Pairs of poses that are looked at.
SEARCH_PAIRS = 2000


def consistency(G: Array, C: Array) -> tuple[float, float, float] | None:
    """Return RMS rotation and translation of W about its mean, and |t_X|, of X fitted to some of the pairs."""
    n = len(G)
    lag = np.unique(np.linspace(1, n - 1, max(1, SEARCH_PAIRS // n)).astype(int))
    i = np.concatenate([np.arange(n - k) for k in lag])
    j = np.concatenate([np.arange(k, n) for k in lag])
    A, B = inverse(G)[j] @ G[i], C[j] @ inverse(C)[i]
    try:
        X = solve_limit(A, B)
    except DegenerateMotionError:
        return None
    angle, distance = pose_residuals(G, C, X)
    return float(np.sqrt(np.mean(angle**2))), float(np.sqrt(np.mean(distance**2))), float(np.linalg.norm(X[:3, 3]))
