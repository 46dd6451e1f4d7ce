"""Figures of `studies.tables_2_3`, from its tables only."""

from __future__ import annotations

from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter, NullLocator, ScalarFormatter

from studies.common.paper_tables import PAPER
from studies.common.study import Tables
from studies.common.styles import style
from studies.tables_2_3.findings import BOUND, OTHERS, PAPER_SCALE, TRUTH, of
from uq_handeye.core.presentation.colours import INK, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain


def figures(tables: Tables) -> dict[str, Figure]:
    return {"accuracy": _accuracy_figure(tables["accuracy"], tables["paper"]), "time": _time_figure(tables["times"])}


SHOWN = ("tsai", "park", "daniilidis", "andreff", "zhang", "4dpa", "gwak", "nguyen", "efficient")


def _band(accuracy: pd.DataFrame, sequence: str, method: str, column: str) -> tuple[pd.Series, pd.Series]:
    """90 % of the draws of (62); two standard errors of an RMS error."""
    rows = accuracy[(accuracy["sequence"] == sequence) & (accuracy["method"] == method)]
    if column == "error62":
        return rows["error62_low"], rows["error62_high"]
    what, _, unit = column.partition("_")
    error = rows[f"{what}_se_{unit}"]
    return rows[column] - 2 * error, rows[column] + 2 * error


def _ticks(axis: Axes, N: Any) -> None:
    axis.set_xscale("log")
    axis.set_xticks([n for n in N if n not in (253, 470)])
    axis.xaxis.set_major_formatter(ScalarFormatter())
    axis.xaxis.set_minor_locator(NullLocator())
    axis.xaxis.set_minor_formatter(NullFormatter())


def _accuracy_figure(accuracy: pd.DataFrame, paper: pd.DataFrame) -> Figure:
    figure = canvas(6.4)
    axes = figure.subplots(3, 3, sharex=True, sharey="row")
    panels = (
        ("error62", "error (62)"),
        ("rotation_mrad", "rotation of X, mrad"),
        ("translation_mm", "translation of X, mm"),
    )
    titles = {"longer": "recording goes on", "denser": "same recording, denser", "late": "denser, robot late"}
    handles: dict[str, Line2D] = {}
    for column, (sequence, title) in enumerate(titles.items()):
        for row, (name, label) in enumerate(panels):
            axis = axes[row, column]
            values = of(accuracy, name, sequence=sequence)
            for method in SHOWN:
                if method in values and values[method].notna().any():
                    handles[method] = axis.plot(values.index, values[method], **style(method), label=method)[0]
                    low, high = _band(accuracy, sequence, method, name)
                    axis.fill_between(values.index, low, high, color=style(method)["color"], alpha=0.2, linewidth=0)
            extra = {TRUTH: {"color": QUIET, "linestyle": "-", "linewidth": 3.2, "zorder": 0}} if row == 0 else {}
            if row > 0 and BOUND in values:
                extra = {BOUND: {"color": QUIET, "linestyle": (0, (5, 1)), "linewidth": 2.2, "zorder": 0}}
            for method, look in extra.items():
                handles[method] = axis.plot(values.index, values[method], **look, label=method)[0]
            if row == 0 and sequence == "late":
                printed = of(paper, "error62")["4dpa"]
                look = {"color": INK, "linestyle": "none", "marker": "x", "markersize": 5}
                handles["4dpa, printed"] = axis.plot(printed.index, printed, **look, label="4dpa, printed")[0]
            axis.set_yscale("log")
            plain(axis)
            _ticks(axis, values.index)
            if row == 0:
                axis.set_title(title, fontsize=TEXT)
            if row == 2:
                axis.set_xlabel("number of motions N", fontsize=TEXT)
            if column == 0:
                axis.set_ylabel(label, fontsize=TEXT)
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=6, fontsize=SMALL, frameon=False
    )
    return finished(figure)


def _time_figure(times: pd.DataFrame) -> Figure:
    figure = canvas(3.4)
    axis = figure.subplots()
    values = of(times, "over_4dpa")
    for method in (*PAPER, *OTHERS):
        axis.plot(values.index, values[method], **style(method), label=method)
    look = {"color": style("4dpa")["color"], "linestyle": ":", "linewidth": 1.6}
    axis.plot(values.index, values[PAPER_SCALE], **look, label=PAPER_SCALE)
    axis.set_yscale("log")
    plain(axis)
    _ticks(axis, values.index)
    axis.set_xlabel("number of motions N", fontsize=TEXT)
    axis.set_ylabel("time / time of 4DPA", fontsize=TEXT)
    figure.legend(loc="outside right center", fontsize=SMALL, frameon=False)
    return finished(figure)
