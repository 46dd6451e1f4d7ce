"""Plans of joints for an arm whose kinematics are known: candidates inside its limits, predictions at task postures.

For an arm with kinematic errors, X, W and the errors e of the arm are joint unknowns, and the criterion ``prediction``
does not depend on the choice of base and flange (K2): it is the error with which a point seen at one posture is
predicted at another. Camera poses are drawn as in `candidates`, without a box, and the arm is brought there by inverse
kinematics (`postures`), half of the draws from near the joints so far, half from postures anywhere inside the
limits: these take other branches of the elbow and the wrist. Of the equivalent angles of a joint the one nearest to the
joints so far is taken, and a posture counts only if every joint is within half a turn of one of them: cables would not
follow it. With a floor, no joint, flange or camera is below it. Other obstacles are unknown, and collisions of the arm
with itself are not checked.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.calibrate import calibrate
from ...calibration.estimated import Estimated
from ...calibration.prediction.predict import CameraAhead, camera_ahead
from ...calibration.result import Calibration
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...model.kinematics.by_poses import joints_by_poses
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.joint import PRISMATIC
from ...model.kinematics.newton import postures_at
from ...model.poses.pose_pairs import PosePairs
from .by_posterior import PREDICTION, Known, PlanRequest, planned
from .candidates import draw_camera_poses, drawn, require_number, robot_of
from .result import Plan


def plan_by_joints(data: PosePairs, chain: Kinematics, asked: PlanRequest) -> Plan:
    """See `plan`."""
    result, joints = _so_far(data, chain, asked)
    known = Known(result, data, asked.noise is None, contradictions=result.contradictions)
    return plan_within_reach(known, chain, joints, asked)


def plan_within_reach(known: Known, chain: Kinematics, joints: Array, asked: PlanRequest) -> Plan:
    """Return the poses to take next, inside the joint limits of the arm; ``joints`` (n, L): those so far.

    The task, where none is given, has as many postures as candidates are drawn.
    """
    result, fitted = known.result, known.result.kinematics
    assert result.W is not None
    if asked.candidates is None:
        e = None if fitted is None else fitted.e
        q = sample_joints(
            known.data, chain, joints, result.X, result.W, asked.sample, e=e, seed=asked.seed, floor=asked.floor_m
        )
    else:
        q = _inside(chain, asked.candidates, "candidates")
    more: dict[str, Any] = {"joint_names": chain.names, "joint_units": tuple(joint.unit for joint in chain.joints)}
    more["joint_noise"] = 0.0 if fitted is None else fitted.joint_noise
    task = None
    if asked.criterion == PREDICTION:
        given = asked.task is not None
        at = chain.spread(asked.sample) if asked.task is None else _inside(chain, asked.task, "task")
        task, more = _ahead(result, chain, at), more | {"task": at, "task_given": given}
    return planned(known, _ahead(result, chain, q), asked, task, joints=q, **more)


def sample_joints(
    data: PosePairs,
    chain: Kinematics,
    joints: Array,
    X: Array,
    W: Array,
    n: int,
    *,
    seed: int | np.random.Generator,
    e: Array | None = None,
    near: tuple[float, float] = (0.5, 0.1),
    floor: float | None = None,
) -> Array:
    """Up to ``n`` joints (m, L) inside the limits from which the camera sees the target; see the module.

    Half of the draws start from joints so far, moved by normal numbers with the standard deviations ``near`` (rad, m).
    ``floor``: height in the base (m) above which the arm and what it carries stay.

    Raises
    ------
    InputError
        n below 1 or above 100,000, a camera pose so far at the target itself, or no draw within reach.
    """
    require_number(n)
    rng = np.random.default_rng(seed)
    sd = np.array([near[joint.kind == PRISMATIC] for joint in chain.joints])
    anywhere = chain.spread()

    def draw(size: int) -> Array:
        robot = robot_of(draw_camera_poses(data.camera, size, rng), X, W, data.setup)
        start = joints[rng.integers(len(joints), size=size)] + sd * rng.normal(size=(size, len(sd)))
        other = rng.uniform(size=size) < 0.5
        start[other] = anywhere[rng.integers(len(anywhere), size=int(other.sum()))]
        postures = postures_at(chain, robot, start, e)
        q = unwound(chain, postures.q[postures.reached], joints)
        if floor is not None:
            carried = X if data.setup == "eye-in-hand" else W
            flange = chain.poses(q)
            moving = chain.frames(q)[:, 1:, 2, 3]  # the first joint is where it is
            q = q[np.column_stack([moving, flange[:, 2, 3], (flange @ carried)[:, 2, 3]]).min(axis=1) >= floor]
        return q

    above = "" if floor is None else ", above the floor"
    why = (
        f"poses that look at the target is within reach and joint limits{above}. Are X, the joints and the URDF right? "
        "If so, "
        "give candidates of your own."
    )
    return drawn(draw, n, why, draws=20, ahead=3, at_once=2_000)


def _so_far(data: PosePairs, chain: Kinematics, asked: PlanRequest) -> tuple[Calibration, Array]:
    """X, W and the errors of the arm from the poses so far, and their joints."""
    advice = "Take more poses, with rotations about other axes, or plan them without joints."
    try:
        result = calibrate(
            data, kinematics=chain, noise=asked.noise, prior=asked.prior, shared=asked.shared, joints=asked.joints,
            kinematic_errors=asked.kinematic_errors,
        )  # fmt: skip
    except (DegenerateMotionError, NotConvergedError) as error:
        raise InputError(f"The poses so far do not determine X and the errors of the arm. {advice}") from error
    if result.posterior is None or result.W is None:
        raise InputError(f"The poses so far leave a part of X open, or fit exactly. {advice}")
    if result.kinematics is not None:
        return result, result.kinematics.joints
    given = data.joints if asked.joints is None else asked.joints
    return result, joints_by_poses(chain, data.robot) if given is None else as_numbers(given, "joints")


def _ahead(result: Estimated, chain: Kinematics, q: Array) -> CameraAhead:
    """Camera poses at joints (m, L); of an arm that is exact, by its model."""
    if result.kinematics is None:
        return camera_ahead(result, robot=chain.poses(q))
    return camera_ahead(result, q)


def _inside(chain: Kinematics, values: ArrayLike, name: str) -> Array:
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


def unwound(chain: Kinematics, q: Array, joints: Array) -> Array:
    """Return postures (k, L) with the angles nearest to the joints so far; those that stay beyond half a turn go.

    ``q`` (m, L) inside the limits. Angles that differ by whole turns are the same posture, where the limits allow both.
    """
    low, high = chain.limits.T
    middle = 0.5 * (joints.min(axis=0) + joints.max(axis=0))
    turns = np.where(chain.revolute, np.round((q - middle) / (2.0 * np.pi)), 0.0)
    nearest = q - 2.0 * np.pi * turns
    q = np.where((nearest >= low) & (nearest <= high), nearest, q)
    away = np.maximum(q - joints.max(axis=0), joints.min(axis=0) - q)
    return np.asarray(q[(~chain.revolute | (away <= np.pi)).all(axis=1)])
