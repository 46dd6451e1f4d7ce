r"""Two synchronised streams as a figure: the angular speeds on one clock, their correlation, residuals by offset.

Above, the angular speeds (deg/s) of robot and camera on the clock of the camera, the robot's moved by the offset: the
two curves lie on each other if the offset is right. Below left, the correlation coefficient of both at each lag (s)
that was looked at. Below right the residuals (per axis, root mean square) of the best X and W at each offset near the
estimate, rotation and translation each by its smallest value; the band is the offset with two standard deviations.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ...core.formatting.numbers import concise, digits

# Synchronised streams; their class imports this module.
Drawn = Any

ROBOT, CAMERA, OFFSET = "#0072B2", "#D55E00", "black"
# Points of a curve beyond which only their extremes can be seen.
MOST_POINTS = 4000


def sync_figure(sync: Drawn) -> Figure:
    """The three panels; a panel of what is not known says so."""
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


def alt_text(sync: Drawn) -> str:
    """Describe the figure in words."""
    high = "" if sync.correlation is None or not sync.correlation.heights else f" of {sync.correlation.heights[0]:.2f}"
    return (
        "Angular speeds of robot and camera against time, the robot's moved by the offset of "
        f"{1e3 * sync.offset:.4g} ms; their correlation against the lag, with its peak{high}; and the residuals "
        "against the offset, smallest at the estimate, with a band of two standard deviations "
        f"({digits(2e3 * sync.offset_std, 2)} ms)."
    )


def _speeds(axis: Axes, sync: Drawn) -> None:
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


def _correlation(axis: Axes, sync: Drawn) -> None:
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


def _residuals(axis: Axes, sync: Drawn) -> None:
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
