r"""Choosing poses by the posterior of a calibration: its covariance so far is the one that the calibration states.

A pose at which the camera pose will be measured with the derivatives A by all errors s of the posterior, and with its
own noise ``L L^T`` (what is drawn again, and what of the arm is unknown again there), adds the information ``B^T B``,
``B = L^-1 A`` (`posterior.selection`). More poses do not average what all of them share: it is among s.

Criterion ``prediction`` is the mean squared error (m^2) of where the camera is from the target at the task postures,

    tr(Q Sigma),    Q = mean over the task of  A_t(q)^T A_t(q),    A_t the rows of the translation,

without what the camera itself misreads there: from most postures of a workspace it does not see the target, and a lens
says nothing of views that its pictures do not hold.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...calibration.estimate.estimated import Estimated
from ...calibration.prediction.predict import CameraAhead, camera_at, own_noise
from ...core.geometry.se3 import Array
from ...errors import InputError
from ...model.kinematics.chain import Kinematics
from ...model.noise.models import PoseNoise
from ...model.noise.square_roots import cholesky_of, whiten
from ...model.poses.pose_pairs import PosePairs
from ...model.posterior.owners import ROBOT
from ...model.posterior.selection import weight_of_X
from .candidates import require_choice
from .result import FORMS, Plan

PREDICTION = "prediction"
# Length of the mean direction of the target below which it was seen from all around, and nothing is out of view.
MIXED = 0.5


class Wanted(NamedTuple):
    """Quantity to minimise."""

    criterion: str
    point: Array | None  # (3,) m
    length: float | None  # m
    task: CameraAhead | None = None  # postures (t, L) of criterion prediction


class Offered(NamedTuple):
    """Candidates to choose from, as given, or how many are drawn."""

    candidates: Any = None
    sample: int = 200
    seed: int | np.random.Generator = 0
    repeat: bool = False


class Known(NamedTuple):
    """A calibration of the poses so far with its posterior, and the poses that it kept."""

    result: Estimated
    data: PosePairs
    noise_estimated: bool
    open_directions: Array = np.zeros((0, 6))


def planned(known: Known, ahead: CameraAhead, k: int, of: Wanted, offered: Offered, **more: Any) -> Plan:
    """Return the k of the poses ahead that make the criterion small; ``more`` are fields of the plan about joints."""
    result, data = known.result, known.data
    sampled, repeat = offered.candidates is None, offered.repeat
    assert result.posterior is not None and result.W is not None
    require_choice(len(ahead.robot), k, repeat)
    camera = camera_at(result, ahead.robot)
    in_view = np.arange(len(camera)) if sampled or len(known.open_directions) else _in_view(data, camera)
    if len(in_view) < (1 if repeat else k):
        raise InputError(
            f"Expected candidates from which the camera sees the target, got {len(in_view)} of {len(camera)}: at the "
            "others the target is behind the camera, or far aside. Are they poses base_T_gripper of this rig?"
        )
    Q = None
    if of.task is not None:
        A = np.array(of.task.columns[:, 3:])
        owned = 12 + result.posterior.owned_by([ROBOT])
        A[..., np.setdiff1d(np.arange(12, A.shape[-1]), owned)] = 0.0
        Q = np.einsum("tri,trj->ij", A, A) / len(A)
    elif of.criterion != "logdet":
        Q = weight_of_X(result.X, of.point, of.length)
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
        criterion=of.criterion,
        criterion_before=float(values[0]),
        criterion_values=values[1:],
        length=of.length,
        point=of.point,
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


def joint_fields(chain: Kinematics, joint_noise: float) -> dict[str, Any]:
    """Fields of a plan about the joints of an arm."""
    units = tuple(joint.unit for joint in chain.joints)
    return {"joint_names": chain.names, "joint_units": units, "joint_noise": joint_noise}
