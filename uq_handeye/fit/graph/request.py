"""The options of `calibrate`: all arguments but the data, checked once, and selected with the poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import NoneType
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from ...core.geometry.se3 import Array
from ...errors import InputError, require_integer, require_one_of, require_type
from ...methods.registry import METHODS, ROBOT_WORLD_METHODS
from ...model.errors.camera_noise import CameraNoise
from ...model.errors.key import ErrorKey
from ...model.errors.keys import CAMERA_SCALE, TARGET_SCALE
from ...model.errors.models import Noise, PairNoise, PoseNoise, is_joint, require_count
from ...model.errors.sizes import Size, SizeLike, checked_sizes, require_noise_prior
from ...model.errors.term import ErrorTerm
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.kinematic_errors import KinematicErrors
from ...model.poses.camera_scale import UNKNOWN
from ...model.poses.motions import relative_motions
from ...model.poses.pose_numbers import Selection
from ...model.poses.pose_pairs import PosePairs, as_joint_values
from ...model.shared_errors.assumed import replace_defaults
from ...model.shared_errors.shared_error import WIDE_SCALE_SD, SharedError, listed_errors
from .gauss_helmert import ESTIMATORS

# Covariances from the residuals (`diagnostics.sandwich`).
OF_RESIDUALS = ("sandwich", "bootstrap")
# Covariances of the result: of the noise, and of the residuals.
COVARIANCES = ("model", *OF_RESIDUALS)
# What neighbouring poses have in common: looked for where the noise is estimated, or not.
CORRELATIONS = ("auto", "none")


@dataclass(frozen=True, eq=False)
class Request:
    """The arguments of `calibrate` other than its data. Raises `InputError` for those that fit no data.

    Attributes
    ----------
    noise : PoseNoise, PairNoise, CameraNoise or None
        Noise of the poses or of the motions. `camera_noise`, the covariance of camera poses without corners by their
        views, leaves the pixel noise and that of the robot to be estimated; in ``PoseNoise(robot=..., camera=...)``
        only the pixel noise, unless its ``pixel_sd`` is given. None estimates the noise from the data
        (`estimate_noise`): isotropic components for rotation and translation of robot and camera. Camera poses from
        corners (``data.camera_calibration``) have a joint covariance: it is used where `noise` is None, with the
        robot's noise estimated, or where `noise` has no ``camera``. Otherwise a side that PoseNoise leaves out is
        exact; where its noise is not known, give that of the other side as
        ``prior=NoisePrior(robot=(..., ...), factor=1)`` in place of `noise`.
    method : str or None
        ``efficient``, at the Cramer-Rao bound; ``ml``, its iteration to maximum likelihood; a name in `METHODS` or,
        for poses, in `ROBOT_WORLD_METHODS`. None is ``efficient``; or ``4dpa`` where `scale` or `kind` require it, or
        where the noise given leaves a part of the residuals exact, so that it has no inverse for weights. Of poses
        from corners ``efficient`` and ``ml`` linearise the corners again at the intrinsics and poses of the estimate,
        where that makes a difference (`camera.adjustment.linearised`).
    pairs : "all", "consecutive", "disjoint" or (N, 2) integers
        Pairs to make of the poses (`relative_motions`); Motions come with theirs. ``efficient`` and ``ml`` work on the
        poses themselves; for them, as for `ROBOT_WORLD_METHODS`, pairs serve 4DPA and the residuals only.
    scale : float or None
        Scaling factor d of 4DPA; None is its limit (`solve`).
    kind : str or None
        How noise is propagated through a published method (`propagate`).
    covariance : "model", "sandwich" or "bootstrap"
        ``model``: that of the noise, to first order (`monte_carlo` tests it, and samples it beyond first order); the
        others come from the residuals of the poses and need no noise model (`diagnostics.sandwich`).
    robust : bool or None
        Down-weight outliers and name them (`robust`), with ``efficient`` and ``ml``. None does so from 5
        poses (or motions) on. Without outliers the estimate is the same as with False: all poses count in full.
    prior : NoisePrior or None
        Prior of the noise to be estimated, for example from a data sheet.
    prior_X, prior_W : tuple of a pose (4, 4) and a covariance (6, 6), or None
        Priors of X and of W, for example by a drawing or a tape measure: a Gaussian whose mean is the pose, with the
        covariance of ``xi = (theta, tau)`` (left rotation, additive translation, rad and m). Infinity on the diagonal:
        that component is not known (`known` makes both of text). A prior counts as a further measurement, and can
        determine directions that the motions leave open.
    seed : int
        Of the random subsets and bootstrap replicates.
    shared : sequence of SharedError or None
        Errors that all poses share, such as ``SharedError.focal_length(0.001)``: unknowns with a prior, whose effect is
        part of the covariance (``result.shared`` has the estimate of each). Where the noise is estimated, each
        replaces the default of its name (`shared_errors.assumed`), and the other defaults stay, as with None; with
        noise given there are no defaults. ``[]``: none.
    correlation : "auto" or "none"
        Whether errors of neighbouring poses may be correlated: a drift of camera or target, or noise that is correlated
        in time. ``auto`` estimates it with the noise, and where the data show some the covariance ("model") contains it
        (`shared_errors.assumed`). With `noise` given it is only tested.
    camera_scale : "unknown" or None
        ``unknown``: the camera poses have a scale of their own, as of visual SLAM or structure from motion. It is one
        more unknown with a flat prior: ``result.camera_scale``. A target scale declared with a standard deviation of
        10 % or more is the same.
    joints : (n, L) or None
        Joint values of the robot at the poses, rad (prismatic: m), in the order of ``kinematics.names``; None:
        ``data.joints``.
    kinematics : Kinematics or None
        The robot's chain from base to flange (`Kinematics.from_urdf`). With it the errors of the arm are unknowns with
        a prior: part of the covariance, estimated, and taken into account by ``result.predict`` and
        ``result.predict_camera``. By ``efficient`` and ``ml``.
    kinematic_errors : KinematicErrors or None
        Priors of the errors of the arm; None: estimated, with those of industrial arms as the smallest sizes.
    sizes : mapping of names to Size, (median, factor) or a number, or None
        Sizes of errors in place of those of the table `sizes.SIZES`, by the names there: a median that is known
        within a factor (one sigma of its logarithm), or a number that is known, rad or m. Where the noise is estimated.
    components : sequence of Component
        User-defined errors in addition to the others, with sizes that are known or estimated. Where the noise is
        estimated.
    """

    noise: Noise | CameraNoise | None = None
    method: str | None = None
    pairs: str | ArrayLike = "all"
    scale: float | None = None
    kind: str | None = None
    covariance: str = "model"
    robust: bool | None = None
    prior: Mapping[ErrorKey, Size] | None = None
    prior_X: tuple[ArrayLike, ArrayLike] | None = None
    prior_W: tuple[ArrayLike, ArrayLike] | None = None
    seed: int = 0
    shared: Sequence[SharedError] | None = None
    correlation: str = "auto"
    camera_scale: str | None = None
    joints: ArrayLike | None = None
    kinematics: Kinematics | None = None
    kinematic_errors: KinematicErrors | None = None
    sizes: Mapping[str, SizeLike] | None = None
    components: Sequence[ErrorTerm] = ()

    def __post_init__(self) -> None:
        if self.method is not None:
            require_one_of("method", self.method, [*ESTIMATORS, *METHODS, *ROBOT_WORLD_METHODS])
        method = self.taken_method
        if self.scale is not None and method != "4dpa":
            raise InputError(f"Expected no `scale` with method {method!r}: it is the scaling factor of 4dpa.")
        if self.by_likelihood and self.kind not in (None, "pairs" if of_motions(self.noise) else "poses"):
            raise InputError(
                f"Expected no kind={self.kind!r} with method {method!r}: it is for published methods such as 4dpa."
            )
        if type(self.robust) not in (NoneType, bool, np.bool_):
            raise InputError(f"Expected `robust` to be True, False or None, got {self.robust!r}.")
        if self.robust and not self.by_likelihood:
            raise InputError(f"Method {method!r} takes no robust weights; use efficient or ml.")
        require_one_of("covariance", self.covariance, COVARIANCES)
        require_one_of("correlation", self.correlation, CORRELATIONS)
        if self.camera_scale is not None:
            require_one_of("camera_scale", self.camera_scale, (UNKNOWN,))
        require_integer("seed", self.seed, 0)
        require_noise_prior(self.prior)
        require_type("kinematics", self.kinematics, (Kinematics, NoneType), "Kinematics")
        require_type("kinematic_errors", self.kinematic_errors, (KinematicErrors, NoneType), "KinematicErrors or None")
        for part in self.components:
            require_type("components", part, ErrorTerm, "Component")
        taken = {
            "shared": None if self.shared is None else listed_errors(self.shared),
            "sizes": checked_sizes(self.sizes),
            "components": tuple(self.components),
        }
        for name, value in taken.items():
            object.__setattr__(self, name, value)

    @property
    def taken_method(self) -> str:
        """The method; where none was given, the default for the other arguments."""
        if self.method is not None:
            return self.method
        return "efficient" if self.scale is None and self.kind in (None, "poses") else "4dpa"

    @property
    def camera_of_data(self) -> bool:
        """True if the noise of the camera is that of the data, and none is given."""
        return self.noise is None or (isinstance(self.noise, PoseNoise) and self.noise.camera is None)

    @property
    def by_likelihood(self) -> bool:
        """True if the method is at the Cramer-Rao bound, no published one."""
        return self.taken_method in ESTIMATORS

    @property
    def opens_scale(self) -> bool:
        """True if nothing is known of the scale of the camera poses."""
        declared = [error.sd[0] for error in self.shared or () if error.key == TARGET_SCALE and not error.default]
        return self.camera_scale is not None or any(sd >= WIDE_SCALE_SD for sd in declared)

    def with_scale(self, intrinsics_known: bool) -> Request:
        """Return the request with the scale of the camera poses as a shared error with a flat prior."""
        given, none = self.shared, self.shared is not None and not self.shared
        known = {TARGET_SCALE, CAMERA_SCALE}
        errors = [error for error in given or () if error.key not in known]
        errors.append(SharedError.camera_scale())
        taken = replace_defaults(errors, intrinsics_known, not none)
        shared = [error.switched_off() if error.key == TARGET_SCALE else error for error in taken]
        return replace(self, camera_scale=None, shared=shared)

    def rows(self, data: PosePairs, selection: Selection) -> Request:
        """Return the request for the poses of ``data`` that count."""
        kept, n, changes = selection.kept, data.n, dict[str, Any]()
        noise = self.noise
        if of_motions(noise):
            if any(S is not None and S.ndim > 2 for S in noise.sides.values()):
                raise InputError(
                    "Expected noise of poses, or one covariance for all motions, beside `exclude` or `only`: the "
                    "motions of the poses that are left are others."
                )
        elif noise is not None:
            for side, S in noise.sides.items():
                require_poses(S, n, side)
            changes["noise"] = noise.rows(kept)
        if self.shared is not None:
            changes["shared"] = [error.rows(kept, n) for error in self.shared]
        changes["components"] = [part.rows(kept) for part in self.components]
        if self.joints is not None:
            changes["joints"] = as_joint_values(self.joints, n)[kept]
        if not isinstance(self.pairs, str):
            pairs = relative_motions(data, self.pairs).pairs
            assert pairs is not None
            pairs = pairs[np.isin(pairs, kept).all(axis=1)]
            if not len(pairs):
                raise InputError("`exclude` or `only` leaves no pair of poses. Give others as `pairs`.")
            changes["pairs"] = np.searchsorted(kept, pairs)
        return replace(self, **changes)

    def to_dict(self, at: Array | None, simulated: bool) -> dict[str, Any]:
        """Return the arguments that also apply to more poses, as plain values, as they were given.

        ``at``: the errors of the arm about which the poses of the result are linearised (`linear_about`);
        ``simulated``: the poses came with their truth, for which no accuracy of the robot is assumed. Of a covariance
        that is joint over the poses only the fact is kept: it does not extend to others.
        """
        arm = None
        if self.kinematics is not None:
            arm = {
                "kinematics": self.kinematics.to_dict(),
                "joints": None if self.joints is None else np.asarray(self.joints, dtype=float).tolist(),
                "errors": None if self.kinematic_errors is None else asdict(self.kinematic_errors),
                "at": None if at is None else at.tolist(),
            }
        return {
            "noise": None if self.noise is None else {name: _side(S) for name, S in self.noise.sides.items()},
            "robust": None if self.robust is None else bool(self.robust),
            "shared": None if self.shared is None else [error.to_dict() for error in self.shared],
            "arm": arm,
            "simulated": simulated,
        }


def _side(S: Any) -> Any:
    match S:
        case None:
            return None
        case CameraNoise(views=views, pixel_sd=pixel_sd):
            return {"views": None if views is None else dict(views), "pixel_sd": pixel_sd}
    return "joint" if is_joint(S) else np.asarray(S).tolist()


def of_motions(noise: Noise | CameraNoise | None) -> TypeGuard[PairNoise]:
    """Return whether noise is that of motions, not of poses."""
    return isinstance(noise, PairNoise)


def require_poses(S: Any, n: int, side: str) -> None:
    """Raise `InputError` unless the noise of a side, also that of a camera, is of ``n`` poses."""
    match S:
        case CameraNoise(n=other):
            if other != n:
                raise InputError(f"Expected camera noise of the data given, {n} poses, got that of {other} poses.")
        case _:
            require_count(S, n, side, "poses")


def documented(doc: str | None) -> str | None:
    """Return the docstring of a function whose further keywords ``asked`` are a `Request`, with the documentation of
    its fields inserted.
    """
    if doc is None or Request.__doc__ is None:  # Python runs without
        return doc
    of_fields = Request.__doc__.partition("----------\n")[2].rstrip()
    return doc.replace("    **asked\n        The fields of `Request`.", of_fields)
