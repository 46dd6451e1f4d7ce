"""Detection of rows in the alphabetical order of numbered names: 1, 10, 11, ..., 2, 20, ..."""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array
from ...findings import Finding
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.residuals import rotation_angles
from .consistency import LARGE_ROTATION_RAD, MAX_MISFIT_SHARE, consistency


def alphabetical_rows(poses: PosePairs) -> Finding | None:
    """Return a finding if robot and camera agree once the rows of one of them are sorted by number.

    Programs list numbered names in alphabetical order: 1, 10, 11, ..., 2, 20, ...
    """
    G, C, rows = poses.effective_robot, poses.camera, np.arange(poses.n)
    travel = float(np.linalg.norm(np.std(G[:, :3, 3], axis=0)))
    for first in (0, 1):  # the number of the first name
        names = sorted(range(first, first + poses.n), key=str)
        by_number = np.argsort(names, kind="stable")
        if (by_number == rows).all():
            continue
        for file, (robot, camera) in (("camera", (G, C[by_number])), ("robot", (G[by_number], C))):
            if _disagreement(robot, camera) > 2.0 * LARGE_ROTATION_RAD:
                continue
            fit = consistency(robot, camera)
            if fit is not None and fit[0] < LARGE_ROTATION_RAD and fit[1] < MAX_MISFIT_SHARE * travel:
                return Finding(
                    "input_checks.alphabetical_rows", "failure", {"file": file, "order": [int(k) for k in names[:4]]}
                )
    return None


def _disagreement(G: Array, C: Array) -> float:
    """Return the RMS difference of the angles from each pose to the next."""
    robot, camera = (rotation_angles(T[:-1, :3, :3].mT @ T[1:, :3, :3]) for T in (G, C))
    return float(np.sqrt(np.mean((robot - camera) ** 2)))
