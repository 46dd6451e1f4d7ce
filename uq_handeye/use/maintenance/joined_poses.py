"""Poses of two sessions joined to one data set, and the arguments with which `calibrate` is run again on all of them.

Joined are robot and camera poses, joints, times, and the pictures, with which the camera is adjusted again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...calibration.job import job_of
from ...calibration.result import Calibration
from ...core.geometry.frames import SETUPS
from ...core.geometry.se3 import Array, difference, perturb
from ...errors import InputError
from ...fit.graph.request import Request
from ...model.camera.calibrate import calibrate_camera
from ...model.camera.corners import Corners
from ...model.camera.models import LINEAR
from ...model.camera.result import CameraCalibration
from ...model.errors.camera_noise import CameraNoise
from ...model.errors.joint_covariance import JointCovariance
from ...model.errors.models import PoseNoise, is_joint
from ...model.errors.pose_prior import PosePrior
from ...model.errors.sizes import prior_from_dict
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.kinematic_errors import KinematicErrors, effects_of_errors, poses_with_errors
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.timing import Timing
from ...model.shared_errors.assumed import default_errors, replace_defaults, stored_error
from ...model.shared_errors.camera_noise import camera_noise_at

# Median distances that differ by this factor are not of one unit.
ANOTHER_UNIT_RATIO = 50.0
# Corners of one picture differ by less, once bent edges are taken out by two calibrations of the camera; px.
SAME_CORNER_PX = 0.02
# A prior of a camera carries no information from these standard deviations on (`camera.adjustment.setting`).
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
    read_as = None if S is None else old.camera_read_as
    return PosePairs(
        robot, camera, old.setup, times, None, sources, timing, cam, joints, S, camera_read_as=read_as
    ), numbers


def joined_covariance(old: JointCovariance | None, new: JointCovariance | None) -> JointCovariance | None:
    """Return the covariance of the camera poses of both, whose errors are independent."""
    if old is None or new is None:
        return None
    if new.shared.shape[-1]:
        raise InputError(
            "Expected camera poses with independent errors, got errors that the new poses share. Give the new poses "
            "with a covariance of each."
        )
    shared = np.concatenate([old.shared, np.zeros((new.n, 6, old.shared.shape[-1]))])
    return JointCovariance(np.concatenate([old.own, new.own]), shared, old.keys)


def require_joinable(old: PosePairs, new: PosePairs) -> None:
    """Raise `InputError` where the poses are of another setup or unit, or were there before."""
    if old.scene is not None or new.scene is not None:
        raise InputError(
            "Pictures of a scene are adjusted all together, and an update would leave the old ones as they are. "
            "Calibrate with all pictures, old and new: uq-handeye calibrate ROBOT --images PATTERN --scene."
        )
    if new.robot.ndim != 3:
        raise InputError(f"Expected new poses of one data set, (m, 4, 4), got shape {new.robot.shape}.")
    if new.setup != old.setup:
        raise InputError(
            f"The new poses are {new.setup} ({SETUPS[new.setup]}), the result is {old.setup} ({SETUPS[old.setup]}): "
            "name the setup of the result."
        )
    for side in ("robot", "camera"):
        before, now = (float(np.median(np.linalg.norm(getattr(p, side)[:, :3, 3], axis=-1))) for p in (old, new))
        if min(before, now) > 0 and not 1 / ANOTHER_UNIT_RATIO < now / before < ANOTHER_UNIT_RATIO:
            raise InputError(
                f"The new {side} poses are {now:.3g} m away and those of the result {before:.3g} m: expected both in "
                f"metres. Name the unit of the file (--units {side}=...)."
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
    fitted = poses.camera_calibration is not None or poses.scene is not None
    sides = [poses.robot] if fitted else [poses.robot, poses.camera]
    numbers = np.concatenate([side.reshape(poses.n, -1) for side in sides], axis=1)
    return [row.tobytes() for row in np.round(numbers, 9) + 0.0]


def _same_corners(new: PosePairs, k: int, old: PosePairs, i: int) -> bool:
    """Return whether two pictures are one: the same corners, but for what the camera makes of bent edges."""
    seen, before = new.camera_calibration, old.camera_calibration
    if seen is None or before is None:
        return True
    one, other = seen.corners.pixels[seen.corners.picture == k], before.corners.pixels[before.corners.picture == i]
    return one.shape == other.shape and bool(np.abs(one - other).max() < SAME_CORNER_PX)


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
    """Return the camera of all pictures, calibrated with the options of the old ones."""
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
    """Return the arguments of `calibrate_camera` with which the camera was calibrated."""
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


def measured_poses(result: Calibration) -> PosePairs:
    """Return the poses of a result as they were measured, the excluded ones too, with their joints.

    Where the errors of an arm were derived at their estimate, its poses stand for those measured (`linear_about`).
    """
    data, arm = cast(PosePairs, result.data), _request(result)["arm"]
    if arm is None:
        return data
    assert result.kinematics is not None
    fitted, kept = result.kinematics, counted(result)
    joints = np.tile(fitted.joints[0], (data.n, 1)) if data.joints is None else np.array(data.joints)
    joints[kept] = fitted.joints
    robot = data.robot.copy()
    if arm["at"] is not None:
        e = np.asarray(arm["at"], dtype=float)
        of = fitted.chain, fitted.joints, e, fitted.flange
        nominal = fitted.chain.poses(fitted.joints)
        linear = perturb(poses_with_errors(*of), -(effects_of_errors(*of) @ e))
        robot[kept] = perturb(robot[kept], -difference(linear, nominal))
    return replace(data, robot=robot, joints=joints)


def counted(result: Calibration) -> NDArray[np.intp]:
    """Return the numbers of the poses that were not excluded."""
    return np.setdiff1d(np.arange(cast(PosePairs, result.data).n), result.excluded)


def arguments(
    result: Calibration, poses: PosePairs, numbers: NDArray[np.intp], noise: PoseNoise | None
) -> dict[str, Any]:
    """Return the arguments of `calibrate` for all ``poses``.

    ``numbers`` of these poses among those of the result, which come first, and the new ones. ``noise``: that of the new
    poses, where it is not that of the old ones. Raises `InputError` that names what the result does not hold.
    """
    assert result.provenance is not None
    options, request = result.provenance.options, _request(result)
    shared = None if request["shared"] is None else [stored_error(error) for error in request["shared"]]
    noise_of_all = _noise(request["noise"], poses, partial(_of_each_pose, result, numbers), noise)
    by_views = isinstance(noise_of_all, CameraNoise)
    if shared is None and (noise_of_all is None or by_views) and request["simulated"]:
        known = by_views or poses.intrinsics_covered
        shared = replace_defaults(default_errors(known), known, others=False)
    if (pairs := options["pairs"]).endswith(" given"):
        raise InputError("The result was made of pairs that were listed: those of the new poses are not known.")
    arm = request["arm"]
    excluded = np.flatnonzero(np.isin(numbers, result.excluded)).tolist()
    return {
        **({"exclude": excluded} if excluded else {}),
        "noise": noise_of_all,
        "pairs": pairs,
        "robust": request["robust"],
        "prior": None if options["prior"] is None else prior_from_dict(options["prior"]),
        "shared": shared,
        **{name: options[name] for name in ("method", "scale", "kind", "covariance", "seed", "correlation")},
        **({"correlation": "none"} if request["simulated"] else {}),  # no drift is assumed of simulated poses
        **_beforehand(options.get("pose_prior")),
        **({} if arm is None else _arm(arm, poses)),
    }


def holds_request(result: Calibration) -> bool:
    """Return whether the result holds its poses and the arguments of its calibration."""
    origin = result.provenance
    return isinstance(result.data, PosePairs) and origin is not None and origin.request is not None


def with_bound_poses(result: Calibration) -> Calibration:
    """Return a result whose file lacks its poses or its arguments with the poses that its posterior is bound to.

    As it is where these are not all that the fit had: corners or points, clocks, joints, more than the defaults.
    """
    posterior, origin, estimate = result.posterior, result.provenance, result.noise_estimate
    if holds_request(result) or posterior is None or posterior.bound is None or origin is None or estimate is None:
        return result
    request, fitted = origin.request, result.kinematics
    if estimate.camera_known or result.time_offset is not None or (request is None and fitted is not None):
        return result
    assert result.setup is not None
    joints = None if fitted is None else fitted.joints
    data = PosePairs(*posterior.bound, result.setup, posterior.times, joints=joints)
    if request is None:
        request = {"noise": None, "robust": origin.options["robust"], "shared": None, "arm": None, "simulated": False}
        assumed = Request(method=result.method, correlation=origin.options["correlation"])
        if [line for error in job_of(assumed, data).shared for line in error.described] != origin.options["shared"]:
            return result
    return replace(result, data=data, excluded=(), provenance=replace(origin, request=request))


def _request(result: Calibration) -> dict[str, Any]:
    assert result.provenance is not None and result.provenance.request is not None
    return result.provenance.request


def _arm(arm: Mapping[str, Any], poses: PosePairs) -> dict[str, Any]:
    errors = None if arm["errors"] is None else KinematicErrors(**arm["errors"])
    return {"joints": poses.joints, "kinematics": Kinematics.from_dict(arm["kinematics"]), "kinematic_errors": errors}


def _beforehand(prior: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the priors of X and W as poses with covariances, infinite where nothing is known."""
    if prior is None:
        return {}
    found = {}
    for name, _, mean, information in PosePrior.from_dict(dict(prior)).parts():
        known = np.flatnonzero(np.diag(information) > 0)
        S = np.diag(np.full(6, np.inf))
        S[np.ix_(known, known)] = np.linalg.inv(information[np.ix_(known, known)])
        found[f"prior_{name}"] = (mean, S)
    return found


def _noise(
    given: Mapping[str, Any] | None, poses: PosePairs, of_each: Callable[[Array, Array], Array], new: PoseNoise | None
) -> Any:
    """Return the noise of all poses, or None where it is to be estimated."""
    if given is None:
        if new is not None:
            raise InputError(
                "The noise of the result was estimated, and is estimated again: leave out that of the new poses."
            )
        return None
    if "A" in given:
        raise InputError("The result has noise of motions (PairNoise): an update needs noise of poses.")
    robot, camera = (_side(name, given[name], poses, of_each, new) for name in ("robot", "camera"))
    if robot is None and type(given["camera"]) is dict:
        return camera
    if robot is None and camera is None:
        raise InputError("The result holds no noise of its poses: calibrate all poses together.")
    return PoseNoise(robot, camera)


def _side(
    name: str, old: Any, poses: PosePairs, of_each: Callable[[Array, Array], Array], noise: PoseNoise | None
) -> Any:
    """Return the covariance of a side for all poses: one for each, or (n, 6, 6)."""
    new = None if noise is None else getattr(noise, name)
    match old, new:
        case {"views": None}, _:
            raise InputError("The result does not hold the board and the camera that its camera noise was made of.")
        case {"views": views, "pixel_sd": sd}, None:
            return camera_noise_at(poses, views, sd)
        case {"views": _}, _:
            raise InputError("The camera noise follows from the views of the board: leave out that of the new poses.")
        case None, None:
            return None
        case None, _:
            raise InputError(
                f"The {name} poses of the result are exact, or their noise comes with them: leave out new noise."
            )
    if old == "joint" or (new is not None and is_joint(new)):
        raise InputError(
            f"The covariance of the {name} poses is joint over the poses, and does not extend to others: calibrate all "
            "poses together."
        )
    before = np.asarray(old, dtype=float)
    if new is None and before.ndim != 2:
        raise InputError(
            f"The noise of the {name} poses differs from pose to pose: expected that of the new poses (`noise`)."
        )
    if new is None:
        return before
    if before.ndim == 2 and np.array_equal(before, new):
        return before
    return of_each(before, np.asarray(new))


def _of_each_pose(result: Calibration, numbers: NDArray[np.intp], old: Array, new: Array) -> Array:
    """(n, 6, 6) the covariance of each pose, by their numbers among the poses of the result and the new ones.

    Those of excluded poses, which do not count, are any.
    """
    n = len(result.data or ())
    m = int(max(numbers.max() + 1 - n, 0)) if new.ndim == 2 else len(new)
    whole = np.tile(old if old.ndim == 2 else old[0], (n, 1, 1))
    if old.ndim > 2:
        whole[counted(result)] = old
    return np.concatenate([whole, np.broadcast_to(new, (m, 6, 6))])[numbers]
