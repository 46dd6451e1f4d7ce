r"""Task space as a figure: how uncertain a point is that the camera measures, by its distance and its angle.

Model: `task_space`; the point itself is exact, so that only the error of X counts. Shown is the standard deviation in
the worst direction, the root of the largest eigenvalue of the point's covariance. This module imports Matplotlib;
import it where it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ...core.presentation.figure_parts import BLUE, INK, ORANGE, QUIET, SMALL, TEXT, canvas, finished, plain
from ..points_ahead import ahead, typical_distance, worst_deviation

if TYPE_CHECKING:
    from ..result import Calibration

_HALF_ANGLE = np.tan(np.radians(30.0))


def task_space_figure(result: Calibration) -> Figure:
    """Left the standard deviation over the distance, right a map of the plane in front of the camera."""
    typical, known = typical_distance(result)
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
