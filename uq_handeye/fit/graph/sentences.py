"""Sentences of the findings about the noise of a data set.

Values hold `ErrorEstimate` as dictionaries of its fields, in rad and m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ...core.levels import RARE
from ...core.presentation.numbers import digits, probability
from ...findings import NOISE, Values, sentence

# What they hold of an `ErrorEstimate`.
Part = Values


@sentence(
    "noise_estimation.exact",
    check=NOISE,
    phrase="residuals at rounding level: the data are exact",
)
def _(parts: Sequence[str]) -> str:
    return (
        f"The residuals in {' and '.join(parts)} are at rounding level: the data are exact, or one file was computed "
        "from the other. Noise cannot be estimated from them. Give the noise."
    )


@sentence("noise_estimation.told_by_data")
def _(components: Sequence[Part]) -> str:
    return f"Estimated from the data: {_list(components)}."


@sentence("noise_estimation.from_data_sheet")
def _(components: Sequence[Part]) -> str:
    return f"From the data sheet: {_list(components)}."


@sentence("noise_estimation.rotation_open")
def _(sides: Sequence[str], components: Sequence[Part]) -> str:
    first, second = components
    return (
        f"Rotation of {sides[0]} and of {sides[1]} cannot be separated: either may be 0, {first['name']} is at most "
        f"{_amount(first['high'], 'rad')} and {second['name']} at most {_amount(second['high'], 'rad')}. The most "
        "likely split is used."
    )


@sentence("noise_estimation.rotation_told")
def _(sides: Sequence[str], components: Sequence[Part], with_data_sheet: bool) -> str:
    return (
        f"Rotation of {sides[0]} and {sides[1]} is separated by {'the data sheet and ' if with_data_sheet else ''}the "
        f"lever arm of {sides[0]}: {_list(components)}."
    )


@sentence("noise_estimation.rotation_near_zero")
def _(component: Part) -> str:
    return (
        f"{component['name'].capitalize()} is consistent with 0. Its upper limit is "
        f"{_amount(component['high'], 'rad')}; where the true value is 0 the interval holds more than 95 %."
    )


@sentence("noise_estimation.with_data_sheet")
def _(what: str, sides: Sequence[str], components: Sequence[Part], decided: bool) -> str:
    how = "follows the data sheet" if decided else "is estimated with the data sheet"
    return f"{what.capitalize()} of {sides[0]} and {sides[1]} {how}: {_list(components)}."


@sentence("noise_estimation.translation_open")
def _(sides: Sequence[str]) -> str:
    return (
        f"Translation of {sides[0]} and of {sides[1]} cannot be separated by data of this kind, which show only their "
        "sum. Each side is given half of the variance. This has no effect on X."
    )


@sentence("noise_estimation.translation_by_data_sheet")
def _(components: Sequence[Part]) -> str:
    return f"The data sheet splits the translation noise: {_list(components)}. The data determine only the sum."


# ------------------------------------------------------------------------------- beside a covariance from corners


@sentence("noise_estimation.camera_from_corners")
def _(rotation: float, translation: float) -> str:
    return (
        "The covariance of the camera poses comes from their corners and includes the errors of the intrinsics, which "
        f"all poses share. Each pose by itself: rotation {_amount(rotation, 'rad')}, translation "
        f"{_amount(translation, 'm')}."
    )


@sentence("noise_estimation.camera_from_points")
def _(rotation: float, translation: float) -> str:
    return (
        "The covariance of the camera poses comes from the measured points of the target. Each pose by itself: "
        f"rotation {_amount(rotation, 'rad')}, translation {_amount(translation, 'm')}."
    )


@sentence("noise_estimation.camera_by_geometry")
def _(component: Part, components: Sequence[Part]) -> str:
    how = {
        "given": "as given",
        "not told apart": "not separable from the robot's noise: assumed, within a factor of 3 of 0.2 px",
    }.get(component["status"], "estimated")
    between = (
        "" if component["status"] == "given" else f", 95 %: {_digits(component['low'])} to {_digits(component['high'])}"
    )
    rotation, translation = (_amount(part["value"], part["unit"]) for part in components)
    return (
        "The covariance of the camera poses comes from the geometry of the views, for a pixel noise of "
        f"{_digits(component['value'])} px ({how}{between}). Each pose by itself: rotation {rotation}, translation "
        f"{translation}."
    )


@sentence(
    "noise_estimation.unusual_pixels",
    check=NOISE,
    phrase=lambda v: f"pixel noise of {digits(v['component']['value'], 2)} px is unusual",
    effect=3,
    rejects=True,
)
def _(component: Part) -> str:
    return (
        f"The residuals indicate a pixel noise of {_digits(component['value'])} px, but corners are found to 0.02 to "
        "0.5 px. Check the board, the unit of its squares, the camera matrix and the pairing of the poses."
    )


@sentence("noise_estimation.robot_shows")
def _(components: Sequence[Part]) -> str:
    words = [
        f"{part['name']} zero (95 %: up to {_amount(part['high'], part['unit'])})"
        if part["status"] == "zero"
        else _words(part)
        for part in components
    ]
    return f"In addition the residuals show: {'; '.join(words)}."


@sentence(
    "noise_estimation.camera_factor",
    check=NOISE,
    phrase=lambda v: f"residuals {digits(math.sqrt(v['factor']), 2)} times what the corners say",
    effect=lambda v: max(math.sqrt(v["factor"]), 1.05),
    rejects=True,
)
def _(factor: float, p_value: float, dof: float) -> str:
    scale, chance = digits(math.sqrt(factor), 2), probability(p_value)
    if p_value > RARE.probability:
        return f"The residuals agree with the camera's covariance (scale {scale}, {chance})."
    return f"The residuals contradict the camera's covariance: its standard deviations need a scale of {scale} " + (
        f"({chance}). Those of X are too small. Check the camera model, the flatness and size of the board, and the "
        "corners."
        if factor > 1
        else f"({chance}). Those of X are too large: the corners are better than their residuals show."
    )


@sentence(
    "noise_estimation.camera_excess",
    check=NOISE,
    phrase=lambda v: f"corners share {digits(v['pixels'], 2)} px of error, included",
    effect=1.2,
)
def _(pixels: float, p_value: float, dof: float, wrong: bool, shifted: bool = False) -> str:
    how = (
        f"each picture was shifted by {_digits(pixels)} px"
        if shifted
        else f"the corners had {_digits(pixels)} px of additional noise"
    )
    text = (
        "The camera poses disagree by more than the residuals of their corners explain, given the robot "
        f"({probability(p_value)}), as if {how}: the corners of one picture share errors. The covariance of X includes "
        "this."
    )
    if not wrong:
        return text
    return (
        f"{text} Check the camera model, the flatness and size of the board, the corners, and the stated accuracy of "
        "the robot."
    )


def _digits(pixels: float | None) -> str:
    return "?" if pixels is None else digits(pixels, 2)


def _amount(value: float | None, unit: str) -> str:
    if value is None:
        return "not limited"
    return f"{digits(math.degrees(value), 2)} deg" if unit == "rad" else f"{digits(value * 1e3, 2)} mm"


def _list(components: Sequence[Part]) -> str:
    return "; ".join(map(_words, components))


def _words(part: Part) -> str:
    name, amount = part["name"], _amount(part["value"], part["unit"])
    if part["status"] == "fixed":
        return f"{name} {amount} (fixed)"
    if part["high"] is None:
        return f"{name} {amount}" if part["low"] > 0 else str(name)
    return f"{name} {amount} (95 %: {_amount(part['low'], part['unit'])} to {_amount(part['high'], part['unit'])})"


@sentence("noise_estimation.size_at_end", check=NOISE, phrase="size of {error}: at the end of its range", effect=1.1)
def _(error: str, of: str, value: float, usual: float, factor: float, declared: bool = False) -> str:
    here, there = (_in_unit(size, of) for size in (value, usual))
    end, was = ("out of the range declared", "declared") if declared else ("to the end of its range", "assumed")
    return (
        f"The data push the size of {error} {end}: {here}, where {there} within a factor of {digits(factor, 2)} was "
        f"{was}. Declare what it is (--size '{error}=SIZE,FACTOR'; sizes in Python)."
    )


@sentence(
    "noise_estimation.size_far_outside",
    check=NOISE,
    phrase=lambda v: f"{v['error']} is {digits(v['value'] / v['usual'], 2)} times what is assumed",
    effect=10,
    remedy="look for a mistake in the files (axes, intrinsics, target), or declare the size: --size",
)
def _(error: str, of: str, value: float, usual: float, factor: float) -> str:
    here, there = (_in_unit(size, of) for size in (value, usual))
    return (
        f"The size of {error} is {here}, where {there} within a factor of {digits(factor, 2)} was assumed. That is no "
        f"noise: axes, intrinsics or the target may be wrong. If it is, declare it (--size '{error}=SIZE,FACTOR')."
    )


@sentence(
    "noise_estimation.sizes_at_low_end",
    check=NOISE,
    phrase=lambda v: f"less than assumed: {len(v['ends'])} sizes at their low ends",
    effect=1.1,
)
def _(ends: Sequence[Part]) -> str:
    found = ", ".join(f"{one['error']} {_in_unit(one['value'], one['of'])}" for one in ends)
    return (
        f"The data have less noise than assumed: they push {len(ends)} sizes of errors to the low ends of their "
        f"ranges ({found}). Declare what they are (--size '{ends[0]['error']}=SIZE,FACTOR'; "
        "sizes in Python)."
    )


@sentence("noise_estimation.absorbed", phrase="{error}: cannot be separated from {unknown}")
def _(
    error: str, unknown: str, turn: float, shift: float, axis: Sequence[float], along: Sequence[float], alone: bool
) -> str:
    mainly = "" if alone else "mainly "
    parts = [
        f"{_amount(size, unit)} {mainly}{how} ({', '.join(f'{round(x, 2) + 0.0:.2f}' for x in way)})"
        for size, unit, how, way in ((turn, "rad", "about", axis), (shift, "m", "along", along))
        if size > (1e-9 if unit == "rad" else 1e-8)
    ]
    return (
        f"{error[:1].upper()}{error[1:]} cannot be separated from {unknown}: it moves all poses as another {unknown} "
        f"would, so the data say nothing of it, and {unknown} is open by its size, {' and '.join(parts)}. A prior of "
        f"{unknown} or a smaller size narrows it."
    )


def _in_unit(value: float, unit: str) -> str:
    if unit in ("rad", "m"):
        return _amount(value, unit)
    return f"{_digits(value)} px" if unit == "px" else f"{digits(1e3 * value, 2)} per mille"
