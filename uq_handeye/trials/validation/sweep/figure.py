"""A sweep over the noise as a figure: the mean NEES of each method against the noise, first order and sigma points.

One panel per method, both axes logarithmic, the noise in multiples of its standard deviations. A consistent covariance
stays at 6. The dark band is chance (99 %, chi-square), the light one errors that are as predicted within the tolerance.
Dotted: where a covariance begins to fail, with ~ where tails are heavy. White markers: levels at which it fails, by the
NEES or by what its 95 % ellipsoid holds.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import math
import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ....core.formatting.numbers import digits, rough
from ....core.presentation.figure_parts import HALO
from ..outcome import figure_of
from .level import KINDS, Limit, MethodSweep
from .run import Sweep

# Colours of Okabe and Ito, lines and markers apart in greyscale too.
STYLES: dict[str, tuple[str, Any, str]] = {KINDS[0]: ("#D55E00", "-", "o"), KINDS[1]: ("#0072B2", (0, (4, 1.5)), "s")}
COLUMNS = 3
_WIDTH, _HEIGHT = 3.6, 3.0  # inches of a panel


@figure_of.register
def sweep_figure(result: Sweep) -> Figure:
    """The figure, as Matplotlib has it."""
    columns = min(COLUMNS, len(result.methods))
    rows = -(-len(result.methods) // columns)
    # a single panel is made wider, for the words above and below
    width = max(columns * _WIDTH, 5.2) + 0.3
    footer = textwrap.wrap(_footer(result), int(18 * width))
    more = 0.12 * (len(footer) - 1)
    height = rows * _HEIGHT + 0.95 + more
    drawn = Figure(figsize=(width, height))
    FigureCanvasAgg(drawn)
    axes = drawn.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    drawn.subplots_adjust(
        left=0.7 / width,
        right=1 - 0.12 / width,
        bottom=(0.62 + more) / height,
        top=1 - 0.72 / height,
        wspace=0.08,
        hspace=0.22,
    )
    low, high = _range(result)
    for axis, found in zip(axes.flat, result.methods, strict=False):
        _panel(axis, result, found, (low, high))
    for axis in axes.flat[len(result.methods) :]:
        axis.set_axis_off()
    for axis in axes[:, 0]:
        axis.set_ylabel("mean NEES, joint (6 if consistent)", fontsize=8)
    for k in range(columns):
        lowest = min(rows - 1, (len(result.methods) - 1 - k) // columns)
        axes[lowest, k].set_xlabel("noise, in your standard deviations", fontsize=8)
        axes[lowest, k].tick_params(labelbottom=True)
    drawn.text(
        0.12 / width,
        1 - 0.1 / height,
        f"Where first order ends: {result.frame} of {result.count} {result.item}",
        fontsize=10,
        fontweight="bold",
        va="top",
    )
    handles, labels = axes.flat[0].get_legend_handles_labels()
    drawn.legend(
        handles,
        labels,
        loc="upper left",
        bbox_to_anchor=(0.06 / width, 1 - 0.25 / height),
        ncols=len(labels),
        fontsize=7,
        frameon=False,
        handlelength=2.4,
        columnspacing=1.2,
    )
    drawn.text(0.12 / width, 0.08 / height, "\n".join(footer), fontsize=6.5, color="0.3", va="bottom")
    return drawn


def _footer(result: Sweep) -> str:
    """Explain the marks in the figure."""
    limits = [found.limit(kind) for found in result.methods for kind in KINDS]
    text = f"{result.trials:,} trials per level; all levels share their draws."
    failing = (not level.of(kind).holds for found in result.methods for level in found.levels for kind in KINDS)
    if any(failing):
        text += " White: fails, by NEES or by its 95 % ellipsoid."
    if any(limit.fails is not None for limit in limits):
        text += " Dotted: from here on."
    if any(limit.heavy for limit in limits):
        text += " ~: heavy tails, beyond it is chance which levels pass."
    return text


def _range(result: Sweep) -> tuple[float, float]:
    """Limits of the NEES: all values, and never less than the band of the tolerance with some room."""
    edge = 6 * (1 + result.tolerance) ** 2
    values = [edge * 1.3, 36 / edge / 1.3]
    for found in result.methods:
        for level in found.levels:
            values += [float(t.mean_nees[0]) for t in map(level.of, KINDS) if t.mean_nees is not None]
    low, high = max(min(values), 1e-3), max(values)
    room = (high / low) ** 0.06
    return low / room, high * room


def _panel(axis: Axes, result: Sweep, found: MethodSweep, nees: tuple[float, float]) -> None:
    axis.set_xscale("log")
    axis.set_yscale("log")
    matters = (1 + result.tolerance) ** 2
    axis.axhspan(6 / matters, 6 * matters, color="0.93", linewidth=0, zorder=0, label=_tolerance(result))
    interval = next(
        (
            level.first_order.consistency.nees_interval[0]
            for level in found.levels
            if level.first_order.consistency is not None and level.first_order.consistency.nees_interval is not None
        ),
        None,
    )
    if interval is not None:
        axis.axhspan(*interval, color="0.8", linewidth=0, zorder=1, label="chance")
    axis.axvline(1.0, color="black", linewidth=1.0, zorder=2)
    axis.annotate(
        "your noise",
        (1.0, 0.985),
        xycoords=("data", "axes fraction"),
        xytext=(3, 0),
        textcoords="offset points",
        va="top",
        fontsize=7,
    )
    for kind, (colour, line, marker) in STYLES.items():
        known = [(level.deviations, level.of(kind)) for level in found.levels if level.of(kind).mean_nees is not None]
        x = np.array([deviations for deviations, _ in known])
        y = np.array([0.0 if tested.mean_nees is None else tested.mean_nees[0] for _, tested in known])
        holds = np.array([tested.holds for _, tested in known], dtype=bool)
        axis.plot(x, y, color=colour, linestyle=line, linewidth=1.4, zorder=4, marker=marker, markersize=0, label=kind)
        for which, face in ((holds, colour), (~holds, "white")):
            axis.plot(
                x[which],
                y[which],
                linestyle="",
                marker=marker,
                markersize=5.4 if marker == "o" else 3.2,
                markerfacecolor=face,
                markeredgecolor=colour,
                markeredgewidth=1.0,
                zorder=5,
            )
        _mark(axis, found.limit(kind), colour, 0.80 if kind == KINDS[0] else 0.68)
    axis.set_title(found.method, fontsize=8.5, loc="left", pad=3)
    axis.set_ylim(*nees)
    deviations = found.levels[0].deviations, found.levels[-1].deviations
    for one, (low, high) in ((axis.xaxis, deviations), (axis.yaxis, nees)):
        one.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 200 * low else (1.0,)))
        one.set_major_formatter(FuncFormatter(_tick))
        one.set_minor_formatter(NullFormatter())
    axis.tick_params(labelsize=7)
    axis.grid(True, which="major", color="0.9", linewidth=0.5, zorder=0)


def _tick(value: float, _: Any) -> str:
    return f"{value:g}" if value < 1e4 else f"$10^{{{math.log10(value):.0f}}}$"


def _mark(axis: Axes, limit: Limit, colour: str, height: float) -> None:
    """Mark where a covariance begins to fail."""
    if limit.fails is None:
        return
    x = math.sqrt(limit.fails if limit.holds is None else math.sqrt(limit.holds * limit.fails))
    axis.axvline(x, color=colour, linestyle=":", linewidth=1.0, zorder=3)
    axis.annotate(
        f"{'<' if limit.holds is None else ''}{'~' + rough(x) if limit.heavy else digits(x, 2)}",
        (x, height),
        xycoords=("data", "axes fraction"),
        xytext=(-3, 0),
        textcoords="offset points",
        ha="right",
        fontsize=7,
        color=colour,
        path_effects=HALO,
        zorder=6,
    )


def _tolerance(result: Sweep) -> str:
    return f"errors as predicted within {100 * result.tolerance:g} %"
