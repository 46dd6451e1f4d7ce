"""Figure of the residuals of points, across the line of sight and along it.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ...core.files.atomic import write_files
from ...core.files.open import StrPath, as_path
from ...core.formatting.numbers import fixed
from ...core.geometry.se3 import Array
from ...core.presentation.figure_parts import (
    BLUE,
    GRID,
    INK,
    ORANGE,
    SMALL,
    TEXT,
    NamedFigure,
    canvas,
    finished,
    plain,
    render,
)
from ...errors import InputError
from .posed import Posed

MOST_DRAWN = 5000


def residual_figure(found: Posed) -> Figure:
    """Residuals across the line of sight (left), and both over the distance (right), with the noise as lines."""
    across, along, far = found.split_residuals
    shown = np.flatnonzero(np.isfinite(along))
    if len(shown) > MOST_DRAWN:
        shown = shown[np.linspace(0, len(shown) - 1, MOST_DRAWN).astype(int)]
    used = found.used[shown]
    figure = canvas(3.1)
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.35])
    _across(left, found, 1e3 * across[shown], used)
    _over_distance(right, found, 1e3 * along[shown], far[shown], used)
    figure = finished(figure)
    if isinstance(figure, NamedFigure):
        figure.named("residuals", "Residuals of the points", residual_words(found))
    return figure


def residual_words(found: Posed) -> str:
    """Describe the figure for those who do not see it."""
    out = len(found.outliers)
    return (
        f"Residuals of {int(found.used.sum()):,} points across the line of sight (standard deviation "
        f"{fixed(1e3 * found.sd[0], 2)} mm per axis) and along it ({fixed(1e3 * found.sd[1], 2)} mm); {out} left out."
    )


def _across(axis: Axes, found: Posed, r: Array, used: NDArray[np.bool_]) -> None:
    size = float(np.quantile(np.abs(r[used]), 0.999, method="higher")) if used.any() else 1.0
    size = 1.25 * max(size, 3e3 * float(found.sd[0]))
    _dots(axis, np.clip(r[:, 0], -size, size), np.clip(r[:, 1], -size, size), used)
    turn = np.linspace(0, 2 * np.pi, 181)
    if not found.model.growing:
        for k, style in ((1, "-"), (3, "--")):
            radius = 1e3 * found.sd[0] * k
            axis.plot(radius * np.cos(turn), radius * np.sin(turn), style, color=INK, linewidth=0.9)
    axis.set(xlim=(-size, size), ylim=(-size, size), aspect="equal")
    axis.set_xlabel("lateral, to the right (mm)", fontsize=TEXT)
    axis.set_ylabel("lateral, down (mm)", fontsize=TEXT)
    plain(axis)


def _over_distance(axis: Axes, found: Posed, r: Array, far: Array, used: NDArray[np.bool_]) -> None:
    size = float(np.quantile(np.abs(r[used]), 0.999, method="higher")) if used.any() else 1.0
    size = 1.25 * max(size, 3e3 * float(found.sd[1]))
    _dots(axis, far, np.clip(r, -size, size), used)
    at = np.linspace(far.min(), far.max(), 50)
    growth = found.model.growth(np.column_stack([0 * at, 0 * at, at]))[:, 1] ** 0.5
    for k, style in ((1, "-"), (3, "--")):
        for sign in (-1, 1):
            label = f"{k} sigma" if sign > 0 else None
            axis.plot(at, sign * k * 1e3 * found.sd[1] * growth, style, color=INK, linewidth=0.9, label=label)
    axis.axhline(0, color=GRID, linewidth=0.8, zorder=0)
    axis.set_ylim(-size, size)
    axis.set_xlabel("distance (m)", fontsize=TEXT)
    axis.set_ylabel("axial, away from the camera (mm)", fontsize=TEXT)
    axis.legend(fontsize=SMALL, frameon=False, loc="upper left", ncols=4, handlelength=1.6)
    plain(axis)


def _dots(axis: Axes, x: Array, y: Array, used: NDArray[np.bool_]) -> None:
    axis.plot(x[used], y[used], ".", color=BLUE, markersize=3, alpha=0.7, markeredgewidth=0, label="points")
    if (~used).any():
        axis.plot(x[~used], y[~used], "x", color=ORANGE, markersize=5, label="left out", clip_on=False)


def save_figure(found: Posed, path: StrPath) -> Path:
    """Write the figure as ``.png`` or ``.svg``, whole or not at all; raises `InputError` for another ending."""
    path = as_path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        raise InputError(f"Expected a figure ending in .png or .svg, got {path.name!r}.")
    write_files(path.parent, {path.name: render(residual_figure(found), kind)})
    return path
