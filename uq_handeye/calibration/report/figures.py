"""Errors of a calibration as figures: of points ahead of the camera, by source, and those that all poses share.

A point ahead of the camera is exact (model `task_space`), so that only the error of X counts. "Worst" is the standard
deviation in the worst direction, the root of the largest eigenvalue of the covariance of the point. This module imports
Matplotlib; import it where it is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ...core.geometry.se3 import Array
from ...core.presentation.colours import BLUE, INK, ORANGE, QUIET
from ...core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from ...core.presentation.numbers import concise
from ...model.errors.error_estimate import ErrorEstimate
from ..estimated import distance_of
from .budget import KINDS
from .points_ahead import ahead, worst_deviation
from .shared_errors import found_of

if TYPE_CHECKING:
    from ..result import Calibration


_HALF_ANGLE = np.tan(np.radians(30.0))


def task_space_figure(result: Calibration) -> Figure:
    """Figure of the standard deviation over the distance (left) and in the plane in front of the camera (right)."""
    typical, known = distance_of(result.analysis)
    reach = 2.0 * typical
    line = ahead(result, np.linspace(0.0, reach, 81))
    figure = canvas(3.3)
    left, right = figure.subplots(1, 2, width_ratios=[1.15, 1])
    plain(left)
    for values, colour, style, name in (
        (line.worst, "black", "-", "worst direction"),
        (line.across, BLUE, "--", "across the line of sight"),
        (line.along, ORANGE, "-.", "along the line of sight"),
    ):
        left.plot(line.distance, 1e3 * values, color=colour, linestyle=style, linewidth=1.6, label=name)
    if known:
        left.axvline(typical, color=QUIET, linewidth=0.9, linestyle=":")
        left.annotate(
            "target, RMS", (typical, 0), xycoords=("data", "axes fraction"), xytext=(3, 4), textcoords="offset points",
            fontsize=SMALL, color=INK,
        )  # fmt: skip
    left.set_xlim(0, reach)
    left.set_ylim(0, 1.45e3 * max(float(line.worst.max()), 1e-12))
    left.set_xlabel("distance in front of the camera (m)", fontsize=TEXT)
    left.set_ylabel("standard deviation (mm)", fontsize=TEXT)
    left.legend(fontsize=SMALL, frameon=False, loc="upper left", handlelength=2.6)

    z, slope = np.meshgrid(np.linspace(0.02, 1.0, 50) * reach, np.linspace(-1.0, 1.0, 41))
    x = slope * _HALF_ANGLE * z
    worst = 1e3 * worst_deviation(result.uncertainty_at(np.stack([x, 0 * x, z], axis=-1)).covariance)
    plain(right)
    right.grid(visible=False)
    if np.ptp(worst) > 1e-9 * worst.max():
        filled = right.contourf(x, z, worst, levels=5, cmap="cividis")
        right.contour(x, z, worst, levels=filled.levels, colors="white", linewidths=0.6)
        bar = figure.colorbar(filled, ax=right, shrink=0.9)
        bar.set_label("worst direction (mm)", fontsize=TEXT)
        bar.ax.tick_params(labelsize=SMALL)
    right.set_aspect("equal")
    right.set_xlabel("camera x (m)", fontsize=TEXT)
    right.set_ylabel("camera z (m)", fontsize=TEXT)
    return finished(figure)


_STYLES = ((BLUE, ""), (ORANGE, "////"))  # rotation, translation


def budget_figure(shares: Mapping[str, Array]) -> Figure:
    """Figure with two bars for each source: its ``shares`` (2,) of the variances of X's rotation and translation."""
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


def shared_figure(errors: Sequence[ErrorEstimate]) -> Figure:
    """Figure of the assumed standard deviation of each error, as a bar, and its estimate with the one after the fit.

    Of an error of many numbers the estimates are dots, without their standard deviations.
    """
    count = len(errors)
    figure = canvas(1.0 + 0.42 * count)
    axis = figure.subplots()
    plain(axis)
    axis.grid(axis="y", visible=False)
    y = np.arange(count)
    z = [np.array([part.estimate / part.size for part in error.parts]) for error in errors]
    after = [np.array([part.sd / part.size for part in error.parts]) for error in errors]
    ends = [np.abs(of) + (sd if len(of) == 1 else 0.0) for of, sd in zip(z, after, strict=True)]
    reach = float(min(max(1.3, 1.1 * max(float(end.max()) for end in ends)), 6.0))
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


def _amount(error: ErrorEstimate) -> str:
    if error.count > 1:
        return found_of(error)
    factor, unit = error.parts[0].shown
    return concise(factor * error.parts[0].estimate, factor * error.parts[0].sd, unit)
