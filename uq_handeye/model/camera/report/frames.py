"""Frames of the figures of a camera calibration: proportions, axes, colour bars and marks."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from ....core.geometry.se3 import Array
from ....core.presentation.colours import ON_MAP, QUIET
from ....core.presentation.figure_parts import FIGURE_WIDTH_IN, MAP_HALO, SMALL, TEXT, canvas, plain


def framed(ratio: float, beside: float, more: float) -> tuple[Figure, Axes]:
    """A figure with one frame, height over width ``ratio``, ``beside`` inches left free for labels, ``more`` above."""
    wide = min(FIGURE_WIDTH_IN - beside, 5.0 / ratio)  # no frame is taller than 5 inches
    figure = canvas(more + wide * ratio)
    side = 0.5 * max(FIGURE_WIDTH_IN - beside - wide, 0.0)
    return figure, figure.add_subplot(
        figure.add_gridspec(1, 3, width_ratios=[side, wide, side])[1] if side > 0 else 111
    )


def named_axes(
    axis: Axes,
    x: str,
    y: str,
    title: str = "",
    ticks: tuple[int, int] | None = None,
    *,
    integer: bool = False,
    steps: Sequence[float] | None = None,
) -> None:
    """Names of both axes, a title, and the largest numbers of ``ticks``: at whole numbers, or at ``steps``."""
    axis.set_xlabel(x, fontsize=TEXT)
    axis.set_ylabel(y, fontsize=TEXT)
    if title:
        axis.set_title(title, fontsize=TEXT, loc="left")
    for line, most in zip((axis.xaxis, axis.yaxis), ticks or (), strict=False):
        line.set_major_locator(MaxNLocator(nbins=most, integer=integer, steps=steps))


def add_colour_scale(figure: Figure, axis: Axes, drawn: ScalarMappable, name: str) -> Colorbar:
    """Colour bar of a map, with the name of its quantity."""
    bar = figure.colorbar(drawn, cax=axis.inset_axes((1.02, 0.0, 0.028, 1.0)))
    bar.ax.tick_params(labelsize=SMALL, length=2.5, color=QUIET)
    bar.outline.set_visible(False)
    bar.set_label(name, fontsize=TEXT)
    return bar


def marked(axis: Axes, at: Array, name: str, middle: Array) -> Text:
    """A cross on a map with a name, written towards the ``middle``; rows count downwards."""
    axis.plot(*at, "+", color=ON_MAP, markersize=8, clip_on=False, zorder=6)
    left, above = at < middle
    return axis.annotate(
        name, (float(at[0]), float(at[1])), xytext=(6 if left else -6, -8 if above else 8), color=ON_MAP, zorder=7,
        textcoords="offset points", fontsize=SMALL, path_effects=MAP_HALO, va="center", ha="left" if left else "right",
    )  # fmt: skip


def picture_canvas(image_size: tuple[int, int], beside: float) -> tuple[Figure, Axes]:
    """A figure with the frame of one picture, ``beside`` inches left free for labels.

    The frame stands at the bottom of its place: where it floats, the layout takes too little room for the labels below.
    """
    figure, axis = framed(image_size[1] / image_size[0], beside, 0.9)
    picture_axes(axis, image_size)
    axis.set_anchor("S")
    return figure, axis


def picture_axes(axis: Axes, image_size: tuple[int, int]) -> None:
    """The frame of a picture in true proportions, u to the right and v down."""
    width, height = image_size
    plain(axis)
    for side in axis.spines.values():
        side.set_visible(True)
        side.set_color(QUIET)
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    named_axes(axis, "u (pixels)", "v (pixels)", ticks=(6, 5), integer=True)
