"""Errors of X as figures: shares of the noise sources in its variance; what was assumed and found of shared errors.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ...core.formatting.numbers import concise
from ...core.geometry.se3 import Array
from ...core.presentation.figure_parts import BLUE, INK, ORANGE, QUIET, SMALL, TEXT, canvas, finished, plain
from ...fit.likelihood.shared_estimates import SharedGroup
from .analysis import KINDS
from .shared_errors import found_of

_STYLES = ((BLUE, ""), (ORANGE, "////"))  # rotation, translation


def budget_figure(shares: Mapping[str, Array]) -> Figure:
    """Two bars for each source, of ``shares`` (2,): of the variances of X's rotation and translation."""
    count = len(shares)
    figure = canvas(0.95 + 0.52 * count)
    axis = figure.subplots()
    plain(axis)
    axis.grid(axis="y", visible=False)
    values = 100 * np.stack(list(shares.values()))
    for k, (kind, (colour, hatch)) in enumerate(zip(KINDS, _STYLES, strict=True)):
        y = np.arange(count) + 0.2 * (2 * k - 1)
        axis.barh(y, values[:, k], 0.36, color=colour, hatch=hatch, edgecolor="white", label=f"of X's {kind}")
        for row, value in zip(y, values[:, k], strict=True):
            axis.annotate(
                f"{value:.1f} %", (max(value, 0.0), row), xytext=(3, 0), textcoords="offset points", va="center",
                fontsize=SMALL, color=INK,
            )  # fmt: skip
    axis.set_yticks(range(count), labels=list(shares), fontsize=TEXT)
    axis.set_ylim(count - 0.5, -0.5)
    axis.set_xlim(min(0.0, 1.1 * float(values.min())), 1.12 * max(float(values.max()), 1.0))
    axis.set_xlabel("share of the variance (%)", fontsize=TEXT)
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=SMALL)
    return finished(figure)


# Estimates are drawn up to so many of the standard deviations assumed.
WIDEST = 6.0


def shared_figure(errors: Sequence[SharedGroup]) -> Figure:
    """A bar of +- one assumed standard deviation for each error, and its estimate with the one after the fit.

    Of an error of many numbers the estimates are dots, without their standard deviations.
    """
    count = len(errors)
    figure = canvas(1.0 + 0.42 * count)
    axis = figure.subplots()
    plain(axis)
    axis.grid(axis="y", visible=False)
    y = np.arange(count)
    z = [np.array([part.estimate / part.prior_sd for part in error.parts]) for error in errors]
    after = [np.array([part.sd / part.prior_sd for part in error.parts]) for error in errors]
    ends = [np.abs(of) + (sd if len(of) == 1 else 0.0) for of, sd in zip(z, after, strict=True)]
    reach = float(min(max(1.3, 1.1 * max(float(end.max()) for end in ends)), WIDEST))
    axis.barh(y, 2.0, 0.56, left=-1.0, color=QUIET, alpha=0.35, label="assumed, 1 sigma")
    single = [k for k, error in enumerate(errors) if error.count == 1]
    axis.errorbar(
        np.clip([z[k][0] for k in single], -reach, reach), single, xerr=[after[k][0] for k in single], fmt="o",
        markersize=4.5, color=BLUE, elinewidth=1.8, capsize=3, label="found, 1 sigma after the fit",
    )  # fmt: skip
    for k, error in enumerate(errors):
        if error.count > 1:
            axis.plot(np.clip(z[k], -reach, reach), np.full(error.count, k), "o", markersize=3, color=BLUE, alpha=0.5)
        axis.annotate(
            _amount(error), (1.0, k), xycoords=("axes fraction", "data"),
            xytext=(4, 0), textcoords="offset points", va="center", fontsize=SMALL, color=INK, annotation_clip=False,
        )  # fmt: skip
    axis.axvline(0.0, color=INK, linewidth=0.8)
    axis.set_yticks(range(count), labels=[error.name for error in errors], fontsize=TEXT)
    axis.set_ylim(count - 0.5, -0.5)
    axis.set_xlim(-reach, reach)
    axis.set_xlabel("error, in standard deviations assumed", fontsize=TEXT)
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=SMALL)
    return finished(figure)


def _amount(error: SharedGroup) -> str:
    if error.count > 1:
        return found_of(error)
    factor, unit = error.parts[0].shown
    return concise(factor * error.parts[0].estimate, factor * error.parts[0].sd, unit)
