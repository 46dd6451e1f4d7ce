r"""Tags seen by their corners in pixels: poses of each by the intrinsics of the camera and the side of the tag.

``apriltag_msgs/AprilTagDetection`` has the four corners in the order in which the AprilTag library has them
(AprilRobotics/apriltag, ``apriltag.h``): counter-clockwise as one sees the tag, its lower left first; ArUco goes
clockwise from the upper left. That library has the centre of the first pixel at (0.5, 0.5) (measured with rendered
tags), cameras are calibrated with (0, 0): half a pixel is subtracted. Both orders are brought into that of
`camera.board.tag_points`; which way they go round shows in the picture. The frame of the tag is in its middle, x right,
y up, z towards the camera.

Second solutions of the poses of a tag in a stream, decided by the robot as those of pictures are.

Picture in which tags were detected, raw or rectified, where a ``camera_info`` has the intrinsics of both.

With the residuals of the corners r_0 under K and D and r_1 under P, ``g = r_1 - r_0`` is what the wrong lens adds. The
share of it in r_0,

    a = - sum g r_0 / sum g^2

is 0 for corners of the raw picture and 1 for those of the rectified one, whatever the noise of the corners is. Its
standard error is that of the sums over groups of neighbouring detections, whose errors are alike.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...fit.input_checks.pose_ambiguity import FEWEST, decide
from ...formats.ros_messages import MessageError, number, part
from ...model.camera.adjustment.bundle import Asked, Bundle, adjust
from ...model.camera.adjustment.initial_guess import Minima, both_minima, poses_of
from ...model.camera.board import tag_points
from ...model.camera.board_shape import flat_shape
from ...model.camera.corners import Corners
from ...model.camera.models import rays
from ...model.poses.pose_pairs import PosePairs, Stream
from .track import CameraInfo, Samples

# Where the AprilTag library has the centre of the first pixel.
HALF = 0.5
# Pixels per coordinate beyond which corners are no picture of the tag by this camera.
SPOILT = 5.0


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


def corners_in(message: Any) -> list[tuple[str, list[float]]] | None:
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
        if part(one, "decision_margin") is not None:  # of the AprilTag library
            flat = [value - HALF for value in flat]
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


class TagPoses(NamedTuple):
    """Poses of a tag at times, with the second solution of each."""

    times: NDArray[np.float64]  # (n,)
    minima: Minima
    notes: list[str]

    @property
    def poses(self) -> Array:
        """(n, 4, 4) ``camera_T_target``, the better solution."""
        return np.asarray(self.minima.poses[0])


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
    return adjust(Asked.poses_only(model, flat_shape(corners.points)), corners, (parameters, start))


def pixels_off(corners: Corners, bundle: Bundle, poses: Array) -> Array:
    """Return the residuals (n, 8) of the corners at poses (n, 4, 4), pixels."""
    C = poses[corners.picture]
    at = (C[:, :3, :3] @ corners.points[..., None])[..., 0] + C[:, :3, 3]
    return np.asarray(bundle.model.project(bundle.parameters, at).pixels - corners.pixels).reshape(len(poses), -1)


def tag_poses(track: TagTrack, info: CameraInfo, side: float) -> TagPoses:
    """Return the poses of a tag by least squares of its corners."""
    times, corners = corners_of(track, side)
    bundle = adjusted(corners, info)
    minima = both_minima(bundle, corners)
    n = len(times)
    fine = np.abs(pixels_off(corners, bundle, minima.poses[0])).max(axis=1) < SPOILT
    notes = [f"{n} poses from corners, side {side:g} m; the tag's frame is in its middle, z towards the camera"]
    if not fine.all():
        notes.append(f"{int((~fine).sum())} detections fit no pose of the tag within {SPOILT:g} px, and are left out")
    kept = Minima(minima.poses[:, fine], minima.own[:, fine], minima.squares[:, fine])
    return TagPoses(times[fine], kept, notes)


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
    if len(found) < FEWEST or any(row is None for row in found):
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


RAW, RECTIFIED = "raw", "rectified"
WORDS = {RAW: "K and D, of the raw picture", RECTIFIED: "P, of the rectified picture"}
# Groups of neighbouring detections, and the fewest of them.
GROUPS, FEWEST_DETECTIONS = 20, 8
# Standard errors by which the share must differ from one half, the largest one, and how far the share may lie beyond
# 0 and 1, where neither lens is right.
CLEAR, LARGEST, BEYOND = 2.0, 0.2, 0.5
# Difference of the rays of both lenses, in pixels RMS, from which on the wrong one matters.
MATTERS = 0.3


class Lens(NamedTuple):
    """The intrinsics to use, a note on where they come from, and a warning if they are in doubt."""

    info: CameraInfo
    note: str
    warning: str = ""


def lens_of(track: TagTrack, info: CameraInfo, side: float, given: str | None = None) -> Lens:
    """Return the intrinsics of the picture that the corners lie in; ``given`` says which, None: they decide."""
    of = {RAW: replace(info, P=np.zeros(4)), RECTIFIED: info}
    source = "intrinsics of camera_info: "
    if given is not None:
        if given == RECTIFIED and not info.rectified:
            raise InputError(
                "--camera-matrix rectified: the camera_info has no matrix P of a rectified picture. Remove it."
            )
        return Lens(of[given], f"{source}{WORDS[given]}, as given")
    if not info.rectified:
        return Lens(info, f"{source}{WORDS[RAW]}")
    if not info.distorted:
        return Lens(info, f"{source}{WORDS[RECTIFIED]}")
    corners = corners_of(track, side)[1]
    seen = {name: rays(*one.lens(), corners.pixels) for name, one in of.items()}
    if not all(np.isfinite(part).all() for part in seen.values()):  # as those of the rectified one reach farther
        return Lens(info, f"{source}{WORDS[RECTIFIED]}")
    off = np.array([_residuals(corners, one) for one in of.values()])  # (2, n, 8)
    off = off[:, np.abs(off).max(axis=2).min(axis=0) < SPOILT]
    fits = np.sqrt(np.sum(off**2, axis=(1, 2)) / max(2 * off.shape[1], 1))  # eight coordinates less six
    fit = dict(zip(of, (f"{value:.2g} px" for value in fits), strict=True))
    chosen = _decided(off)
    taken = chosen or RECTIFIED
    other = RAW if taken == RECTIFIED else RECTIFIED
    note = f"{source}{WORDS[taken]}; the corners fit to {fit[taken]}, with {WORDS[other]}, to {fit[other]}"
    if chosen:
        return Lens(of[taken], note)
    if _apart(seen[RAW], seen[RECTIFIED]) * info.linear()[0] < MATTERS:
        return Lens(of[taken], f"{note}, which does not decide; if it was the raw one, give --camera-matrix raw")
    warning = (
        f"The camera_info has D and P, and the corners do not decide whether the tag was detected in the raw picture "
        f"or in the rectified one (they fit to {fit[RAW]} and {fit[RECTIFIED]}). The rectified one was taken (P). If "
        'it was the raw one, give camera_matrix="raw" (--camera-matrix raw).'
    )
    return Lens(of[taken], note, warning)


def _residuals(corners: Corners, info: CameraInfo) -> Array:
    """Return the residuals (n, 8) of the better pose of each detection, pixels."""
    bundle = adjusted(corners, info)
    return pixels_off(corners, bundle, both_minima(bundle, corners).poses[0])


def _decided(off: Array) -> str | None:
    """Return the picture that residuals (2, n, 8) of both lenses speak for; None: neither."""
    raw, difference = off[0], off[1] - off[0]
    whole = float(np.sum(difference**2))
    if off.shape[1] < FEWEST_DETECTIONS or not whole > 0.0:
        return None
    share = -float(np.sum(difference * raw)) / whole
    scores = np.sum(difference * (raw + share * difference), axis=1)
    groups = [part.sum() for part in np.array_split(scores, min(GROUPS, len(scores)))]
    error = float(np.sqrt(np.sum(np.square(groups)))) / whole
    if error > LARGEST or abs(share - 0.5) < CLEAR * error or abs(share - 0.5) > 0.5 + BEYOND:
        return None
    return RAW if share < 0.5 else RECTIFIED


def _apart(one: Array, other: Array) -> float:
    """Return the RMS angle (rad) between rays (m, 3)."""
    one, other = (part / np.linalg.norm(part, axis=1, keepdims=True) for part in (one, other))
    return float(np.sqrt(np.mean(np.sum(np.cross(one, other) ** 2, axis=1))))
