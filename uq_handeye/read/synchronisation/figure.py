"""Two synchronised streams as a figure: the angular speeds on one clock, their correlation, residuals by offset.

Above, the angular speeds (deg/s) of robot and camera on the clock of the camera, the robot's moved by the offset: the
two curves coincide if the offset is right. Below left, the correlation coefficient of both at each lag (s) that was
searched. Below right, the residuals (per axis, root mean square) of the best X and W at each offset near the
estimate, rotation and translation each by its smallest value; the band is the offset with two standard deviations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.geometry.se3 import Array
from ...core.limits import MAX_DRAWN_POINTS
from ...core.presentation.colours import BLUE, ORANGE
from ...core.presentation.numbers import digits
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M, MS_PER_S
from ...core.rounding import TINY
from .correlation import Correlation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of robot, camera and offset that colour-blind people can distinguish.
ROBOT_COLOUR, CAMERA_COLOUR, OFFSET_COLOUR = BLUE, ORANGE, "black"


def sync_figure(
    title: str,
    correlation: Correlation | None,
    residuals: tuple[Array, Array, Array] | None,
    offset: float,
    offset_sd: float,
    shift: float,
) -> Figure:
    """Return the three panels; a panel of what is not known says so.

    ``residuals`` are offsets (s), rotations (rad) and translations (m); ``shift`` is between the origins of time of
    the streams.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 1.1))
    _speeds(figure.add_subplot(grid[0, :]), correlation, offset - shift)
    _correlation(figure.add_subplot(grid[1, 0]), correlation, offset, shift)
    _residuals(figure.add_subplot(grid[1, 1]), residuals, offset, offset_sd)
    figure.suptitle(title, fontsize=11)
    return figure


def _speeds(axis: Axes, found: Correlation | None, offset: float) -> None:
    if found is None or not len(found.robot.speed):
        _nothing(axis, "no angular speeds")
        return
    parts = (
        ("robot", found.robot.times - offset, found.robot.speed, ROBOT_COLOUR, "-", 1.8),
        ("camera", found.camera.times, found.camera.speed, CAMERA_COLOUR, "--", 1.0),
    )
    highest = 0.0
    for name, times, speed, colour, line, width in parts:
        step = max(1, len(times) // MAX_DRAWN_POINTS)
        axis.plot(times[::step], np.degrees(speed[::step]), line, color=colour, linewidth=width, label=name)
        if np.isfinite(speed).any():
            highest = max(highest, float(np.degrees(np.nanquantile(speed, 0.995))))
    axis.set_ylim(0, 1.15 * highest or 1.0)
    axis.set_xlabel("time since the first camera pose (s)")
    axis.set_ylabel("angular speed (deg/s)")
    axis.legend(loc="upper right", ncols=2, frameon=False, fontsize=9)


def _correlation(axis: Axes, found: Correlation | None, offset: float, shift: float) -> None:
    if found is None or not len(found.lags):
        _nothing(axis, "the speeds were not correlated")
        return
    axis.plot(found.lags + shift, found.values, color=ROBOT_COLOUR, linewidth=1.2)
    axis.axhline(found.needed, color="0.4", linestyle=":", linewidth=1.0)
    axis.annotate(
        "chance stays below", (0.02, found.needed), xycoords=("axes fraction", "data"), xytext=(0, 2),
        textcoords="offset points", fontsize=8, color="0.3",
    )  # fmt: skip
    axis.axvline(offset, color=OFFSET_COLOUR, linewidth=0.9, linestyle="--")
    axis.set_xlabel("offset (s)")
    axis.set_ylabel("correlation of angular speeds")


def _residuals(axis: Axes, curve: tuple[Array, Array, Array] | None, offset: float, offset_sd: float) -> None:
    if curve is None:
        _nothing(axis, "residuals are not known")
        return
    offsets, rotation, translation = curve
    if offset_sd > 0:
        low, high = (MS_PER_S * (offset + sign * 2 * offset_sd) for sign in (-1, 1))
        axis.axvspan(low, high, color="0.85", label="offset, 2 standard deviations")
    axis.axvline(MS_PER_S * offset, color=OFFSET_COLOUR, linewidth=0.9, linestyle="--")
    for values, name, unit, factor, colour, line in (
        (rotation, "rotation", "deg", DEG_PER_RAD, ROBOT_COLOUR, "-"),
        (translation, "translation", "mm", MM_PER_M, CAMERA_COLOUR, "-."),
    ):
        least = max(float(values.min()), TINY)
        label = f"{name}, smallest {digits(factor * least, 2)} {unit}"
        axis.plot(MS_PER_S * offsets, values / least, line, color=colour, linewidth=1.5, label=label)
    axis.set_xlabel("offset (ms)")
    axis.set_ylabel("residual, by its smallest value")
    axis.legend(fontsize=8, loc="upper center", framealpha=0.9)


def _nothing(axis: Axes, text: str) -> None:
    axis.set_axis_off()
    axis.text(0.5, 0.5, text, ha="center", va="center", transform=axis.transAxes)
