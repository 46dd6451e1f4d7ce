"""Errors that the covariance of X includes, and those that it does not."""

from __future__ import annotations

from ...core.formatting.numbers import digits
from ...fit.likelihood.shared_estimates import SharedGroup, grouped
from ...model.kinematics.kinematic_errors import DECLARED_AS
from ...model.noise.joint_covariance import JointCovariance, group_of
from ...model.noise.models import INTRINSICS, TARGET_SHAPE, PoseNoise, is_joint
from ...model.shared_errors.shared_error import CLOCK_OFFSET, FOCAL_LENGTH, TARGET_SCALE, VIEW
from ...model.shared_errors.sizes import ROBOT_ACCURACY
from ..estimate.estimated import Estimated

# Errors by a name that says more to the reader.
PLAIN = {VIEW: "camera errors by view"}


def shared_groups(result: Estimated) -> list[SharedGroup]:
    """Return the shared errors of a result, those of many numbers as one."""
    carried = any(group_of(error.name) == ROBOT_ACCURACY for error in result.shared)  # no part of the bound
    return grouped(result.shared, result.covariance if carried or result.bound is None else result.bound)


def included(result: Estimated) -> list[tuple[str, bool]]:
    """Return the shared errors that the covariance of X includes, and whether each is a default."""
    parts: list[tuple[str, bool]] = []
    if of_camera(result):
        parts.append(("errors of the intrinsics", False))
    elif isinstance(result.noise, PoseNoise) and _unnamed(result.noise):
        parts.append(("the joint covariance of the noise", False))
    groups: dict[str, list[SharedGroup]] = {}  # by error: such as both coordinates of the principal point
    for group in shared_groups(result):
        groups.setdefault(group.parts[0].error, []).append(group)
    of_arm = [name for name in groups if name in DECLARED_AS]
    if of_arm:
        parts.append((f"errors of the arm ({', '.join(of_arm)})", False))
    for name, of_error in groups.items():
        if name in of_arm:
            continue
        sizes = list(dict.fromkeys(map(sizes_of, of_error)))
        parts.append((f"{PLAIN.get(name, name)} {' and '.join(sizes)}", of_error[0].default))
    columns = dict.fromkeys(map(group_of, column_names(result)))
    parts += [(name, False) for name in columns if not groups or name == TARGET_SHAPE]
    if result.time_offset is not None and result.time_offset.std > 0:
        parts.append((f"{CLOCK_OFFSET} {digits(1e3 * result.time_offset.std, 2)} ms", False))
    return parts


def not_included(result: Estimated) -> list[str]:
    """Return the systematic errors that the covariance of X does not include."""
    names = column_names(result)
    known = of_camera(result) or FOCAL_LENGTH in names
    camera = "camera model" if known else "camera intrinsics"
    if from_points(result):
        camera = "depth errors that points share"
    target = "target shape" if TARGET_SCALE in names or of_camera(result) else "target size"
    robot = "robot kinematics"
    if any(error.error == ROBOT_ACCURACY for error in result.shared):
        assumed = all(error.default for error in result.shared if error.error == ROBOT_ACCURACY)
        robot = f"robot errors beyond those {'assumed' if assumed else 'declared'}"
    if set(DECLARED_AS) & set(map(group_of, names)):
        robot = "arm errors outside its model"
    if TARGET_SHAPE in map(group_of, names):  # the camera gave it
        return [camera, robot] if TARGET_SCALE in names else [camera, robot, "scale of the camera"]
    return [camera, robot, target]


def sizes_of(group: SharedGroup) -> str:
    """Return the standard deviations assumed of the numbers of a group: one, or from the smallest to the largest."""
    if group.parts[0].stated:
        return group.parts[0].stated
    found = []
    for unit in group.units:
        prior = group.of_unit(unit)[0]
        ends = list(dict.fromkeys(digits(end, 2) for end in (prior.min(), prior.max())))
        found.append(f"{' to '.join(ends)} {unit}".rstrip())
    return ", ".join(found)


def column_names(result: Estimated) -> tuple[str, ...]:
    """Return the names of the shared errors that the noise holds, without those of the intrinsics."""
    if not isinstance(result.noise, PoseNoise):
        return ()
    joint = [S for S in (result.noise.robot, result.noise.camera) if isinstance(S, JointCovariance)]
    return tuple(name for S in joint for name in S.names if name not in ("", INTRINSICS))


def of_camera(result: Estimated) -> bool:
    """Return whether the noise of the camera poses holds the errors of the intrinsics."""
    S = result.noise.camera if isinstance(result.noise, PoseNoise) else None
    return isinstance(S, JointCovariance) and bool({INTRINSICS, ""} & set(S.names))


def from_points(result: Estimated) -> bool:
    """Return whether the camera poses come from points in 3-D."""
    return getattr(getattr(result, "data", None), "camera_covariance", None) is not None


def _unnamed(noise: PoseNoise) -> bool:
    """Return whether a side has a joint covariance that was given as such."""
    joint = [S for S in (noise.robot, noise.camera) if S is not None and is_joint(S)]
    return any(not isinstance(S, JointCovariance) or "" in S.names for S in joint)
