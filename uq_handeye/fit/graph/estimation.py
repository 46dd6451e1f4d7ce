r"""Noise and shared errors of one data set, estimated together: the components of a request, their sizes, the noise.

Every error that a request declares or leaves to the data is an `ErrorTerm`: the noise of both sides, that of camera
poses by their corners or their views, the errors that all poses share (`SharedError`), the arm. Their sizes are
estimated jointly (`mode`), near the unknowns that robust weights start from; at the end they are integrated over
(`integration`). The result is a `PoseNoise` with the estimated sizes and named columns, and the contribution of the
uncertain sizes to the covariance of X and W.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from ...core.geometry.se3 import Array
from ...core.levels import INTERVAL
from ...core.rounding import FIT_ROUNDING, SOLUTION_ROUNDING, THIRD_DIGITS
from ...errors import InputError
from ...model.errors.camera_noise import CameraNoise
from ...model.errors.cholesky import symmetric_factor
from ...model.errors.columns import MANY_POSES, Columns, as_columns, scaled, side_by_side, squares, turned
from ...model.errors.joint_covariance import JointCovariance
from ...model.errors.key import ErrorKey, Kind, Owner
from ...model.errors.keys import (
    BY_VIEW,
    CAMERA_EXCESS,
    DEPTH,
    INTRINSICS,
    PICTURE_SHIFT,
    ROBOT_SHARED,
    SCENE_EXCESS,
    SCENE_FEATURES,
)
from ...model.errors.models import Noise, PairNoise, PoseNoise, marginals
from ...model.errors.pose_prior import PosePrior
from ...model.errors.sizes import BY_NAME, SIZES, Size
from ...model.errors.square_roots import Covariance
from ...model.errors.term import ErrorTerm
from ...model.kinematics.kinematic_errors import DECLARED_AS
from ...model.poses.pose_pairs import PosePairs
from ...model.shared_errors.in_noise import errors_of_arm
from ...model.shared_errors.shared_error import SharedError
from ...model.shared_errors.view import lines_of_sight, view_block
from .constraint import Constraint, Unknowns
from .engine import LatentModel
from .integration import Mixture, integrate
from .mode import GAIN, ROUGH_GAIN, Mode, find_mode
from .reduced_rows import Reduced, reduce_rows
from .search import Linear, search

KINDS = (Kind.ROTATION, Kind.TRANSLATION)
# At most this many poses, evenly spread over the rows, are used to estimate the sizes; and as long as unknowns and
# robust weights are not final, by which rows are judged.
MAX_POSES_FOR_SIZES, MAX_POSES_FOR_ROUGH_SIZES = 200, 100
# The data do not resolve a size whose logarithm has a posterior standard deviation above this share of its prior one.
MAX_RESOLVED_SPREAD = 0.6
# Half the width of an interval of a normal distribution, in standard deviations.
INTERVAL_SD = float(ndtri(0.5 * (1.0 + INTERVAL.probability)))

_TURN, _SHIFT = np.eye(6)[:, :3], np.eye(6)[:, 3:]


@dataclass(frozen=True, eq=False)
class JointModel:
    """Components of one data set, as declared or left to the data; see the module."""

    constraint: Constraint
    prior: Mapping[ErrorKey, Size] = field(default_factory=dict)  # of the noise, by data sheets
    camera: Covariance | CameraNoise | None = (
        None  # covariance of the camera poses, or CameraNoise; None: to be estimated
    )
    robot: Covariance | None = None  # of the robot poses; None: to be estimated
    errors: tuple[SharedError, ...] = ()  # what all poses share
    poses: PosePairs | None = None
    pose_prior: PosePrior | None = None
    arm: tuple[ErrorTerm, ...] = ()  # errors of an arm by its joints
    excess: JointCovariance | None = None  # of the camera in addition to its covariance from corners, per pixel^2
    shift: Array | None = None  # (n, 6, 2) of the camera where all corners of a picture are shifted, per pixel
    sizes: Mapping[str, Size] = field(default_factory=dict)  # in place of those of the table, by name
    more: tuple[ErrorTerm, ...] = ()  # of the user's own
    by_view: Array | None = None  # (n, 6, 6) noise of the camera by the view; None: that of the poses
    nothing_open: bool = False  # all rows together determine all of X and W: not looked at again
    most_used: int = MAX_POSES_FOR_SIZES  # poses that the sizes are found by
    how: str = ""  # where a known covariance of the camera comes from: "from corners", "from points", "from the scene"

    @classmethod
    def beside(
        cls,
        constraint: Constraint,
        poses: PosePairs | None,
        prior: Mapping[ErrorKey, Size] | None = None,
        camera: Covariance | CameraNoise | None = None,
        robot: Covariance | None = None,
        errors: tuple[SharedError, ...] = (),
        **others: Any,
    ) -> JointModel:
        """Build the model of poses; ``camera`` None takes the covariance that the camera poses come with.

        Raises `InputError` for a prior of a side that is known.
        """
        how, excess, shift = "", None, None
        if camera is None and poses is not None and poses.known_camera is not None:
            camera = poses.known_camera
            how = "from points" if poses.camera_calibration is None else "from corners"
            if poses.scene is not None:
                how, excess = "from the scene", poses.camera_covariance
            if poses.camera_calibration is not None:
                excess, shift = poses.camera_calibration.per_pixel, poses.camera_calibration.by_shift
        prior = prior or {}
        if camera is not None and any(key.owner == Owner.CAMERA for key in prior):
            known = (
                "but for that of their pixels" if isinstance(camera, CameraNoise) else how.replace("from", "from their")
            )
            raise InputError(
                f"Expected a `prior` for the robot only: the noise of the camera poses is known {known}.".replace(
                    " .", "."
                )
            )
        return cls(constraint, prior, camera, robot, errors, poses, excess=excess, shift=shift, how=how, **others)

    @property
    def sides(self) -> tuple[str, str]:
        """Names of the sides: robot and camera, or A and B."""
        return self.constraint.sides

    @property
    def of_scene(self) -> bool:
        """True if the camera poses come from pictures of a scene."""
        return self.how == "from the scene"

    @cached_property
    def components(self) -> tuple[ErrorTerm, ...]:
        """All components with something to move; raises `InputError` for a size of none of them."""
        found = [*self._noise(), *self._shared(), *self.arm, *self.more]
        names = [part.name for part in found]
        if unknown := [name for name in self.sizes if name not in names]:
            near = get_close_matches(unknown[0], names, 3, 0.3) or names
            absent = "that is known, but not here" if unknown[0] in BY_NAME else "of no known error"
            raise InputError(
                f"Expected sizes of errors of this request, got {unknown[0]!r}, a name {absent}. Near it: "
                f"{', '.join(near)}."
            )
        return tuple(self._sized(part) for part in found)

    def _sized(self, part: ErrorTerm) -> ErrorTerm:
        """Return a component with the size that was given for it; of shared errors that of their first number."""
        given = self.sizes.get(part.name)
        return part if given is None else replace(part, size=replace(given, unit=given.unit or part.size.unit))

    @cached_property
    def known(self) -> dict[str, Array]:
        """Covariances (6, 6) or (n, 6, 6) that are taken as they are, by side."""
        found = {}
        for side in ("robot", "camera"):
            S = getattr(self, side)
            if S is not None and not isinstance(S, CameraNoise):
                found[side] = S.own if isinstance(S, JointCovariance) else marginals(S)
        return found

    def _noise(self) -> list[ErrorTerm]:
        found = []
        for k, side in enumerate(("robot", "camera")):
            if getattr(self, side) is not None:
                continue
            sheet = {key.kind: size for key, size in self.prior.items() if key.owner == Owner(side)}
            for what, block in zip(KINDS, (_TURN, _SHIFT), strict=True):
                size = sheet.get(what, SIZES[ErrorKey(Owner(side), what)])
                found.append(ErrorTerm(ErrorKey(Owner(self.sides[k]), what), side, size, block=block))
            if side == "camera" and self.poses is not None and not sheet:
                block = view_block(self.poses.camera) if self.by_view is None else self.by_view
                found.append(ErrorTerm(BY_VIEW, side, SIZES[BY_VIEW], block=block))
                found.append(ErrorTerm(DEPTH, side, SIZES[DEPTH], block=lines_of_sight(self.poses.camera)))
        found += self._known_camera()
        if isinstance(self.robot, JointCovariance):
            keys = _keys(self.robot, ROBOT_SHARED)
            found.append(ErrorTerm(ROBOT_SHARED, "robot", Size(1.0), columns=self.robot.columns, keys=keys))
        return found

    def _known_camera(self) -> list[ErrorTerm]:
        S = self.camera
        found: list[ErrorTerm] = []
        if isinstance(S, CameraNoise):
            found += S.terms()
        elif isinstance(S, JointCovariance):
            key = SCENE_FEATURES if self.of_scene else INTRINSICS
            found.append(ErrorTerm(key, "camera", Size(1.0), columns=S.columns, keys=_keys(S, key)))
        if self.excess is not None:
            key = SCENE_EXCESS if self.of_scene else CAMERA_EXCESS
            found.append(ErrorTerm(key, "camera", SIZES[key], self.excess.columns, symmetric_factor(self.excess.own)))
        if self.shift is not None:
            found.append(ErrorTerm(PICTURE_SHIFT, "camera", SIZES[PICTURE_SHIFT], block=self.shift))
        return found

    def _shared(self) -> list[ErrorTerm]:
        shared = [error for error in self.errors if not error.is_exact]
        assert self.poses is not None or not shared
        return [] if self.poses is None else [error.term(self.poses) for error in shared]

    # ------------------------------------------------------------------------------------------- estimation

    def find(
        self,
        at: Unknowns,
        weights: Array | None = None,
        start: Array | None = None,
        gain: float = GAIN,
        known: Sequence[Mode] | None = None,
    ) -> FoundSizes:
        """Find the sizes near the unknowns, of the poses of weight above 0.

        ``start`` (k,): logarithms of sizes near them; ``gain``: what a further step may still promise (`find_mode`).
        ``known``: the further modes for almost the same rows, which are followed and not searched for again.

        Raises
        ------
        InputError
            No more residuals than unknowns.
        NotConvergedError
            Unknowns or sizes that do not converge (`search`).
        """
        n = self.constraint.n
        kept = np.arange(n) if weights is None else np.flatnonzero(weights)
        constraint = self.constraint if len(kept) == n else self.constraint.rows(kept)
        self._require_freedom(constraint, constraint.p)
        used = np.arange(len(kept))
        most = self.most_used if gain <= GAIN else min(self.most_used, MAX_POSES_FOR_ROUGH_SIZES)
        if len(kept) > most:
            used = np.unique(np.linspace(0, len(kept) - 1, most).round().astype(np.intp))
        part = constraint.rows(used) if len(used) < len(kept) else constraint
        every = len(used) == n
        components = self.components if every else tuple(one.rows(kept[used]) for one in self.components)
        nothing_open = self.nothing_open and every

        def linear_at(at: Unknowns) -> Linear:
            nonlocal nothing_open
            model, reduced = self._model(part, at, kept[used], components, nothing_open)
            nothing_open = reduced.basis is None
            return Linear(model, reduced)

        first = linear_at(at)
        exact = self._exact(part, first.model)
        if exact.any():
            return FoundSizes(self, *first, find_mode(first.model), at, kept, kept[used], exact)
        self._require_freedom(part, first.model.p)
        found = search(linear_at, Unknowns.moved, at, start, gain, known, first)
        return FoundSizes(self, *found.linear, found.mode, found.at, kept, kept[used], exact, found.others)

    def _require_freedom(self, constraint: Constraint, p: int) -> None:
        dof = 6.0 * constraint.n - p + (0 if self.pose_prior is None else self.pose_prior.rank)
        if dof <= 0:
            raise InputError(
                f"Expected residuals to estimate the noise from, got {dof:g} degrees of freedom. Give more poses, or "
                "the noise."
            )

    def _model(
        self,
        constraint: Constraint,
        at: Unknowns,
        kept: NDArray[np.intp],
        components: tuple[ErrorTerm, ...],
        nothing_open: bool,
    ) -> tuple[LatentModel, Reduced]:
        linear = constraint.linearise(at, constraint.first, constraint.second)
        reduced = reduce_rows(constraint, linear, at, self.pose_prior, nothing_open)
        whole = len(kept) == self.constraint.n
        known: Array | None = None
        for side, D in zip(("robot", "camera"), linear.sides, strict=True):
            if side in self.known:
                S = self.known[side]
                each = D @ (S if S.ndim == 2 or whole else S[kept]) @ D.mT
                known = each if known is None else known + each
        return LatentModel.of(linear, components, reduced.J, known, reduced.known), reduced

    def _exact(self, constraint: Constraint, model: LatentModel) -> NDArray[np.bool_]:
        """(2,) whether the residuals of rotation and translation are rounding."""
        if all(part.size.is_known for part in self.components):
            return np.zeros(2, dtype=bool)
        longest = max(1e-300, *(float(np.abs(T[:, :3, 3]).max()) for T in (constraint.first, constraint.second)))
        size = np.zeros(2)
        for k, rows in enumerate((slice(0, 3), slice(3, 6))):  # noise of one is no residual of the other
            J, r = model.J[:, rows].reshape(-1, model.p), model.r[:, rows].ravel()
            if np.sqrt(np.mean(r * r)) > THIRD_DIGITS * (1.0, longest)[k]:  # squares of them remain, no rounding
                size[k] = np.inf
                continue
            x, _, rank, _ = np.linalg.lstsq(J, r, rcond=None)
            size[k] = np.sqrt(np.mean((r - J @ x) ** 2)) if rank < len(r) else np.inf  # few rows fit in any case
        return np.asarray(size < FIT_ROUNDING * np.array([1.0, longest]))


@dataclass(frozen=True, eq=False)
class FoundSizes:
    """Sizes of one problem, and the noise that they make."""

    source: JointModel
    model: LatentModel
    reduced: Reduced
    mode: Mode
    at: Unknowns  # where the model is linear
    kept: NDArray[np.intp]
    used: NDArray[np.intp]  # numbers of the poses of the model
    exact: NDArray[np.bool_]  # (2,) rotation, translation residuals at rounding level
    others: tuple[Mode, ...] = ()  # modes where an error of one number is in its tail, or out of it (`other_modes`)

    @cached_property
    def mixture(self) -> Mixture:
        """Posterior with the sizes integrated over."""
        return integrate(self.model, [self.mode, *self.others])

    def probability_of(self, key: ErrorKey, beyond: float) -> float:
        """Return the probability that a shared error of one number is larger than ``beyond``, whatever its sign.

        In the unit of the error (relative for the target scale and the focal length), with all sizes integrated over
        and all modes counted by their evidence: ``P(|target scale| > 0.003)`` is that of a target of another size.
        Raises `InputError` for an error without such a number.
        """
        numbers = [k for k, part in enumerate(self.source.components) if part.key == key and part.count == 1]
        if not numbers or beyond < 0:
            single = [part.name for part in self.source.components if part.count == 1]
            raise InputError(
                f"Expected an error of one number ({', '.join(single)}) and `beyond` >= 0, got {str(key)!r}, "
                f"{beyond:g}."
            )
        place, found = self.model.place(numbers[0]), 0.0
        for weight, theta in zip(self.mixture.weights.tolist(), self.mixture.theta, strict=True):
            at = self.model.conditional(theta)
            mean, sd = float(at.mean[place]), float(np.sqrt(at.covariance[place, place]))
            found += weight * float(ndtr((mean - beyond) / sd) + ndtr((-mean - beyond) / sd))
        return found

    def sizes_at(self, theta: Array) -> dict[ErrorKey, float]:
        """Sizes of the errors."""
        sizes = self.model.sizes(theta).tolist()
        return {part.key: size for part, size in zip(self.source.components, sizes, strict=True)}

    @property
    def noise(self) -> Noise | None:
        """Noise of all poses by the most probable sizes, to weigh them by; None: the data are exact.

        Shared errors that the data hardly show (energy below `ROUGH_GAIN`) are noise of each pose here.
        """
        if self.exact.any():
            return None
        turns = self.model.turns(self.mode.theta)
        return self._noise_by(self.sizes_at(self.mode.theta), turns)

    @cached_property
    def integrated_noise(self) -> Noise:
        """Noise of all poses by the mean of the logarithms of the sizes."""
        return self._noise_by(self.sizes)

    @cached_property
    def sizes(self) -> dict[ErrorKey, float]:
        """Sizes of the errors, integrated over."""
        return self.sizes_at(self.mixture.mean_theta)

    @cached_property
    def spreads(self) -> Array:
        """(k,) standard deviations of the logarithms of the free sizes, of which their intervals are made.

        The variance of weighted points is too small by ``1 - sum w^2``, much where few of them count, and these leave
        out tails: it is at least that of the parabola at the mode.
        """
        mixture = self.mixture
        of_points = np.diag(mixture.covariance_theta) / max(1.0 - float(mixture.weights @ mixture.weights), 0.1)
        return np.asarray(np.sqrt(np.maximum(of_points, np.diag(np.linalg.inv(self.mode.state.information)))))

    def _noise_by(self, sizes: dict[ErrorKey, float], turns: Mapping[str, tuple[Array, Array]] | None = None) -> Noise:
        """Noise by sizes; ``turns`` (r, energies) of the columns of a side: those that are faint go to each pose."""
        source = self.source
        sides: dict[str, Covariance | None] = {}
        for side in ("robot", "camera"):
            own: Array | None = source.known.get(side)
            own = None if own is not None and not own.any() else own
            columns: list[Array | Columns] = []
            keys: list[ErrorKey] = []
            for part in source.components:
                if part.side != side:
                    continue
                s = sizes[part.key]
                if part.block is not None:
                    square = part.block @ part.block.mT
                    more = 0.5 * s * s * (square + square.mT)
                    own = more if own is None else own + more
                if part.columns is not None:
                    each = part.columns if source.constraint.n <= MANY_POSES else as_columns(part.columns)
                    sized = turns is None and not isinstance(each, Columns)
                    columns.append(self._sized(part, s) if sized else scaled(each, s))
                    keys += part.keys
            if columns:
                n = source.constraint.n
                each = np.zeros((n, 6, 6)) if own is None else np.broadcast_to(own, (n, 6, 6))
                shared = side_by_side(columns)
                if turns is not None:
                    turn, energy = turns[side]
                    each, keys = each + squares(shared, turn[:, energy < ROUGH_GAIN]), []
                    shared = turned(shared, turn[:, energy >= ROUGH_GAIN])
                sides[side] = JointCovariance(each, shared, tuple(keys))
            else:
                sides[side] = own
        if source.constraint.item == "pose":
            return PoseNoise(sides["robot"], sides["camera"])
        A, B = (None if S is None else np.asarray(S) for S in sides.values())
        return PairNoise(A, B)

    def _sized(self, part: ErrorTerm, size: float) -> Array | Columns:
        """Return columns of one standard deviation of each number, bit by bit as a file computes them (`by_poses`)."""
        error = next((error for error in self.source.errors if error.key == part.key), None)
        assert part.columns is not None
        if error is None or self.source.poses is None:
            return scaled(part.columns, size)
        return error.of_size(size).columns_of_sd(self.source.poses)

    @cached_property
    def of_arm(self) -> dict[Kind, float]:
        """Sizes of the errors of the arm and of the noise of its joints, by kind."""
        return {kind: self.sizes.get(ErrorKey(Owner.ROBOT, kind), 0.0) for kind in (*DECLARED_AS, Kind.JOINT_NOISE)}

    @cached_property
    def errors(self) -> tuple[SharedError, ...]:
        """Errors that all poses share, those of the arm among them, with the standard deviations found."""
        found = [error.of_size(self.sizes.get(error.key, error.size.median)) for error in self.source.errors]
        return (*found, *errors_of_arm(self.source.arm, self.of_arm))

    @cached_property
    def spread(self) -> Array:
        """(p, r) moves of X and W by the uncertain sizes, one standard deviation each, in addition to the noise."""
        p, mixture = self.model.p, self.mixture
        centre = self.model.of_poses(mixture.mean_theta)
        more = mixture.about(centre.mean)[:p, :p] - centre.covariance[:p, :p]
        unit = np.sqrt(np.diag(centre.covariance)[:p])
        values, vectors = np.linalg.eigh(more / np.outer(unit, unit))
        kept = values > SOLUTION_ROUNDING
        moves = unit[:, None] * vectors[:, kept] * np.sqrt(values[kept])
        return np.asarray(moves if self.reduced.basis is None else self.reduced.basis @ moves)


def _keys(S: JointCovariance, otherwise: ErrorKey) -> tuple[ErrorKey, ...]:
    return tuple(key or otherwise for key in S.keys)
