"""Figure of a series of checks: the shift of X estimated from each check.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.limits import MAX_NAMED
from ...core.presentation.colours import BLUE, GREEN, ORANGE, QUIET
from ...core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from .log import CheckSeries


def series_figure(series: CheckSeries, what: str = "X") -> Figure:
    """Draw translation and rotation of the shift with two standard deviations; ``what`` names what has moved."""
    figure = canvas(4.2)
    above, below = figure.subplots(2, 1, sharex=True)
    _shifts(above, series, slice(3, 6), MM_PER_M, f"{what}, translation (mm)")
    _shifts(below, series, slice(0, 3), DEG_PER_RAD, f"{what}, rotation (deg)")
    n = len(series.checks)
    at = list(range(1, n + 1, max(1, -(-n // MAX_NAMED))))
    below.set_xticks(at, labels=[f"{k}\n{series.checks[k - 1].time[:10]}" for k in at], fontsize=SMALL)
    below.set_xlim(0.4, n + 0.6)
    below.set_xlabel("check", fontsize=TEXT)
    return finished(figure)


def _shifts(axis: Axes, series: CheckSeries, part: slice, unit: float, words: str) -> None:
    """Draw three components of the shift of each check, side by side."""
    plain(axis)
    axis.axhline(0.0, color=QUIET, linewidth=0.8)
    at = np.arange(1, len(series.checks) + 1)
    values = unit * np.array([check.shift[part] for check in series.checks])
    sd = unit * np.array([check.shift_std[part] for check in series.checks])
    for k, (colour, mark) in enumerate(((BLUE, "o"), (ORANGE, "s"), (GREEN, "^"))):
        axis.errorbar(
            at + 0.18 * (k - 1), values[:, k], yerr=2 * sd[:, k], fmt=mark, color=colour, markersize=3,
            elinewidth=0.8, label="xyz"[k],
        )  # fmt: skip
    axis.set_ylabel(words, fontsize=TEXT)
    axis.legend(loc="upper left", ncols=3, frameon=False, fontsize=SMALL)
