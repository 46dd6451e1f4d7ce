"""X and W with their covariances: frames, standard deviations, other forms of the same pose, points that it carries."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ..core.geometry import conventions
from ..core.geometry.frames import SETUPS, TARGETS
from ..core.geometry.principal_axes import principal_axes
from ..core.geometry.se3 import Array, inverse, inverse_jacobian
from ..errors import InputError
from ..fit.diagnostics.task_space import PointUncertainty, moves_of_points, through_robot, through_target, through_X
from ..fit.likelihood.d2_distribution import Reference
from ..fit.likelihood.open_directions import OpenDirections, moves_along
from ..methods.procrustes.limit import octonion
from ..methods.procrustes.sensitivity import pose_from_octonion_jacobian
from ..methods.procrustes.so4_covariances import PAPER_SCALE
from .sentences import open_words


class EstimatedPoses:
    """Quantities that follow from X, W and their covariances only; the attributes are those of `Calibration`."""

    X: Array
    covariance: Array | None
    W: Array | None
    covariance_W: Array | None
    setup: str | None
    scale: float | None
    opened: OpenDirections | None
    reference: Reference

    @property
    def frame(self) -> str:
        """The frames of X, e.g. ``gripper_T_camera``."""
        return "X" if self.setup is None else SETUPS[self.setup]

    @property
    def frame_W(self) -> str:
        """The frames of W, e.g. ``base_T_target``."""
        return "W" if self.setup is None else TARGETS[self.setup]

    @property
    def std(self) -> Array | None:
        """Standard deviations (6,) of (theta, tau), rad and m; infinite for components that move along what is open."""
        if self.covariance is None:
            return None
        return deviations_of(self.covariance, self.opened, "X")

    @property
    def std_W(self) -> Array | None:
        """Standard deviations (6,) of (theta, tau) of W, rad and m; infinite as those of X."""
        if self.covariance_W is None:
            return None
        return deviations_of(self.covariance_W, self.opened, "W")

    @property
    def open_directions(self) -> Array:
        """(k, 12): what of (xi_X, xi_W) the motions leave open, as errors (theta, tau) of X, then of W, rad and m.

        Orthonormal in units of the rig: angles times ``opened.lever``, the distance of camera and target. k = 0 where
        nothing is open.
        """
        return np.zeros((0, 12)) if self.opened is None else self.opened.basis

    @property
    def open_of_X(self) -> Array | None:
        """(j, 6): what of X is open; None: nothing."""
        return None if self.opened is None else self.opened.of_X

    @property
    def open_of_W(self) -> Array | None:
        """(j, 6): what of W is open; None: nothing."""
        return None if self.opened is None else self.opened.of_W

    @property
    def open_words(self) -> tuple[str, ...]:
        """Each open direction in words."""
        return (
            () if self.opened is None else tuple(open_words(one, self.setup) for one in self.opened.single().tolist())
        )

    @property
    def correlation(self) -> Array | None:
        """Correlation matrix (6, 6) of (theta, tau); 0 beside a variance of 0."""
        if self.covariance is None:
            return None
        std = np.sqrt(np.diag(self.covariance))
        unit = np.where(std > 0, std, 1.0)
        correlation: Array = self.covariance / np.outer(unit, unit)
        np.fill_diagonal(correlation, 1.0)
        return correlation

    @property
    def inverse(self) -> Array:
        """``inv(X)`` (4, 4), e.g. ``camera_T_gripper``."""
        return inverse(self.X)

    @property
    def covariance_inverse(self) -> Array | None:
        """Covariance (6, 6) of ``inv(X)`` in the same convention, in its own parent frame."""
        if self.covariance is None:
            return None
        J = inverse_jacobian(self.X)
        return np.asarray(J @ self.covariance @ J.T)

    @property
    def sigma_scale(self) -> float:
        """The factor d at which `sigma` is given: that of the estimate, or 1e4 where it was the limit."""
        return PAPER_SCALE if self.scale is None else self.scale

    @property
    def sigma(self) -> Array:
        """The unit octonion (8,) of X on SO(4) (18), at `sigma_scale`."""
        return octonion(self.X, self.sigma_scale)

    @property
    def covariance_sigma(self) -> Array | None:
        """Covariance (8, 8) of `sigma` (48), of rank 6: the unit lengths of q_L and q_R are exact."""
        if self.covariance is None:
            return None
        sigma = self.sigma
        # sigma moves in the six directions orthogonal to (q_L, 0) and (0, q_R); there d xi / d sigma is regular.
        normals = np.zeros((8, 2))
        normals[:4, 0], normals[4:, 1] = sigma[:4], sigma[4:]
        tangent = np.linalg.qr(normals, mode="complete")[0][:, 2:]
        J = tangent @ np.linalg.inv(pose_from_octonion_jacobian(sigma, self.sigma_scale) @ tangent)
        return np.asarray(J @ self.covariance @ J.T)

    def covariance_in(self, convention: str) -> Array:
        """The covariance in the convention of another library; see `uq_handeye.core.geometry.conventions`."""
        if self.covariance is None:
            raise InputError("The covariance is not determined: no noise was given, and none could be estimated.")
        return conventions.to_convention(self.covariance, self.X, convention)

    @property
    def R(self) -> Array:
        """Rotation (3, 3) of X."""
        return np.asarray(self.X[:3, :3])

    @property
    def t(self) -> Array:
        """Translation (3,) of X, m."""
        return np.asarray(self.X[:3, 3])

    @property
    def quaternion(self) -> Array:
        """Unit quaternion (x, y, z, w) of X, w >= 0."""
        return np.asarray(Rotation.from_matrix(self.X[:3, :3]).as_quat(canonical=True))

    @property
    def weakest_rotation(self) -> tuple[Array, float] | None:
        """Axis (3,) about which the rotation of X is least certain, and its standard deviation in rad."""
        return None if self.covariance is None else _weakest(self.covariance[:3, :3])

    @property
    def weakest_translation(self) -> tuple[Array, float] | None:
        """Direction (3,) along which the translation of X is least certain, and its standard deviation in m."""
        return None if self.covariance is None else _weakest(self.covariance[3:, 3:])

    def quantile(self, level: float = 0.95) -> float:
        """The d^2 that a share ``level`` of all errors stays below: the squared radius of that ellipsoid."""
        return self.reference.quantile(level)

    def uncertainty_at(
        self,
        points: ArrayLike,
        *,
        robot: ArrayLike | None = None,
        camera: ArrayLike | None = None,
        robot_covariance: ArrayLike | None = None,
        camera_covariance: ArrayLike | None = None,
        points_covariance: ArrayLike | None = None,
    ) -> PointUncertainty:
        """The uncertainty of points that the camera measures, where the calibration carries them.

        Model (`task_space`): to first order, errors of X (or W), of the pose given and of the points independent.

        Parameters
        ----------
        points : (..., 3)
            In camera coordinates, metres.
        robot : (..., 4, 4) or None
            ``base_T_gripper`` when the points were seen. With it the points are expressed at the other end of the robot
            (the base for eye-in-hand, the gripper for eye-to-hand); without, in the parent frame of X (the gripper for
            eye-in-hand, the base for eye-to-hand).
        camera : (..., 4, 4) or None
            ``camera_T_target`` when the points were seen: the same frame as with `robot`, but through the target and
            W, ``W inv(C) p``; needs neither X nor the robot pose.
        robot_covariance, camera_covariance : (6, 6), (..., 6, 6) or None
            Of that pose; None is exact.
        points_covariance : (3, 3), (..., 3, 3) or None
            Noise of the points themselves, in the camera frame.

        Returns
        -------
        PointUncertainty
            ``points`` (..., 3), ``covariance`` (..., 3, 3), ``std`` (..., 3), ``radius_95`` (...), ``frame``. Where
            X (or W) is open (`open_directions`) coordinates that this moves are infinite, the others are as known.

        Raises
        ------
        InputError
            Wrong shapes or numbers; a covariance that is not positive semidefinite, or whose pose is not given; poses
            for a calibration of motions that came without any; an X or W whose covariance is not determined.
        """
        setup = self.setup
        for name, pose, noise in (("robot", robot, robot_covariance), ("camera", camera, camera_covariance)):
            if pose is None and noise is not None:
                raise InputError(f"Expected the pose `{name}` beside `{name}_covariance`, which is that of this pose.")
            if pose is not None and setup is None:
                raise InputError(
                    f"Expected no `{name}`: this calibration is of motions that came without poses, so that X is "
                    "known in its own frame only."
                )
        if robot is not None and camera is not None:
            raise InputError("Give either `robot`, to go through the robot, or `camera`, to go through the target.")
        if camera is not None:
            assert setup is not None
            if self.W is None or self.covariance_W is None:
                raise InputError(
                    "The way through the target needs W and its covariance: calibrate poses with PoseNoise."
                )
            found = through_target(
                self.W,
                self.covariance_W,
                points,
                camera,
                camera_covariance=camera_covariance,
                setup=setup,
                points_covariance=points_covariance,
            )
            if self.opened is None:
                return found
            return found.left_open(moves_of_points(found.points - self.W[:3, 3], self.opened.of_W))
        if self.covariance is None:
            raise InputError("The covariance of X is not determined, and so is that of the points.")
        near = through_X(self.X, self.covariance, points, setup=setup, points_covariance=points_covariance)
        if robot is None:
            if self.opened is None:
                return near
            return near.left_open(moves_of_points(near.points - self.X[:3, 3], self.opened.of_X))
        assert setup is not None
        found = through_robot(
            self.X,
            self.covariance,
            points,
            robot,
            robot_covariance=robot_covariance,
            setup=setup,
            points_covariance=points_covariance,
        )
        if self.opened is None:
            return found
        R = np.asarray(robot, dtype=float)[..., :3, :3]
        R = R if setup == "eye-in-hand" else R.mT
        return found.left_open(moves_of_points(near.points - self.X[:3, 3], self.opened.of_X, R))


def deviations_of(covariance: Array, opened: OpenDirections | None, of: str) -> Array:
    """Standard deviations (6,) of X or W, infinite for components that move along what is open."""
    std = np.sqrt(np.diag(covariance))
    if opened is None:
        return np.asarray(std)
    basis = opened.of_X if of == "X" else opened.of_W
    return np.where(moves_along(basis, opened.lever), np.inf, std)


def _weakest(covariance: Array) -> tuple[Array, float]:
    deviations, axes = principal_axes(covariance)
    return axes[0], float(deviations[0])
