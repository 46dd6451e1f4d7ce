r"""Tags seen by their corners in pixels: poses of each by the intrinsics of the camera and the side of the tag.

``apriltag_msgs/AprilTagDetection`` has the four corners in the order in which the AprilTag library has them
(AprilRobotics/apriltag, ``apriltag.h``): counter-clockwise as one sees the tag, its lower left first; ArUco goes
clockwise from the upper left. That library has the centre of the first pixel at (0.5, 0.5) (measured with rendered
tags), cameras are calibrated with (0, 0): half a pixel is subtracted. Both orders are brought into that of
`camera.board.tag_points`; which way they go round shows in the picture. The frame of the tag is in its middle, x right,
y up, z towards the camera.

The pose of a small tag has two solutions that fit its corners nearly as well. Both are kept, and `decide_stream` takes
the one that agrees with the robot and the other poses, as for pictures (`diagnostics.pose_ambiguity`).
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.limits import MIN_POSES_FOR_ROBUST
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...fit.diagnostics.pose_ambiguity import decide
from ...formats.ros_messages import MessageError, number, part
from ...model.camera.adjustment.bundle import Bundle, BundleUnknowns, adjust
from ...model.camera.adjustment.initial_guess import poses_of
from ...model.camera.adjustment.two_minima import Minima, both_minima
from ...model.camera.board_shape import flat_shape
from ...model.camera.corners import Corners
from ...model.camera.description import tag_points
from ...model.camera.rays import rays
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.stream import Stream
from .camera_info import CameraInfo
from .message_types import RosMessage
from .track import Samples, TimedPoses

# Residual of a corner coordinate beyond which a detection is no picture of the tag by this camera.
MAX_CORNER_RESIDUAL_PX = 5.0


class TagTrack(Samples):
    """Corners of one tag, eight coordinates, as they arrive."""

    def __init__(self, name: str) -> None:
        super().__init__(name, 8)

    def corners(self) -> tuple[NDArray[np.float64], Array]:
        """Return times (n,), each once, and pixels (n, 4, 2) in the order of `tag_points`."""
        table = self.rows[np.isfinite(self.rows).all(axis=1)]
        table = table[np.unique(table[:, 0], return_index=True)[1]]
        pixels = table[:, 1:].reshape(-1, 4, 2)
        x, y = pixels[..., 0], pixels[..., 1]
        area = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)  # y points down
        pixels = np.where((area > 0)[:, None, None], pixels, pixels[:, ::-1])
        fine = np.abs(area) > 1.0
        return table[fine, 0], pixels[fine]


def corners_in(message: RosMessage) -> list[tuple[str, list[float]]] | None:
    """Return name and pixels of each tag of a message; None: its detections have no corners."""
    detections = part(message, "detections")
    if detections is None:
        return None
    found = []
    for one in detections:
        corners, ids = part(one, "corners"), part(one, "id")
        if corners is None or len(corners) not in (4, 8) or ids is None:
            return None
        flat = [
            number(v, "corners") for c in corners for v in ((part(c, "x"), part(c, "y")) if len(corners) == 4 else [c])
        ]
        if part(one, "decision_margin") is not None:  # the AprilTag library
            flat = [value - 0.5 for value in flat]  # the centre of its first pixel
        if len(flat) != 8:
            raise MessageError("four corners")
        found.append((f"{part(one, 'family') or 'tag'}_{number(ids, 'id'):.0f}", flat))
    return found


def plain_name(text: str) -> str:
    """Return a name in small letters, with _ for every other mark."""
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def same_tag(name: str, asked: str) -> bool:
    """Return whether a tag is meant: ``tag36h11_0`` as tag36h11:0, 36h11_0 or 0."""
    plain, wanted = plain_name(name), plain_name(asked)
    return wanted in (plain, plain.removeprefix("tag"), f"tag_{plain.rpartition('_')[2]}", plain.rpartition("_")[2])


def corners_of(track: TagTrack, side: float) -> tuple[NDArray[np.float64], Corners]:
    """Return times (n,) and the corners of a tag with the side (m), one detection a picture."""
    times, pixels = track.corners()
    if not len(times):
        raise InputError(f"{track.name}: no detection has four corners.")
    n = len(times)
    return times, Corners(np.repeat(np.arange(n), 4), np.tile(tag_points(side), (n, 1)), pixels.reshape(-1, 2))


def adjusted(corners: Corners, info: CameraInfo) -> Bundle:
    """Return the poses of least squares of a tag's corners with these intrinsics."""
    model, parameters = info.lens()
    seen = rays(model, parameters, corners.pixels)
    if not np.isfinite(seen).all():
        raise InputError(
            "Corners of the tag lie where the camera sees nothing. Check its intrinsics (--camera-matrix)."
        )
    start = poses_of(corners, np.ascontiguousarray(seen[:, :2] / seen[:, 2:]))
    return adjust(BundleUnknowns.poses_only(model, flat_shape(corners.points)), corners, (parameters, start))


def pixels_off(corners: Corners, bundle: Bundle, poses: Array) -> Array:
    """Return the residuals (n, 8) of the corners at poses (n, 4, 4), pixels."""
    C = poses[corners.picture]
    at = (C[:, :3, :3] @ corners.points[..., None])[..., 0] + C[:, :3, 3]
    return np.asarray(bundle.model.project(bundle.parameters, at).pixels - corners.pixels).reshape(len(poses), -1)


def tag_poses(track: TagTrack, info: CameraInfo, side: float) -> TimedPoses:
    """Return the poses of a tag by least squares of its corners."""
    times, corners = corners_of(track, side)
    bundle = adjusted(corners, info)
    minima = both_minima(bundle, corners)
    n = len(times)
    fine = np.abs(pixels_off(corners, bundle, minima.poses[0])).max(axis=1) < MAX_CORNER_RESIDUAL_PX
    notes = [f"{n} poses from corners, side {side:g} m; the tag's frame is in its middle, z towards the camera"]
    if not fine.all():
        limit = f"{MAX_CORNER_RESIDUAL_PX:g} px"
        notes.append(f"{int((~fine).sum())} detections fit no pose of the tag within {limit}, and are left out")
    kept = Minima(minima.poses[:, fine], minima.own[:, fine], minima.squares[:, fine])
    return TimedPoses(times[fine], np.asarray(kept.poses[0]), notes, kept)


class Decided(NamedTuple):
    """The stream with the solutions that the other poses agree with."""

    stream: Stream
    doubtful: int  # poses with two solutions that the corners do not decide between
    changed: int
    undecided: int


def decide_stream(pairs: PosePairs, stream: Stream, minima: Minima) -> Decided | None:
    """Return the camera's stream with the solution of each pose that robot and other poses agree with.

    ``pairs`` are those of the stream as it is, its poses not interpolated. None: nothing is in doubt, the poses of the
    pairs are not those of the stream, or they do not determine X.
    """
    row_of = {pose.tobytes(): k for k, pose in enumerate(np.ascontiguousarray(stream.poses))}
    found = [row_of.get(pose.tobytes()) for pose in np.ascontiguousarray(pairs.camera)]
    if len(found) < MIN_POSES_FOR_ROBUST or any(row is None for row in found):
        return None
    rows = np.array(found, dtype=np.intp)
    here = Minima(minima.poses[:, rows], minima.own[:, rows], minima.squares[:, rows])
    if not here.doubtful.any():
        return None
    try:
        chosen = decide(pairs, here)
    except (DegenerateMotionError, InputError, NotConvergedError):
        return None
    poses = np.array(stream.poses)
    poses[rows] = here.poses[chosen.label, np.arange(len(rows))]
    counts = (int(part.sum()) for part in (chosen.doubtful, chosen.label == 1, chosen.undecided))
    return Decided(replace(stream, poses=poses), *counts)
