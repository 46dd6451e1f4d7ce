"""Errors that all poses share as a figure: what was assumed of each, and what is known after the fit.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...formatting.numbers import concise
from ...likelihood.shared_estimates import SharedEstimate
from ...presentation.figure_parts import BLUE, INK, QUIET, SMALL, TEXT, canvas, finished, plain

# Estimates are drawn up to so many of the standard deviations assumed.
WIDEST = 6.0


def shared_figure(errors: Sequence[SharedEstimate]) -> Figure:
    """A bar of +- one assumed standard deviation for each error, and its estimate with the one after the fit."""
    count = len(errors)
    figure = canvas(1.0 + 0.42 * count)
    axis = figure.subplots()
    plain(axis)
    axis.grid(axis="y", visible=False)
    y = np.arange(count)
    estimate = np.array([error.estimate / error.prior_sd for error in errors])
    after = np.array([error.sd / error.prior_sd for error in errors])
    reach = float(min(max(1.3, 1.1 * np.max(np.abs(estimate) + after)), WIDEST))
    axis.barh(y, 2.0, 0.56, left=-1.0, color=QUIET, alpha=0.35, label="assumed, 1 sigma")
    axis.errorbar(
        np.clip(estimate, -reach, reach), y, xerr=after, fmt="o", markersize=4.5, color=BLUE, elinewidth=1.8, capsize=3,
        label="found, 1 sigma after the fit",
    )  # fmt: skip
    for k, error in enumerate(errors):
        factor, unit = error.shown
        axis.annotate(
            concise(factor * error.estimate, factor * error.sd, unit), (1.0, k), xycoords=("axes fraction", "data"),
            xytext=(4, 0), textcoords="offset points", va="center", fontsize=SMALL, color=INK, annotation_clip=False,
        )  # fmt: skip
    axis.axvline(0.0, color=INK, linewidth=0.8)
    axis.set_yticks(range(count), labels=[error.name for error in errors], fontsize=TEXT)
    axis.set_ylim(count - 0.5, -0.5)
    axis.set_xlim(-reach, reach)
    axis.set_xlabel("error, in standard deviations assumed", fontsize=TEXT)
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=SMALL)
    return finished(figure)
