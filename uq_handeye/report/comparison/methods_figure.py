"""The methods side by side as a figure for a page: their differences from one X, with bars of 1 and 2 sigma.

A lighter `comparison.figure`: one row per method, one panel for each of the six components, no ellipses. This module
imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.presentation.figure_parts import BLUE, INK, ORANGE, SMALL, TEXT, Picture, canvas, finished, plain
from .result import Comparison
from .row import Row

_UNITS = (180 / np.pi, 1e3)
_NAMES = ("rotation", "translation")
# Differences beyond so many typical ones are marked at the rim.
_FAR = 4.0


def methods_picture(comparison: Comparison) -> Picture | None:
    """Differences of all methods from the reference; None where no other method has any."""
    base = comparison.base
    others = [row for row in comparison.rows if row is not base]
    if base is None or not any(row.xi is not None and row.failure is None for row in others):
        return None
    alt = f"Differences of {len(others)} methods from {base.method} in the six components of X, with 1 and 2 sigma."
    caption = (
        f"Differences from {base.method}, one row per method; thick and thin bars are 1 and 2 standard deviations "
        "of the method itself, the grey band is 1 standard deviation of the reference. Orange diamonds: the method "
        "differs from it beyond its own 95 % ellipsoid. Triangles at the rim: farther away, with the value. Bars "
        "that do not reach zero in several panels deserve a look."
    )
    return Picture(methods_figure([base, *others]), alt, caption)


def methods_figure(rows: Sequence[Row]) -> Figure:
    """Draw rows whose differences are from the first of them; those without a result are left out."""
    shown = [row for row in rows if row.xi is not None and row.failure is None]
    figure = canvas(0.9 + 2 * (0.17 * len(shown) + 0.55))
    grid: Any = figure.subplots(2, 3, sharey=True)
    for k, axis in enumerate(grid.ravel()):
        _panel(axis, k, shown)
    names = [f"{row.method}, differs" if row.agrees is False else row.method for row in shown]
    for line in grid:
        line[0].set_yticks(range(len(shown)), labels=names, fontsize=SMALL)
        line[0].get_yticklabels()[0].set_fontweight("bold")
    return finished(figure)


def _panel(axis: Axes, k: int, rows: Sequence[Row]) -> None:
    unit = _UNITS[k // 3]
    group = slice(3 * (k // 3), 3 * (k // 3) + 3)
    plain(axis)
    axis.grid(axis="y", visible=False)
    axis.axvline(0, color="0.6", linewidth=0.8)
    reach = _reach(rows, group) * unit
    axis.set_xlim(-reach, reach)
    axis.set_ylim(len(rows) - 0.4, -0.6)
    if rows and rows[0].std is not None:
        sigma = float(rows[0].std[k]) * unit
        axis.axvspan(-sigma, sigma, color="0.92", zorder=0, linewidth=0)
    for y, row in enumerate(rows):
        assert row.xi is not None  # the caller left the others out
        value = _drawn(float(row.xi[k]) * unit, reach)
        colour = "black" if y == 0 else ORANGE if row.agrees is False else BLUE
        mark = "D" if row.agrees is False else "o"
        if abs(value) > reach:
            axis.plot(np.sign(value) * 0.97 * reach, y, marker=">" if value > 0 else "<", color=colour, markersize=5)
            axis.annotate(
                f"{value:+.2g}", (np.sign(value) * 0.9 * reach, y), ha="right" if value > 0 else "left", va="center",
                fontsize=SMALL, color=INK,
            )  # fmt: skip
            continue
        if row.std is not None:
            sigma = _drawn(float(row.std[k]) * unit, reach)
            for level, width in ((2, 0.9), (1, 2.4)):
                ends = np.clip([value - level * sigma, value + level * sigma], -reach, reach)
                axis.plot(ends, [y, y], color=colour, linewidth=width, solid_capstyle="butt")
        axis.plot(value, y, marker=mark, color=colour, markersize=4.5, markeredgecolor="white", markeredgewidth=0.5)
    axis.xaxis.set_major_locator(MaxNLocator(nbins=4, symmetric=True, steps=[1, 2, 5, 10]))
    axis.set_xlabel(f"{_NAMES[k // 3]} {'xyz'[k % 3]} ({('deg', 'mm')[k // 3]})", fontsize=TEXT)


def _reach(rows: Sequence[Row], group: slice) -> float:
    """Half the range: most methods with two standard deviations, in the unit of the row."""
    extents = []
    for row in rows:
        assert row.xi is not None
        spread = 0.0 if row.std is None else 2 * float(row.std[group].max())
        extents.append(float(np.abs(row.xi[group]).max()) + spread)
    typical = float(np.median(extents)) if extents else 0.0
    inside = [extent for extent in extents if extent <= _FAR * typical]
    return float(f"{1.08 * max([*inside, 1e-9]):.3g}")


def _drawn(value: float, reach: float) -> float:
    """A value as fine as it can be seen: the last digits of an iteration may differ from run to run."""
    return round(value / reach, 4) * reach
