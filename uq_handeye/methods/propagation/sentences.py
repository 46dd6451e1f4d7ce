"""The words of what is found of a propagated covariance."""

from __future__ import annotations

from ...core.formatting.numbers import digits
from ...findings import NOISE, sentence


@sentence("propagation.few_data", check=NOISE, phrase="too few data for this method's covariance", effect=3)
def _(method: str, count: int, item: str, enough: int) -> str:
    return (
        f"The covariance of method {method!r} is valid for many data. With {count} {item} it may be wrong by a large "
        f"factor. Take at least {enough}."
    )


@sentence("propagation.precise_residuals", check=NOISE, phrase="this method's covariance may be too small", effect=3)
def _(method: str, share: float) -> str:
    return (
        f"The covariance of method {method!r} may be too small by a large factor: in one direction {share:.0%} of the "
        "information about X comes from residuals that are known better than X itself, to which its limit of many data "
        "does not apply. Check it by Monte Carlo simulation, or use another method."
    )


@sentence("propagation.curved", check=NOISE, phrase="first order is not enough for this method", effect=3)
def _(method: str, bend: float) -> str:
    return (
        f"The first-order covariance of method {method!r} may be wrong by a large factor. The rotation of X is so "
        f"uncertain that the translation follows it along a curve, {digits(bend, 2)} standard deviations off a "
        "straight line. Add motions that rotate about other axes, or use sigma points."
    )
