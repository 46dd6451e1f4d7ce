"""The figure of `scaling_factor`: distances from the limit over d / length, and the error with noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.common.study import Tables
from studies.scaling_factor.curves import (
    CLAIM_SCALES,
    CLAIMED,
    LENGTHS,
    PRECISIONS,
    SLOPES,
    Curve,
    chosen,
    curve,
    with_ratios,
)
from uq_handeye.core.presentation.colours import BLUE, INK, ORANGE, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain

_LOOK = {"double": (BLUE, "-"), "single": (ORANGE, "--")}
_MARKERS = dict(zip(LENGTHS, (("o", 7.5), ("s", 5.5), ("D", 3.5), ("x", 3.0)), strict=True))
_RANGE = (2.0, 3e11)  # of d / length


def figures(tables: Tables) -> Mapping[str, Figure]:
    table = with_ratios(tables["accuracy"])
    figure = canvas(5.6)
    axes = figure.subplots(2, 2, sharex=True)
    units = {"rotation": "rad", "translation": "lengths", "covariance": "largest relative deviation"}
    titles = {"rotation": "Rotation of X", "translation": "Translation of X", "covariance": "Covariance"}
    for axis, quantity in zip(axes.flat, titles, strict=False):
        for precision in PRECISIONS:
            _draw(axis, curve(table, precision, quantity), precision, quantity)
        axis.set_title(f"{titles[quantity]}: distance from the limit", fontsize=TEXT)
        axis.set_ylabel(units[quantity], fontsize=TEXT)
    for precision in PRECISIONS:
        _draw_printed(axes[1, 0], curve(table, precision, "covariance as printed"), precision)
    _draw_claim(axes[0, 1])
    _draw_noisy(axes[1, 1], table)
    for axis in axes.flat:
        plain(axis)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlim(*_RANGE)
    for axis in axes[1]:
        axis.set_xlabel("d / length", fontsize=TEXT)
    own = axes[0, 0]
    handles = [
        *(own.plot([], [], color=c, linestyle=s, linewidth=1.1, label=n)[0] for n, (c, s) in _LOOK.items()),
        *(own.plot([], [], color=QUIET, linestyle="", label=_length(n), **_marker(n))[0] for n in LENGTHS),
        own.plot([], [], color=INK, linestyle=":", linewidth=1.0, label="error of the limit")[0],
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize=SMALL, frameon=False)
    return {"scaling_factor": finished(figure)}


def _length(length: float) -> str:
    return f"{length * 1e3:g} mm" if length < 1 else f"{length:g} m"


def _marker(length: float) -> dict[str, Any]:
    """Open and of different sizes, so that all are seen where they coincide."""
    marker, size = _MARKERS[length]
    return {"marker": marker, "markersize": size, "markerfacecolor": "none", "markeredgewidth": 0.7}


def _draw(axis: Axes, c: Curve, precision: str, quantity: str) -> None:
    """Medians, the fitted slopes, and the limit."""
    colour, style = _LOOK[precision]
    shown = (c.decades >= math.log10(_RANGE[0])) & (c.values < 10)
    for length in LENGTHS:
        of = shown & (c.lengths == length)
        axis.plot(10.0 ** c.decades[of], c.values[of], color=colour, linestyle="", **_marker(length))
    axis.axhline(c.limit, color=colour, linestyle=":", linewidth=1.0)
    for factor, slope in zip(c.factors, SLOPES[quantity], strict=True):
        if math.isnan(factor):
            continue
        x = np.geomspace(*_RANGE, 400)
        y = factor * x ** float(slope)
        keep = (y < 10) & (y > 0.3 * c.least)
        keep &= x > (0.0 if slope < 0 else 0.3 * (c.factors[0] / factor) ** (1 / (2 + slope)))  # from their crossing on
        axis.plot(x[keep], y[keep], color=colour, linestyle=style, linewidth=1.1)
        if slope == 0:
            word, at = f"{precision}: constant", 0.99
        elif slope == 1:
            word, at = f"{precision}: d", 0.3 if precision == "double" else 0.8
        else:
            continue
        k = int(at * (keep.sum() - 1))
        above = slope == 0 or precision == "single"
        side: dict[str, Any] = {"va": "bottom", "ha": "right"} if above else {"va": "top", "ha": "left"}
        axis.annotate(
            word, (x[keep][k], y[keep][k]), (-2, 5) if above else (6, -3), textcoords="offset points",
            fontsize=SMALL, color=colour, **side,
        )  # fmt: skip
    if precision == "double" and not math.isnan(c.factors[0]):
        axis.annotate(
            "1/d²", (1e4, c.factors[0] * 1e-8), (-8, -2), textcoords="offset points", fontsize=SMALL, color=INK,
            ha="right", va="top",
        )  # fmt: skip


def _draw_printed(axis: Axes, c: Curve, precision: str) -> None:
    """The rounding of the covariance as printed."""
    colour, style = _LOOK[precision]
    shown = (c.decades > math.log10(c.best)) & (c.values < 10)
    axis.plot(10.0 ** c.decades[shown], c.values[shown], color=colour, linestyle="", marker="+", markersize=4)
    if math.isnan(c.factors[1]):
        return
    x = np.sqrt(np.array([c.least, 10.0]) / c.factors[1])
    axis.plot(x, c.factors[1] * x**2, color=colour, linestyle=style, linewidth=0.7)
    if precision == "double":
        at = (1e8, c.factors[1] * 1e16)
        axis.annotate(
            "as printed: d²", at, (6, -8), textcoords="offset points", fontsize=SMALL, color=colour, ha="left"
        )


def _draw_claim(axis: Axes) -> None:
    axis.plot(CLAIM_SCALES, (CLAIMED, CLAIMED), color=INK, linewidth=2.5, solid_capstyle="butt")
    axis.annotate(
        "III-D claims, single", (3e6, CLAIMED), (0, 0), textcoords="offset points", fontsize=SMALL, color=INK,
        ha="left", va="center",
    )  # fmt: skip


def _draw_noisy(axis: Axes, table: pd.DataFrame) -> None:
    axis.set_title("Translation of X: RMS error with noise", fontsize=TEXT)
    axis.set_ylabel("lengths", fontsize=TEXT)
    for precision, (colour, style) in _LOOK.items():
        part = table[(table.noise != "none") & (table.precision == precision)]
        for length in LENGTHS:
            rows = chosen(part, length_m=length)
            error = rows.translation_error_rms_m / length
            ratio = rows.d_m / length
            at_d = (ratio >= _RANGE[0]) & (error < 10)
            axis.plot(ratio[at_d], error[at_d], color=colour, linestyle="", **_marker(length))
            if length == 1.0:
                axis.plot(ratio[at_d], error[at_d], color=colour, linestyle=style, linewidth=1.1)
                axis.axhline(float(error[rows.d_m.isna()].iloc[0]), color=colour, linestyle=":", linewidth=1.0)
