"""`Synchronised`, the result of `synchronise`: the pose pairs, their time offset and the details of its estimation."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...core.files.json_values import JsonObject
from ...core.files.records import attributes
from ...core.geometry.se3 import Array
from ...core.presentation.numbers import concise
from ...core.presentation.shown import Shown
from ...core.presentation.units import MS_PER_S
from ...findings import Finding, texts
from ...model.errors.models import PoseNoise
from ...model.poses.pose_pairs import PosePairs
from .correlation import Correlation
from .figure import sync_figure
from .pairing import Pairing
from .refinement import Refined, residual_scale
from .stream_checks import LeftOut

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Synchronised(Shown):
    """Two streams made one; see `synchronise`. ``offset`` and times in s, ``robot_time = camera_time + offset``."""

    title = "Synchronised streams"

    poses: PosePairs  # at the times of the camera's clock; `poses.timing` carries the uncertainty of the offset
    offset: float
    offset_std: float  # 0: given as exact
    origin: str  # "estimated", "given" or "estimated with a prior"
    model_std: float | None  # of the offset, if rows were independent; None: not estimated
    growth: float  # factor on its deviation for what neighbouring rows share
    side: str  # which stream was interpolated
    interpolation: str
    max_gap: float
    interpolation_error: tuple[float, float]  # rad, m: root mean square
    intervals: tuple[float, float]  # median, of robot and camera
    left_out: tuple[LeftOut, ...]
    alternatives: tuple[float, ...]  # other offsets that fit nearly as well
    stops: int | None  # that the poses were averaged from; None: poses in motion
    stops_found: int
    noise: PoseNoise | None  # of the pose pairs, for `calibrate`, where that of the samples was given
    findings: tuple[Finding, ...]
    correlation: Correlation | None = field(repr=False)
    pairing: Pairing | None = field(repr=False)
    refined: Refined | None = field(repr=False)
    shift: float = field(repr=False, default=0.0)  # between the origins of time of the streams in `pairing`

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings that are more than a note, in words."""
        return texts(self.findings)

    @property
    def notes(self) -> tuple[str, ...]:
        """The findings worth knowing, in words."""
        return tuple(str(finding) for finding in self.findings if finding.severity == "note")

    def __repr__(self) -> str:
        return f"Synchronised({self.poses.n} poses, offset {1e3 * self.offset:.3g} +- {1e3 * self.offset_std:.2g} ms)"

    @cached_property
    def residual_curve(self) -> tuple[Array, Array, Array] | None:
        """Offsets (m,), and RMS rotation (rad) and translation (m) residuals of the best X at each; None if not known.

        Of at most `ROWS_FOR_ROUNDS` rows, with the robust weights of the estimate.
        """
        if self.pairing is None or self.refined is None:
            return None
        reach = max(5 * self.offset_std, 2 * min(self.intervals), 5 * (self.model_std or 0.0))
        offsets = self.offset + np.linspace(-reach, reach, 31)
        rotation, translation = residual_scale(self.pairing, self.refined, offsets - self.shift)
        return offsets, rotation, translation

    def figure(self) -> Figure:
        """Angular speeds, their correlation, residuals against the offset, as a Matplotlib figure."""
        value, how = f"{MS_PER_S * self.offset:.6g} ms", "as given"
        if self.origin != "given":
            value = concise(MS_PER_S * self.offset, MS_PER_S * self.offset_std, "ms")
            how = "1 standard deviation in parentheses"
        title = f"Time offset {value} ({how}): robot_time = camera_time + offset"
        return sync_figure(title, self.correlation, self.residual_curve, self.offset, self.offset_std, self.shift)

    def to_dict(self) -> JsonObject:
        """Everything but the poses as plain numbers, lists and text."""
        times = self.poses.timestamps
        return {
            "format": "uq-handeye synchronisation 1",
            "convention": "robot_time = camera_time + offset",
            "units": {"time": "s", "rotation": "rad", "translation": "m"},
            "setup": self.poses.setup,
            "n_poses": self.poses.n,
            "first": None if times is None else float(times.min()),
            "last": None if times is None else float(times.max()),
            **attributes(
                self,
                "offset offset_std origin model_std growth interpolated=side interpolation interpolation_error max_gap",
            ),
            "median_intervals": {"robot": self.intervals[0], "camera": self.intervals[1]},
            "correlation": None if self.correlation is None else attributes(self.correlation, "peaks heights"),
            **attributes(self, "alternatives stops stops_found"),
            "left_out": [attributes(part, "side times reason") for part in self.left_out],
            **attributes(self, "findings notes warnings"),
        }
