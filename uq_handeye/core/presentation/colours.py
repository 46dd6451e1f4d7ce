"""Colours of figures and drawings: those of Okabe and Ito, which colour-blind readers can distinguish, and greys."""

from __future__ import annotations

BLUE, ORANGE, SKY, GREEN, PURPLE, AMBER = "#0072B2", "#D55E00", "#56B4E9", "#009E73", "#CC79A7", "#E69F00"
# Greys of Matplotlib: text and lines, what is less important, and the lines of a grid.
INK, QUIET, GRID = "0.15", "0.45", "0.87"
ON_MAP = "0.2"  # marks on a coloured map, which is light also where the page is dark


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of a colour such as ``#0072B2``."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue
