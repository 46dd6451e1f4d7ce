"""Whose an error is: of the robot, the camera or the target, and the same tomorrow; or drawn again in each session."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...errors import InputError
from ..noise.joint_covariance import group_of
from ..noise.models import INTRINSICS
from ..poses.pose_pairs import PosePairs
from ..shared_errors.assumed import DRIFT
from ..shared_errors.shared_error import FOCAL_LENGTH, LENS, PRINCIPAL_POINT, TARGET_SCALE, VIEW

ROBOT, CAMERA, TARGET = "robot", "camera", "target"
THINGS = (ROBOT, CAMERA, TARGET)
ANEW = ""
NOTHING = "none"


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
    """Return which of `THINGS` are the same, "none" of them where that is the only name; raises `InputError`.

    >>> sorted(checked_things("robot")), sorted(checked_things(["none"]))
    (['robot'], [])
    """
    given = (same,) if isinstance(same, str) else tuple(same)
    if given == (NOTHING,):
        return frozenset()
    if wrong := [name for name in given if name not in THINGS]:
        found = f"{NOTHING!r} beside other names" if wrong[0] == NOTHING else repr(wrong[0])
        raise InputError(f"Expected `same` (--same) to be names out of {', '.join(THINGS)}, got {found}.")
    return frozenset(given)


def require_same(named: Iterable[str], old: PosePairs | None, new: PosePairs | None) -> None:
    """Raise `InputError` where what was named as the same is known to be another one, by the pictures of both."""
    before, now = (None if poses is None else poses.camera_calibration for poses in (old, new))
    if before is None or now is None:
        return
    if CAMERA in named and not np.array_equal(before.bundle.parameters, now.bundle.parameters):
        raise InputError(
            "Expected one camera, as `same` (--same) names it: the pictures of both were adjusted with other "
            "intrinsics. Leave the camera out of `same`."
        )
    boards = [cam.corners.board for cam in (before, now)]
    if TARGET in named and None not in boards and boards[0] != boards[1]:
        raise InputError(
            "Expected one target, as `same` (--same) names it: the pictures of both show other boards. Leave the "
            "target out of `same`."
        )
