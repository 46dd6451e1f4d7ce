"""Squared distances against chi-square: the picture of whether covariances are consistent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from uq_handeye.core.presentation.colours import GRID
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain

Curve = tuple[ArrayLike, str, str, str]  # squared distances (n,), label, colour and style of the line


def quantile_figure(curves: Sequence[Curve], freedom: int = 6) -> Any:
    """Sorted squared distances, of n sets in each curve, over those of chi-square; shaded, where true ones lie."""
    n = np.size(curves[0][0])
    figure = canvas(3.6)
    axis = figure.subplots()
    plain(axis)
    expected = stats.chi2.ppf((np.arange(n) + 0.5) / n, freedom)
    order = np.arange(1, n + 1)
    low, high = (stats.chi2.ppf(stats.beta.ppf(level, order, n + 1 - order), freedom) for level in (0.005, 0.995))
    axis.fill_between(expected, low, high, color=GRID, label="99 % of true ones", linewidth=0)
    for values, label, colour, line in curves:
        axis.plot(expected, np.sort(values), color=colour, linestyle=line, label=label)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlabel(f"quantile of chi-square with {freedom} degrees of freedom", fontsize=TEXT)
    axis.set_ylabel("squared distance of X from the truth", fontsize=TEXT)
    axis.legend(fontsize=SMALL, frameon=False)
    return finished(figure)
