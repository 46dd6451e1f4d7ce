"""The figures of `figure_5`: ellipses in the planes of Fig. 5, in all 15 planes, and the other geometries."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from scipy.stats import chi2

from studies.common.study import Tables
from studies.figure_5.findings import by_row
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.core.presentation.colours import BLUE, GREEN, INK, ORANGE, PURPLE, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain

RADIUS = float(np.sqrt(chi2.ppf(0.95, 2)))
SYMBOLS = {f"{name}_{axis}": rf"$\{name}_{axis}$" for name in ("theta", "tau") for axis in "xyz"}


class Curve(NamedTuple):
    """Style of the ellipse of a row; broad and pale below what must lie on it."""

    label: str
    colour: str
    line: Any
    width: float
    order: int


CURVES = {
    "4dpa-sampled": Curve("4DPA, sampled", "#A8D4F0", "-", 4.0, 3),
    "4dpa-pairs": Curve("4DPA, sum over pairs", "black", "-", 1.0, 6),
    "nguyen-sampled": Curve("Nguyen and Pham, sampled", "#A6DCC8", "-", 4.0, 4),
    "nguyen-own": Curve("Nguyen and Pham, own", "#00694C", (0, (4, 1.5)), 1.2, 7),
    "bound": Curve("bound", ORANGE, "-", 2.0, 5),
    "efficient-own": Curve("efficient, own", "#5A1E00", (0, (1, 1.2)), 1.2, 8),
    "4dpa-mean": Curve("(45), F a mean too", PURPLE, (0, (5, 1.2, 1, 1.2)), 1.1, 9),
    "4dpa-literal": Curve("(45) as printed", "#C7006E", "-", 1.5, 10),
}

CLOUDS = {"4dpa": ("4DPA, trials", "#6C9DC4"), "nguyen": ("Nguyen and Pham, trials", "#2F8F70")}


def figures(tables: Tables) -> dict[str, Figure]:
    return {
        "figure_5": planes(tables, 2, 5.4, 400),
        "all_planes": planes(tables, 5, 12.2, 150),
        "geometries": geometries(tables["deviations"]),
    }


def planes(tables: Tables, rows: int, height: float, points: int) -> Figure:
    """The first planes of the table, three in a row, each with ellipses of 95 % and so many trials of each method."""
    projections, samples = tables["projections"], tables["samples"].groupby("method").head(points)
    figure = canvas(height)
    grid: Any = figure.subplots(rows, 3)
    order = list(dict.fromkeys(zip(projections["x"], projections["y"], strict=True)))
    reach = _reach(projections)
    for axis, (x, y) in zip(grid.flat, order, strict=False):
        some = projections[(projections["x"] == x) & (projections["y"] == y)]
        _panel(axis, some, samples)
        units = some.iloc[0]
        axis.set_xlabel(f"{SYMBOLS[x]} ({units['x unit']})", fontsize=TEXT, labelpad=1)
        axis.set_ylabel(f"{SYMBOLS[y]} ({units['y unit']})", fontsize=TEXT, labelpad=1)
        axis.set_xlim(-reach[x[:3]], reach[x[:3]])
        axis.set_ylim(-reach[y[:3]], reach[y[:3]])
        axis.set_box_aspect(1)
        for line in (axis.xaxis, axis.yaxis):
            line.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10], symmetric=True))
    _legend(figure)
    return finished(figure)


def _reach(projections: pd.DataFrame) -> dict[str, float]:
    """Half the range of rotations and of translations, by the first letters of the axis."""
    drawn = projections[projections["row"].isin(CURVES)]
    return {
        name: 1.12 * RADIUS * float(np.sqrt(drawn[drawn["x"].str.startswith(name)]["variance x"].max()))
        for name in ("the", "tau")
    }


def _panel(axis: Axes, some: pd.DataFrame, samples: pd.DataFrame) -> None:
    plain(axis)
    names = [f"{some.iloc[0][side]} ({some.iloc[0][f'{side} unit']})" for side in "xy"]
    for method, (_, colour) in CLOUDS.items():
        x, y = samples[samples["method"] == method][names].to_numpy().T
        axis.plot(x, y, ".", color=colour, markersize=1.9, markeredgewidth=0, zorder=1)
    lines = by_row(some)
    for key, curve in CURVES.items():
        line = lines[key]
        x, y = ellipse(line["variance x"], line["covariance"], line["variance y"])
        axis.plot(x, y, color=curve.colour, linestyle=curve.line, linewidth=curve.width, zorder=curve.order)


def ellipse(xx: float, xy: float, yy: float) -> Array:
    """Points (2, 181) of the ellipse that holds 95 % of a Gaussian with this covariance, which may be singular."""
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    angle = np.linspace(0, 2 * np.pi, 181)
    return np.asarray(RADIUS * (vectors * np.sqrt(np.maximum(values, 0.0))) @ np.stack([np.cos(angle), np.sin(angle)]))


def _legend(figure: Figure) -> None:
    """Draw the legend in three columns: 4DPA, Nguyen and Pham, and what lies within."""
    lines = {
        key: Line2D([], [], color=curve.colour, linestyle=curve.line, linewidth=curve.width, label=curve.label)
        for key, curve in CURVES.items()
    }
    literal = CURVES["4dpa-literal"]  # smaller than its line is wide
    lines["4dpa-literal"] = Line2D([], [], color=literal.colour, marker="o", linestyle="", markersize=3)
    lines["4dpa-literal"].set_label(literal.label)
    for method, (label, colour) in CLOUDS.items():
        lines[method] = Line2D([], [], marker=".", linestyle="", color=colour, markersize=4, label=label)
    order = ("4dpa", "4dpa-sampled", "4dpa-pairs", "4dpa-mean", "nguyen", "nguyen-sampled", "nguyen-own")
    figure.legend(
        handles=[lines[key] for key in (*order, "4dpa-literal", "bound", "efficient-own")],
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=SMALL,
        handlelength=2.6,
    )


def geometries(deviations: pd.DataFrame) -> Figure:
    """Per geometry, the range over the six axes of standard deviations over those of Nguyen and Pham."""
    figure = canvas(3.0)
    axis = figure.subplots()
    plain(axis)
    table = deviations.pivot(index=["geometry", "axis"], columns="row", values="sd")
    kinds = deviations.groupby("geometry")["kind"].first()
    shown = (
        ("4dpa-pairs", "4DPA, sum over pairs", BLUE, "o"),
        ("4dpa-mean", "(45), F a mean too", PURPLE, "D"),
        ("4dpa-literal", "(45) as printed", "#C7006E", "v"),
        ("efficient-own", "efficient, own", INK, "s"),
    )
    for k, (key, label, colour, marker) in enumerate(shown):
        ratios = (table[key] / table["nguyen-own"]).unstack("axis")
        at = np.arange(len(ratios)) + 0.16 * (k - 1.5)
        axis.vlines(at, ratios.min(axis=1), ratios.max(axis=1), color=colour, linewidth=1.4, zorder=3)
        middle = np.exp(np.log(ratios).mean(axis=1))
        axis.plot(at, middle, marker, color=colour, markersize=4, zorder=4, label=label)
    axis.axhline(1, color=GREEN, linewidth=1.2, linestyle="--", zorder=2, label="Nguyen and Pham, own")
    axis.set_yscale("log")
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_xticks(range(len(kinds)), list(map(str, range(len(kinds)))), fontsize=SMALL)
    for boundary in np.flatnonzero(kinds.to_numpy()[1:] != kinds.to_numpy()[:-1]):
        axis.axvline(boundary + 0.5, color=QUIET, linewidth=0.8)
    axis.set_xlim(-0.6, len(kinds) - 0.4)
    axis.set_xlabel(
        "geometry (0: that of the ellipses; left of the line random motions, right of it a camera and a board)",
        fontsize=SMALL,
    )
    axis.set_ylabel("sd over Nguyen and Pham's", fontsize=TEXT)
    figure.legend(loc="outside upper center", ncols=5, frameon=False, fontsize=SMALL, handlelength=1.4, columnspacing=1)
    return finished(figure)
