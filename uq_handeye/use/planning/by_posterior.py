r"""Choosing poses by the posterior of a calibration: its covariance so far is the one that the calibration states.

A pose at which the camera pose will be measured with the derivatives A by all errors s of the posterior, and with its
own noise ``L L^T`` (what is drawn again, and what of the arm is unknown again there), adds the information ``B^T B``,
``B = L^-1 A`` (`posterior.selection`). More poses do not average what all of them share: it is among s.

Criterion ``prediction`` is the mean squared error (m^2) of where the camera is from the target at the task postures,

    tr(Q Sigma),    Q = mean over the task of  A_t(q)^T A_t(q),    A_t the rows of the translation,

without what the camera itself misreads there: from most postures of a workspace it does not see the target, and a lens
says nothing of views that its pictures do not hold.

*In joints*, of an arm whose kinematics are wrong, X, W and the errors e of the arm are unknowns together, and the
criterion ``prediction`` is free of the choice of base and flange (K2): it is the error with which something seen now is
found elsewhere. Candidates are joints inside the limits. Camera poses are drawn as in `candidates`, without a box, and
the arm is brought there by inverse kinematics (`arms.postures`), half of the draws from near the joints so far, half
from postures anywhere inside the limits: these take other branches of the elbow and the wrist. Obstacles are unknown,
and so is the arm itself in its way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...calibration.calibrate import calibrate
from ...calibration.estimate.estimated import Estimated
from ...calibration.job import joints_by_poses
from ...calibration.prediction.predict import CameraAhead, camera_ahead, camera_at, own_noise
from ...calibration.result import Calibration
from ...core.formatting.units import parse_length
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError, InputError, NotConvergedError, require_integer, require_one_of
from ...model.kinematics.arms.newton import postures_at
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.joint import PRISMATIC
from ...model.kinematics.kinematic_errors import KinematicErrors
from ...model.noise.estimate import NoisePrior
from ...model.noise.models import PoseNoise
from ...model.noise.square_roots import cholesky_of, whiten
from ...model.poses.pose_pairs import PosePairs
from ...model.posterior.owners import ROBOT
from ...model.posterior.selection import weight_of_X
from ...model.shared_errors.shared_error import SharedError
from .candidates import draw_camera_poses, drawn, require_choice, require_number, robot_of
from .result import FORMS, Plan

PREDICTION = "prediction"
# Length of the mean direction of the target below which it was seen from all around, and nothing is out of view.
MIXED = 0.5


CRITERIA = ("trace", "logdet", "point")


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """The arguments of `plan` beside the poses; see there. Raises `InputError` for those that fit no poses."""

    candidates: Any = None
    k: int = 5
    noise: PoseNoise | None = None
    criterion: str | None = None
    point: Any = None
    length: str | float | None = None
    sample: int = 200
    seed: int | np.random.Generator = 0
    repeat: bool = False
    shared: Sequence[SharedError] | None = None
    joints: ArrayLike | None = None
    kinematics: Kinematics | None = None
    kinematic_errors: KinematicErrors | None = None
    task: ArrayLike | None = None
    prior: NoisePrior | None = None

    def __post_init__(self) -> None:
        require_integer("k", self.k, 1)
        if self.kinematics is None:
            if self.criterion == PREDICTION or any(
                given is not None for given in (self.joints, self.kinematic_errors, self.task)
            ):
                raise InputError(
                    "Expected `kinematics` (Kinematics.from_urdf) beside joints, kinematic errors, task and criterion "
                    f"{PREDICTION!r}."
                )
            if self.noise is not None and self.prior is not None:
                raise InputError("Give either `noise` or, for noise that is to be estimated, a `prior`; not both.")
        criterion, point, length = self.criterion or ("trace" if self.kinematics is None else PREDICTION), None, None
        require_one_of("criterion", criterion, (*CRITERIA, PREDICTION))
        if (self.point is not None) != (criterion == "point"):
            raise InputError(
                "Criterion 'point' and a point (x, y, z in camera coordinates) go together, "
                f"got criterion {criterion!r} and point {self.point!r}."
            )
        if self.length is not None:
            if criterion != "trace":
                raise InputError(f"A length is part of criterion 'trace' only, got criterion {criterion!r}.")
            if (length := parse_length(self.length, "`length`")) <= 0:
                raise InputError(f"Expected `length` to be above 0, got {self.length!r}.")
        if self.point is not None:
            if np.shape(self.point) != (3,):
                raise InputError(f"Expected `point` to be x, y, z in camera coordinates, got {self.point!r}.")
            point = np.array([parse_length(x, "`point`") for x in self.point])
        for name, value in (("criterion", criterion), ("point", point), ("length", length)):
            object.__setattr__(self, name, value)

    def of(self, data: PosePairs) -> PlanRequest:
        """Return the request with what follows from the poses: the length is the RMS distance of the target."""
        if self.criterion != "trace" or self.length is not None:
            return self
        return replace(self, length=float(np.sqrt(np.mean(np.sum(data.camera[:, :3, 3] ** 2, axis=-1)))))


class Known(NamedTuple):
    """A calibration of the poses so far with its posterior, and the poses that it kept."""

    result: Estimated
    data: PosePairs
    noise_estimated: bool
    open_directions: Array = np.zeros((0, 6))


def planned(known: Known, ahead: CameraAhead, asked: PlanRequest, at: CameraAhead | None = None, **more: Any) -> Plan:
    """Return those of the poses ahead that make the criterion small.

    ``at``: where predictions are to be good, of criterion prediction; ``more``: fields of the plan about joints.
    """
    result, data = known.result, known.data
    sampled, repeat, k = asked.candidates is None, asked.repeat, asked.k
    assert result.posterior is not None and result.W is not None
    require_choice(len(ahead.robot), k, repeat)
    camera = camera_at(result, ahead.robot)
    in_view = np.arange(len(camera)) if sampled or len(known.open_directions) else _in_view(data, camera)
    if len(in_view) < (1 if repeat else k):
        raise InputError(
            f"Expected candidates from which the camera sees the target, got {len(in_view)} of {len(camera)}: at the "
            "others the target is behind the camera, or far aside. Are they poses base_T_gripper of this rig?"
        )
    Q, length = None, cast("float | None", asked.length)
    if at is not None:
        A = np.array(at.columns[:, 3:])
        owned = 12 + result.posterior.owned_by([ROBOT])
        A[..., np.setdiff1d(np.arange(12, A.shape[-1]), owned)] = 0.0
        Q = np.einsum("tri,trj->ij", A, A) / len(A)
    elif asked.criterion != "logdet":
        Q = weight_of_X(result.X, asked.point, length)
    rows = whiten(cholesky_of(ahead.noise + ahead.unseen), ahead.columns)
    picked, covariances, values = result.posterior.choose(rows[in_view], k, Q, repeat=repeat)
    chosen = in_view[picked]
    form = data.sources[0].format if data.sources and "joints" not in more else ""
    return Plan(
        chosen=chosen,
        robot=ahead.robot[chosen],
        camera=camera[chosen],
        covariance_before=covariances[0],
        covariances=covariances[1:],
        criterion=str(asked.criterion),
        criterion_before=float(values[0]),
        criterion_values=values[1:],
        length=length,
        point=asked.point,
        X=result.X,
        W=result.W,
        setup=data.setup,
        n_poses=data.n,
        n_candidates=len(ahead.robot),
        sampled=sampled,
        noise=PoseNoise(own_noise(result, "robot"), own_noise(result, "camera")),
        noise_estimated=known.noise_estimated,
        open_directions=known.open_directions,
        shared=tuple(dict.fromkeys(error.error for error in result.shared)),
        form=form if form in FORMS else None,
        **{name: value[chosen] if name == "joints" else value for name, value in more.items()},
    )


def _in_view(data: PosePairs, camera: Array) -> NDArray[np.intp]:
    """Numbers of the poses (m, 4, 4) at which the target is within 90 degrees of where it was seen on average."""
    seen, ahead = (T[:, :3, 3] / np.maximum(np.linalg.norm(T[:, :3, 3], axis=-1, keepdims=True), 1e-12)
                   for T in (data.camera, camera))  # fmt: skip
    mean = seen.mean(axis=0)
    return np.flatnonzero(ahead @ mean > 0) if np.linalg.norm(mean) > MIXED else np.arange(len(camera))


# Postures of the task where none are given.
TASK = 200
# Candidates start from joints so far, moved by this (rad, m); and are drawn so many times as often as asked for.
NEAR = {PRISMATIC: 0.1}
NEAR_TURN = 0.5
DRAWS = 20
DRAWN_AT_ONCE = 2_000


def plan_by_joints(data: PosePairs, chain: Kinematics, asked: PlanRequest) -> Plan:
    """See `plan`."""
    result, joints = _so_far(data, chain, asked)
    return plan_within_reach(Known(result, data, asked.noise is None), chain, joints, asked)


def plan_within_reach(known: Known, chain: Kinematics, joints: Array, asked: PlanRequest) -> Plan:
    """Return the poses to take next, inside the joint limits of the arm; ``joints`` (n, L): those so far."""
    result, fitted = known.result, known.result.kinematics
    assert result.W is not None
    if asked.candidates is None:
        e = None if fitted is None else fitted.e
        q = sample_joints(known.data, chain, joints, result.X, result.W, asked.sample, e=e, seed=asked.seed)
    else:
        q = _inside(chain, asked.candidates, "candidates")
    more: dict[str, Any] = {"joint_names": chain.names, "joint_units": tuple(joint.unit for joint in chain.joints)}
    more["joint_noise"] = 0.0 if fitted is None else fitted.joint_noise
    task = None
    if asked.criterion == PREDICTION:
        given = asked.task is not None
        at = _inside(chain, asked.task, "task") if given else chain.spread(TASK)
        task, more = _ahead(result, chain, at), more | {"task": at, "task_given": given}
    return planned(known, _ahead(result, chain, q), asked, task, joints=q, **more)


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
    anywhere = chain.spread()

    def draw(size: int) -> Array:
        robot = robot_of(draw_camera_poses(data.camera, size, rng), X, W, data.setup)
        start = joints[rng.integers(len(joints), size=size)] + near * rng.normal(size=(size, len(near)))
        other = rng.uniform(size=size) < 0.5
        start[other] = anywhere[rng.integers(len(anywhere), size=int(other.sum()))]
        postures = postures_at(chain, robot, start, e)
        return _unwound(chain, postures.q[postures.reached], joints)

    why = (
        "poses that look at the target is within reach and joint limits. Are X, the joints and the URDF right? If so, "
        "give candidates of your own."
    )
    return drawn(draw, n, DRAWS, 3, DRAWN_AT_ONCE, why)


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
    return result, joints_by_poses(chain, data) if given is None else as_numbers(given, "joints")


def _ahead(result: Estimated, chain: Kinematics, q: Array) -> CameraAhead:
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
    endless = chain.revolute & ~np.isfinite(chain.limits).any(axis=1)
    middle = 0.5 * (joints.min(axis=0) + joints.max(axis=0))
    return np.where(endless, middle + (q - middle + np.pi) % (2 * np.pi) - np.pi, q)
