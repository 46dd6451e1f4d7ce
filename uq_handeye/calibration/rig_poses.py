r"""All poses of a rig with their joint covariance, and relative poses from it.

``T_ij = T_i^-1 T_j`` of two poses on one carrier has the error, in the frame of i,

    xi = -R_i^T (theta_i, tau_i - [t_j - t_i]x theta_i) + R_i^T (theta_j, tau_j)                        (T18)

so that its covariance needs the block between i and j of the joint covariance.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Annotated, Any, ClassVar

import numpy as np
from scipy.linalg import svd
from scipy.special import chdtrc

from ..core.files.records import Record
from ..core.geometry.se3 import Array, block, inverse, skew
from ..core.limits import MAX_LISTED
from ..errors import InputError
from ..findings import Finding, texts
from ..fit.diagnostics.optimality import Optimality
from ..fit.diagnostics.paths import RigPath
from ..fit.graph.fit import onto_closed
from ..fit.graph.open_directions import MIN_OPEN_PART
from ..fit.graph.posterior import Posterior
from ..fit.graph.reference import Reference
from ..model.poses.estimated_pose import EstimatedPose
from ..model.poses.pose_numbers import ranges
from ..model.poses.pose_pairs import Names, PosePairs
from ..model.rig.description import WORLD, Rig
from .parts import Provenance


@dataclass(frozen=True, eq=False)
class RigPoses(Record):
    """All poses of a rig with their joint covariance.

    Attributes
    ----------
    rig : Rig
    names : tuple of str
        The unknown poses in the order of ``poses`` and of the blocks of ``covariance``: cameras, targets, bases.
    poses : (m, 4, 4)
    covariance : (6m, 6m)
        Joint, of the errors ``(theta, tau)`` of each; see `block`.
    open : (k, 6m)
        Directions that the views leave open, rad and m; the covariance is 0 along them.
    lever : float
        The length that makes an angle a length (m).
    chi_square, dof : float
        Of the residuals against the noise.
    method : str
        ``efficient`` or ``ml``.
    weights : (E,)
        Robust weights of the views, in their order.
    distances : (E,)
        Squared distances of the views in units of their covariance.
    pose_weights : (R,)
        Robust weights of the robot poses, in the order of ``pose_names``.
    pose_names : tuple
        Arm and name, or time, of each robot pose.
    noise : mapping
        Standard deviations per axis (rad, m) by arm and camera.
    components : tuple of mappings
        Sizes of all errors, where they were estimated; ``logs``: differences of their logarithms at points of the
        posterior of the sizes.
    size_weights : (d,)
        Weights of these points.
    paths : tuple of RigPath
        Two estimates of one pose each, with the chi-square of their difference: a large one shows a pose that moved.
    optimality : Optimality
        Whether the estimate is proven to be the global minimum.
    reference : Reference
        Distribution of intervals.
    findings : tuple of Finding
    posterior : Posterior or None
        Joint posterior of all poses and of the errors that measurements share, with the noise of new ones, by arm and
        camera.
    provenance : Provenance or None
        Versions of the software, and the arguments of `calibrate_rig`.
    split : tuple of EstimatedPose
        Where a camera or target moved: all poses of the fit with it as two, before and after (`split_rig`).
    about : dict of str to str
        Title block of the report: cell, robot, cameras, serial numbers, ... (`files.about.ABOUT`).
    """

    rig: Rig
    names: tuple[str, ...]
    poses: Annotated[Array, "m", 4, 4]
    covariance: Annotated[Array, "p", "p"]
    open: Annotated[Array, "k", "p"]
    lever: float
    chi_square: float
    dof: float
    method: str
    weights: Annotated[Array, "E"]
    distances: Annotated[Array, "E"]
    pose_weights: Annotated[Array, "R"]
    pose_names: tuple[tuple[str, Hashable], ...]
    noise: dict[str, tuple[float, float]]  # standard deviations per axis (rad, m) by arm and camera
    components: tuple[dict[str, Any], ...] = ()  # sizes of all errors, where they were estimated
    size_weights: Annotated[Array, "d"] = field(default_factory=lambda: np.zeros(0))
    paths: tuple[RigPath, ...] = ()
    optimality: Optimality = field(default_factory=Optimality)
    reference: Reference = field(default_factory=Reference)
    findings: tuple[Finding, ...] = ()
    posterior: Posterior | None = None
    provenance: Provenance | None = None
    split: tuple[EstimatedPose, ...] = ()
    about: dict[str, str] = field(default_factory=dict)

    # ------------------------------------------------------------------------------------------- poses

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The names of the cameras."""
        return tuple(self.rig.cameras)

    @property
    def target_names(self) -> tuple[str, ...]:
        """The names of the targets."""
        return tuple(self.rig.targets)

    item: ClassVar[str] = "view"  # what was measured

    @property
    def n_measured(self) -> int:
        """Number of views."""
        return self.rig.n_views

    @property
    def camera_poses(self) -> dict[str, Array]:
        """X of each camera by its name."""
        return {name: one.pose for name, one in self.cameras.items()}

    @property
    def one_of_each(self) -> Names | None:
        """None: there are several arms, cameras or targets, whose new measurements are views by their names."""
        return None

    def new_measurements(self, poses: PosePairs | Rig) -> Rig:
        """Return new measurements in the form in which they are compared with the result: views of a rig.

        Raises `InputError` for anything else.
        """
        if isinstance(poses, Rig):
            return poses
        raise InputError(f"Expected new views of a rig as a Rig (uq.Rig, uq.read_rig), got {type(poses).__name__}.")

    @cached_property
    def cameras(self) -> Mapping[str, EstimatedPose]:
        """Cameras by name, ``.X`` on their arm or in the world."""
        return {name: self._single(name, f"{self._place(place)}_T_{name}") for name, place in self.rig.cameras.items()}

    @cached_property
    def targets(self) -> Mapping[str, EstimatedPose]:
        """Targets by name, ``.W`` on their arm or in the world."""
        return {name: self._single(name, f"{self._place(place)}_T_{name}") for name, place in self.rig.targets.items()}

    @cached_property
    def arms(self) -> Mapping[str, EstimatedPose]:
        """Bases of the arms by name, ``.base`` in the base of the first, which is exact."""
        first, *others = self.rig.arms
        exact = EstimatedPose(first, f"{first}_T_{first}", np.eye(4), np.zeros((6, 6)))
        return {first: exact} | {name: self._single(name, f"{first}_T_{name}") for name in others}

    @property
    def every(self) -> tuple[EstimatedPose, ...]:
        """All estimated poses: cameras, targets, bases of the arms but the first, relative poses of cameras."""
        return (*self.singles, *self.pairs)

    @property
    def kinematics(self) -> None:
        """Errors of the arm as of one camera: None, they are among the errors of the posterior, by the arm's name."""
        return

    @property
    def singles(self) -> tuple[EstimatedPose, ...]:
        """Cameras, targets, and bases of the arms but the first."""
        return (*self.cameras.values(), *self.targets.values(), *list(self.arms.values())[1:])

    def _place(self, place: str) -> str:
        return "world" if place == WORLD else "gripper" if len(self.rig.arms) == 1 else f"gripper_{place}"

    def _single(self, name: str, frame: str) -> EstimatedPose:
        k = self.names.index(name)
        by = np.eye(len(self.covariance))[6 * k : 6 * k + 6]
        count = sum(len(view.poses) for view in self.rig.views if name in (view.camera, view.target))
        return self._function(name, frame, self.poses[k], by, count)

    def _function(self, name: str, frame: str, pose: Array, by: Array, count: int = 0) -> EstimatedPose:
        opened = open_of(by, self.open, self.lever)
        P = onto_closed(opened, np.repeat([self.lever, 1.0], 3)) @ by
        covariance = P @ self.covariance @ P.T
        return EstimatedPose(name, frame, pose, 0.5 * (covariance + covariance.T), opened, count)

    def block(self, one: str, two: str) -> Array:
        """(6, 6) block of the joint covariance between two poses."""
        i, j = (self._number(name) for name in (one, two))
        return np.asarray(self.covariance[6 * i : 6 * i + 6, 6 * j : 6 * j + 6])

    def _number(self, name: str) -> int:
        if name not in self.names:
            raise InputError(f"Expected the name of one of {', '.join(self.names)}, got {name!r}.")
        return self.names.index(name)

    def relative(self, one: str, two: str) -> EstimatedPose:
        """Return the pose of ``two`` in the frame of ``one``, with the covariance from the joint one.

        Both must have the same carrier: an arm, or the world (bases of arms, too). Raises `InputError` otherwise.
        """
        i, j = self._number(one), self._number(two)
        places = self.rig.place(one), self.rig.place(two)
        if places[0] != places[1]:
            raise InputError(
                f"{one!r} is on {places[0]!r} and {two!r} on {places[1]!r}, so that their relative pose is "
                "not constant."
            )
        pose, by_i, by_j = relative_pose(self.poses[i], self.poses[j])
        by = np.zeros((6, len(self.covariance)))
        by[:, 6 * i : 6 * i + 6] += by_i
        by[:, 6 * j : 6 * j + 6] += by_j
        return self._function(f"{one} to {two}", frame_of_pair(one, two), pose, by)

    @cached_property
    def pairs(self) -> tuple[EstimatedPose, ...]:
        """Relative poses of all pairs of cameras on one carrier."""
        return tuple(self.relative(one, two) for one, two in camera_pairs(self.rig))

    @property
    def relative_poses(self) -> dict[str, EstimatedPose]:
        """`pairs` by their frames."""
        return {one.frame: one for one in self.pairs}

    # ------------------------------------------------------------------------------------------- residuals

    @property
    def p_value(self) -> float:
        """Probability of a larger chi-square if the noise is right."""
        return float(chdtrc(self.dof, self.chi_square)) if self.dof > 0 else float("nan")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences of the findings that are more than a note."""
        return texts(self.findings)

    @cached_property
    def _kept(self) -> dict[tuple[str, str], tuple[int, int]]:
        """Number of views that count, and of all, of each camera and target; those of a rejected robot pose do not."""
        out = set(self.rejected_poses)
        weights, found = iter(self.weights.tolist()), dict[tuple[str, str], tuple[int, int]]()
        for view in self.rig.views:
            arms = [place for place in self.rig.places(view) if place != WORLD]
            count = [next(weights) > 0 and not any((arm, moment) in out for arm in arms) for moment in view.at or ()]
            kept, of_all = found.get((view.camera, view.target), (0, 0))
            found[view.camera, view.target] = (kept + sum(count), of_all + len(count))
        return found

    @property
    def rejected(self) -> tuple[tuple[str, str, Hashable], ...]:
        """Camera, target and moment of the views with weight 0."""
        listed = [(view.camera, view.target, moment) for view in self.rig.views for moment in view.at or ()]
        return tuple(one for one, weight in zip(listed, self.weights.tolist(), strict=True) if weight == 0)

    @property
    def rejected_poses(self) -> tuple[tuple[str, Hashable], ...]:
        """Arm and moment of the robot poses with weight 0."""
        return tuple(one for one, w in zip(self.pose_names, self.pose_weights.tolist(), strict=True) if w == 0)

    @property
    def rejected_words(self) -> list[str]:
        """Rejected views and robot poses in words: of each pair of target and camera, and of each arm."""
        of: dict[str, list[Any]] = {}
        for camera, target, moment in self.rejected:
            of.setdefault(f"{target} by {camera}", []).append(moment)
        for arm, moment in self.rejected_poses:
            of.setdefault(arm, []).append(moment)
        lines = []
        for what, moments in of.items():
            numbered = {type(moment) for moment in moments} == {int}
            more = f" and {len(moments) - MAX_LISTED} more" if len(moments) > MAX_LISTED else ""
            at = ranges(sorted(moments)) if numbered else ", ".join(map(str, moments[:MAX_LISTED])) + more
            lines.append(f"{what} at {at}")
        return lines


def camera_pairs(rig: Rig) -> list[tuple[str, str]]:
    """Return the pairs of cameras whose relative pose is constant: they are on one carrier."""
    return [(one, two) for one, two in combinations(rig.cameras, 2) if rig.cameras[one] == rig.cameras[two]]


def frame_of_pair(one: str, two: str) -> str:
    """Return the frame of the pose of ``two`` in the frame of ``one``."""
    return f"{one}_T_{two}"


def relative_pose(T_i: Array, T_j: Array) -> tuple[Array, Array, Array]:
    """Return ``T_i^-1 T_j`` and its derivatives (6, 6) by the errors of both."""
    R = T_i[:3, :3].T
    by_i = -block(R, 0.0, -R @ skew(T_j[:3, 3] - T_i[:3, 3]), R)
    return inverse(T_i) @ T_j, by_i, block(R, 0.0, 0.0, R)


def open_of(by: Array, U: Array, lever: float) -> Array:
    """(j, 6) directions of a function, whose derivatives are ``by`` (6, p), that the open ones U (k, p) move.

    In rad and m, orthonormal in units of the rig; smaller parts than `MIN_OPEN_PART`, in these units, are none.
    """
    if not len(U):
        return np.zeros((0, 6))
    units = np.repeat([lever, 1.0], 3)
    moved = (U @ by.T) * units
    _, s, V = svd(moved, full_matrices=False)
    V[np.abs(V) < MIN_OPEN_PART] = 0.0
    return np.asarray(V[s > MIN_OPEN_PART] / units)
