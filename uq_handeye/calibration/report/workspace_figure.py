"""The workspace as a figure: the distance by which the tool misses a point, in a section and by distance.

Model: `prediction.workspace`.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.geometry.se3 import Array
from ...core.presentation.colours import INK, ORANGE
from ...core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain, plain_numbers
from ...core.rounding import TINY
from ..prediction.workspace import WorkspacePrediction

if TYPE_CHECKING:
    pass

# A map of the workspace and its axis of distances span at least this.
SMALLEST_MAP_M = 0.02
# The ends of a colour bar differ at least by this factor.
MIN_COLOUR_RATIO = 1.5


def workspace_figure(found: WorkspacePrediction) -> Figure:
    """Figure of the 95 % radius in a section of the workspace, and over the distance from calibrated poses."""
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
