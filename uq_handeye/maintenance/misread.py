"""New poses that contradict a calibration grossly: the reading or the pairing of the files that would agree with it.

Unlike `input_checks.misread_files` nothing is fitted: X and W are known, and one pose is enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from ..findings import Finding
from ..formatting.units import LENGTH_UNITS
from ..geometry.se3 import Array, inverse, logarithm
from ..poses.pose_pairs import PosePairs
from ..posterior.rows import NewRows

# Findings that say that the files are misread.
MISREAD = ("maintenance.misread", "maintenance.pairing")
# d^2 per number from which the files are doubted, and its share that another reading may leave.
GROSS, LEFT = 25.0, 0.01
# Poses up to which all pairings are tried.
MOST_PAIRED = 200

# Rows by which one file may begin before the other.
MOST_ROWS = 3
# A factor on the camera's translations that differs from 1 by less may be a focal length.
LENS = 0.2

Judge = Callable[..., float]  # poses, and which rows they are of those that were given


def misread(
    X: Array, W: Array, poses: PosePairs, evidence: NewRows, d2_of: Judge, lens: bool = False
) -> Finding | None:
    """Return how else the files may be meant, where that explains a gross contradiction; ``d2_of`` judges poses.

    ``lens``: a change of the focal length explains the poses.
    """
    d2 = evidence.d2
    if d2 < GROSS * evidence.dof:
        return None
    bare = replace(poses, camera_calibration=None, camera_covariance=None, timing=None, truth=None)
    best: tuple[float, dict[str, Any]] | None = None
    for reading, robot, camera in _readings(bare):
        rough = _rough(X, W, robot, camera, poses.setup)
        if rough > 0.3 * _rough(X, W, poses.robot, poses.camera, poses.setup):
            continue
        found = d2_of(replace(bare, robot=robot, camera=camera))
        if found < LEFT * d2 and (best is None or found < best[0]):
            best = found, reading
    if best is not None:
        return Finding("maintenance.misread", "caution", best[1])
    factor = _factor(X, W, poses)
    if abs(factor - 1.0) > (LENS if lens else 0.0) and factor > 0:
        found = d2_of(replace(bare, camera=_scaled(bare.camera, factor)))
        if found < LEFT * d2:
            return Finding("maintenance.misread", "caution", {"kind": "scale", "file": "camera", "factor": factor})
    order = _pairing(X, W, bare, evidence)
    if order is not None and d2_of(replace(bare, camera=bare.camera[order])) < LEFT * d2:
        rows = np.flatnonzero(order != np.arange(len(order)))
        values = {"rows": rows.tolist()[:10], "count": len(rows), "n": poses.n}
        return Finding("maintenance.pairing", "caution", values)
    for shift in (k for size in range(1, MOST_ROWS + 1) for k in (size, -size) if poses.n - size > 1):
        rows = np.arange(max(0, -shift), poses.n - max(0, shift))
        part = replace(bare.rows(rows), camera=bare.camera[rows + shift])
        if d2_of(part, rows) / part.n < LEFT * d2 / poses.n:
            return Finding("maintenance.misread", "caution", {"kind": "rows", "file": None, "shift": shift})
    return None


def _readings(poses: PosePairs) -> list[tuple[dict[str, Any], Array, Array]]:
    G, C = poses.robot, poses.camera
    found: list[tuple[dict[str, Any], Array, Array]] = [
        ({"kind": "inverse", "file": "robot"}, inverse(G), C),
        ({"kind": "inverse", "file": "camera"}, G, inverse(C)),
        ({"kind": "inverse", "file": None}, inverse(G), inverse(C)),
        ({"kind": "swapped", "file": None}, C, G),
    ]
    for order, shift in (("wxyz", -1), ("xyzw", 1)):
        robot, camera = _reordered(G, shift), _reordered(C, shift)
        found += [
            ({"kind": "quaternion", "file": "robot", "order": order}, robot, C),
            ({"kind": "quaternion", "file": "camera", "order": order}, G, camera),
            ({"kind": "quaternion", "file": None, "order": order}, robot, camera),
        ]
    for unit in ("mm", "cm", "in"):
        for factor, given, meant in ((LENGTH_UNITS[unit], "m", unit), (1.0 / LENGTH_UNITS[unit], unit, "m")):
            robot, camera = _scaled(G, factor), _scaled(C, factor)
            found += [
                ({"kind": "unit", "file": "robot", "unit": meant, "given": given}, robot, C),
                ({"kind": "unit", "file": "camera", "unit": meant, "given": given}, G, camera),
                ({"kind": "unit", "file": None, "unit": meant, "given": given}, robot, camera),
            ]
    return found


def _factor(X: Array, W: Array, poses: PosePairs) -> float:
    """The factor s on the camera's translations that fits best: ``R_G R_X s t_C = t_W - t_G - R_G t_X``."""
    G = poses.effective_robot
    seen = (G @ X)[:, :3, :3] @ poses.camera[:, :3, 3:]
    meant = W[:3, 3] - (G @ X)[:, :3, 3]
    return float(np.sum(seen[..., 0] * meant) / max(float(np.sum(seen**2)), 1e-300))


def _rough(X: Array, W: Array, robot: Array, camera: Array, setup: str) -> float:
    """Sum of rotation (rad) and translation (in distances of the camera) that ``G X C`` differs from W by, median."""
    G = inverse(robot) if setup == "eye-to-hand" else robot
    left = G @ X @ camera
    turn = np.linalg.norm(logarithm(left[:, :3, :3] @ W[:3, :3].T), axis=-1)
    shift = np.linalg.norm(left[:, :3, 3] - W[:3, 3], axis=-1)
    size = np.linalg.norm((inverse(X) @ inverse(G) @ W)[:, :3, 3], axis=-1)
    return float(np.median(turn + shift / np.maximum(size, 1e-9)))


def _pairing(X: Array, W: Array, poses: PosePairs, evidence: NewRows) -> Array | None:
    """The order of the camera rows that fits the robot rows best, if it is another."""
    m = poses.n
    if not 2 <= m <= MOST_PAIRED:
        return None
    G = inverse(poses.robot) if poses.setup == "eye-to-hand" else poses.robot
    both = (G @ X)[:, None] @ poses.camera[None]
    turn = np.linalg.norm(logarithm(both[..., :3, :3] @ W[:3, :3].T), axis=-1)
    shift = np.linalg.norm(both[..., :3, 3] - W[:3, 3], axis=-1)
    S = evidence.own.mean(axis=0)
    cost = turn**2 / np.trace(S[:3, :3]) + shift**2 / np.trace(S[3:, 3:])
    order = linear_sum_assignment(np.minimum(cost, 1e4 * np.median(cost)))[1]
    return None if (order == np.arange(m)).all() else np.asarray(order)


def _scaled(T: Array, factor: float) -> Array:
    result = T.copy()
    result[:, :3, 3] *= factor
    return result


def _reordered(T: Array, shift: int) -> Array:
    """Poses whose quaternion is read in the other order."""
    result = T.copy()
    columns = Rotation.from_matrix(T[:, :3, :3]).as_quat()
    result[:, :3, :3] = Rotation.from_quat(np.roll(columns, shift, axis=1)).as_matrix()
    return result
