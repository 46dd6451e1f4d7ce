"""The residuals of each pose as a figure: rotation, translation, and the squared distance ``d^2`` with its limit.

Model: `pose_table`. ``d^2`` is drawn on a logarithmic scale, with the limit beyond which a pose is flagged.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ...core.geometry.se3 import Array
from ...core.limits import MAX_DRAWN_POINTS, MAX_NAMED
from ...core.presentation.colours import BLUE, INK, ORANGE, QUIET
from ...core.presentation.figure_parts import FIGURE_WIDTH_IN, HALO, SMALL, TEXT, canvas, finished, plain, plain_numbers
from ...fit.diagnostics.pose_table import PoseTable

if TYPE_CHECKING:
    pass

# More poses are drawn with smaller marks.
MAX_LARGE_MARKS = 200
# Marker and colour are chosen by the first word of the flag.
MARKS: dict[str, dict[str, Any]] = {
    "kept": {"marker": "o", "color": BLUE, "markersize": 3.6, "markeredgewidth": 0},
    "downweighted": {
        "marker": "^", "color": "#B07500", "markersize": 6.0, "markerfacecolor": "white", "markeredgewidth": 1.2
    },
    "outlier": {"marker": "s", "color": ORANGE, "markersize": 5.0, "markeredgewidth": 0},
    "rejected": {"marker": "X", "color": ORANGE, "markersize": 7.0, "markeredgecolor": "white", "markeredgewidth": 0.5},
    "excluded": {
        "marker": "o", "color": QUIET, "markersize": 4.6, "markerfacecolor": "white", "markeredgewidth": 1.1
    },
}  # fmt: skip


def residual_figure(table: PoseTable, small: bool = False) -> Figure:
    """Figure of three panels over the numbers of the poses (or motions); ``small``: without d^2, in half the width."""
    figure = canvas(2.0, FIGURE_WIDTH_IN / 2) if small else canvas(5.4)
    axes: Any = figure.subplots(2 if small else 3, 1, sharex=True, height_ratios=[1, 1, 1.15][: 2 if small else 3])
    values = (1e3 * table.translation, np.degrees(table.rotation), np.maximum(table.distance2, 1e-3))
    names = ("mm", "deg", "") if small else ("translation (mm)", "rotation (deg)", "$d^2$")
    groups = {word: np.array([flag == word for flag in table.flag], dtype=bool) for word in MARKS}
    many = MAX_LARGE_MARKS / 3 if small else MAX_LARGE_MARKS
    for axis, value, name in zip(axes, values, names, strict=False):
        plain(axis)
        axis.set_ylabel(name, fontsize=SMALL if small else TEXT)
        few_hide_all = value.max() > 12 * max(float(np.median(value[table.counted])), 1e-12)
        _limits(axis, value, logarithmic=name == "$d^2$" or bool(few_hide_all))
        for word, rows in groups.items():
            marks = MARKS[word] | ({"markersize": 1.8} if word == "kept" and len(table) > many else {})
            if word != "rejected":
                marks = marks | {"rasterized": rows.sum() > MAX_DRAWN_POINTS}
            label = f"{word} ({rows.sum():,})" if rows.any() else None
            axis.plot(np.flatnonzero(rows), value[rows], linestyle="", label=label, **marks)
    handles, labels = axes[0].get_legend_handles_labels()
    if not small:
        axes[2].axhline(table.limit, color=INK, linewidth=1.0, linestyle="--")
        axes[2].set_ylim(top=max(axes[2].get_ylim()[1], 2.0 * table.limit))
        handles.append(Line2D([], [], color=INK, linewidth=1.0, linestyle="--"))
        labels.append(f"limit of $d^2$, {table.limit:.3g}")
    for axis in axes:
        if axis.get_yscale() == "log":
            plain_numbers(axis)
    if not small:
        _named(axes[2], sorted(table.flagged, key=lambda k: -table.distance2[k])[:MAX_NAMED], values[2], len(table))
    last = axes[-1]
    last.set_xlabel(f"number of the {table.item}, counted from 0", fontsize=SMALL if small else TEXT)
    last.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True, min_n_ticks=1))
    margin = 0.02 * max(len(table) - 1, 1) + 0.4
    last.set_xlim(-margin, len(table) - 1 + margin)
    figure.legend(
        handles, labels, loc="outside upper right", ncols=3 if small else 5, frameon=False,
        fontsize=SMALL, columnspacing=1.2, handletextpad=0.4,
    )  # fmt: skip
    return finished(figure)


def _limits(axis: Axes, value: Array, logarithmic: bool) -> None:
    if not logarithmic:
        axis.set_ylim(0, 1.12 * max(float(value.max()), 1e-9))
        return
    axis.set_yscale("log")
    positive = value[value > 0]
    # Of very many poses the smallest residuals are not informative; of few all are shown.
    low = float(np.quantile(positive, 0.01 if len(positive) > MAX_LARGE_MARKS else 0.0)) if positive.size else 1.0
    high = float(positive.max()) if positive.size else 1.0
    axis.set_ylim(0.5 * max(low, 1e-6 * high), 3.0 * high)


def _named(axis: Axes, rows: list[int], value: Array, count: int) -> None:
    """Write numbers next to the farthest of the flagged poses, unless another number is in the way."""
    low, high = np.log(axis.get_ylim())
    taken: list[tuple[float, float]] = []
    for k in rows:
        where = k / max(count - 1, 1), (np.log(value[k]) - low) / (high - low)
        if any(abs(where[0] - x) < 0.05 and abs(where[1] - y) < 0.12 for x, y in taken):
            continue
        taken.append(where)
        right = where[0] < 0.93
        axis.annotate(
            str(k), (k, value[k]), xytext=(5 if right else -5, 0), textcoords="offset points", va="center",
            ha="left" if right else "right", fontsize=SMALL, color=INK, path_effects=HALO, zorder=9,
        )  # fmt: skip
