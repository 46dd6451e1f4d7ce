r"""Planning: which poses to take next, and what they would bring.

Model (`constraint`, T5): the errors of pose i reach X and W through the residual of ``G X C = W``, so that its
information about ``(xi_X, xi_W)`` is ``J_i^T S_i^-1 J_i``. Poses yet to be taken have independent errors, and all that
the information asks of them is where they are: for a robot pose G the camera will see ``C = inv(X) inv(G) W`` (G
inverted for eye-to-hand). To first order the covariance after the poses c is therefore known beforehand,

    Sigma(c) = ( I_so_far + sum_(j in c) B_j^T B_j )^-1,    B_j = L_j^-1 J_j (6x12),    S_j = L_j L_j^T,

The camera that saw the poses so far will see the next, with the intrinsics it was calibrated with: their errors are
further unknowns too, with the columns ``D_C G T`` at the poses to come (`CameraCalibration.shared_ahead`).

*Shared errors* (T10) are further unknowns z with the prior N(0, I): J becomes ``[J, D F]``, new poses have the columns
of where they will be seen, and what is known so far is an identity more. More poses do not average them out.

The block of X is what the plan shows: errors ``(theta, tau)``, rad and m, parent frame of X. Three criteria, each
to be made small:

- ``trace``: the mean squared error (m^2) of points at the distance ``length`` from the camera, in all directions:
  ``tr(Sigma_tau) + 2/3 length^2 tr(Sigma_theta)``. The length makes angles and lengths commensurable.
- ``point``: the mean squared error (m^2) of one point p in camera coordinates, expressed in the parent frame of X:
  ``tr(M Sigma M^T)``, ``M = [-[R_X p]x, I]``.
- ``logdet``: ``log det Sigma``, the volume of the ellipsoid, whatever the units.

Poses are chosen greedily, then exchanged one by one as long as that helps, and put into the order in which each brings
most (`selection`). That is no proof of the best set; docs/how-to/plan.md has the gap.

Poses that leave a part of X open (parallel axes, pure translations) can be planned from: there a weak prior stands in
(`weak_prior`), and `Plan.open_directions` says where.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibrate import calibrate
from ..calibration.result import Calibration
from ..errors import DegenerateMotionError, InputError, NotConvergedError, require_integer
from ..formatting.units import parse_length
from ..geometry.checks import as_transforms
from ..geometry.se3 import Array
from ..kinematics.chain import Kinematics
from ..kinematics.kinematic_errors import KinematicErrors
from ..likelihood.constraint import Linearised, OnPoses, constraint_of, residual_covariance
from ..likelihood.gauss_helmert import efficient
from ..noise.estimate import NoisePrior
from ..noise.joint_covariance import JointCovariance
from ..noise.models import PoseNoise, is_joint, marginals
from ..noise.square_roots import cholesky_of, gram, whiten
from ..poses.pose_pairs import PosePairs
from ..poses.timing import SIDES, warn_left_out
from ..posterior.selection import select, weight_of_X
from ..prediction.predict import camera_ahead, camera_at
from ..shared_errors.shared_error import (
    CLOCK_OFFSET,
    OF_ANY_POSES,
    SharedError,
    assumed_drift,
    checked_errors,
    replace_defaults,
    settled_errors,
    without_shared,
)
from .by_joints import PREDICTION, Wanted, plan_by_joints, so_far_by_joints
from .by_posterior import chosen_by, noise_of_new
from .candidates import predicted_camera, require_choice, sample_candidates
from .result import FORMS, Plan
from .weak_prior import so_far

CRITERIA = ("trace", "logdet", "point")
GIVE = "Give `noise` (--robot-noise and --camera-noise, or --noise)."


def plan(
    data: PosePairs,
    candidates: Any = None,
    k: int = 5,
    *,
    noise: PoseNoise | None = None,
    criterion: str | None = None,
    point: Any = None,
    length: str | float | None = None,
    sample: int = 200,
    seed: int | np.random.Generator = 0,
    repeat: bool = False,
    shared: Sequence[SharedError] | None = None,
    joints: ArrayLike | None = None,
    kinematics: Kinematics | None = None,
    kinematic_errors: KinematicErrors | None = None,
    task: ArrayLike | None = None,
    prior: NoisePrior | None = None,
) -> Plan:
    """The next k poses that most reduce the uncertainty of X, and the covariance of X predicted after each.

    Parameters
    ----------
    data : PosePairs
        The poses so far, at least 3, without batch axes. They need not determine X yet.
    candidates : (m, 4, 4) or None; (m, L) with ``kinematics``
        Robot poses ``base_T_gripper``, or joints, to choose from; None draws ``sample`` of them by `sample_candidates`,
        or inside the joint limits by `sample_joints`.
    k : int
    noise : PoseNoise or None
        6x6 or (n, 6, 6), whose mean is taken for new poses; of the camera also what its calibration says
        (``camera_calibration``), which stands where it is left out. None estimates it from the poses so far.
    criterion : "trace", "logdet", "point", "prediction" or None
        What the poses are chosen by: the mean squared error of points at a distance (``length``), the volume of the
        ellipsoid, the mean squared error of one point (``point``), or that of predictions at ``task``. None is
        "prediction" with ``kinematics``, else "trace".
    point : 3 numbers (m) or texts with units, or None
        For criterion "point": in camera coordinates.
    length : float (m), str or None
        For criterion "trace"; None is the root mean square distance from camera to target so far.
    sample : int
    seed : int or numpy Generator
        Of the candidates drawn.
    repeat : bool
        Whether a candidate may be taken more than once.
    shared : sequence of SharedError or None
        As in `calibrate`, but for columns of the user's own, whose effect on new poses is not known. The clock offset
        has none: the robot is taken to stand still.
    joints, kinematics, kinematic_errors
        As in `calibrate`: the errors of the arm are unknowns beside X and W, and the plan is one of joints, inside
        their limits (`planning.by_joints`).
    task : (t, L) or None
        Joints (rad, m) at which predictions are to be good; None: postures spread over the joint limits.
    prior : NoisePrior or None
        As in `calibrate`, where ``noise`` is None.

    Raises
    ------
    InputError
        Arguments that do not fit each other or the data; more than 100,000 candidates; joint noise (6n, 6n), which
        says nothing of new poses; no noise where it cannot be estimated.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> from uq_handeye.planning.plan import plan
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> found = plan(uq.simulate(n_poses=10, noise=noise), k=3, noise=noise)
    >>> found.robot.shape, found.covariances.shape
    ((3, 4, 4), (3, 6, 6))
    """
    if not isinstance(data, PosePairs):
        raise InputError(f"Expected `data` to be PosePairs, got {type(data).__name__}.")
    if data.robot.ndim != 3:
        raise InputError(f"Expected poses without batch axes, got shape {data.robot.shape}.")
    if data.n < 3:
        raise InputError(f"Expected at least 3 poses so far, got {data.n}.")
    warn_left_out("plan()", data)
    require_integer("k", k, 1)
    if kinematics is not None:
        options = {"noise": noise, "prior": prior, "shared": shared, "joints": joints}
        known = so_far_by_joints(data, kinematics, options | {"kinematic_errors": kinematic_errors})
        criterion = criterion or PREDICTION
        of = Wanted(criterion, *_target(data, criterion, point, length), task)
        return plan_by_joints(known, candidates, k, of, sample, seed, repeat)
    if criterion == PREDICTION or any(given is not None for given in (joints, kinematic_errors, task)):
        raise InputError(
            "Expected `kinematics` (Kinematics.from_urdf) beside joints, kinematic errors, task and criterion "
            f"{PREDICTION!r}."
        )
    if noise is not None and prior is not None:
        raise InputError("Give either `noise` or, for noise that is to be estimated, a `prior`; not both.")
    criterion = criterion or "trace"
    estimated = noise is None
    if shared is not None:
        shared = tuple(error for error in checked_errors(shared, data) if not error.is_exact)
        if own := [error.name for error in shared if error.name not in OF_ANY_POSES]:
            raise InputError(f"Expected `shared` without {own[0]!r}: what it does to new poses is not known.")
    errors = tuple(error.bound(data) for error in shared or ())
    if noise is None:
        result = _calibrated(data, shared, prior)
        if result.posterior is not None:
            wanted = criterion, *_target(data, criterion, point, length)
            return _by_posterior(result, data, candidates, k, wanted, sample, seed, repeat)
        data, noise, errors = _estimated_noise(result, data, shared)
    elif isinstance(noise, PoseNoise) and not (
        isinstance(noise.robot, JointCovariance) and noise.robot.shared.shape[-1]
    ):
        noise = _of_each_pose(noise)  # of a drift
    intrinsics, seen = np.zeros((data.n, 6, 0)), data.camera_calibration
    if isinstance(noise, PoseNoise) and data.camera_covariance is not None:
        S = data.camera_covariance if noise.camera is None else noise.camera
        noise = PoseNoise(noise.robot, marginals(S), prior=noise.prior)
    if seen is not None and isinstance(noise, PoseNoise):
        if noise.camera is None:
            noise = PoseNoise(noise.robot, seen.covariance, prior=noise.prior)
        noise, intrinsics = _without_intrinsics(noise, intrinsics)
    target, distance = _target(data, criterion, point, length)
    constraint = constraint_of(data, noise)
    if not isinstance(constraint, OnPoses):
        raise InputError("Expected PoseNoise: planning needs the noise of poses.")
    of_new = _noise_of_new(noise)

    at, information, open_directions = so_far(data, noise)
    if intrinsics.shape[-1] and not len(open_directions):  # X is far better known by what the poses share
        assert noise.camera is not None
        camera_noise = JointCovariance(np.broadcast_to(noise.camera, (data.n, 6, 6)), intrinsics)
        at = efficient(data, PoseNoise(noise.robot, camera_noise, prior=noise.prior)).unknowns
        before = constraint.linearise(at, constraint.first, constraint.second)
        information = gram(whiten(cholesky_of(residual_covariance(before.sides, noise)), before.J))
        if noise.prior is not None:
            information = information + noise.prior.normal_equations(at.X, at.W)[0]
    assert at.W is not None
    robot = _candidates(candidates, data, at.X, at.W, sample, seed)
    require_choice(len(robot), k, repeat)
    camera = predicted_camera(robot, at.X, at.W, data.setup)
    if errors or intrinsics.shape[-1]:
        before = constraint.linearise(at, constraint.first, constraint.second)
        F = _white_columns(before, noise, errors, data, intrinsics)
        J = whiten(cholesky_of(residual_covariance(before.sides, noise)), before.J)
        across = np.einsum("nri,nrj->ij", J, F)
        information = np.block([[information, across], [across.T, np.eye(F.shape[-1]) + gram(F)]])
    linear = OnPoses(robot, camera, constraint.inverted).linearise(at, robot, camera)
    rows = whiten(cholesky_of(residual_covariance(linear.sides, of_new)), linear.J)
    if errors or intrinsics.shape[-1]:
        new = PosePairs(robot, camera, data.setup)
        ahead = np.zeros((len(robot), 6, 0)) if seen is None else seen.shared_ahead(camera, intrinsics)
        rows = np.concatenate([rows, _white_columns(linear, of_new, errors, new, ahead)], axis=-1)

    Q = None if criterion == "logdet" else weight_of_X(at.X, target, distance)
    chosen, covariances, values = select(information, rows, k, Q, repeat)
    return Plan(
        chosen=chosen,
        robot=robot[chosen],
        camera=camera[chosen],
        covariance_before=covariances[0],
        covariances=covariances[1:],
        criterion=criterion,
        criterion_before=float(values[0]),
        criterion_values=values[1:],
        length=distance,
        point=target,
        X=at.X,
        W=at.W,
        setup=data.setup,
        n_poses=data.n,
        n_candidates=len(robot),
        sampled=candidates is None,
        noise=of_new,
        noise_estimated=estimated,
        open_directions=open_directions,
        shared=tuple(error.name for error in errors),
        form=_form_of(data),
    )


def _form_of(data: PosePairs) -> str | None:
    """Return the format in which the robot poses were read, if poses can be written in it."""
    format = data.sources[0].format if data.sources else ""
    return format if format in FORMS else None


def _target(
    data: PosePairs, criterion: str, point: Any, length: str | float | None
) -> tuple[Array | None, float | None]:
    """Point and length of the criterion, checked."""
    if criterion not in (*CRITERIA, PREDICTION):
        raise InputError(f"Expected `criterion` to be one of {', '.join((*CRITERIA, PREDICTION))}, got {criterion!r}.")
    if (point is not None) != (criterion == "point"):
        raise InputError(
            "Criterion 'point' and a point (x, y, z in camera coordinates) go together, "
            f"got criterion {criterion!r} and point {point!r}."
        )
    if length is not None and criterion != "trace":
        raise InputError(f"A length is part of criterion 'trace' only, got criterion {criterion!r}.")
    if criterion == "point":
        if isinstance(point, str) or np.shape(point) != (3,):
            raise InputError(f"Expected `point` to be x, y, z in camera coordinates, got {point!r}.")
        return np.array([parse_length(x, "`point`") for x in point]), None
    if criterion in ("logdet", PREDICTION):
        return None, None
    if length is None:
        return None, float(np.sqrt(np.mean(np.sum(data.camera[:, :3, 3] ** 2, axis=-1))))
    distance = parse_length(length, "`length`")
    if distance <= 0:
        raise InputError(f"Expected `length` to be above 0, got {length!r}.")
    return None, distance


def _white_columns(
    linear: Linearised, noise: PoseNoise, errors: tuple[SharedError, ...], poses: PosePairs, intrinsics: Array
) -> Array:
    """(n, 6, q) what one standard deviation of each shared error does to the whitened residuals of these poses.

    ``intrinsics`` (n, 6, k): what those of the camera do to its poses.
    """
    f = [linear.sides[1] @ intrinsics]
    for error in errors:
        if error.name == CLOCK_OFFSET and poses.timestamps is None:  # the robot stands still
            f.append(np.zeros((poses.n, 6, 1)))
        else:
            f.append(linear.sides[SIDES.index(error.side)] @ (error.at(poses) * error.sd))
    return whiten(cholesky_of(residual_covariance(linear.sides, noise)), np.concatenate(f, axis=-1))


def _calibrated(data: PosePairs, shared: Sequence[SharedError] | None, prior: NoisePrior | None) -> Calibration:
    """The calibration of the poses so far, which warns of those left out; raises `InputError` where there is none."""
    try:
        return calibrate(data, shared=shared, prior=prior)
    except (DegenerateMotionError, NotConvergedError) as error:
        raise InputError(
            f"The noise cannot be estimated from the poses so far, which may leave a part of X open. {GIVE}"
        ) from error


def _by_posterior(
    result: Calibration,
    data: PosePairs,
    candidates: Any,
    k: int,
    of: tuple[str, Array | None, float | None],
    sample: int,
    seed: int | np.random.Generator,
    repeat: bool,
) -> Plan:
    """The plan by what the calibration knows (`by_posterior`)."""
    assert result.W is not None
    criterion, target, distance = of
    kept = data if result.table is None else data.rows(np.flatnonzero(result.table.weight > 0))
    robot = _candidates(candidates, kept, result.X, result.W, sample, seed)
    require_choice(len(robot), k, repeat)
    ahead = camera_ahead(result, robot=robot)
    Q = None if criterion == "logdet" else weight_of_X(result.X, target, distance)
    chosen, covariances, values = chosen_by(result, ahead, k, Q, repeat)
    return Plan(
        chosen=chosen,
        robot=robot[chosen],
        camera=camera_at(result, robot)[chosen],
        covariance_before=covariances[0],
        covariances=covariances[1:],
        criterion=criterion,
        criterion_before=float(values[0]),
        criterion_values=values[1:],
        length=distance,
        point=target,
        X=result.X,
        W=result.W,
        setup=data.setup,
        n_poses=kept.n,
        n_candidates=len(robot),
        sampled=candidates is None,
        noise=noise_of_new(result),
        noise_estimated=True,
        open_directions=np.zeros((0, 6)),
        shared=tuple(dict.fromkeys(error.error for error in result.shared)),
        form=_form_of(data),
    )


def _candidates(given: Any, data: PosePairs, X: Array, W: Array, sample: int, seed: int | np.random.Generator) -> Array:
    """(m, 4, 4) robot poses to choose from, given or drawn."""
    if given is None:
        return sample_candidates(data, X, W, sample, seed=seed)
    robot = np.asarray(as_transforms(given, "candidates"))
    if robot.ndim != 3 or len(robot) == 0:
        raise InputError(f"Expected `candidates` to have shape (m, 4, 4) with m >= 1, got {robot.shape}.")
    return robot


def _estimated_noise(
    result: Calibration, data: PosePairs, shared: Sequence[SharedError] | None
) -> tuple[PosePairs, PoseNoise, tuple[SharedError, ...]]:
    """Noise and shared errors of a calibration that leaves a part open, and the poses that it keeps."""
    every, noise, kept = data, result.noise, np.arange(data.n)
    if result.table is not None and result.table.rejected:
        kept = np.flatnonzero(result.table.weight > 0)
        data = data.rows(kept)
    if not isinstance(noise, PoseNoise):
        raise InputError(f"The noise cannot be estimated from poses that fit exactly. {GIVE}")
    listed = replace_defaults((), every.camera_known) if shared is None else shared
    errors = settled_errors(listed, {found.name: found.prior_sd for found in result.shared}, every)
    noise = without_shared(noise, (*errors, *assumed_drift(every)))  # a drift so far says nothing about new poses
    return data, _of_each_pose(noise).rows(kept), errors


def _of_each_pose(noise: PoseNoise) -> PoseNoise:
    """Return the marginals without what neighbours have in common, which says nothing about new poses."""
    sides = []
    for S in (noise.robot, noise.camera):
        if isinstance(S, JointCovariance):
            S = S if S.shared.shape[-1] else S.own
        sides.append(S)
    return PoseNoise(*sides, prior=noise.prior)


def _without_intrinsics(noise: PoseNoise, none: Array) -> tuple[PoseNoise, Array]:
    """The noise of each pose, and what errors of the intrinsics do to the camera poses so far (n, 6, q)."""
    if not isinstance(noise.camera, JointCovariance):
        return noise, none
    return PoseNoise(noise.robot, noise.camera.own, prior=noise.prior), noise.camera.shared


def _noise_of_new(noise: PoseNoise) -> PoseNoise:
    """6x6: the noise of each new pose, the mean of those so far."""
    for name, covariance in (("robot", noise.robot), ("camera", noise.camera)):
        if covariance is not None and is_joint(covariance):
            raise InputError(
                f"Expected the covariance `{name}` to be (6, 6) or (n, 6, 6), got the joint one of all poses so far, "
                "which does not say how new poses share their errors. For a plan as if they did not, give its 6x6 "
                "blocks, uq_handeye.noise.models.marginals(...)."
            )
    robot, camera = (None if S is None else S.reshape(-1, 6, 6).mean(axis=0) for S in (noise.robot, noise.camera))
    return PoseNoise(robot, camera)
