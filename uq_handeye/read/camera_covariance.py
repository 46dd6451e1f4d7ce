"""Covariances that come with the poses of a camera: read from a file, given to pairs of poses, and read again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.geometry.conventions import CovarianceReading
from ..core.geometry.se3 import Array
from ..errors import InputError
from ..formats.contents import FRAMES, Side, finished_covariance
from ..model.errors.joint_covariance import JointCovariance
from ..model.poses.pose_pairs import PosePairs
from ..model.poses.stream import Stream
from .pairing_by_time import SYNCHRONOUS_S


def camera_covariance(
    side: Side,
    units: str | None,
    form: str | None,
    frame: str,
    poses: Array,
    asked: CovarianceReading | None = None,
) -> tuple[Array | None, CovarianceReading | None, str]:
    """Return the covariances (n, 6, 6) that a file gives its camera poses, how they were read, and a note.

    ``asked``: how they are read, in place of what the file says. Numbers that are no covariances are not used, but for
    a reading that was asked for.
    """
    if side.covariance is None:
        return None, None, ""
    reading = CovarianceReading(side.convention) if asked is None else asked
    try:
        S = finished_covariance(side, "camera", units, form, frame, poses, reading)
    except InputError as error:
        if asked is not None:
            raise
        return None, None, f"covariances are not used: {str(error)[0].lower()}{str(error)[1:]}"
    if S is None:
        return None, None, "covariances are not known for every pose, and not used"
    if FRAMES["camera"][1] in (frame, side.frame):
        reading = replace(reading, inverse=not reading.inverse)
    return S, reading, f"covariances of the poses, read as {reading.words}"


def with_covariance(poses: PosePairs, camera: Stream) -> PosePairs:
    """Return pairs with the covariances of a stream where all camera poses are those of the stream as measured.

    Poses that were interpolated, or averaged at a stop, have other covariances, and get none.
    """
    if camera.covariance is None or poses.timestamps is None or poses.camera_known:
        return poses
    order = np.argsort(camera.timestamps)
    times = camera.timestamps[order]
    rows = order[np.clip(np.searchsorted(times, poses.timestamps - SYNCHRONOUS_S), 0, len(times) - 1)]
    apart = np.abs(camera.timestamps[rows] - poses.timestamps)
    if apart.max() > SYNCHRONOUS_S or not np.allclose(camera.poses[rows], poses.camera, rtol=0.0, atol=1e-9):
        return poses
    S = JointCovariance.of_each(camera.covariance[rows])
    return replace(poses, camera_covariance=S, camera_read_as=camera.read_as)


def read_again(poses: PosePairs, reading: CovarianceReading | None) -> PosePairs:
    """Return pairs whose covariances of a file are read in another way; None: as they are."""
    before, S = poses.camera_read_as, poses.camera_covariance
    if reading is None or before is None or S is None:
        return poses
    numbers = before.write(S.own, poses.camera)
    if before.inverse:  # the poses of the file were inverted
        reading = replace(reading, inverse=not reading.inverse)
    own = reading.read(numbers, poses.camera, "covariance of the camera poses")
    return replace(poses, camera_covariance=JointCovariance.of_each(own), camera_read_as=reading)
