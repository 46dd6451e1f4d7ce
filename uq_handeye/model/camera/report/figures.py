"""All figures of a camera calibration, each with its caption and alternative text."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.figure import Figure

from ....core.presentation.figure_parts import (
    Picture,
)
from ....errors import InputError
from ..calibrated import Calibrated
from .board_figures import board_map, by_point
from .residual_figures import (
    by_picture,
    over_cells,
    over_picture,
)
from .view_figures import boards_seen, over_certainty

FIGURES: dict[str, Callable[[Calibrated], Picture | None]] = {
    "pattern": over_cells,
    "residuals": over_picture,
    "pictures": by_picture,
    "certainty": over_certainty,
    "boards": boards_seen,
    "board": board_map,
    "board_residuals": by_point,
}


def camera_pictures(cam: Calibrated) -> dict[str, Picture]:
    """The figures of a camera calibration by the stem of their file names; those that cannot be drawn are left out."""
    return {stem: picture for stem, draw in FIGURES.items() if (picture := draw(cam)) is not None}


def named_figure(cam: Calibrated, name: str) -> Figure:
    """One of the figures; raises `InputError` for a name that none of them has, or of one that cannot be drawn."""
    picture = FIGURES[name](cam) if name in FIGURES else None
    if picture is None:
        names = ", ".join(camera_pictures(cam))
        raise InputError(f"Expected `name` to be one of {names}, got {name!r}.")
    return picture.figure
