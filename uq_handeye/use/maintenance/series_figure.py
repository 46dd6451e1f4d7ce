"""A series of checks as a figure: the CUSUM charts, and the shift of X that each check asks for.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.presentation.figure_parts import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    QUIET,
    SMALL,
    TEXT,
    canvas,
    finished,
    plain,
)
from .log import CheckSeries
from .series_alarm import RESIDUALS, TARGET, SeriesAlarm, X, day

_LINES = {
    X: (BLUE, "-", "shift of X"),
    TARGET: (ORANGE, "--", "shift of the target"),
    RESIDUALS: (PURPLE, ":", "all residuals"),
}
_AXES = ((BLUE, "o", "x"), (ORANGE, "s", "y"), (GREEN, "^", "z"))
# Charts are drawn up to so many times their limit.
HIGHEST = 3.0
# Dates below the figure.
MOST_DATES = 7


def series_figure(series: CheckSeries, found: SeriesAlarm) -> Figure:
    """Three panels over the number of the check: the charts in units of their limits, translation, rotation."""
    figure = canvas(5.4)
    above, middle, below = figure.subplots(3, 1, sharex=True, height_ratios=(1.3, 1.0, 1.0))
    used = [k + 1 for k, check in enumerate(series.checks) if check.used]
    _charts(above, used, found)
    for axis, part, unit, words in (
        (middle, slice(3, 6), 1e3, "translation (mm)"),
        (below, slice(0, 3), 180 / np.pi, "rotation (deg)"),
    ):
        what = "X" if {chart.name for chart in found.charts} <= set(_LINES) else "move"
        _shifts(axis, series, part, unit, f"{what}, {words}")
    if found.since is not None:
        for axis in (above, middle, below):
            axis.axvspan(used[found.since] - 0.5, used[-1] + 0.5, color="0.93", zorder=0, linewidth=0)
    n = len(series.checks)
    step = max(1, -(-n // MOST_DATES))
    at = list(range(1, n + 1, step))
    below.set_xticks(at, labels=[f"{k}\n{day(series.checks[k - 1].time)}" for k in at], fontsize=SMALL)
    below.set_xlim(0.4, n + 0.6)
    below.set_xlabel("check", fontsize=TEXT)
    return finished(figure)


def _charts(axis: Axes, used: list[int], found: SeriesAlarm) -> None:
    plain(axis)
    for k, chart in enumerate(found.charts):
        colour, line, words = _LINES.get(chart.name, (f"C{k}", "-", f"move of {chart.name}"))
        axis.plot(
            used, np.minimum(chart.path / chart.limit, HIGHEST), line, color=colour, linewidth=1.5, marker=".",
            markersize=4, label=words,
        )  # fmt: skip
    axis.axhline(1.0, color=INK, linewidth=1.0)
    axis.annotate(
        f"limit: one false alarm in {found.every:g} checks", (0.0, 1.0), xycoords=("axes fraction", "data"),
        xytext=(3, 3), textcoords="offset points", fontsize=SMALL, color=INK,
    )  # fmt: skip
    top = max([1.25, *(1.1 * min(float(c.path.max() / c.limit), HIGHEST) for c in found.charts)])
    axis.set_ylim(0.0, top)
    axis.set_ylabel("CUSUM, by its limit", fontsize=TEXT)
    axis.legend(loc="upper left", bbox_to_anchor=(0.0, 0.78), frameon=False, fontsize=SMALL)


def _shifts(axis: Axes, series: CheckSeries, part: slice, unit: float, words: str) -> None:
    plain(axis)
    axis.axhline(0.0, color=QUIET, linewidth=0.8)
    at = np.arange(1, len(series.checks) + 1)
    values = unit * np.array([check.shift[part] for check in series.checks])
    sd = unit * np.array([check.shift_std[part] for check in series.checks])
    for k, (colour, mark, name) in enumerate(_AXES):
        axis.errorbar(
            at + 0.18 * (k - 1), values[:, k], yerr=2 * sd[:, k], fmt=mark, color=colour, markersize=3,
            elinewidth=0.8, label=name,
        )  # fmt: skip
    axis.set_ylabel(words, fontsize=TEXT)
    axis.legend(loc="upper left", ncols=3, frameon=False, fontsize=SMALL)
