"""Whose an error is: of the robot, the camera or the target, and the same tomorrow; or drawn again in each session."""

from __future__ import annotations

from collections.abc import Iterable

from ..errors import InputError
from ..noise.camera_noise import INTRINSICS
from ..noise.joint_covariance import group_of
from ..shared_errors.drift import DRIFT
from ..shared_errors.shared_error import FOCAL_LENGTH, LENS, PRINCIPAL_POINT, TARGET_SCALE, VIEW

ROBOT, CAMERA, TARGET = "robot", "camera", "target"
THINGS = (ROBOT, CAMERA, TARGET)
ANEW = ""


def owner_of(name: str) -> str:
    """Return the thing that an error of this name belongs to.

    >>> [owner_of(name) for name in ("view: 3", "target scale", "joint offsets: elbow", "drift of the camera: 1")]
    ['camera', 'target', 'robot', '']
    """
    group = group_of(name)
    if group in (FOCAL_LENGTH, VIEW, LENS, INTRINSICS, "") or group.startswith(PRINCIPAL_POINT):
        return CAMERA
    if group.startswith(DRIFT):
        return ANEW
    return TARGET if group == TARGET_SCALE else ROBOT


def checked_things(same: Iterable[str] | str) -> frozenset[str]:
    """Return which of `THINGS` are the same; raises `InputError` for others."""
    given = (same,) if isinstance(same, str) else tuple(same)
    if wrong := [name for name in given if name not in THINGS]:
        raise InputError(f"Expected `same` to be names out of {', '.join(THINGS)}, got {wrong[0]!r}.")
    return frozenset(given)
