"""Corner plot of a posterior: each coordinate and the density of each pair, with the Gaussian of the bound.

The diagonal has the histogram of the samples and the normal density of the `ml` covariance. Below it is the smoothed
density of two coordinates, with contours that hold 39.3 %, 86.5 % and 98.9 % of the samples (the probabilities of the
1, 2 and 3 sigma ellipses in two dimensions), and those ellipses of the `ml` covariance. The origin is the `ml`
estimate.

The density is a histogram smoothed by a Gaussian of 0.2 standard deviations, which widens its contours by 2 %.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import gaussian_filter

from ...core.geometry.se3 import Array
from ...core.presentation.colours import BLUE, ORANGE
from ...core.presentation.ellipses import SIGMAS, SYMBOLS, display_unit
from ...core.presentation.figure_parts import NamedFigure, settle_layout
from .outcome import figure_of
from .posterior.result import Posterior

COLOUR, OVERLAY = BLUE, ORANGE
# Bins of a histogram along each axis.
BINS = 60


@figure_of.register
def corner(posterior: Posterior) -> Figure:
    """The six coordinates of X; raises `NotConvergedError` for a chain that has not converged."""
    x = posterior.samples
    reach = 4.0 * np.maximum(posterior.std, np.sqrt(np.diag(posterior.bound)))
    shift = posterior.mean
    units = [display_unit(float(value), "rad" if k < 3 else "m") for k, value in enumerate(reach)]
    scale = np.array([factor for factor, _ in units])
    x, low, high = x / scale, (shift - reach) / scale, (shift + reach) / scale
    bound = posterior.bound / scale[:, None] / scale

    figure = NamedFigure(figsize=(9.5, 9.8), layout="constrained")
    axes = figure.subplots(6, 6)
    for row in range(6):
        for column in range(6):
            axis = axes[row, column]
            if column > row:
                axis.set_axis_off()
                continue
            axis.set_xlim(low[column], high[column])
            if row == column:
                _marginal(axis, x[:, row], float(bound[row, row]), (low[row], high[row]))
            else:
                axis.set_ylim(low[row], high[row])
                ends = np.array([low[[column, row]], high[[column, row]]])
                _joint(axis, x[:, [column, row]], bound[np.ix_([column, row], [column, row])], ends)
            _frame(axis, f"${SYMBOLS[column]}$ ({units[column][1]})" if row == 5 else None, column == row)
            if column == 0 and row > 0:
                axis.set_ylabel(f"${SYMBOLS[row]}$ ({units[row][1]})", fontsize=9)
            elif column != row:
                axis.set_yticklabels([])
    _corner_legend(figure, posterior)
    settle_layout(figure)
    return figure


def _marginal(axis: Axes, x: Array, variance: float, ends: tuple[float, float]) -> None:
    axis.hist(x, BINS, range=ends, density=True, histtype="stepfilled", color=COLOUR, alpha=0.35)
    at = np.linspace(*ends, 201)
    axis.plot(at, np.exp(-0.5 * at**2 / variance) / np.sqrt(2 * np.pi * variance), "--", color=OVERLAY, linewidth=1.2)
    axis.set_yticks([])


def _joint(axis: Axes, x: Array, bound: Array, ends: Array) -> None:
    counts, across, along = np.histogram2d(x[:, 0], x[:, 1], BINS, ends.T)
    smooth = gaussian_filter(counts, 0.2 * BINS / 8.0)  # 0.2 of the 8 standard deviations that the axes show
    middle = [0.5 * (edges[1:] + edges[:-1]) for edges in (across, along)]
    axis.contourf(*middle, smooth.T, _thresholds(smooth), cmap="Blues", alpha=0.75, extend="max")
    axis.contour(*middle, smooth.T, _thresholds(smooth), colors=COLOUR, linewidths=0.9)
    angle = np.linspace(0, 2 * np.pi, 181)
    circle = np.linalg.cholesky(bound) @ np.stack([np.cos(angle), np.sin(angle)])
    for level in SIGMAS:
        axis.plot(*(level * circle), "--", color=OVERLAY, linewidth=0.9)


def _thresholds(density: Array) -> Array:
    """Densities, growing, above which lie 98.9 %, 86.5 % and 39.3 % of the total."""
    ordered = np.sort(density.ravel())[::-1]
    content = np.cumsum(ordered) / ordered.sum()
    wanted = 1 - np.exp(-0.5 * np.array(SIGMAS[::-1]) ** 2)
    return np.asarray(ordered[np.searchsorted(content, wanted)])


def _frame(axis: Axes, label: str | None, diagonal: bool) -> None:
    axis.set_box_aspect(1)
    axis.tick_params(labelsize=7, direction="in", top=True, right=not diagonal)
    axis.xaxis.set_major_locator(MaxNLocator(nbins=3, steps=[1, 2, 5, 10]))
    if not diagonal:
        axis.yaxis.set_major_locator(MaxNLocator(nbins=3, steps=[1, 2, 5, 10]))
    if label is None:
        axis.set_xticklabels([])
    else:
        axis.set_xlabel(label, fontsize=9)


def _corner_legend(figure: Figure, posterior: Posterior) -> None:
    contents = ", ".join(f"{100 * (1 - np.exp(-k * k / 2)):.1f} %" for k in SIGMAS)
    handles = [
        Patch(facecolor=COLOUR, alpha=0.4, edgecolor=COLOUR, label=f"samples; contours hold {contents}"),
        Line2D([], [], color=OVERLAY, linestyle="--", label="bound (ml): normal density; 1, 2, 3 $\\sigma$ ellipses"),
    ]
    figure.legend(
        handles=handles,
        loc="upper right",
        bbox_to_anchor=(0.98, 0.96),
        frameon=False,
        fontsize=9,
        title=(
            f"Posterior of {posterior.frame or 'X'}: errors about the ml estimate\n"
            f"{len(posterior.samples):,} samples, at least {posterior.diagnostics.ess_bulk[:6].min():,.0f} effective"
        ),
        title_fontsize=10,
        alignment="left",
    )
