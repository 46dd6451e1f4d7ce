r"""The board as figures: a map of its height, and what the residuals say of each of its points.

Model: the height of a point is that over the plane nearest to all points, along z of the board, which points away from
the camera (`camera.measured_board`). Between the points it is drawn by a thin plate spline through them. The residuals
of all pictures put point j off by d_j (`camera.board_pattern`). The board is seen from the front: x to the right, y
down. This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from scipy.interpolate import RBFInterpolator
from scipy.spatial import Delaunay

from ...errors import InputError
from ...geometry.se3 import Array
from ...presentation.figure_parts import (
    INK,
    ON_MAP,
    ORANGE,
    QUIET,
    SMALL,
    TEXT,
    WIDTH,
    canvas,
    finished,
    plain,
    round_number,
)
from ...presentation.label_placement import MAP_HALO
from ..board_pattern import BoardPattern, flat_pattern
from ..calibrated import Calibrated
from .text import board_words

# Nodes of the map along the longer side, and nearest points that a node is drawn from.
NODES, NEAREST = 120, 60
# Share of the board beyond the outermost points that is drawn.
RIM = 0.06
# Height in inches of a board that stands upright.
TALLEST = 5.0
# Both signs, dark where far from 0; contours and labels say the same in grey.
COLOURS = "RdBu_r"
# Length of the arrows, of which _SHARE per cent are shorter, by the distance of two points.
LONGEST, _SHARE = 1.6, 95.0
# Boards of which height over width is less are drawn below each other.
BROAD = 0.8
# Diameter of a dot by the distance of two points.
DOT = 0.6


def height_figure(cam: Calibrated) -> Figure | None:
    """Map of the height with contours in mm; None where the shape of the board has no height."""
    board = cam.board
    height = 1e3 * board.heights
    if not np.ptp(height) > 0:
        return None
    at = _in_plane(cam)
    low, high = at.min(axis=0), at.max(axis=0)
    ratio = float((high - low)[1] / (high - low)[0])
    wide = min(WIDTH - 1.5, TALLEST / ratio)
    figure = canvas(1.0 + wide * ratio)
    side = 0.5 * max(WIDTH - 1.5 - wide, 0.0)
    axis = figure.add_subplot(figure.add_gridspec(1, 3, width_ratios=[side, wide, side])[1] if side > 0 else 111)
    step = float((high - low).max()) / NODES
    x, y = np.meshgrid(*(np.arange(a, b + 0.5 * step, step) for a, b in zip(low, high, strict=True)))
    nodes = np.stack([x, y], axis=-1).reshape(-1, 2)
    drawn = RBFInterpolator(at, height, neighbors=min(NEAREST, len(at)))(nodes)
    middle = at.mean(axis=0)
    drawn[Delaunay(middle + 1.001 * (at - middle)).find_simplex(nodes) < 0] = np.nan
    levels = MaxNLocator(nbins=11, steps=[1, 2, 2.5, 5, 10], symmetric=True).tick_values(
        -float(np.abs(height).max()), float(np.abs(height).max())
    )
    z = np.ma.masked_invalid(drawn.reshape(x.shape))
    filled = axis.contourf(x, y, z, levels=levels, cmap=COLOURS)
    lines = axis.contour(x, y, z, levels=levels, colors=ON_MAP, linewidths=0.6)
    axis.plot(*at.T, ".", color=ON_MAP, markersize=2.0, markeredgewidth=0)
    _board_axes(axis, cam)
    axis.grid(visible=False)
    bar = figure.colorbar(filled, cax=axis.inset_axes((1.02, 0.0, 0.028, 1.0)))
    bar.ax.tick_params(labelsize=SMALL, length=2.5, color=QUIET)
    bar.outline.set_visible(False)
    bar.set_label("height along z, away from the camera (mm)", fontsize=TEXT)
    named = []
    for j, name in ((int(np.argmin(height)), "lowest"), (int(np.argmax(height)), "highest")):
        axis.plot(*at[j], "+", color=ON_MAP, markersize=8, clip_on=False, zorder=6)
        left, above = at[j, 0] < middle[0], at[j, 1] < middle[1]
        named.append(axis.annotate(
            f"{name}: {height[j]:.2f}", at[j], xytext=(6 if left else -6, -8 if above else 8),
            textcoords="offset points", fontsize=SMALL, color=ON_MAP, path_effects=MAP_HALO, zorder=7, va="center",
            ha="left" if left else "right",
        ))  # fmt: skip
    figure.suptitle(textwrap.fill(board_words(cam), 95), fontsize=TEXT)
    _label_contours(
        figure, axis.clabel(lines, fmt=lambda level: f"{level + 0.0:g}", fontsize=SMALL, inline=False), named
    )
    return finished(figure)


def _label_contours(figure: Figure, labels: Sequence[Text], named: Sequence[Text]) -> None:
    """Keep the labels of contours that are clear of each other and of what is ``named``."""
    figure.draw_without_rendering()
    taken = [text.get_window_extent() for text in named]
    for text in labels:
        text.set_path_effects([*MAP_HALO])
        box = text.get_window_extent().padded(6.0)
        if any(box.overlaps(one) for one in taken):
            text.remove()
        else:
            taken.append(box)


def point_figure(cam: Calibrated) -> tuple[Figure, float, BoardPattern | None]:
    """Return the figure of the residuals by point, the enlargement of its arrows, and the pattern of a flat board
    beside it.

    None where the board was taken as flat, and one panel then.
    """
    before = None
    if not cam.board.flat:
        try:
            before = flat_pattern(cam.bundle, cam.corners)
        except InputError:  # too few pictures were selected
            before = None
    shown = [("as meant, flat", before)] if before is not None else []
    shown.append(("flat" if cam.board.flat else f"as measured ({cam.shape})", cam.board_pattern))
    at, board = _in_plane(cam), cam.board
    moved = [1e3 * pattern.mean @ board.axes.T for _, pattern in shown if pattern is not None]  # mm
    every = np.concatenate(moved)
    typical = float(np.percentile(np.linalg.norm(every[:, :2], axis=1), _SHARE))
    spacing = float(np.sqrt(np.prod(np.ptp(at, axis=0)) / len(at)))
    factor = round_number(LONGEST * spacing / max(typical, 1e-9))
    most = max(float(np.percentile(np.abs(every[:, 2]), _SHARE)), 1e-9)
    ratio = float(np.ptp(at[:, 1]) / np.ptp(at[:, 0]))
    down = len(shown) if ratio < BROAD else 1
    across = len(shown) // down
    wide = min((WIDTH - 1.6) / across, TALLEST / ratio)
    figure = canvas(1.2 + down * (wide * ratio + 0.3))
    axes: Any = figure.subplots(down, across, squeeze=False, sharex=True, sharey=True).ravel()
    found = cam.board_pattern.found and not cam.pattern.found
    size = float(np.clip((DOT * 72.0 * wide * spacing / np.ptp(at[:, 0])) ** 2, 2.0, 60.0))
    for k, (axis, (name, pattern), d) in enumerate(zip(axes, shown, moved, strict=True)):
        _board_axes(axis, cam)
        dots = axis.scatter(*at.T, c=d[:, 2], cmap=COLOURS, vmin=-most, vmax=most, s=size, linewidths=0.3,
                            edgecolors=QUIET, zorder=2)  # fmt: skip
        axis.quiver(
            *at.T, *d[:, :2].T, angles="xy", scale_units="xy", scale=1.0 / factor, color=INK, width=0.004,
            headwidth=3.5, zorder=3,
        )  # fmt: skip
        assert pattern is not None  # those that are not were left out
        axis.set_title(f"{name}: {pattern.share:.2f} of the noise", fontsize=TEXT, loc="left")
        if k % across == across - 1:
            bar = figure.colorbar(dots, cax=axis.inset_axes((1.03, 0.0, 0.03 * across, 1.0)))
            bar.ax.tick_params(labelsize=SMALL, length=2.5, color=QUIET)
            bar.outline.set_visible(False)
            bar.set_label("off along z (mm)", fontsize=TEXT)
        if k % across:
            axis.set_ylabel("")
        if k < len(shown) - across:
            axis.set_xlabel("")
    arrow = axes[0].plot([], [], color=INK, linewidth=1.2, label=f"off in the plane, {factor:,g} times enlarged")
    figure.legend(handles=arrow, loc="outside lower center", frameon=False, fontsize=SMALL)
    if found:
        figure.suptitle("The residuals follow the points of the board", fontsize=TEXT, color=ORANGE, fontweight="bold")
    return finished(figure), factor, before


def _in_plane(cam: Calibrated) -> Array:
    """(u, 2) x and y of the points as meant along the axes of the board, mm."""
    return np.asarray(1e3 * cam.board.nominal @ cam.board.axes[:2].T)


def _board_axes(axis: Axes, cam: Calibrated) -> None:
    """The frame of the board in true proportions, x to the right and y down."""
    at = _in_plane(cam)
    plain(axis)
    low, high = at.min(axis=0), at.max(axis=0)
    rim = RIM * float((high - low).max())
    axis.set(xlim=(low[0] - rim, high[0] + rim), ylim=(high[1] + rim, low[1] - rim), aspect="equal")
    axis.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    axis.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    axis.set_xlabel("x of the board (mm)", fontsize=TEXT)
    axis.set_ylabel("y (mm)", fontsize=TEXT)
