"""Errors of a calibration as figures: of points, by source, of shared errors, and the residuals of each pose.

Models: `task_space`, where the point itself is exact, so that only the error of X counts, `prediction.workspace`, and
`pose_table`, whose ``d^2`` stands on a logarithmic scale with the limit beyond which a pose is flagged. Worst is the
standard deviation in the worst direction, the root of the largest eigenvalue of the point's covariance.
This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ...core.formatting.numbers import concise
from ...core.geometry.se3 import Array
from ...core.numbers.limits import MAX_DRAWN_POINTS, MAX_NAMED
from ...core.numbers.rounding import TINY
from ...core.presentation.figure_parts import (
    BLUE,
    HALO,
    INK,
    ORANGE,
    QUIET,
    SMALL,
    TEXT,
    WIDTH,
    canvas,
    finished,
    plain,
    plain_numbers,
)
from ...fit.diagnostics.pose_table import PoseTable
from ...fit.likelihood.shared_estimates import SharedGroup
from ..estimate.estimated import distance_of
from ..prediction.workspace import WorkspacePrediction
from .analysis import KINDS
from .facts import ahead, worst_deviation
from .text import found_of

if TYPE_CHECKING:
    from ..result import Calibration

# A map of the workspace and its axis of distances span at least this.
SMALLEST_MAP_M = 0.02
# The ends of a colour bar differ at least by this factor.
MIN_COLOUR_RATIO = 1.5
# More poses are drawn with smaller marks.
MAX_LARGE_MARKS = 200


def workspace_figure(found: WorkspacePrediction) -> Figure:
    """Left a section of the workspace with the 95 % radius, right the same over the distance from calibrated poses."""
    figure = canvas(3.5)
    left, right = figure.subplots(1, 2, width_ratios=[0.85, 1])
    _section(figure, left, found)
    _curves(right, found)
    return finished(figure)


def _section(figure: Figure, axis: Axes, found: WorkspacePrediction) -> None:
    """The 95 % radius in cells of the section, geometric mean about each; calibrated poses on top."""
    plain(axis)
    places, low, span = found.place, found.place.min(axis=0), np.ptp(found.place, axis=0)
    size = max(float(span.max()), SMALLEST_MAP_M) / 20
    edges = [low[k] + size * np.arange(max(int(np.ceil(span[k] / size)), 1) + 1) for k in range(2)]
    x, y = np.meshgrid(*(0.5 * (edge[1:] + edge[:-1]) for edge in edges))
    off2 = ((np.stack([x, y], axis=-1)[..., None, :] - places) ** 2).sum(axis=-1) / size**2
    weight = np.exp(-0.5 * off2)
    cells = 1e3 * np.exp((weight @ np.log(found.radius_95)) / np.maximum(weight.sum(axis=-1), TINY))
    cells = np.where(off2.min(axis=-1) < 1.0, cells, np.nan)
    least, most = float(np.nanmin(cells)), float(np.nanmax(cells))
    if most < MIN_COLOUR_RATIO * least:
        middle = np.sqrt(least * most)
        least, most = middle / np.sqrt(MIN_COLOUR_RATIO), middle * np.sqrt(MIN_COLOUR_RATIO)
    drawn = axis.pcolormesh(
        edges[0],
        edges[1],
        np.ma.masked_invalid(cells),
        cmap="cividis_r",
        norm=LogNorm(least, most),
        edgecolors="face",
        linewidth=0.3,
    )
    _bar(figure, axis, drawn)
    axis.plot(
        found.near_place[:, 0], found.near_place[:, 1], "o", markersize=4.0, markerfacecolor="white",
        markeredgecolor="black", markeredgewidth=0.9, label="calibrated poses", clip_on=False, zorder=3,
    )  # fmt: skip
    axis.legend(
        fontsize=SMALL, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), borderpad=0.1, handletextpad=0.3
    )
    axis.grid(visible=False)
    axis.set_aspect("equal")
    axis.set_xlabel("flange: distance from joint 1 (m)", fontsize=TEXT)
    axis.set_ylabel("height above the base (m)", fontsize=TEXT)


def _bar(figure: Figure, axis: Axes, drawn: QuadMesh) -> None:
    """A logarithmic colour bar with few numbers."""
    least, most = drawn.get_clim()
    bar = figure.colorbar(drawn, ax=axis, shrink=0.95)
    bar.set_label("95 % radius (mm)", fontsize=TEXT)
    bar.ax.tick_params(labelsize=SMALL)
    if most > 6.0 * least:
        plain_numbers(bar.ax)
        return
    ticks = [tick for tick in MaxNLocator(5).tick_values(least, most) if least <= tick <= most]
    bar.set_ticks(ticks, labels=[f"{tick:.4g}" for tick in ticks])
    bar.ax.minorticks_off()


def _curves(axis: Axes, found: WorkspacePrediction) -> None:
    """Median, and the range of 90 % of the postures, over the distance; and what nominal poses add."""
    plain(axis)
    away = np.concatenate([np.zeros(len(found.near_radius_95)), found.away])
    radius, bias = (
        1e3 * np.concatenate(parts)
        for parts in ((found.near_radius_95, found.radius_95), (found.near_bias, found.bias))
    )
    ends = np.quantile(found.away, np.linspace(0.0, 1.0, 8))
    groups = [away == 0.0, *((away > low) & (away <= high) for low, high in pairwise(ends))]
    groups = [group for group in groups if group.any()]
    x = np.array([away[group].mean() for group in groups])
    low, middle, high = (np.array([np.quantile(radius[group], q) for group in groups]) for q in (0.05, 0.5, 0.95))
    axis.fill_between(x, low, high, color="0.8", linewidth=0, label="9 of 10 postures")
    axis.plot(
        x, middle, color="black", linewidth=1.6, marker="o", markersize=3, clip_on=False, label="95 % radius, median"
    )
    if (bias > 1e-3 * radius.min()).any():
        rms = np.array([np.sqrt(np.mean(bias[group] ** 2)) for group in groups])
        axis.plot(
            x, rms, color=ORANGE, linewidth=1.6, linestyle="--", marker="s", markersize=3, clip_on=False,
            label="nominal poses add (RMS)",
        )  # fmt: skip
        _fit(axis, np.concatenate([low, high, rms]))
    else:
        _fit(axis, np.concatenate([low, high]))
    axis.set_xlim(0, max(float(x[-1]), SMALLEST_MAP_M) * 1.02)
    axis.set_xlabel("flange from the nearest calibrated pose (m)", fontsize=TEXT)
    axis.set_ylabel("miss of the tool (mm)", fontsize=TEXT, color=INK)
    axis.legend(fontsize=SMALL, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=1, borderpad=0.1)


def _fit(axis: Axes, values: Array) -> None:
    """A logarithmic axis that holds the values, with numbers on it."""
    values = values[values > 0]
    axis.set_yscale("log")
    axis.set_ylim(float(values.min()) / 1.3, float(values.max()) * 1.3)
    plain_numbers(axis)


_HALF_ANGLE = np.tan(np.radians(30.0))


def task_space_figure(result: Calibration) -> Figure:
    """Left the standard deviation over the distance, right a map of the plane in front of the camera."""
    typical, known = distance_of(result.analysis)
    reach = 2.0 * typical
    line = ahead(result, np.linspace(0.0, reach, 81))
    figure = canvas(3.3)
    left, right = figure.subplots(1, 2, width_ratios=[1.15, 1])
    plain(left)
    for values, colour, style, name in (
        (line.worst, "black", "-", "worst direction"),
        (line.across, BLUE, "--", "across the line of sight"),
        (line.along, ORANGE, "-.", "along the line of sight"),
    ):
        left.plot(line.distance, 1e3 * values, color=colour, linestyle=style, linewidth=1.6, label=name)
    if known:
        left.axvline(typical, color=QUIET, linewidth=0.9, linestyle=":")
        left.annotate(
            "target, RMS", (typical, 0), xycoords=("data", "axes fraction"), xytext=(3, 4), textcoords="offset points",
            fontsize=SMALL, color=INK,
        )  # fmt: skip
    left.set_xlim(0, reach)
    left.set_ylim(0, 1.45e3 * max(float(line.worst.max()), 1e-12))
    left.set_xlabel("distance in front of the camera (m)", fontsize=TEXT)
    left.set_ylabel("standard deviation (mm)", fontsize=TEXT)
    left.legend(fontsize=SMALL, frameon=False, loc="upper left", handlelength=2.6)

    z, slope = np.meshgrid(np.linspace(0.02, 1.0, 50) * reach, np.linspace(-1.0, 1.0, 41))
    x = slope * _HALF_ANGLE * z
    worst = 1e3 * worst_deviation(result.uncertainty_at(np.stack([x, 0 * x, z], axis=-1)).covariance)
    plain(right)
    right.grid(visible=False)
    if np.ptp(worst) > 1e-9 * worst.max():
        filled = right.contourf(x, z, worst, levels=5, cmap="cividis")
        right.contour(x, z, worst, levels=filled.levels, colors="white", linewidths=0.6)
        bar = figure.colorbar(filled, ax=right, shrink=0.9)
        bar.set_label("worst direction (mm)", fontsize=TEXT)
        bar.ax.tick_params(labelsize=SMALL)
    right.set_aspect("equal")
    right.set_xlabel("camera x (m)", fontsize=TEXT)
    right.set_ylabel("camera z (m)", fontsize=TEXT)
    return finished(figure)


_STYLES = ((BLUE, ""), (ORANGE, "////"))  # rotation, translation


def budget_figure(shares: Mapping[str, Array]) -> Figure:
    """Two bars for each source, of ``shares`` (2,): of the variances of X's rotation and translation."""
    count = len(shares)
    figure = canvas(0.95 + 0.52 * count)
    axis = figure.subplots()
    plain(axis)
    axis.grid(axis="y", visible=False)
    values = 100 * np.stack(list(shares.values()))
    for k, (kind, (colour, hatch)) in enumerate(zip(KINDS, _STYLES, strict=True)):
        y = np.arange(count) + 0.2 * (2 * k - 1)
        axis.barh(y, values[:, k], 0.36, color=colour, hatch=hatch, edgecolor="white", label=f"of X's {kind}")
        for row, value in zip(y, values[:, k], strict=True):
            axis.annotate(
                f"{value:.1f} %", (max(value, 0.0), row), xytext=(3, 0), textcoords="offset points", va="center",
                fontsize=SMALL, color=INK,
            )  # fmt: skip
    axis.set_yticks(range(count), labels=list(shares), fontsize=TEXT)
    axis.set_ylim(count - 0.5, -0.5)
    axis.set_xlim(min(0.0, 1.1 * float(values.min())), 1.12 * max(float(values.max()), 1.0))
    axis.set_xlabel("share of the variance (%)", fontsize=TEXT)
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=SMALL)
    return finished(figure)


def shared_figure(errors: Sequence[SharedGroup]) -> Figure:
    """A bar of +- one assumed standard deviation for each error, and its estimate with the one after the fit.

    Of an error of many numbers the estimates are dots, without their standard deviations.
    """
    count = len(errors)
    figure = canvas(1.0 + 0.42 * count)
    axis = figure.subplots()
    plain(axis)
    axis.grid(axis="y", visible=False)
    y = np.arange(count)
    z = [np.array([part.estimate / part.prior_sd for part in error.parts]) for error in errors]
    after = [np.array([part.sd / part.prior_sd for part in error.parts]) for error in errors]
    ends = [np.abs(of) + (sd if len(of) == 1 else 0.0) for of, sd in zip(z, after, strict=True)]
    reach = float(min(max(1.3, 1.1 * max(float(end.max()) for end in ends)), 6.0))
    axis.barh(y, 2.0, 0.56, left=-1.0, color=QUIET, alpha=0.35, label="assumed, 1 sigma")
    single = [k for k, error in enumerate(errors) if error.count == 1]
    axis.errorbar(
        np.clip([z[k][0] for k in single], -reach, reach), single, xerr=[after[k][0] for k in single], fmt="o",
        markersize=4.5, color=BLUE, elinewidth=1.8, capsize=3, label="found, 1 sigma after the fit",
    )  # fmt: skip
    for k, error in enumerate(errors):
        if error.count > 1:
            axis.plot(np.clip(z[k], -reach, reach), np.full(error.count, k), "o", markersize=3, color=BLUE, alpha=0.5)
        axis.annotate(
            _amount(error), (1.0, k), xycoords=("axes fraction", "data"),
            xytext=(4, 0), textcoords="offset points", va="center", fontsize=SMALL, color=INK, annotation_clip=False,
        )  # fmt: skip
    axis.axvline(0.0, color=INK, linewidth=0.8)
    axis.set_yticks(range(count), labels=[error.name for error in errors], fontsize=TEXT)
    axis.set_ylim(count - 0.5, -0.5)
    axis.set_xlim(-reach, reach)
    axis.set_xlabel("error, in standard deviations assumed", fontsize=TEXT)
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=SMALL)
    return finished(figure)


def _amount(error: SharedGroup) -> str:
    if error.count > 1:
        return found_of(error)
    factor, unit = error.parts[0].shown
    return concise(factor * error.parts[0].estimate, factor * error.parts[0].sd, unit)


# Marker and colour by the first word of the flag.
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
    """Three panels over the numbers of the poses (or motions); ``small``: without d^2, in half the width."""
    figure = canvas(2.0, WIDTH / 2) if small else canvas(5.4)
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
    # Of very many poses the smallest residuals say nothing; of few all are shown.
    low = float(np.quantile(positive, 0.01 if len(positive) > MAX_LARGE_MARKS else 0.0)) if positive.size else 1.0
    high = float(positive.max()) if positive.size else 1.0
    axis.set_ylim(0.5 * max(low, 1e-6 * high), 3.0 * high)


def _named(axis: Axes, rows: list[int], value: Array, count: int) -> None:
    """Numbers beside the farthest of the flagged poses, unless another number is in the way."""
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
