"""Detection of new pose files that are misread or paired wrongly, where they strongly contradict a calibration.

Each other reading of the files (unit, direction, quaternion order, exchanged files, a factor on lengths, pairing,
shifted rows) is judged by d^2 against the calibration. Unlike `diagnostics.misread_files` nothing is fitted: X and W
are known, and one pose is enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...core.geometry.se3 import Array, inverse, logarithm
from ...core.limits import MAX_LEFT_SHARE
from ...core.presentation.units import LENGTH_UNITS
from ...core.rounding import TINY
from ...findings import GROSS_EXCESS, Finding
from ...fit.diagnostics.misread_files import rotation_readings
from ...fit.graph.rows import NewRows
from ...model.poses.pose_pairs import PosePairs

# Findings that say that the files are misread, or of another rig.
MISREAD = ("maintenance.misread", "maintenance.pairing", "maintenance.another_rig")
# How files may be meant: the values of the finding.
Reading = dict[str, str | float | None]
Judge = Callable[..., float]  # poses, and which rows they are of those that were given


def misread(
    X: Array,
    W: Array,
    poses: PosePairs,
    evidence: NewRows,
    d2_of: Judge,
    *,
    least_factor: float = 0.03,
    far: float = 1.0,
    agrees: float = 2.0,
    max_shift: int = 3,
) -> Finding | None:
    """Return how else the files may be meant, where that explains a gross contradiction; ``d2_of`` judges poses.

    The files are doubted where the residuals are `GROSS_EXCESS` times as large as expected, or the poses ``far`` off
    (`_rough`), as errors of lengths in a wrong unit hide the contradiction. Another reading may leave `MAX_LEFT_SHARE`
    of d^2; of poses that are far off ``agrees`` times what is expected. Factors on translations that differ
    from 1 by less than ``least_factor`` are not tried (they are causes among others), nor files shifted by more than
    ``max_shift`` rows.
    """
    d2, as_given = evidence.d2, _rough(X, W, poses.robot, poses.camera, poses.setup)
    if d2 < GROSS_EXCESS**2 * evidence.dof and as_given < far:
        return None
    limit = max(MAX_LEFT_SHARE * d2, agrees * evidence.dof if as_given > far else 0.0)
    bare = replace(poses, camera_calibration=None, camera_covariance=None, timing=None, truth=None)
    fits = [
        (found, reading)
        for reading, robot, camera in _readings(bare)
        if _rough(X, W, robot, camera, poses.setup) <= 0.3 * as_given
        and (found := d2_of(replace(bare, robot=robot, camera=camera))) < limit
    ]
    if fits:
        return Finding("maintenance.misread", "caution", min(fits, key=lambda fit: fit[0])[1])
    for side, factor in _factors(X, W, poses).items():
        if abs(factor - 1.0) > least_factor and factor > 0:
            scaled = _scaled(getattr(bare, side), factor)
            other = replace(bare, robot=scaled) if side == "robot" else replace(bare, camera=scaled)
            if d2_of(other) < max(limit, agrees * evidence.dof):
                return scale_finding(side, factor)
    order = _pairing(X, W, bare, evidence)
    if order is not None and d2_of(replace(bare, camera=bare.camera[order])) < MAX_LEFT_SHARE * d2:
        rows = np.flatnonzero(order != np.arange(len(order)))
        values = {"rows": rows.tolist()[:10], "count": len(rows), "n": poses.n}
        return Finding("maintenance.pairing", "caution", values)
    for shift in (k for size in range(1, max_shift + 1) for k in (size, -size) if poses.n - size > 1):
        rows = np.arange(max(0, -shift), poses.n - max(0, shift))
        part = replace(bare.rows(rows), camera=bare.camera[rows + shift])
        if d2_of(part, rows) / part.n < MAX_LEFT_SHARE * d2 / poses.n:
            return Finding("maintenance.misread", "caution", {"kind": "rows", "file": None, "shift": shift})
    return None


def scale_finding(side: str, factor: float) -> Finding:
    """Return what is said of poses that agree once the translations of one side are multiplied by a factor."""
    return Finding("maintenance.misread", "caution", {"kind": "scale", "file": side, "factor": factor})


def _readings(poses: PosePairs) -> list[tuple[Reading, Array, Array]]:
    G, C = poses.robot, poses.camera
    found: list[tuple[Reading, Array, Array]] = [
        ({"kind": "inverse", "file": "robot"}, inverse(G), C),
        ({"kind": "inverse", "file": "camera"}, G, inverse(C)),
        ({"kind": "inverse", "file": None}, inverse(G), inverse(C)),
        ({"kind": "swapped", "file": None}, C, G),
        *rotation_readings(G, C),
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


def _factors(X: Array, W: Array, poses: PosePairs) -> dict[str, float]:
    """The factor on the translations of each side that fits best: ``s_G t_G + R_G t_X + s_C R_G R_X t_C = t_W``."""
    G = poses.effective_robot
    moved, seen, bracket = G[:, :3, 3], ((G @ X)[:, :3, :3] @ poses.camera[:, :3, 3:])[..., 0], G[:, :3, :3] @ X[:3, 3]
    of = {"camera": (seen, W[:3, 3] - moved - bracket), "robot": (moved, W[:3, 3] - seen - bracket)}
    return {side: float(np.sum(part * meant) / max(float(np.sum(part**2)), TINY)) for side, (part, meant) in of.items()}


def _rough(X: Array, W: Array, robot: Array, camera: Array, setup: str) -> float:
    """Sum of rotation (rad) and translation (in distances of the camera) that ``G X C`` differs from W by, median."""
    G = inverse(robot) if setup == "eye-to-hand" else robot
    left = G @ X @ camera
    turn = np.linalg.norm(logarithm(left[:, :3, :3] @ W[:3, :3].T), axis=-1)
    shift = np.linalg.norm(left[:, :3, 3] - W[:3, 3], axis=-1)
    size = np.linalg.norm((inverse(X) @ inverse(G) @ W)[:, :3, 3], axis=-1)
    return float(np.median(turn + shift / np.maximum(size, 1e-9)))


def _pairing(X: Array, W: Array, poses: PosePairs, evidence: NewRows, max_poses: int = 200) -> Array | None:
    """The order of the camera rows that fits the robot rows best, if it is another."""
    m = poses.n
    if not 2 <= m <= max_poses:
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
