"""The errors of every usable rig in units of the accuracy stated."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from studies.common.study import Tables
from studies.headline.findings import BEYOND, usable, worst


def figures(tables: Tables) -> dict[str, Figure]:
    """The largest of the three ratios of each rig, a row for each kind."""
    rigs = usable(tables["rigs"])
    groups = list(rigs.groupby("kind", sort=False))
    figure = Figure(figsize=(7.2, 0.8 + 0.32 * len(groups)), layout="constrained")
    axes = figure.subplots()
    for row, (_, of) in enumerate(groups):
        ratio, lower = worst(of).to_numpy(), of["lower_limit"].to_numpy() == 1
        place = row + np.linspace(-0.25, 0.25, len(of))
        for marked, face, label in ((False, "C0", "accuracy"), (True, "none", "lower limit")):
            some = lower == marked
            axes.plot(
                ratio[some], place[some], "o", markersize=4, color="C0", markerfacecolor=face,
                label=label if row == 0 else None,
            )  # fmt: skip
    axes.axvline(BEYOND, color="0.4", linewidth=1)
    axes.set_xscale("log")
    ticks = (0.1, 0.3, 1, 3, 10, 30)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_yticks(range(len(groups)), [str(kind) for kind, _ in groups])
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.set_xlabel("largest error / accuracy stated; line: 3")
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    return {"ratios": figure}
