r"""A comparison of methods as a figure: who agrees with the reference within the own ellipsoid, seen at a glance.

Above, one row per method and one column per component of the difference ``xi = (theta, tau)`` from the reference, with
bars of 1 and 2 standard deviations of the method itself, and the verdict in words. Below, the same in pairs of
components: the shadow of each method's 95 % ellipsoid in six dimensions,

    xi + sqrt(12.59) (s_i cos t,  s_j (rho cos t + sqrt(1 - rho^2) sin t)),   0 <= t < 2 pi

so that a method agrees only if its ellipse holds the reference, which is the origin, in every panel. Methods that agree
share one quiet colour; each that differs, and each without a verdict, has a colour, line style and marker of its own,
the same in its row and in the panels. What lies far outside is marked by an arrow at the rim.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import io
import textwrap
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core.geometry.se3 import Array
from ...core.presentation.ellipses import PAIRS_WITHIN, SYMBOLS, ellipse, render
from ...core.presentation.figure_parts import BLUE, HALO, ORANGE, SMALL, Picture, canvas, finished, plain
from .compare import CHI2_95
from .result import Comparison, apart, digits, without_numbers
from .text import notes

MINUS = "\N{MINUS SIGN}"
# Colours of Okabe and Ito for the methods that differ; line styles and markers of other periods keep all of them apart.
COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
LINES: tuple[Any, ...] = ("-", "--", (0, (1, 1)), "-.", (0, (6, 1.5, 1, 1.5, 1, 1.5)))
MARKERS = ("s", "^", "D", "v", "P", "X", "h")
QUIET = "#7C8A97"  # methods that agree
WARNING = "#B3001B"
INK = {
    "#009E73": "#00795A",
    "#CC79A7": "#A3497B",
    "#E69F00": "#996A00",
    "#56B4E9": "#1A78AE",
    QUIET: "0.25",
}

# Differences beyond so many typical ones are left outside, as arrows.
FAR = 3.0
# Ellipses reaching beyond so many typical differences with their two standard deviations are cut off.
WIDE = 1.9
# Half a panel is never less than this (rad, m): differences below are rounding.
LEAST = (1e-9, 1e-9)
# What the panels show beyond the columns, as a part of their range.
ROOM = 0.12
_RADIUS = float(np.sqrt(CHI2_95))


class _Style(NamedTuple):
    colour: str
    line: Any
    marker: str
    width: float
    order: int
    hollow: bool = False


class _Scale(NamedTuple):
    low: Array  # (6,) limits of the components in rad and m
    high: Array
    factor: Array  # (6,) from rad and m to the units of the axes
    unit: tuple[str, str]


def comparison_figure(comparison: Comparison) -> Figure:
    """The differences of all methods from the reference, with their standard deviations, as a Matplotlib figure."""
    rows = comparison.rows
    styles = _styles(comparison)
    scale = _scale(comparison)
    above = 0.215 * len(rows)  # inches of the rows
    remarks, colour = _remarks(comparison)
    top, middle, below, bottom = 0.95 if remarks else 0.78, 0.62, 1.3, 0.74
    width, height = 10.8, top + above + middle + below + bottom
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)

    def place(x: float, y: float, across: float, up: float) -> Axes:
        """Axes with their lower left corner at x, y, all in inches."""
        return figure.add_axes((x / width, y / height, across / width, up / height))

    x = 0.15 / width
    title = f"{comparison.frame}: {len(rows)} methods on the same {comparison.origin}"
    figure.text(x, 1 - 0.12 / height, title, fontsize=10, fontweight="bold", va="top")
    figure.text(x, 1 - 0.34 / height, _short(comparison.verdict, 190), fontsize=7.5, va="top")
    figure.text(x, 1 - 0.51 / height, _short(remarks, 205), fontsize=7, va="top", color=colour)
    if comparison.reference is None:
        _failures(place(0.84, bottom, width - 1.0, middle + below + above), comparison)
        return figure
    forest = [place(0.84 + 1.34 * k + (0.2 if k >= 3 else 0.0), bottom + below + middle, 1.24, above) for k in range(6)]
    for k, axis in enumerate(forest):
        _column(axis, k, comparison, styles, scale)
    for y, row in enumerate(rows):
        forest[0].text(
            -0.06,
            y,
            row.method,
            transform=forest[0].get_yaxis_transform(),
            ha="right",
            va="center",
            fontsize=7.5,
            fontweight="bold" if row.method == comparison.reference else "normal",
            color=_ink(styles[row.method]),
        )
    _verdicts(forest[5], comparison, styles)
    for k, (i, j) in enumerate([*PAIRS_WITHIN, *((i + 3, j + 3) for i, j in PAIRS_WITHIN)]):
        panel = place(0.52 + 1.72 * k + (0.06 if k >= 3 else 0.0), bottom, below, below)
        _projection(panel, i, j, comparison, styles, scale)
    _explanation(figure, comparison, width, height)
    return figure


def methods_picture(comparison: Comparison) -> Picture | None:
    """The columns alone, in the width of a page, for a report; None where no other method has a difference."""
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
    shown = replace(comparison, rows=tuple(rows))
    styles = {
        row.method: _Style("black" if row is base else BLUE, "-", "o", 1.0, 5)
        if row.agrees is not False
        else _Style(ORANGE, "-", "D", 1.0, 5)
        for row in rows
    }
    figure = canvas(0.9 + 2 * (0.17 * len(rows) + 0.55))
    grid: Any = figure.subplots(2, 3, sharey=True)
    for k, axis in enumerate([*grid[1], *grid[0]]):  # translation above, as everywhere else
        _column(axis, k, shown, styles, _scale(shown), SMALL)
        plain(axis)
        axis.grid(visible=False)
    names = [f"{row.method}, differs" if row.agrees is False else row.method for row in rows]
    for line in grid:
        line[0].set_yticks(range(len(rows)), labels=names, fontsize=SMALL)
        line[0].get_yticklabels()[0].set_fontweight("bold")
    return Picture(finished(figure), alt, caption)


def png(figure: Figure) -> bytes:
    """The figure as a PNG of 256 colours, which is a third of the size and looks the same."""
    from PIL import Image  # comes with Matplotlib

    image = Image.open(io.BytesIO(render(figure, "png"))).convert("RGB")
    buffer = io.BytesIO()
    image.quantize(256, dither=Image.Dither.NONE).save(buffer, "png", optimize=True)
    return buffer.getvalue()


def _remarks(comparison: Comparison) -> tuple[str, str]:
    """Return the cautions about a comparison, and their colour."""
    remarks = notes(comparison, of_pairs=False)  # the title has the pairs
    if not comparison.warnings:
        return " ".join(remarks), "0.35"
    count = len(comparison.warnings)
    return " ".join([f"CAUTION, {count} warning{'s'[: count != 1]}: {comparison.warnings[0]}", *remarks]), WARNING


def _failures(axis: Axes, comparison: Comparison) -> None:
    """Write why every method failed, where there is nothing to draw."""
    axis.set_axis_off()
    axis.set_yticks([])
    count = len(comparison.rows)
    axis.set_ylim(count - 0.5, -0.5)
    first: dict[str, str] = {}
    for y, row in enumerate(comparison.rows):
        axis.text(-0.01, y, row.method, transform=axis.get_yaxis_transform(), ha="right", va="center", fontsize=7.5)
        like = first.setdefault(without_numbers(str(row.failure)), row.method)
        reason = f"{row.status}: {row.failure if like == row.method else f'like {like}'}"
        text = "\n".join(textwrap.wrap(_short(reason, 380), 190, break_on_hyphens=False))
        axis.text(0.0, y, text, transform=axis.get_yaxis_transform(), va="center", fontsize=6.3, color=WARNING)


def _ticks(axis: Any, low: float, high: float) -> None:
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


def _styles(comparison: Comparison) -> dict[str, _Style]:
    """Return the style in which each method is drawn."""
    styles: dict[str, _Style] = {}
    different = 0
    for row in comparison.rows:
        if row.method == comparison.reference:
            styles[row.method] = _Style("black", "-", "o", 1.6, 9)
        elif row.failure is not None:
            styles[row.method] = _Style("0.45", "-", "o", 0.7, 2, hollow=True)
        elif row.agrees:
            styles[row.method] = _Style(QUIET, "-", "o", 0.8, 3)
        else:
            k = different
            styles[row.method] = _Style(
                COLOURS[k % len(COLOURS)], LINES[k % len(LINES)], MARKERS[k % len(MARKERS)], 1.1, 5
            )
            different += 1
    return styles


def _ink(style: _Style) -> str:
    """A colour for text: as the lines, but dark enough to read."""
    return INK.get(style.colour, style.colour)


def _scale(comparison: Comparison) -> _Scale:
    """Limits that show most methods; rotation and translation have one scale each unless a component needs less."""
    drawn = [row for row in comparison.rows if row.xi is not None and row.status != "undetermined"]
    centres = np.array([row.xi for row in drawn]).reshape(-1, 6)
    known = [None if row.failure is not None else row.std for row in drawn]
    spread = np.array([np.zeros(6) if std is None else std for std in known]).reshape(-1, 6)
    others = np.array([row.method != comparison.reference for row in drawn], dtype=bool)
    low, high, factors, units = np.zeros(6), np.zeros(6), np.zeros(6), []
    for group, least in zip((slice(0, 3), slice(3, 6)), LEAST, strict=True):
        position = np.abs(centres[:, group]).max(axis=1, initial=0.0)
        extent = np.sort((position + 2 * spread[:, group].max(axis=1, initial=0.0))[others])
        typical = extent[(len(extent) - 1) // 2] if extent.size else 0.0
        if not others.all():
            typical = max(typical, 2 * float(spread[~others, group].max(initial=0.0)))
        cap = max(FAR * typical, least)
        for value in np.sort(position):  # no cut where there is no gap
            cap = float(value) if cap < value <= min(1.5 * cap, 3 * FAR * typical) else cap
        near = np.clip(centres[:, group], -cap, cap)[position <= cap]
        reach = np.minimum(_RADIUS * spread[:, group][position <= cap], WIDE * typical)
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


def _label(k: int, scale: _Scale) -> str:
    return f"${SYMBOLS[k]}$ ({scale.unit[k // 3]})"


def _limits(k: int, scale: _Scale) -> tuple[float, float]:
    return float(scale.low[k] * scale.factor[k]), float(scale.high[k] * scale.factor[k])


def _column(
    axis: Axes, k: int, comparison: Comparison, styles: dict[str, _Style], scale: _Scale, size: float = 6.3
) -> None:
    """One component of all methods: point and bars of 1 and 2 standard deviations; text of a size in points."""
    count = len(comparison.rows)
    low, high = _limits(k, scale)
    step = 1e-4 * (high - low) if size == SMALL else 0.0  # of a page: an iteration's last digits differ by the run

    def drawn(value: float) -> float:
        value = float(value * scale.factor[k])
        return step * round(value / step) if step else value

    axis.set_xlim(low, high)
    axis.set_ylim(count - 0.5, -0.5)
    axis.axvline(0, color="0.6", linewidth=0.8, zorder=1)
    for y, row in enumerate(comparison.rows):
        if row.method == comparison.reference:
            axis.axhspan(y - 0.5, y + 0.5, color="0.92", zorder=0, linewidth=0)
        if y:
            axis.axhline(y - 0.5, color="0.92", linewidth=0.6, zorder=0)
        if row.xi is None:
            continue
        style = styles[row.method]
        x = drawn(row.xi[k])
        if not low <= x <= high:
            _beyond(axis, x, y, low, high, style, size)
            continue
        if row.std is not None and row.failure is None:
            sigma = drawn(row.std[k])
            for level, width in ((2, 0.9), (1, 2.4)):
                ends = np.clip([x - level * sigma, x + level * sigma], 2 * low - high, 2 * high - low)
                axis.plot(ends, [y, y], color=style.colour, linewidth=width, solid_capstyle="butt", zorder=style.order)
        axis.plot(x, y, **_marker(style, 4.8), zorder=style.order + 0.5)
    axis.set_yticks([])
    _ticks(axis.xaxis, low, high)
    axis.tick_params(labelsize=size, direction="in", length=2.2, pad=2)
    axis.set_xlabel(_label(k, scale), fontsize=max(size, 7.5), labelpad=1)
    for side in ("left", "right", "top"):
        axis.spines[side].set_color("0.8")
    if k % 3 == 1:
        axis.set_title(
            ("rotation", "translation")[k // 3] + f" from that of {comparison.reference}",
            fontsize=max(size, 7.8),
            pad=4,
        )


def _marker(style: _Style, size: float) -> dict[str, Any]:
    return {
        "marker": style.marker,
        "linestyle": "",
        "markersize": size,
        "color": style.colour,
        "markerfacecolor": "white" if style.hollow else style.colour,
        "markeredgecolor": style.colour if style.hollow else "white",
        "markeredgewidth": 1.0 if style.hollow else 0.6,
    }


def _beyond(axis: Axes, x: float, y: float, low: float, high: float, style: _Style, size: float) -> None:
    """An arrow at the rim and the value of what lies outside."""
    right = x > high
    edge = high if right else low
    inward = (low - high if right else high - low) * 0.02
    axis.plot(
        edge + 1.2 * inward,
        y,
        marker=">" if right else "<",
        color=style.colour,
        markersize=4.5,
        markeredgewidth=0,
        zorder=style.order,
    )
    axis.text(
        edge + 4.5 * inward,
        y,
        ("+" if x > 0 else MINUS) + digits(abs(x)).replace("-", MINUS),
        ha="right" if right else "left",
        va="center",
        fontsize=size,
        color=_ink(style),
        path_effects=HALO,
        zorder=style.order,
    )


def _verdicts(axis: Axes, comparison: Comparison, styles: dict[str, _Style]) -> None:
    """The verdict on each method, right of its row."""
    transform = axis.get_yaxis_transform()
    for y, row in enumerate(comparison.rows):
        style = styles[row.method]
        options: dict[str, Any] = {"transform": transform, "va": "center", "clip_on": False}
        if row.method == comparison.reference:
            axis.text(1.07, y, "reference", fontsize=7.5, fontweight="bold", **options)
        elif row.failure is not None:
            word = "" if row.status == "unconverged" else f"{row.status}: "  # that one says so itself
            text = "\n".join(textwrap.wrap(_short(word + row.failure, 82), 43, break_on_hyphens=False))
            axis.text(1.07, y, text, fontsize=5.4, color=WARNING, linespacing=1.0, **options)
        elif row.agrees is None:
            rotation, translation = row.difference_rotation or 0.0, row.difference_translation or 0.0
            text = f"{apart(rotation, 180 / np.pi)} deg, {apart(translation, 1e3)} mm away"
            text += "" if comparison.noise is None else "\n(no covariance)"
            size = 7.0 if comparison.noise is None else 5.8
            axis.text(1.07, y, text, fontsize=size, color="0.25", linespacing=1.0, **options)
        else:
            axis.plot(1.09, y, **_marker(style, 4.6), transform=transform, clip_on=False)
            axis.text(
                1.14,
                y,
                "agrees" if row.agrees else "differs",
                fontsize=7.5,
                fontweight="normal" if row.agrees else "bold",
                color=_ink(style),
                **options,
            )
            value = apart(row.d2).replace("e+0", "e").replace("e+", "e")
            axis.text(1.55, y, f"$d^2$ = {value}".replace("= <", "< "), fontsize=7.2, color=_ink(style), **options)


def _projection(axis: Axes, i: int, j: int, comparison: Comparison, styles: dict[str, _Style], scale: _Scale) -> None:
    """Two components of all methods, each with the shadow of its 95 % ellipsoid."""
    x_limits, y_limits = _limits(i, scale), _limits(j, scale)
    x_limits, y_limits = ((low - ROOM * (high - low), high + ROOM * (high - low)) for low, high in (x_limits, y_limits))
    axis.set_xlim(*x_limits)
    axis.set_ylim(*y_limits)
    axis.axhline(0, color="0.85", linewidth=0.6, zorder=0)
    axis.axvline(0, color="0.85", linewidth=0.6, zorder=0)
    for row in comparison.rows:
        if row.xi is None:
            continue
        style = styles[row.method]
        x, y = (float(row.xi[k] * scale.factor[k]) for k in (i, j))
        if row.covariance is not None and row.std is not None and row.failure is None:
            curve = np.array([[x], [y]]) + _RADIUS * ellipse(row.covariance, i, j, scale.factor)
            if row.method == comparison.reference:
                axis.fill(*curve, color="0.5", alpha=0.13, linewidth=0, zorder=1)
            axis.plot(*curve, color=style.colour, linestyle=style.line, linewidth=style.width, zorder=style.order)
        if x_limits[0] <= x <= x_limits[1] and y_limits[0] <= y <= y_limits[1]:
            axis.plot(x, y, **_marker(style, 3.6), zorder=style.order + 0.5)
        else:
            _at_rim(axis, x, y, style)
    axis.set_xlabel(_label(i, scale), fontsize=7.2, labelpad=0)
    axis.set_ylabel(_label(j, scale), fontsize=7.2, labelpad=0.5)
    _ticks(axis.xaxis, *x_limits)
    _ticks(axis.yaxis, *y_limits)
    axis.tick_params(labelsize=6, direction="in", length=2, pad=1.5)
    axis.set_box_aspect(1)


def _at_rim(axis: Axes, x: float, y: float, style: _Style) -> None:
    """Draw a mark on the rim in the direction of a point outside."""
    (x0, x1), (y0, y1) = axis.get_xlim(), axis.get_ylim()
    u, v = (x - x0) / (x1 - x0), (y - y0) / (y1 - y0)
    marker = (">" if u > 1 else "<") if max(u, 1 - u) > max(v, 1 - v) else ("^" if v > 1 else "v")
    u, v = (float(np.clip(w, 0.025, 0.975)) for w in (u, v))
    x, y = x0 + u * (x1 - x0), y0 + v * (y1 - y0)
    axis.plot(x, y, marker=marker, color=style.colour, markersize=4, markeredgewidth=0, zorder=style.order + 1)


def _explanation(figure: Figure, comparison: Comparison, width: float, height: float) -> None:
    """Write what is drawn, below the panels."""
    if comparison.reference is None:
        return
    if comparison.noise is None:
        text = (
            "Points: difference from the reference. The noise is not known, so there are no bars and no ellipses, and "
            "whether a difference matters cannot be said. "
        )
    else:
        text = (
            "Bars: 1 and 2 standard deviations of the method itself. Ellipses: shadows of its 95 % ellipsoid. A method "
            "agrees if its ellipsoid holds the reference (black), $d^2 \\leq 12.6$; it is then grey. Coloured: it "
            "differs. "
        )
    if any(row.X is not None and row.failure is not None for row in comparison.rows):
        text += "Hollow: not to be relied on, see its row. "
    text += "Colours and markers are those of the rows. Arrow: off the scale. "
    text += "All methods use the same data: those that agree may be wrong together."
    lines = "\n".join(textwrap.wrap(text, 200, break_on_hyphens=False))
    figure.text(0.15 / width, 0.12 / height, lines, fontsize=6.5, va="bottom", color="0.3", linespacing=1.2)


def _short(text: str, length: int) -> str:
    return textwrap.shorten(text, length, placeholder=" ...")
