"""Figure of a Monte Carlo run: quantiles of the errors of the trials against those that the covariance predicts.

The figure compares the quantiles of the distance ``d = sqrt(xi^T P^-1 xi)`` of the errors of all trials with those of
the chi distribution with 6 (joint) or 3 degrees of freedom (rotation, translation). The grey band holds the whole curve
of a consistent covariance with the confidence of the verdict: it is simultaneous over all quantiles, of equal local
level, that level found from simulated histograms (Aldor-Noiman et al., The American Statistician 67, 2013). Standard
deviations of the axes and shares in the ellipsoids, with their intervals, are in the tables.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import textwrap
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike
from scipy.special import gammaincinv
from scipy.stats import binom

from ...core.geometry.se3 import Array
from ...core.presentation.colours import BLUE, ORANGE
from ...core.presentation.figure_parts import NamedFigure
from .monte_carlo.consistency import Consistency, smaller_tail
from .monte_carlo.result import MonteCarlo, heading
from .monte_carlo.sums import ABOVE, BELOW, PARTS, SIZES, edges
from .monte_carlo.text import nees_number, percent, verdict
from .outcome import figure_of

COLOURS = ("black", ORANGE, BLUE)  # of the parts


@figure_of.register
def validation_figure(result: MonteCarlo) -> Figure:
    """Quantiles of the errors of a run, as a Matplotlib figure."""
    c = result.consistency
    # Per cent signs stay with their numbers.
    words = textwrap.wrap(verdict(c).replace(" %", "\N{NO-BREAK SPACE}%"), 195, break_on_hyphens=False)
    top = 0.8 + 0.145 * len(words)  # inches above the panels
    height, width = 3.4 if c.sums.count else 0.4, 10.8
    figure = NamedFigure(figsize=(width, height + top))

    def place(x: float, y: float, across: float, up: float) -> Axes:
        """Axes with their lower left corner at x, y, all in inches."""
        total = height + top
        return figure.add_axes((x / width, y / total, across / width, up / total))

    left = 0.15 / width
    figure.text(left, 1 - 0.12 / (height + top), heading(result), fontsize=10, fontweight="bold", va="top")
    figure.text(left, 1 - 0.36 / (height + top), "\n".join(words), fontsize=7.5, va="top", linespacing=1.3)
    if c.sums.count == 0:
        return figure
    for k in range(3):
        _quantiles(place(0.62 + 3.5 * k, 0.85, 2.95, 2.5), c, k)
    text = (
        "The distances d of the errors of all trials, sorted, against where they should lie. The grey band holds the "
        f"whole curve of a consistent covariance with {percent(c.confidence)}."
    )
    figure.text(left, 0.12 / (height + top), text, fontsize=6.5, va="bottom", color="0.3")
    return figure


def _quantiles(axis: Axes, c: Consistency, part: int) -> None:
    """Observed against expected quantiles of d of one part, with the band."""
    T, size = c.sums.count, SIZES[part]
    axis.set_title(PARTS[part], fontsize=8.5, fontweight="bold", color=COLOURS[part], loc="left", pad=13)
    if T < 10:  # too few for a curve
        return _empty(axis)
    observed = np.sqrt(edges(size))
    below = np.cumsum(c.sums.histogram[part])[:-1]
    low, high = band(T, c.confidence)
    left, right = (_expected(k, T, size) for k in (low, high))
    # Beyond its extremes a sample says nothing.
    inside = (below > 0) & (below < T)
    held = (high > 0) & (low < T)
    x = _expected(below, T, size)
    reach = float(max(_expected(np.array(T), T, size), observed[inside].max(initial=0.0))) * 1.04
    axis.fill_betweenx(observed[held], left[held], right[held], color="0.86", linewidth=0, zorder=1)
    axis.plot([0, reach], [0, reach], color="0.5", linewidth=0.7, zorder=2)
    axis.plot(x[inside], observed[inside], color=COLOURS[part], linewidth=1.6, zorder=4)
    last = 0.0
    for level in (0.5, 0.99, 0.9999, 0.999999):
        at = float(np.sqrt(2 * gammaincinv(size / 2, level)))
        if last + 0.16 * reach < at < 0.93 * reach and level < 1 - 0.3 / T:
            last = at
            axis.axvline(at, color="0.85", linewidth=0.6, zorder=0)
            axis.text(at, reach * 1.01, percent(level), fontsize=6, color="0.4", ha="center", va="bottom")
    axis.set_xlim(0, reach)
    axis.set_ylim(0, reach)
    _plain(axis)
    axis.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axis.yaxis.set_major_locator(MaxNLocator(6, integer=True))
    axis.set_xlabel(f"expected d (chi, {size} degrees of freedom)", fontsize=7.5, labelpad=1)
    if part == 0:
        axis.set_ylabel("observed d", fontsize=7.5, labelpad=2)
    assert c.mean_nees is not None and c.nees_interval is not None
    mean, low_mean, high_mean = (nees_number(x, c) for x in (c.mean_nees[part], *c.nees_interval[part]))
    axis.text(
        0.04,
        0.95,
        f"mean d$^2$ {mean}\nexpected {low_mean} to {high_mean}",
        transform=axis.transAxes,
        fontsize=7,
        va="top",
        linespacing=1.3,
    )


@lru_cache(maxsize=8)
def band(trials: int, confidence: float, draws: int = 1_000) -> tuple[Array, Array]:
    """Numbers of trials at or below each edge, lowest and highest (B,), that hold a true histogram everywhere.

    Simultaneously, with probability ``confidence``; at each edge alone with the same, higher probability, which follows
    from simulated histograms: 1,000 give the band to some 3 %.
    """
    rng = np.random.default_rng(102)
    cells = np.diff(np.concatenate([[0.0], BELOW]))
    upper = BELOW > 0.5  # differences of numbers near 1 lose the tail
    cells[upper] = -np.diff(np.concatenate([[1 - BELOW[~upper][-1]], ABOVE[upper]]))
    cells = np.append(cells, ABOVE[-1])
    k = np.cumsum(rng.multinomial(trials, cells / cells.sum(), draws), axis=1)[:, :-1]
    local = float(np.quantile(smaller_tail(k, trials, BELOW, ABOVE).min(axis=1), 1 - confidence))
    low, high = binom.ppf(local, trials, BELOW), trials - binom.ppf(local, trials, ABOVE)
    return np.clip(low, 0, trials), np.clip(high, 0, trials)


def _expected(below: ArrayLike, trials: int, size: int) -> Array:
    """Return the quantile of chi that ``below`` of the trials lie under."""
    p = (np.asarray(below) + 0.5) / (trials + 1)
    return np.asarray(np.sqrt(2 * gammaincinv(size / 2, p)))


def _empty(axis: Axes) -> None:
    axis.set_axis_off()
    axis.text(0.0, 0.9, "Not determined: too few trials.", transform=axis.transAxes, fontsize=7.5, va="top")


def _plain(axis: Axes) -> None:
    axis.tick_params(labelsize=6.8, direction="in", length=2.2, pad=2)
    for spine in axis.spines.values():
        spine.set_color("0.7")
