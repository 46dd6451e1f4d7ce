"""A rig of one camera, one target and one arm that carries one of the two: poses side by side.

Such a rig holds what `PosePairs` hold, and `calibrate` gives one answer to both. `single_of` turns a rig into poses,
`rig_of_poses` poses into a rig, whose graph has one view.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...errors import InputError
from ..errors.joint_covariance import JointCovariance
from ..errors.models import PoseNoise
from ..poses.pose_pairs import Names, PosePairs
from .description import WORLD, ArmPoses, Rig, View
from .noise_by_name import NoiseByName, by_name, covariance_of


class Single(NamedTuple):
    """Poses side by side that a rig holds, and what it says of them as arguments of `calibrate`."""

    poses: PosePairs
    options: dict[str, Any]


def is_single(rig: Rig) -> bool:
    """Return whether a rig has one arm, which carries its only camera or its only target."""
    if not len(rig.arms) == len(rig.cameras) == len(rig.targets) == 1:
        return False
    return (WORLD in rig.cameras.values()) != (WORLD in rig.targets.values())


def single_of(rig: Rig, noise: NoiseByName | None = None) -> Single:
    """Return the poses of a rig that `is_single`, with the options that it holds: noise, priors, kinematics.

    Names of robot poses that are times become timestamps. Raises `InputError` for noise
    that is missing.
    """
    ((name, arm),), (camera,), (target,) = rig.arms.items(), rig.cameras, rig.targets
    of_name = {moment: k for k, moment in enumerate(arm.names)}
    moments = [moment for view in rig.views for moment in view.at or ()]
    rows = np.array([of_name[moment] for moment in moments], dtype=np.intp)
    timed = arm.timed or {type(moment) for moment in moments} == {float}
    times = np.array(moments, dtype=float) if timed else None
    poses = PosePairs(
        arm.poses[rows],
        np.concatenate([view.poses for view in rig.views]),
        "eye-to-hand" if rig.cameras[camera] == WORLD else "eye-in-hand",
        times,
        camera_covariance=_covariance_of_views(rig),
        joints=None if arm.joints is None or arm.by_poses else arm.joints[rows],
        names=Names(name, camera, target),
    )
    options: dict[str, Any] = {}
    if noise is not None:
        given = by_name(rig, noise)
        S = covariance_of(given, name, len(arm.poses))
        known = poses.camera_covariance is not None
        of_camera = None if known else covariance_of(given, camera, None)
        options["noise"] = PoseNoise(S[rows] if S.ndim == 3 else S, of_camera)
    if arm.kinematics is not None:
        options |= {"kinematics": arm.kinematics, "kinematic_errors": arm.errors}
    for side, of in (("prior_X", camera), ("prior_W", target)):
        if (prior := (rig.known or {}).get(of)) is not None:
            options[side] = prior
    return Single(poses, options)


def poses_like(rig: Rig, names: Names) -> PosePairs:
    """Return the poses of a rig of one camera whose parts have these names; raises `InputError` for another rig."""
    found = (*rig.arms, *rig.cameras, *rig.targets)
    if found != tuple(names) or not is_single(rig):
        raise InputError(f"Expected new views of {', '.join(names)}, got a rig of {', '.join(found)}.")
    return single_of(rig).poses


def _covariance_of_views(rig: Rig) -> JointCovariance | None:
    """Joint covariance of the camera poses, where the views come with theirs."""
    given = [view.covariance is not None for view in rig.views]
    if not any(given):
        return None
    if not all(given):
        raise InputError("Expected a covariance of all views of the camera, or of none.")
    own: list[Array] = []
    shared: list[Array] = []
    for view in rig.views:
        n = len(view.poses)
        own.append(np.broadcast_to(np.asarray(view.covariance), (n, 6, 6)))
        shared.append(np.zeros((n, 6, 0)) if view.intrinsics is None else view.intrinsics)
    if len({F.shape[-1] for F in shared}) > 1:
        raise InputError("Expected as many errors of intrinsics in all views of the camera.")
    return JointCovariance(np.concatenate(own), np.concatenate(shared))


def rig_of_poses(poses: PosePairs, S: JointCovariance | None = None) -> Rig:
    """Return the rig of poses side by side, in order of time, whose robot poses are named by their rows.

    ``S``: joint covariance of the camera poses, where it is known.
    """
    order = np.arange(poses.n) if poses.timestamps is None else np.argsort(poses.timestamps, kind="stable")
    rows, (arm, camera, target) = tuple(map(str, order.tolist())), poses.names
    on = {camera: arm, target: WORLD} if poses.setup == "eye-in-hand" else {camera: WORLD, target: arm}
    own, intrinsics = (None, None) if S is None else (S.own[order], S.shared[order])
    view = View(camera, target, poses.camera[order], rows, own, intrinsics=intrinsics)
    return Rig({arm: ArmPoses(poses.robot[order], rows)}, {camera: on[camera]}, {target: on[target]}, (view,))
