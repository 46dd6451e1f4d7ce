"""Colour, marker and line of each method, the same in every figure; no two differ by colour only."""

from __future__ import annotations

from typing import Any

from uq_handeye.core.presentation.colours import BLUE, GREEN, INK, ORANGE, PURPLE, SKY

YELLOW = "#B59B00"  # Okabe and Ito's yellow is too light on white
_STYLES = {
    "tsai": (YELLOW, "v", ":"),
    "shiu": (YELLOW, "^", "--"),
    "chou": (GREEN, "s", "--"),
    "park": (SKY, "o", "-"),
    "horaud": (SKY, "P", ":"),
    "daniilidis": (PURPLE, "D", "-"),
    "andreff": (ORANGE, "X", "-"),
    "lu": (PURPLE, "<", ":"),
    "gwak": (INK, "*", ":"),
    "heller": (ORANGE, ">", "--"),
    "condurache": (GREEN, "d", "-."),
    "zhang": (PURPLE, "p", "--"),
    "zhao": (ORANGE, "h", ":"),
    "nguyen": (GREEN, "o", "-"),
    "4dpa": (BLUE, "o", "-"),
    "li": (YELLOW, "p", "-."),
    "shah": (SKY, "h", "-."),
    "efficient": (INK, "s", "-"),
    "ml": (INK, "D", "--"),
}


def style(method: str) -> dict[str, Any]:
    """Keyword arguments of Matplotlib's ``plot``."""
    colour, marker, line = _STYLES[method]
    return {"color": colour, "marker": marker, "linestyle": line, "markersize": 4, "linewidth": 1.1}
