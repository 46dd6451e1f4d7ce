r"""Bundle adjustment of intrinsics, X, W and robot poses on the corners: `ml` with repeated linearisation of them.

Model: with true robot poses G_i (inverted for eye-to-hand), X and W, the board is seen at ``C_i = (G_i X)^-1 W``.
Corner j of picture i is ``z_ij = project(k, C_i P_j) + e``, e independent with the standard deviation s per coordinate
(pixels); the measured robot pose is the true one with the error ``xi_i = L_i u_i + F_i v`` (left rotation in rad,
additive translation in m), u_i and v standard normal, ``L_i L_i^T`` its own covariance, singular or 0 where the robot
is exact, v errors that all robot poses share. The objective is

    sum_ij |z_ij - project(k, C_i P_j)|^2 / s^2  +  sum_i |u_i|^2  +  |v|^2  +  (k - k_0)^T Sigma_0^-1 (k - k_0)

minimised over X, W, the free intrinsics k and all u_i and v. With the rows r of the corners of picture i and their
derivatives A by k and B by the error of C_i, at any k and C_i (`camera.adjustment.bundle`), all over s,

    S_i = (B^T B)^-1,   d_i = -S_i B^T r,   G_i = -S_i B^T A,   H = sum_i (A + B G_i)^T (A + B G_i) + Sigma_0^-1

C_i moved by d_i is a measured camera pose with its own covariance S_i, and k with ``H^-1`` the error that all of them
share, through G_i: the joint covariance of T4b. `gauss_helmert` estimates X, W, k and the true poses by it, the corners
are linearised at those, and so on until it converges: Gauss-Newton of the sum above. To first order, and so after the
first round, it is `efficient`.

A picture whose robot pose is wrong (robust weight 0) keeps its corners, which still inform about the intrinsics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ...core.files.records import Record
from ...core.geometry.se3 import Array, difference, left_jacobian, perturb
from ...errors import InputError, NotConvergedError
from ...model.camera.adjustment.bundle import Bundle, Sight, prior_rows
from ...model.noise.joint_covariance import JointCovariance, joint_of
from ...model.noise.models import PoseNoise, is_joint, require_count
from ...model.noise.square_roots import pulled, whiten
from ...model.poses.pose_pairs import PosePairs
from .constraint import OnPoses, Unknowns
from .gauss_helmert import MAX_ML_STEPS, MAX_ROUNDS, STEP_SD, Fit, corrected, fit, inverse_information


class RigBundle(NamedTuple):
    """Result of `adjust_rig`."""

    X: Array  # (4, 4)
    W: Array  # (4, 4)
    covariance: (
        Array  # (12 + f + q,) * 2 of the errors of X and W, the f free intrinsics, the q shared errors of the robot
    )
    parameters: Array  # (p,) intrinsics and shape of the board
    robot: Array  # (n, 4, 4) as adjusted
    chi2: float  # the objective at the estimate
    dof: int
    iterations: int

    @property
    def covariance_X(self) -> Array:
        """(6, 6)"""
        return self.covariance[:6, :6]

    @property
    def covariance_W(self) -> Array:
        """(6, 6)"""
        return self.covariance[6:12, 6:12]


@dataclass(frozen=True, eq=False)
class Agreement(Record):
    """The bundle adjustment against `efficient` with the joint covariance of the camera poses: the same to first order.

    Differences are X of the bundle from X of `efficient`, ``xi = (theta, tau)``, in standard deviations of `efficient`.
    """

    distance: float  # sqrt(xi^T Sigma^-1 xi)
    by_component: Annotated[Array, 6]  # (6,) xi_k / sigma_k
    eigenvalues: Annotated[Array, 6]  # (6,) of the covariance of the bundle, in units of that of `efficient`, ascending

    @classmethod
    def of(cls, X: Array, covariance: Array, X0: Array, covariance0: Array) -> Agreement:
        """Compare estimate and covariance by bundle and by `efficient`."""
        sd = np.sqrt(np.diag(covariance0))
        xi = difference(X, X0) / sd
        scale = 1.0 / np.outer(sd, sd)
        half = np.linalg.cholesky(covariance0 * scale)
        white = np.linalg.solve(half, np.linalg.solve(half, covariance * scale).T)
        distance = float(np.linalg.norm(np.linalg.solve(half, xi)))
        return cls(distance, xi, np.asarray(np.linalg.eigvalsh(0.5 * (white + white.T)), dtype=float))

    @property
    def sentence(self) -> str:
        """Agreement in words."""
        low, high = self.eigenvalues[0], self.eigenvalues[-1]
        return (
            "Bundle adjustment against method 'efficient' with the joint covariance of the camera poses: X differs by "
            f"{self.distance:.2g} standard deviations (at most {np.abs(self.by_component).max():.2g} in one "
            f"component), variances are {low:.3f} to {high:.3f} times as large."
        )


class _Seen(NamedTuple):
    """The corners as camera poses, linearised at intrinsics and poses; see the module."""

    poses: Array  # (n, 4, 4) measured
    covariance: JointCovariance
    parameters: Array  # (f,) k that they go with
    half: Array  # (f, f) with ``half half^T = H^-1``: k for one of what the poses share
    squares: float  # of corners and of the prior of k, where they are linearised


def adjust_rig(
    poses: PosePairs,
    robot: Array | JointCovariance | None,
    start: Unknowns,
    weights: Array | None = None,
    excess: float = 0.0,
) -> RigBundle:
    """The least squares estimate of X, W, intrinsics and robot poses on the corners.

    Parameters
    ----------
    poses : PosePairs
        With a ``camera_calibration``, whose corners, intrinsics, prior and pixel noise are taken.
    robot : (6, 6), (n, 6, 6), JointCovariance or None
        Covariance of the robot poses, with errors that all of them share; None: they are exact.
    start : Unknowns
        X and W near the solution.
    weights : (n,) or None
        Robust weights in [0, 1]: divide the variances of the corners and of the robot pose; 0 says that the robot pose
        belongs to another picture or is wrong, and is taken as unknown.
    excess : float
        Pixels: noise of all corners in addition to that of the camera calibration (`noise.estimate.CAMERA_EXCESS`).

    Raises
    ------
    InputError
        Poses without corners; a covariance (6n, 6n), or of another number of poses.
    DegenerateMotionError
        The data do not determine X and W.
    NotConvergedError
        ``partial`` holds the `RigBundle` that was reached.
    """
    seen = poses.camera_calibration
    if seen is None or start.W is None:
        raise InputError("Expected poses with a `camera_calibration`, and W beside X to start from.")
    require_shared(robot)
    require_count(robot, poses.n, "robot", "poses")
    w = np.ones(poses.n) if weights is None else np.asarray(weights, dtype=float)
    bundle, free, at, camera = seen.bundle, seen.bundle.free, start, seen.poses
    of_picture = 1.0 / np.hypot(bundle.picture_noise, excess)
    sight = Sight.of(bundle.model, bundle.shape, seen.corners, bundle.used * of_picture[seen.corners.picture])
    k, adjusted, kept = np.array(bundle.parameters), np.array(poses.robot), np.flatnonzero(w > 0)
    done, converged = 0, False
    while not converged and done < MAX_ROUNDS:
        of_corners = _as_poses(sight, bundle, k, camera, np.where(w > 0, w, 1.0))
        noise = PoseNoise(robot, of_corners.covariance).rows(kept).weighted(w[kept])
        constraint = OnPoses(poses.robot[kept], of_corners.poses[kept], poses.setup == "eye-to-hand")
        found = fit(constraint, noise, at, MAX_ML_STEPS)
        S = joint_of(found.S)
        assert S is not None and found.W is not None and at.W is not None
        told, q = found.told(S.shared), S.shared.shape[-1] - len(of_corners.half)  # q of the robot come first
        now = of_corners.parameters - of_corners.half @ told.z[q:]
        off = np.concatenate([difference(found.X, at.X), difference(found.W, at.W)])
        moved = np.linalg.solve(np.linalg.cholesky(found.covariance), off)
        of_k = np.linalg.solve(of_corners.half, now - k[free])
        at, k[free] = found.unknowns, now
        camera = perturb(of_corners.poses, -of_corners.covariance.shared @ told.z[q:])
        adjusted[kept], camera[kept] = corrected(found, noise, constraint.first, constraint.second)
        move = float(np.hypot(np.linalg.norm(moved), np.linalg.norm(of_k)))
        done, converged = done + 1, move < 10.0 * STEP_SD  # the steps inside a round end at STEP_SD
    assert at.W is not None
    # Each robot pose brings as many numbers as it has unknowns; an unknown one neither.
    known = 0 if bundle.prior is None else int(free.sum())
    dof = 2 * int(bundle.used.sum()) - 12 - int(free.sum()) + known - 6 * int((w == 0).sum())
    chi2 = of_corners.squares + _squares_of_robot(found, constraint.first, adjusted[kept])
    to_errors = np.zeros((12 + len(told.z),) * 2)  # from those of X and W, and truth less estimate of z
    to_errors[:12, :12], to_errors[12 : len(to_errors) - q, 12 + q :] = np.eye(12), of_corners.half
    to_errors[len(to_errors) - q :, 12 : 12 + q] = -np.eye(q)
    joint = np.block([[found.covariance, told.response], [told.response.T, told.left]])
    covariance = to_errors @ joint @ to_errors.T
    result = RigBundle(at.X, at.W, covariance, k, adjusted, chi2, dof, done)
    if not converged:
        raise NotConvergedError(
            f"Method 'bundle' did not converge within {done} steps: the residuals are too large for the noise. "
            "Look at the warnings of method 'efficient'.",
            result,
        )
    return result


def require_shared(robot: Array | JointCovariance | None) -> None:
    """Raise `InputError` for a joint covariance of the robot other than by errors that all poses share."""
    if robot is not None and is_joint(robot) and joint_of(robot) is None:
        raise InputError(
            "Method 'bundle' takes robot noise that is independent from pose to pose but for errors that all share "
            "(JointCovariance), got a dense joint covariance or a drift. Use method 'efficient'."
        )


def _squares_of_robot(fitted: Fit, measured: Array, adjusted: Array) -> float:
    """Return ``xi^T Sigma^-1 xi`` of the errors of the robot poses, also where Sigma is singular."""
    pull = pulled(fitted.weighted_factor, whiten(fitted.weighted_factor, fitted.residual[..., None]))
    return float(np.sum((fitted.linear.sides[0].mT @ pull)[..., 0] * difference(measured, adjusted)))


def _as_poses(sight: Sight, bundle: Bundle, k: Array, camera: Array, w: Array) -> _Seen:
    """Linearise the corners at intrinsics and camera poses (n, 4, 4), by weights w (n,)."""
    r, A, B = sight.rows(k, camera, bundle.free)
    own = np.linalg.inv(B.mT @ B)
    d, G = -(own @ (B.mT @ r[..., None]))[..., 0], -(own @ (B.mT @ A))
    root = np.sqrt(w)[:, None]
    left, rest = (root[..., None] * (A + B @ G)).reshape(r.size, G.shape[-1]), (root * r).ravel()
    if bundle.prior is not None:
        mean, R = prior_rows(bundle.prior, bundle.free, 1.0)
        left, rest = np.concatenate([left, R]), np.append(rest, R @ (k[bundle.free] - mean))
    H = left.T @ left
    half = np.asarray(np.linalg.cholesky(inverse_information(H)) if len(H) else H, dtype=float)
    step = -half @ (half.T @ (left.T @ rest))  # B^T (A + B G) = 0: the poses may be anywhere
    moved = d + (G @ step)
    # An error of the pose as moved is another one of the pose where the corners are linearised.
    turn = np.tile(np.eye(6), (len(d), 1, 1))
    turn[:, :3, :3] = np.linalg.inv(left_jacobian(-moved[:, :3]))
    own = turn @ own @ turn.mT
    covariance = JointCovariance(0.5 * (own + own.mT), turn @ G @ half)
    return _Seen(perturb(camera, moved), covariance, k[bundle.free] + step, half, float(rest @ rest))
