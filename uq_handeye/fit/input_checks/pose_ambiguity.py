r"""Poses of a target that a picture alone does not decide, decided by the others: second solutions, turned boards.

*Second solutions* of a small flat target, such as a single tag.

Both minima C_k of picture i (`camera.adjustment.two_minima`) have the sums of squares q_k in pixels^2. Where
``(q_2 - q_1) / s^2`` is small, s the pixel noise, the picture alone does not decide. The robot does: with X and W of
the poses that agree (`consensus`), minus twice the logarithm of the likelihood is

    L_k = q_k / s^2 + r_k^T S_k^-1 r_k / f

r_k the residual of ``E X C_k = W``, S_k its covariance by the pixel noise at that minimum and f how much larger the
residuals of the poses are than S says. Taken is the smaller; X and W are fitted again until no pose changes.

Finished poses come without corners. Of one that is an outlier the other minimum is that of the corners which it
predicts (`flipped_rows`): it is named, and not put in the place of the pose, as its errors are not known.

*Turned boards*: half turns of boards that look the same after one. Of a board with the symmetry Q (a turn by 360/K
degrees about its middle) picture i shows ``C_i Q^l_i`` with an unknown number l_i. With ``E_i X C_i Q^l_i = W`` and
``angle`` that of a rotation, for all pairs of poses

    angle(E_i^-1 E_j) = angle(C_i Q^(l_i - l_j) C_j^-1)

whatever X is. Taken are the l with the smallest sum of the differences of both sides, each counted as at most MOST.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, inverse, skew
from ...errors import DegenerateMotionError, InputError, InputWarning, NotConvergedError
from ...findings import Finding
from ...model.camera.adjustment.bundle import Asked, adjust
from ...model.camera.adjustment.two_minima import Minima, both_minima, flipped, may_be_ambiguous
from ...model.camera.board import listed
from ...model.camera.board_shape import flat_shape
from ...model.camera.corners import Corners
from ...model.camera.description import Board
from ...model.camera.models import MODELS
from ...model.camera.result import CameraCalibration
from ...model.noise.models import PoseNoise
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.residuals import rotation_angles
from ..likelihood.consensus import consensus
from ..likelihood.constraint import OnPoses, Unknowns, residual_covariance
from ..likelihood.gauss_helmert import fit

_log = logging.getLogger("uq_handeye")

# Odds of exp(UNDECIDED / 2) below which the other poses do not decide either.
UNDECIDED = 6.0
# Differences of the sums of squares, over s^2, below which a second solution fits about as well (p = 0.0005).
CLOSE = 12.0
# The least noise of a robot pose, rad and m.
ROBOT = (np.radians(0.02), 1e-4)
# Median of chi-square(6).
MEDIAN = 5.348
FEWEST, ROUNDS, STEPS = 5, 8, 20
# A flipped outlier fits where its rotation residual is below so many medians and this angle (rad), and so much smaller.
FITS, FLOOR, BETTER = 5.0, np.radians(0.2), 3.0
CODE = "input_checks.pose_ambiguity"


class Decision(NamedTuple):
    """Choice between both minima."""

    label: NDArray[np.intp]  # (n,) 0 or 1
    doubtful: NDArray[np.bool_]  # (n,)
    undecided: NDArray[np.bool_]  # (n,) the other poses do not decide either


def decide(poses: PosePairs, minima: Minima) -> Decision:
    """Choose between both minima by the other poses; raises where these do not determine X."""
    n, doubtful = poses.n, minima.doubtful
    label, every = np.zeros(n, dtype=np.intp), np.arange(n)
    robot = np.diag(np.repeat(np.square(ROBOT), 3))
    seen: set[bytes] = set()
    difference = np.zeros(n)
    for _ in range(ROUNDS):
        if not doubtful.any() or label.tobytes() in seen:
            break
        seen.add(label.tobytes())
        constraint = OnPoses(poses.robot, minima.poses[label, every], poses.setup == "eye-to-hand")
        noise = PoseNoise(np.broadcast_to(robot, (n, 6, 6)), minima.own[label, every])
        agreed = consensus(constraint, noise, 0)
        at = fit(constraint, noise, agreed.unknowns, STEPS, weights=np.maximum(agreed.inside, 1e-6)).unknowns
        d2 = np.array([_distance2(poses, at, minima.poses[k], minima.own[k], robot) for k in (0, 1)])
        scale = max(1.0, float(np.median(d2[label, every])) / MEDIAN)
        score = minima.squares + d2 / scale
        difference = score[1] - score[0]
        label = np.where(doubtful & (difference < 0), 1, 0).astype(np.intp)
    return Decision(label, doubtful, doubtful & (np.abs(difference) < UNDECIDED))


def _distance2(poses: PosePairs, at: Unknowns, camera: Array, own: Array, robot: Array) -> Array:
    """(n,) ``r^T S^-1 r`` of camera poses."""
    constraint = OnPoses(poses.robot, camera, poses.setup == "eye-to-hand")
    linear = constraint.linearise(at, constraint.first, constraint.second)
    S = np.asarray(residual_covariance(linear.sides, PoseNoise(np.broadcast_to(robot, own.shape), own)))
    return np.asarray(np.einsum("ni,ni->n", linear.r, np.linalg.solve(S, linear.r[..., None])[..., 0]))


def resolve_pose_ambiguity(poses: PosePairs) -> PosePairs:
    """Return the poses with, of each picture of a small flat target, that solution which the other poses agree with.

    ``poses`` come from a calibrated camera (``poses.camera_calibration``); others are returned as they are, and so are
    those of pictures that decide by themselves. What was decided is a finding of the camera, and of the calibration.
    See the module; raises nothing where the other poses do not determine X.
    """
    seen = poses.camera_calibration
    if seen is None or poses.n < FEWEST or poses.robot.ndim != 3 or not _flat(seen.corners.on_board[0]):
        return poses
    if any(finding.code == CODE for finding in seen.findings):
        return poses
    try:
        if not may_be_ambiguous(seen.bundle, seen.corners):
            return poses
        minima = both_minima(seen.bundle, seen.corners)
        if not minima.doubtful.any():
            return poses
        chosen = decide(poses, minima)
        found = _refitted(seen, minima.poses[chosen.label, np.arange(poses.n)])
    except (DegenerateMotionError, InputError, NotConvergedError, np.linalg.LinAlgError):
        return poses
    names = np.array(seen.corners.names)
    close = minima.squares[1] - minima.squares[0] < CLOSE
    values = {
        "count": int((chosen.doubtful & (close | (chosen.label == 1))).sum()),
        "n": poses.n,
        "changed": int((chosen.label == 1).sum()),
        "undecided": names[chosen.undecided].tolist(),
    }
    if not values["count"]:
        return poses
    found = replace(found, findings=(*seen.findings, Finding(CODE, "note", values)))
    return replace(poses, camera=found.poses, camera_calibration=found)


def _flat(points: Array) -> bool:
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(sizes[2] < 1e-6 * sizes[0])


def _refitted(seen: CameraCalibration, poses: Array) -> CameraCalibration:
    """Return the camera fitted once more from these poses on."""
    before = seen.bundle
    start = np.array(before.parameters), poses
    bundle = adjust(before.asked, seen.corners, start, used=before.used, weights=before.weights)
    return replace(seen, bundle=bundle)


def flipped_rows(
    poses: PosePairs, at: Unknowns, kept: NDArray[np.bool_], rows: list[int], views: Mapping[str, Any] | None
) -> list[int]:
    """Return those of the ``rows`` (outliers) whose rotation fits X and W as the kept poses do once the target is
    flipped.

    ``views`` are points and camera of a `CameraNoise`; without them the flip is that of a far target.
    """
    if not rows or at.W is None or kept.sum() < FEWEST:
        return []
    some = poses.rows(np.array(rows))
    other = flipped(some.camera, np.zeros(3)) if views is None else _other_minimum(some.camera, views)
    if other is None:
        return []
    angles = _rotation_residuals(poses, at, poses.camera)
    usual = FITS * float(np.median(angles[kept])) + FLOOR
    after = _rotation_residuals(some, at, other)
    return [k for k, angle in zip(rows, after.tolist(), strict=True) if angle < min(usual, angles[k] / BETTER)]


def _rotation_residuals(poses: PosePairs, at: Unknowns, camera: Array) -> Array:
    constraint = OnPoses(poses.robot, camera, poses.setup == "eye-to-hand")
    r = constraint.linearise(at, constraint.first, constraint.second).r
    return np.asarray(np.linalg.norm(r[:, :3], axis=-1))


def _other_minimum(camera: Array, views: Mapping[str, Any]) -> Array | None:
    """Return the other minimum (n, 4, 4) of the corners that poses predict; None: the target is not flat."""
    points, n = np.asarray(views["points"], dtype=float), len(camera)
    if not _flat(points):
        return None
    model, parameters = MODELS[views["model"]], np.asarray(views["parameters"], dtype=float)
    pixels = model.project(parameters, points @ camera[:, :3, :3].mT + camera[:, None, :3, 3]).pixels
    row = np.repeat(np.arange(n), len(points))
    corners = Corners(row, np.tile(points, (n, 1)), pixels.reshape(-1, 2))
    start = flipped(camera, points.mean(axis=0))
    asked = Asked.poses_only(model, flat_shape(points))
    return np.asarray(adjust(asked, corners, (parameters, start), pixel_noise=1.0).poses)


# --------------------------------------------------------------------------------------------------- turned boards

MOST = np.radians(20.0)
# A turn is told where any other would fit worse by this much per pair, on average, and twice as badly.
TURN_TOLD = np.radians(1.0)
STARTS, TURN_ROUNDS = 20, 50


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
    """(n, n, K): how badly ``l_i - l_j = k`` fits."""
    robot = rotation_angles(np.swapaxes(E[:, None, :3, :3], -1, -2) @ E[None, :, :3, :3])
    cost = np.empty((len(E), len(E), K))
    for k in range(K):
        # The points turn by k, so the pose by -k: camera_T_board' = camera_T_board Q^-k.
        Q = Rotation.from_euler("z", -2 * np.pi * k / K).as_matrix()
        camera = rotation_angles((C[:, :3, :3] @ Q)[:, None] @ np.swapaxes(C[None, :, :3, :3], -1, -2))
        cost[..., k] = np.minimum(np.abs(robot - camera), MOST)
    cost[np.arange(len(E)), np.arange(len(E))] = 0.0
    return cost


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
        for _ in range(TURN_ROUNDS):
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
    """(n,) whether the next best turn of a pose fits worse by `TURN_TOLD` per pair, and twice as badly."""
    n = len(cost)
    each = _of_each(cost, labels) / (n - 1)
    chosen = each[np.arange(n), labels].copy()
    each[np.arange(n), labels] = np.inf
    best_other = each.min(axis=1)
    return np.asarray(best_other > np.maximum(chosen + TURN_TOLD, 2.0 * chosen))
