"""Pairs of poses whose camera poses were fitted to pixels that were counted from the corner of the first one."""

from __future__ import annotations

from dataclasses import replace

from ...core.geometry.se3 import Array
from ...findings import Finding
from ..camera.models import CORNER_PX
from ..camera.pixel_origin import poses_from_centre
from ..poses.pose_pairs import PosePairs


def pairs_from_centre(poses: PosePairs, points: Array, model: str, parameters: Array) -> PosePairs:
    """Return pairs whose camera poses were fitted to pixels counted from the corner; a finding says so."""
    said = Finding("poses.pixel_origin", "note", {"shift": CORNER_PX})
    camera = poses_from_centre(poses.camera, points, model, parameters)
    return replace(poses, camera=camera, findings=(*poses.findings, said))
