"""Estimate of the factor of length between robot and camera, which shows another unit or another size of the target."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...core.files.source import Source
from ...core.geometry.se3 import Array, inverse
from ...core.presentation.units import LENGTH_UNITS
from ...errors import DegenerateMotionError
from ...methods.limit import solve_limit
from .consistency import LARGE_ROTATION_RAD, consistency
from .readings import Reading

# A rig whose longest translation is below this is unusually small: its file was read in too small a unit.
SMALL_RIG_M = 0.02
# A factor is that of a unit if their logarithms differ by less: of 2.54; and of 10, 25.4 and more, which no target has.
SMALL_UNIT_TOLERANCE, LARGE_UNIT_TOLERANCE = 0.03, 0.15


def scaled_reading(G: Array, C: Array, shift: float, sources: Iterable[Source] = ()) -> Reading | None:
    """Return the factor on the camera's translations that makes them fit, with the unit it may come from, if one does.

    ``bag``: the poses come from a ROS bag, for which there are other options.
    """
    scale = _scaled_camera(G, C) if len(G) >= 6 else None  # four numbers fitted to fewer poses fit anything
    if scale is None or abs(scale - 1.0) <= 0.02:
        return None
    camera = C.copy()
    camera[:, :3, 3] *= scale
    fit = consistency(G, camera)
    if fit is None or fit[0] > 2.0 * LARGE_ROTATION_RAD or fit[1] >= 0.4 * shift:  # a factor leaves the rotations
        return None
    file, unit = _unit_of(scale, G, C)
    found: Reading = {"kind": "scale", "factor": scale, "file": file, "unit": unit}
    if unit is None and not _between_units(scale):
        found["target"] = True
    return found | ({"bag": True} if any(source.format == "rosbag" for source in sources) else {})


def _unit_of(scale: float, G: Array, C: Array) -> tuple[str | None, str | None]:
    """Return the file that is in another unit, and the unit, for a factor on the camera's translations.

    A factor has two causes: one file is in a smaller unit, or the other was read in one and is in metres, which is the
    cause where its translations are smaller than any rig.
    """
    small = [file for file, T in (("robot", G), ("camera", C)) if np.abs(T[:, :3, 3]).max() < SMALL_RIG_M]
    for unit in ("mm", "cm", "in"):
        for file, other, factor in (
            ("camera", "robot", LENGTH_UNITS[unit]),
            ("robot", "camera", 1.0 / LENGTH_UNITS[unit]),
        ):
            if _near(scale, factor):
                return (other, "m") if other in small else (file, unit)
    return None, None


def _between_units(scale: float) -> bool:
    """Return whether a factor is that between two units of length, none of which need be metres."""
    ratios = np.divide.outer(list(LENGTH_UNITS.values()), list(LENGTH_UNITS.values()))
    return any(_near(scale, ratio) for ratio in ratios[ratios != 1.0].tolist())


def _near(scale: float, factor: float) -> bool:
    """Return whether a factor is that of a unit: near 1 a target may have it, far from 1 nothing else has."""
    limit = LARGE_UNIT_TOLERANCE if abs(np.log(factor)) > np.log(9.0) else SMALL_UNIT_TOLERANCE
    return bool(abs(np.log(scale / factor)) < limit)


def _scaled_camera(G: Array, C: Array) -> float | None:
    """Return the factor s on the camera's translations that fits best: ``R_G t_X + s R_G R_X t_C - t_W = -t_G``."""
    n = len(G)
    i, j = np.arange(n - 1), np.arange(1, n)
    i, j = np.concatenate([i, np.arange(n // 2)]), np.concatenate([j, np.arange(n // 2) + n - n // 2])
    try:
        R = solve_limit(inverse(G)[j] @ G[i], C[j] @ inverse(C)[i])[:3, :3]
    except DegenerateMotionError:
        return None
    R_G, eye = G[:, :3, :3], np.broadcast_to(np.eye(3), (n, 3, 3))
    M = np.concatenate([R_G, R_G @ R @ C[:, :3, 3:], -eye], axis=2).reshape(-1, 7)
    solution, _, rank, _ = np.linalg.lstsq(M, -G[:, :3, 3].reshape(-1), rcond=None)
    return float(solution[3]) if rank == 7 and solution[3] > 0 else None
