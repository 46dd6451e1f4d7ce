"""X and W with their covariances: frames, standard deviations, other forms of the same pose, points that it carries."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..core.files.records import Record
from ..core.geometry import conventions
from ..core.geometry.frames import SETUPS, TARGETS
from ..core.geometry.pose_numbers import principal_axes
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array, inverse, inverse_jacobian
from ..errors import InputError, require_type
from ..findings import Finding, texts
from ..fit.diagnostics.budget import Budget, budget_of_posterior
from ..fit.diagnostics.result import Diagnostics
from ..fit.diagnostics.split_half import SplitHalf
from ..fit.diagnostics.task_space import Link, PointUncertainty, by_pose, frames_of, moves_of_points, through
from ..fit.graph.open_directions import OpenDirections, moves_along
from ..fit.graph.points import OpenSizes
from ..fit.graph.posterior import Posterior
from ..methods.paper_covariances import PAPER_SCALE
from ..methods.scaled import octonion
from ..methods.scaled_sensitivity import pose_from_octonion_jacobian
from ..model.errors.error_estimate import ErrorEstimate
from ..model.errors.key import ErrorKey, Kind, Owner
from ..model.errors.models import Noise
from ..model.poses.estimated_pose import EstimatedPose
from ..model.poses.motions import Motions
from ..model.poses.pose_pairs import NAMES, Names, PosePairs
from ..model.rig.description import Rig
from ..model.rig.single import poses_like
from .analysis import Analysis, StoredAnalysis
from .error_of_X import moved, points_of, tails_of
from .parts import PARTS, Errors, Named, Origin, Quality, Solution

# Components of an undetermined direction below this share of the largest are left out of the words.
NEGLIGIBLE_SHARE = 0.02


@dataclass(frozen=True, eq=False, init=False)
class Estimated(Named, Record):
    """X and W, their data, and quantities that follow from these only.

    The attributes are described with `Calibration`.
    """

    X: Array  # (4, 4)
    covariance: Array | None  # (6, 6); None: not determined, no noise was given
    W: Array | None  # (4, 4), the mean of G X C: base_T_target (gripper_T_target for eye-to-hand)
    covariance_W: Array | None  # (6, 6), as `covariance`, in the parent frame of W; needs noise on the poses
    opened: OpenDirections | None  # what of X and W the motions leave open
    findings: tuple[Finding, ...]
    origin: Origin
    solution: Solution
    errors: Errors
    quality: Quality

    def __init__(self, X: Array, **values: Any) -> None:
        """``values``: the other attributes, also those of the parts by their names; None or empty where not given."""
        vars(self).update(X=X, covariance=None, W=None, covariance_W=None, opened=None, findings=())
        vars(self).update({name: values.pop(name) for name in vars(self).keys() & values.keys()})
        for part, kind in PARTS.items():
            named = {one.name: values.pop(one.name) for one in fields(kind) if one.name in values}
            held = values.pop(part, None)
            vars(self)[part] = kind(**named) if held is None else replace(held, **named)
        if values:
            raise TypeError(f"{type(self).__name__}() got an unexpected keyword argument {min(values)!r}")
        self.__post_init__()

    @property
    def components(self) -> tuple[ErrorEstimate, ...]:
        """All errors of the joint model, with their sizes and their effects on X; empty where the noise was given."""
        return () if self.noise_estimate is None else self.noise_estimate.of_model

    @property
    def posterior(self) -> Posterior | None:
        """Joint posterior of X, W and the errors that all poses share, with uncertain sizes; None if X has open
        directions.

        `predict`, `check`, `verify`, `update`, `difference` and `plan` read it.
        """
        held = self.joint_posterior
        return held.posterior if isinstance(held, OpenSizes) else held

    @cached_property
    def shared(self) -> tuple[ErrorEstimate, ...]:
        """Errors that all poses share, with the standard deviations of the posterior, sizes integrated over."""
        if not isinstance(self.joint_posterior, OpenSizes):
            return self.shared_at_sizes
        of = self.joint_posterior.posterior
        sd = dict(zip(of.keys, np.sqrt(np.maximum(np.diag(of.covariance)[of.p :], 0.0)).tolist(), strict=True))
        return tuple(replace(error, sd=sd.get(error.key, error.sd)) for error in self.shared_at_sizes)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Texts of the findings that are more than a note, one sentence or more each."""
        return texts(self.findings)

    @property
    def efficiency(self) -> Array | None:
        """Standard deviations (6,) of 4DPA, as multiples of the Cramer-Rao bound; infinite where the bound is 0."""
        if self.fourdpa is None or self.fourdpa.covariance is None or self.bound is None:
            return None
        least, found = np.diag(self.bound), np.full(6, np.inf)  # of a direction that is open the bound may be 0
        np.divide(np.diag(self.fourdpa.covariance), least, out=found, where=least > 0)
        return np.asarray(np.sqrt(found))

    @property
    def diagnostics(self) -> Diagnostics:
        """Observability, influence, tests of the residuals, systematic errors: see `Diagnostics`."""
        return self._analysed().diagnostics

    @property
    def covariances(self) -> dict[str, Array | None]:
        """Covariances (6, 6) of X by name: that of the noise model, and those that need none; None: not determined."""
        return self._analysed().covariances

    @property
    def split_half(self) -> SplitHalf:
        """Comparison of X from the even rows with X from the odd rows."""
        return self._analysed().split_half

    @property
    def split_in_time(self) -> SplitHalf:
        """Comparison of X from the first rows with X from the last rows, which detects drift."""
        return self._analysed().split_in_time

    @property
    def budget(self) -> Budget:
        """Shares of the variance by source, from the posterior, including measurements by which it was updated."""
        if not (self._taken_in and self.has_budget):
            return self._analysed().budget
        assert self.posterior is not None
        touched = "evidence.touches_used" in self._taken_in
        noise = ErrorKey(Owner.ALL, Kind.POSES_AND_TOUCHES if touched else Kind.POSES)
        dof = math.inf if self.reference.dof is None else self.reference.dof
        sd = {error.key: error.size for error in self.shared}
        return budget_of_posterior(self.posterior, sd, self.X, noise, dof)

    @property
    def has_budget(self) -> bool:
        """True if the contributions to the covariance are known."""
        if self._taken_in:
            return self.posterior is not None
        return self.analysis is not None

    @property
    def _taken_in(self) -> set[str]:
        """Codes of the findings about measurements that the posterior took in, and the analysis of the poses lacks."""
        return {finding.code for finding in self.findings} & {"evidence.touches_used", "maintenance.by_posterior"}

    def _analysed(self) -> Analysis | StoredAnalysis:
        if self.analysis is None:
            raise InputError(
                f"This is known for the methods efficient and ml where there is noise, not for this result of "
                f"{self.method!r}."
            )
        return self.analysis

    @property
    def used(self) -> tuple[PosePairs | Motions, Noise]:
        """Data and noise of which X is the plain fit: the poses that count, the noise of each divided by its weight.

        `monte_carlo`, `sample_posterior` and `cross_check`, given the calibration itself, start from these, so
        that all of them speak of this X. Raises `InputError` where there are no poses or there is no noise.
        """
        data = self.counted
        if data is None or self.noise is None:
            lacks = "no poses: its file holds none" if data is None else "no noise: none was found"
            raise InputError(f"This calibration holds {lacks}.")
        weight = None if self.table is None else self.table.weight[self.table.counted]
        if weight is None or (weight == 1).all():
            return data, self.noise
        kept = np.flatnonzero(weight > 0)
        return data.rows(kept), self.noise.rows(kept).weighted(weight[kept])

    @property
    def frame(self) -> str:
        """The frames of X, e.g. ``gripper_T_camera``."""
        return "X" if self.setup is None else SETUPS[self.setup]

    @property
    def frame_W(self) -> str:
        """The frames of W, e.g. ``base_T_target``."""
        return "W" if self.setup is None else TARGETS[self.setup]

    @property
    def names(self) -> Names:
        """Names of arm, camera and target."""
        return NAMES if self.data is None or self.data.poses is None else self.data.poses.names

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The name of the camera, as of a rig of several."""
        return (self.names.camera,)

    @property
    def target_names(self) -> tuple[str, ...]:
        """The name of the target, as of a rig of several."""
        return (self.names.target,)

    item: ClassVar[str] = "pose"  # what was measured

    @property
    def n_measured(self) -> int:
        """Number of poses that count, of motions alone that of pairs."""
        return self.n_pairs if self.n_poses is None else self.n_poses

    @property
    def camera_poses(self) -> dict[str, Array]:
        """X by the name of the camera, also where its covariance is not known."""
        return {self.names.camera: self.X}

    @property
    def one_of_each(self) -> Names | None:
        """Names of arm, camera and target, whose new poses come side by side; None for several, which have views."""
        return self.names

    def new_measurements(self, poses: PosePairs | Rig) -> PosePairs:
        """Return new measurements in the form in which they are compared with the result: poses side by side.

        Raises `InputError` for a rig of other parts, and for anything else.
        """
        if isinstance(poses, Rig):
            return poses_like(poses, self.names)
        require_type("poses", poses, PosePairs, "PosePairs")
        return poses

    @cached_property
    def cameras(self) -> dict[str, EstimatedPose]:
        """The camera by its name, as of a rig of several: ``.X`` with its covariance. Empty if that is not known."""
        return self._by_name(self.names.camera, self.frame, self.X, self.covariance)

    @cached_property
    def targets(self) -> dict[str, EstimatedPose]:
        """The target by its name: ``.W`` with its covariance. Empty if that is not known."""
        return self._by_name(self.names.target, self.frame_W, self.W, self.covariance_W)

    @cached_property
    def arms(self) -> dict[str, EstimatedPose]:
        """The arm by its name: its base, which is the world and exact."""
        arm = self.names.arm
        return {arm: EstimatedPose(arm, f"{arm}_T_{arm}", np.eye(4), np.zeros((6, 6)))}

    def _by_name(self, name: str, frame: str, pose: Array | None, covariance: Array | None) -> dict[str, EstimatedPose]:
        if pose is None or covariance is None:
            return {}
        opened, none = self.opened, np.zeros((0, 6))
        of = none if opened is None else opened.of_X if pose is self.X else opened.of_W
        return {name: EstimatedPose(name, frame, pose, covariance, of, self.n_poses or 0)}

    @property
    def pairs(self) -> tuple[EstimatedPose, ...]:
        """Relative poses of all pairs of cameras on one carrier: of one camera none."""
        return ()

    def relative(self, one: str, two: str) -> EstimatedPose:
        """Return the pose of ``two`` in the frame of ``one``, which must have the same carrier.

        Of one camera that is a pose in its own frame; a rig of several has others. Raises `InputError` otherwise.
        """
        known = (*self.names,)
        for name in (one, two):
            if name not in known:
                raise InputError(f"Expected the name of one of {', '.join(known)}, got {name!r}.")
        if one != two:
            raise InputError(
                f"{one!r} and {two!r} are not on one carrier, so that their relative pose is not constant."
            )
        return EstimatedPose(one, f"{one}_T_{one}", np.eye(4), np.zeros((6, 6)))

    @property
    def std(self) -> Array | None:
        """Standard deviations (6,) of (theta, tau), rad and m; infinite for components in an open direction."""
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
        """(k, 12): directions of (xi_X, xi_W) that the motions leave open, (theta, tau) of X, then of W, rad and m.

        Orthonormal in units of the rig: angles times ``opened.lever``, the distance of camera and target. k = 0 where
        nothing is open.
        """
        return np.zeros((0, 12)) if self.opened is None else self.opened.basis

    @property
    def open_of_X(self) -> Array | None:
        """(j, 6): open directions of X; None: X is determined."""
        return None if self.opened is None else self.opened.of_X

    @property
    def open_of_W(self) -> Array | None:
        """(j, 6): open directions of W; None: W is determined."""
        return None if self.opened is None else self.opened.of_W

    @property
    def open_words(self) -> tuple[str, ...]:
        """Description of each open direction."""
        if self.opened is None:
            return ()
        if self.translation_open:
            return ("the positions of camera and target",)
        return tuple(open_words(one, self.setup) for one in self.opened.single().tolist())

    @property
    def translation_open(self) -> bool:
        """True if nothing is known of the translations of X and W: no positions were given."""
        return self.opened is not None and len(self.opened.basis) == 6 and not self.opened.basis[:, [0, 1, 2]].any()

    @property
    def correlation(self) -> Array | None:
        """Correlation matrix (6, 6) of (theta, tau); 0 for components with a variance of 0."""
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

    @cached_property
    def error_points(self) -> Array:
        """(N, 6) errors of X drawn from its distribution (`error_of_X`), of which all statements for 95 % are made.

        Raises `InputError` where the covariance of X is not determined.
        """
        if self.covariance is None:
            raise InputError("The covariance of X is not determined, and so is the distribution of its errors.")
        return points_of(self.covariance, self.reference, self.posterior if self.covariance_kind == "model" else None)

    @cached_property
    def tails(self) -> float:
        """Ratio of the 95 % radius of a point to that of Gaussian errors of the same covariance.

        It is that of a point at the distance of the target; infinite where too few poses determine no such radius.
        """
        if self.covariance is None or not self.reference.determined:
            return math.inf
        arm = self.X[:3, 2] * distance_of(self.analysis)[0]
        J = by_pose(arm)
        return tails_of(moved(self.error_points, arm), J @ self.covariance @ J.T)

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
        """The uncertainty of points that the camera measures, in the frame to which the calibration transforms them.

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
        opened, R, (parent, far) = self.opened, None, frames_of(setup)
        if camera is not None:
            if self.W is None or self.covariance_W is None:
                raise InputError(
                    "The way through the target needs W and its covariance: calibrate poses with PoseNoise."
                )
            links = [Link("camera", camera, camera_covariance, inverted=True), Link("W", self.W, self.covariance_W)]
            found = through(links, points, far, points_covariance, self.tails)
            if opened is None:
                return found
            return found.left_open(moves_of_points(found.points - self.W[:3, 3], opened.of_W))
        if self.covariance is None:
            raise InputError("The covariance of X is not determined, and so is that of the points.")
        X = Link("X", self.X, self.covariance)
        found = near = through([X], points, parent, points_covariance, self.tails)
        if robot is not None:
            of_robot = Link("robot", robot, robot_covariance, inverted=setup == "eye-to-hand")
            found = through([X, of_robot], points, far, points_covariance, self.tails)
            R = np.asarray(robot, dtype=float)[..., :3, :3]
            R = R if setup == "eye-in-hand" else R.mT
        if opened is None:
            return found
        return found.left_open(moves_of_points(near.points - self.X[:3, 3], opened.of_X, R))


def deviations_of(covariance: Array, opened: OpenDirections | None, of: str) -> Array:
    """Standard deviations (6,) of X or W, infinite for components with a part in an open direction."""
    std = np.sqrt(np.diag(covariance))
    if opened is None:
        return np.asarray(std)
    basis = opened.of_X if of == "X" else opened.of_W
    return np.where(moves_along(basis, opened.lever), np.inf, std)


def _weakest(covariance: Array) -> tuple[Array, float]:
    deviations, axes = principal_axes(covariance)
    return axes[0], float(deviations[0])


def open_words(direction: Sequence[float], setup: str | None) -> str:
    """One open direction (12) of X and W, e.g. "the camera along the gripper's z axis, with the target along ..."."""
    frames = {"eye-in-hand": ("gripper", "base"), "eye-to-hand": ("base", "gripper"), None: ("frame of A", "")}[setup]
    of_X, of_W = direction[:6], direction[6:]
    size = max(map(abs, [*direction[3:6], *direction[9:]])) or 1.0
    parts = [
        f"{what} {_movement(xi, frame)}"
        for what, xi, frame in (("the camera", of_X, frames[0]), ("the target", of_W, frames[1]))
        if max(map(abs, xi)) > NEGLIGIBLE_SHARE * size
    ]
    return " together with ".join(parts)


def _movement(xi: Sequence[float], frame: str) -> str:
    turns = math.hypot(*xi[:3]) > NEGLIGIBLE_SHARE * math.hypot(*xi[3:])
    axis = xi[:3] if turns else xi[3:]
    length = math.hypot(*axis) or 1.0
    unit = [x / length for x in axis]
    largest = max(range(3), key=lambda k: abs(unit[k]))
    how = "about" if turns else "along"
    if abs(unit[largest]) > 1.0 - NEGLIGIBLE_SHARE**2:
        return f"{how} the {frame}'s {'xyz'[largest]} axis"
    sign = 1.0 if unit[largest] > 0 else -1.0
    return f"{how} ({', '.join(f'{sign * x:.2f}' for x in unit)}) of the {frame}"


def distance_of(analysis: Analysis | StoredAnalysis | None) -> tuple[float, bool]:
    """Return the RMS distance from camera to target (m); False: it is not known, and a usual one is taken."""
    if analysis is not None:
        spectrum = analysis.diagnostics.spectrum
        if spectrum.length_of == "target":
            return float(spectrum.length_m), True
    return 0.5, False
