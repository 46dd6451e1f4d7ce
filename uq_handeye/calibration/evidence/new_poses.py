r"""Residuals of new poses against a stored calibration, with the covariance that they have if nothing has changed.

At the estimates, with robot and camera poses corrected by the estimates of the shared errors, the residual of a new
pose (`graph.constraint`) is to first order in the errors

    r = J (xi_X; xi_W) + D_G (F_G (e - estimate) + eta_G) + D_C (F_C (e - estimate) + eta_C)

with eta the noise of the new poses. A drift that the calibration estimated continues in their session, from its value
at one of the poses of the calibration; poses that were taken between those share the estimated drift itself. If X was
moved by delta after the calibration, ``E r = -J_X delta``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...core.geometry.se3 import Array, difference, perturb
from ...core.rounding import CHAIN_ROUNDING
from ...errors import InputError
from ...fit.graph.constraint import Linearised, OnPoses, Unknowns
from ...fit.graph.rows import NewRows, at_points
from ...model.errors.joint_covariance import JointCovariance, joint_of
from ...model.errors.key import Owner
from ...model.errors.keys import DRIFTS, ROBOT_ACCURACY, SCENE_EXCESS
from ...model.errors.models import PoseNoise, is_joint, require_count
from ...model.errors.term import ErrorTerm
from ...model.poses.pose_pairs import PosePairs
from ...model.shared_errors.assumed import drift_columns
from ..estimated import Estimated
from ..prediction.predict import (
    RobotAhead,
    camera_at,
    fresh_of_camera,
    numbers_of_intrinsics,
    own_noise,
    poses_so_far,
    posterior_of,
    predict_camera,
    robot_ahead,
    shared_effects,
)
from .same_things import THINGS, checked_things, require_same

# Noise of new poses of one side: a covariance of each, or noises of sizes that the calibration found.
NoiseAhead: TypeAlias = Array | JointCovariance | tuple[ErrorTerm, ...] | None


@dataclass(frozen=True, eq=False)
class PoseEvidence(NewRows):
    """Residuals of new poses against a calibration, with the derivatives for the columns of causes."""

    _each = (*NewRows._each, "by_state", "robot", "camera")

    by_state: Array  # (m, 6, 12 + q) by the errors of the estimates
    linear: Linearised  # J (m, 6, 12) by X and W, sides D_G and D_C (m, 6, 6), at the estimates
    robot: Array  # (m, 4, 4) base_T_gripper, corrected by the estimates
    camera: Array  # (m, 4, 4) camera_T_target, likewise

    def rows(self, index: Array) -> PoseEvidence:
        """Some of the poses, by their numbers or a mask."""
        r, J, sides = self.linear.r[index], self.linear.J[index], [D[index] for D in self.linear.sides]
        return replace(super().rows(index), linear=Linearised(r, J, (sides[0], sides[1])))


def evidence_of_poses(
    result: Estimated,
    poses: PosePairs,
    noise: PoseNoise | None = None,
    joints: ArrayLike | None = None,
    same: Iterable[str] | str = THINGS,
) -> PoseEvidence:
    """Compare new poses with a calibration.

    Parameters
    ----------
    result : Calibration
        With its joint posterior.
    poses : PosePairs
        m >= 1 poses of the same setup, in the frames of the calibration.
    noise : PoseNoise or None
        Of the new poses; None: that of the calibration's own, the mean where it differs from pose to pose, and for
        camera poses from corners that of their own fit.
    joints : (m, L) or None
        For a calibration with the kinematics of its arm; None: ``poses.joints``.

    same : names out of "robot", "camera" and "target"
        Which of them are those of the calibration. The errors of the others are independent, with the assumed size.

    Raises
    ------
    InputError
        A calibration without joint covariance, of another setup, without noise; poses of several data sets, or without
        the joints that this calibration needs.
    SingularNoiseError
        New poses whose residuals have no noise of their own.
    """
    posterior = posterior_of(result)
    assert result.W is not None
    if getattr(poses, "robot", np.zeros(0)).ndim != 3:
        raise InputError(f"Expected the new poses to be PosePairs of one data set, got {type(poses).__name__}.")
    poses = _in_scene(result, poses)
    if poses.setup != result.setup:
        raise InputError(f"Expected new poses of the setup {result.setup}, that of the calibration, got {poses.setup}.")
    ahead, F_C, of_camera, camera = _corrected(result, poses, joints)
    constraint = OnPoses(ahead.poses, camera, poses.setup == "eye-to-hand")
    linear = constraint.linearise(Unknowns(result.X, result.W), constraint.first, constraint.second)
    D_G, D_C = linear.sides
    by_state = np.concatenate([linear.J, D_G @ ahead.columns + D_C @ F_C], axis=-1)
    r, anew, drift = linear.r, np.zeros((poses.n, 6, 0)), D_C @ _drift_anew(result, poses)
    kept = checked_things(same)
    if _same_session(result, poses) and posterior.source is not None and len(kept) == len(THINGS):
        posterior = posterior.source.without_beside  # X and W as the means of the session that the poses are of
    if same is not THINGS:
        require_same(kept, poses_so_far(result), poses)
    if len(kept) < len(THINGS):
        other = 12 + posterior.owned_by([thing for thing in THINGS if thing not in kept])
        r = r + by_state[..., other] @ posterior.estimate[other - 12]  # of other things nothing was found
        sd = {error.key: error.size for error in result.shared}
        anew = by_state[..., other] * np.array([sd.get(posterior.keys[k - 12], 1.0) for k in other])
        by_state[..., other] = 0.0
    by_unit = by_state @ posterior.A
    robot_noise, more_G = _noise_of(poses, noise, "robot", ahead.fresh)
    camera_noise, more_C = _noise_of(poses, noise, "camera", of_camera)
    carried = [(one, D_G @ one.covariance @ D_G.mT) for one in robot_noise]
    carried += [(one, D_C @ one.covariance @ D_C.mT) for one in camera_noise]
    arm = next((one for one in posterior.noise if one.key == ROBOT_ACCURACY), None)
    unseen = D_G @ ahead.unseen @ D_G.mT
    if arm is not None:
        carried.append((arm, unseen / arm.size.median**2))
        unseen = 0.0 * unseen
    own = sum((one.size.median**2 * S for one, S in carried), unseen)
    sizes_open = () if posterior.points is None else posterior.points.keys
    parts = tuple((one.key, S) for one, S in carried if one.key in sizes_open)
    own_at = at_points(posterior, own, parts)
    by_unit = np.concatenate([by_unit, anew, D_G @ more_G, D_C @ more_C, drift], axis=-1)
    robot, at = ahead.poses, (r, by_unit, own, posterior)
    return PoseEvidence(*at, by_state, linear, robot, camera, own_at=own_at, parts=parts)


def _in_scene(result: Estimated, poses: PosePairs) -> PosePairs:
    """Return new poses in the unit of a result by a scene, with the errors beyond their features that it found."""
    if isinstance(result.data, PosePairs):
        result.data.require_same_scene(poses)
    S = poses.camera_covariance
    if poses.scene is None or S is None or result.camera_scale is None:
        return poses
    size = next((one.size for one in result.components if one.key == SCENE_EXCESS), 0.0)
    more = 1.0 + size**2
    S = JointCovariance(more * S.own, np.sqrt(more) * S.shared, S.keys)
    return replace(poses, camera_covariance=S).scaled(result.camera_scale.factor)


def _same_session(result: Estimated, poses: PosePairs) -> bool:
    """Return whether new poses were taken between those of the calibration: by one clock, at other times."""
    old, new = posterior_of(result).times, poses.timestamps
    if old is None or new is None or result.time_offset is not None:
        return False
    return bool(old.min() < new.max() and new.min() < old.max() and not np.isin(new, old).any())


def _drift_anew(result: Estimated, poses: PosePairs) -> Array:
    """(m, 6, z) drift of camera and target in a session of new poses, with the estimated size of a step.

    It is a random walk from their poses at its start, whose uncertainty is in the covariance of X and W: these are
    stated for any pose of a session. Its modes have the mean 0; the mean of m steps has the variance m / 3.
    """
    found = [np.zeros((poses.n, 6, 0))]
    if poses.n == 1 or _same_session(result, poses):
        return found[0]
    times = np.arange(float(poses.n)) if poses.timestamps is None else poses.timestamps
    for of, R in ((Owner.CAMERA, np.eye(3)), (Owner.TARGET, poses.camera[:, :3, :3])):
        if (sd := next((one.size for one in result.shared if one.key.error == DRIFTS[of]), 0.0)) > 0:
            constant = np.zeros((poses.n, 6, 6))
            constant[:, :3, :3] = constant[:, 3:, 3:] = np.sqrt(poses.n / 3.0) * R
            found += [sd * constant, sd * drift_columns(poses.camera, times, of == Owner.TARGET).rows()]
    return np.concatenate(found, axis=-1)


def poses_less_shared_errors(result: Estimated, poses: PosePairs) -> PosePairs:
    """Poses of the rig of a calibration, corrected by the estimates of the errors that they share with its poses."""
    ahead, _, _, camera = _corrected(result, poses, None)
    return PosePairs(ahead.poses, camera, poses.setup)


def _corrected(
    result: Estimated, poses: PosePairs, joints: ArrayLike | None
) -> tuple[RobotAhead, Array, NoiseAhead, Array]:
    """The robot poses corrected, what shared errors do to the camera poses, the noise of these, and they corrected."""
    given = joints if joints is not None or result.kinematics is None else poses.joints
    ahead = robot_ahead(result, given, poses.robot, measured=True)
    F_C, of_camera = _effects_on_camera(result, poses, ahead.poses)
    estimate = posterior_of(result).estimate
    return ahead, F_C, of_camera, perturb(poses.camera, -(F_C @ estimate[:, None])[..., 0])


def _effects_on_camera(result: Estimated, poses: PosePairs, robot: Array) -> tuple[Array, NoiseAhead]:
    """(m, 6, q) what the errors of the posterior do to the new camera poses, and the noise of these.

    They are taken where the camera should be at the corrected robot poses, without the noise of what it measured.
    Pictures that were adjusted with a camera of their own have nothing of the intrinsics' errors of the calibration.
    """
    posterior, there = posterior_of(result), camera_at(result, robot)
    F = shared_effects(result, "camera", robot, there)
    if _same_session(result, poses) and poses.timestamps is not None:
        for of, drift in DRIFTS.items():
            if walked := [k for k, key in enumerate(posterior.keys) if key.error == drift]:
                drifted = drift_columns(there, poses.timestamps, of == Owner.TARGET, posterior.times)
                F[..., walked] = drifted.rows()
    if not poses.camera_known:
        return F, fresh_of_camera(result, there)
    S = noise_of_pictures(result, poses)
    if joint_of(S) is not None and poses.camera_calibration is not None:
        F[..., numbers_of_intrinsics(posterior)] = 0.0
    return F, S


def noise_of_pictures(result: Estimated, poses: PosePairs) -> Array | JointCovariance | None:
    """Return the noise of camera poses with a covariance; with the camera of the result, only each pose's own part."""
    seen = poses.camera_calibration
    if seen is None:
        return poses.camera_covariance
    so_far = poses_so_far(result)
    before = None if so_far is None else so_far.camera_calibration
    same = before is not None and np.array_equal(before.bundle.parameters, seen.bundle.parameters)
    return np.asarray(seen.covariance.own) if same else seen.covariance


def _noise_of(
    poses: PosePairs, noise: PoseNoise | None, side: str, otherwise: NoiseAhead
) -> tuple[tuple[ErrorTerm, ...], Array]:
    """Noises of each new pose of a side, and what they share by themselves (m, 6, z)."""
    S = otherwise if noise is None else getattr(noise, side)
    m = poses.n
    if S is None or isinstance(S, tuple):
        return S or (), np.zeros((m, 6, 0))
    require_count(S, m, side, "poses")
    if (joint := joint_of(S)) is not None:
        return (ErrorTerm.given(side, np.asarray(joint.own)),), np.asarray(joint.shared)
    if is_joint(S):
        raise InputError(
            f"Expected the noise of new {side} poses as (6, 6), (m, 6, 6) or JointCovariance, got an array."
        )
    return (ErrorTerm.given(side, np.broadcast_to(S, (m, 6, 6))),), np.zeros((m, 6, 0))


class Residual(NamedTuple):
    """Residuals of m poses."""

    rotation: Array  # (m,) rad
    translation: Array  # (m,) m
    distance2: Array  # (m,) squared Mahalanobis distance from the prediction of the fit


def residuals_against(result: Estimated, poses: PosePairs) -> Residual:
    """Return the residuals of ``G X C = W`` of poses that the result was not fitted to, and their distances.

    The distance is that of the camera pose from its prediction (`predict_camera`), with the noise of one measurement:
    the mean of the noise of the poses that were used. Where the motions leave a part of X open, the errors of X and W
    count as independent, without those along what is open.
    """
    assert result.W is not None
    constraint = OnPoses(poses.robot, poses.camera, poses.setup == "eye-to-hand")
    linear = constraint.linearise(Unknowns(result.X, result.W), poses.robot, poses.camera)
    length = np.linalg.norm(linear.r.reshape(-1, 2, 3), axis=-1)
    if result.posterior is not None and result.opened is None:
        joints = None if result.kinematics is None else poses.joints
        ahead = predict_camera(result, joints, poses.robot)
        e, S = difference(poses.camera, ahead.poses), ahead.covariance
    else:
        e, S = linear.r, np.zeros((len(poses), 6, 6))
        by_robot, by_camera = linear.sides
        of_X, of_W = linear.J[..., :6], linear.J[..., 6:]
        parts = ((by_robot, own_noise(result, "robot")), (by_camera, own_noise(result, "camera")))
        for D, covariance in (*parts, (of_X, result.covariance), (of_W, result.covariance_W)):
            if covariance is not None:
                S = S + D @ covariance @ D.mT
    S = S + CHAIN_ROUNDING**2 * np.eye(6)
    return Residual(length[:, 0], length[:, 1], np.sum(e * np.linalg.solve(S, e[..., None])[..., 0], axis=-1))
