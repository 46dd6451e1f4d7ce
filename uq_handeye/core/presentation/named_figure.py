"""Figures with a name, a title and a text for those who do not see them.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import io
from typing import Any

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ...errors import InputError


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
