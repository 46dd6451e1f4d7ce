r"""Figures of the camera's view: the accuracy of a predicted pixel over the picture, and where the board was.

Model of the first: a point known in the camera frame is seen where the intrinsics predict; their covariance gives the
standard deviation shown (`camera.rays`). This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import numpy as np
from matplotlib.lines import Line2D

from ....core.limits import MAX_DRAWN_POINTS
from ....core.presentation.colours import GREEN, ON_MAP, QUIET
from ....core.presentation.figure_parts import SMALL, Picture, finished, plain
from ....core.presentation.numbers import fixed
from ..calibrated import Calibrated, certainty, distances, tilts
from .frames import add_colour_scale, framed, marked, named_axes, picture_canvas
from .text import boards_words


def over_certainty(cam: Calibrated) -> Picture | None:
    """Map of the standard deviation in pixels over the picture; None where the intrinsics are exact."""
    if not cam.estimated:
        return None
    u, v, deviation = certainty(cam)
    if not np.isfinite(deviation).any():
        return None
    figure, axis = picture_canvas(cam.image_size, 1.6)
    axis.grid(visible=False)
    low, high = float(np.nanmin(deviation)), float(np.nanmax(deviation))
    levels = np.geomspace(low, high, 13) if high > 8 * low > 0 else np.linspace(low, max(high, 1.001 * low + 1e-9), 13)
    drawn = axis.contourf(u, v, np.ma.masked_invalid(deviation), levels=levels, cmap="Blues")
    used = cam.bundle.used
    many = bool(used.sum() > MAX_DRAWN_POINTS)
    axis.plot(
        *cam.corners.pixels[used].T, ".", color=ON_MAP, markersize=1.0 if many else 2.0, markeredgewidth=0,
        rasterized=many,
    )  # fmt: skip
    bar = add_colour_scale(figure, axis, drawn, "standard deviation (pixels)")
    bar.set_ticks(levels[::2].tolist(), labels=[fixed(level, 2) for level in levels[::2]])
    for k, name in ((int(np.nanargmin(deviation)), "best"), (int(np.nanargmax(deviation)), "worst")):
        at = np.array([u.flat[k], v.flat[k]])
        marked(axis, at, f"{name}: {fixed(deviation.flat[k], 2)}", 0.5 * np.array(cam.image_size))
    handles = [Line2D([], [], marker=".", linestyle="", color=QUIET, markersize=4, label="corners used")]
    figure.legend(handles=handles, loc="outside upper right", frameon=False, fontsize=SMALL)
    least, most = fixed(low, 2), fixed(high, 2)
    alt = f"Map of the standard deviation of where a point is seen, over the picture: {least} to {most} pixels."
    caption = (
        "How well the intrinsics say where a point is seen that is known in the camera frame: standard deviation in "
        f"the worst direction, {least} to {most} pixels. It is the part that all pictures share, as far as the model "
        "is right; it grows where there were no corners."
    )
    return Picture(finished(figure), alt, caption)


def boards_seen(cam: Calibrated) -> Picture:
    """Distance and tilt of the board in each picture."""
    figure, axis = framed(0.45, 1.0, 1.0)
    plain(axis)
    many = cam.corners.n > MAX_DRAWN_POINTS
    axis.plot(
        distances(cam), tilts(cam), "o", color=GREEN, markersize=2.0 if many else 5.0, markeredgewidth=0,
        rasterized=many,
    )  # fmt: skip
    axis.set_xlim(left=0.0)
    axis.set_ylim(bottom=0.0)
    named_axes(axis, "distance along the optical axis (m)", "tilt against the picture (deg)", ticks=(8, 6))
    alt = f"Distance and tilt of the board in each picture. {boards_words(cam)}"
    caption = (
        f"{boards_words(cam)} Boards at several distances and tilts separate the focal length from the distance; "
        "boards that are all parallel to the picture do not."
    )
    return Picture(finished(figure), alt, caption)
