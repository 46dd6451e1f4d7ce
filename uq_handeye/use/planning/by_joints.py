r"""Planning in joints: the next poses of an arm whose kinematics are wrong.

X, W and the errors e of the arm are unknowns together, and poses are chosen by their joint posterior (`by_posterior`).
The criterion ``prediction`` is free of the choice of base and flange (K2): it is the error with which something seen
now is found elsewhere.

*Candidates* are joints inside the limits. Camera poses are drawn as in `candidates`, without a box, and the arm is
brought there by inverse kinematics (`arms.postures`), half of the draws from near the joints so far, half from
postures anywhere inside the limits: these take other branches of the elbow and the wrist. Obstacles are unknown, and so
is the arm itself in its way.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...calibration.calibrate import calibrate
from ...calibration.estimate.fitted_kinematics import FittedKinematics
from ...calibration.job import joints_by_poses
from ...calibration.prediction.predict import CameraAhead, camera_ahead
from ...calibration.result import Calibration
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...model.kinematics.arms.postures import postures_at
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.forward import spread_postures
from ...model.kinematics.joint import PRISMATIC
from ...model.poses.pose_pairs import PosePairs
from .by_posterior import PREDICTION, Known, Offered, Wanted, joint_fields, planned
from .candidates import draw_camera_poses, require_number, robot_of
from .result import Plan

# Postures of the task where none are given.
TASK = 200
# Candidates start from joints so far, moved by this (rad, m); and are drawn so many times as often as asked for.
NEAR = {PRISMATIC: 0.1}
NEAR_TURN = 0.5
DRAWS = 20
DRAWN_AT_ONCE = 2_000


def plan_by_joints(
    data: PosePairs, chain: Kinematics, options: dict[str, Any], offered: Offered, k: int, of: Wanted, task: Any
) -> Plan:
    """See `plan`; ``options`` are those of `calibrate`."""
    result, joints = _so_far(data, chain, options)
    assert result.W is not None
    fitted = result.kinematics
    if offered.candidates is None:
        e = None if fitted is None else fitted.e
        q = sample_joints(data, chain, joints, result.X, result.W, offered.sample, e=e, seed=offered.seed)
    else:
        q = _inside(chain, offered.candidates, "candidates")
    more = joint_fields(chain, 0.0 if fitted is None else fitted.joint_noise)
    if of.criterion == PREDICTION:
        revolute = _revolute(chain)
        at_task = spread_postures(chain.limits, revolute, TASK) if task is None else _inside(chain, task, "task")
        of = of._replace(task=_ahead(result, chain, at_task))
        more["task"] = at_task
    known = Known(result, data, options["noise"] is None)
    return planned(known, _ahead(result, chain, q), k, of, offered, joints=q, task_given=task is not None, **more)


def plan_within_reach(known: Known, arm: FittedKinematics, of: Wanted, offered: Offered) -> Plan:
    """Return the one pose to take next, inside the joint limits of the arm of a calibration."""
    result, chain = known.result, arm.chain
    assert isinstance(result, Calibration) and result.W is not None
    q = sample_joints(known.data, chain, arm.joints, result.X, result.W, offered.sample, e=arm.e, seed=offered.seed)
    fields = joint_fields(chain, arm.joint_noise)
    return planned(known, _ahead(result, chain, q), 1, of, offered, joints=q, **fields)


def sample_joints(
    data: PosePairs,
    chain: Kinematics,
    joints: Array,
    X: Array,
    W: Array,
    n: int = 200,
    *,
    e: Array | None = None,
    seed: int | np.random.Generator = 0,
) -> Array:
    """Up to ``n`` joints (m, L) inside the limits from which the camera sees the target; see the module.

    Raises
    ------
    InputError
        n below 1 or above 100,000, a camera pose so far at the target itself, or no draw within reach.
    """
    require_number(n)
    rng = np.random.default_rng(seed)
    near = np.array([NEAR.get(joint.kind, NEAR_TURN) for joint in chain.joints])
    anywhere = spread_postures(chain.limits, _revolute(chain))
    found: list[Array] = []
    missing, left = n, DRAWS * n
    while missing and left:
        size = min(left, max(3 * missing, 64), DRAWN_AT_ONCE)
        robot = robot_of(draw_camera_poses(data.camera, size, rng), X, W, data.setup)
        start = joints[rng.integers(len(joints), size=size)] + near * rng.normal(size=(size, len(near)))
        other = rng.uniform(size=size) < 0.5
        start[other] = anywhere[rng.integers(len(anywhere), size=int(other.sum()))]
        postures = postures_at(chain, robot, start, e)
        found.append(_unwound(chain, postures.q[postures.reached], joints)[:missing])
        missing -= len(found[-1])
        left -= size
    if missing == n:
        raise InputError(
            f"None of {DRAWS * n} poses that look at the target is within reach and joint limits. Are X, the joints "
            "and the URDF right? If so, give candidates of your own."
        )
    return np.concatenate(found)


def _so_far(data: PosePairs, chain: Kinematics, options: dict[str, Any]) -> tuple[Calibration, Array]:
    """X, W and the errors of the arm from the poses so far, and their joints."""
    advice = "Take more poses, with rotations about other axes, or plan them without joints."
    try:
        result = calibrate(data, kinematics=chain, **options)
    except (DegenerateMotionError, NotConvergedError) as error:
        raise InputError(f"The poses so far do not determine X and the errors of the arm. {advice}") from error
    if result.posterior is None or result.W is None:
        raise InputError(f"The poses so far leave a part of X open, or fit exactly. {advice}")
    if result.kinematics is not None:
        return result, result.kinematics.joints
    given = data.joints if options["joints"] is None else options["joints"]
    return result, joints_by_poses(chain, data) if given is None else as_numbers(given, "joints")


def _ahead(result: Calibration, chain: Kinematics, q: Array) -> CameraAhead:
    """Camera poses at joints (m, L); of an arm that is exact, by its model."""
    if result.kinematics is None:
        return camera_ahead(result, robot=chain.poses(q))
    return camera_ahead(result, q)


def _inside(chain: Kinematics, values: Any, name: str) -> Array:
    """Joints (m, L), m >= 1, inside the limits; raises `InputError`."""
    q = as_numbers(values, name)
    if q.ndim != 2 or len(q) == 0 or q.shape[1] != chain.n_joints or not np.isfinite(q).all():
        raise InputError(
            f"Expected `{name}` to be finite joints (m, {chain.n_joints}) of {', '.join(chain.names)}, got shape "
            f"{q.shape}."
        )
    outside = (q < chain.limits[:, 0]) | (q > chain.limits[:, 1])
    if outside.any():
        row, joint = (int(index) for index in np.argwhere(outside)[0])
        low, high = chain.limits[joint]
        raise InputError(
            f"Expected `{name}` inside the joint limits, got {q[row, joint]:.4g} of {chain.names[joint]} in row {row} "
            f"(limits {low:.4g} to {high:.4g} {chain.joints[joint].unit}); are they in degrees?"
        )
    return q


def _unwound(chain: Kinematics, q: Array, joints: Array) -> Array:
    """The same postures with joints that rotate without limits within half a turn of where they have been."""
    endless = _revolute(chain) & ~np.isfinite(chain.limits).any(axis=1)
    middle = 0.5 * (joints.min(axis=0) + joints.max(axis=0))
    return np.where(endless, middle + (q - middle + np.pi) % (2 * np.pi) - np.pi, q)


def _revolute(chain: Kinematics) -> Any:
    return np.array([joint.is_revolute for joint in chain.joints])
