"""What `calibrate` finds beyond the checks that it calls, in words. Values are in rad and m."""

from __future__ import annotations

import math

from ..findings import sentence
from ..formatting.numbers import digits


@sentence("calibration.data_sheet_contradicted")
def _(rotation: float, translation: float, p_value: float) -> str:
    return (
        f"The rotation residuals are {_times(rotation)}, the translation residuals {_times(translation)} than the "
        f"noise taken from the data sheet explains (chi-square test, p = {p_value:.1g}): it is not that of these data, "
        "and the standard deviations of X are wrong by up to that."
    )


def _times(ratio: float) -> str:
    return f"{ratio:.2g} times larger" if ratio > 1 else f"{1 / ratio:.2g} times smaller"


@sentence("calibration.bundle_differs")
def _(distance: float, largest: float, variance_low: float, variance_high: float) -> str:
    return (
        f"Bundle adjustment and method 'efficient' differ by {digits(distance, 2)} standard deviations of X (at most "
        f"{digits(largest, 2)} in one component); variances are {variance_low:.3f} to {variance_high:.3f} times as "
        "large. They should agree to first order: errors are too large for that, or wrong poses or corners spoil one "
        "of them."
    )


@sentence("calibration.unweighted")
def _() -> str:
    return (
        "The noise given makes a part of the data exact, so that they cannot be weighted by its inverse: X is that of "
        "method '4dpa', which does not weight and does not look for outliers. Give the poses of one side a rotation "
        "and a translation deviation above 0 for the estimate of least variance."
    )


@sentence("calibration.robust_failed")
def _(error: str) -> str:
    return f"All poses count in full, and outliers bias X: robust weights were not found. {error}"


@sentence("calibration.robust_skipped")
def _() -> str:
    return (
        "Wrong poses were not looked for, and any of them spoil X: the poses that agree with each other do not "
        "determine X by themselves, all together do. Add poses that turn about other axes."
    )


@sentence("calibration.few_for_outliers")
def _(item: str, count: int, needed: int) -> str:
    return f"With {count} {item}s a wrong one cannot be told from the others: take at least {needed}."


@sentence("calibration.near_half_turn")
def _(angle: float) -> str:
    return (
        f"X turns by {math.degrees(angle):.1f} degrees. The Rodrigues vector that Tsai's method solves for grows "
        "without bound at 180 degrees, and so do its errors: use another method."
    )


@sentence("calibration.no_covariance")
def _(covariance: str) -> str:
    return f"There is no covariance {covariance!r}: without noise there is nothing to make it of."


@sentence("calibration.noise_not_estimated")
def _(error: str) -> str:
    return error
