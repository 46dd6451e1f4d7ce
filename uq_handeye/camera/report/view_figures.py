r"""Figures of the camera's view: how well the intrinsics say where a point is seen, and where the board was.

Model of the first: a point known in the camera frame is seen where the intrinsics say; their covariance makes the
standard deviation shown (`camera.rays`). The second stands in the camera frame: z ahead along the optical axis, x to
the right, y down. This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ...formatting.numbers import fixed
from ...geometry.se3 import Array
from ...presentation.figure_parts import BLUE, GREEN, ON_MAP, QUIET, SMALL, TEXT, WIDTH, canvas, finished, plain
from ...presentation.label_placement import MAP_HALO
from ..calibrated import Calibrated
from ..rays import rays
from ..what_was_seen import certainty, seen_points
from .residual_figures import MANY, picture_canvas

# Boards that are drawn in full, evenly spread over the pictures, and as dots.
MOST_BOARDS, MOST_DOTS = 40, 1000
# A field of view to both sides beyond this is not drawn as lines.
WIDEST = np.radians(80.0)


def certainty_figure(cam: Calibrated) -> Figure | None:
    """Map of the standard deviation in pixels over the picture; None where the intrinsics are exact."""
    if not cam.estimated:
        return None
    width, height = cam.image_size
    u, v, deviation = certainty(cam)
    if not np.isfinite(deviation).any():
        return None
    figure, axis = picture_canvas(cam.image_size, 1.6)
    axis.grid(visible=False)
    low, high = float(np.nanmin(deviation)), float(np.nanmax(deviation))
    levels = np.geomspace(low, high, 13) if high > 8 * low > 0 else np.linspace(low, max(high, 1.001 * low + 1e-9), 13)
    drawn = axis.contourf(u, v, np.ma.masked_invalid(deviation), levels=levels, cmap="Blues")
    used = cam.bundle.used
    axis.plot(
        *cam.corners.pixels[used].T, ".", color=ON_MAP, markersize=1.0 if used.sum() > MANY else 2.0, markeredgewidth=0,
        rasterized=bool(used.sum() > MANY),
    )  # fmt: skip
    bar = figure.colorbar(drawn, cax=axis.inset_axes((1.02, 0.0, 0.028, 1.0)))
    bar.set_ticks(levels[::2].tolist(), labels=[fixed(level, 2) for level in levels[::2]])
    bar.ax.tick_params(labelsize=SMALL, length=2.5, color=QUIET)
    bar.outline.set_visible(False)
    bar.set_label("standard deviation (pixels)", fontsize=TEXT)
    best = np.unravel_index(int(np.nanargmin(deviation)), deviation.shape)
    for at, name in ((best, "best"), (np.unravel_index(int(np.nanargmax(deviation)), deviation.shape), "worst")):
        x, y = float(u[at]), float(v[at])
        axis.plot(x, y, "+", color=ON_MAP, markersize=7, clip_on=False, zorder=6)
        left, above = x < width / 2, y < height / 2
        axis.annotate(
            f"{name}: {fixed(deviation[at], 2)}", (x, y), xytext=(6 if left else -6, -7 if above else 7),
            textcoords="offset points", fontsize=SMALL, color=ON_MAP, path_effects=MAP_HALO, zorder=7, va="center",
            ha="left" if left else "right",
        )  # fmt: skip
    handles = [Line2D([], [], marker=".", linestyle="", color=QUIET, markersize=4, label="corners used")]
    figure.legend(handles=handles, loc="outside upper right", frameon=False, fontsize=SMALL)
    return finished(figure)


def boards_figure(cam: Calibrated) -> Figure:
    """The boards in the camera frame, from above and from the side, with the field of view."""
    points = seen_points(cam)
    middle = np.stack([part.mean(axis=0) for part in points])
    n = len(points)
    full, dots = (
        np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int)) for most in (MOST_BOARDS, MOST_DOTS)
    )
    outlines = [outline(points[k]) for k in full]
    everything = np.concatenate([np.zeros((1, 3)), *outlines])
    low, high = everything.min(axis=0), everything.max(axis=0)
    # Both panels have one scale; a direction in which the boards hardly differ still gets some room.
    size = np.maximum(high - low, 0.45 * max(high[2] - low[2], 1e-9))
    middle_of = 0.5 * (low + high)
    low, high = middle_of - 0.55 * size, middle_of + 0.55 * size
    each = (WIDTH - 1.5) / (size[0] + size[2])
    figure = canvas(float(np.clip(1.25 + each * max(size[2], size[1]), 2.6, 6.0)))
    axes: Any = figure.subplots(1, 2, width_ratios=[size[0], size[2]])
    for axis, (across, up), names, title in (
        (axes[0], (0, 2), ("x, to the right (m)", "z, ahead (m)"), "from above"),
        (axes[1], (2, 1), ("z, ahead (m)", "y, down (m)"), "from the side"),
    ):
        plain(axis)
        for line in outlines:
            axis.plot(line[:, across], line[:, up], color=GREEN, linewidth=0.9, zorder=3)
        axis.plot(middle[dots, across], middle[dots, up], "o", color=GREEN, markersize=2.4, markeredgewidth=0, zorder=4)
        axis.plot(0.0, 0.0, "s", color=BLUE, markersize=6, zorder=5)
        for ray in _edges(cam, 0 if up == 2 else 1, float(high[2])):
            axis.plot(ray[:, across], ray[:, up], color=BLUE, linewidth=0.8, linestyle="--", zorder=2)
        axis.set(xlim=(low[across], high[across]), ylim=(low[up], high[up]), aspect="equal")
        if up == 1:
            axis.invert_yaxis()
        axis.xaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
        axis.yaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
        axis.set_xlabel(names[0], fontsize=TEXT)
        axis.set_ylabel(names[1], fontsize=TEXT)
        axis.set_title(title, fontsize=TEXT, loc="left")
    handles = [
        Line2D([], [], marker="s", linestyle="", color=BLUE, markersize=5, label="camera"),
        Line2D([], [], color=BLUE, linewidth=1.0, linestyle="--", label="edge of the picture"),
        Line2D([], [], color=GREEN, linewidth=1.2, label=f"outline of the corners ({len(full)} of {n} pictures)"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=SMALL)
    return finished(figure)


def outline(points: Array) -> Array:
    """Closed hull (k, 3) of points of a plane (m, 3)."""
    from scipy.spatial import ConvexHull  # needed here only

    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2][:2]
    ring = ConvexHull((points - middle) @ axes.T).vertices
    return np.asarray(points[[*ring, ring[0]]])


def _edges(cam: Calibrated, side: int, depth: float) -> list[Array]:
    """Lines (2, 3) from the camera through the middles of two opposite edges of the picture, to the depth given."""
    width, height = cam.image_size
    centre = cam.bundle.parameters[2:4]
    ends = np.array([[-0.5, centre[1]], [width - 0.5, centre[1]]] if side == 0 else
                    [[centre[0], -0.5], [centre[0], height - 0.5]])  # fmt: skip
    found = rays(cam.bundle.model, cam.bundle.intrinsics, ends)
    return [
        np.stack([np.zeros(3), ray * depth / ray[2]])
        for ray in found
        if ray[2] > np.cos(WIDEST)  # nan is not
    ]
