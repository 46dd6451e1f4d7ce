"""Distance of each method from the Cramer-Rao bound, and the noise at which it breaks (Table II and section IV-A of
the paper).

The paper finds 4DPA almost always the most accurate, and "more efficient" than dual quaternions (Daniilidis) and
Kronecker products (Andreff). Here the standard deviation of every method of X is put beside the least possible one,
over the number of poses, the spread of their rotations, the ratio of rotation to translation noise, motions near 180
degrees, and motions that share their translation.

Poses: `uq.simulate`, 15 where their number is not varied, all pairs; camera 0.3 mrad and 0.3 mm per axis unless the
ratio is varied, robot a fifth. Motions: 60 independent ones with axes uniform on the sphere, angles of 0.4 to 2.6 rad,
1 mrad and 1 mm on A and on B; `li` and `shah` solve for poses and have no row there. One geometry per cell, seed 2019.

Each cell has the standard deviations that first order predicts, without drawing anything, and those of the errors about
the truth in up to 1,000 draws; where drawing would take too long, only the former (`heller`, a convex program per draw,
always; `zhao`, `nguyen` and `ml` at times; at 200 poses all that form the 19,900 pairs). Cells in which the two differ
are repeated at a tenth of the noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

import uq_handeye as uq
from studies.common.study import Study, Tables
from studies.common.styles import style
from studies.efficiency.findings import NEES, deviations_between, findings, first_order, means_between, rows_of
from studies.efficiency.rig import METHODS, SWEEPS, Setting, Size, Sweep, cell, motions
from uq_handeye.core.presentation.colours import GRID, INK, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar
from uq_handeye.core.threads import one_thread

FULL, QUICK = Size(budget=60_000, most=500_000), Size(budget=5_000, most=10_000, fewest=80, trials=200)
NEAR_SHARE, NEAR_DISTANCE = 0.8, 0.01  # of the motions whose weight is asked for; degrees from 180
TICKS = {  # of the figures, by the largest value that they show
    3.5: (1, 1.1, 1.2, 1.3, 1.5, 1.7, 2, 2.5, 3),
    7.0: (1, 1.2, 1.5, 2, 3, 4, 5),
    np.inf: (1, 1.5, 2, 3, 5, 10, 20, 50),
}
PART = 0.1  # of the noise, where first order fails


def measure(full: bool) -> dict[str, pd.DataFrame]:
    size = FULL if full else QUICK
    settings = [(sweep, value) for sweep in SWEEPS for value in (sweep.values if full else sweep.quick)]
    with one_thread(), progress_bar("efficiency", len(settings) * len(METHODS), "cells") as advance:
        cells = pd.DataFrame(_cells(settings, size, advance))
        odd = cells[(cells.trials > 0) & ~first_order(cells)]
        again = [
            {"sweep": row.sweep, "quantity": row.quantity, "value": row.value, "method": row.method}
            | cell(_sweep(row.sweep).setting(row.value), row.method, size, PART)
            for row in rows_of(odd)
        ]
        return {
            "cells": cells,
            "smaller": pd.DataFrame(again, columns=cells.columns),
            "half_turns": pd.DataFrame(_half_turns()),
        }


def _cells(settings: list[tuple[Sweep, float]], size: Size, advance: Any) -> Iterator[dict[str, Any]]:
    for sweep, value in settings:
        setting = sweep.setting(value)
        for method in METHODS:
            row = {"sweep": sweep.name, "quantity": sweep.label, "value": value, "method": method}
            yield row | cell(setting, method, size)
            advance(1)


def _sweep(name: str) -> Sweep:
    return next(sweep for sweep in SWEEPS if sweep.name == name)


def _half_turns() -> Iterator[dict[str, Any]]:
    """Standard deviations with motions of nearly 180 degrees, over those without them: 1 if they count nothing."""
    everything = motions(near=NEAR_SHARE, distance=NEAR_DISTANCE)
    assert isinstance(everything.truth, uq.Motions)
    rest = round((1 - NEAR_SHARE) * everything.truth.N)
    few = Setting(
        uq.Motions(everything.truth.A[:rest], everything.truth.B[:rest]), everything.X, None, everything.noise
    )
    for method in METHODS:
        if method in uq.ROBOT_WORLD_METHODS:
            continue
        row: dict[str, Any] = {"method": method, "motions": everything.truth.N, "near_180": everything.truth.N - rest}
        row["degrees"] = 180.0 - NEAR_DISTANCE
        try:
            with_them, without = (np.sqrt(np.diag(s.experiment(method).predicted())) for s in (everything, few))
        except uq.InputError as error:
            yield row | {"answer": type(error).__name__}
            continue
        ratio = with_them / without
        yield row | {"answer": "yes", "with_over_without_low": ratio.min(), "with_over_without_high": ratio.max()}


# ---------------------------------------------------------------------------------------------------- figures


def figures(tables: Tables) -> dict[str, Figure]:
    return {"bound": _of_the_bound(tables["cells"]), "first_order": _of_first_order(tables["cells"])}


def _of_the_bound(cells: pd.DataFrame) -> Figure:
    """One panel per swept quantity: lines predicted, markers drawn."""
    figure = canvas(8.6)
    axes = figure.subplots(3, 2)
    for axis, sweep in zip(axes.flat, SWEEPS, strict=True):
        some = cells[cells.sweep == sweep.name]
        for method, rows in some[some.answer == "yes"].groupby("method", sort=False):
            look = style(str(method))
            axis.plot(rows.value, rows.predicted_over_bound_high, **(look | {"marker": ""}))
            axis.plot(rows.value, rows.drawn_over_bound_high, **(look | {"linestyle": ""}), markerfacecolor="none")
        axis.axhline(1.0, color=QUIET, linewidth=0.8, zorder=0)
        axis.set_yscale("log")
        _log(axis, sweep, some.value.to_numpy())
        axis.set_xlabel(sweep.label, fontsize=TEXT)
        axis.set_title(f"{chr(97 + SWEEPS.index(sweep))}  {sweep.data}", fontsize=TEXT, loc="left", color=INK)
        plain(axis)
        low, high = axis.get_ylim()
        candidates = next(ticks for limit, ticks in TICKS.items() if high < limit)
        ticks = [y for y in candidates if low <= y <= high]
        axis.set_yticks(ticks, [f"{y:g}" for y in ticks])
        axis.yaxis.set_minor_locator(NullLocator())
    figure.supylabel("largest of six deviations / bound", fontsize=TEXT)
    handles = [
        axes.flat[0].plot([], [], **style(method), markerfacecolor="none", label=method)[0]
        for method in METHODS
        if method in set(cells.method)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize=SMALL, frameon=False, handlelength=3)
    return finished(figure)


def _log(axis: Axes, sweep: Sweep, values: Any) -> None:
    if sweep.name == "share":
        axis.set_xlim(-0.03, 1.0)
        return
    axis.set_xscale("log")
    if values.max() < 1000 and sweep.name != "ratio":
        shown = sorted(set(values))
        axis.set_xticks(shown, [f"{v:g}" for v in shown])
        axis.minorticks_off()
    else:
        axis.xaxis.set_major_formatter(lambda x, _: f"{x:g}")


def _of_first_order(cells: pd.DataFrame) -> Figure:
    """Standard deviations drawn over predicted, and the mean NEES, against the number of trials."""
    figure = canvas(3.0)
    left, right = figure.subplots(1, 2)
    drawn = cells[cells.trials > 0]
    spans = np.geomspace(drawn.trials.min() * 0.9, drawn.trials.max() * 1.1, 50)
    rng = np.random.default_rng(0)
    for method, rows in drawn.groupby("method", sort=False):
        look = style(str(method)) | {"linestyle": "", "markersize": 3, "markerfacecolor": "none"}
        at = rows.trials * rng.uniform(0.95, 1.05, len(rows))  # apart from each other
        left.plot(at, rows.drawn_over_predicted_low, **look)
        left.plot(at, rows.drawn_over_predicted_high, **look)
        right.plot(at, rows.nees, **look)
    for axis, (low, high) in zip(
        (left, right), (deviations_between(spans, len(drawn)), means_between(spans, len(drawn))), strict=True
    ):
        axis.fill_between(spans, low, high, color=GRID, zorder=0, linewidth=0)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("trials of a cell", fontsize=TEXT)
        plain(axis)
        values = (0.7, 0.8, 0.9, 1, 1.1, 1.2, 1.5, 2, 3, 4, 5, 6, 7, 8, 10, 15, 20)
        for line, candidates, (start, end) in (
            (axis.xaxis, (50, 100, 200, 500, 1000), axis.get_xlim()),
            (axis.yaxis, values, axis.get_ylim()),
        ):
            ticks = [x for x in candidates if start <= x <= end]
            line.set_ticks(ticks, [f"{x:g}" for x in ticks])
            line.set_minor_locator(NullLocator())
    left.set_ylabel("deviation, drawn / predicted", fontsize=TEXT)
    right.set_ylabel("mean NEES", fontsize=TEXT)
    right.axhline(NEES, color=QUIET, linewidth=0.8, zorder=0)
    left.axhline(1.0, color=QUIET, linewidth=0.8, zorder=0)
    return finished(figure)


STUDY = Study("efficiency", measure, findings, figures, packages=("cvxpy",))
