r"""Everything at once on the corners: intrinsics, X, W and latent robot poses by one bundle adjustment.

Model: with true robot poses G_i (inverted for eye-to-hand), X and W, the board is seen at ``C_i = (G_i X)^-1 W``.
Corner j of picture i is ``z_ij = project(k, C_i P_j) + e``, e independent with the standard deviation s per coordinate
(pixels); the measured robot pose is the true one with the error ``xi_i = L_i u_i`` (left rotation in rad, additive
translation in m), u_i standard normal, ``L_i L_i^T`` its covariance: singular or 0 where the robot is exact. Minimised
is

    sum_ij |z_ij - project(k, C_i P_j)|^2 / s^2  +  sum_i |u_i|^2  +  (k - k_0)^T Sigma_0^-1 (k - k_0)

over X, W, the free intrinsics k and all u_i; those are eliminated picture by picture
(`camera.adjustment.variable_projection`).
Errors that all robot poses share (a `JointCovariance`, ``xi_i = L_i u_i + F_i v``) are q more unknowns v, standard
normal, beside k: ``|v|^2`` comes to the sum.
The covariance of X and W is their block of the inverse of the reduced information. s is that of the camera calibration.

Derivatives. ``G X C = W`` linearised (`constraint`) is ``J d(X, W) + D_G d(G) + D_C d(C) = 0``, and D_C is orthogonal:

    d(C) = -D_C^T (J d(X, W) + D_G d(G)),      d(G) = -blkdiag(J_l(-theta_i), I) L_i du_i

To first order in the errors the estimate and its covariance are those of `likelihood` with the joint covariance of the
camera poses (T4b). Pictures whose robot pose is wrong keep their corners, which still tell the intrinsics: their robot
pose is then unknown, that is, it starts where the camera saw the board from and has a prior that says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.files.records import Record
from ...core.geometry.se3 import Array, inverse, left_jacobian, logarithm, perturb
from ...errors import InputError, NotConvergedError
from ...model.camera.adjustment.bundle import Sight, prior_rows
from ...model.camera.adjustment.variable_projection import minimised
from ...model.camera.result import CameraCalibration
from ...model.noise.joint_covariance import JointCovariance
from ...model.noise.models import factor, is_joint, require_count
from ...model.poses.pose_pairs import PosePairs
from .constraint import OnPoses, Unknowns
from .gauss_helmert import inverse_information

# Deviation (rad, m) of a robot pose of which nothing is known.
UNKNOWN = 100.0


class RigBundle(NamedTuple):
    """Result of `adjust_rig`."""

    X: Array  # (4, 4)
    W: Array  # (4, 4)
    covariance: (
        Array  # (12 + f + q,) * 2 of the errors of X and W, the f free intrinsics, the q shared errors of the robot
    )
    parameters: Array  # (p,) intrinsics and shape of the board
    robot: Array  # (n, 4, 4) as adjusted
    chi2: float  # what is left of the objective
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
        xi = np.concatenate([logarithm(X[:3, :3] @ X0[:3, :3].T), X[:3, 3] - X0[:3, 3]]) / sd
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


@dataclass(frozen=True, eq=False)
class _Problem:
    """Values: errors of X and W (12) from a start, the f free intrinsics, v (q); blocks: u (n, 6)."""

    sight: Sight
    s: float
    parameters: Array
    free: NDArray[np.bool_]
    start: Unknowns
    robot: Array  # (n, 4, 4) measured
    L: Array  # (n, 6, 6)
    F: Array  # (n, 6, q)
    inverted: bool

    @property
    def last(self) -> int:
        """End of the intrinsics among the values."""
        return 12 + int(self.free.sum())

    def _all(self, values: Array) -> Array:
        parameters = self.parameters.copy()
        parameters[self.free] = values[12 : self.last]
        return parameters

    def _camera(self, at: Unknowns, robot: Array) -> Array:
        assert at.W is not None
        G = inverse(robot) if self.inverted else robot
        return np.asarray(inverse(G @ at.X) @ at.W)

    def corrected(self, values: Array, blocks: Array, part: slice) -> tuple[Array, Array]:
        """Robot poses of a part of the pictures without their errors, and those errors xi (n, 6)."""
        xi = (self.L[part] @ blocks[..., None])[..., 0] + self.F[part] @ values[self.last :]
        return perturb(self.robot[part], -xi), xi

    @property
    def m(self) -> int:
        return 2 * int(self.sight.weights.shape[1]) + 6

    def rows(self, values: Array, blocks: Array, part: slice) -> tuple[Array, Array, Array]:
        at, sight = self.start.moved(values[:12]), self.sight.pictures(part)
        robot, xi = self.corrected(values, blocks, part)
        camera = self._camera(at, robot)
        r, by_parameters, by_pose = sight.rows(self._all(values), camera, self.free)
        linear = OnPoses(robot, camera, self.inverted).linearise(at, robot, camera)
        D_G, D_C = linear.sides
        J, D = linear.J.copy(), D_G.copy()
        for first in (0, 6):  # exp([theta + d]x) = exp([J_l(theta) d]x) exp([theta]x)
            J[..., first : first + 3] = J[..., first : first + 3] @ left_jacobian(values[first : first + 3])
        D[..., :3] = D[..., :3] @ left_jacobian(-xi[..., :3])
        by_pose = -(by_pose @ D_C.mT) / self.s
        n, m, f = len(r), r.shape[1], len(values)
        A, B = np.zeros((n, m + 6, f)), np.empty((n, m + 6, 6))
        A[:, :m, :12] = by_pose @ J
        A[:, :m, 12 : self.last] = by_parameters / self.s
        A[:, :m, self.last :] = -(by_pose @ (D @ self.F[part]))
        B[:, :m] = -(by_pose @ (D @ self.L[part]))
        B[:, m:] = np.eye(6)
        return np.concatenate([r / self.s, blocks], axis=-1), A, B

    def moved(self, blocks: Array, step: Array) -> Array:
        return blocks + step


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
        Pixels: noise of all corners beside that of the camera calibration (`noise.estimate.CAMERA_EXCESS`).

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
    problem = _problem(poses, seen, robot, start, w, excess)
    q = problem.F.shape[-1]
    values = np.concatenate([np.zeros(12), problem.parameters[problem.free], np.zeros(q)])
    rows = [np.eye(len(values))[problem.last :]]  # of v, and of what is known of the intrinsics
    mean = np.zeros(len(values))
    if (known := seen.bundle.prior) is not None:
        mean[12 : problem.last], R = prior_rows(known, problem.free, 1.0)
        rows.append(np.pad(R, ((0, 0), (12, q))))
    told = np.concatenate(rows)
    prior = (mean, told) if len(told) else None
    found = minimised(problem, values, np.zeros((poses.n, 6)), prior)
    information = found.information if prior is None else found.information + prior[1].T @ prior[1]
    for first in (0, 6):  # of errors at the solution, not of steps from the start
        turn = np.linalg.inv(left_jacobian(found.values[first : first + 3]))
        part = slice(first, first + 3)
        information[:, part] = information[:, part] @ turn
        information[part] = turn.T @ information[part]
    at = start.moved(found.values[:12])
    assert at.W is not None
    # Each robot pose brings as many numbers as it has unknowns; an unknown one neither.
    dof = 2 * int(seen.bundle.used.sum()) - len(values) + (0 if prior is None else len(prior[1]))
    dof -= 6 * int((w == 0).sum())
    parameters = problem._all(found.values)
    robots, _ = problem.corrected(found.values, found.blocks, slice(None))
    covariance = inverse_information(information)
    result = RigBundle(at.X, at.W, covariance, parameters, robots, found.squares, dof, found.steps)
    if not found.converged:
        raise NotConvergedError(
            f"Method 'bundle' did not converge within {found.steps} steps: the residuals are too large for the noise. "
            "Look at the warnings of method 'efficient'.",
            result,
        )
    return result


def require_shared(robot: Array | JointCovariance | None) -> None:
    """Raise `InputError` for a joint covariance of the robot other than by errors that all poses share."""
    joint = robot is not None and is_joint(robot)
    if joint and not isinstance(robot, JointCovariance):
        raise InputError(
            "Method 'bundle' takes robot noise that is independent from pose to pose but for errors that all share "
            "(JointCovariance), got a dense joint covariance or a drift. Use method 'efficient'."
        )


def _problem(
    poses: PosePairs,
    seen: CameraCalibration,
    robot: Array | JointCovariance | None,
    start: Unknowns,
    weights: Array,
    excess: float = 0.0,
) -> _Problem:
    bundle, kept = seen.bundle, weights > 0
    root = np.sqrt(np.where(kept, weights, 1.0))
    of_picture = root / np.sqrt(1.0 / bundle.weights + (excess / bundle.pixel_noise) ** 2)
    sight = Sight.of(bundle.model, bundle.shape, seen.corners, bundle.used * of_picture[seen.corners.picture])
    inverted = poses.setup == "eye-to-hand"
    F = np.zeros((poses.n, 6, 0))
    if isinstance(robot, JointCovariance):
        F = np.where(kept[:, None, None], robot.shared, 0.0)
        robot = robot.own
    L = np.zeros((poses.n, 6, 6)) if robot is None else np.broadcast_to(factor(robot), (poses.n, 6, 6))
    L = np.where(kept[:, None, None], L / root[:, None, None], UNKNOWN * np.eye(6))
    assert start.W is not None
    G = start.W @ inverse(start.X @ poses.camera)  # where the camera saw the board from
    measured = np.where(kept[:, None, None], poses.robot, inverse(G) if inverted else G)
    return _Problem(sight, bundle.pixel_noise, bundle.parameters, bundle.free, start, measured, L, F, inverted)
