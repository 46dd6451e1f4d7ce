"""Tables of what a bag holds, for commands that read files: joint values as CSV, camera_info as YAML."""

from __future__ import annotations

from ..errors import InputError
from ..files.csv_text import csv_text
from .info import CameraInfo
from .open import HINT
from .recording import JointTrack, Recording


def joint_tracks(recording: Recording, topic: str) -> list[JointTrack]:
    """Return the joint values of a topic, those of most joints first."""
    found = recording.joints.get(topic) or recording.joints.get(f"/{topic}")
    if found is None or not found.sets:
        there = ", ".join(recording.joints) or "none"
        raise InputError(
            f"--joints {topic}: {recording.name} has no such topic of JointState; there are: {there}. {HINT}."
        )
    return found.tracks


def joints_csv(track: JointTrack) -> str:
    """Return joint values as a table with the header ``timestamp`` and the names of the joints."""
    return csv_text([["timestamp", *track.names], *track.table().tolist()])


def camera_info_yaml(info: CameraInfo) -> str:
    """Return the intrinsics as --camera-matrix reads them, in the names of ``camera_calibration``."""
    fx, fy, cx, cy = info.linear().tolist()
    d = [] if info.rectified else info.D.tolist()
    lines = [
        f"image_width: {info.image_size[0]}",
        f"image_height: {info.image_size[1]}",
        f"distortion_model: {'plumb_bob' if info.rectified or not info.model else info.model}",
        f"camera_matrix: {{rows: 3, cols: 3, data: [{fx!r}, 0, {cx!r}, 0, {fy!r}, {cy!r}, 0, 0, 1]}}",
        f"distortion_coefficients: {{rows: 1, cols: {max(len(d), 5)}, data: {d or [0.0] * 5}}}",
    ]
    return "\n".join(lines) + "\n"
