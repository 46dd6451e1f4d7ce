"""Sentences of the findings of a camera calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...core.presentation.numbers import concise, digits, probability
from ...core.presentation.units import DEG_PER_RAD as DEG
from ...findings import CAMERA, sentence


@sentence(
    "camera.focal_uncertain",
    check=CAMERA,
    phrase=lambda v: f"focal length known to {digits(100 * v['share'], 2)} % only",
)
def _(share: float) -> str:
    return (
        f"The focal length, and with it distances, are known to only {100 * share:.1f} %. Take pictures in which the "
        "board is tilted by 30 degrees or more, or give `intrinsics` (--intrinsics)."
    )


@sentence("camera.given_agree", check=CAMERA, phrase="the given intrinsics agree with the pictures")
def _(chi2: float, dof: int, p_value: float) -> str:
    return (
        f"The pictures agree with the given intrinsics (chi-square {digits(chi2, 3)} of {dof}, {probability(p_value)})."
    )


def _with_unit(name: str, value: float, std: float) -> str:
    return concise(value, std, "px" if name in ("fx", "fy", "cx", "cy") else "")


@sentence(
    "camera.given_contradicted",
    check=CAMERA,
    phrase=lambda v: (
        "given intrinsics do not fit: "
        + ", ".join(f"{one['name']} off by {digits(one['given'] - one['wanted'], 2)}" for one in v["contradicted"][:3])
    ),
    effect=lambda v: float(v["sigma"]),
    remedy=lambda v: (
        f"correct the given intrinsics ({v['explanations'][0]})"
        if v["explanations"]
        else "calibrate the camera from the pictures, without --intrinsics"
    ),
    rank=0,
    first=True,
    explains=lambda v: float(v["sigma"]) >= 5.0 and not v["kept"],
)
def _(
    contradicted: Sequence[Mapping[str, Any]],
    sigma: float,
    chi2: float,
    dof: int,
    explanations: Sequence[str],
    kept: bool,
    data: str,
) -> str:
    each = "; ".join(
        f"{one['name']} {digits(one['given'], 6)} given, {_with_unit(one['name'], one['wanted'], one['std'])} wanted "
        f"({digits(abs(one['sigma']), 2)} sigma)"
        for one in contradicted
    )
    why = f" Readings that fit: {'; or '.join(explanations)}." if explanations else ""
    done = (
        "They are kept, as given exact: X is the best for these intrinsics, and belongs to them."
        if kept
        else "Correct the file, leave it out, or keep its numbers by the word exact."
    )
    by = f"{digits(sigma, 2)} sigma, chi-square {digits(chi2, 3)} of {dof}"
    return f"The given intrinsics do not fit the {data} ({by}): {each}.{why} {done}"


@sentence(
    "camera.models_alike",
    check=CAMERA,
    phrase=lambda v: f"{v['lens'].partition(' ')[0]} fits as well, its axis {digits(v['angle'] * DEG, 2)} deg away",
    effect=lambda v: float(v["angle"] / v["std"]),
)
def _(lens: str, angle: float, std: float) -> str:
    return (
        f"The model {lens} fits the pictures as well, and its optical axis lies {digits(angle * DEG, 2)} deg away "
        f"(standard deviation of the axis: {digits(std * DEG, 2)} deg): X turns by as much with it. Use X with the "
        "model and the numbers that are written."
    )


@sentence("camera.given_moved")
def _(how: str) -> str:
    return f"The given intrinsics were brought to the size of the pictures: {how}."


@sentence("camera.corrected_by_robot")
def _() -> str:
    return "The intrinsics are those of pictures and robot poses together, to which X belongs."


@sentence(
    "camera.another_board",
    check=CAMERA,
    phrase=lambda v: f"corners {digits(v['pixels'], 2)} px off: another board?",
    effect=8.0,
)
def _(pixels: float, board: str) -> str:
    what = f"They were read as those of a {board} board. " if board else ""
    return (
        f"The corners are {pixels:.2g} pixels off any camera (RMS): they are hardly those of this board. {what}Check "
        "its kind, columns and rows (--pattern, --board)."
    )


@sentence("camera.coefficients_near_zero", check=CAMERA, phrase="some lens coefficients are not significant")
def _(coefficients: Sequence[Mapping[str, str | float]]) -> str:
    named = "; ".join(f"{one['name']} = {float(one['value']):.2g} +- {float(one['std']):.2g}" for one in coefficients)
    return (
        f"These coefficients are consistent with 0: {named}. Leave them out with `coefficients` (--coefficients), or "
        "take corners nearer to the rim of the picture."
    )


@sentence("camera.corners_left_out", check=CAMERA, phrase="{count} of {n} corners left out")
def _(count: int, n: int) -> str:
    return (
        f"{count} of {n} corners ({100 * count / n:.0f} %) were rejected as outliers. Look at the pictures that "
        "`outliers` names."
    )


@sentence("camera.residual_pattern", check=CAMERA, phrase="residuals have a pattern over the image", effect=1.5)
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


@sentence("camera.board_pattern", check=CAMERA, phrase="residuals follow the points of the board", effect=1.5)
def _(share: float, shape: str) -> str:
    more = ", or the board is bent" if shape == "flat" else ""
    return (
        f"The residuals follow the points of the board, {share:.1f} times the pixel noise: points are printed or "
        f"detected off their places in all pictures alike{more}. Such errors do not average out over pictures, and the "
        "covariance does not include them."
    )


@sentence("camera.squares_stretched", check=CAMERA, phrase="squares wider than high, or higher than wide")
def _(stretch: float, std: float) -> str:
    longer = "wider than high" if stretch > 0 else "higher than wide"
    return (
        f"The squares of the board are {concise(100 * abs(stretch), 100 * std)} % {longer}. Measure them along "
        "both directions. The scale of X is that of the mean of both sides."
    )


@sentence("camera.pictures_left_out", check=CAMERA, phrase=lambda v: f"{len(v['pictures'])} images rejected")
def _(pictures: Sequence[str]) -> str:
    rows = pictures[0].startswith("row ")  # corners without names of pictures
    if len(pictures) == 1:
        start = f"{'The image of' if rows else 'Image'} {pictures[0]} was rejected: most of its corners are"
    else:
        start = (
            f"{'The images of' if rows else 'Images'} {', '.join(pictures)} were rejected: most of their corners are"
        )
    return f"{start} inconsistent with any board pose. Check how the corners were detected and numbered."


@sentence("camera.bent_edges")
def _(largest: float, rms: float) -> str:
    return (
        f"Corners were moved by up to {largest:.3f} pixels (RMS {rms:.3f}), because they are detected off their places "
        "where the lens bends edges."
    )
