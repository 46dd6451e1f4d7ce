r"""Pixels that are counted from the corner of the first pixel, and camera poses that were computed from them.

The pixels of this package, as OpenCV's, have the centre of the first pixel at (0, 0). Other detectors, such as those of
AprilTag's libraries, have its corner there, so that their pixels are larger by `CORNER_PX`. A pose C that was fitted to
such pixels with a camera matrix of OpenCV is the fit to ``z_j = project(k, C P_j)``; that of the corners as they are
here is the fit to ``z_j - (0.5, 0.5)``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.geometry.se3 import Array
from .adjustment.bundle import BundleUnknowns, adjust
from .board_shape import flat_shape
from .corners import Corners
from .models import CORNER_PX, MODELS

PIXEL_ORIGINS = ("centre", "corner")


def corners_from_centre(corners: Corners) -> Corners:
    """Return corners whose pixels were counted from the corner of the first pixel."""
    return replace(corners, pixels=corners.pixels - CORNER_PX)


def poses_from_centre(poses: Array, points: Array, model: str, parameters: Array) -> Array:
    """Return ``camera_T_target`` (n, 4, 4) of poses fitted to pixels that were counted from the corner.

    ``points`` (m, 3) are those of the target that the poses were fitted to; raises `InputError` where a fit is none.
    """
    lens, n, m = MODELS[model], len(poses), len(points)
    seen = points @ poses[:, :3, :3].mT + poses[:, None, :3, 3]
    pixels = lens.project(parameters, seen).pixels - CORNER_PX
    corners = Corners(np.repeat(np.arange(n), m), np.tile(points, (n, 1)), pixels.reshape(-1, 2))
    unknowns = BundleUnknowns.poses_only(lens, flat_shape(points))
    return np.asarray(adjust(unknowns, corners, (parameters, poses), pixel_noise=1.0).poses)
