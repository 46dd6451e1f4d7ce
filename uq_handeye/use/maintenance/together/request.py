"""The arguments that a result was asked for with, for the same question about more poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....calibration.result import Calibration
from ....core.geometry.se3 import Array, logarithm, perturb
from ....errors import InputError
from ....model.kinematics.chain import Kinematics
from ....model.kinematics.kinematic_errors import KinematicErrors, effects_of_errors, poses_with_errors
from ....model.noise.camera_noise import CameraNoise
from ....model.noise.estimate import NoisePrior
from ....model.noise.models import PoseNoise, is_joint
from ....model.noise.pose_prior import PosePrior
from ....model.poses.pose_pairs import PosePairs
from ....model.shared_errors.camera_noise import camera_noise_at
from ....model.shared_errors.shared_error import SharedError, default_errors


def measured_poses(result: Calibration) -> PosePairs:
    """Return the poses of a result as they were measured, the excluded ones too, with their joints.

    Where the errors of an arm were derived at their estimate, its poses stand for those measured (`linear_about`).
    """
    data = result.data
    assert isinstance(data, PosePairs)
    arm = _request(result)["arm"]
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
        turn = logarithm(linear[:, :3, :3] @ nominal[:, :3, :3].mT)
        off = np.concatenate([turn, linear[:, :3, 3] - nominal[:, :3, 3]], axis=-1)
        robot[kept] = perturb(robot[kept], -off)
    return replace(data, robot=robot, joints=joints)


def counted(result: Calibration) -> NDArray[np.intp]:
    """Return the numbers of the poses that were not excluded."""
    assert isinstance(result.data, PosePairs)
    return np.setdiff1d(np.arange(result.data.n), result.excluded)


def arguments(
    result: Calibration, poses: PosePairs, numbers: NDArray[np.intp], noise: PoseNoise | None
) -> dict[str, Any]:
    """Return the arguments of `calibrate` for all ``poses``.

    ``numbers`` of these poses among those of the result, which come first, and the new ones. ``noise``: that of the new
    poses, where it is not that of the old ones. Raises `InputError` that names what the result does not hold.
    """
    options, request = _options(result), _request(result)
    shared = None if request["shared"] is None else [SharedError.from_dict(error) for error in request["shared"]]
    noise_of_all = _noise(request["noise"], poses, _Rows(result, numbers), noise)
    if shared is None and noise_of_all is None and request["simulated"]:
        shared = list(default_errors(poses.camera_known))
    if shared is None and isinstance(noise_of_all, CameraNoise) and request["simulated"]:
        shared = list(default_errors(True))
    if not isinstance(pairs := options["pairs"], str) or pairs.endswith(" given"):
        raise InputError("The result was made of pairs that were listed: those of the new poses are not known.")
    arm = request["arm"]
    excluded = np.flatnonzero(np.isin(numbers, result.excluded)).tolist()
    return {
        **({"exclude": excluded} if excluded else {}),
        "noise": noise_of_all,
        "pairs": pairs,
        "robust": request["robust"],
        "prior": None if options["prior"] is None else NoisePrior(**options["prior"]),
        "shared": shared,
        **{name: options[name] for name in ("method", "scale", "kind", "covariance", "seed", "correlation")},
        **({"correlation": "none"} if request["simulated"] else {}),  # no drift is assumed of simulated poses
        **_beforehand(options.get("pose_prior")),
        **({} if arm is None else _arm(arm, poses)),
    }


def holds_request(result: Calibration) -> bool:
    """Return whether the result holds its poses and all that was asked of them."""
    return (
        isinstance(result.data, PosePairs) and result.provenance is not None and result.provenance.request is not None
    )


def _options(result: Calibration) -> dict[str, Any]:
    assert result.provenance is not None
    return result.provenance.options


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


def _noise(given: Mapping[str, Any] | None, poses: PosePairs, rows: _Rows, new: PoseNoise | None) -> Any:
    """Return the noise of all poses, or None where it is to be estimated."""
    if given is None:
        if new is not None:
            raise InputError(
                "The noise of the result was estimated, and is estimated again: leave out that of the new poses."
            )
        return None
    if "A" in given:
        raise InputError("The result has noise of motions (PairNoise): an update needs noise of poses.")
    robot, camera = (_side(name, given[name], poses, rows, new) for name in ("robot", "camera"))
    if isinstance(camera, CameraNoise) and robot is None:
        return camera
    if robot is None and camera is None:
        raise InputError("The result holds no noise of its poses: calibrate all poses together.")
    return PoseNoise(robot, camera)


def _side(name: str, old: Any, poses: PosePairs, rows: _Rows, noise: PoseNoise | None) -> Any:
    """Return the covariance of a side for all poses: one for each, or (n, 6, 6)."""
    new = None if noise is None else getattr(noise, name)
    if isinstance(old, Mapping):
        if old["views"] is None:
            raise InputError("The result does not hold the board and the camera that its camera noise was made of.")
        if new is not None:
            raise InputError("The camera noise follows from the views of the board: leave out that of the new poses.")
        return camera_noise_at(poses, old["views"], old["pixel_sd"])
    if isinstance(old, str) or (new is not None and is_joint(new)):
        raise InputError(
            f"The covariance of the {name} poses is joint over the poses, and does not extend to others: calibrate all "
            "poses together."
        )
    if old is None and new is None:
        return None
    if old is None:
        raise InputError(
            f"The {name} poses of the result are exact, or their noise comes with them: leave out new noise."
        )
    before = np.asarray(old, dtype=float)
    if new is None:
        if before.ndim != 2:
            raise InputError(
                f"The noise of the {name} poses differs from pose to pose: expected that of the new poses (`noise`)."
            )
        return before
    if before.ndim == 2 and np.array_equal(before, new):
        return before
    return rows.each(before, np.asarray(new))


class _Rows(NamedTuple):
    """Poses of a result and new ones, by their numbers among both."""

    result: Calibration
    numbers: NDArray[np.intp]

    def each(self, old: Array, new: Array) -> Array:
        """(n, 6, 6) the covariance of each pose; those of excluded poses, which do not count, are any."""
        n = len(self.result.data or ())
        m = int(max(self.numbers.max() + 1 - n, 0)) if new.ndim == 2 else len(new)
        whole = np.tile(old if old.ndim == 2 else old[0], (n, 1, 1))
        if old.ndim > 2:
            whole[counted(self.result)] = old
        return np.concatenate([whole, np.broadcast_to(new, (m, 6, 6))])[self.numbers]
