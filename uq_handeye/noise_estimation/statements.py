"""What a data set can and cannot tell about its noise, in words."""

from __future__ import annotations

import numpy as np

from ..findings import sentence
from ..formatting.numbers import digits, probability
from ..noise.estimate import CameraFactor, Component, together

# Fewer degrees of freedom than this tell nothing worth saying of the camera's covariance.
TELLING = 4.0
# Probability below which the residuals contradict the camera's covariance.
CONTRADICTION = 1e-4


def noise_statement(
    parts: dict[str, Component], sides: tuple[str, str], rotation_told: bool, sheet: frozenset[str]
) -> tuple[str, ...]:
    """What the data can and cannot tell, in sentences; ``sheet`` names what the data sheet decides."""
    said = []
    sums = [parts[together(what, sides)] for what in ("rotation", "translation")]
    for start, which in (
        ("Told by the data", [part for part in sums if part.name not in sheet]),
        ("From the data sheet", [part for part in sums if part.name in sheet]),
    ):
        if which:
            said.append(f"{start}: {'; '.join(map(_in_words, which))}.")
    rotations = [parts[f"{side} rotation"] for side in sides]
    if not rotation_told:
        said.append(
            f"Rotation of {sides[0]} and of {sides[1]} cannot be told apart: either may be 0, "
            f"{rotations[0].name} is at most {_amount(rotations[0].high, 'rad')} and {rotations[1].name} at most "
            f"{_amount(rotations[1].high, 'rad')}. The noise holds the most likely split."
        )
    elif not all(part.status in ("fixed", "prior") for part in rotations):
        known = any(part.status in ("fixed", "prior") for part in rotations)
        said.append(
            f"Rotation of {sides[0]} and {sides[1]} is told apart by {'the data sheet and ' if known else ''}the lever "
            f"arm of {sides[0]}: {_in_words(rotations[0])}; {_in_words(rotations[1])}."
        )
        for part in rotations:
            if part.low == 0 and part.status != "fixed":
                said.append(
                    f"{part.name.capitalize()} cannot be told from 0; its upper limit is "
                    f"{_amount(part.high, 'rad')}, and the interval is wider than 95 % where the true value is 0."
                )
    else:
        said.append(_both("rotation", rotations, sides, sheet))
    translations = [parts[f"{side} translation"] for side in sides]
    if translations[0].status == "not told apart":
        said.append(
            f"Translation of {sides[0]} and of {sides[1]} cannot be told apart by any data of this kind: both enter "
            "alike, only their sum shows. The noise holds half of the variance on each side. This has no effect on X."
        )
    elif sums[1].name in sheet:
        said.append(_both("translation", translations, sides, sheet))
    else:
        said.append(
            f"The translation noise is split by the data sheet: {'; '.join(map(_in_words, translations))}. The data "
            "tell only the sum."
        )
    return tuple(said)


def beside_camera_statement(parts: dict[str, Component], factor: CameraFactor | None) -> tuple[str, ...]:
    """Of the robot's noise beside a camera covariance from corners, in sentences."""
    sizes = ", ".join(f"{what} {_amount(parts['camera ' + what].value, unit)}" for what, unit in _KINDS)
    said = [
        "The covariance of the camera poses comes from their corners, with the errors of the intrinsics that all poses "
        f"share; of a pose by itself: {sizes}."
    ]
    of_robot = [parts[f"robot {what}"] for what, _ in _KINDS]
    if all(part.status == "zero" for part in of_robot):
        limits = " and ".join(
            f"{what} {_amount(part.high, part.unit)}" for (what, _), part in zip(_KINDS, of_robot, strict=True)
        )
        said.append(
            "The robot shows no noise beside it: the residuals are what the camera's errors make. At most "
            f"{limits} (95 %)."
        )
    else:
        words = [
            f"{part.name} zero (95 %: up to {_amount(part.high, part.unit)})"
            if part.status == "zero"
            else _in_words(part)
            for part in of_robot
        ]
        said.append(f"Beside it the residuals show: {'; '.join(words)}.")
        said += [
            f"{part.name.capitalize()} cannot be told from 0."
            for part in of_robot
            if part.low == 0 and part.status == "estimated"
        ]
    return (*said, camera_factor_words(factor))


_KINDS = (("rotation", "rad"), ("translation", "m"))


def camera_factor_words(factor: CameraFactor | None) -> str:
    """Whether the residuals contradict the camera's covariance."""
    if factor is None or factor.dof < TELLING:
        return "Whether that covariance is true the residuals cannot say: the robot's noise hides the camera's."
    return contradiction_words(factor.value, factor.p_value, factor.dof)


@sentence("noise_estimation.camera_factor")
def contradiction_words(factor: float, p_value: float, dof: float) -> str:
    """How far the residuals would scale the camera's covariance, with what probability."""
    times = float(np.sqrt(factor))
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


def _both(what: str, parts: list[Component], sides: tuple[str, str], sheet: frozenset[str]) -> str:
    how = "follows the data sheet" if all(part.name in sheet for part in parts) else "is estimated with the data sheet"
    return f"{what.capitalize()} of {sides[0]} and {sides[1]} {how}: {'; '.join(map(_in_words, parts))}."


def _amount(value: float | None, unit: str) -> str:
    if value is None or not np.isfinite(value):
        return "not limited"
    return f"{digits(np.rad2deg(value), 2)} deg" if unit == "rad" else f"{digits(value * 1e3, 2)} mm"


def _in_words(part: Component) -> str:
    if part.status == "fixed":
        return f"{part.name} {_amount(part.value, part.unit)} (fixed)"
    if part.high is None:
        return f"{part.name} {_amount(part.value, part.unit)}" if part.low > 0 else part.name
    return (
        f"{part.name} {_amount(part.value, part.unit)} (95 %: {_amount(part.low, part.unit)} to "
        f"{_amount(part.high, part.unit)})"
    )
