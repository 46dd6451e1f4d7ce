"""A Monte Carlo run as a figure: whether the errors of the trials follow the covariance, seen at a glance.

Quantiles of the distance ``d = sqrt(xi^T P^-1 xi)`` of the errors of all trials against those of the chi distribution
with 6 (joint) or 3 degrees of freedom (rotation, translation). The grey band holds the whole curve of a consistent
covariance with the confidence of the verdict: it is simultaneous over all quantiles, of equal local level, that level
found from `DRAWS` simulated histograms (Aldor-Noiman et al., The American Statistician 67, 2013). Standard deviations
of the axes and shares in the ellipsoids, with their intervals, are in the tables.

This module imports Matplotlib; import it where it is used.

A sweep over the noise as a figure: the mean NEES of each method against the noise, first order and sigma points.

One panel per method, both axes logarithmic, the noise in multiples of its standard deviations. A consistent covariance
stays at 6. The dark band is chance (99 %, chi-square), the light one errors that are as predicted within the tolerance.
Dotted: where a covariance begins to fail, with ~ where tails are heavy. White markers: levels at which it fails, by the
NEES or by what its 95 % ellipsoid holds.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import math
import textwrap
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from scipy.special import gammaincinv
from scipy.stats import binom

from ...core.formatting.numbers import digits, rough
from ...core.geometry.se3 import Array
from ...core.presentation.figure_parts import HALO, NamedFigure
from .monte_carlo.consistency import Consistency, smaller_tail
from .monte_carlo.result import MonteCarlo, heading
from .monte_carlo.sums import ABOVE, BELOW, PARTS, SIZES, edges
from .monte_carlo.text import nees_number, percent, verdict
from .outcome import figure_of
from .sweep.level import KINDS, Limit, MethodSweep
from .sweep.run import Sweep

DRAWS = 1_000  # of histograms: the local level to about a third of itself, the band to some 3 %
COLOURS = ("black", "#D55E00", "#0072B2")  # of the parts, after Okabe and Ito
_WIDTH = 10.8
_BAND = "0.86"
_FEWEST = 10  # trials that make a curve
_SHOWN = (0.5, 0.99, 0.9999, 0.999999)  # quantiles marked in the upper panels


@figure_of.register
def validation_figure(result: MonteCarlo) -> Figure:
    """Quantiles of the errors of a run, as a Matplotlib figure."""
    c = result.consistency
    # Per cent signs stay with their numbers.
    words = textwrap.wrap(verdict(c).replace(" %", "\N{NO-BREAK SPACE}%"), 195, break_on_hyphens=False)
    top = 0.8 + 0.145 * len(words)  # inches above the panels
    height = 3.4 if c.sums.count else 0.4
    figure = NamedFigure(figsize=(_WIDTH, height + top))

    def place(x: float, y: float, across: float, up: float) -> Axes:
        """Axes with their lower left corner at x, y, all in inches."""
        total = height + top
        return figure.add_axes((x / _WIDTH, y / total, across / _WIDTH, up / total))

    left = 0.15 / _WIDTH
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
    if T < _FEWEST:
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
    axis.fill_betweenx(observed[held], left[held], right[held], color=_BAND, linewidth=0, zorder=1)
    axis.plot([0, reach], [0, reach], color="0.5", linewidth=0.7, zorder=2)
    axis.plot(x[inside], observed[inside], color=COLOURS[part], linewidth=1.6, zorder=4)
    last = 0.0
    for level in _SHOWN:
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
def band(trials: int, confidence: float) -> tuple[Array, Array]:
    """Numbers of trials at or below each edge, lowest and highest (B,), that hold a true histogram everywhere.

    Simultaneously, with probability ``confidence``; at each edge alone with the same, higher probability.
    """
    rng = np.random.default_rng(102)
    cells = np.diff(np.concatenate([[0.0], BELOW]))
    upper = BELOW > 0.5  # differences of numbers near 1 lose the tail
    cells[upper] = -np.diff(np.concatenate([[1 - BELOW[~upper][-1]], ABOVE[upper]]))
    cells = np.append(cells, ABOVE[-1])
    k = np.cumsum(rng.multinomial(trials, cells / cells.sum(), DRAWS), axis=1)[:, :-1]
    local = float(np.quantile(smaller_tail(k, trials, BELOW, ABOVE).min(axis=1), 1 - confidence))
    low, high = binom.ppf(local, trials, BELOW), trials - binom.ppf(local, trials, ABOVE)
    return np.clip(low, 0, trials), np.clip(high, 0, trials)


def _expected(below: Any, trials: int, size: int) -> Array:
    """The quantile of chi at which so many of the trials lie below."""
    p = (np.asarray(below) + 0.5) / (trials + 1)
    return np.asarray(np.sqrt(2 * gammaincinv(size / 2, p)))


def _empty(axis: Axes) -> None:
    axis.set_axis_off()
    axis.text(0.0, 0.9, "Not determined: too few trials.", transform=axis.transAxes, fontsize=7.5, va="top")


def _plain(axis: Axes) -> None:
    axis.tick_params(labelsize=6.8, direction="in", length=2.2, pad=2)
    for spine in axis.spines.values():
        spine.set_color("0.7")


# Colours of Okabe and Ito, lines and markers apart in greyscale too.
STYLES: dict[str, tuple[str, Any, str]] = {KINDS[0]: ("#D55E00", "-", "o"), KINDS[1]: ("#0072B2", (0, (4, 1.5)), "s")}
COLUMNS = 3
_PANEL_WIDTH, _PANEL_HEIGHT = 3.6, 3.0  # inches of a panel


@figure_of.register
def sweep_figure(result: Sweep) -> Figure:
    """The figure, as Matplotlib has it."""
    columns = min(COLUMNS, len(result.methods))
    rows = -(-len(result.methods) // columns)
    # a single panel is made wider, for the words above and below
    width = max(columns * _PANEL_WIDTH, 5.2) + 0.3
    footer = textwrap.wrap(_footer(result), int(18 * width))
    more = 0.12 * (len(footer) - 1)
    height = rows * _PANEL_HEIGHT + 0.95 + more
    drawn = NamedFigure(figsize=(width, height))
    axes = drawn.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    drawn.subplots_adjust(
        left=0.7 / width,
        right=1 - 0.12 / width,
        bottom=(0.62 + more) / height,
        top=1 - 0.72 / height,
        wspace=0.08,
        hspace=0.22,
    )
    low, high = _range(result)
    for axis, found in zip(axes.flat, result.methods, strict=False):
        _panel(axis, result, found, (low, high))
    for axis in axes.flat[len(result.methods) :]:
        axis.set_axis_off()
    for axis in axes[:, 0]:
        axis.set_ylabel("mean NEES, joint (6 if consistent)", fontsize=8)
    for k in range(columns):
        lowest = min(rows - 1, (len(result.methods) - 1 - k) // columns)
        axes[lowest, k].set_xlabel("noise, in your standard deviations", fontsize=8)
        axes[lowest, k].tick_params(labelbottom=True)
    drawn.text(
        0.12 / width,
        1 - 0.1 / height,
        f"Where first order ends: {result.frame} of {result.count} {result.item}",
        fontsize=10,
        fontweight="bold",
        va="top",
    )
    handles, labels = axes.flat[0].get_legend_handles_labels()
    drawn.legend(
        handles,
        labels,
        loc="upper left",
        bbox_to_anchor=(0.06 / width, 1 - 0.25 / height),
        ncols=len(labels),
        fontsize=7,
        frameon=False,
        handlelength=2.4,
        columnspacing=1.2,
    )
    drawn.text(0.12 / width, 0.08 / height, "\n".join(footer), fontsize=6.5, color="0.3", va="bottom")
    return drawn


def _footer(result: Sweep) -> str:
    """Explain the marks in the figure."""
    limits = [found.limit(kind) for found in result.methods for kind in KINDS]
    text = f"{result.trials:,} trials per level; all levels share their draws."
    failing = (not level.of(kind).holds for found in result.methods for level in found.levels for kind in KINDS)
    if any(failing):
        text += " White: fails, by NEES or by its 95 % ellipsoid."
    if any(limit.fails is not None for limit in limits):
        text += " Dotted: from here on."
    if any(limit.heavy for limit in limits):
        text += " ~: heavy tails, beyond it is chance which levels pass."
    return text


def _range(result: Sweep) -> tuple[float, float]:
    """Limits of the NEES: all values, and never less than the band of the tolerance with some room."""
    edge = 6 * (1 + result.tolerance) ** 2
    values = [edge * 1.3, 36 / edge / 1.3]
    for found in result.methods:
        for level in found.levels:
            values += [float(t.mean_nees[0]) for t in map(level.of, KINDS) if t.mean_nees is not None]
    low, high = max(min(values), 1e-3), max(values)
    room = (high / low) ** 0.06
    return low / room, high * room


def _panel(axis: Axes, result: Sweep, found: MethodSweep, nees: tuple[float, float]) -> None:
    axis.set_xscale("log")
    axis.set_yscale("log")
    matters = (1 + result.tolerance) ** 2
    axis.axhspan(6 / matters, 6 * matters, color="0.93", linewidth=0, zorder=0, label=_tolerance(result))
    intervals = (level.first_order.nees_interval for level in found.levels)
    if (interval := next((known for known in intervals if known is not None), None)) is not None:
        axis.axhspan(*interval[0], color="0.8", linewidth=0, zorder=1, label="chance")
    axis.axvline(1.0, color="black", linewidth=1.0, zorder=2)
    axis.annotate(
        "your noise",
        (1.0, 0.985),
        xycoords=("data", "axes fraction"),
        xytext=(3, 0),
        textcoords="offset points",
        va="top",
        fontsize=7,
    )
    for kind, (colour, line, marker) in STYLES.items():
        known = [(level.deviations, level.of(kind)) for level in found.levels if level.of(kind).mean_nees is not None]
        x = np.array([deviations for deviations, _ in known])
        y = np.array([0.0 if tested.mean_nees is None else tested.mean_nees[0] for _, tested in known])
        holds = np.array([tested.holds for _, tested in known], dtype=bool)
        axis.plot(x, y, color=colour, linestyle=line, linewidth=1.4, zorder=4, marker=marker, markersize=0, label=kind)
        for which, face in ((holds, colour), (~holds, "white")):
            axis.plot(
                x[which],
                y[which],
                linestyle="",
                marker=marker,
                markersize=5.4 if marker == "o" else 3.2,
                markerfacecolor=face,
                markeredgecolor=colour,
                markeredgewidth=1.0,
                zorder=5,
            )
        _mark(axis, found.limit(kind), colour, 0.80 if kind == KINDS[0] else 0.68)
    axis.set_title(found.method, fontsize=8.5, loc="left", pad=3)
    axis.set_ylim(*nees)
    deviations = found.levels[0].deviations, found.levels[-1].deviations
    for one, (low, high) in ((axis.xaxis, deviations), (axis.yaxis, nees)):
        one.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 200 * low else (1.0,)))
        one.set_major_formatter(FuncFormatter(_tick))
        one.set_minor_formatter(NullFormatter())
    axis.tick_params(labelsize=7)
    axis.grid(True, which="major", color="0.9", linewidth=0.5, zorder=0)


def _tick(value: float, _: Any) -> str:
    return f"{value:g}" if value < 1e4 else f"$10^{{{math.log10(value):.0f}}}$"


def _mark(axis: Axes, limit: Limit, colour: str, height: float) -> None:
    """Mark where a covariance begins to fail."""
    if limit.fails is None:
        return
    x = math.sqrt(limit.fails if limit.holds is None else math.sqrt(limit.holds * limit.fails))
    axis.axvline(x, color=colour, linestyle=":", linewidth=1.0, zorder=3)
    axis.annotate(
        f"{'<' if limit.holds is None else ''}{'~' + rough(x) if limit.heavy else digits(x, 2)}",
        (x, height),
        xycoords=("data", "axes fraction"),
        xytext=(-3, 0),
        textcoords="offset points",
        ha="right",
        fontsize=7,
        color=colour,
        path_effects=HALO,
        zorder=6,
    )


def _tolerance(result: Sweep) -> str:
    return f"errors as predicted within {100 * result.tolerance:g} %"
