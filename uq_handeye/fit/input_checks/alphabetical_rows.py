"""Rows of one file in the alphabetical order of numbered names: 1, 10, 11, ..., 2, 20, ...

Programs list pictures so. The other file has its rows by number, and most rows do not belong together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...findings import Finding
from ...model.poses.motions import rotation_angles
from ...model.poses.pose_pairs import PosePairs
from .board_rotation import LARGE_ROTATION, consistency
from .misread_files import FITS

CODE = "input_checks.alphabetical_rows"


def alphabetical_rows(poses: PosePairs) -> Finding | None:
    """Return a finding if robot and camera agree once the rows of one of them are sorted by number."""
    G, C, rows = poses.effective_robot, poses.camera, np.arange(poses.n)
    travel = float(np.linalg.norm(np.std(G[:, :3, 3], axis=0)))
    for first in (0, 1):  # the number of the first name
        by_number = np.argsort(sorted(range(first, first + poses.n), key=str), kind="stable")
        if (by_number == rows).all():
            continue
        for file, (robot, camera) in (("camera", (G, C[by_number])), ("robot", (G[by_number], C))):
            if _disagreement(robot, camera) > 2.0 * LARGE_ROTATION:
                continue
            fit = consistency(robot, camera)
            if fit is not None and fit[0] < LARGE_ROTATION and fit[1] < FITS * travel:
                return Finding(CODE, "failure", {"file": file, "order": _beginning(first, poses.n)})
    return None


def _disagreement(G: Array, C: Array) -> float:
    """Return the RMS difference of the angles from each pose to the next."""
    robot, camera = (rotation_angles(T[:-1, :3, :3].mT @ T[1:, :3, :3]) for T in (G, C))
    return float(np.sqrt(np.mean((robot - camera) ** 2)))


def _beginning(first: int, n: int) -> list[int]:
    """Return the first numbers of the alphabetical order."""
    names: NDArray[np.intp] = np.array(sorted(range(first, first + n), key=str))
    return [int(name) for name in names[:4]]
