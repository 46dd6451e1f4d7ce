"""Request to `calibrate` beside the data: its arguments, checked once, for these or for fewer poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.geometry.se3 import Array
from ..errors import InputError, require_integer
from ..fit.empirical_covariance.resampled import KINDS as OF_RESIDUALS
from ..fit.likelihood.gauss_helmert import ESTIMATORS
from ..fit.one_model.component import Component
from ..methods.estimators.registry import METHODS, ROBOT_WORLD_METHODS
from ..model.kinematics.chain import Kinematics
from ..model.kinematics.kinematic_errors import KinematicErrors
from ..model.noise.estimate import NoisePrior
from ..model.noise.models import CameraNoise, Noise, PairNoise, PoseNoise, is_joint, require_count
from ..model.poses.motions import relative_motions
from ..model.poses.pose_pairs import PosePairs, Selection, as_joint_values
from ..model.shared_errors.shared_error import SharedError, listed_errors
from ..model.shared_errors.sizes import SizeLike, checked_sizes

# Covariances of the result: of the noise, to first order and beyond; and of the residuals.
OF_NOISE = ("model", "sigma-points")
COVARIANCES = (*OF_NOISE, *OF_RESIDUALS)
# What neighbouring poses have in common: looked for where the noise is estimated, or not.
CORRELATIONS = ("auto", "none")
# The full bundle adjustment on the corners (`rig_bundle`).
BUNDLE = "bundle"


@dataclass(frozen=True, eq=False)
class Request:
    """The arguments of `calibrate`; see there. Raises `InputError` for those that fit no data."""

    noise: Noise | CameraNoise | None = None
    method: str | None = None
    pairs: str | ArrayLike = "all"
    scale: float | None = None
    kind: str | None = None
    covariance: str = "model"
    robust: bool | None = None
    prior: NoisePrior | None = None
    prior_X: tuple[ArrayLike, ArrayLike] | None = None
    prior_W: tuple[ArrayLike, ArrayLike] | None = None
    seed: int = 0
    shared: Sequence[SharedError] | None = None
    correlation: str = "auto"
    joints: ArrayLike | None = None
    kinematics: Kinematics | None = None
    kinematic_errors: KinematicErrors | None = None
    sizes: Mapping[str, SizeLike] | None = None
    components: Sequence[Component] = ()

    def __post_init__(self) -> None:
        known = [*ESTIMATORS, BUNDLE, *METHODS, *ROBOT_WORLD_METHODS]
        if self.method is not None and (not isinstance(self.method, str) or self.method not in known):
            raise InputError(f"Expected `method` to be one of {', '.join(known)}, got {self.method!r}.")
        method = self.taken_method
        if self.scale is not None and method != "4dpa":
            raise InputError(f"Expected no `scale` with method {method!r}: it is the scaling factor of 4dpa.")
        if self.by_likelihood and self.kind not in (None, "pairs" if isinstance(self.noise, PairNoise) else "poses"):
            raise InputError(
                f"Expected no kind={self.kind!r} with method {method!r}: it is for published methods such as 4dpa."
            )
        if self.robust is not None and not isinstance(self.robust, bool | np.bool_):
            raise InputError(f"Expected `robust` to be True, False or None, got {self.robust!r}.")
        if self.robust and not self.by_likelihood:
            raise InputError(f"Method {method!r} takes no robust weights; use efficient or ml.")
        if self.covariance not in COVARIANCES:
            raise InputError(f"Expected `covariance` to be one of {', '.join(COVARIANCES)}, got {self.covariance!r}.")
        if self.covariance == "sigma-points" and self.kind is not None:
            raise InputError(
                f"Expected no kind={self.kind!r} with covariance='sigma-points': it is of first order only."
            )
        if self.correlation not in CORRELATIONS:
            raise InputError(
                f"Expected `correlation` to be one of {', '.join(CORRELATIONS)}, got {self.correlation!r}."
            )
        require_integer("seed", self.seed, 0)
        if self.prior is not None and not isinstance(self.prior, NoisePrior):
            raise InputError(f"Expected `prior` to be a NoisePrior or None, got {type(self.prior).__name__}.")
        for part in self.components:
            if not isinstance(part, Component):
                raise InputError(f"Expected `components` to be Component, got {type(part).__name__}.")
        values = {
            "shared": None if self.shared is None else listed_errors(self.shared),
            "sizes": checked_sizes(self.sizes),
            "components": tuple(self.components),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def taken_method(self) -> str:
        """The method; where none was asked for, the one that the other arguments leave."""
        if self.method is not None:
            return self.method
        return "efficient" if self.scale is None and self.kind in (None, "poses") else "4dpa"

    @property
    def by_likelihood(self) -> bool:
        """True if the method is at the Cramer-Rao bound, no published one."""
        return self.taken_method in (*ESTIMATORS, BUNDLE)

    def rows(self, data: PosePairs, selection: Selection) -> Request:
        """Return the request for the poses of ``data`` that count."""
        kept, n, changes = selection.kept, data.n, dict[str, Any]()
        noise = self.noise
        if isinstance(noise, PairNoise):
            if any(S is not None and S.ndim > 2 for S in (noise.A, noise.B)):
                raise InputError(
                    "Expected noise of poses, or one covariance for all motions, beside `exclude` or `only`: the "
                    "motions of the poses that are left are others."
                )
        elif isinstance(noise, PoseNoise | CameraNoise):
            sides = (noise.robot, noise.camera) if isinstance(noise, PoseNoise) else (noise,)
            for side, S in zip(("robot", "camera"), sides, strict=False):
                if not isinstance(S, CameraNoise):
                    require_count(S, n, side, "poses")
                elif S.n != n:
                    raise InputError(f"Expected camera noise of the data given, {n} poses, got that of {S.n} poses.")
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
        """Return what can be asked of more poses, as plain values, as it was given.

        ``at``: the errors of the arm about which the poses of the result stand for those measured (`linear_about`);
        ``simulated``: the poses came with their truth, for which no accuracy of the robot is assumed. Of a covariance
        that is joint over the poses only the fact is kept: it does not extend to others.
        """
        noise, sides = self.noise, None
        if isinstance(noise, CameraNoise):
            sides = {"robot": None, "camera": _side(noise)}
        elif noise is not None:
            names = ("A", "B") if isinstance(noise, PairNoise) else ("robot", "camera")
            sides = {name: _side(getattr(noise, name)) for name in names}
        arm = None
        if self.kinematics is not None:
            arm = {
                "kinematics": self.kinematics.to_dict(),
                "joints": None if self.joints is None else np.asarray(self.joints, dtype=float).tolist(),
                "errors": None if self.kinematic_errors is None else asdict(self.kinematic_errors),
                "at": None if at is None else at.tolist(),
            }
        return {
            "noise": sides,
            "robust": None if self.robust is None else bool(self.robust),
            "shared": None if self.shared is None else [error.to_dict() for error in self.shared],
            "arm": arm,
            "simulated": simulated,
        }


def _side(S: Any) -> Any:
    if isinstance(S, CameraNoise):
        return {"views": None if S.views is None else dict(S.views), "pixel_sd": S.pixel_sd}
    if S is None:
        return None
    return "joint" if is_joint(S) else np.asarray(S).tolist()
