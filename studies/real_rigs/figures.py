"""The figure of `real_rigs`: d^2 of the truth by what is wrong, as of independent poses and by default."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from studies.common.study import Tables
from uq_handeye.core.presentation.colours import BLUE, GRID, ORANGE, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain

STYLES = {"alone": (ORANGE, "o", "independent, nothing shared"), "default": (BLUE, "D", "by default")}


def figures(tables: Tables) -> dict[str, Figure]:
    """A row for each error and number of poses; both setups on it."""
    table = tables["poses"]
    rows = list(dict.fromkeys(zip(table["error"], table["poses"], strict=True)))
    figure = canvas(0.26 * len(rows) + 1.1)
    axis = figure.subplots()
    plain(axis)
    axis.axvline(6, color=QUIET, linewidth=0.8, zorder=1)
    for k, (error, n) in enumerate(rows):
        lines = table[(table["error"] == error) & (table["poses"] == n)]
        axis.axhline(k, color=GRID, linewidth=0.5, zorder=0)
        for way, (colour, marker, _) in STYLES.items():
            d2 = lines[f"mean d2, {way}"]
            axis.plot(d2, [k] * len(d2), marker, color=colour, markersize=5, linestyle="", zorder=3)
    axis.set_xscale("log")
    ticks = [3, 6, 10, 30, 100, 300, 1000]
    shown = [tick for tick in ticks if tick < 1.3 * table["mean d2, alone"].max()]
    axis.set_xticks(shown, [f"{tick:g}" for tick in shown])
    axis.minorticks_off()
    axis.set_yticks(range(len(rows)), [f"{error}, {n:,}" for error, n in rows], fontsize=SMALL)
    axis.set_ylabel("error beside the noise, number of poses", fontsize=TEXT)
    axis.set_ylim(len(rows) - 0.4, -0.6)
    axis.set_xlabel("mean d² of the true X (6 is right)", fontsize=TEXT)
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle="", markersize=5, label=label)
        for colour, marker, label in STYLES.values()
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=2, frameon=False, fontsize=SMALL)
    return {"real_rigs": finished(figure)}
