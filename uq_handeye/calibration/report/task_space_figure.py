r"""Task space as a figure: how uncertain a point is that the camera measures, by its distance and its angle.

Model: `task_space`; the point itself is exact, so that only the error of X counts. Shown is the standard deviation in
the worst direction, the root of the largest eigenvalue of the point's covariance. This module imports Matplotlib;
import it where it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ...geometry.se3 import Array
from ...presentation.figure_parts import BLUE, INK, ORANGE, QUIET, SMALL, TEXT, canvas, finished, plain

if TYPE_CHECKING:
    from ..result import Calibration

# Where nothing is known of the distance to the target (m).
_DEFAULT = 0.5
_STEPS = np.array([0.25, 0.5, 0.75, 1.0, 1.5, 2.0])  # of the table, in distances to the target
_HALF_ANGLE = np.tan(np.radians(30.0))


class Ahead(NamedTuple):
    """Points straight ahead of the camera."""

    distance: Array  # (k,) m
    worst: Array  # (k,) m, standard deviation in the worst direction
    across: Array  # (k,) m, in the worst direction across the line of sight
    along: Array  # (k,) m, along it
    radius_95: Array  # (k,) m


def typical_distance(result: Calibration) -> tuple[float, bool]:
    """RMS distance from camera to target (m); False: it is not known, and a usual one is taken."""
    if result.analysis is not None:
        spectrum = result.analysis.diagnostics.spectrum
        if spectrum.length_of.endswith("camera to target"):
            return float(spectrum.length_m), True
    return _DEFAULT, False


def ahead(result: Calibration, distances: Array | None = None) -> Ahead:
    """The uncertainty of points on the optical axis; without ``distances`` (m) those of a small table.

    Raises `InputError` where the covariance of X is not determined.
    """
    if distances is None:
        distances = np.array([float(f"{x:.2g}") for x in typical_distance(result)[0] * _STEPS])
    found = result.uncertainty_at(np.stack([0 * distances, 0 * distances, distances], axis=-1))
    R = result.X[:3, :3]
    in_camera = R.T @ found.covariance @ R
    root = np.sqrt(np.maximum(np.linalg.eigvalsh(in_camera[..., :2, :2])[..., -1], 0.0))
    return Ahead(distances, _worst(found.covariance), root, np.sqrt(in_camera[..., 2, 2]), found.radius_95)


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
    worst = 1e3 * _worst(result.uncertainty_at(np.stack([x, 0 * x, z], axis=-1)).covariance)
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


def _worst(covariance: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[..., -1], 0.0)))
