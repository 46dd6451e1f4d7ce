r"""The covariance of X as a figure: its projections onto all 15 pairs of the six error components.

Model: the error ``xi = (theta, tau)`` of X (rotation first, left rotation, additive translation, rad and m,
in the frame in which ``A`` is expressed) is Gaussian with mean zero and the covariance given. The projection
onto two components (i, j) is Gaussian with the 2x2 covariance of these components, and its k-sigma ellipse

    (s_i cos t,  s_j (rho cos t + sqrt(1 - rho^2) sin t)) k,   0 <= t < 2 pi

holds the probability ``1 - exp(-k^2 / 2)``: 39.3 %, 86.5 % and 98.9 % for k = 1, 2, 3. The figure follows
Fig. 5 of Wu et al. (2019) and adds the coupling of rotation and translation.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from ...errors import InputError
from ..geometry.checks import as_covariance, as_pose
from ..geometry.rotations import Rotation
from ..geometry.se3 import Array
from ..limits import MAX_DRAWN_POINTS
from .colours import BLUE, GREEN, ORANGE, SKY
from .figure_parts import SMALL, NamedFigure, settle_layout
from .figure_parts import render as render

SIGMAS = (1, 2, 3)  # standard deviations of the ellipses that are drawn
SYMBOLS = (r"\theta_x", r"\theta_y", r"\theta_z", r"\tau_x", r"\tau_y", r"\tau_z")
PAIRS_WITHIN = ((0, 1), (1, 2), (0, 2))

# Colours of clearly different lightness, each with its own line style: the ellipses
# can be distinguished in greyscale and by colour-blind readers.
STYLES: tuple[tuple[str, Any], ...] = (
    ("black", "-"),
    (SKY, "--"),
    (ORANGE, ":"),
    (BLUE, "-."),
    (GREEN, (0, (6, 1, 1, 1, 1, 1))),
)
LINE_WIDTH = 1.6  # of the 1 sigma ellipse; larger ellipses are thinner

PREFIXES = {0: "", -3: "m", -6: "µ", -9: "n", -12: "p"}


def covariance_ellipses(
    X: ArrayLike,
    covariance: ArrayLike,
    *,
    samples: ArrayLike | None = None,
    others: Mapping[str, ArrayLike] | None = None,
    label: str = "estimate",
    title: str | None = None,
) -> Figure:
    """The 1, 2 and 3 sigma ellipses of a 6x6 covariance of X, in all 15 projections.

    Three panels show the rotation, three the translation, nine the coupling of the two. Axes of the same
    quantity share one scale, so that sizes can be compared by eye, unless their ranges differ by more than a
    factor of 10: then each has its own, and the heading says so. Each panel states the correlation
    coefficient of ``covariance``. The origin is ``X``, whose value stands in the caption.

    Parameters
    ----------
    X : (4, 4)
        The estimate, translation in m.
    covariance : (6, 6)
        Of ``xi = (theta, tau)``, in rad and m.
    samples : (S, 6) or None
        Errors ``xi`` in rad and m, of a Monte Carlo simulation or a posterior; at most 5000, evenly spaced,
        are drawn. A scale shows the 3 sigma ellipses and three standard deviations of the samples.
    others : name -> (6, 6) or None
        Up to four more covariances to compare with, drawn in other line styles.
    label : str
        Names ``covariance`` in the legend.
    title : str or None

    Raises
    ------
    InputError
        A covariance that is not 6x6, finite, symmetric and positive semidefinite; poses or samples of the
        wrong shape or not finite; more than four others.
    """
    pose = as_pose(X, "X")
    covariances = {label: as_covariance(covariance, "covariance")}
    for name, other in (others or {}).items():
        if name == label or len(covariances) == len(STYLES):
            count = len(STYLES) - 1
            raise InputError(f"Expected at most {count} others with names of their own, got also {name!r}.")
        covariances[name] = as_covariance(other, f"others[{name!r}]")
    points = np.empty((0, 6)) if samples is None else _points(samples)
    reach, common = _reach(covariances, points)
    units = [display_unit(value, "rad" if k < 3 else "m") for k, value in enumerate(reach)]
    scale = np.array([factor for factor, _ in units])
    axis_labels = [f"${symbol}$ ({unit})" for symbol, (_, unit) in zip(SYMBOLS, units, strict=True)]

    figure = NamedFigure(figsize=(6.9, 11.6), layout="constrained")
    if title is not None:
        figure.suptitle(title, fontsize=11)
    parts: Any = figure.subfigures(3, 1, height_ratios=[1.12, 1.12, 2.76], hspace=0.02)
    panels: list[tuple[Axes, int, int]] = []
    for part, name, first in ((parts[0], "Rotation", 0), (parts[1], "Translation", 3)):
        part.suptitle(name if common[first // 3] else f"{name} (each axis has its own scale)", fontsize=10)
        axes = part.subplots(1, 3)
        panels += [(axis, first + i, first + j) for axis, (i, j) in zip(axes, PAIRS_WITHIN, strict=True)]
    parts[2].suptitle("Coupling of rotation and translation", fontsize=10)
    grid = parts[2].subplots(3, 3)
    panels += [(grid[row, column], column, 3 + row) for row in range(3) for column in range(3)]

    for axis, i, j in panels:
        _draw(axis, i, j, covariances, points, scale)
        limited(axis, (reach[i] / scale[i], reach[j] / scale[j]))
        axis.set_xlabel(axis_labels[i], fontsize=9)
        axis.set_ylabel(axis_labels[j], fontsize=9)
    _legend(figure, covariances, len(points) > 0, pose)
    settle_layout(figure)
    return figure


def small_ellipses(covariance: Array) -> Figure:
    """The ellipses of a covariance (6, 6) of X in half the width: translation in mm above, rotation in deg below."""
    figure = NamedFigure(figsize=(3.45, 2.62), layout=ConstrainedLayoutEngine(wspace=0.02, hspace=0.04))
    grid: Any = figure.subplots(2, 3, sharey="row")
    scale = np.repeat([np.pi / 180, 1e-3], 3)
    for line, first, unit in ((grid[0], 3, "mm"), (grid[1], 0, "deg")):
        reach = 3.2 * float(np.sqrt(np.diag(covariance)[first : first + 3].max())) / scale[first] or 1.0
        for axis, (i, j) in zip(line, PAIRS_WITHIN, strict=True):
            _draw(axis, first + i, first + j, {"": covariance}, np.empty((0, 6)), scale)
            limited(axis, (reach, reach))
            axis.set_xlabel(f"{'xyz'[i]} ({unit})", fontsize=7, labelpad=1)
            axis.set_ylabel("xyz"[j], fontsize=7, labelpad=2)
            axis.set_title(axis.get_title(loc="right"), fontsize=6.5, loc="right", pad=2)
    settle_layout(figure)
    return figure


def _points(samples: ArrayLike) -> Array:
    try:
        points = np.asarray(samples, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"Expected `samples` to be numbers, got {type(samples).__name__}.") from error
    if points.ndim != 2 or points.shape[1] != 6 or not np.isfinite(points).all():
        raise InputError(f"Expected `samples` to be finite errors of shape (S, 6), got shape {points.shape}.")
    return points


def _reach(covariances: Mapping[str, Array], points: Array) -> tuple[Array, list[bool]]:
    """Half the range of each axis (6,) in rad and m; whether rotation and translation have a common one."""
    rows = [3 * np.sqrt(np.diag(S)) for S in covariances.values()]
    if len(points):
        rows.append(3 * np.sqrt(np.mean(points**2, axis=0)))
    reach = np.max(rows, axis=0)
    common = []
    for group in (reach[:3], reach[3:]):
        varying = group[group > 0]
        largest = varying.max(initial=0) or 1e-6  # nothing varies: any scale does, this one is small
        common.append(bool((varying > 0.1 * largest).all()))
        group[(group == 0) | common[-1]] = largest
    return 1.12 * reach, common


def display_unit(reach: float, base: str) -> tuple[float, str]:
    """A factor and a unit in which ``reach`` lies between 1 and 1000, if there is such a prefix."""
    exponent = min(0, 3 * int(np.floor(np.log10(reach) / 3)))
    if exponent in PREFIXES and reach < 1e4:
        return 10.0**exponent, PREFIXES[exponent] + base
    exponent = int(np.floor(np.log10(reach)))
    return 10.0**exponent, f"$10^{{{exponent}}}$ {base}"


def held(places: int) -> str:
    """Return what the ellipses of `SIGMAS` hold of the errors of two components: ``39 %, 86 %, 99 %``."""
    return ", ".join(f"{100 * (1 - np.exp(-k * k / 2)):.{places}f} %" for k in SIGMAS)


def correlation(S: Array, i: int, j: int) -> float | None:
    """Return the correlation of two components; None where one has no variance."""
    product = np.sqrt(S[i, i] * S[j, j])
    return float(np.clip(S[i, j] / product, -1.0, 1.0)) if product > 0 else None


def ellipse(S: Array, i: int, j: int, factor: Array) -> Array:
    """Return the ellipse (2, m) of one standard deviation of two components, each times its ``factor`` (6,).

    ``(s_i cos t, s_j (rho cos t + sqrt(1 - rho^2) sin t))``, 0 <= t < 2 pi.
    """
    angle, rho = np.linspace(0, 2 * np.pi, 181), correlation(S, i, j) or 0.0
    x, y = (np.sqrt(S[k, k]) * factor[k] for k in (i, j))
    return np.stack([x * np.cos(angle), y * (rho * np.cos(angle) + np.sqrt(1 - rho**2) * np.sin(angle))])


def _draw(axis: Axes, i: int, j: int, covariances: Mapping[str, Array], points: Array, scale: Array) -> None:
    """Samples, ellipses and correlation of one panel."""
    if len(points):
        step = -(-len(points) // MAX_DRAWN_POINTS)
        x, y = (points[::step, [i, j]] / scale[[i, j]]).T
        axis.plot(x, y, ".", color="0.65", markersize=1.5, markeredgewidth=0, rasterized=True, zorder=1)
    axis.axhline(0, color="0.85", linewidth=0.6, zorder=0)
    axis.axvline(0, color="0.85", linewidth=0.6, zorder=0)
    for number, (S, (colour, style)) in enumerate(zip(covariances.values(), STYLES, strict=False)):
        s = np.sqrt(np.diag(S))[[i, j]]
        rho, (x, y) = correlation(S, i, j), ellipse(S, i, j, 1 / scale)
        for level in SIGMAS:
            width = LINE_WIDTH / np.sqrt(level)
            axis.plot(level * x, level * y, color=colour, linestyle=style, linewidth=width, zorder=3 + number)
        if number == 0:
            value = "undefined" if rho is None else f"= {round(rho, 3) + 0.0:+.3f}".replace("-", "\N{MINUS SIGN}")
            axis.set_title(rf"$\rho$ {value}", fontsize=8, loc="right", pad=3)
            if not s.any():
                axis.plot(0, 0, "o", color=colour, markersize=3, zorder=3)


def limited(axis: Axes, reach: tuple[float, float]) -> None:
    """Limits and few, round ticks; a square panel."""
    axis.set_xlim(-reach[0], reach[0])
    axis.set_ylim(-reach[1], reach[1])
    axis.set_box_aspect(1)
    for direction in (axis.xaxis, axis.yaxis):
        direction.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10], symmetric=True))
    axis.tick_params(labelsize=SMALL, direction="in", top=True, right=True)


def _legend(figure: Figure, covariances: Mapping[str, Array], samples: bool, pose: Array) -> None:
    """Explain what the lines mean, what the ellipses hold, and where the origin is."""
    handles: list[Any] = []
    for name, (colour, style) in zip(covariances, STYLES, strict=False):
        handles.append(Line2D([], [], color=colour, linestyle=style, linewidth=LINE_WIDTH, label=name))
    if samples:
        handles.append(Line2D([], [], marker=".", linestyle="", color="0.65", markersize=5, label="samples"))
    position = ", ".join(f"{1e3 * x:.3f}" for x in pose[:3, 3])
    turn = ", ".join(f"{x:.4f}" for x in Rotation.from_matrix(pose[:3, :3]).as_rotvec(degrees=True))
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles) if len(handles) <= 4 else (len(handles) + 1) // 2,
        frameon=False,
        fontsize=9,
        title=(
            f"1, 2, 3 $\\sigma$ ellipses, from the inside, hold {held(1)} of the probability.\n"
            f"Origin: translation ({position}) mm, rotation vector ({turn})\N{DEGREE SIGN}"
        ),
        title_fontproperties={"size": 8.5},
        alignment="center",
    )
