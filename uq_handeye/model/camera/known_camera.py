"""Poses of a board in new pictures of a calibrated camera, with its intrinsics unchanged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import InputError, NotConvergedError
from .adjustment.bent_edges import bias
from .adjustment.bundle import poses_only
from .adjustment.disc_centres import offset
from .adjustment.initial_guess import poses_of
from .adjustment.two_minima import MAX_AMBIGUOUS_POINTS, better_start
from .calibrate import MAX_DISC_ROUNDS, MIN_SHIFT_PX
from .corners import Corners
from .rays import rays
from .result import CameraCalibration


def poses_by_known_camera(seen: CameraCalibration, corners: Corners) -> CameraCalibration:
    """Return the same camera with new pictures, one or more; only their poses are estimated.

    The covariance of the poses is that of the pixel noise of the calibration; that of the intrinsics is not in it, as
    they share their errors with the pictures before.

    Raises
    ------
    InputError
        Pictures of another size.
    NotConvergedError
        The poses do not converge with these intrinsics.
    """
    if corners.image_size is not None and corners.image_size != seen.image_size:
        got, expected = ("{} x {}".format(*size) for size in (corners.image_size, seen.image_size))
        raise InputError(f"Expected pictures of {expected} pixels, as those of the calibration, got {got}.")
    before = seen.bundle
    seen_at = rays(before.model, before.intrinsics, corners.pixels)
    poses = poses_of(corners, np.ascontiguousarray(seen_at[:, :2] / seen_at[:, 2:]))
    if len(before.shape.points) < MAX_AMBIGUOUS_POINTS:
        poses = better_start(before.model, before.parameters, before.shape, corners, poses)
    bundle = poses_only(before, corners, poses)
    if corners.window is not None:
        corners = replace(corners, pixels=corners.pixels - bias(bundle, corners), window=None)
        bundle = poses_only(before, corners, bundle.poses)
    taken = np.zeros((corners.m, 2))
    for _ in range(0 if corners.diameter is None else MAX_DISC_ROUNDS):
        d = offset(bundle, corners)
        if np.abs(d - taken).max() < MIN_SHIFT_PX:
            break
        corners, taken = replace(corners, pixels=corners.pixels - (d - taken)), d
        bundle = poses_only(before, corners, bundle.poses)
    corners = replace(corners, diameter=None)
    if not bundle.converged:
        raise NotConvergedError("The poses of the new pictures do not converge with the intrinsics given.", bundle)
    return replace(seen, bundle=bundle, corners=corners, findings=())
