"""Sentences about what a data set can and cannot tell about its noise.

Values hold `Component` as dictionaries of its fields, in rad and m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..findings import sentence
from ..formatting.numbers import digits, probability

# Probability below which the residuals contradict the camera's covariance.
CONTRADICTION = 1e-4

Part = Mapping[str, Any]


@sentence("noise_estimation.exact")
def _(parts: Sequence[str]) -> str:
    return (
        f"The residuals in {' and '.join(parts)} are at rounding level: these data are exact, or were made from each "
        "other. No noise can be estimated from them; give the noise."
    )


@sentence("noise_estimation.told_by_data")
def _(components: Sequence[Part]) -> str:
    return f"Told by the data: {_list(components)}."


@sentence("noise_estimation.from_data_sheet")
def _(components: Sequence[Part]) -> str:
    return f"From the data sheet: {_list(components)}."


@sentence("noise_estimation.rotation_open")
def _(sides: Sequence[str], components: Sequence[Part]) -> str:
    first, second = components
    return (
        f"Rotation of {sides[0]} and of {sides[1]} cannot be told apart: either may be 0, {first['name']} is at most "
        f"{_amount(first['high'], 'rad')} and {second['name']} at most {_amount(second['high'], 'rad')}. The noise "
        "holds the most likely split."
    )


@sentence("noise_estimation.rotation_told")
def _(sides: Sequence[str], components: Sequence[Part], with_data_sheet: bool) -> str:
    return (
        f"Rotation of {sides[0]} and {sides[1]} is told apart by {'the data sheet and ' if with_data_sheet else ''}the "
        f"lever arm of {sides[0]}: {_list(components)}."
    )


@sentence("noise_estimation.rotation_near_zero")
def _(component: Part) -> str:
    return (
        f"{component['name'].capitalize()} cannot be told from 0; its upper limit is "
        f"{_amount(component['high'], 'rad')}, and the interval is wider than 95 % where the true value is 0."
    )


@sentence("noise_estimation.with_data_sheet")
def _(what: str, sides: Sequence[str], components: Sequence[Part], decided: bool) -> str:
    how = "follows the data sheet" if decided else "is estimated with the data sheet"
    return f"{what.capitalize()} of {sides[0]} and {sides[1]} {how}: {_list(components)}."


@sentence("noise_estimation.translation_open")
def _(sides: Sequence[str]) -> str:
    return (
        f"Translation of {sides[0]} and of {sides[1]} cannot be told apart by any data of this kind: both enter alike, "
        "only their sum shows. The noise holds half of the variance on each side. This has no effect on X."
    )


@sentence("noise_estimation.translation_by_data_sheet")
def _(components: Sequence[Part]) -> str:
    return f"The translation noise is split by the data sheet: {_list(components)}. The data tell only the sum."


@sentence("noise_estimation.interval_too_wide")
def _(names: Sequence[str]) -> str:
    return (
        f"The search for the ends of the interval of {' and of '.join(names)} did not converge: the interval given is "
        "wider than 95 %."
    )


@sentence("noise_estimation.correlated")
def _(
    way: str, against: str, rotation: float, translation: float, length: float, drift: bool, odds: float, growth: float
) -> str:
    size = f"{_amount(rotation, 'rad')} and {_amount(translation, 'm')}"
    if not way.endswith("noise"):
        moves = f"the {way} {'drifts' if drift else 'moves'} against the {against}"
        if way == "camera mount":
            moves += ", which turns the camera about its origin"
        what = f"{moves}, by {size} (1 sigma"
    else:
        what = f"the {way} is correlated, {size} of it (1 sigma"
    over = "slowly, as a random walk" if drift else f"over {digits(length, 2)} poses"
    sure = f"odds {digits(odds, 2)} : 1" if odds < 1e6 else "beyond doubt"
    wider = f"{digits(growth, 2)} times as wide as" if growth >= 1.05 else "hardly wider than"
    return (
        f"Errors of neighbouring poses are correlated: {what}, {over}; {sure}). The covariance of X contains it: its "
        f"standard deviations are {wider} those of independent poses."
    )


# ------------------------------------------------------------------------------- beside a covariance from corners


@sentence("noise_estimation.camera_from_corners")
def _(rotation: float, translation: float) -> str:
    return (
        "The covariance of the camera poses comes from their corners, with the errors of the intrinsics that all poses "
        f"share; of a pose by itself: rotation {_amount(rotation, 'rad')}, translation {_amount(translation, 'm')}."
    )


@sentence("noise_estimation.camera_by_geometry")
def _(component: Part, components: Sequence[Part]) -> str:
    how = {
        "given": "as given",
        "not told apart": "not told apart from the robot's noise: assumed, within a factor of 3 of 0.2 px",
    }.get(component["status"], "estimated")
    between = (
        "" if component["status"] == "given" else f", 95 %: {_digits(component['low'])} to {_digits(component['high'])}"
    )
    rotation, translation = (_amount(part["value"], part["unit"]) for part in components)
    return (
        "The covariance of the camera poses comes from the geometry of the views, for a pixel noise of "
        f"{_digits(component['value'])} px ({how}{between}); of a pose by itself: rotation {rotation}, translation "
        f"{translation}."
    )


@sentence("noise_estimation.pixels_hidden")
def _() -> str:
    return "Whether the pixel noise given is true the residuals cannot say: the robot's noise hides it."


@sentence("noise_estimation.pixels_given")
def _(given: float, factor: float, p_value: float, dof: float) -> str:
    start = (
        f"Left free, the residuals would make the pixel noise {_digits(given * math.sqrt(factor))} px instead of "
        f"{_digits(given)} px ({probability(p_value)}, {dof:.0f} degrees of freedom)"
    )
    if p_value > CONTRADICTION:
        return f"{start}: they do not contradict it."
    return f"{start}: they contradict it, and the standard deviations of X are wrong by up to that. Leave it out."


@sentence("noise_estimation.unusual_pixels")
def _(component: Part) -> str:
    return (
        f"The residuals ask for a pixel noise of {_digits(component['value'])} px, and corners are found to 0.02 "
        "to 0.5 px: the board, the unit of its squares, the camera matrix or the pairing of the poses is wrong."
    )


@sentence("noise_estimation.robot_shows_none")
def _(rotation: float | None, translation: float | None) -> str:
    return (
        "The robot shows no noise beside it: the residuals are what the camera's errors make. At most rotation "
        f"{_amount(rotation, 'rad')} and translation {_amount(translation, 'm')} (95 %)."
    )


@sentence("noise_estimation.robot_shows")
def _(components: Sequence[Part]) -> str:
    words = [
        f"{part['name']} zero (95 %: up to {_amount(part['high'], part['unit'])})"
        if part["status"] == "zero"
        else _words(part)
        for part in components
    ]
    return f"Beside it the residuals show: {'; '.join(words)}."


@sentence("noise_estimation.near_zero")
def _(name: str) -> str:
    return f"{name.capitalize()} cannot be told from 0."


@sentence("noise_estimation.camera_hidden")
def _() -> str:
    return "Whether that covariance is true the residuals cannot say: the robot's noise hides the camera's."


@sentence("noise_estimation.camera_factor")
def _(factor: float, p_value: float, dof: float) -> str:
    times = math.sqrt(factor)
    start = (
        f"Left free, the residuals would make the camera's standard deviations {digits(times, 2)} times as large "
        f"({probability(p_value)}, {dof:.0f} degrees of freedom)"
    )
    if p_value > CONTRADICTION:
        return f"{start}: they do not contradict that covariance."
    return f"{start}: they contradict that covariance. " + (
        "The camera model is wrong, the board is not flat or not as long as given, or corners are wrong: look at "
        "the residuals of the camera. The standard deviations of X are too small."
        if times > 1
        else "The corners are better than their residuals say. The standard deviations of X are too large."
    )


@sentence("noise_estimation.camera_excess")
def _(pixels: float, p_value: float, dof: float, wrong: bool) -> str:
    text = (
        "The robot being known, the camera poses disagree by more than the residuals of their corners say "
        f"({probability(p_value)}, {dof:.0f} degrees of freedom), as if these had {_digits(pixels)} px more of noise: "
        "those of one picture share errors. The covariance of X contains it."
    )
    if not wrong:
        return text
    return (
        f"{text} So much has a cause: the camera model is wrong, the board is not flat or not as long as given, "
        "corners are wrong, or the robot is not as exact as was said."
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


@sentence("noise_estimation.kinematics")
def _(of: str, declared: bool, given: Sequence[str], groups: int) -> str:
    if declared:
        return "The standard deviations of the arm's errors are as declared."
    least = f"those of {of} arms" if len(given) < groups else "those given"
    if given and len(given) < groups:
        least += f" (given: {', '.join(given)})"
    return f"The standard deviations of the arm's errors are at least {least}; the residuals can only raise them."
