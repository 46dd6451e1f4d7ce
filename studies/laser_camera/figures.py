"""The figures of `studies.laser_camera`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from scipy.stats import chi2

from studies.common.scores import true_means
from studies.common.study import Tables
from studies.laser_camera import rig as rig
from studies.laser_camera.estimates import AXES, DRIFT, EFFICIENT, PAPER, TOLD
from uq_handeye.core.presentation.colours import BLUE, INK, ORANGE, QUIET, SKY
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain

ENLARGED = 10.0


def trajectories(tables: Tables) -> Figure:
    figure = canvas(4.9)
    axes = figure.subplots(2, 3, height_ratios=(1.5, 1.0))
    paths, errors_at_end = tables["paths"], tables["trajectory"]
    for column, experiment in enumerate(rig.LOOPS):
        axis: Axes = axes[0, column]
        path = paths[(paths["experiment"] == experiment) & (paths["method"] == TOLD)]
        axis.plot(path["X (m)"], path["Y (m)"], color=INK, linewidth=2.6, alpha=0.35, label="true")
        axis.plot(
            path["X before (m)"], path["Y before (m)"], color=ORANGE, linestyle="--", linewidth=1.1, label="before"
        )
        axis.plot(path["X after (m)"], path["Y after (m)"], color=BLUE, linewidth=1.1, label="after")
        label = f"95 % ellipse, enlarged {ENLARGED:g} times"
        for row in path[path["time (s)"] % 10 == 0].to_dict("records"):
            look = {"color": SKY, "alpha": 0.5, "linewidth": 0, "label": label}
            axis.add_patch(ellipse(row, (row["X after (m)"], row["Y after (m)"]), ENLARGED, **look))
            label = "_"  # once in the legend
        axis.plot(0, 0, "+", color=INK, markersize=8)
        axis.set_aspect("equal", adjustable="datalim")
        axis.set_title(f"Experiment {experiment}", fontsize=TEXT)
        axis.set_xlabel("X (m)", fontsize=SMALL)
        plain(axis)
        bars(axes[1, column], errors_at_end[(errors_at_end["experiment"] == experiment)])
    axes[0, 0].set_ylabel("Y (m)", fontsize=SMALL)
    axes[1, 0].set_ylabel("error at the end (m)", fontsize=SMALL)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    more, others = axes[1, 0].get_legend_handles_labels()
    figure.legend(
        [*handles, *more], [*labels, *others], loc="outside lower center", ncols=3, fontsize=SMALL, frameon=False
    )
    return finished(figure)


def ellipse(row: Mapping[Any, Any], centre: tuple[float, float], enlarged: float, **look: Any) -> Ellipse:
    """The 95 % ellipse of X and Y of one place."""
    S = np.array([[row["var X (m^2)"], row["cov X Y (m^2)"]], [row["cov X Y (m^2)"], row["var Y (m^2)"]]])
    values, vectors = np.linalg.eigh(S)
    width, height = 2 * enlarged * np.sqrt(chi2.ppf(0.95, 2) * values)
    return Ellipse(centre, width, height, angle=float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))), **look)


def bars(axis: Axes, table: pd.DataFrame) -> None:
    """RMS errors by axis before and after, with the standard deviation predicted by `efficient`, told and not told."""
    case = table[table["noise"] == DRIFT]
    place = np.arange(3)
    after = case[case["method"] == PAPER]
    axis.bar(
        place - 0.2, after["before, RMS (m)"], 0.36, color=ORANGE, hatch="//", edgecolor="white", label="before, RMS"
    )
    axis.bar(place + 0.2, after["after, RMS (m)"], 0.36, color=BLUE, label="after (4DPA, d = 1e5), RMS")
    for method, marker, label in (
        (TOLD, "D", "sd predicted, told the drift"),
        (EFFICIENT, "v", "sd predicted, noise taken as white"),
    ):
        sd = case[case["method"] == method]["sd (m)"]
        axis.plot(place + 0.2, sd, marker, color="white", markeredgecolor=INK, markersize=5, label=label)
    axis.set_yscale("log")
    axis.set_xticks(place, AXES)
    axis.set_ylim(3e-3, 3.0)
    plain(axis)
    axis.grid(visible=False, axis="x")


_LOOKS = {
    ("4dpa, consecutive motions", "white, pairs independent"): (QUIET, "s", ":"),
    ("4dpa, consecutive motions", "white, shared poses"): (BLUE, "o", "-"),
    ("4dpa, all motions", "white, pairs independent"): (ORANGE, "X", ":"),
    ("4dpa, all motions", "white, shared poses"): (ORANGE, "^", "--"),
    ("efficient", "white, shared poses"): (INK, "D", "--"),
    ("efficient", "white and drift, shared poses"): (INK, "D", "-"),
}


def honesty(tables: Tables) -> Figure:
    figure = canvas(3.4)
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    table = tables["drift"]
    low, high = true_means(int(table["trials"].min()), 6)
    left.axhspan(low, high, color=SKY, alpha=0.5, label="99.9 % of true covariances")
    for (method, assumed), (colour, marker, line) in _LOOKS.items():
        part = table[(table["method"] == method) & (table["noise assumed"] == assumed)]
        left.plot(
            part["drift"],
            part["NEES"],
            color=colour,
            marker=marker,
            linestyle=line,
            markersize=4,
            linewidth=1.1,
            label=f"{method}: {assumed}",
        )
    left.set_yscale("log")
    left.set_xlabel("drift, multiples of 0.5 mrad and 2 mm in 1 s", fontsize=SMALL)
    left.set_ylabel("mean NEES of X (6 if true)", fontsize=SMALL)
    plain(left)
    points = tables["points"]
    points = points[points["experiment"] == 3]
    right.plot(
        1e3 * points["X (m)"], 1e3 * points["Y (m)"], ".", color=BLUE, markersize=4, label="repeats, experiment 3"
    )
    paths = tables["paths"]
    last = {row["method"]: row for row in paths[paths["experiment"] == 3].to_dict("records")}  # the last row of each
    for method, line, label in ((TOLD, "-", "95 %, told the drift"), (EFFICIENT, "--", "95 %, noise taken as white")):
        look = {"fill": False, "edgecolor": INK, "linestyle": line, "linewidth": 1.2, "label": label}
        right.add_patch(ellipse(last[method], (0.0, 0.0), 1e3, **look))
    right.set_aspect("equal", adjustable="datalim")
    right.set_xlabel("X error at the end (mm)", fontsize=SMALL)
    right.set_ylabel("Y error at the end (mm)", fontsize=SMALL)
    plain(right)
    handles, labels = left.get_legend_handles_labels()
    more, others = right.get_legend_handles_labels()
    figure.legend(
        [*handles, *more], [*labels, *others], loc="outside lower center", ncols=2, fontsize=SMALL, frameon=False
    )
    return finished(figure)
