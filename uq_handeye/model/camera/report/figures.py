r"""All figures of a camera calibration, each with the words that belong to it.

This module imports Matplotlib; import it where it is used.

The board as figures: a map of its height, and what the residuals say of each of its points.

Model: the height of a point is that over the plane nearest to all points, along z of the board, which points away from
the camera (`camera.measured_board`). Between the points it is drawn by a thin plate spline through them. The residuals
of all pictures put point j off by d_j (`camera.board_pattern`). The board is seen from the front: x to the right, y
down. This module imports Matplotlib; import it where it is used.

Figures of the camera's view: how well the intrinsics say where a point is seen, and where the board was.

Model of the first: a point known in the camera frame is seen where the intrinsics say; their covariance makes the
standard deviation shown (`camera.rays`). The second stands in the camera frame: z ahead along the optical axis, x to
the right, y down. This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from scipy.interpolate import RBFInterpolator
from scipy.spatial import Delaunay

from ....core.files.atomic import write_files
from ....core.files.open import StrPath, as_path
from ....core.formatting.numbers import digits, fixed
from ....core.geometry.se3 import Array
from ....core.presentation.ellipses import render
from ....core.presentation.figure_parts import (
    BLUE,
    GREEN,
    INK,
    MAP_HALO,
    ON_MAP,
    ORANGE,
    QUIET,
    SMALL,
    TEXT,
    WIDTH,
    Picture,
    canvas,
    finished,
    plain,
    round_number,
)
from ....errors import InputError
from ..calibrated import Calibrated, certainty, picture_rms, seen_points
from ..models import rays
from ..residual_pattern import LARGE, BoardPattern, flat_pattern
from .residual_figures import MANY, by_picture_figure, over_picture_figure, pattern_figure, picture_canvas
from .text import board_pattern_words, board_words, boards_words, coverage_words, noise_words, pattern_words

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


def camera_figures(cam: Calibrated) -> dict[str, Figure]:
    """The figures of a camera calibration by the stem of their file names; those that cannot be drawn are left out."""
    return {stem: picture.figure for stem, picture in camera_pictures(cam).items()}


def save_figure(cam: Calibrated, path: StrPath, name: str) -> Path:
    """Write one of `camera_figures` as ``.png`` or ``.svg``, by the ending of the path, whole or not at all.

    Raises `InputError` for another ending, a name that none of them has, and if the file cannot be written.
    """
    path = as_path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        raise InputError(f"Expected a figure ending in .png or .svg, got {path.name!r}.")
    found = camera_figures(cam)
    if name not in found:
        raise InputError(f"Expected `name` to be one of {', '.join(found)}, got {name!r}.")
    write_files(path.parent, {path.name: render(found[name], kind)})
    return path


def camera_pictures(cam: Calibrated) -> dict[str, Picture]:
    """`camera_figures` with alt text and caption."""
    found = {
        "pattern": _pattern(cam),
        "residuals": _residuals(cam),
        "pictures": _by_picture(cam),
        "certainty": _certainty(cam),
        "boards": _boards(cam),
        "board": _board(cam),
        "board_residuals": _board_residuals(cam),
    }
    return {stem: picture for stem, picture in found.items() if picture is not None}


def _pattern(cam: Calibrated) -> Picture:
    figure, factor = pattern_figure(cam)
    alt = f"Mean residuals over the picture by cell, and by the distance from the centre. {pattern_words(cam)}"
    caption = (
        f"{pattern_words(cam)} Left: the mean residual (measured less predicted) of each cell, enlarged {factor:,g} "
        f"times; orange ones are beyond chance and larger than {LARGE:g} of the pixel noise. Right: its part away from "
        f"the centre, with bars of 2 sigma, and grey where it is below {LARGE:g} of the noise. A right model leaves "
        "short arrows without order, and a curve about 0."
    )
    return Picture(figure, alt, caption)


def _residuals(cam: Calibrated) -> Picture:
    figure, factor = over_picture_figure(cam)
    out = int((~cam.bundle.used).sum())
    alt = f"Residuals of all corners over the picture, in true proportions; {out} corners were left out."
    caption = (
        f"Residuals (measured less predicted) of the {int(cam.bundle.used.sum()):,} corners used, enlarged "
        f"{factor:,g} times, at their places in the picture, u to the right and v down. {coverage_words(cam)}"
    )
    if out:
        caption += " Crosses: corners left out, named by picture and number; the farthest only where they are many."
    return Picture(figure, alt, caption)


def _by_picture(cam: Calibrated) -> Picture:
    rms = picture_rms(cam)
    worst = int(np.argmax(rms))
    alt = (
        f"Root mean square of the residuals of each of {cam.corners.n} pictures, {digits(rms.min())} to "
        f"{digits(rms.max())} pixels; the largest is that of {cam.corners.names[worst]}."
    )
    caption = (
        f"Residuals of every picture. {noise_words(cam)} A picture far above the line was blurred, or its corners were "
        "found badly."
    )
    return Picture(by_picture_figure(cam), alt, caption)


def _certainty(cam: Calibrated) -> Picture | None:
    figure = certainty_figure(cam)
    if figure is None:
        return None
    deviation = certainty(cam)[2]
    low, high = fixed(np.nanmin(deviation), 2), fixed(np.nanmax(deviation), 2)
    alt = f"Map of the standard deviation of where a point is seen, over the picture: {low} to {high} pixels."
    caption = (
        "How well the intrinsics say where a point is seen that is known in the camera frame: standard deviation in "
        f"the worst direction, {low} to {high} pixels. It is the part that all pictures share, as far as the model is "
        "right; it grows where there were no corners."
    )
    return Picture(figure, alt, caption)


def _boards(cam: Calibrated) -> Picture:
    alt = f"Where the board was in the camera frame, from above and from the side. {boards_words(cam)}"
    caption = (
        f"{boards_words(cam)} Boards at several distances and tilts separate the focal length from the distance; "
        "boards that are all parallel to the picture do not."
    )
    return Picture(boards_figure(cam), alt, caption)


def _board(cam: Calibrated) -> Picture | None:
    figure = height_figure(cam)
    if figure is None:
        return None
    sd = 1e3 * cam.board.deviations[:, 2]
    alt = f"Map of the height of the board over its plane. {board_words(cam)}"
    caption = (
        f"{board_words(cam)} Height of the board over the plane nearest to its points (dots), seen from the front, "
        f"with contours in mm; its shape is {cam.shape}. The standard deviation of a height is {fixed(sd.min(), 2)} to "
        f"{fixed(sd.max(), 2)} mm, largest at the rim. board.csv has the points, and the covariance of all of them."
    )
    return Picture(figure, alt, caption)


def _board_residuals(cam: Calibrated) -> Picture:
    figure, factor, before = point_figure(cam)
    after = cam.board_pattern
    words = board_pattern_words(cam)
    alt = f"What the residuals say of each point of the board, from the front. {words}"
    caption = (
        f"{words} Where all pictures together put each point, minus where it was taken to be: arrows within the plane "
        f"of the board, enlarged {factor:,g} times, and colours along z. "
    )
    if before is not None:
        caption += (
            "Left: with the same camera model fitted once more to a flat board, part of whose errors then hide in "
            f"intrinsics and poses ({fixed(before.share, 2)} times the pixel noise). Right: with the board as measured "
            f"({fixed(after.share, 2)} times). "
        )
    chance = 1e3 * np.sqrt(np.mean(after.deviation**2, axis=0))
    caption += (
        "Where the shape is right, arrows and colours have no order: chance makes "
        f"{fixed(chance[0], 2)} mm in x, {fixed(chance[1], 2)} mm in y and {fixed(chance[2], 2)} mm in z (RMS)."
    )
    return Picture(figure, alt, caption)
