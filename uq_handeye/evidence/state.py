r"""The errors of a calibration as one Gaussian, with those of the robot at other poses.

The errors of its estimates ``s = (xi_X, xi_W, e - estimate)`` have the covariance P of the joint posterior. A robot
accuracy that was carried to X (`likelihood.carried_errors`) is a smooth field over the pose: where the robot comes back
to the poses of the calibration, it is wrong by what has already moved X. With z ~ N(0, I) the numbers of the field, F_i
their columns at the poses of the calibration and F at a new pose, K_i the gain of the estimate,

    s = s_0 + (sum_i K_i F_i; 0) z,      xi_G = F z,      s_0 ~ N(0, P_0),  P_0 = P - (its part of the field)

so that all is linear in one standard normal u = (u_0, z): ``s = A u``, ``A = [P_0^(1/2), K F]``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..errors import InputError, SingularNoiseError
from ..geometry.se3 import Array
from ..likelihood.constraint import Unknowns, constraint_of
from ..likelihood.gauss_helmert import Fit, fit
from ..likelihood.shared_estimates import JointPosterior, SharedEstimate
from ..noise.models import PoseNoise
from ..noise.square_roots import pulled, whiten
from ..poses.motions import Motions
from ..poses.pose_pairs import PosePairs
from ..prediction.predict import Predicting
from ..runtime.read_only import ReadOnlyArrays
from ..shared_errors.accuracy import RobotAccuracy
from ..shared_errors.shared_error import SharedError


class Weighted(Protocol):
    """Interface of a pose table, as far as evidence needs it."""

    @property
    def weight(self) -> Array: ...
    @property
    def counted(self) -> list[int]: ...


class Calibrated(Predicting, Protocol):
    """Interface of a calibration, as far as evidence needs it."""

    @property
    def method(self) -> str: ...
    @property
    def shared(self) -> tuple[SharedEstimate, ...]: ...
    @property
    def table(self) -> Weighted | None: ...


@dataclass(frozen=True, eq=False)
class State(ReadOnlyArrays):
    """Errors of the estimates, ``s = A u`` with u ~ N(0, I), and the robot's errors at new poses by the same u."""

    A: Array  # (12 + q, p)
    estimate: Array  # (q,) of the shared errors
    names: tuple[str, ...]  # (q)
    field: Callable[[Array], Array] | None = None  # columns (k, 6, r) at robot poses (k, 4, 4), by the last r of u

    @property
    def covariance(self) -> Array:
        """(12 + q, 12 + q) of s."""
        return np.asarray(self.A @ self.A.T)

    def robot_errors(self, poses: Array) -> Array:
        """(k, 6, p) errors of robot poses (k, 4, 4) by u: those of the accuracy that was carried to X."""
        found = np.zeros((len(poses), 6, self.A.shape[1]))
        if self.field is not None:
            columns = self.field(poses)
            found[..., found.shape[-1] - columns.shape[-1] :] = columns
        return found


def state_of(result: Calibrated, robot: Array | None = None) -> State:
    """Return the errors of a calibration, and of the robot at poses ``robot`` (k, 4, 4), ``base_T_gripper``.

    Raises
    ------
    InputError
        No joint covariance of X and W: a published method, motions without poses, an older file; a part of X open.
    """
    posterior = joint_posterior_of(result)
    P, accuracy = posterior.covariance, accuracy_of(result)
    data = result.counted
    poses = data if isinstance(data, PosePairs) else getattr(data, "poses", None)
    if accuracy is None or robot is None or not len(robot):
        return State(root(P), posterior.estimate, posterior.names)
    before = refitted(result)
    error = SharedError.robot_accuracy(accuracy.translation, accuracy.rotation, reach=accuracy.reach)
    if before is None or poses is None:  # how X moved with the field is not known: as if it were independent
        field = _field(error, robot, result)
        r = field(robot[:1]).shape[-1]
        return State(np.hstack([root(P), np.zeros((len(P), r))]), posterior.estimate, posterior.names, field)
    was = _moves(before, error.bound(poses).at(poses))
    P_0 = P.copy()
    P_0[:12, :12] -= was @ was.T
    field = _field(error, np.concatenate([poses.robot, robot]), result)
    moves = np.zeros((len(P), field(robot[:1]).shape[-1]))
    moves[:12] = _moves(before, field(poses.robot))
    return State(np.hstack([root(P_0), moves]), posterior.estimate, posterior.names, field)


def joint_posterior_of(result: Calibrated) -> JointPosterior:
    """Return the joint posterior of X and W; raises `InputError` where there is none, with the reason."""
    if result.opened is not None:
        raise InputError("The motions of this calibration leave a part of X or W open: nothing can be held against it.")
    if result.joint_posterior is None or result.W is None:
        what = "of motions without poses" if isinstance(result.counted, Motions) else f"by method {result.method!r}"
        raise InputError(
            f"Expected a calibration with the joint covariance of X and W, got one {what} without it. Calibrate poses "
            "by method efficient or ml."
        )
    return result.joint_posterior


def accuracy_of(result: Calibrated) -> RobotAccuracy | None:
    """Return the robot's accuracy that was declared or assumed and carried to X; None where there is none."""
    return next((error.accuracy for error in result.shared if error.accuracy is not None), None)


def refitted(result: Calibrated) -> Fit | None:
    """Return the fit again at the stored estimate, with stored noise and weights; None where the result lacks these."""
    data = result.counted
    if not isinstance(data, PosePairs) or not isinstance(result.noise, PoseNoise) or result.W is None:
        return None
    constraint = constraint_of(data, result.noise)
    weights = None if result.table is None else np.asarray(result.table.weight)[result.table.counted]
    try:
        return fit(constraint, result.noise, Unknowns(result.X, result.W), 1, weights)
    except SingularNoiseError:
        return None


def root(P: Array) -> Array:
    """L with ``P = L L^T``; negative eigenvalues, which are rounding, become 0."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(P)), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(P / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _field(error: SharedError, poses: Array, result: Calibrated) -> Callable[[Array], Array]:
    """Columns of the robot's accuracy, bound to the poses, at others."""

    def pairs(robot: Array) -> PosePairs:
        return PosePairs(robot, np.broadcast_to(np.eye(4), robot.shape), result.setup or "eye-in-hand")

    bound = error.bound(pairs(poses))
    return lambda robot: bound.at(pairs(robot)) * bound.widest


def _moves(before: Fit, columns: Array) -> Array:
    """(12, r) how X and W move with errors of the robot poses: ``sum_i K_i F_i``."""
    factor = before.weighted_factor
    back = pulled(factor, whiten(factor, before.linear.J))
    by_error = np.einsum("nri,nrk->ik", back, before.linear.sides[0] @ columns)
    return np.asarray(-before.closed_projection @ before.covariance @ by_error)
