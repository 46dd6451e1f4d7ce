r"""Figures of the board: a map of its height, and the displacement that the residuals show of each of its points.

Model: the height of a point is that over the plane nearest to all points, along z of the board, which points away from
the camera (`MeasuredBoard`). Between the points it is drawn linearly. The residuals of all pictures put point j off by
d_j (`BoardPattern`). The board is seen from the front: x to the right, y down. This module imports Matplotlib; import
it where it is used.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from ....core.geometry.se3 import Array
from ....core.presentation.colours import INK, ON_MAP, ORANGE, QUIET
from ....core.presentation.figure_parts import (
    FIGURE_WIDTH_IN,
    MAP_HALO,
    SMALL,
    TEXT,
    Picture,
    finished,
    plain,
    round_number,
)
from ....core.presentation.numbers import fixed
from ....core.presentation.units import MM_PER_M
from ..calibrated import Calibrated
from .frames import add_colour_scale, framed, marked, named_axes
from .text import board_pattern_words, board_words

# Both signs, dark where far from 0; contours and labels say the same in grey.
COLOURS = "RdBu_r"


def board_map(cam: Calibrated) -> Picture | None:
    """Map of the height with contours in mm; None where the shape of the board has no height."""
    board = cam.board
    height = MM_PER_M * board.heights
    if not np.ptp(height) > 0:
        return None
    at = _in_plane(cam)
    low, high, middle = at.min(axis=0), at.max(axis=0), at.mean(axis=0)
    figure, axis = framed(float((high - low)[1] / (high - low)[0]), 1.5, 1.0)
    most = float(np.abs(height).max())
    levels = MaxNLocator(nbins=11, steps=[1, 2, 2.5, 5, 10], symmetric=True).tick_values(-most, most)
    filled = axis.tricontourf(at[:, 0], at[:, 1], height, levels=levels, cmap=COLOURS)
    lines = axis.tricontour(at[:, 0], at[:, 1], height, levels=levels, colors=ON_MAP, linewidths=0.6)
    axis.plot(*at.T, ".", color=ON_MAP, markersize=2.0, markeredgewidth=0)
    _board_axes(axis, cam)
    axis.grid(visible=False)
    add_colour_scale(figure, axis, filled, "height along z, away from the camera (mm)")
    named = [
        marked(axis, at[j], f"{name}: {height[j]:.2f}", middle)
        for j, name in ((int(np.argmin(height)), "lowest"), (int(np.argmax(height)), "highest"))
    ]
    figure.suptitle(textwrap.fill(board_words(cam), 95), fontsize=TEXT)
    _label_contours(
        figure, axis.clabel(lines, fmt=lambda level: f"{level + 0.0:g}", fontsize=SMALL, inline=False), named
    )
    sd = MM_PER_M * board.deviations[:, 2]
    alt = f"Map of the height of the board over its plane. {board_words(cam)}"
    caption = (
        f"{board_words(cam)} Height of the board over the plane nearest to its points (dots), seen from the front, "
        f"with contours in mm; its shape is {cam.shape}. The standard deviation of a height is {fixed(sd.min(), 2)} to "
        f"{fixed(sd.max(), 2)} mm, largest at the rim. board.csv has the points, and the covariance of all of them."
    )
    return Picture(finished(figure), alt, caption)


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


def by_point(cam: Calibrated) -> Picture:
    """Residuals by the points of the board."""
    at, board, found = _in_plane(cam), cam.board, cam.board_pattern
    moved = MM_PER_M * found.mean @ board.axes.T  # mm
    typical = float(np.percentile(np.linalg.norm(moved[:, :2], axis=1), 95))
    spacing = float(np.sqrt(np.prod(np.ptp(at, axis=0)) / len(at)))
    factor = round_number(1.6 * spacing / max(typical, 1e-9))
    most = max(float(np.percentile(np.abs(moved[:, 2]), 95)), 1e-9)
    figure, axis = framed(float(np.ptp(at[:, 1]) / np.ptp(at[:, 0])), 1.6, 1.5)
    wide = 72.0 * axis.get_position().width * FIGURE_WIDTH_IN
    size = float(np.clip((0.6 * wide * spacing / np.ptp(at[:, 0])) ** 2, 2.0, 60.0))
    _board_axes(axis, cam)
    x, y = at.T
    dots = axis.scatter(x, y, c=moved[:, 2], cmap=COLOURS, vmin=-most, vmax=most, s=size, linewidths=0.3,
                        edgecolors=QUIET, zorder=2)  # fmt: skip
    axis.quiver(
        *at.T, *moved[:, :2].T, angles="xy", scale_units="xy", scale=1.0 / factor, color=INK, width=0.004,
        headwidth=3.5, zorder=3,
    )  # fmt: skip
    named = "flat" if board.flat else f"as measured ({cam.shape})"
    axis.set_title(f"{named}: {found.share:.2f} of the noise", fontsize=TEXT, loc="left")
    add_colour_scale(figure, axis, dots, "off along z (mm)")
    arrow = axis.plot([], [], color=INK, linewidth=1.2, label=f"off in the plane, {factor:,g} times enlarged")
    figure.legend(handles=arrow, loc="outside lower center", frameon=False, fontsize=SMALL)
    if found.found and not cam.pattern.found:
        figure.suptitle("The residuals follow the points of the board", fontsize=TEXT, color=ORANGE, fontweight="bold")
    words = board_pattern_words(cam)
    alt = f"What the residuals say of each point of the board, from the front. {words}"
    chance = MM_PER_M * np.sqrt(np.mean(found.deviation**2, axis=0))
    caption = (
        f"{words} Where all pictures together put each point, minus where it was taken to be: arrows within the plane "
        f"of the board, enlarged {factor:,g} times, and colours along z. Where the shape is right, arrows and colours "
        f"have no order: chance makes {fixed(chance[0], 2)} mm in x, {fixed(chance[1], 2)} mm in y and "
        f"{fixed(chance[2], 2)} mm in z (RMS)."
    )
    return Picture(finished(figure), alt, caption)


def _in_plane(cam: Calibrated) -> Array:
    """(u, 2) x and y of the points as meant along the axes of the board, mm."""
    return np.asarray(MM_PER_M * cam.board.nominal @ cam.board.axes[:2].T)


def _board_axes(axis: Axes, cam: Calibrated) -> None:
    """The frame of the board in true proportions, x to the right and y down."""
    at = _in_plane(cam)
    plain(axis)
    low, high = at.min(axis=0), at.max(axis=0)
    rim = 0.06 * float((high - low).max())
    axis.set(xlim=(low[0] - rim, high[0] + rim), ylim=(high[1] + rim, low[1] - rim), aspect="equal")
    named_axes(axis, "x of the board (mm)", "y (mm)", ticks=(6, 5), steps=[1, 2, 5, 10])
