r"""Orientation of a rotationally symmetric board in each picture, decided by the robot poses.

Of a board with the symmetry Q (a rotation by 360/K degrees about its middle) picture i shows ``C_i Q^l_i`` with an
unknown number l_i. With ``E_i X C_i Q^l_i = W`` and ``angle`` that of a rotation, for all pairs of poses

    angle(E_i^-1 E_j) = angle(C_i Q^(l_i - l_j) C_j^-1)

whatever X is. The estimate is the l with the smallest sum of the differences of both sides, each limited to
`MAX_ANGLE_DIFFERENCE_RAD`.
"""

from __future__ import annotations

import logging
import warnings
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, inverse, skew
from ...core.rounding import SOLUTION_ROUNDING
from ...errors import InputError, InputWarning
from ...model.camera.board import listed
from ...model.camera.description import Board
from ...model.camera.result import CameraCalibration
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.residuals import rotation_angles

_log = logging.getLogger("uq_handeye")

# The most that a pair of poses counts: outliers do not decide.
MAX_ANGLE_DIFFERENCE_RAD = np.radians(20.0)
# A turn is decided where any other fits worse by this much per pair, on average, and twice as badly.
DECISIVE_DIFFERENCE_RAD = np.radians(1.0)


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
    if doubtful := [names[k] for k in np.flatnonzero(~_decided(cost, labels)).tolist()]:
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
    D[:, :3, :3], D[:, 3, 3] = Rotation.from_euler("z", angle[:, None]).as_matrix(), 1.0
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


def _costs(E: Array, C: Array, K: int) -> Array:
    """Return how badly ``l_i - l_j = k`` fits, (n, n, K)."""
    robot = rotation_angles(np.swapaxes(E[:, None, :3, :3], -1, -2) @ E[None, :, :3, :3])
    cost = np.empty((len(E), len(E), K))
    for k in range(K):
        # The points turn by k, so the pose by -k: camera_T_board' = camera_T_board Q^-k.
        Q = Rotation.from_euler("z", -2 * np.pi * k / K).as_matrix()
        camera = rotation_angles((C[:, :3, :3] @ Q)[:, None] @ np.swapaxes(C[None, :, :3, :3], -1, -2))
        cost[..., k] = np.minimum(np.abs(robot - camera), MAX_ANGLE_DIFFERENCE_RAD)
    cost[np.arange(len(E)), np.arange(len(E))] = 0.0
    return cost


def _of_each(cost: Array, labels: NDArray[np.intp]) -> Array:
    """Return the cost (n, K) of each label of pose i, all others as they are."""
    own = np.arange(cost.shape[2])
    index = (own[None, None, :] - labels[None, :, None]) % cost.shape[2]
    return np.asarray(np.take_along_axis(cost, np.broadcast_to(index, cost.shape), axis=2).sum(axis=1))


def _labels(cost: Array, starts: int = 20, max_rounds: int = 50) -> NDArray[np.intp]:
    """Label all poses as they fit one of them, for several such starts; then one after the other as they fit all."""
    n = len(cost)
    best: tuple[float, NDArray[np.intp]] | None = None
    for first in np.unique(np.linspace(0, n - 1, min(n, starts)).astype(int)):
        labels = cost[:, first].argmin(axis=1).astype(np.intp)
        for _ in range(max_rounds):
            each = _of_each(cost, labels)
            gain = each[np.arange(n), labels] - each.min(axis=1)
            worst = int(np.argmax(gain))
            if gain[worst] <= SOLUTION_ROUNDING:
                break
            labels[worst] = each[worst].argmin()
        total = float(_of_each(cost, labels)[np.arange(n), labels].sum())
        if best is None or total < best[0] - SOLUTION_ROUNDING:
            best = total, labels
    assert best is not None
    return best[1]


def _decided(cost: Array, labels: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return whether (n,) the next best turn of a pose fits clearly worse (`DECISIVE_DIFFERENCE_RAD`)."""
    n = len(cost)
    each = _of_each(cost, labels) / (n - 1)
    chosen = each[np.arange(n), labels].copy()
    each[np.arange(n), labels] = np.inf
    best_other = each.min(axis=1)
    return np.asarray(best_other > np.maximum(chosen + DECISIVE_DIFFERENCE_RAD, 2.0 * chosen))
