"""Results of a fit in addition to X and its covariance: its diagnostics, and the estimated errors of the arm.

`Analysis` computes on first access the diagnostics, the covariances that need no noise model, the split-half test and
the budget of the noise sources. They belong to one data set and the `Fit` on it; poses that robust estimation rejected
are left out of the tests. The arm holds the estimated errors of its kinematics and corrects poses by them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.files.records import Record, parts_of, unequal
from ..core.geometry.checks import as_numbers, checked_covariance
from ..core.geometry.se3 import Array, difference, perturb
from ..core.read_only import read_only
from ..errors import DegenerateMotionError, InputError
from ..fit.diagnostics.budget import Budget, budget, by_posterior, with_types
from ..fit.diagnostics.diagnose import diagnose
from ..fit.diagnostics.resampled import resampled
from ..fit.diagnostics.result import Diagnostics
from ..fit.diagnostics.split_half import SplitHalf, split_fit
from ..fit.graph.gauss_helmert import Fit
from ..fit.graph.points import OpenSizes
from ..fit.graph.posterior import Posterior
from ..fit.graph.request import OF_RESIDUALS
from ..fit.graph.shared_estimates import of_moves
from ..model.errors.error_estimate import ErrorEstimate, resolved_share
from ..model.errors.joint_covariance import JointCovariance
from ..model.errors.key import ErrorKey, Kind
from ..model.errors.keys import DRIFTS
from ..model.errors.models import Noise
from ..model.errors.noise_estimate import NoiseEstimate
from ..model.kinematics.chain import Kinematics
from ..model.kinematics.errors import GROUPS
from ..model.kinematics.joint import require_within_limits
from ..model.kinematics.kinematic_errors import poses_with_errors
from ..model.kinematics.newton import postures_at
from ..model.poses.motions import Motions
from ..model.poses.pose_pairs import PosePairs

if TYPE_CHECKING:
    import pandas as pd

# The controller's poses count as those of the joints where their RMS difference (rad, m) is below this.
MAX_CONTROLLER_RMS = (np.radians(0.01), 1e-4)


@dataclass(frozen=True, eq=False)
class FittedKinematics(Record):
    """An arm with the estimates of its kinematic errors, ``true = FK(q; e)``.

    ``covariance`` is that of e; numbers that were left out (of the base, of the flange, of groups that are exact) are 0
    in both. Units: rad and m.
    """

    _in_file: ClassVar[str] = "chain names e covariance sd how flange joints beside_controller"

    chain: Kinematics
    e: Annotated[Array, "m"]  # (m,) of all errors of the chain
    covariance: Annotated[Array, "m", "m"]  # (m, m)
    sd: dict[str, float]  # deviations of the groups and of the joint noise, by kind
    how: str  # "estimate", "declared" or "exact"
    flange: str  # "workspace", "controller" or "physical"
    joints: Annotated[Array, "n", "joints"]  # (n, L) at which it was calibrated
    beside_controller: tuple[float, float]  # RMS of the controller's poses minus those of the joints, rad and m

    @property
    def joint_noise(self) -> float:
        """Standard deviation of the noise of each joint, rad."""
        return self.sd.get(Kind.JOINT_NOISE, 0.0)

    @property
    def kept(self) -> NDArray[np.intp]:
        """(k,) the numbers of the errors that count."""
        return np.flatnonzero(np.diag(self.covariance) > 0)

    def table(self) -> list[ErrorEstimate]:
        """The estimates of the errors that count, in the order of the chain's errors."""
        found = []
        for k in self.kept.tolist():
            of, prior = self.chain.errors[k], self.sd.get(self.chain.errors[k].group, 0.0)
            sd = float(np.sqrt(self.covariance[k, k]))
            found.append(
                ErrorEstimate(
                    of.key, "robot", of.unit, prior, prior, prior, count=1, resolved=resolved_share(sd, prior),
                    estimate=float(self.e[k]), sd=sd,
                )
            )  # fmt: skip
        return found

    def told(self) -> dict[str, float]:
        """Share by which the data reduced the prior variance of each group of errors, on average, 0 to 1."""
        rows = self.table()
        shares = {group: [row.resolved for row in rows if row.key.kind == group] for group in GROUPS}
        return {group: float(np.mean(share)) for group, share in shares.items() if share}

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table of `table`, a row per number of e by its name."""
        import pandas as pd

        joint = {error.key: error.joint for error in self.chain.errors}
        rows = [
            (row.name, row.key.kind.value, joint[row.key], row.unit, row.size, row.estimate, row.sd, row.resolved)
            for row in self.table()
        ]
        head = ["name", "group", "joint", "unit", "prior_sd", "estimate", "sd", "resolved"]
        return pd.DataFrame(rows, columns=head).set_index("name")

    def at(self, q: Array) -> Array:
        """(..., 4, 4) ``FK(q; e)`` at the estimate, in the frames that X is stated in."""
        return poses_with_errors(self.chain, q, self.e, self.flange)

    def poses(self, q: ArrayLike, robot: Array | None = None) -> Array:
        """(..., 4, 4) ``FK(q; e)``, corrected by the estimate, at joints q (..., L).

        ``robot`` (..., 4, 4) are the controller's poses there: they are moved as the correction moves those of the
        joints. Where its poses at the calibration were others than those of the joints, they are needed.
        """
        joints = self.checked(q)
        corrected = self.at(joints)
        if robot is None:
            if self.beside_controller[0] > MAX_CONTROLLER_RMS[0] or self.beside_controller[1] > MAX_CONTROLLER_RMS[1]:
                turn, shift = np.degrees(self.beside_controller[0]), 1e3 * self.beside_controller[1]
                raise InputError(
                    f"The controller's poses differ from those of the joints by {shift:.2g} mm and {turn:.2g} deg "
                    "(RMS): expected `robot`, its poses, beside `joints`."
                )
            return corrected
        nominal = self.chain.poses(joints)
        if nominal.shape != robot.shape:
            raise InputError(f"Expected `robot` poses {nominal.shape} at these joints, got shape {robot.shape}.")
        return perturb(robot, difference(corrected, nominal))

    def joints_at(self, robot: Array) -> Array:
        """(..., L) joint values at which the arm is at poses ``robot`` (..., 4, 4), near those of the calibration.

        Raises `InputError` for poses that the arm does not reach from there.
        """
        flat = robot.reshape(-1, 4, 4)
        at = self.chain.poses(self.joints)
        reach = max(self.chain.reach, 1e-3)
        apart = np.linalg.norm(flat[:, None, :3, 3] - at[:, :3, 3], axis=-1) / reach
        apart = apart + np.linalg.norm(flat[:, None, :3, :3] - at[:, :3, :3], axis=(-2, -1))
        q, left = np.empty((len(flat), self.chain.n_joints)), np.arange(len(flat))
        for of in apart.argsort(axis=1, kind="stable").T[:10]:
            found = postures_at(self.chain, flat[left], self.joints[of[left]])
            q[left[found.reached]] = found.q[found.reached]
            left = left[~found.reached]
            if not len(left):
                return q.reshape(*robot.shape[:-2], -1)
        raise InputError(
            f"The arm {self.chain.name} does not reach {len(left)} of {len(flat)} robot poses near the postures of the "
            "calibration: give `joints` (--joints FILE.csv)."
        )

    def checked(self, q: ArrayLike) -> Array:
        """Joints (..., L), rad (prismatic: m); raises `InputError`."""
        values = as_numbers(q, "joints")
        count = self.chain.n_joints
        if values.ndim < 1 or values.shape[-1] != count or not np.isfinite(values).all():
            raise InputError(
                f"Expected `joints` to be finite numbers (..., {count}) of {', '.join(self.chain.names)}, got shape "
                f"{values.shape}."
            )
        kinds = [joint.kind for joint in self.chain.joints]
        require_within_limits(
            values.reshape(-1, count), self.chain.names, kinds, self.chain.limits, np.zeros(count, dtype=bool),
            lambda row: f"`joints`, row {row}", "Expected rad, and m of prismatic joints.",
        )  # fmt: skip
        return values

    @classmethod
    def of(
        cls,
        chain: Kinematics,
        joints: Array,
        how: str,
        flange: str,
        sd: dict[str, float],
        beside_controller: tuple[float, float],
        posterior: Posterior,
    ) -> FittedKinematics:
        """Build the kinematics from the joint posterior, by the keys of the errors."""
        m = len(chain.errors)
        e, covariance = np.zeros(m), np.zeros((m, m))
        place = {error.key: k for k, error in enumerate(chain.errors)}
        pairs = [(place[key], k) for k, key in enumerate(posterior.keys) if key in place]
        if pairs:
            here, there = np.array(pairs).T
            e[here] = posterior.estimate[there]
            covariance[np.ix_(here, here)] = posterior.covariance[np.ix_(12 + there, 12 + there)]
        return cls(chain, e, covariance, sd, how, flange, joints, beside_controller)

    @property
    def names(self) -> list[str]:
        """Names of the errors of the chain."""
        return [error.name for error in self.chain.errors]

    @classmethod
    def from_dict(cls, data: Any) -> FittedKinematics:
        """Read the values that `to_dict` writes; raises `InputError` on any others."""
        found = cls(**parts_of(cls, data, "kinematics"))
        m, L = len(found.chain.errors), found.chain.n_joints
        if data.get("names") != found.names or len(found.e) != m or found.joints.shape[1:] != (L,):
            raise InputError(f"Expected kinematics with the {m} errors and {L} joints of their chain.")
        return found


@dataclass(frozen=True, eq=False)
class Analysis(Record):
    """Analysis of one data set: see the module."""

    _in_file: ClassVar[str] = "diagnostics covariances reasons split_half split_in_time budget=budget.in_file"

    data: PosePairs | Motions = field(repr=False)
    noise: Noise = field(repr=False)
    fit: Fit = field(repr=False)
    method: str  # "efficient" or "ml"
    estimate: NoiseEstimate | None = field(default=None, repr=False)  # where the noise comes from the data
    dof: float | None = None  # degrees of freedom of the covariance then
    seed: int = 0
    # Moves of X and W, (p,) or (p, r), by one standard deviation of each error in addition to the noise.
    beside: dict[ErrorKey, Array] = field(default_factory=dict, repr=False)
    # Covariances (n, 6, 6) within what each robot pose has by itself: of joint noise.
    within: dict[ErrorKey, Array] = field(default_factory=dict, repr=False)
    # The posterior over open sizes, and the deviations of its errors before the data: for the budget.
    joint: OpenSizes | None = field(default=None, repr=False)
    prior_sd: dict[ErrorKey, float] = field(default_factory=dict, repr=False)
    numbers: tuple[int, ...] | None = None  # of the rows in the data set, where some of it is excluded

    @cached_property
    def diagnostics(self) -> Diagnostics:
        """Observability, influence, tests of the residuals, systematic errors."""
        shared = (key.error for S in joint_sides(self.noise).values() for key in S.keys if key is not None)
        known = not set(DRIFTS.values()).isdisjoint(shared)
        found = diagnose(self.fit.gauged(), self.data, self.noise, correlation_estimated=known)
        if self.estimate is not None and (poses := self.data.poses) is not None and poses.truth is None:
            found = replace(found, autocorrelation=replace(found.autocorrelation, untimed=poses.timestamps is None))
        return replace(found, numbers=self.numbers)

    @cached_property
    def covariances(self) -> dict[str, Array | None]:
        """Covariances (6, 6) of X by name, "model" first; None where one is not determined (`reasons`)."""
        return self._covariances[0]

    @cached_property
    def reasons(self) -> dict[str, str]:
        """Reasons why a covariance is not determined, by its name."""
        return self._covariances[1]

    @cached_property
    def _covariances(self) -> tuple[dict[str, Array | None], dict[str, str]]:
        found: dict[str, Array | None] = {"model": self.fit.covariance_X}
        reasons: dict[str, str] = {}
        for kind in OF_RESIDUALS:
            if self.fit.open is not None:
                found[kind], reasons[kind] = None, "The motions leave a part of X open."
                continue
            try:
                found[kind] = resampled(self.data, self.method, kind, fit=self.fit, seed=self.seed).covariance_X
            except (InputError, DegenerateMotionError) as error:
                found[kind], reasons[kind] = None, str(error)
        more = [of_moves(move[:6]) for move in self.beside.values()]
        found = {name: S if S is None else np.asarray(sum(more, S)) for name, S in found.items()}
        return read_only(found), reasons

    @cached_property
    def split_half(self) -> SplitHalf:
        """Comparison of X from the even rows with X from the odd rows."""
        return self._split("interleaved")

    @cached_property
    def split_in_time(self) -> SplitHalf:
        """Comparison of X from the first rows with X from the last rows, which detects drift."""
        return self._split("contiguous")

    def _split(self, split: str) -> SplitHalf:
        return split_fit(self.fit.gauged(), self.data, split, dof=self.dof)

    @cached_property
    def budget(self) -> Budget:
        """Shares of the variance by source, with their types; sources that the data cannot separate are one."""
        corners = self.data is (poses := self.data.poses) and poses is not None and poses.camera_known
        found = budget(self.fit, self.noise, beside=self.beside, within=self.within)
        if self.joint is not None:
            found = by_posterior(found, self.joint.posterior, self.prior_sd)
        found = with_types(found, self.estimate, corners)
        if self.joint is not None and self.joint.posterior.points is not None:
            found = replace(found, relative=None)
        if self.estimate is None:
            return found
        sums = [part.key for part in self.estimate.components if part.status == "not told apart"]
        kinds = ([key for key in sums if key.kind == kind] for kind in (Kind.ROTATION, Kind.TRANSLATION))
        return found.merged(*(group for group in kinds if len(group) > 1))


def joint_sides(noise: Noise | None) -> dict[str, JointCovariance]:
    """The covariances of noise, by side, in which poses share errors."""
    sides = {} if noise is None else noise.sides
    return {name: S for name, S in sides.items() if isinstance(S, JointCovariance)}


@dataclass(frozen=True, eq=False)
class StoredAnalysis(Record):
    """An `Analysis` read from a file: the same names, no data behind them; its budget is not divided by pose."""

    _in_file: ClassVar[str] = Analysis._in_file

    diagnostics: Diagnostics
    covariances: dict[str, Array | None]
    reasons: dict[str, str]
    split_half: SplitHalf
    split_in_time: SplitHalf
    budget: Budget

    @classmethod
    def of(cls, data: Any, X: Array) -> StoredAnalysis:
        """Return the analysis that `Analysis.to_dict` wrote, for the X that it belongs to."""
        covariances = {
            name: None if S is None else checked_covariance(S, name, joint=False)
            for name, S in data["covariances"].items()
        }
        if unknown := {name for name, S in covariances.items() if S is None} - set(data["reasons"]):
            raise InputError(f"Expected the covariance {unknown.pop()!r}, or the reason why there is none.")
        budget = Budget.of(data["budget"], X)
        if (where := unequal(budget.in_file, data["budget"], "analysis.budget")) is not None:
            raise InputError(f"{where} does not fit the rest")
        return cls(**parts_of(cls, data, "analysis", covariances=covariances, budget=budget))
