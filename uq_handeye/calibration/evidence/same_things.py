"""Robot, camera and target of a later session: which of them are those of a calibration, and which are others."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...errors import InputError
from ...model.errors.key import Owner
from ...model.poses.pose_pairs import PosePairs

ROBOT, CAMERA, TARGET = THINGS = (Owner.ROBOT, Owner.CAMERA, Owner.TARGET)
NOTHING = "none"
# Largest difference of the focal lengths of two calibrations of one camera: in standard deviations, and relative.
MAX_FOCAL_CHANGE_SD, MAX_FOCAL_CHANGE = 6.0, 0.03


def checked_things(same: Iterable[str] | str) -> frozenset[str]:
    """Return which of `THINGS` are the same, "none" of them where that is the only name; raises `InputError`.

    >>> sorted(checked_things("robot, camera")), sorted(checked_things(["none"]))
    (['camera', 'robot'], [])
    """
    listed = same.split(",") if isinstance(same, str) else same if np.iterable(same) else (same,)
    given = [str(name).strip() for name in listed]
    if given == [NOTHING]:
        return frozenset()
    if wrong := [name for name in given if name not in THINGS]:
        found = f"{NOTHING!r} beside other names" if NOTHING in given else f"{wrong[0]!r:.40}"
        raise InputError(f"Expected `same` (--same) to be names out of {', '.join(THINGS)}, got {found}.")
    return frozenset(given)


def others_by_pictures(old: PosePairs | None, new: PosePairs | None) -> dict[str, str]:
    """Return which of camera and target are plainly others in new pictures, with what they were and are."""
    before, now = (None if poses is None else poses.camera_calibration for poses in (old, new))
    if before is None or now is None:
        return {}
    found: dict[str, str] = {}
    was, has = ("{} x {} pixels".format(*cam.image_size) for cam in (before, now))
    f, g = (cam.intrinsics["fx"] / cam.image_size[0] for cam in (before, now))
    sd = float(np.linalg.norm([cam.std["fx"] / cam.intrinsics["fx"] for cam in (before, now)]))
    if abs(np.log(g / f)) > max(MAX_FOCAL_CHANGE, MAX_FOCAL_CHANGE_SD * sd) or was != has:
        focal = (f"fx {cam.intrinsics['fx']:.0f} px of {size}" for cam, size in ((now, has), (before, was)))
        found[CAMERA] = ", in the result ".join(focal)
    boards = [cam.corners.board for cam in (before, now)]
    if all(boards) and boards[0] != boards[1]:
        found[TARGET] = f"{boards[1]}, in the result {boards[0]}"
    return found


def require_same(named: Iterable[str], old: PosePairs | None, new: PosePairs | None) -> None:
    """Raise `InputError` where what was named as the same is known to be another one, by the pictures of both."""
    before, now = (None if poses is None else poses.camera_calibration for poses in (old, new))
    others = others_by_pictures(old, new)
    if before is not None and now is not None and not np.array_equal(before.bundle.parameters, now.bundle.parameters):
        others.setdefault(CAMERA, "adjusted with other intrinsics")
    if thing := next((thing for thing in others if thing in named), None):
        raise InputError(
            f"Expected one {thing}, as `same` (--same) names it: the pictures of both are of others, "
            f"{others[thing]}. Leave the {thing} out of `same`."
        )
