"""The uncertainty budget as a figure: which noise source makes which share of the variance of X.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ...core.geometry.se3 import Array
from ...core.presentation.figure_parts import BLUE, INK, ORANGE, SMALL, TEXT, canvas, finished, plain
from .analysis import KINDS

_STYLES = ((BLUE, ""), (ORANGE, "////"))  # rotation, translation


def budget_figure(shares: Mapping[str, Array]) -> Figure:
    """Two bars for each source, of ``shares`` (2,): of the variances of X's rotation and translation."""
    count = len(shares)
    figure = canvas(0.95 + 0.52 * count)
    axis = figure.subplots()
    plain(axis)
    axis.grid(axis="y", visible=False)
    values = 100 * np.stack(list(shares.values()))
    for k, (kind, (colour, hatch)) in enumerate(zip(KINDS, _STYLES, strict=True)):
        y = np.arange(count) + 0.2 * (2 * k - 1)
        axis.barh(y, values[:, k], 0.36, color=colour, hatch=hatch, edgecolor="white", label=f"of X's {kind}")
        for row, value in zip(y, values[:, k], strict=True):
            axis.annotate(
                f"{value:.1f} %", (max(value, 0.0), row), xytext=(3, 0), textcoords="offset points", va="center",
                fontsize=SMALL, color=INK,
            )  # fmt: skip
    axis.set_yticks(range(count), labels=list(shares), fontsize=TEXT)
    axis.set_ylim(count - 0.5, -0.5)
    axis.set_xlim(min(0.0, 1.1 * float(values.min())), 1.12 * max(float(values.max()), 1.0))
    axis.set_xlabel("share of the variance (%)", fontsize=TEXT)
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=SMALL)
    return finished(figure)
