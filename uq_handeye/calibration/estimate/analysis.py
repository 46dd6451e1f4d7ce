"""Quantities of a fit beyond X and its covariance, computed when they are first requested.

Diagnostics, the covariances that need no noise model beside that of the model, the split-half test, the budget of the
noise sources. All of one data set and the `Fit` on it; poses that robust estimation rejected are left out of the tests.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ...core.files.records import Record, parts_of, unequal
from ...core.geometry.checks import checked_covariance
from ...core.geometry.se3 import Array
from ...core.runtime.read_only import read_only
from ...errors import DegenerateMotionError, InputError
from ...fit.diagnostics.budget import Budget, budget, by_posterior
from ...fit.diagnostics.diagnose import diagnose
from ...fit.diagnostics.result import Diagnostics
from ...fit.diagnostics.source_types import with_types
from ...fit.diagnostics.split_half import SplitHalf, split_fit
from ...fit.empirical_covariance.resampled import KINDS, resampled
from ...fit.likelihood.gauss_helmert import Fit
from ...fit.likelihood.shared_estimates import of_moves
from ...fit.one_model.points import OpenSizes
from ...model.noise.estimate import NoiseEstimate
from ...model.noise.joint_covariance import JointCovariance, group_of
from ...model.noise.models import Noise, PoseNoise
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ...model.shared_errors.assumed import DRIFT


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
    # How X and W move, (p,) or (p, r), with errors that are beside the noise, by name: one standard deviation each.
    beside: dict[str, Array] = field(default_factory=dict, repr=False)
    # Covariances (n, 6, 6) within what each robot pose has by itself, by name: of joint noise.
    within: dict[str, Array] = field(default_factory=dict, repr=False)
    # The posterior over open sizes, and the deviations of its errors before the data, by name: for the budget.
    joint: OpenSizes | None = field(default=None, repr=False)
    prior_sd: dict[str, float] = field(default_factory=dict, repr=False)
    numbers: tuple[int, ...] | None = None  # of the rows in the data set, where some of it is excluded

    @cached_property
    def diagnostics(self) -> Diagnostics:
        """Observability, influence, tests of the residuals, systematic errors."""
        known = any(DRIFT in name for name in _names(self.noise))
        found = diagnose(self.fit.gauged(), self.data, self.noise, correlation_estimated=known)
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
        for kind in KINDS:
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
        """X from the even and from the odd rows against each other."""
        return self._split("interleaved")

    @cached_property
    def split_in_time(self) -> SplitHalf:
        """X from the first and from the last rows against each other, which finds drift."""
        return self._split("contiguous")

    def _split(self, split: str) -> SplitHalf:
        return split_fit(self.fit.gauged(), self.data, split, dof=self.dof)

    @cached_property
    def budget(self) -> Budget:
        """Shares of the variance by source, with their types; sources that the data cannot separate are one."""
        corners = isinstance(self.data, PosePairs) and self.data.camera_known
        found = budget(self.fit, self.noise, beside=self.beside, within=self.within)
        if self.joint is not None:
            found = by_posterior(found, self.joint.posterior, self.prior_sd)
        found = with_types(found, self.noise, self.estimate, corners)
        return found if self.estimate is None else found.merged(*_not_told_apart(self.estimate))


def _not_told_apart(estimate: NoiseEstimate) -> list[list[str]]:
    """Groups of noise components that only a sum is known of."""
    open_ = [component.name for component in estimate.components if component.status == "not told apart"]
    groups = [[name for name in open_ if name.endswith(kind)] for kind in ("rotation", "translation")]
    return [group for group in groups if len(group) > 1]


def _names(noise: Noise) -> set[str]:
    """Names of the errors that poses share."""
    sides = (noise.robot, noise.camera) if isinstance(noise, PoseNoise) else ()
    return {group_of(name) for S in sides if isinstance(S, JointCovariance) for name in S.names}


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
