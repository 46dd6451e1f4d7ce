"""Attributes of a calibration that its statement is made of."""

from __future__ import annotations

from typing import Any, Literal, Protocol

from ...core.geometry.se3 import Array
from ...findings import Finding
from ...fit.diagnostics.budget import Budget
from ...fit.diagnostics.pose_table import PoseTable
from ...fit.diagnostics.result import Diagnostics
from ...fit.diagnostics.split_half import SplitHalf
from ...fit.diagnostics.task_space import PointUncertainty
from ...fit.likelihood.d2_distribution import Reference
from ...fit.likelihood.goodness_of_fit import GoodnessOfFit
from ...fit.likelihood.open_directions import OpenDirections
from ...fit.likelihood.shared_estimates import SharedEstimate
from ...model.noise.estimate import NoiseEstimate
from ...model.noise.models import Noise
from ...model.poses.timing import TimeOffset
from ...model.posterior.posterior import Posterior

# Distance taken where that of the target is not known (m).
USUAL_DISTANCE = 0.5


class Analysed(Protocol):
    """Diagnostics, split halves and budget of a fit."""

    @property
    def diagnostics(self) -> Diagnostics: ...
    @property
    def split_half(self) -> SplitHalf: ...
    @property
    def split_in_time(self) -> SplitHalf: ...
    @property
    def budget(self) -> Budget: ...


class Stated(Protocol):
    """A calibration, as far as its statement needs it."""

    @property
    def X(self) -> Array: ...
    @property
    def covariance(self) -> Array | None: ...
    @property
    def covariance_kind(self) -> str: ...
    @property
    def bound(self) -> Array | None: ...
    @property
    def frame(self) -> str: ...
    @property
    def method(self) -> str: ...
    @property
    def n_poses(self) -> int | None: ...
    @property
    def n_pairs(self) -> int: ...
    @property
    def noise(self) -> Noise | None: ...
    @property
    def noise_estimate(self) -> NoiseEstimate | None: ...
    @property
    def findings(self) -> tuple[Finding, ...]: ...
    @property
    def fit(self) -> GoodnessOfFit | None: ...
    @property
    def table(self) -> PoseTable | None: ...
    @property
    def excluded(self) -> tuple[int, ...]: ...
    @property
    def time_offset(self) -> TimeOffset | None: ...
    @property
    def shared(self) -> tuple[SharedEstimate, ...]: ...
    @property
    def posterior(self) -> Posterior | None: ...
    @property
    def reference(self) -> Reference: ...
    @property
    def opened(self) -> OpenDirections | None: ...
    @property
    def open_words(self) -> tuple[str, ...]: ...
    @property
    def analysis(self) -> Analysed | None: ...
    @property
    def answered(self) -> Literal["whole", "in part", "no"]: ...
    def uncertainty_at(self, points: Any) -> PointUncertainty: ...


def distance_of(analysis: Analysed | None) -> tuple[float, bool]:
    """Return the RMS distance from camera to target (m); False: it is not known, and a usual one is taken."""
    if analysis is not None:
        spectrum = analysis.diagnostics.spectrum
        if spectrum.length_of == "target":
            return float(spectrum.length_m), True
    return USUAL_DISTANCE, False
