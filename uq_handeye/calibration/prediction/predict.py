r"""Predictions at other robot poses, from the joint posterior of X, W and the errors that all poses share (theory K4).

With the posterior of ``(xi_X, xi_W, e)``, errors of X and W and those that all poses share (focal length, target, arm),
and the error ``xi_G = F_G (e - estimate)`` of the robot pose G at joints q (``FK(q; e)`` at the estimate), F_G the
columns there, to first order

- *camera pose*, ``C = inv(X) inv(G) W``: with J, D_G, D_C the derivatives of the constraint ``G X C = W`` by X and W,
  robot and camera pose (G inverted for eye-to-hand), ``xi_C = -inv(D_C) (J (xi_X; xi_W) + D_G xi_G)``. A camera with
  wrong intrinsics, or a target of wrong size, adds these errors to what is measured; their estimates are in the
  prediction.
- *point p seen by the camera*: in the base ``b = G X p`` (eye-in-hand), ``d b = R_G (theta_X x R_X p + tau_X) +
  theta_G x (b - t_G) + tau_G``; or ``b = X p`` (eye-to-hand).
- *tool against point*: ``FK(q') tau - b``, tau the tip of the tool in the flange at joints q': by
  ``theta_G' x R_G' tau + tau_G'`` minus d b; errors that move both, such as those of the base, cancel.

X, W and e are correlated: near the poses of the calibration much of their errors cancels. One new measurement adds its
own noise: of the joints, of the robot pose, of the camera. Noise of the robot that was estimated from the data is not
measurement noise alone: in addition to repeatability it contains position errors of the arm that no model explains (the
elbow of one of seven axes, its gears), which occur at any other pose as well. It therefore counts without a measurement
too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, TypeAlias, Union

import numpy as np
from numpy.typing import ArrayLike

from ...core.files.records import Record
from ...core.geometry.checks import as_numbers, as_transforms
from ...core.geometry.se3 import Array, inverse, perturb
from ...errors import InputError
from ...fit.diagnostics.task_space import PointUncertainty, by_pose, point_noise
from ...fit.graph.constraint import OnPoses, Unknowns
from ...fit.graph.gauss_helmert import ESTIMATORS
from ...fit.graph.posterior import Posterior
from ...model.errors.joint_covariance import JointCovariance
from ...model.errors.key import ErrorKey, Kind
from ...model.errors.keys import BY_VIEW, INTRINSICS, JOINT_NOISE, ROBOT_ACCURACY
from ...model.errors.sizes import Size
from ...model.errors.term import ErrorTerm
from ...model.kinematics.elbow import elbow_moved
from ...model.kinematics.errors import GROUPS
from ...model.kinematics.kinematic_errors import EXACT, effects_of_errors, frame_key
from ...model.kinematics.workspace_gauge import frame_columns
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ...model.shared_errors.assumed import bound_again, error_by_number
from ...model.shared_errors.shared_error import SharedError
from ...model.shared_errors.view import median_distance, target_centre, view_block
from ..analysis import FittedKinematics
from ..estimated import Estimated

if TYPE_CHECKING:  # slow to import
    from scipy.spatial.transform import RigidTransform

# Robot poses (..., 4, 4) as they are given.
PosesLike: TypeAlias = Union[ArrayLike, "RigidTransform"]
# How far, along the joints, the elbow of an arm of seven axes is from where inverse kinematics places it at other
# poses: RMS 1.3 to 1.9 rad of Pandas whose elbow is anywhere (`studies/one_model/new_program.md`).
ELBOW_OFFSET_RAD = 1.6


def posterior_of(result: Estimated) -> Posterior:
    """Return the joint posterior of X and W; raises `InputError` where there is none, with the reason."""
    if result.opened is not None:
        raise InputError(
            "Predictions, checks and updates need all of X and W, and the motions leave a part of them open "
            "(`opened`). Close it by a prior (prior_X, prior_W), or calibrate with rotations about another axis."
        )
    if result.posterior is None or result.W is None:
        if result.covariance is None:
            raise InputError(
                "Expected a calibration with a covariance, got one without: poses that fit exactly, or too few, show "
                "no noise. Calibrate with `noise`, or with more poses."
            )
        what, do = f"by method {result.method!r}", "Calibrate poses by method efficient or ml."
        if isinstance(result.counted, Motions):
            what = "of motions without poses"
        elif result.method in ESTIMATORS:
            what, do = "of a file", "Calibrate again; uq.update does it where the file has its poses."
        raise InputError(
            f"Expected a calibration with the joint covariance of X and W, got one {what} without it. {do}"
        )
    return result.posterior


@dataclass(frozen=True, eq=False)
class CameraPrediction(Record):
    """Predicted camera poses ``camera_T_target`` at m robot poses."""

    _in_file: ClassVar[str] = "frame new_measurement poses covariance std"
    frame: ClassVar[str] = "camera_T_target"

    poses: Array  # (..., 4, 4)
    covariance: Array  # (..., 6, 6) of (theta, tau): left rotation (rad), additive translation (m), camera frame
    new_measurement: bool  # whether it holds the noise of one new measurement

    @property
    def std(self) -> Array:
        """(..., 6) standard deviations, rad and m."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))


def total_of(fresh: tuple[ErrorTerm, ...], shape: tuple[int, ...]) -> Array:
    """(..., 6, 6) sum of the covariances of several noises."""
    return sum((one.size.median**2 * one.covariance for one in fresh), np.zeros((*shape, 6, 6)))


class RobotAhead(NamedTuple):
    """Robot poses of predictions, with the effects of the shared errors and of new noise on them."""

    poses: Array  # (..., 4, 4) base_T_gripper, corrected by the estimates
    columns: Array  # (..., 6, q) error of the pose by (e - estimate) of each shared error
    fresh: tuple[ErrorTerm, ...]  # of joints and pose, drawn again
    unseen: Array  # (..., 6, 6) of errors of the robot there of which its poses so far say nothing

    @property
    def noise(self) -> Array:
        """(..., 6, 6) covariance of all independent noise."""
        return total_of(self.fresh, self.poses.shape[:-2])


class CameraAhead(NamedTuple):
    """Camera poses of predictions, with the effects of the errors of the posterior and of new noise on them."""

    poses: Array  # (..., 4, 4) camera_T_target that will be measured
    columns: Array  # (..., 6, 12 + q) error of the pose by those of the posterior
    noise: Array  # (..., 6, 6) of joints, robot pose and camera pose, drawn again
    of_robot: Array  # (..., 6, 6) that of joints and robot pose only, where it was estimated from the data
    robot: Array  # (..., 4, 4) base_T_gripper, corrected by the estimates
    unseen: Array  # (..., 6, 6) of errors of the robot there of which its poses so far say nothing


def predict_camera(
    result: Estimated,
    joints: ArrayLike | None = None,
    robot: PosesLike | None = None,
    new_measurement: bool = True,
) -> CameraPrediction:
    """See `Calibration.predict_camera`."""
    posterior = posterior_of(result)
    so_far = poses_so_far(result)
    from_corners = so_far is not None and so_far.camera_calibration is not None
    if new_measurement and numbers_of_intrinsics(posterior) and not from_corners:
        raise InputError(
            "The effect of the intrinsics' errors on a new measurement follows from its corners, which this result "
            "does not hold: calibrate again with the camera folder; or predict without the noise of one measurement."
        )
    ahead = camera_ahead(result, joints, robot)
    noise = ahead.unseen + (ahead.noise if new_measurement else ahead.of_robot)
    return CameraPrediction(ahead.poses, posterior.predict(ahead.columns, noise), new_measurement)


def camera_ahead(result: Estimated, joints: ArrayLike | None = None, robot: PosesLike | None = None) -> CameraAhead:
    """Camera poses at joints or robot poses, to first order in the errors of the posterior."""
    posterior = posterior_of(result)
    assert result.W is not None and result.setup is not None
    ahead = robot_ahead(result, joints, robot)
    C = camera_at(result, ahead.poses)
    shape = C.shape[:-2]
    flat = C.reshape(-1, 4, 4)
    constraint = OnPoses(ahead.poses.reshape(-1, 4, 4), flat, result.setup == "eye-to-hand")
    linear = constraint.linearise(Unknowns(result.X, result.W), constraint.first, constraint.second)
    D_G, D_C = linear.sides
    F_C = shared_effects(result, "camera", ahead.poses.reshape(-1, 4, 4), flat)
    by_robot = -np.linalg.solve(D_C, D_G)
    by_all = np.concatenate(
        [-np.linalg.solve(D_C, linear.J), by_robot @ ahead.columns.reshape(F_C.shape) - F_C], axis=-1
    )
    all_of_robot, of_robot = (
        by_robot @ total_of(fresh, shape).reshape(-1, 6, 6) @ by_robot.mT
        for fresh in (ahead.fresh, tuple(one for one in ahead.fresh if posterior.noise and one.key.kind != Kind.GIVEN))
    )
    noise = all_of_robot + total_of(fresh_of_camera(result, flat), flat.shape[:1])
    unseen = (by_robot @ ahead.unseen.reshape(-1, 6, 6) @ by_robot.mT).reshape(*shape, 6, 6)
    seen = perturb(flat, (F_C @ posterior.estimate[:, None])[..., 0])
    return CameraAhead(
        seen.reshape(*shape, 4, 4), by_all.reshape(*shape, *by_all.shape[1:]), noise.reshape(*shape, 6, 6),
        of_robot.reshape(*shape, 6, 6), ahead.poses, unseen,
    )  # fmt: skip


def camera_at(result: Estimated, robot: Array) -> Array:
    """(..., 4, 4) camera_T_target by X and W at robot poses (..., 4, 4)."""
    assert result.W is not None
    G = inverse(robot) if result.setup == "eye-to-hand" else robot
    return np.asarray(inverse(result.X) @ inverse(G) @ result.W)


def predict_points(
    result: Estimated,
    points: ArrayLike,
    joints: ArrayLike | None = None,
    robot: PosesLike | None = None,
    points_covariance: ArrayLike | None = None,
    reached_at: ArrayLike | None = None,
    tool: ArrayLike | None = None,
) -> PointUncertainty:
    """See `Calibration.predict`."""
    posterior_of(result)
    if reached_at is None and tool is not None:
        raise InputError("Expected `reached_at`, the joints at which the tool is at the point, beside `tool`.")
    stands = result.setup == "eye-to-hand" and joints is None and robot is None  # the robot does not enter
    ahead = None if stands else robot_ahead(result, joints, robot)
    p = as_numbers(points, "points")
    if p.ndim < 1 or p.shape[-1] != 3 or not np.isfinite(p).all():
        raise InputError(f"Expected `points` to be finite numbers (..., 3) in metres, got shape {p.shape}.")
    noise = point_noise(points_covariance, p)
    at = () if ahead is None else ahead.poses.shape[:-2]
    reached = None if reached_at is None else tip_at(robot_ahead(result, reached_at, None), tool)
    try:
        shape = np.broadcast_shapes(p.shape[:-1], at, () if reached is None else reached.at.shape[:-1])
    except ValueError:
        raise InputError(
            f"Expected leading axes of `points` (..., 3) and robot poses that fit, got {p.shape} and {at}"
            f"{'' if reached is None else f' and {reached.at.shape[:-1]}'}."
        ) from None
    found = seen_at(result, p, ahead, noise)
    found = found if reached is None else reached.less(found)
    S = np.broadcast_to(found.covariance(result), (*shape, 3, 3))
    return PointUncertainty(np.broadcast_to(found.at, (*shape, 3)), S, "base", tails=result.tails)


class InBase(NamedTuple):
    """Points in the base, with their derivatives by the joint posterior and their independent noise."""

    at: Array  # (..., 3)
    by_all: Array  # (..., 3, 12 + q)
    new: Array  # (..., 3, 3)

    def less(self, other: InBase) -> InBase:
        """The difference from other points, with the noise of both."""
        return InBase(self.at - other.at, self.by_all - other.by_all, self.new + other.new)

    def covariance(self, result: Estimated) -> Array:
        """(..., 3, 3)."""
        return posterior_of(result).predict(self.by_all, self.new)


def seen_at(result: Estimated, p: Array, ahead: RobotAhead | None, noise: Array | None = None) -> InBase:
    """Points (..., 3) that the camera sees at robot poses; ``noise`` (..., 3, 3): that of the points themselves."""
    X, q = result.X, posterior_of(result).covariance.shape[0] - 12
    arm = p @ X[:3, :3].T
    by_X = by_pose(arm)
    in_X = arm + X[:3, 3]
    if result.setup == "eye-in-hand":
        assert ahead is not None
        R = ahead.poses[..., :3, :3]
        lever = (R @ in_X[..., None])[..., 0]
        b = lever + ahead.poses[..., :3, 3]
        by_G = by_pose(lever)
        by_errors = by_G @ ahead.columns
        by_X = R @ by_X
        new = by_G @ (ahead.noise + ahead.unseen) @ by_G.mT
        R_p = R @ X[:3, :3]
    else:
        b, by_errors, new, R_p = in_X, np.zeros((3, q)), np.zeros((3, 3)), X[:3, :3]
    if noise is not None:
        new = new + R_p @ noise @ R_p.mT
    by_all = np.zeros((*b.shape, 12 + q))
    by_all[..., :6], by_all[..., 12:] = by_X, by_errors
    return InBase(b, by_all, new)


def tip_at(ahead: RobotAhead, tool: ArrayLike | None) -> InBase:
    """The tip of the tool (..., 3) in the flange, at robot poses."""
    tip = np.zeros(3) if tool is None else as_numbers(tool, "tool")
    if tip.ndim < 1 or tip.shape[-1] != 3 or not np.isfinite(tip).all():
        raise InputError(f"Expected `tool` to be finite numbers (..., 3) in metres, got shape {tip.shape}.")
    lever = (ahead.poses[..., :3, :3] @ tip[..., None])[..., 0]
    by_G = by_pose(lever)
    by_errors = by_G @ ahead.columns
    by_all = np.zeros((*by_errors.shape[:-1], 12 + by_errors.shape[-1]))
    by_all[..., 12:] = by_errors
    return InBase(lever + ahead.poses[..., :3, 3], by_all, by_G @ (ahead.noise + ahead.unseen) @ by_G.mT)


def robot_ahead(
    result: Estimated, joints: ArrayLike | None, robot: PosesLike | None, measured: bool = False
) -> RobotAhead:
    """Return the robot poses by joints, corrected by the estimates, or as given by the controller; raises `InputError`.

    ``measured``: with the noise of new measurements (`BoundPopulation.unseen`).
    """
    posterior, fitted = posterior_of(result), result.kinematics
    if joints is None and robot is None:
        raise InputError("Expected `joints` of the robot, or `robot`, its poses.")
    if joints is not None and fitted is None:
        raise InputError(
            "This calibration knows no joints: give `robot`, poses base_T_gripper; or calibrate with joints and "
            "kinematics."
        )
    given = None if robot is None else as_transforms(robot, "robot", stack=False)
    by_poses = joints is None and fitted is not None and fitted.how != EXACT
    if by_poses:
        assert given is not None and fitted is not None
        joints = fitted.joints_at(given)
    place = posterior.place
    if joints is not None:
        assert fitted is not None
        q = fitted.checked(joints)
        G = fitted.poses(q, given)
        J = fitted.chain.jacobian(q, fitted.e)
        of_arm = [(k, place[part.key]) for k, part in enumerate(fitted.chain.errors) if part.key in place]
        columns = np.zeros((*G.shape[:-2], 6, len(place)))
        if of_arm:
            here, there = np.array(of_arm).T
            columns[..., there] = -effects_of_errors(fitted.chain, q, fitted.e, fitted.flange)[..., here]
        for group in GROUPS:
            if frame_key(group, 0) in place:
                there = np.array([place[frame_key(group, k)] for k in range(12)])
                columns[..., there] = -frame_columns(fitted.chain, q, group)
    else:
        assert given is not None
        G, J = given, None
        columns = np.zeros((*G.shape[:-2], 6, len(place)))
    flat = G.reshape(-1, 4, 4)
    more = shared_effects(result, "robot", flat, np.broadcast_to(np.eye(4), flat.shape))
    G = perturb(flat, -(more @ posterior.estimate[:, None])[..., 0]).reshape(G.shape)
    unseen = rest_of_robot(result, flat, measured and bool(posterior.noise)).reshape(*G.shape[:-2], 6, 6)
    if by_poses and fitted is not None and fitted.chain.n_joints > 6 and of_arm:
        unseen = unseen + _of_elbow(fitted, posterior, q, *np.array(of_arm).T)
    return RobotAhead(G, columns + more.reshape(columns.shape), _fresh_of_robot(result, J), unseen)


def _of_elbow(fitted: FittedKinematics, posterior: Posterior, q: Array, here: Array, there: Array) -> Array:
    """Return the covariance (..., 6, 6) that the unknown elbow of seven axes adds to the effect of the arm's errors.

    The mean square of the change of the errors ``here`` of the arm, ``there`` in the posterior, where the elbow is
    `ELBOW_OFFSET_RAD` from where inverse kinematics places it.
    """
    flat = q.reshape(-1, q.shape[-1])

    def effects(at: Array) -> Array:
        return effects_of_errors(fitted.chain, at, fitted.e, fitted.flange)[..., here]

    e = posterior.estimate[there]
    square = posterior.covariance[np.ix_(12 + there, 12 + there)] + np.outer(e, e)
    change = [
        effects(at) - effects(flat)
        for at in elbow_moved(fitted.chain, fitted.chain.poses(flat), flat, ELBOW_OFFSET_RAD)
    ]
    S = sum(0.5 * D @ square @ D.mT for D in change)
    return np.asarray(S).reshape(*q.shape[:-1], 6, 6)


def _fresh_of_robot(result: Estimated, J: Array | None) -> tuple[ErrorTerm, ...]:
    """Noises of future robot poses; ``J`` (..., 6, L): their derivatives by the joints, where these are known."""
    posterior, fitted = posterior_of(result), result.kinematics
    if not posterior.noise:
        found = [ErrorTerm.given("robot", own_noise(result, "robot"))]
        if J is not None and fitted is not None:
            found.append(ErrorTerm(JOINT_NOISE, "robot", Size(fitted.joint_noise, unit="rad"), block=J))
        return tuple(found)
    of_robot = [one for one in posterior.noise if one.side == "robot" and one.key != ROBOT_ACCURACY]
    others = [one for one in of_robot if one.key != JOINT_NOISE]
    of_joints = [] if J is None else [replace(one, block=J) for one in of_robot if one.key == JOINT_NOISE]
    return (*others, *of_joints)


def fresh_of_camera(result: Estimated, camera: Array) -> tuple[ErrorTerm, ...]:
    """Noises of future camera poses (m, 4, 4)."""
    posterior, of = posterior_of(result), bound_to(result)
    if not posterior.noise:
        return (ErrorTerm.given("camera", own_noise(result, "camera")),)
    found = [one for one in posterior.noise if one.side == "camera"]
    if of is None:
        return tuple(found)
    distance = median_distance(of.camera)
    centre = target_centre(of.camera, distance)
    block = view_block(camera, distance, centre)
    return tuple(replace(one, block=block) if one.key == BY_VIEW else one for one in found)


def shared_effects(result: Estimated, side: Literal["robot", "camera"], robot: Array, camera: Array) -> Array:
    """(m, 6, q) effects of shared errors of a side on m poses, known by kind or the camera's calibration; else 0."""
    posterior = posterior_of(result)
    found = np.zeros((len(robot), 6, len(posterior.keys)))
    poses = PosePairs(robot, camera, result.setup or "eye-in-hand")
    calibrated = poses if (data := bound_to(result)) is None else data
    columns: dict[ErrorKey, Array] = {}
    for k, key in enumerate(posterior.keys):
        if (of := error_by_number(key)) is not None and of[0].side == side:
            error, part = of
            if error.key not in columns:
                columns[error.key] = error.bound(calibrated).at(poses)
            found[..., k] = columns[error.key][..., part]
    for error in errors_of_poses(result):
        if error.side == side:
            index = [posterior.place[key] for key in error.keys]
            found[..., index] = error.at(poses)
    before = poses_so_far(result)
    index, seen = numbers_of_intrinsics(posterior), None if before is None else before.camera_calibration
    S: JointCovariance | None = getattr(result.noise, "camera", None)
    if side == "camera" and index and seen is not None and S is not None:
        so_far = S.shared[..., [key in (None, INTRINSICS) for key in S.keys]]
        found[..., index] = seen.shared_ahead(camera, so_far)
    return found


def poses_so_far(result: Estimated) -> PosePairs | None:
    """Return the poses of the calibration, where it holds them."""
    data = result.counted
    return None if data is None else data.poses


def bound_to(result: Estimated) -> PosePairs | None:
    """Return the poses that errors of poses were bound to."""
    posterior = posterior_of(result)
    if posterior.bound is not None:
        return PosePairs(*posterior.bound, result.setup or "eye-in-hand")
    return poses_so_far(result)


def errors_of_poses(result: Estimated) -> list[SharedError]:
    """Return the errors whose numbers belong to the poses of the calibration, bound to them."""
    poses, posterior = bound_to(result), posterior_of(result)
    if poses is None:
        return []
    errors = dict.fromkeys(key.error for key in posterior.keys)
    reach = next((error.accuracy.reach for error in result.shared if error.accuracy is not None), None)
    found = [bound_again(key, poses, reach) for key in errors]
    return [error for error in found if error is not None and set(error.keys) <= posterior.place.keys()]


def rest_of_robot(result: Estimated, robot: Array, measured: bool = False) -> Array:
    """(m, 6, 6) covariance of the robot's errors at other poses, given those at the poses of the calibration."""
    sd = next((error.size for error in result.shared if error.key.error == ROBOT_ACCURACY), 0.0)
    for error in errors_of_poses(result):
        if error.unseen is not None:
            return sd**2 * error.unseen(PosePairs(robot, np.broadcast_to(np.eye(4), robot.shape)), measured)
    return np.zeros((len(robot), 6, 6))


def numbers_of_intrinsics(posterior: Posterior) -> list[int]:
    return [k for k, key in enumerate(posterior.keys) if key.error == INTRINSICS]


def own_noise(result: Estimated, side: Literal["robot", "camera"]) -> Array:
    """(6, 6) the noise of one new pose of a side, the mean of those so far, without that of joints."""
    S = getattr(result.noise, side, None)
    if S is None:
        return np.zeros((6, 6))
    own = np.asarray(getattr(S, "own", S))
    if own.shape[-1] != 6:
        raise InputError(f"Expected noise of each pose for a prediction, got a joint array of the {side} poses.")
    fitted = result.kinematics
    if side == "robot" and fitted is not None and fitted.joint_noise > 0:
        J = fitted.chain.jacobian(fitted.joints, fitted.e)
        own = own - fitted.joint_noise**2 * J @ J.mT
    values, vectors = np.linalg.eigh(own.reshape(-1, 6, 6).mean(axis=0))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
