"""The figure of `kinematics`: share of predictions inside and their RMS, with joints and without."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from studies.common.study import Tables
from studies.kinematics.findings import NAMES, WORDS
from uq_handeye.core.presentation.colours import BLUE, GREEN, GRID, ORANGE, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain

STYLES = {
    "declared": (GREEN, "s", "joints, scales declared"),
    "estimated": (BLUE, "o", "joints, scales estimated"),
    "no joints": (ORANGE, "^", "no joints"),
}
TICKS = (0.1, 0.3, 1, 3, 10, 30)
Points = dict[str, tuple[float, float]]  # way: share inside, RMS in mm


def rows_of(tables: Tables) -> Iterator[tuple[str, Points]]:
    """Label, and the points of each way."""
    key: Any
    for key, lines in tables["simulated"].groupby(["arm", "setup"], sort=False):
        yield f"{NAMES[key[0]].partition(',')[0]}, {key[1]}", points(lines, "far: inside", "far: mm")
    for key, lines in tables["population"].groupby(["poses", "where"], sort=False):
        yield f"population, {key[0]} {WORDS[key[1]]}", points(lines, "far: inside", "far: mm")
    if "real" in tables:
        for key, lines in tables["real"].groupby(["arm", "where", "poses"], sort=False):
            yield (
                f"{NAMES[key[0]].split()[-1]}, {key[2]} {WORDS[key[1]]}",
                points(lines, "held out: inside", "held out: mm"),
            )
    if "touches" in tables:
        for line in tables["touches"].to_dict("records"):
            label = f"{line['arm'].replace('_', ' ')}, {line['poses']}, {line['held out']}"
            yield label, {"estimated": (line["inside"], line["mm"]), "no joints": (float("nan"), line["nominal mm"])}


def points(lines: Any, inside: str, mm: str) -> Points:
    names = {"joints": "estimated"}
    return {
        names.get(line["way"], line["way"]): (line[inside], line[mm])
        for line in lines.to_dict("records")
        if names.get(line["way"], line["way"]) in STYLES
    }


def figures(tables: Tables) -> dict[str, Figure]:
    rows = list(rows_of(tables))
    figure = canvas(0.24 * len(rows) + 1.2)
    left, right = figure.subplots(1, 2, sharey=True)
    for axis in (left, right):
        plain(axis)
        for k in range(len(rows)):
            axis.axhline(k, color=GRID, linewidth=0.5, zorder=0)
    left.axvline(95, color=QUIET, linewidth=0.8, zorder=1)
    for k, (_, of) in enumerate(rows):
        for way, (inside, mm) in of.items():
            colour, marker, _ = STYLES[way]
            style = {"color": colour, "marker": marker, "markersize": 4.5, "linestyle": "", "zorder": 3}
            left.plot([100 * inside], [k], **style)
            right.plot([mm], [k], **style)
    left.set_xlim(-3, 103)
    left.set_xlabel("inside the 95 % ellipsoid (%)", fontsize=TEXT)
    right.set_xscale("log")
    most = max(mm for _, of in rows for _, mm in of.values())
    shown = [tick for tick in TICKS if tick < 2 * most]
    right.set_xticks(shown, [f"{tick:g}" for tick in shown])
    right.minorticks_off()
    right.set_xlabel("RMS of the prediction (mm)", fontsize=TEXT)
    left.set_yticks(range(len(rows)), [label for label, _ in rows], fontsize=SMALL)
    left.set_ylim(len(rows) - 0.4, -0.6)
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle="", markersize=4.5, label=label)
        for colour, marker, label in STYLES.values()
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False, fontsize=SMALL)
    return {"kinematics": finished(figure)}
