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

from ..geometry.se3 import Array
from ..kinematics.chain import Kinematics
from ..noise.models import PoseNoise
from ..noise.square_roots import cholesky_of, whiten
from ..poses.pose_pairs import PosePairs
from ..posterior.owners import ROBOT
from ..posterior.selection import weight_of_X
from ..prediction.predict import CameraAhead, Predicting, camera_at, own_noise
from .candidates import require_choice
from .result import FORMS, Plan

PREDICTION = "prediction"


class Wanted(NamedTuple):
    """Quantity to minimise."""

    criterion: str
    point: Array | None  # (3,) m
    length: float | None  # m
    task: CameraAhead | None = None  # postures (t, L) of criterion prediction


class Known(NamedTuple):
    """What the poses so far say: a calibration with its posterior, and the poses that it kept."""

    result: Predicting
    data: PosePairs
    noise_estimated: bool
    open_directions: Array = np.zeros((0, 6))


def planned(known: Known, ahead: CameraAhead, k: int, of: Wanted, *, sampled: bool, repeat: bool, **more: Any) -> Plan:
    """Return the k of the poses ahead that make the criterion small; ``more`` are fields of the plan about joints."""
    result, data = known.result, known.data
    assert result.posterior is not None and result.W is not None
    require_choice(len(ahead.robot), k, repeat)
    Q = None
    if of.task is not None:
        A = np.array(of.task.columns[:, 3:])
        owned = 12 + result.posterior.owned_by([ROBOT])
        A[..., np.setdiff1d(np.arange(12, A.shape[-1]), owned)] = 0.0
        Q = np.einsum("tri,trj->ij", A, A) / len(A)
    elif of.criterion != "logdet":
        Q = weight_of_X(result.X, of.point, of.length)
    rows = whiten(cholesky_of(ahead.noise + ahead.unseen), ahead.columns)
    chosen, covariances, values = result.posterior.choose(rows, k, Q, repeat=repeat)
    form = data.sources[0].format if data.sources and "joints" not in more else ""
    return Plan(
        chosen=chosen,
        robot=ahead.robot[chosen],
        camera=camera_at(result, ahead.robot)[chosen],
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


def joint_fields(chain: Kinematics, joint_noise: float) -> dict[str, Any]:
    """Fields of a plan about the joints of an arm."""
    units = tuple(joint.unit for joint in chain.joints)
    return {"joint_names": chain.names, "joint_units": units, "joint_noise": joint_noise}
