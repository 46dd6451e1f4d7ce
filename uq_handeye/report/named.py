"""Figures of a calibration by name, one at a time. This module imports Matplotlib; import it where it is used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from ..calibration.report.plotted import FIGURES, figure_names
from ..errors import InputError
from .comparison.of_result import compare_beside
from .figures import pictures

if TYPE_CHECKING:
    from ..calibration.result import Calibration


def figure_of(result: Calibration, name: str | None = None) -> Figure:
    """Return the figure of that name, without a name the first there is.

    Raises `InputError` for a name that the result has no figure of.
    """
    names = figure_names(result)
    if name is None and names:
        name = names[0]
    if name in names:
        comparison = compare_beside(result).comparison if name == "methods" else None
        picture = pictures(result, None, comparison, only=(name,)).get(name)
        if picture is not None:
            return picture.figure
    known = f"; {name!r} needs data or a covariance that this result does not have" if name in FIGURES else ""
    raise InputError(f"Expected `name` to be one of {', '.join(names) or 'no figures'}, got {name!r}{known}.")
