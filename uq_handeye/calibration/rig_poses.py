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
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from scipy.linalg import svd
from scipy.special import chdtrc

from ..core.files.records import Record
from ..core.geometry.se3 import Array, block, inverse, skew
from ..core.levels import IMPOSSIBLE
from ..core.presentation.numbers import times_of_noise
from ..errors import InputError
from ..findings import Finding, step_after, texts
from ..fit.diagnostics.optimality import Optimality
from ..fit.diagnostics.paths import RigPath
from ..fit.graph.fit import onto_closed
from ..fit.graph.posterior import Posterior
from ..fit.graph.reference import Reference
from ..fit.graph.robust import is_weak_minority
from ..model.poses.estimated_pose import EstimatedPose
from ..model.poses.pose_numbers import ranges
from ..model.poses.pose_pairs import Names, PosePairs
from ..model.rig.description import WORLD, Rig
from .accuracy import amounts
from .checks import Check, in_order
from .parts import Provenance
from .report.facts import Facts, facts_of_rig
from .rig_statement import PointAhead, checks_of_rig, points_ahead
from .stored_result import NOT_USABLE

# The residuals contradict the model, whatever the size of the noise, where chi-square over its degrees of freedom
# exceeds this.
MAX_CHI_SQUARE_RATIO = 10.0
# Noise that was given is refuted from residuals on that are larger by this factor, where that is no chance.
MIN_REFUTED_RATIO = 1.3


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

    # ------------------------------------------------------------------------------------------- text

    @property
    def p_value(self) -> float:
        """Probability of a larger chi-square if the noise is right."""
        return float(chdtrc(self.dof, self.chi_square)) if self.dof > 0 else float("nan")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences of the findings that are more than a note."""
        return texts(self.findings)

    @property
    def headline(self) -> str:
        """Accuracy of the cameras in one sentence; or ``NOT USABLE:`` and the decisive reason."""
        if self.reasons:
            return f"{NOT_USABLE}: {self.reasons[0]}."
        if len(self.open):
            names = ", ".join(one.name for one in self.singles if len(one.open))
            count = "1 direction" if len(self.open) == 1 else f"{len(self.open)} directions"
            return f"Not determined: {count}, of {names}. The robot poses turn about too few axes."
        turns, shifts = zip(*(one.sizes for one in self.cameras.values()), strict=True)
        known = f"{amounts(max(shifts), max(turns))} (1 sigma, worst direction)"
        if len(self.cameras) == 1:
            (one,) = self.cameras.values()
            return f"{one.frame} is known to {known}."
        count = "Both" if len(self.cameras) == 2 else f"All {len(self.cameras)}"
        return f"{count} cameras are known to {known} or better."

    @property
    def status(self) -> str:
        """Status of the headline: "failed" where the poses are not usable, "caution" where something is found, "ok"."""
        if self.reasons:
            return "failed"
        return "caution" if any(check.status in ("caution", "failed") for check in self.checks) else "ok"

    @property
    def cautions(self) -> tuple[Finding, ...]:
        """The findings that are more than a note, in the order of their effect on the poses."""
        return in_order(self.findings)

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """The checks of views and fit, one line each: ok, caution, failed or not run."""
        return checks_of_rig(self)

    @cached_property
    def points_ahead(self) -> dict[str, PointAhead]:
        """The error of a point straight ahead of each camera, at the distance of its targets."""
        return points_ahead(self)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the errors may be larger than stated: checks that failed, of poses that can be used."""
        return tuple(f"check failed: {one.name} ({one.text})" for one in self.checks if one.status == "failed")

    @property
    def advice(self) -> str | None:
        """The next step about the findings, None where there is nothing to do."""
        step = step_after(self.cautions)
        if step is None and self.noise_refuted:
            step = "leave the noise out, it is then estimated; look at the files, and what each camera and target is on"
        return None if step is None else step.rstrip(".")

    @property
    def is_stated(self) -> bool:
        """True if the accuracy is known: of several poses always."""
        return True

    @property
    def remedy(self) -> str | None:
        """Remedy of what was found, None where nothing has one."""
        return self.advice

    @property
    def open_words(self) -> tuple[str, ...]:
        """Names of the poses that are not determined in all directions."""
        return tuple(one.name for one in self.every if len(one.open))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the poses cannot be used; empty where they can."""
        return self.contradictions

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Reasons why the poses cannot be used, none of which more views mend."""
        found = [finding.phrase for finding in self.cautions if finding.severity == "failure"]
        if not found and self.noise_refuted:  # what moved makes them larger, too
            ratio = float(np.sqrt(self.chi_square / self.dof))
            found.append(f"{times_of_noise(ratio)} (chi-square {self.chi_square:.0f} of {self.dof:.0f})")
        for (camera, target), (kept, count) in self._kept.items():
            if is_weak_minority(kept, count):
                found.append(f"{count - kept} of {count} views of {target} by {camera} contradict the others")
        if len(self.rejected) > 0.5 * len(self.weights):
            found.append(f"{len(self.rejected)} of {len(self.weights)} views contradict the others")
        return tuple(found)

    @property
    def noise_refuted(self) -> bool:
        """True if the residuals are larger than the noise explains, by more than chance."""
        ratio = self.chi_square / self.dof if self.dof > 0 else 0.0
        refuted = not self.components and ratio > MIN_REFUTED_RATIO**2 and self.p_value < IMPOSSIBLE.probability
        return refuted or ratio > MAX_CHI_SQUARE_RATIO

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
    def usable(self) -> bool:
        """True if the poses can be used, and are determined in all directions."""
        return self.answered == "whole"

    @property
    def answered(self) -> Literal["whole", "in part", "no"]:
        """``whole``: all directions are determined. ``in part``: `open` are not. ``no``: see `reasons`."""
        if self.reasons:
            return "no"
        return "in part" if len(self.open) else "whole"

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
        """What is rejected, in words: of each pair of target and camera, and of each arm."""
        of: dict[str, list[Any]] = {}
        for camera, target, moment in self.rejected:
            of.setdefault(f"{target} by {camera}", []).append(moment)
        for arm, moment in self.rejected_poses:
            of.setdefault(arm, []).append(moment)
        lines = []
        for what, moments in of.items():
            numbered = {type(moment) for moment in moments} == {int}
            at = ranges(sorted(moments)) if numbered else ", ".join(map(str, moments))
            lines.append(f"{what} at {at}")
        return lines

    @cached_property
    def facts(self) -> Facts:
        """Facts that the views of the result select from: text, page, notebook, certificate, panel, JSON."""
        residuals = self.chi_square, self.dof, self.p_value
        return facts_of_rig(
            list(self.cameras.values()),
            self.points_ahead,
            {one.frame: one for one in self.every} | {one.name: one for one in self.split},
            self.reference,
            residuals,
            self.noise,
            self.components,
        )

    @property
    def relative_poses(self) -> dict[str, EstimatedPose]:
        """`pairs` by their frames."""
        return {one.frame: one for one in self.pairs}


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

    In rad and m, orthonormal in units of the rig.
    """
    if not len(U):
        return np.zeros((0, 6))
    units = np.repeat([lever, 1.0], 3)
    moved = (U @ by.T) * units
    _, s, V = svd(moved, full_matrices=False)
    return np.asarray(V[s > 1e-6] / units)  # smaller parts, in units of the rig, are none
