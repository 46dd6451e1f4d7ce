"""Figure of the residuals of points, across the line of sight and along it.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.limits import MAX_DRAWN_POINTS
from ...core.presentation.colours import BLUE, GRID, INK, ORANGE
from ...core.presentation.figure_parts import SMALL, TEXT, NamedFigure, canvas, finished, plain
from ...core.presentation.numbers import fixed
from .posed import Posed


def residual_figure(found: Posed) -> NamedFigure:
    """Residuals across the line of sight (left), and both over the distance (right), with the noise as lines."""
    across, along, far = found.split_residuals
    shown = np.flatnonzero(np.isfinite(along))
    if len(shown) > MAX_DRAWN_POINTS:
        shown = shown[np.linspace(0, len(shown) - 1, MAX_DRAWN_POINTS).astype(int)]
    used, far = found.used[shown], far[shown]
    sd = 1e3 * found.sd
    figure = canvas(3.1)
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.35])
    r = 1e3 * across[shown]
    size = _reach(r, used, sd[0])
    _dots(left, np.clip(r[:, 0], -size, size), np.clip(r[:, 1], -size, size), used)
    turn = np.linspace(0, 2 * np.pi, 181)
    for k, style in ((1, "-"), (3, "--")):
        left.plot(k * sd[0] * np.cos(turn), k * sd[0] * np.sin(turn), style, color=INK, linewidth=0.9)
    left.set(xlim=(-size, size), ylim=(-size, size), aspect="equal")
    r = 1e3 * along[shown]
    size = _reach(r, used, sd[1])
    _dots(right, far, np.clip(r, -size, size), used)
    for k, style in ((1, "-"), (3, "--")):
        for sign, label in ((-1, None), (1, f"{k} sigma")):
            right.axhline(sign * k * sd[1], linestyle=style, color=INK, linewidth=0.9, label=label)
    right.axhline(0, color=GRID, linewidth=0.8, zorder=0)
    right.set_ylim(-size, size)
    right.legend(fontsize=SMALL, frameon=False, loc="upper left", ncols=4, handlelength=1.6)
    for axis, x, y in (
        (left, "lateral, to the right (mm)", "lateral, down (mm)"),
        (right, "distance (m)", "axial, away from the camera (mm)"),
    ):
        axis.set_xlabel(x, fontsize=TEXT)
        axis.set_ylabel(y, fontsize=TEXT)
        plain(axis)
    words = (
        f"Residuals of {int(found.used.sum()):,} points across the line of sight (standard deviation "
        f"{fixed(sd[0], 2)} mm per axis) and along it ({fixed(sd[1], 2)} mm); {len(found.outliers)} left out."
    )
    finished(figure)
    return figure.named("residuals", "Residuals of the points", words)


def _reach(r: Array, used: NDArray[np.bool_], sd: float) -> float:
    """Half length of the axes of residuals (mm): nearly all of those used, and three standard deviations."""
    most = float(np.quantile(np.abs(r[used]), 0.999, method="higher")) if used.any() else 1.0
    return 1.25 * max(most, 3.0 * sd)


def _dots(axis: Axes, x: Array, y: Array, used: NDArray[np.bool_]) -> None:
    axis.plot(x[used], y[used], ".", color=BLUE, markersize=3, alpha=0.7, markeredgewidth=0, label="points")
    if (~used).any():
        axis.plot(x[~used], y[~used], "x", color=ORANGE, markersize=5, label="left out", clip_on=False)
