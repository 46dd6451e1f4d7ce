r"""Residuals of the corners as figures: picture by picture, all over the picture, and their mean by cell and radius.

Model: a residual is the measured minus the predicted place of a corner, in pixels, u to the right
and v down. Where the model is right, means of residuals are chance: that of m corners has the standard deviation
``s / sqrt(m)`` per coordinate, with s the pixel noise (`camera.residual_pattern`).
This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from ....core.geometry.se3 import Array
from ....core.limits import MAX_DRAWN_POINTS
from ....core.presentation.colours import BLUE, GRID, INK, ORANGE, QUIET
from ....core.presentation.figure_parts import (
    FIGURE_WIDTH_IN,
    SMALL,
    TEXT,
    Picture,
    canvas,
    finished,
    plain,
    plain_numbers,
    round_number,
)
from ....core.presentation.numbers import digits
from ..calibrated import Calibrated, cells_that_matter, picture_rms, radial_means
from ..residual_pattern import CELLS, MIN_PATTERN_SHARE
from .frames import named_axes, picture_axes, picture_canvas
from .text import coverage_words, noise_words, pattern_words


def by_picture(cam: Calibrated) -> Picture:
    """RMS of the residuals of every picture, the corners left out of it, and the pixel noise."""
    corners, used = cam.corners, cam.bundle.used
    distance = np.linalg.norm(cam.bundle.residuals, axis=1)
    figure = canvas(2.9)
    axis = figure.subplots()
    plain(axis)
    rms = picture_rms(cam)
    number = corners.rows.astype(float)
    size = 4.0 if corners.n <= 200 else 2.0
    axis.plot(number, rms, "o", color=BLUE, markersize=size, markeredgewidth=0, label="RMS of the corners used")
    noise = cam.bundle.picture_noise
    axis.plot(number, noise, "_", color=INK, markersize=7, label="noise of the picture, by which they count")
    axis.axhline(
        cam.pixel_noise, color=INK, linewidth=1.0, linestyle="--", label=f"pixel noise, {cam.pixel_noise:.3g} pixels"
    )
    if (~used).any():
        out = number[corners.picture[~used]]
        _crosses(axis, out, distance[~used], f"distance of a corner left out ({int((~used).sum()):,})")
    highest = float(max(rms.max(), cam.pixel_noise, distance[~used].max(initial=0.0)))
    if highest > 12 * cam.pixel_noise:
        axis.set_yscale("log")
        axis.set_ylim(0.5 * max(float(rms.min()), 0.05 * cam.pixel_noise), 4.0 * highest)
        plain_numbers(axis)
    else:
        axis.set_ylim(0.0, 1.25 * highest or 1.0)
    margin = 0.02 * max(float(np.ptp(number)), 1.0) + 0.4
    axis.set_xlim(number[0] - margin, number[-1] + margin)
    axis.xaxis.set_major_locator(MaxNLocator(nbins=12, integer=True, min_n_ticks=1))
    named_axes(axis, "row of the picture, counted from 0", "residual (pixels)")
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=SMALL, columnspacing=1.2)
    worst = corners.names[int(np.argmax(rms))]
    alt = (
        f"Root mean square of the residuals of each of {corners.n} pictures, {digits(rms.min())} to "
        f"{digits(rms.max())} pixels; the largest is that of {worst}."
    )
    caption = (
        f"Residuals of every picture. {noise_words(cam)} A picture far above the line was blurred, or its corners were "
        "found badly."
    )
    return Picture(finished(figure), alt, caption)


def _crosses(axis: Axes, x: Array, y: Array, label: str) -> list[Line2D]:
    """Crosses at the corners that were left out."""
    return axis.plot(
        x, y, "X", color=ORANGE, markersize=6.5, markeredgecolor="white", markeredgewidth=0.6, label=label, zorder=5
    )


def over_picture(cam: Calibrated) -> Picture:
    """All residuals as arrows at their corners."""
    corners, used, residuals = cam.corners, cam.bundle.used, cam.bundle.residuals
    width, height = cam.image_size
    figure, axis = picture_canvas(cam.image_size, 0.8)
    typical = max(2.45 * cam.pixel_noise, 1e-9)  # 95 % are shorter
    factor = round_number(0.02 * max(width, height) / typical)
    u, v = corners.pixels[used].T
    axis.quiver(
        u, v, *residuals[used].T, angles="xy", scale_units="xy", scale=1.0 / factor, color=BLUE, headwidth=3.5,
        width=0.0009 if used.sum() > MAX_DRAWN_POINTS else 0.0016, rasterized=bool(used.sum() > MAX_DRAWN_POINTS),
    )  # fmt: skip
    handles = [axis.plot([], [], color=BLUE, linewidth=1.2, label=f"residual, {factor:,g} times enlarged")[0]]
    if (~used).any():
        out = corners.pixels[~used]
        label = f"corner left out ({int((~used).sum()):,})"
        handles += _crosses(axis, out[:, 0], out[:, 1], label)
    figure.legend(handles=handles, loc="outside upper right", ncols=2, frameon=False, fontsize=SMALL)
    left = int((~used).sum())
    alt = f"Residuals of all corners over the picture, in true proportions; {left} corners were left out."
    caption = (
        f"Residuals (measured minus predicted) of the {int(used.sum()):,} corners used, enlarged {factor:,g} times, at "
        f"their places in the picture, u to the right and v down. {coverage_words(cam)}"
    )
    if left:
        caption += " Crosses: corners left out, which the table names."
    return Picture(finished(figure), alt, caption)


def over_cells(cam: Calibrated) -> Picture:
    """The mean residual of each cell of the picture, and the radial part by the distance from the centre."""
    width, height = cam.image_size
    half = 0.55 * FIGURE_WIDTH_IN
    figure = canvas(float(np.clip(1.45 + (half - 0.6) * height / width, 3.2, 6.0)))
    left, right = figure.subplots(1, 2, width_ratios=[1.35, 1.0])
    found = cam.pattern.found
    figure.suptitle(
        textwrap.fill(pattern_words(cam, short=True), 80 if found else 100),
        fontsize=TEXT,
        color=ORANGE if found else INK,
        fontweight="bold" if found else "normal",
    )
    figure.get_layout_engine().set(wspace=0.05)  # type: ignore[union-attr, call-arg]
    factor = _cells(left, cam)
    _radial(right, cam)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=SMALL, columnspacing=1.4)
    alt = f"Mean residuals over the picture by cell, and by the distance from the centre. {pattern_words(cam)}"
    caption = (
        f"{pattern_words(cam)} Left: the mean residual (measured minus predicted) of each cell, enlarged {factor:,g} "
        f"times; orange ones are beyond chance and larger than {MIN_PATTERN_SHARE:g} of the pixel noise. Right: its "
        f"part away from the centre, with bars of 2 sigma, and grey where it is below {MIN_PATTERN_SHARE:g} of it. "
        "A right model leaves short arrows without order, and a curve about 0."
    )
    return Picture(finished(figure), alt, caption)


def _cells(axis: Axes, cam: Calibrated) -> float:
    """Arrows of the means, with a hatch where no corner was; returns by what they are enlarged."""
    width, height = cam.image_size
    picture_axes(axis, cam.image_size)
    axis.grid(visible=False)
    mean, count, s = cam.pattern.mean, cam.pattern.count, cam.pixel_noise
    cell = np.array([width, height]) / CELLS
    for k, (row, column) in enumerate(np.argwhere(count == 0)):
        u, v = cell * (column, row) - 0.5
        label = "no corner" if k == 0 else None
        axis.add_patch(
            Rectangle((u, v), *cell, label=label, facecolor="0.94", edgecolor="0.7", hatch="////", linewidth=0)
        )
    for k in range(1, CELLS):
        axis.axvline(k * cell[0] - 0.5, color=GRID, linewidth=0.6, zorder=0.5)
        axis.axhline(k * cell[1] - 0.5, color=GRID, linewidth=0.6, zorder=0.5)
    length = np.linalg.norm(mean, axis=-1)
    # So that a mean as large as the pixel noise fills a cell: that of a right model stays short.
    factor = round_number(float(cell.min()) / max(float(length.max()) / 1.5, s, 1e-12))
    matters = cells_that_matter(cam)
    rows, columns = np.nonzero(count > 0)
    centres = (np.stack([columns, rows], axis=-1) + 0.5) * cell - 0.5
    for chosen, colour, name in (
        (~matters, BLUE, "chance, or too small to matter"),
        (matters, ORANGE, f"beyond chance, and more than {MIN_PATTERN_SHARE:g} of the noise"),
    ):
        part = chosen[rows, columns]
        if not part.any():
            continue
        axis.quiver(
            *centres[part].T, *mean[rows[part], columns[part]].T, angles="xy", scale_units="xy", scale=1.0 / factor,
            color=colour, width=0.006, headwidth=3.6, headlength=4.0, headaxislength=3.6, zorder=3,
        )  # fmt: skip
        axis.plot(*centres[part].T, ".", color=colour, markersize=3.0, markeredgewidth=0, zorder=3)
        axis.plot([], [], color=colour, linewidth=1.8, label=name)
    axis.set_title(f"mean residual by cell, {factor:,g} times enlarged", fontsize=TEXT, loc="left")
    return factor


def _radial(axis: Axes, cam: Calibrated) -> None:
    """Mean radial residual in rings about the centre: what a wrong distortion leaves."""
    radius, mean, count = radial_means(cam)
    plain(axis)
    s = cam.pixel_noise
    axis.axhline(0.0, color=QUIET, linewidth=0.8)
    axis.errorbar(
        radius, mean, 2 * s / np.sqrt(count), fmt="o-", color=BLUE, markersize=3.5, linewidth=1.0, elinewidth=1.0,
        capsize=2.0,
    )  # fmt: skip
    axis.axhspan(-MIN_PATTERN_SHARE * s, MIN_PATTERN_SHARE * s, color="0.93", zorder=0.4)
    top = 1.15 * max(s, float(np.max(np.abs(mean) + 2 * s / np.sqrt(count))))
    axis.set_ylim(-top, top)
    axis.set_xlim(0.0, 1.06 * float(radius.max()))
    axis.xaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))
    axis.yaxis.set_major_locator(MaxNLocator(nbins=6, symmetric=True))
    named_axes(axis, "distance from the centre (pixels)", "outward, mean (pixels)", "by the distance from the centre")
