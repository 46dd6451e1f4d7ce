r"""Figure of a comparison of methods: which of them agree with the reference within their own ellipsoid.

One row per method and one panel per component of the difference ``xi = (theta, tau)`` from the reference (rotation
first; left rotation, additive translation), with bars of 1 and 2 standard deviations of the method itself. A method
differs where the reference lies outside its 95 % ellipsoid in all six components together: it is marked and named. A
value far outside the axis is an arrow at the rim, with its number.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import MaxNLocator

from ...core.geometry.se3 import Array
from ...core.presentation.colours import BLUE, ORANGE
from ...core.presentation.ellipses import SYMBOLS
from ...core.presentation.figure_parts import HALO, SMALL, Picture, canvas, finished, plain
from ...core.rounding import CHAIN_ROUNDING
from .compare import CHI2_95
from .result import Comparison, Row, digits

MINUS = "\N{MINUS SIGN}"
_RADIUS = float(np.sqrt(CHI2_95))


class _Scale(NamedTuple):
    low: Array  # (6,) limits of the components in rad and m
    high: Array
    factor: Array  # (6,) from rad and m to the units of the axes
    unit: tuple[str, str]


def comparison_picture(comparison: Comparison) -> Picture | None:
    """The figure, in the width of a page; None where no other method has a difference."""
    base = comparison.base
    others = [row for row in comparison.rows if row is not base]
    if base is None or not any(row.xi is not None and row.failure is None for row in others):
        return None
    alt = f"Differences of {len(others)} methods from {base.method} in the six components of X, with 1 and 2 sigma."
    caption = (
        f"Differences from {base.method}, one row per method; thick and thin bars are 1 and 2 standard deviations "
        "of the method itself. Orange diamonds: the method differs beyond its own 95 % ellipsoid. Triangles at the "
        "rim: farther away, with the value. Bars that do not reach zero in several panels deserve a look."
    )
    rows = [row for row in (base, *others) if row.xi is not None and row.failure is None]
    scale = _scale(rows)
    figure = canvas(0.9 + 2 * (0.17 * len(rows) + 0.55))
    grid: Any = figure.subplots(2, 3, sharey=True)
    for k, axis in enumerate([*grid[1], *grid[0]]):  # translation above, as everywhere else
        _column(axis, k, rows, scale)
        plain(axis)
        axis.grid(visible=False)
    names = [f"{row.method}, differs" if row.agrees is False else row.method for row in rows]
    for line in grid:
        line[0].set_yticks(range(len(rows)), labels=names, fontsize=SMALL)
        line[0].get_yticklabels()[0].set_fontweight("bold")
    return Picture(finished(figure), alt, caption)


def _ticks(axis: Axis, low: float, high: float) -> None:
    """Set at least two ticks if they fit: round numbers whose labels neither touch nor reach beyond the rim."""
    kept: list[tuple[float, str]] = []
    for bins in (3, 4, 5, 6, 8, 10):
        ticks = MaxNLocator(nbins=bins, steps=[1, 2, 5, 10]).tick_values(low, high)
        labels = [(float(tick), f"{tick:g}".replace("-", MINUS)) for tick in ticks]
        kept = [(x, text) for x, text in labels if min(x - low, high - x) > 0.02 * len(text) * (high - low)]
        if len(kept) >= 2:
            break
    if sum(len(text) for _, text in kept) > 14:
        kept = kept[::2]
    axis.set_ticks([x for x, _ in kept], labels=[text for _, text in kept])


def _scale(rows: Sequence[Row]) -> _Scale:
    """Limits that show most methods, the reference first; one scale for rotation and one for translation, unless a
    component needs less."""
    centres = np.array([row.xi for row in rows])
    spread = np.array([np.zeros(6) if row.std is None else row.std for row in rows])
    low, high, factors, units = np.zeros(6), np.zeros(6), np.zeros(6), []
    for group, least in zip((slice(0, 3), slice(3, 6)), (CHAIN_ROUNDING, CHAIN_ROUNDING), strict=True):
        position = np.abs(centres[:, group]).max(axis=1)
        extent = np.sort((position + 2 * spread[:, group].max(axis=1))[1:])
        typical = max(float(extent[(len(extent) - 1) // 2]), 2 * float(spread[0, group].max()))
        cap = max(3.0 * typical, least)
        for value in np.sort(position):  # no cut where there is no gap
            cap = float(value) if cap < value <= min(1.5 * cap, 3 * 3.0 * typical) else cap
        near = np.clip(centres[:, group], -cap, cap)[position <= cap]
        reach = np.minimum(_RADIUS * spread[:, group][position <= cap], 1.9 * typical)
        bottom = np.minimum((near - reach).min(axis=0, initial=0.0), 0.0)
        top = np.maximum((near + reach).max(axis=0, initial=0.0), 0.0)
        size = top - bottom
        widest = max(float(size.max()), least)
        size = np.where(size > widest / 5, widest, np.maximum(size, least))
        middle = 0.5 * (bottom + top)
        low[group], high[group] = middle - 0.56 * size, middle + 0.56 * size
        factor, unit = _unit(0.56 * widest, rotation=group.start == 0)
        factors[group] = factor
        units.append(unit)
    return _Scale(low, high, factors, (units[0], units[1]))


def _unit(reach: float, rotation: bool) -> tuple[float, str]:
    """Factor from rad or m to the unit in which ``reach`` is a handy number."""
    if rotation:
        reach = float(np.degrees(reach))
    names = ("deg", "mdeg", "µdeg") if rotation else ("m", "mm", "µm", "nm")
    least = 0.05 if rotation else 3.0
    k = 0
    while k < len(names) - 1 and reach * 1e3**k < (least if k == 0 else 0.05):
        k += 1
    return (180 / np.pi if rotation else 1.0) * 1e3**k, names[k]


def _column(axis: Axes, k: int, rows: Sequence[Row], scale: _Scale) -> None:
    """One component of all methods, the reference first: point and bars of 1 and 2 standard deviations."""
    low, high = float(scale.low[k] * scale.factor[k]), float(scale.high[k] * scale.factor[k])
    step = 1e-4 * (high - low)  # an iteration's last digits differ by the run

    def drawn(value: float) -> float:
        return step * round(float(value * scale.factor[k]) / step)

    axis.set_xlim(low, high)
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.axvline(0, color="0.6", linewidth=0.8, zorder=1)
    axis.axhspan(-0.5, 0.5, color="0.92", zorder=0, linewidth=0)
    for y, row in enumerate(rows):
        assert row.xi is not None
        colour, marker = (ORANGE, "D") if row.agrees is False else ("black" if y == 0 else BLUE, "o")
        if y:
            axis.axhline(y - 0.5, color="0.92", linewidth=0.6, zorder=0)
        x = drawn(row.xi[k])
        if not low <= x <= high:
            _beyond(axis, x, y, (low, high), colour)
            continue
        if row.std is not None:
            sigma = drawn(row.std[k])
            for level, width in ((2, 0.9), (1, 2.4)):
                ends = np.clip([x - level * sigma, x + level * sigma], 2 * low - high, 2 * high - low)
                axis.plot(ends, [y, y], color=colour, linewidth=width, solid_capstyle="butt", zorder=5)
        axis.plot(x, y, marker, color=colour, markersize=4.8, markeredgecolor="white", markeredgewidth=0.6, zorder=6)
    axis.set_yticks([])
    _ticks(axis.xaxis, low, high)
    axis.tick_params(labelsize=SMALL, direction="in", length=2.2, pad=2)
    axis.set_xlabel(f"${SYMBOLS[k]}$ ({scale.unit[k // 3]})", fontsize=SMALL, labelpad=1)
    for side in ("left", "right", "top"):
        axis.spines[side].set_color("0.8")
    if k % 3 == 1:
        axis.set_title(f"{('rotation', 'translation')[k // 3]} from that of {rows[0].method}", fontsize=7.8, pad=4)


def _beyond(axis: Axes, x: float, y: float, limits: tuple[float, float], colour: str) -> None:
    """An arrow at the rim and the value of what lies outside."""
    right = x > limits[1]
    edge, other = limits[::-1] if right else limits
    inward = 0.02 * (other - edge)
    axis.plot(edge + 1.2 * inward, y, ">" if right else "<", color=colour, markersize=4.5, markeredgewidth=0, zorder=5)
    axis.text(
        edge + 4.5 * inward,
        y,
        ("+" if x > 0 else MINUS) + digits(abs(x)).replace("-", MINUS),
        ha="right" if right else "left",
        va="center",
        fontsize=SMALL,
        color=colour,
        path_effects=HALO,
        zorder=5,
    )
