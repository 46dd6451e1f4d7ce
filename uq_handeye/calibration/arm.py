"""The arm of a request: its joints at the poses, given or by inverse kinematics, and its declared kinematic errors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core.geometry.checks import as_numbers
from ..core.geometry.se3 import Array, difference, perturb
from ..errors import InputError
from ..fit.graph.gauss_helmert import ESTIMATORS
from ..fit.graph.request import Request, of_motions
from ..model.errors.joint_covariance import JointCovariance
from ..model.errors.keys import JOINT_NOISE
from ..model.errors.models import Noise, PoseNoise
from ..model.errors.term import ErrorTerm
from ..model.kinematics.against_controller import ControllerComparison, compare_with_controller
from ..model.kinematics.by_poses import joints_by_poses
from ..model.kinematics.chain import Kinematics
from ..model.kinematics.kinematic_errors import KinematicErrors, effects_of_errors, poses_with_errors
from ..model.poses.pose_pairs import PosePairs
from ..model.shared_errors.in_noise import add_columns, errors_of_arm
from ..model.shared_errors.shared_error import SharedError

# Two branches of the inverse kinematics differ where the sine of half an angle between them exceeds this.
MIN_BRANCH_DIFFERENCE = 0.1


class Arm(NamedTuple):
    """A robot by its joints."""

    kinematics: Kinematics  # in the base frame and with the tool of the measured poses
    joints: Array  # (n, L) rad, m
    errors: KinematicErrors
    against: ControllerComparison  # the measured poses against those of the joints
    measured: PosePairs  # as they came
    at: Array | None = None  # (m,) errors about which the model is linear; None: 0
    by_poses: bool = False  # joints by inverse kinematics, in a branch that is one of several

    def other_branches(self) -> list[Arm]:
        """Return the arm in the other branches of its inverse kinematics that reach the poses."""
        from ..model.kinematics.postures import all_branches

        found = all_branches(self.kinematics, self.measured.robot) if self.by_poses else []
        apart = [q for q in found if np.abs(np.sin(0.5 * (q - self.joints))).max() > MIN_BRANCH_DIFFERENCE]
        return [self._replace(joints=q) for q in apart]

    @property
    def terms(self) -> tuple[ErrorTerm, ...]:
        """Errors of the robot poses by those of the arm."""
        return self.errors.terms(self.kinematics, self.joints, self.at, self.by_poses)

    def linear_about(self, e: Array) -> Array:
        """(n, 4, 4) poses of the robot in place of the measured ones, for errors e (m,) of the arm.

        ``FK(q; e)`` minus ``F(e) e``, where ``FK(q; 0)`` was measured: with it the errors have the mean 0 as before,
        and ``F(e)`` times them is right to the second order about e.
        """
        of = self.kinematics, self.joints, e, self.errors.flange
        nominal, true = self.kinematics.poses(self.joints), poses_with_errors(*of)
        linear = perturb(true, -(effects_of_errors(*of) @ e))
        return perturb(self.measured.robot, difference(linear, nominal))


def with_declared(
    noise: PoseNoise, errors: KinematicErrors, terms: Iterable[ErrorTerm]
) -> tuple[PoseNoise, tuple[SharedError, ...]]:
    """Return the noise with joint noise added, and the declared errors of the arm, which all poses share."""
    robot, joint_sd = noise.robot, float(errors.joint_sd or 0.0)
    for term in terms:
        if term.key == JOINT_NOISE and joint_sd > 0:
            own = joint_sd**2 * term.covariance
            robot = add_columns(robot, JointCovariance.of_each(own))
    return replace(noise, robot=robot), errors_of_arm(terms, errors.standard_deviations)


def _arm_of(request: Request, poses: PosePairs | None, noise: Noise | None, at: Array | None) -> Arm | None:
    """The arm of poses as they came, where joints and kinematics are given; raises `InputError`.

    ``at``: its errors about which the poses are linearised.
    """
    joints, kinematics, errors = request.joints, request.kinematics, request.kinematic_errors
    method = request.taken_method
    if kinematics is None:
        if joints is not None or errors is not None:
            raise InputError("Expected `kinematics` beside joints and kinematic errors: Kinematics.from_urdf(...).")
        return None
    if poses is None or of_motions(noise):
        raise InputError("Expected poses, with PoseNoise or none, beside `kinematics`: joints say nothing of motions.")
    if method not in ESTIMATORS:
        raise InputError(f"Method {method!r} takes no kinematic errors; use efficient or ml.")
    given = poses.joints if joints is None else joints
    q = joints_by_poses(kinematics, poses.robot) if given is None else as_numbers(given, "joints")
    if q.shape != (poses.n, kinematics.n_joints) or not np.isfinite(q).all():
        raise InputError(
            f"Expected `joints` to be finite numbers {(poses.n, kinematics.n_joints)}, of {poses.n} poses and the "
            f"joints {', '.join(kinematics.names)}, got shape {q.shape}."
        )
    errors = KinematicErrors() if errors is None else errors
    against = compare_with_controller(kinematics, q, poses.robot)
    if not against.same_arm:
        raise InputError(" ".join(map(str, against.findings)))
    return Arm(against.adapt(kinematics), q, errors, against, poses, at=at, by_poses=given is None)
