"""What a camera calibration finds, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..findings import sentence


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
def _(share: float, model: str) -> str:
    return (
        f"The residuals have a pattern over the picture, {share:.1f} times the pixel noise: the model {model} is wrong "
        "for this camera, or the board is not flat. Try model 'auto'."
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
