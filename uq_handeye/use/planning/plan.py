r"""Choice of the poses to measure next, and the covariance of X that they would give.

Model: the calibration of the poses so far has a joint posterior of X, W and all errors that poses share, and a pose yet
to be taken adds information about all of them that depends on where it is only (`by_posterior`): for a robot pose G the
camera will see ``C = inv(X) inv(G) W`` (G inverted for eye-to-hand). To first order the covariance after the poses c is
therefore known beforehand,

    Sigma(c) = ( P^-1 + sum_(j in c) B_j^T B_j )^-1

P is what `calibrate` states of the same poses. Errors that all poses share, those of the camera's intrinsics among
them, are not averaged out by more poses.

The block of X is what the plan shows: errors ``(theta, tau)``, rad and m, parent frame of X. Three criteria, each
to be made small:

- ``trace``: the mean squared error (m^2) of points at the distance ``length`` from the camera, in all directions:
  ``tr(Sigma_tau) + 2/3 length^2 tr(Sigma_theta)``. The length makes angles and lengths commensurable.
- ``point``: the mean squared error (m^2) of one point p in camera coordinates, expressed in the parent frame of X:
  ``tr(M Sigma M^T)``, ``M = [-[R_X p]x, I]``.
- ``logdet``: ``log det Sigma``, the volume of the ellipsoid, whatever the units.

Poses are chosen greedily, then exchanged one by one as long as that helps, and put into the order in which each brings
most (`selection`). That is no proof of the best set; docs/how-to/plan.md has the gap.

Planning also starts from poses that do not determine a part of X (parallel axes, pure translations): a weak prior takes
the place of the missing information (`weak_prior`), and `Plan.open_directions` has these directions.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import singledispatch
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...calibration.calibrate import calibrate
from ...calibration.estimated import Estimated
from ...calibration.prediction.predict import camera_ahead, poses_so_far, posterior_of
from ...calibration.result import Calibration
from ...calibration.rig_result import RigCalibration
from ...core.geometry.checks import as_transforms
from ...errors import DegenerateMotionError, InputError, NotConvergedError, keywords_of, require_known, require_type
from ...model.errors.models import PoseNoise, is_joint
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.timing import warn_left_out
from ...model.rig.description import require_left_out
from ...model.shared_errors.shared_error import OF_ANY_POSES, checked_errors
from . import text as text  # registers the text of a plan
from .by_joints import plan_by_joints, plan_within_reach
from .by_posterior import Known, PlanRequest, planned
from .candidates import sample_candidates
from .next_views import plan_rig
from .result import Plan
from .weak_prior import OPEN_SD, WeaklyKnown

# Arguments that a result has answered.
OF_POSES = ("noise", "shared", "joints", "kinematics", "kinematic_errors", "prior")
GIVE = "Give `noise` (--robot-noise and --camera-noise, or --noise)."


def plan(
    data: PosePairs | Calibration | RigCalibration,
    candidates: ArrayLike | Mapping[str, ArrayLike] | None = None,
    k: int = 5,
    **asked: Any,
) -> Plan:
    """The next k poses that most reduce the uncertainty of X, and the covariance of X predicted after each.

    Parameters
    ----------
    data : PosePairs
        The poses so far, at least 3, without batch axes. They need not determine X yet. Or a result, whose posterior is
        planned from: of one camera, also one of a rig (`of_camera`); or of a rig, of which the views to take next are
        planned, and by which camera (`uq_handeye.use.planning.next_views`).
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
        their limits (`planning.by_posterior`).
    task : (t, L) or None
        Joints (rad, m) at which predictions are to be good; None: postures spread over the joint limits.
    prior : NoisePrior or None
        As in `calibrate`, where ``noise`` is None.
    floor : float (m), str or None
        Height in the base above which the flange and what it carries stay, of an arm also its joints.
    tolerance : text, numbers or None
        Tolerance of X, such as ``"0.5mm"``: the plan says after how many poses it is met (PASS).

    Raises
    ------
    InputError
        Arguments that do not fit each other or the data; more than 100,000 candidates; joint noise (6n, 6n), which
        says nothing of new poses; no noise where it cannot be estimated.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> found = uq.plan(uq.simulate(n_poses=10, noise=noise), k=3, noise=noise)
    >>> found.robot.shape, found.covariances.shape
    ((3, 4, 4), (3, 6, 6))
    """
    require_known("plan", asked, PlanRequest)
    return planned_from(data, PlanRequest(cast("ArrayLike | None", candidates), k, **asked))


plan.__signature__ = keywords_of(plan, PlanRequest)  # type: ignore[attr-defined]


@singledispatch
def planned_from(data: object, asked: PlanRequest) -> Plan:
    """Return the plan from poses, which are calibrated first, or from a result of one camera or of several."""
    raise InputError(f"Expected `data` to be PosePairs, got {type(data).__name__}.")


@planned_from.register
def _of_poses(data: PosePairs, asked: PlanRequest) -> Plan:
    if data.robot.ndim != 3:
        raise InputError(f"Expected poses without batch axes, got shape {data.robot.shape}.")
    if data.n < 3:
        raise InputError(f"Expected at least 3 poses so far, got {data.n}.")
    warn_left_out("plan()", data)
    request = asked.of(data)
    if request.kinematics is not None:
        return plan_by_joints(data, request.kinematics, request)
    return plan_from(_so_far(data, request), request)


@planned_from.register
def _of_rig(result: RigCalibration, asked: PlanRequest) -> Plan:
    criterion = None if asked.criterion == "trace" else asked.criterion
    left_out = {name: getattr(asked, name) for name in (*OF_POSES, "point", "task")}
    require_left_out("of a rig", criterion=criterion, **left_out)
    return plan_rig(result, asked)


@planned_from.register
def _of_result(result: Calibration, asked: PlanRequest) -> Plan:
    require_left_out("of a calibration", **{name: getattr(asked, name) for name in OF_POSES})
    data = poses_so_far(result)
    if data is None:
        raise InputError("Expected a result with its poses. Calibrate again.")
    kept = np.arange(data.n)
    if result.table is not None and len(result.table.weight) == data.n:
        kept = np.flatnonzero(np.asarray(result.table.weight) > 0)
    known = Known(result, data.rows(kept), result.noise_estimate is not None, contradictions=result.contradictions)
    if result.opened is not None and result.kinematics is None and result.noise is not None:
        known = _weakly_known(known, result.noise, data, kept)
    else:
        posterior_of(result)
    return plan_from(known, asked.of_arm(result.names.arm).of(data))


def plan_from(known: Known, asked: PlanRequest) -> Plan:
    """See `plan`: from what is known already, inside the joint limits of an arm whose joints are."""
    result, arm = known.result, known.result.kinematics
    assert result.W is not None
    if arm is not None:
        return plan_within_reach(known, arm.chain, arm.joints, asked)
    if asked.candidates is None:
        robot = sample_candidates(known.data, result.X, result.W, asked.sample, seed=asked.seed, floor=asked.floor_m)
    else:
        robot = np.asarray(as_transforms(asked.candidates, "candidates"))
        if robot.ndim != 3 or len(robot) == 0:
            raise InputError(f"Expected `candidates` to have shape (m, 4, 4) with m >= 1, got {robot.shape}.")
    return planned(known, camera_ahead(result, robot=robot), asked)


def _so_far(data: PosePairs, asked: PlanRequest) -> Known:
    """The calibration of the poses so far, or X and W with a weak prior where these leave a part open."""
    noise, shared = asked.noise, asked.shared
    if noise is not None:
        _require_noise_of_poses(noise)
    if shared is not None:
        shared = checked_errors(shared, data)
        if own := [error.name for error in shared if not error.is_exact and error.key not in OF_ANY_POSES]:
            raise InputError(f"Expected `shared` without {own[0]!r}: what it does to new poses is not known.")
    result = None
    with warnings.catch_warnings(record=True) as said:  # of a part that is open the plan speaks itself
        warnings.simplefilter("always")
        try:
            result = calibrate(data, noise=noise, shared=shared, prior=asked.prior)
        except (DegenerateMotionError, NotConvergedError) as error:
            if noise is None:
                raise InputError(
                    f"The noise cannot be estimated from the poses so far, which may leave a part of X open. {GIVE}"
                ) from error
    kept = np.arange(data.n)
    if result is not None and result.table is not None:
        kept = np.flatnonzero(np.asarray(result.table.weight) > 0)
    contradictions = () if result is None else result.contradictions
    known = Known(cast("Estimated", result), data.rows(kept), noise is None, contradictions=contradictions)
    if result is not None and _is_determined(result):
        for one in said if noise is None else ():
            warnings.warn(one.message, stacklevel=3)
        return known
    of_each = _of_each_pose(noise, data) if result is None or noise is not None else result.noise
    if of_each is None:
        raise InputError(f"The noise cannot be estimated from poses that fit exactly. {GIVE}")
    return _weakly_known(known, of_each, data, kept)


def _weakly_known(known: Known, noise: Any, data: PosePairs, kept: NDArray[np.intp]) -> Known:
    """Return the kept poses with a weak prior where these leave a part of X open; ``noise``: of all ``data``."""
    found: Any = WeaklyKnown.of(data.rows(kept), _of_each_pose(noise, data).rows(kept))
    return known._replace(result=found, data=found.data, open_directions=found.open_directions)


def _is_determined(result: Calibration) -> bool:
    """Return whether no direction of X is less certain than `OPEN_SD`."""
    if result.posterior is None or result.opened is not None:
        return False
    return bool(np.linalg.eigvalsh(result.posterior.covariance[:6, :6])[-1] <= OPEN_SD**2)


def _of_each_pose(noise: Any, data: PosePairs) -> PoseNoise:
    """Return the noise of each pose without what poses share, which a weak prior hides."""
    seen, known = data.camera_calibration, data.camera_covariance
    camera = noise.camera
    if camera is None and (seen is not None or known is not None):
        camera = known if seen is None else seen.covariance
    robot, camera = (getattr(S, "own", S) for S in (noise.robot, camera))
    return PoseNoise(robot, camera, prior=noise.prior)


def _require_noise_of_poses(noise: PoseNoise) -> None:
    """Raise `InputError` for noise that says nothing of new poses."""
    require_type("noise", noise, PoseNoise, "PoseNoise, the noise of poses")
    for name, covariance in (("robot", noise.robot), ("camera", noise.camera)):
        if covariance is not None and is_joint(getattr(covariance, "own", covariance)):
            raise InputError(
                f"Expected the covariance `{name}` to be (6, 6) or (n, 6, 6), got the joint one of all poses so far, "
                "which does not say how new poses share their errors. For a plan as if they did not, give its 6x6 "
                "blocks, uq_handeye.model.noise.models.marginals(...)."
            )
