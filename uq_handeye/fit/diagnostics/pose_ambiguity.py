r"""Choice between the two solutions of the pose of a small flat target, such as a single tag, by the other poses.

Both minima C_k of picture i (`camera.adjustment.two_minima`) have the sums of squares q_k in pixels^2. Where
``(q_2 - q_1) / s^2`` is small, s the pixel noise, the picture alone does not decide. The robot does: with X and W of
the poses that agree (`consensus`), minus twice the logarithm of the likelihood is

    L_k = q_k / s^2 + r_k^T S_k^-1 r_k / f

r_k the residual of ``E X C_k = W``, S_k its covariance by the pixel noise at that minimum and f the ratio of the
residuals of the poses to those expected by S. The solution with the smaller value is taken; X and W are fitted again
until no pose changes.

Poses from other programs come without corners. For an outlier among them, the other minimum is that of the corners
which it predicts (`flipped_rows`): it is reported, but does not replace the pose, as its errors are not known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ...core.geometry.se3 import Array
from ...core.levels import UNUSUAL
from ...core.limits import MIN_POSES_FOR_ROBUST
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...findings import Finding
from ...model.camera.adjustment.bundle import BundleUnknowns, adjust
from ...model.camera.adjustment.two_minima import Minima, both_minima, flipped, may_be_ambiguous
from ...model.camera.board_shape import flat_shape
from ...model.camera.corners import Corners
from ...model.camera.models import MODELS
from ...model.camera.result import CameraCalibration
from ...model.errors.models import PoseNoise
from ...model.poses.pose_pairs import PosePairs
from ..graph.consensus import consensus
from ..graph.constraint import OnPoses, Unknowns, residual_covariance
from ..graph.gauss_helmert import fit

# Difference of the sums of squares, in variances of the pixel noise, below which both solutions fit about as well.
SIMILAR_SQUARES = 12.0
# The least noise of a robot pose, rad and m: it keeps a precise robot from deciding by its own error.
MIN_ROBOT_NOISE = (np.radians(0.02), 1e-4)
# The rotation residual of an outlier that is flipped falls by this factor, and below MAX_FLIPPED_RATIO times the median
# of the other poses and a constant for their rounding.
FLIPPED_GAIN, MAX_FLIPPED_RATIO = 3.0, 5.0
FLIPPED_ROUNDING_RAD = np.radians(0.2)
CODE = "input_checks.pose_ambiguity"


class Decision(NamedTuple):
    """Choice between both minima."""

    label: NDArray[np.intp]  # (n,) 0 or 1
    doubtful: NDArray[np.bool_]  # (n,)
    undecided: NDArray[np.bool_]  # (n,) the other poses do not decide either


def decide(poses: PosePairs, minima: Minima, max_rounds: int = 8) -> Decision:
    """Choose between both minima by the other poses; raises where these do not determine X."""
    n, doubtful = poses.n, minima.doubtful
    label, every = np.zeros(n, dtype=np.intp), np.arange(n)
    robot = np.diag(np.repeat(np.square(MIN_ROBOT_NOISE), 3))
    seen: set[bytes] = set()
    difference = np.zeros(n)
    for _ in range(max_rounds):
        if not doubtful.any() or label.tobytes() in seen:
            break
        seen.add(label.tobytes())
        constraint = OnPoses(poses.robot, minima.poses[label, every], poses.setup == "eye-to-hand")
        noise = PoseNoise(np.broadcast_to(robot, (n, 6, 6)), minima.own[label, every])
        agreed = consensus(constraint, noise, 0)
        at = fit(constraint, noise, agreed.unknowns, 20, weights=np.maximum(agreed.inside, 1e-6)).unknowns
        d2 = np.array([_distance2(poses, at, minima.poses[k], minima.own[k], robot) for k in (0, 1)])
        scale = max(1.0, float(np.median(d2[label, every])) / float(chdtri(6, 0.5)))
        score = minima.squares + d2 / scale
        difference = score[1] - score[0]
        label = np.where(doubtful & (difference < 0), 1, 0).astype(np.intp)
    return Decision(label, doubtful, doubtful & (np.abs(difference) < -2.0 * np.log(UNUSUAL.probability)))


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
    if seen is None or poses.n < MIN_POSES_FOR_ROBUST or poses.robot.ndim != 3 or not _flat(seen.corners.on_board[0]):
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
    close = minima.squares[1] - minima.squares[0] < SIMILAR_SQUARES
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
    bundle = adjust(before.unknowns, seen.corners, start, used=before.used, weights=before.weights)
    return replace(seen, bundle=bundle)


def flipped_rows(
    poses: PosePairs, at: Unknowns, kept: NDArray[np.bool_], rows: list[int], views: Mapping[str, Any] | None
) -> list[int]:
    """Return those of the ``rows`` (outliers) whose rotation fits X and W as the kept poses do once the target is
    flipped.

    ``views`` are points and camera of a `CameraNoise`; without them the flip is that of a far target.
    """
    if not rows or at.W is None or kept.sum() < MIN_POSES_FOR_ROBUST:
        return []
    some = poses.rows(np.array(rows))
    other = flipped(some.camera, np.zeros(3)) if views is None else _other_minimum(some.camera, views)
    if other is None:
        return []
    angles = _rotation_residuals(poses, at, poses.camera)
    usual = MAX_FLIPPED_RATIO * float(np.median(angles[kept])) + FLIPPED_ROUNDING_RAD
    after = _rotation_residuals(some, at, other)
    return [k for k, angle in zip(rows, after.tolist(), strict=True) if angle < min(usual, angles[k] / FLIPPED_GAIN)]


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
    unknowns = BundleUnknowns.poses_only(model, flat_shape(points))
    return np.asarray(adjust(unknowns, corners, (parameters, start), pixel_noise=1.0).poses)
