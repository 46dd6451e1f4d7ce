"""A request with its data: the noise, shared errors, arm and motions that the estimators take, checked together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core.geometry.se3 import Array
from ..core.limits import MIN_POSES_FOR_ROBUST
from ..core.memory import FEWER_POSES, require_memory
from ..errors import InputError, among, require_type
from ..fit.graph.constraint import Constraint, constraint_of, require_noise_fits
from ..fit.graph.gauss_helmert import ESTIMATORS
from ..fit.graph.request import Request, of_motions
from ..methods.all_pairs import AllPairs
from ..methods.registry import ROBOT_WORLD_METHODS
from ..model.errors.camera_noise import CameraNoise
from ..model.errors.columns import MANY_POSES
from ..model.errors.joint_covariance import JointCovariance
from ..model.errors.keys import CLOCK_OFFSET, LENS, OUTLINE, ROBOT_ACCURACY, VIEW
from ..model.errors.models import Noise, PoseNoise, require_count, with_prior
from ..model.errors.pose_prior import PosePrior
from ..model.errors.sizes import OF_SHEETS, checked_sizes
from ..model.errors.term import ErrorTerm
from ..model.kinematics.kinematic_errors import (
    ESTIMATE,
)
from ..model.poses.motions import Motions, relative_motions, spread_pairs
from ..model.poses.pose_pairs import PosePairs
from ..model.shared_errors.assumed import replace_defaults
from ..model.shared_errors.in_noise import shared_columns, with_shared
from ..model.shared_errors.shared_error import SharedError, checked_errors
from .arm import Arm, _arm_of, with_declared

# A pose (4, 4) and its covariance (6, 6), as a prior is given.
PoseAndCovariance: TypeAlias = tuple[ArrayLike, ArrayLike]


@dataclass(frozen=True, eq=False)
class Job:
    """A request with its data, checked and converted to the input of the estimators."""

    request: Request
    motions: Motions  # for residuals, and for 4DPA where `everything` is None
    everything: AllPairs | None  # 4DPA of all pairs, without forming them
    noise: Noise | None
    method: str
    robust: bool
    camera_noise: CameraNoise | None = None  # camera noise whose pixel noise, or the robot noise, is to be estimated
    robot_noise: Array | JointCovariance | None = None  # covariance of the robot poses, where it is known
    shared: tuple[SharedError, ...] = ()  # errors that all poses share, as unknowns
    pose_prior: PosePrior | None = None  # of X and W; the noise has it too, where it is known
    arm: Arm | None = None  # the robot's joints, where its kinematic errors count
    terms_of_arm: tuple[ErrorTerm, ...] = ()  # at the poses, where deviations are to be estimated
    given: PoseNoise | None = None  # noise in addition to which these are estimated

    @property
    def poses(self) -> PosePairs | None:
        return self.motions.poses

    @cached_property
    def constraint(self) -> Constraint:
        """Residual rows of the data, which define the likelihood."""
        constraint = constraint_of(self.data, self.noise)
        if self.noise is not None:
            return constraint
        return replace(constraint, split_known=False)

    @cached_property
    def columns(self) -> dict[str, JointCovariance]:
        """Effect of the shared errors on the poses of each side."""
        return {} if self.poses is None else shared_columns(self.shared, self.poses)

    @property
    def data(self) -> PosePairs | Motions:
        """Data of the likelihood: the poses where there are any, unless the noise is that of motions."""
        return self.motions if self.poses is None or of_motions(self.noise) else self.poses


def _open_noise(
    noise: Noise | CameraNoise | None,
) -> tuple[Noise | None, CameraNoise | None, Array | JointCovariance | None]:
    """The noise where it is known; else the camera noise with unknown pixel noise, and the robot's if it is known."""
    match noise:
        case CameraNoise():
            return None, noise, None
        case PoseNoise(robot=robot, camera=CameraNoise() as camera):
            return None, camera, robot
    return noise, None, None


def _with_corners(noise: Noise | None, motions: Motions) -> Noise | None:
    """Add to noise of the robot only the covariance of camera poses from corners or points."""
    S = None if motions.poses is None else motions.poses.known_camera
    match noise:
        case PoseNoise(robot=robot, camera=None, prior=prior) if S is not None:
            return PoseNoise(robot, S, prior=prior)
    return noise


def _pose_prior(
    noise: Noise | None, X: PoseAndCovariance | None, W: PoseAndCovariance | None, method: str, motions: Motions
) -> PosePrior | None:
    """Return the prior of X and W: given here, or with the noise."""
    given = PosePrior.of(X, W)
    if noise is not None and noise.prior is not None:
        if given is not None:
            raise InputError("Expected no `prior_X` or `prior_W` beside noise that has a `prior` of its own.")
        given = noise.prior
    if given is None:
        return None
    if method not in ESTIMATORS:
        raise InputError(f"Method {method!r} takes no prior of X or W; use efficient or ml.")
    if given.W is not None and (motions.poses is None or of_motions(noise)):
        raise InputError("Expected no prior of W: motions know nothing of W. Give poses, with PoseNoise or none.")
    return given


def job_of(request: Request, data: PosePairs | Motions, about: tuple[PosePairs, Array] | None = None) -> Job:
    """Return the job of a request and its data; raises `InputError` where they do not fit each other.

    ``about``: the measured poses and the errors of the arm about which ``data`` is linearised (`linear_about`).
    """
    require_type("data", data, (PosePairs, Motions), "PosePairs or Motions, or poses beside `camera`")
    timed, listed = take_offset(data, request.shared)
    of_both, camera, robot = _open_noise(request.noise)
    if request.prior is not None and (of_both is not None or robot is not None):
        raise InputError("Give either `noise` or, for noise that is to be estimated, a `prior`; not both.")
    motions, everything = _motions_of(request, timed, of_both)
    poses, N = motions.poses, len(motions) if motions.poses is None else motions.poses.n
    require_noise_fits(of_both, motions)
    if camera is not None:
        if poses is None or camera.n != poses.n:
            data_given = "motions" if poses is None else f"{poses.n} poses"
            raise InputError(f"Expected camera noise of the data given, {data_given}, got that of {camera.n} poses.")
        require_count(robot, camera.n, "robot", "poses")
    noise = _with_corners(of_both, motions) if camera is None else None
    measured, at = (poses, None) if about is None else about
    arm = _arm_of(request, measured, noise, at)
    robot_known = noise is not None or robot is not None or arm is not None
    errors = _errors_of(request, listed, poses, noise, camera, robot_known)
    terms = () if arm is None or arm.errors.is_exact else arm.terms
    own = None if of_motions(noise) else cast("PoseNoise | None", noise)
    declared, of_arm = _with_arm(own, arm, terms)
    shared, is_declared = (*errors, *of_arm), declared is not own
    of_arm_open = bool(terms) and not is_declared
    sizes_open = declared is not None and (of_arm_open or any(error.factor > 1 for error in shared))
    beside = declared if sizes_open else None  # sizes in addition to it are to be found
    priors = request.prior_X, request.prior_W
    pose_prior = _pose_prior(beside if sizes_open else noise, *priors, request.taken_method, motions)
    weighed = noise if of_motions(noise) else None if sizes_open else _with_columns(declared, shared, poses)
    job = Job(
        request=request,
        motions=motions,
        everything=everything,
        noise=None if weighed is None else with_prior(weighed, pose_prior),
        method=request.taken_method,
        robust=request.by_likelihood and N >= MIN_POSES_FOR_ROBUST if request.robust is None else request.robust,
        camera_noise=camera,
        robot_noise=robot,
        shared=shared,
        pose_prior=pose_prior,
        arm=arm,
        terms_of_arm=() if is_declared else terms,
        given=beside,
    )
    _require_open_sizes(job)
    _require_memory(job)
    return job


def _with_arm(
    noise: PoseNoise | None, arm: Arm | None, terms: tuple[ErrorTerm, ...]
) -> tuple[PoseNoise | None, tuple[SharedError, ...]]:
    """Return the noise with that of the joints, and the errors of an arm whose sizes are declared beside it."""
    if noise is None or arm is None or not terms or arm.errors.how == ESTIMATE:
        return noise, ()
    return with_declared(noise, arm.errors, terms)


def _with_columns(
    noise: PoseNoise | None, shared: tuple[SharedError, ...], poses: PosePairs | None
) -> PoseNoise | None:
    """Return the noise with the columns of the errors that poses share."""
    if noise is None or poses is None or not shared:
        return noise
    return with_shared(noise, shared_columns(shared, poses))


def _motions_of(request: Request, data: PosePairs | Motions, noise: Noise | None) -> tuple[Motions, AllPairs | None]:
    """Return the motions of one data set, and all pairs where 4DPA takes these without forming them."""
    everything, pairs = None, request.pairs
    match data:
        case PosePairs():
            if data.n < 3:
                raise InputError(f"Expected at least 3 poses, which make 2 motions, got {data.n}.")
            if among(pairs, ("all",)) and data.robot.ndim == 3 and not of_motions(noise):
                direct = (request.by_likelihood or request.taken_method == "4dpa") and request.scale is None
                if direct and request.kind in (None, "poses") and (of_all := AllPairs(data)).precise:
                    everything = of_all
                if everything or request.taken_method in ROBOT_WORLD_METHODS:
                    pairs = spread_pairs(data.n, 200_000)  # used for residuals and checks only
            motions = relative_motions(data, pairs)
        case Motions():
            motions = data
    if motions.A.ndim != 3:
        raise InputError("Expected one data set; for a batch call solve() and propagate(), or efficient().")
    return motions, everything


def _require_memory(job: Job, copies: int = 16, copies_of_many: int = 2, bytes_per_pose: int = 10_000) -> None:
    """Raise `InputError` where so many copies of the columns of X, W and the shared errors are more than is free.

    Of many poses they are held as their factors, measured and corrected, beside so many bytes of each pose.
    """
    if job.method in ESTIMATORS:
        n, columns = len(job.data), 12 + sum(len(error.keys) for error in job.shared)
        many = n > MANY_POSES
        needed = n * (8.0 * 6.0 * (copies_of_many if many else copies) * columns + (bytes_per_pose if many else 0))
        require_memory(needed, f"A fit to {n:,} poses", FEWER_POSES)


def _stands(poses: PosePairs | None) -> bool:
    """Return whether the origin of the gripper stays in one place, as of a gimbal: errors over a workspace are none."""
    return poses is not None and float(np.ptp(poses.robot[..., :3, 3], axis=-2).max(initial=0.0)) < 1e-9


def _require_open_sizes(job: Job) -> None:
    """Raise `InputError` where sizes or components are given and nothing is estimated, or of other poses."""
    request = job.request
    if not request.sizes and not request.components:
        return
    if job.noise is not None or job.method not in ESTIMATORS:
        raise InputError(
            "Expected no `sizes` or `components` where the noise is given or the method is a published one: nothing is "
            "estimated. Declare a known error as `shared` (SharedError.columns)."
        )
    for part in request.components:
        if part.columns is not None and part.columns.shape[0] != len(job.data):
            raise InputError(
                f"Expected `columns` of the component {part.name!r} of {len(job.data)} poses, got "
                f"{part.columns.shape[0]}."
            )


def take_offset(
    data: PosePairs | Motions, shared: Sequence[SharedError] | None
) -> tuple[PosePairs | Motions, Sequence[SharedError] | None]:
    """Replace the standard deviation of the clock offset in the `timing` of synchronised poses; the rest of the errors.

    None: the defaults, also where a clock offset is all that was given.
    """
    poses = data.poses
    offset = next((error for error in shared or () if error.key == CLOCK_OFFSET), None)
    if offset is None or poses is None or poses.timing is None:
        return data, shared
    timed = replace(poses, timing=replace(poses.timing, std=float(offset.sd[0])))
    rest = tuple(error for error in shared or () if error is not offset)
    return (timed if isinstance(data, PosePairs) else replace(data, poses=timed)), rest or None


def _errors_of(
    request: Request,
    listed: Sequence[SharedError] | None,
    poses: PosePairs | None,
    noise: Noise | None,
    camera: CameraNoise | None,
    robot_known: bool,
) -> tuple[SharedError, ...]:
    """Return the errors that count, bound to the poses and with the sizes that were given."""
    found = _listed(listed, poses, noise, request, camera)
    prior = request.prior
    declared = prior is not None and all(key in prior and prior[key].is_known for key in OF_SHEETS["robot"])
    without = {ROBOT_ACCURACY} if robot_known or declared or _stands(poses) else set()
    if not request.by_likelihood or poses is None or poses.truth is not None:
        without = {ROBOT_ACCURACY, LENS, OUTLINE, VIEW}
    errors = tuple(one for one in found if not (one.default and (one.is_exact or one.key in without)))
    if poses is None:
        return errors
    sizes = checked_sizes(request.sizes)
    if twice := [error.name for error in errors if error.name in sizes and not error.default]:
        raise InputError(
            f"The size of {twice[0]!r} is declared twice: in `sizes` (--size), and as a shared error of its own or "
            "by the class of the arm. Remove one of them."
        )
    bound = (error.bound(poses) if error.needs_poses else error for error in errors)
    return tuple(error.sized(sizes[error.name]) if error.name in sizes else error for error in bound)


def _listed(
    shared: Sequence[SharedError] | None,
    poses: PosePairs | None,
    noise: Noise | None,
    request: Request,
    camera: CameraNoise | None,
) -> tuple[SharedError, ...]:
    """Return the errors that were given and, where the noise is to be estimated, the defaults of other names."""
    estimated = noise is None and poses is not None and request.kind in (None, "poses")
    if shared is None and not estimated:
        return ()
    if estimated and shared != ():
        assert poses is not None
        errors = tuple(replace_defaults(shared or (), camera is not None or poses.intrinsics_covered))
        return errors if shared is None else checked_errors(errors, poses)
    errors = tuple(shared or ()) if poses is None else checked_errors(shared, poses)
    if not errors:
        return ()
    if poses is None or of_motions(noise):
        raise InputError(
            "Expected poses and PoseNoise beside `shared`: the effect of errors on motions without poses is not known."
        )
    return errors
