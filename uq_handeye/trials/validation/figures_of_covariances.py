"""A cross-check as a figure: the ellipses of all covariances in the 15 pairs of components, as Fig. 5 of the paper.

Model: the error ``xi = (theta, tau)`` of X is Gaussian with mean zero and each of the covariances; its projection onto
two components has the ellipse

    2 (s_i cos t,  s_j (rho cos t + sqrt(1 - rho^2) sin t)),   0 <= t < 2 pi

of 2 standard deviations, which holds 86.5 % (`ellipses`). All are drawn about 0, the posterior too, so that sizes and
directions can be compared. Columns: rotation against rotation, translation against translation, and three with rotation
against translation, which the paper does not show.

Curves that must coincide are drawn one upon the other: a broad pale one below, a thin dark one above. All differ in
line style and lightness, not in colour only. This module imports Matplotlib; import it where it is used.

The corner plot of a posterior: each coordinate, and the density of each pair, beside the Gaussian of the bound.

On the diagonal the histogram of the samples and the normal density of the `ml` covariance; below it the smoothed
density of two coordinates, with contours that hold 39.3 %, 86.5 % and 98.9 % of the samples (what the 1, 2 and 3 sigma
ellipses of two dimensions hold), and those ellipses of the `ml` covariance. The origin is the `ml` estimate.

The density is a histogram smoothed by a Gaussian of 0.2 standard deviations, which widens its contours by 2 %.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import gaussian_filter

from ...core.geometry.se3 import Array
from ...core.presentation.ellipses import LEVELS, SYMBOLS, display_unit, limited
from ...core.presentation.figure_parts import NamedFigure, settle_layout
from .cross_check.run import CrossCheck
from .outcome import figure_of
from .posterior.result import Posterior

DRAWN = 2
POINTS = 2000
PAIRS = ((0, 1), (0, 2), (1, 2))


class _Curve(NamedTuple):
    keys: tuple[str, ...]  # the first of these rows that there is
    label: str
    colour: str
    line: Any
    width: float
    order: int


_DOT = _Curve(("4dpa-literal",), "4DPA, (45) as printed", "#C7006E", "-", 1.0, 9)
# Colours of Okabe and Ito. Pale and broad below what must lie on it.
_CURVES = (
    _Curve(("4dpa-sampled",), "4DPA, Monte Carlo", "#BFE0F5", "-", 5.0, 3),
    _Curve(("4dpa-poses", "4dpa-pairs"), "4DPA, first order", "black", "-", 0.9, 6),
    _Curve(("nguyen-own",), "Nguyen and Pham, own", "#0072B2", (0, (5, 1.5, 1, 1.5)), 1.3, 7),
    _Curve(("bound",), "bound (efficient, ml)", "#E69F00", "-", 3.2, 4),
    _Curve(("posterior",), "posterior", "#5A1E00", (0, (1.2, 1.0)), 1.3, 8),
    _DOT,
)


@figure_of.register
def cross_check_figure(check: CrossCheck) -> Figure:
    """Ellipses of 2 standard deviations in 3 x 5 panels, with up to 2,000 errors of the trials of 4DPA."""
    known = {row.key: row.covariance for row in check.rows if row.covariance is not None}
    drawn = []
    for curve in _CURVES:
        if keys := [key for key in curve.keys if key in known]:
            drawn.append((curve, known[keys[0]]))
    points = check.runs["4dpa"].errors[:POINTS] if "4dpa" in check.runs else np.empty((0, 6))

    reach = _reach([S for _, S in drawn], points)
    units = [display_unit(value, "rad" if k < 3 else "m") for k, value in enumerate(reach)]
    scale = np.array([factor for factor, _ in units])
    figure = NamedFigure(figsize=(10.6, 7.3), layout="constrained")
    grid: Any = figure.subplots(3, 5)
    for column, title in ((0, "Rotation"), (1, "Translation"), (3, "Rotation against translation")):
        grid[0, column].set_title(title, fontsize=9.5, pad=8)
    panels: list[tuple[Axes, int, int]] = []
    for first, column in ((0, 0), (3, 1)):
        panels += [(grid[row, column], first + i, first + j) for row, (i, j) in enumerate(PAIRS)]
    panels += [(grid[row, 2 + column], column, 3 + row) for row in range(3) for column in range(3)]
    for axis, i, j in panels:
        _panel(axis, i, j, drawn, points, scale)
        limited(axis, (reach[i] / scale[i], reach[j] / scale[j]))
        axis.tick_params(labelsize=7)
        axis.set_xlabel(f"${SYMBOLS[i]}$ ({units[i][1]})", fontsize=8, labelpad=1)
        axis.set_ylabel(f"${SYMBOLS[j]}$ ({units[j][1]})", fontsize=8, labelpad=1)
    _ellipse_legend(figure, check, [curve for curve, _ in drawn], len(points))
    settle_layout(figure)
    return figure


def _reach(covariances: list[Array], points: Array) -> Array:
    """Half the range (6,) of each axis, the same for the three rotations and for the three translations."""
    rows = [DRAWN * np.sqrt(np.diag(S)) for S in covariances]
    if len(points):
        rows.append(2.6 * points.std(axis=0))
    largest = np.max(rows, axis=0) if rows else np.full(6, 1e-6)
    return 1.1 * np.repeat([largest[:3].max(), largest[3:].max()], 3)


def _panel(axis: Axes, i: int, j: int, drawn: list[tuple[_Curve, Array]], points: Array, scale: Array) -> None:
    """Sampled errors and ellipses of one pair of components."""
    if len(points):
        x, y = (points[:, [i, j]] / scale[[i, j]]).T
        axis.plot(x, y, ".", color="0.8", markersize=1.4, markeredgewidth=0, rasterized=True, zorder=1)
    axis.axhline(0, color="0.88", linewidth=0.6, zorder=0)
    axis.axvline(0, color="0.88", linewidth=0.6, zorder=0)
    for curve, S in drawn:
        x, y = ellipse(S, i, j) / scale[[i, j]][:, None]
        axis.plot(x, y, color=curve.colour, linestyle=curve.line, linewidth=curve.width, zorder=curve.order)
        if curve is _DOT:
            axis.fill(x, y, color=curve.colour, linewidth=0, zorder=curve.order)


def ellipse(S: Array, i: int, j: int) -> Array:
    """Points (2, 181) of the ellipse of `DRAWN` standard deviations of components i and j."""
    angle = np.linspace(0, 2 * np.pi, 181)
    s = np.sqrt(np.diag(S))[[i, j]]
    rho = float(np.clip(S[i, j] / (s[0] * s[1]), -1, 1)) if s.all() else 0.0
    return DRAWN * np.stack([s[0] * np.cos(angle), s[1] * (rho * np.cos(angle) + np.sqrt(1 - rho**2) * np.sin(angle))])


def _ellipse_legend(figure: Figure, check: CrossCheck, curves: list[_Curve], points: int) -> None:
    handles = [
        Line2D([], [], color=curve.colour, linestyle=curve.line, linewidth=curve.width, label=curve.label)
        for curve in curves
        if curve is not _DOT
    ]
    if _DOT in curves:  # smaller than its line is wide
        handles.append(Line2D([], [], marker="o", linestyle="", color=_DOT.colour, markersize=3.5, label=_DOT.label))
    if points:
        label = f"{points:,} trials of 4DPA"
        handles.append(Line2D([], [], marker=".", linestyle="", color="0.7", markersize=5, label=label))
    held = 100 * (1 - np.exp(-(DRAWN**2) / 2))
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=4,
        frameon=False,
        fontsize=8.5,
        handlelength=3,
        title=f"{check.frame}: ellipses of {DRAWN} standard deviations, which hold {held:.1f} % of the probability",
        title_fontproperties={"size": 8.5},
    )


BINS = 60
REACH = 4.0  # standard deviations to either side
SMOOTHING = 0.2  # standard deviations
COLOUR, OVERLAY = "#0072B2", "#D55E00"


@figure_of.register
def corner(posterior: Posterior) -> Figure:
    """The six coordinates of X; raises `NotConvergedError` for a chain that has not converged."""
    x = posterior.samples
    reach = REACH * np.maximum(posterior.std, np.sqrt(np.diag(posterior.bound)))
    shift = posterior.mean
    units = [display_unit(float(value), "rad" if k < 3 else "m") for k, value in enumerate(reach)]
    scale = np.array([factor for factor, _ in units])
    x, low, high = x / scale, (shift - reach) / scale, (shift + reach) / scale
    bound = posterior.bound / scale[:, None] / scale

    figure = NamedFigure(figsize=(9.5, 9.8), layout="constrained")
    axes: Any = figure.subplots(6, 6)
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
    smooth = gaussian_filter(counts, SMOOTHING * BINS / (2 * REACH))
    middle = [0.5 * (edges[1:] + edges[:-1]) for edges in (across, along)]
    axis.contourf(*middle, smooth.T, _thresholds(smooth), cmap="Blues", alpha=0.75, extend="max")
    axis.contour(*middle, smooth.T, _thresholds(smooth), colors=COLOUR, linewidths=0.9)
    angle = np.linspace(0, 2 * np.pi, 181)
    circle = np.linalg.cholesky(bound) @ np.stack([np.cos(angle), np.sin(angle)])
    for level in LEVELS:
        axis.plot(*(level * circle), "--", color=OVERLAY, linewidth=0.9)


def _thresholds(density: Array) -> Array:
    """Densities, growing, above which lie 98.9 %, 86.5 % and 39.3 % of the total."""
    ordered = np.sort(density.ravel())[::-1]
    content = np.cumsum(ordered) / ordered.sum()
    wanted = 1 - np.exp(-0.5 * np.array(LEVELS[::-1]) ** 2)
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
    contents = ", ".join(f"{100 * (1 - np.exp(-k * k / 2)):.1f} %" for k in LEVELS)
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
