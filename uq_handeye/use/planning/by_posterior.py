"""Choice of poses by the posterior of a calibration: a plan begins with the covariance that the calibration states.

A pose at which the camera pose will be measured with the derivatives A by all errors s of the posterior, and with its
own noise ``L L^T`` (measurement noise, and errors of the arm that are new at that pose), adds the information
``B^T B``, ``B = L^-1 A`` (`graph.selection`). More poses do not average the errors that all of them share: these
are among s.

Criterion ``prediction`` is the mean squared error (m^2) of where the camera is from the target at the task postures,

    tr(Q Sigma),    Q = mean over the task of  A_t(q)^T A_t(q),    A_t the rows of the translation,

without the errors of a camera measurement there: from most postures of a workspace the camera does not see the target,
and the calibration of a lens does not cover views outside its pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...calibration.estimated import Estimated
from ...calibration.evidence.same_things import ROBOT
from ...calibration.prediction.predict import CameraAhead, camera_at, own_noise
from ...calibration.tolerance import MET, Tolerance, ToleranceLike, probability_within
from ...core.geometry.se3 import Array
from ...core.presentation.units import parse_length
from ...core.rounding import TINY
from ...errors import InputError, require_integer, require_one_of
from ...fit.graph.reference import Reference
from ...fit.graph.selection import weight_of_X
from ...model.errors.key import ErrorKey
from ...model.errors.models import PoseNoise
from ...model.errors.sizes import Size
from ...model.errors.square_roots import cholesky_of, whiten
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.kinematic_errors import KinematicErrors
from ...model.poses.pose_pairs import PosePairs
from ...model.shared_errors.shared_error import SharedError
from .candidates import require_choice
from .result import FORMS, Plan

PREDICTION = "prediction"
# Poses after which it is said that more of them will not make X meet a tolerance.
MAX_POSES_TO_PASS = 60
CRITERIA = ("trace", "logdet", "point")


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """The arguments of `plan` in addition to the poses; see there. Raises `InputError` for those that fit no poses."""

    candidates: ArrayLike | None = None
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
    prior: Mapping[ErrorKey, Size] | None = None
    floor: str | float | None = None
    tolerance: ToleranceLike | None = None

    @property
    def floor_m(self) -> float | None:
        """Height of the floor in the base, m."""
        return None if self.floor is None else parse_length(self.floor, "`floor`")

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
        if self.tolerance is not None:
            object.__setattr__(self, "tolerance", Tolerance.read(self.tolerance))
        if self.floor_m is not None and self.candidates is not None:
            raise InputError("The floor is for candidates that are drawn: leave it out beside `candidates`.")
        for name, value in (("criterion", criterion), ("point", point), ("length", length)):
            object.__setattr__(self, name, value)

    def of_arm(self, name: str) -> PlanRequest:
        """Return the request with the candidates of one arm, where they are given by the names of arms.

        Raises `InputError` for those of another arm.
        """
        if not isinstance(self.candidates, Mapping):
            return self
        if list(self.candidates) != [name]:
            raise InputError(f"Expected `candidates` of the arm {name!r}, got of {', '.join(self.candidates)}.")
        return replace(self, candidates=self.candidates[name])

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
    contradictions: tuple[str, ...] = ()  # reasons why X of these poses cannot be used


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
    if (tolerance := cast("Tolerance | None", asked.tolerance)) is not None:
        more |= {"tolerance": tolerance, "needed": _until_met(known, rows[in_view], Q, tolerance)}
    form = data.sources[0].format if data.sources and "joints" not in more else ""
    return Plan(
        chosen=chosen,
        views=((data.names.camera, data.names.target),) * len(chosen),
        robots={data.names.arm: ahead.robot[chosen]},
        camera=camera[chosen],
        cameras=(data.names.camera,),
        of_cameras=covariances[:, None, :6, :6],
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
        shared=tuple(dict.fromkeys(str(error.key.error) for error in result.shared)),
        form=form if form in FORMS else None,
        contradictions=known.contradictions,
        **{name: value[chosen] if name == "joints" else value for name, value in more.items()},
    )


def _until_met(known: Known, rows: Array, Q: Array | None, tolerance: Tolerance) -> int | None:
    """Return how many more poses, the best first, until X meets a tolerance; None: not by `MAX_POSES_TO_PASS`."""
    result = known.result
    if len(known.open_directions) or result.posterior is None:
        return None
    _, covariances, _ = result.posterior.choose(rows, MAX_POSES_TO_PASS, Q, repeat=True)
    return first_within(covariances[:, None, :6, :6], result.reference, tolerance, [result.X])


def first_within(of_cameras: Array, reference: Reference, tolerance: Tolerance, poses: Sequence[Array]) -> int | None:
    """Return after how many poses all cameras meet a tolerance; None: after none.

    Parameters
    ----------
    of_cameras : (k + 1, cameras, 6, 6)
        Covariances before, and after each pose.
    poses : of the cameras (4, 4)
    """
    for count, blocks in enumerate(of_cameras):
        if all(
            probability_within(S, reference, tolerance, T[:3, :3]) >= MET for S, T in zip(blocks, poses, strict=True)
        ):
            return count
    return None


def _in_view(data: PosePairs, camera: Array, min_mean: float = 0.5) -> NDArray[np.intp]:
    """Numbers of the poses (m, 4, 4) at which the target is within 90 degrees of where it was seen on average.

    Where the mean of its directions is shorter than ``min_mean``, it was seen from all around, and all are in view.
    """
    seen, ahead = (T[:, :3, 3] / np.maximum(np.linalg.norm(T[:, :3, 3], axis=-1, keepdims=True), TINY)
                   for T in (data.camera, camera))  # fmt: skip
    mean = seen.mean(axis=0)
    return np.flatnonzero(ahead @ mean > 0) if np.linalg.norm(mean) > min_mean else np.arange(len(camera))
