"""Sentences of the findings of a camera calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..findings import sentence
from ..formatting.numbers import concise


@sentence("camera.focal_uncertain")
def _(share: float) -> str:
    return (
        f"The focal length is known to {100 * share:.1f} % only, and distances with it: take pictures in which the "
        "board is tilted by 30 degrees and more, or give `intrinsics`."
    )


@sentence("camera.coefficients_near_zero")
def _(coefficients: Sequence[Mapping[str, Any]]) -> str:
    named = "; ".join(f"{one['name']} = {one['value']:.2g} +- {one['std']:.2g}" for one in coefficients)
    return (
        f"The pictures do not tell these coefficients from 0: {named}. Leave them out with `coefficients`, or take "
        "corners nearer to the rim of the picture."
    )


@sentence("camera.corners_left_out")
def _(count: int, n: int) -> str:
    return (
        f"{count} of {n} corners ({100 * count / n:.0f} %) do not fit and were left out: look at the pictures that "
        "`outliers` names."
    )


@sentence("camera.residual_pattern")
def _(share: float, model: str, tried_all: bool = False) -> str:
    advice = (
        "No other model that was tried describes it better: look for blur, glass before the lens, or a rolling shutter."
        if tried_all
        else "Try model 'auto'."
    )
    return (
        f"The residuals have a pattern over the picture, {share:.1f} times the pixel noise: the model {model} is wrong "
        f"for this camera, or the board has another shape. {advice}"
    )


@sentence("camera.board_pattern")
def _(share: float, shape: str) -> str:
    more = ", or the board is bent" if shape == "flat" else ""
    return (
        f"The residuals follow the points of the board, {share:.1f} times the pixel noise: points are printed or "
        f"detected off their places in all pictures alike{more}. Such errors do not average out over pictures, and the "
        "covariance does not contain them."
    )


@sentence("camera.squares_stretched")
def _(stretch: float, std: float) -> str:
    longer = "wider than high" if stretch > 0 else "higher than wide"
    return (
        f"The squares of the board are {concise(100 * abs(stretch), 100 * std)} % {longer}: are they measured along "
        "both directions? The scale of X is that of the mean of both sides."
    )


@sentence("camera.pictures_left_out")
def _(pictures: Sequence[str]) -> str:
    return (
        f"Most corners of {', '.join(pictures)} do not fit any pose of the board, and the whole "
        f"picture{'s were' if len(pictures) > 1 else ' was'} left out: look at how its corners were detected and "
        "numbered."
    )


@sentence("camera.bent_edges")
def _(largest: float, rms: float) -> str:
    return (
        f"Corners were moved by up to {largest:.3f} pixels (RMS {rms:.3f}): where the lens bends edges, they are found "
        "beside where they are."
    )
