"""The figure of `shared_poses`: NEES of both covariances and accuracy against the number of poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

from studies.common.study import Tables
from studies.shared_poses.findings import AWARE, INDEPENDENT, NAMES, numbers_of_poses
from uq_handeye.core.presentation.colours import BLUE, GREEN, INK, ORANGE, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain

STYLES: dict[str, tuple[str, str, Any]] = {
    "disjoint": (GREEN, "^", ":"),
    "consecutive": (BLUE, "s", "--"),
    "all": (ORANGE, "o", "-"),
    "poses": (INK, "D", "-."),
}


def figures(tables: Tables) -> dict[str, Figure]:
    """Columns: what carries noise. Rows: NEES of independent pairs, pose-aware NEES, accuracy."""
    sampled = tables["sampled"]
    figure = canvas(6.6)
    noises = list(sampled["noise"].unique())
    grid: Any = figure.subplots(3, len(noises), sharex=True, sharey="row")
    for column, noise in enumerate(noises):
        some = sampled[sampled["noise"] == noise]
        top, middle, bottom = grid[:, column]
        for axis in (top, middle, bottom):
            plain(axis)
            axis.set_xscale("log")
            axis.set_xticks(numbers_of_poses(sampled), list(map(str, numbers_of_poses(sampled))))
            axis.xaxis.set_minor_locator(NullLocator())
        top.set_title(f"noise on {noise if noise == 'both' else f'{noise} poses'}", fontsize=TEXT)
        low, high = some.iloc[0][["NEES from", "NEES to"]]
        for axis in (top, middle):
            axis.axhspan(low, high, color="0.8", zorder=1, linewidth=0)
            axis.axhline(6, color=QUIET, linewidth=0.7, zorder=2)
        for way, (colour, marker, line) in STYLES.items():
            of = some[some["data"] == way]
            style = {"color": colour, "marker": marker, "linestyle": line, "markersize": 4, "linewidth": 1.2}
            if way != "poses":
                top.plot(of["poses"], of[INDEPENDENT], **style)
            middle.plot(of["poses"], of[AWARE], **{**style, "linestyle": ""})
            bottom.plot(of["poses"], of["sd over bound: mean"], **style)
            bottom.fill_between(
                of["poses"],
                of["sd over bound: least"],
                of["sd over bound: largest"],
                color=colour,
                alpha=0.12,
                linewidth=0,
            )
        top.set_yscale("log")
        top.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        top.yaxis.set_minor_formatter(NullFormatter())
        bottom.set_xlabel("poses n", fontsize=TEXT)
    _labels(grid[:, 0])
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle=line, markersize=4, label=NAMES[way].replace("`", ""))
        for way, (colour, marker, line) in STYLES.items()
    ]
    handles.append(Line2D([], [], color="0.8", linewidth=5, label="where a true NEES lies (99.9 %)"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=SMALL, handlelength=2.6)
    return {"shared_poses": finished(figure)}


def _labels(axes: Sequence[Axes]) -> None:
    words = ("NEES, pairs taken\nas independent", "NEES, pose-aware", "sd over bound")
    for axis, label in zip(axes, words, strict=True):
        axis.set_ylabel(label, fontsize=TEXT)
