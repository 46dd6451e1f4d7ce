"""Poses of two sessions as one data set: robot and camera poses, joints, times, and the camera adjusted with all
pictures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.frames import SETUPS
from ....core.geometry.se3 import Array
from ....errors import InputError
from ....model.camera.calibrate import calibrate_camera
from ....model.camera.corners import Corners
from ....model.camera.models import LINEAR
from ....model.camera.result import CameraCalibration
from ....model.noise.joint_covariance import JointCovariance
from ....model.poses.pose_pairs import PosePairs
from ....model.poses.timing import Timing

# Median distances that differ by this factor are not of one unit.
UNIT = 50.0
# Corners of one picture differ by less, once bent edges are taken out by two calibrations of the camera; px.
SAME_PIXEL = 0.02
# Standard deviations of a camera's prior from which on it says nothing (`camera.adjustment.setting`).
_SILENT = {True: 1e6, False: 1e3}


def joined_poses(old: PosePairs, new: PosePairs) -> tuple[PosePairs, NDArray[np.intp]]:
    """Return the poses of both, the old ones first, and their numbers; raises `InputError` where they do not fit.

    Corners: the camera is adjusted again with all pictures, and may leave some out. Times are kept where they are of
    one clock, joints where both have them.
    """
    require_joinable(old, new)
    seen, more = old.camera_calibration, new.camera_calibration
    timing = _joined_timing(old.timing, new.timing)
    robot = np.concatenate([old.robot, new.robot])
    joints = None if old.joints is None or new.joints is None else np.concatenate([old.joints, new.joints])
    times = _joined_times(old.timestamps, new.timestamps)
    sources = (*old.sources, *(source for source in new.sources if source not in old.sources))
    if seen is None or more is None:
        camera, cam = np.concatenate([old.camera, new.camera]), None
        numbers = np.arange(old.n + new.n)
    else:
        cam = adjusted_again(seen, more.corners)
        kept = numbers = cam.rows
        robot, camera = robot[kept], cam.poses
        joints = None if joints is None else joints[kept]
        times = None if times is None else times[kept]
        cam = replace(cam, corners=replace(cam.corners, row=cam.corners.picture))
    S = joined_covariance(old.camera_covariance, new.camera_covariance)
    return PosePairs(robot, camera, old.setup, times, None, sources, timing, cam, joints, S), numbers


def joined_covariance(old: JointCovariance | None, new: JointCovariance | None) -> JointCovariance | None:
    """Return the covariance of the camera poses of both, whose errors are independent."""
    if old is None or new is None:
        return None
    if new.shared.shape[-1]:
        raise InputError(
            "The shape of the target was estimated again with the new points, in another frame of the target. Give "
            "the target of the result: uq-handeye points --target DIR/target.csv."
        )
    shared = np.concatenate([old.shared, np.zeros((new.n, 6, old.shared.shape[-1]))])
    return JointCovariance(np.concatenate([old.own, new.own]), shared, old.names)


def require_joinable(old: PosePairs, new: PosePairs) -> None:
    """Raise `InputError` where the poses are of another setup or unit, or were there before."""
    if new.robot.ndim != 3:
        raise InputError(f"Expected new poses of one data set, (m, 4, 4), got shape {new.robot.shape}.")
    if new.setup != old.setup:
        raise InputError(
            f"The new poses are {new.setup} ({SETUPS[new.setup]}), the result is {old.setup} ({SETUPS[old.setup]}): "
            "name the setup of the result."
        )
    for side in ("robot", "camera"):
        before, now = (float(np.median(np.linalg.norm(getattr(p, side)[:, :3, 3], axis=-1))) for p in (old, new))
        if min(before, now) > 0 and not 1 / UNIT < now / before < UNIT:
            raise InputError(
                f"The new {side} poses are {now:.3g} m away and those of the result {before:.3g} m: expected both in "
                f"metres. Name the unit of the file (--{side}-units)."
            )
    require_new(old, new)
    given = [
        "come from corners"
        if poses.camera_calibration is not None
        else "come without corners"
        if poses.camera_covariance is None
        else "come from points"
        for poses in (old, new)
    ]
    if given[0] != given[1]:
        raise InputError(
            f"The camera poses of the result {given[0]} and the new ones {given[1]}: give both in the same way "
            "(pictures, or the folder of uq-handeye camera or points)."
        )


def require_new(old: PosePairs, new: PosePairs) -> None:
    """Raise `InputError` where a new pose is one of the old ones."""
    if twice := common_poses(old, new):
        k, i = twice[0]
        raise InputError(
            f"{len(twice)} of {new.n} new poses are in the result already (new pose {k} is pose {i} there): a pose "
            "counts once. Leave them out."
        )


def common_poses(old: PosePairs, new: PosePairs) -> list[tuple[int, int]]:
    """Return the numbers (new, old) of poses that both hold: the same numbers on both sides, or the same corners."""
    before: dict[bytes, list[int]] = {}
    for i, key in enumerate(_keys(old)):
        before.setdefault(key, []).append(i)
    found = []
    for k, key in enumerate(_keys(new)):
        left = before.get(key, [])
        if equal := [i for i in left if _same_corners(new, k, old, i)]:
            left.remove(equal[0])
            found.append((k, equal[0]))
    return found


def _keys(poses: PosePairs) -> list[bytes]:
    """The numbers of each pose, without rounding errors; of the robot only where the camera poses are fitted."""
    sides = [poses.robot, poses.camera] if poses.camera_calibration is None else [poses.robot]
    numbers = np.concatenate([side.reshape(poses.n, -1) for side in sides], axis=1)
    return [row.tobytes() for row in np.round(numbers, 9) + 0.0]


def _same_corners(new: PosePairs, k: int, old: PosePairs, i: int) -> bool:
    """Return whether two pictures are one: the same corners, but for what the camera makes of bent edges."""
    seen, before = new.camera_calibration, old.camera_calibration
    if seen is None or before is None:
        return True
    one, other = seen.corners.pixels[seen.corners.picture == k], before.corners.pixels[before.corners.picture == i]
    return one.shape == other.shape and bool(np.abs(one - other).max() < SAME_PIXEL)


def _joined_times(old: Array | None, new: Array | None) -> Array | None:
    """Both, where each has times and no span of one lies within the other."""
    if old is None or new is None or not (new.min() > old.max() or old.min() > new.max()):
        return None
    return np.concatenate([old, new])


def _joined_timing(old: Timing | None, new: Timing | None) -> Timing | None:
    if old is None and new is None:
        return None
    if old is None or new is None or (old.offset, old.std, old.side) != (new.offset, new.std, new.side):
        raise InputError(
            "The clock offsets of old and new poses are two numbers, and a fit of all poses has one: interpolate the "
            f"new poses with that of the result ({'none' if old is None else f'--offset {old.offset!r},{old.std!r}'})."
        )
    return replace(old, rate=np.concatenate([old.rate, new.rate]))


def adjusted_again(seen: CameraCalibration, more: Corners) -> CameraCalibration:
    """Return the camera of all pictures, asked for as the camera of the old ones was."""
    old = seen.corners
    if seen.image_size != more.image_size and more.image_size is not None:
        raise InputError(
            f"The new pictures have {more.image_size[0]} x {more.image_size[1]} pixels and those of the result "
            f"{seen.image_size[0]} x {seen.image_size[1]}: expected one camera at one resolution."
        )
    both = Corners(
        np.concatenate([old.picture, more.picture + old.n]),
        np.concatenate([old.points, more.points]),
        np.concatenate([old.pixels, more.pixels]),
        (*old.names, *more.names),
        seen.image_size,
        (*old.missing, *more.missing),
        old.board,
        None if more.window is None else np.concatenate([np.zeros(old.m, dtype=np.intp), more.window]),
    )
    return calibrate_camera(both, seen.image_size, **_asked(seen))


def _asked(seen: CameraCalibration) -> dict[str, Any]:
    """Arguments of `calibrate_camera` that the camera was asked for with."""
    bundle = seen.bundle
    names, free = bundle.model.names, bundle.free[: len(bundle.model.names)]
    lenses = {(one.model, one.coefficients) for one in seen.candidates}
    shapes = {one.shape for one in seen.candidates}
    asked: dict[str, Any] = {}
    if len(lenses) < 2:
        asked["model"] = bundle.model.name
        asked["coefficients"] = [
            name for name, is_free in zip(names, free, strict=True) if is_free and name not in LINEAR
        ]
    if len(shapes) < 2:
        asked["shape"] = bundle.shape if bundle.shape.name == "measured" else bundle.shape.name
    known: dict[str, Any] = {}
    for k, name in enumerate(names):
        if not free[k] and (name in LINEAR or "model" in asked):
            known[name] = float(bundle.parameters[k])
        elif free[k] and bundle.prior is not None:
            sd = float(np.sqrt(bundle.prior.covariance[k, k]))
            if sd < _SILENT[name in LINEAR]:
                known[name] = (float(bundle.prior.mean[k]), sd)
    return {**asked, **({"intrinsics": known} if known else {})}
