"""Synchronised: what `synchronise` returns, the pose pairs with their time offset and how it was found.

Two synchronised streams in words, and what the summary of a calibration says of their time offset.

Two synchronised streams as a figure: the angular speeds on one clock, their correlation, residuals by offset.

Above, the angular speeds (deg/s) of robot and camera on the clock of the camera, the robot's moved by the offset: the
two curves lie on each other if the offset is right. Below left, the correlation coefficient of both at each lag (s)
that was looked at. Below right the residuals (per axis, root mean square) of the best X and W at each offset near the
estimate, rotation and translation each by its smallest value; the band is the offset with two standard deviations.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.files.records import attributes
from ...core.formatting.numbers import concise, digits
from ...core.geometry.se3 import Array
from ...core.presentation.document import Block, Caution, Document, Heading, Paragraph, document_of
from ...core.presentation.shown import Shown
from ...findings import Finding, texts
from ...model.noise.models import PoseNoise
from ...model.poses.pose_pairs import PosePairs
from .correlation import Correlation, LeftOut
from .refinement import Pairing, Refined, residual_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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

        Of at most 1,500 rows, with the robust weights of the estimate.
        """
        if self.pairing is None or self.refined is None:
            return None
        reach = max(5 * self.offset_std, 2 * min(self.intervals), 5 * (self.model_std or 0.0))
        offsets = self.offset + np.linspace(-reach, reach, 31)
        rotation, translation = residual_scale(self.pairing, self.refined, offsets - self.shift)
        return offsets, rotation, translation

    def figure(self) -> Figure:
        """Angular speeds, their correlation, residuals against the offset, as a Matplotlib figure."""
        return sync_figure(self)

    def to_dict(self) -> dict[str, Any]:
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


# Groups of poses left out that a text lists.
MOST_LISTED = 12
NAMES = {"so4": "on SO(4), (37)-(38)", "geodesic": "along the geodesic of SE(3)"}


@document_of.register(Synchronised)
def synchronised_document(sync: Synchronised) -> Document:
    """The offset first, then what the poses were made of, what was left out and what to know."""
    return [
        Paragraph(headline(sync)),
        *map(Caution, sync.warnings),
        [Paragraph(sentence) for sentence in offset_sentences(sync)],
        [Paragraph(sentence) for sentence in _made_of(sync)],
        _left_out(sync),
        *map(Paragraph, sync.notes),
        Paragraph(_scope(sync)),
    ]


def headline(sync: Synchronised) -> str:
    """Poses and offset in one sentence."""
    what = f"{sync.poses.n} pose pairs" if sync.stops is None else f"{sync.stops} stops, one averaged pose pair each"
    if sync.origin == "given":
        return f"{what}; time offset {1e3 * sync.offset:.6g} ms as given (robot_time = camera_time + offset)."
    return (
        f"{what}; time offset {concise(1e3 * sync.offset, 1e3 * sync.offset_std, 'ms')} "
        f"(robot_time = camera_time + offset), {sync.origin}."
    )


def offset_sentences(sync: Synchronised) -> list[str]:
    """Describe how the offset and its standard deviation were found."""
    found = []
    if sync.correlation is not None and sync.correlation.found:
        found.append(
            f"The angular speeds of robot and camera correlate by {sync.correlation.heights[0]:.2f} at "
            f"{1e3 * (sync.correlation.peaks[0] + sync.shift):.4g} ms (chance stays below "
            f"{sync.correlation.needed:.2f}); from there the offset was refined jointly with X and W."
        )
    if sync.origin != "given":
        more = ""
        if sync.model_std is not None and sync.offset_std > 1.2 * sync.model_std and sync.origin == "estimated":
            more = (
                f" If all poses were independent it would be {digits(1e3 * sync.model_std, 2)} ms; their residuals say "
                "otherwise"
            )
            shared = f": neighbours are correlated, which makes it {digits(sync.growth, 2)} times larger"
            more += f"{shared if sync.growth > 1.05 else ''}."
        found.append(f"Standard deviation of the offset: {digits(1e3 * sync.offset_std, 2)} ms.{more}")
    if sync.stops is not None:
        found.append("At a stop nothing moves: the time offset hardly matters for these poses.")
    return found


def _made_of(sync: Synchronised) -> list[str]:
    robot, camera = (f"{1.0 / interval:.4g} Hz" for interval in sync.intervals)
    lines = [f"Rates: robot {robot}, camera {camera} (median)."]
    if sync.stops is None:
        other = "camera" if sync.side == "robot" else "robot"
        turn, move = np.degrees(sync.interpolation_error[0]), 1e3 * sync.interpolation_error[1]
        lines.append(
            f"The {sync.side} was interpolated at the times of the {other} {NAMES[sync.interpolation]}, never over "
            f"more than {sync.max_gap:.3g} s; that misses the motion by about {digits(turn, 2)} deg and "
            f"{digits(move, 2)} mm (root mean square)."
        )
    return lines


def _left_out(sync: Synchronised) -> list[Block]:
    if not sync.left_out:
        return [] if sync.stops is not None else [Paragraph("No pose was left out.")]
    listed = [Paragraph(str(part), indent="  ", hang="    ") for part in sync.left_out[:MOST_LISTED]]
    more = len(sync.left_out) - MOST_LISTED
    rest = [Paragraph(f"and {more} more groups; see left_out", indent="  ")] if more > 0 else []
    return [Heading("Left out:"), *listed, *rest]


def _scope(sync: Synchronised) -> str:
    carried = (
        "calibrate() takes the uncertainty of the offset into the covariance of X (methods efficient and ml). "
        if sync.offset_std > 0 and sync.stops is None
        else ""
    )
    if sync.noise is not None:
        carried += "Give it the noise of the pose pairs, `noise` of this result, not that of the samples. "
    return (
        f"{carried}Not covered: clocks that run at different rates, delays that change while recording. A delay that "
        "is constant is part of the offset."
    )


ROBOT, CAMERA, OFFSET = "#0072B2", "#D55E00", "black"
# Points of a curve beyond which only their extremes can be seen.
MOST_POINTS = 4000


def sync_figure(sync: Synchronised) -> Figure:
    """The three panels; a panel of what is not known says so."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 1.1))
    _speeds(figure.add_subplot(grid[0, :]), sync)
    _correlation(figure.add_subplot(grid[1, 0]), sync)
    _residuals(figure.add_subplot(grid[1, 1]), sync)
    how = "as given" if sync.origin == "given" else "1 standard deviation in parentheses"
    value = (
        f"{1e3 * sync.offset:.6g} ms"
        if sync.origin == "given"
        else concise(1e3 * sync.offset, 1e3 * sync.offset_std, "ms")
    )
    figure.suptitle(f"Time offset {value} ({how}): robot_time = camera_time + offset", fontsize=11)
    return figure


def _speeds(axis: Axes, sync: Synchronised) -> None:
    found = sync.correlation
    if found is None or not len(found.robot.speed) or sync.poses.timestamps is None:
        _nothing(axis, "no angular speeds")
        return
    at = sync.offset - sync.shift
    parts = (
        ("robot", found.robot.times - at, found.robot.speed, ROBOT, "-", 1.8),
        ("camera", found.camera.times, found.camera.speed, CAMERA, "--", 1.0),
    )
    highest = 0.0
    for name, times, speed, colour, line, width in parts:
        step = max(1, len(times) // MOST_POINTS)
        axis.plot(times[::step], np.degrees(speed[::step]), line, color=colour, linewidth=width, label=name)
        if np.isfinite(speed).any():
            highest = max(highest, float(np.degrees(np.nanquantile(speed, 0.995))))
    axis.set_ylim(0, 1.15 * highest or 1.0)
    axis.set_xlabel("time since the first camera pose (s)")
    axis.set_ylabel("angular speed (deg/s)")
    axis.legend(loc="upper right", ncols=2, frameon=False, fontsize=9)


def _correlation(axis: Axes, sync: Synchronised) -> None:
    found = sync.correlation
    if found is None or not len(found.lags):
        _nothing(axis, "the speeds were not correlated")
        return
    axis.plot(found.lags + sync.shift, found.values, color=ROBOT, linewidth=1.2)
    axis.axhline(found.needed, color="0.4", linestyle=":", linewidth=1.0)
    axis.annotate(
        "chance stays below", (0.02, found.needed), xycoords=("axes fraction", "data"), xytext=(0, 2),
        textcoords="offset points", fontsize=8, color="0.3",
    )  # fmt: skip
    axis.axvline(sync.offset, color=OFFSET, linewidth=0.9, linestyle="--")
    axis.set_xlabel("offset (s)")
    axis.set_ylabel("correlation of angular speeds")


def _residuals(axis: Axes, sync: Synchronised) -> None:
    curve = sync.residual_curve
    if curve is None:
        _nothing(axis, "residuals are not known")
        return
    offsets, rotation, translation = curve
    if sync.offset_std > 0:
        low, high = (1e3 * (sync.offset + sign * 2 * sync.offset_std) for sign in (-1, 1))
        axis.axvspan(low, high, color="0.85", label="offset, 2 standard deviations")
    axis.axvline(1e3 * sync.offset, color=OFFSET, linewidth=0.9, linestyle="--")
    for values, name, unit, factor, colour, line in (
        (rotation, "rotation", "deg", 180 / np.pi, ROBOT, "-"),
        (translation, "translation", "mm", 1e3, CAMERA, "-."),
    ):
        least = max(float(values.min()), 1e-300)
        label = f"{name}, smallest {digits(factor * least, 2)} {unit}"
        axis.plot(1e3 * offsets, values / least, line, color=colour, linewidth=1.5, label=label)
    axis.set_xlabel("offset (ms)")
    axis.set_ylabel("residual, by its smallest value")
    axis.legend(fontsize=8, loc="upper center", framealpha=0.9)


def _nothing(axis: Axes, text: str) -> None:
    axis.set_axis_off()
    axis.text(0.5, 0.5, text, ha="center", va="center", transform=axis.transAxes)
