"""All figures of a camera calibration, each with the words that belong to it.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ...errors import InputError
from ...files.atomic import write_files
from ...files.open import StrPath, as_path
from ...formatting.numbers import digits, fixed
from ...presentation.ellipses import render
from ...presentation.figure_parts import Picture
from ..calibrated import Calibrated
from ..residual_pattern import LARGE
from ..what_was_seen import certainty, picture_rms
from .board_figures import height_figure, point_figure
from .residual_figures import by_picture_figure, over_picture_figure, pattern_figure
from .text import board_pattern_words, board_words, boards_words, coverage_words, noise_words, pattern_words
from .view_figures import boards_figure, certainty_figure


def camera_figures(cam: Calibrated) -> dict[str, Figure]:
    """The figures of a camera calibration by the stem of their file names; those that cannot be drawn are left out."""
    return {stem: picture.figure for stem, picture in camera_pictures(cam).items()}


def save_figure(cam: Calibrated, path: StrPath, name: str) -> Path:
    """Write one of `camera_figures` as ``.png`` or ``.svg``, by the ending of the path, whole or not at all.

    Raises `InputError` for another ending, a name that none of them has, and if the file cannot be written.
    """
    path = as_path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        raise InputError(f"Expected a figure ending in .png or .svg, got {path.name!r}.")
    found = camera_figures(cam)
    if name not in found:
        raise InputError(f"Expected `name` to be one of {', '.join(found)}, got {name!r}.")
    write_files(path.parent, {path.name: render(found[name], kind)})
    return path


def camera_pictures(cam: Calibrated) -> dict[str, Picture]:
    """`camera_figures` with alt text and caption."""
    found = {
        "pattern": _pattern(cam),
        "residuals": _residuals(cam),
        "pictures": _by_picture(cam),
        "certainty": _certainty(cam),
        "boards": _boards(cam),
        "board": _board(cam),
        "board_residuals": _board_residuals(cam),
    }
    return {stem: picture for stem, picture in found.items() if picture is not None}


def _pattern(cam: Calibrated) -> Picture:
    figure, factor = pattern_figure(cam)
    alt = f"Mean residuals over the picture by cell, and by the distance from the centre. {pattern_words(cam)}"
    caption = (
        f"{pattern_words(cam)} Left: the mean residual (measured less predicted) of each cell, enlarged {factor:,g} "
        f"times; orange ones are beyond chance and larger than {LARGE:g} of the pixel noise. Right: its part away from "
        f"the centre, with bars of 2 sigma, and grey where it is below {LARGE:g} of the noise. A right model leaves "
        "short arrows without order, and a curve about 0."
    )
    return Picture(figure, alt, caption)


def _residuals(cam: Calibrated) -> Picture:
    figure, factor = over_picture_figure(cam)
    out = int((~cam.bundle.used).sum())
    alt = f"Residuals of all corners over the picture, in true proportions; {out} corners were left out."
    caption = (
        f"Residuals (measured less predicted) of the {int(cam.bundle.used.sum()):,} corners used, enlarged "
        f"{factor:,g} times, at their places in the picture, u to the right and v down. {coverage_words(cam)}"
    )
    if out:
        caption += " Crosses: corners left out, named by picture and number; the farthest only where they are many."
    return Picture(figure, alt, caption)


def _by_picture(cam: Calibrated) -> Picture:
    rms = picture_rms(cam)
    worst = int(np.argmax(rms))
    alt = (
        f"Root mean square of the residuals of each of {cam.corners.n} pictures, {digits(rms.min())} to "
        f"{digits(rms.max())} pixels; the largest is that of {cam.corners.names[worst]}."
    )
    caption = (
        f"Residuals of every picture. {noise_words(cam)} A picture far above the line was blurred, or its corners were "
        "found badly."
    )
    return Picture(by_picture_figure(cam), alt, caption)


def _certainty(cam: Calibrated) -> Picture | None:
    figure = certainty_figure(cam)
    if figure is None:
        return None
    deviation = certainty(cam)[2]
    low, high = fixed(np.nanmin(deviation), 2), fixed(np.nanmax(deviation), 2)
    alt = f"Map of the standard deviation of where a point is seen, over the picture: {low} to {high} pixels."
    caption = (
        "How well the intrinsics say where a point is seen that is known in the camera frame: standard deviation in "
        f"the worst direction, {low} to {high} pixels. It is the part that all pictures share, as far as the model is "
        "right; it grows where there were no corners."
    )
    return Picture(figure, alt, caption)


def _boards(cam: Calibrated) -> Picture:
    alt = f"Where the board was in the camera frame, from above and from the side. {boards_words(cam)}"
    caption = (
        f"{boards_words(cam)} Boards at several distances and tilts separate the focal length from the distance; "
        "boards that are all parallel to the picture do not."
    )
    return Picture(boards_figure(cam), alt, caption)


def _board(cam: Calibrated) -> Picture | None:
    figure = height_figure(cam)
    if figure is None:
        return None
    sd = 1e3 * cam.board.deviations[:, 2]
    alt = f"Map of the height of the board over its plane. {board_words(cam)}"
    caption = (
        f"{board_words(cam)} Height of the board over the plane nearest to its points (dots), seen from the front, "
        f"with contours in mm; its shape is {cam.shape}. The standard deviation of a height is {fixed(sd.min(), 2)} to "
        f"{fixed(sd.max(), 2)} mm, largest at the rim. board.csv has the points, and the covariance of all of them."
    )
    return Picture(figure, alt, caption)


def _board_residuals(cam: Calibrated) -> Picture:
    figure, factor, before = point_figure(cam)
    after = cam.board_pattern
    words = board_pattern_words(cam)
    alt = f"What the residuals say of each point of the board, from the front. {words}"
    caption = (
        f"{words} Where all pictures together put each point, minus where it was taken to be: arrows within the plane "
        f"of the board, enlarged {factor:,g} times, and colours along z. "
    )
    if before is not None:
        caption += (
            "Left: with the same camera model fitted once more to a flat board, part of whose errors then hide in "
            f"intrinsics and poses ({fixed(before.share, 2)} times the pixel noise). Right: with the board as measured "
            f"({fixed(after.share, 2)} times). "
        )
    chance = 1e3 * np.sqrt(np.mean(after.deviation**2, axis=0))
    caption += (
        "Where the shape is right, arrows and colours have no order: chance makes "
        f"{fixed(chance[0], 2)} mm in x, {fixed(chance[1], 2)} mm in y and {fixed(chance[2], 2)} mm in z (RMS)."
    )
    return Picture(figure, alt, caption)
