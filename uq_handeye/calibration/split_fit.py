"""The fit in which a camera or target that moved is two: X before and after the move (`rig.split`)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..core.geometry.se3 import Array
from ..errors import InputError, NotConvergedError
from ..findings import Finding
from ..fit.diagnostics.paths import pose_change, sizes_of_move
from ..model.errors.joint_covariance import joint_form
from ..model.errors.models import PoseNoise
from ..model.poses.estimated_pose import EstimatedPose
from ..model.poses.pose_pairs import PosePairs
from ..model.rig.description import WORLD, Rig, later_name
from ..model.rig.noise_by_name import NoiseByName
from ..model.rig.single import rig_of_poses
from ..model.rig.split import split_rig
from .rig_poses import RigPoses


class SplitFit(NamedTuple):
    """Cameras and targets of the fit in which what moved is two, and the finding with the sizes of the move by it."""

    poses: tuple[EstimatedPose, ...]
    finding: Finding


def split_fit(
    rig: Rig, noise: NoiseByName | None, moved: Finding, label: str | None = None, **options: Any
) -> SplitFit | None:
    """Return the fit in which what moved is two; None where it has no answer.

    ``label``: what the first pose after the move is called; None: by its name in the rig. ``options``: those of
    `calibrate_rig`.
    """
    from .calibrate_rig import calibrate_rig

    by_name = dict(noise) if isinstance(noise, dict) else noise
    first, names = moved, ("", "")
    for _ in range(3):  # moves of one session at most, one after the other
        name, since = moved.values["name"], moved.values["since"]
        if moved.values["kind"] not in ("camera", "target"):
            return None
        rig = split_rig(rig, name, since, label)
        names = (name, later_name(name, label or since)) if moved is first else names
        if isinstance(by_name, dict) and name in by_name:
            by_name[names[1] if moved is first else later_name(name, since)] = by_name[name]
        try:
            found = calibrate_rig(rig, by_name, **options)
        except (InputError, NotConvergedError, np.linalg.LinAlgError):
            return None
        again = next((one for one in found.findings if one.code == "rig.moved"), None)
        if again is None:
            values = {**first.values, **_move(found, *names)}
            poses = (*found.cameras.values(), *found.targets.values())
            return None if found.reasons else SplitFit(poses, Finding(first.code, first.severity, values))
        moved, label = again, None
    return None


def _move(found: RigPoses, before: str, after: str) -> dict[str, float | None]:
    """Return the sizes of a move by the joint covariance of the poses before and after it."""
    i, j = (found.names.index(name) for name in (before, after))
    change = pose_change(found.poses[i], found.poses[j])
    S = (
        found.block(before, before)
        + found.block(after, after)
        - found.block(before, after)
        - found.block(after, before)
    )
    return sizes_of_move(change, S)


def split_of_poses(poses: PosePairs, noise: Any, moved: Finding, label: str, **options: Any) -> SplitFit | None:
    """Return the same of poses side by side, with frames of one camera: base or gripper, not world.

    The noise is that given where it is the same of all poses, and else estimated.
    """
    known = poses.known_camera
    rig = rig_of_poses(poses, None if known is None else joint_form(known, poses.n))
    given = None
    if isinstance(noise, PoseNoise) and all(S is None or np.shape(S) == (6, 6) for S in noise.sides.values()):
        given = noise if known is None or noise.camera is not None else None
    sides = {} if given is None else {poses.names.arm: given.robot, poses.names.camera: given.camera}
    by_name = {name: _or_exact(S) for name, S in sides.items()}
    at = Finding(moved.code, moved.severity, {**moved.values, "since": str(moved.values["since"])})
    found = split_fit(rig, by_name or None, at, label, **options)
    if found is None:
        return None
    finding = replace(found.finding, values={**found.finding.values, "since": moved.values["since"]})
    return SplitFit(tuple(_renamed(one) for one in found.poses), finding)


def _or_exact(S: Any) -> Array:
    return np.zeros((6, 6)) if S is None else np.asarray(S)


def _renamed(one: EstimatedPose) -> EstimatedPose:
    frame = one.frame.replace(f"{WORLD}_T_", "base_T_", 1)
    return EstimatedPose(one.name, frame, one.pose, one.covariance, one.open, one.count)
