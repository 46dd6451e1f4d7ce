"""The figure of `table_1`: accuracy against time, and how sure of itself each method rightly is."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from studies.common.study import Tables
from studies.common.styles import style
from studies.table_1.findings import ACCURACY, SPEED, summary
from uq_handeye.core.presentation.colours import GRID, INK, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain


def figures(tables: Tables) -> dict[str, Figure]:
    return {"table_1": _figure(summary(tables), tables["accuracy"])}


def _figure(table: pd.DataFrame, accuracy: pd.DataFrame) -> Figure:
    figure = canvas(5.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    looks = {str(name): style(str(name)) | {"linestyle": "none", "markersize": 6.5} for name in table.index}
    for name in table.index[table["cases"] < table["cases"].max()]:
        looks[str(name)]["markerfacecolor"] = "white"
    for name, row in table.iterrows():
        ends = [row["least"], row["largest"]]
        left.plot([row["one_over_fastest"]] * 2, ends, color=looks[str(name)]["color"], linewidth=0.7, alpha=0.6)
        left.plot(row["one_over_fastest"], row["ratio"], **looks[str(name)])
    left.set_xscale("log")
    left.set_yscale("log")
    plain(left)
    left.set_xlim(0.85, max(table["one_over_fastest"].max() * 1.5, 110.0))
    left.set_ylim(0.93, max(table["largest"].max() * 1.08, 2.3))
    for _, limit in SPEED[:-1]:
        left.axvline(limit, color=QUIET, linewidth=0.8, linestyle="--", zorder=0)
    for _, limit in ACCURACY[:-1]:
        left.axhline(limit, color=QUIET, linewidth=0.8, linestyle="--", zorder=0)
    ticks = [1, 1.25, 1.5, 2, 2.5]
    left.set_yticks(ticks, [f"{x:g}" for x in ticks])
    left.set_yticks([], minor=True)
    left.set_xticks([1, 2, 5, 15, 50], ["1", "2", "5", "15", "50"])
    left.set_xticks([], minor=True)
    for (name, _), at in zip(SPEED, (2.0, 8.5, 27.0, 75.0), strict=True):
        left.text(at, 1.01, name, transform=left.get_xaxis_transform(), ha="center", fontsize=SMALL, color=QUIET)
    for (name, _), at in zip(ACCURACY, (1.12, 1.6, 2.15), strict=True):
        left.text(
            1.01, at, name, transform=left.get_yaxis_transform(), va="center", rotation=90, fontsize=SMALL, color=QUIET
        )
    left.set_xlabel("time of one problem / fastest", fontsize=TEXT)
    left.set_ylabel("predicted deviation / Cramer-Rao bound", fontsize=TEXT)

    names = list(table.index)[::-1]
    shades = dict(zip(accuracy["case"].unique(), ("o", "s", "^", "D", "X"), strict=False))
    for height, name in enumerate(names):
        cells = accuracy[accuracy["method"] == name]
        offsets = np.linspace(0.3, -0.3, len(cells)) if len(cells) > 1 else [0.0]
        for offset, (_, row) in zip(offsets, cells.iterrows(), strict=True):
            low, high = row["nees_low"], row["nees_high"]
            right.plot([low, high], [height + offset] * 2, color="0.78", linewidth=1.6, solid_capstyle="butt", zorder=1)
            right.plot(row["nees"], height + offset, marker=shades[row["case"]], color=INK, markersize=2.8, zorder=2)
    right.axvline(6.0, color=QUIET, linewidth=0.8, zorder=0)
    right.set_yticks(range(len(names)), names)
    right.set_ylim(-0.7, len(names) - 0.3)
    right.set_xlabel("mean NEES (6 is true), 99.9 % interval in grey", fontsize=TEXT)
    plain(right)
    right.grid(axis="y", visible=False)
    for height in range(1, len(names)):
        right.axhline(height - 0.5, color=GRID, linewidth=0.5, zorder=0)
    methods = [Line2D([], [], **(look | {"markersize": 5}), label=name) for name, look in looks.items()]
    marks = [
        Line2D([], [], linestyle="none", marker=mark, color=INK, markersize=3.5, label=case)
        for case, mark in shades.items()
    ]
    figure.legend(handles=methods, loc="outside lower center", ncols=7, fontsize=SMALL, frameon=False)
    right.legend(handles=marks, loc="lower center", bbox_to_anchor=(0.42, 1.0), ncols=2, fontsize=SMALL, frameon=False)
    return finished(figure)
