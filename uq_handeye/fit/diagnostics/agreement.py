"""Agreement of robot and camera poses under some reading, judged by most of the poses and with the scale free.

A reading of rotations is judged before outliers are looked for, before half turns of a board are resolved, and before
the size of the target is known. So poses that disagree with most others count at most as the rest does, and the
translations of the camera have a factor of their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, inverse
from ...core.limits import MAJORITY
from ...errors import DegenerateMotionError
from ...methods.limit import solve_limit
from ...model.poses.residuals import rotation_angles

# A pose counts up to this multiple of the typical residual, and always below `ROTATION_FLOOR_RAD`.
OUTLIER_RATIO = 3.0
ROTATION_FLOOR_RAD = np.radians(0.05)
# The quantile ``MAJORITY**2`` of |x| for a standard Gaussian x: so many motions are between poses of the majority.
QUANTILE_OF_MAJORITY = 0.468
# Motions that are compared, about.
MAX_MOTIONS = 2000
# Fewest poses of which some may be left out.
MIN_POSES_TO_TRIM = 7
# Rounds of the fit to the poses that count, which are chosen again after each.
ROUNDS = 3


IDENTITY = np.eye(3)


class Agreement(NamedTuple):
    """Agreement of two sides; lengths in the unit of the robot.

    ``angle`` (rad) and ``distance`` are the root mean squares of rotation and translation of W about its mean, of the
    poses that count, ``share`` of all. ``length`` is |t_X|, ``scale`` the factor on the camera's translations,
    ``rotation`` that of X, and ``counts`` (n,) the poses that agree in rotation.
    """

    angle: float
    distance: float
    length: float
    scale: float
    share: float
    rotation: Array = IDENTITY
    counts: NDArray[np.bool_] | None = None


def motions_between(n: int, max_pairs: int = MAX_MOTIONS) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the two poses of each of about ``max_pairs`` motions, over lags of all sizes."""
    lag = np.unique(np.linspace(1, n - 1, max(1, max_pairs // n)).astype(int))
    i = np.concatenate([np.arange(n - k) for k in lag])
    return i, np.concatenate([np.arange(k, n) for k in lag])


def angles_between(R: Array) -> Array:
    """Return the rotation angle of each of `motions_between`, which no choice of frames changes."""
    i, j = motions_between(len(R))
    return np.asarray(rotation_angles(R[i].mT @ R[j]))


def typical_difference(robot: Array, camera: Array) -> float:
    """Return the standard deviation of the difference of `angles_between` of two sides, by what most poses share."""
    return float(np.quantile(np.abs(robot - camera), MAJORITY**2)) / QUANTILE_OF_MAJORITY


def agreement(G: Array, C: Array, scale_free: bool = True) -> Agreement | None:
    """Return how well poses ``G X C = W`` of two sides agree; None where their motions do not determine X.

    ``scale_free``: the camera's translations have a factor of their own.
    """
    n = len(G)
    i, j = motions_between(n)
    difference = np.abs(angles_between(G[:, :3, :3]) - angles_between(C[:, :3, :3]))
    counts = _counting(_medians(n, np.concatenate([i, j]), np.tile(difference, 2)), ROTATION_FLOOR_RAD)
    A, B = inverse(G)[j] @ G[i], C[j] @ inverse(C)[i]
    X = angle = None
    for _ in range(ROUNDS):
        inside = counts[i] & counts[j]
        try:
            X = solve_limit(A[inside], B[inside])
        except DegenerateMotionError:
            break
        W = G[:, :3, :3] @ X[:3, :3] @ C[:, :3, :3]
        angle = np.asarray(rotation_angles(_mean(W[counts]).T @ W))
        again = _counting(angle, ROTATION_FLOOR_RAD)
        if (again == counts).all():
            break
        counts = again
    if X is None or angle is None:
        return None
    agree = counts
    distance, length, scale, counts = _translation(G, C, X[:3, :3], counts, scale_free)
    rms = float(np.sqrt(np.mean(angle[counts] ** 2)))
    return Agreement(rms, distance, length, scale, float(np.mean(counts)), X[:3, :3], agree)


def _medians(n: int, pose: NDArray[np.intp], values: Array) -> Array:
    """(n,) medians of the values (N,) of each of n poses, which all have some."""
    ordered = values[np.lexsort((values, pose))]
    count = np.bincount(pose, minlength=n)
    start = np.cumsum(count) - count
    return np.asarray(0.5 * (ordered[start + (count - 1) // 2] + ordered[start + count // 2]))


def _counting(residuals: Array, floor: float) -> NDArray[np.bool_]:
    """Return the poses that fit like the majority."""
    if len(residuals) < MIN_POSES_TO_TRIM:
        return np.ones(len(residuals), dtype=bool)
    least = float(np.quantile(residuals, MAJORITY))
    return np.asarray(residuals <= max(OUTLIER_RATIO * least, floor))


def _mean(R: Array) -> Array:
    """Return the mean rotation, nearest to the sum of the matrices."""
    U, _, Vt = np.linalg.svd(R.sum(axis=0))
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def _translation(
    G: Array, C: Array, R: Array, counts: NDArray[np.bool_], scale_free: bool
) -> tuple[float, float, float, NDArray[np.bool_]]:
    """Return the RMS of the translation of W, |t_X|, the scale and the poses that count, by linear least squares.

    ``R_G t_X + s R_G R_X t_C - t_W = -t_G``, with s = 1 where the fit would make it negative.
    """
    n = len(G)
    R_G, eye = G[:, :3, :3], np.broadcast_to(np.eye(3), (n, 3, 3))
    seen = R_G @ R @ C[:, :3, 3:]  # (n, 3, 1)
    fixed = np.concatenate([R_G, -eye], axis=2)  # (n, 3, 6)
    free = np.concatenate([fixed, seen], axis=2)  # (n, 3, 7)
    among = counts
    for _ in range(ROUNDS):
        scale, right = 1.0, -G[:, :3, 3]
        if scale_free:
            scale = float(np.linalg.lstsq(free[among].reshape(-1, 7), right[among].reshape(-1), rcond=None)[0][6])
            scale = scale if scale > 0.0 else 1.0
        right = right - scale * seen[..., 0]
        solution = np.linalg.lstsq(fixed[among].reshape(-1, 6), right[among].reshape(-1), rcond=None)[0]
        distance = np.linalg.norm(fixed @ solution - right, axis=1)
        among = counts & _counting(distance, 0.0)
    if among.sum() < MAJORITY * counts.sum():
        among = counts
    return float(np.sqrt(np.mean(distance[among] ** 2))), float(np.linalg.norm(solution[:3])), scale, among
