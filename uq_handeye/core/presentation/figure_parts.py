"""Common parts of figures: names and alternative texts, width, canvas, and SVG for pages with several figures.

All figures are drawn on white, 6.9 inches wide, the width of an A4 page between its margins, with text of 7.5 points or
more. Colours are those of `colours`; hatches, markers or line styles say the same once more, for greyscale and
colour-blind readers. This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ...errors import InputError
from ..files.atomic import write_files
from ..files.open import StrPath, as_path
from .colours import GRID, QUIET

FIGURE_WIDTH_IN = 6.9
ROOM = 0.015  # share of the width at both sides
TEXT, SMALL = 8.5, 7.5  # points
HALO = [withStroke(linewidth=2.2, foreground="white")]
MAP_HALO = [withStroke(linewidth=2.2, foreground="#fefefe")]  # on a coloured map: white also where the page is dark

_ID = re.compile(r'(\sid="|url\(#|href="#)')


class Picture(NamedTuple):
    """A figure with its words."""

    figure: Figure
    alt: str  # what is seen, for those who do not see it
    caption: str  # how to read it
    scene: str = ""  # JSON that `turn.js` draws in its place, where it can be turned


def canvas(height: float, width: float = FIGURE_WIDTH_IN) -> NamedFigure:
    """An empty figure, ``height`` and ``width`` in inches."""
    # Hinting makes text a little wider at the resolution of a picture than where the layout is settled: leave it room.
    return NamedFigure(figsize=(width, height), layout=ConstrainedLayoutEngine(rect=(ROOM, 0.0, 1.0 - 2 * ROOM, 1.0)))


def finished(figure: Figure) -> Figure:
    """The figure with its layout settled.

    Positions are rounded: the last digits of the solver of the layout differ from time to time.
    """
    settle_layout(figure)
    for axis in figure.axes:
        left, bottom, width, height = (round(float(x), 4) for x in axis.get_position(original=True).bounds)
        axis.set_position((left, bottom, width, height))
    return figure


def plain(axis: Axes) -> None:
    """Thin frame, small ticks, a quiet grid below everything."""
    axis.tick_params(labelsize=SMALL, length=2.5, color=QUIET)
    axis.grid(color=GRID, linewidth=0.6)
    axis.set_axisbelow(True)
    for line in (axis.xaxis, axis.yaxis):
        line.get_offset_text().set_fontsize(SMALL)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axis.spines[side].set_color(QUIET)


def inline_svg(figure: Figure, name: str) -> str:
    """The figure as an ``<svg>`` element, the same bytes for the same figure; its ids begin with ``name``."""
    text = render(figure, "svg").decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<(metadata|title)>.*?</\1>\s*", "", text, flags=re.DOTALL)  # the page has words of its own
    text = _ID.sub(rf"\g<1>{name}-", text)
    # As the page is HTML, the namespaces need no declaration, and the size is that of the column.
    head, body = text.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None  # Matplotlib writes one
    return f'<svg {box.group()} xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"' + (
        f' aria-hidden="true" focusable="false">{body}'
    )


def round_number(value: float) -> float:
    """The nearest of 1, 2, 5, 10, ... below."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)))


def plain_numbers(axis: Axes) -> None:
    """Few ticks of a logarithmic axis, as numbers: 0.5, 1, 10, 20, and powers only where that would be long."""
    low, high = axis.get_ylim()
    decades = float(np.log10(high / low))
    steps = (1.0, 2.0, 5.0) if decades < 1.5 else (1.0, 3.0) if decades < 2.2 else (1.0,)
    axis.yaxis.set_major_locator(LogLocator(subs=steps, numticks=6 if decades >= 2.2 else 12))
    axis.yaxis.set_minor_formatter(NullFormatter())
    if low >= 1e-4 and high < 1e6:
        axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))


class NamedFigure(Figure):
    """A Matplotlib figure that notebooks show, with its alt text, also where pyplot was never imported."""

    name = ""
    title = ""
    alt = ""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        FigureCanvasAgg(self)

    def __repr__(self) -> str:
        return f"<Figure {self.name!r}: {self.title}>" if self.name else super().__repr__()

    def _repr_png_(self) -> tuple[bytes, dict[str, str]]:
        return render(self, "png", 110), {"alt": self.alt}

    def named(self, name: str, title: str, alt: str) -> NamedFigure:
        """Set what the figure is called; return the figure itself."""
        self.name, self.title, self.alt = name, title, alt
        self.set_label(name)
        return self


def settle_layout(figure: Figure) -> None:
    """Arrange the panels once and for all: every further pass of the layout would shift them a little."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
    figure.set_layout_engine("none")


def render(figure: Figure, kind: str, dpi: int = 200) -> bytes:
    """The figure as a ``png`` or ``svg`` file, with title and alt text inside; the same figure gives the same bytes."""
    if kind not in ("png", "svg"):
        raise InputError(f"Expected `kind` to be png or svg, got {kind!r}.")
    buffer = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {"Software": None}
    if isinstance(figure, NamedFigure) and figure.title:
        metadata |= {"Title": figure.title, "Description": figure.alt}
    with matplotlib.rc_context({"svg.hashsalt": "uq-handeye", "svg.fonttype": "path"}):
        figure.savefig(buffer, format=kind, dpi=dpi, metadata=metadata)
    return buffer.getvalue()


def save_figure(path: StrPath, drawn: Callable[[], Figure]) -> Path:
    """Draw a figure and write it as ``.png`` or ``.svg``, by the ending of the path, whole or not at all.

    Raises `InputError` for another ending, and if the file cannot be written.
    """
    path = as_path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        raise InputError(f"Expected a figure ending in .png or .svg, got {path.name!r}.")
    write_files(path.parent, {path.name: render(drawn(), kind)})
    return path
