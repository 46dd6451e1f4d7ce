"""Sentences of the findings about a propagated covariance."""

from ..findings import NOISE, sentence

sentence(
    "propagation.few_data",
    "The covariance of method {method!r} is valid for many data. With {count} {item} it may be wrong by a large "
    "factor. Take at least {enough}.",
    check=NOISE,
    phrase="too few data for this method's covariance",
    effect=3,
)
sentence(
    "propagation.precise_residuals",
    "The covariance of method {method!r} may be too small by a large factor: in one direction {share:.0%} of the "
    "information about X comes from residuals that are known better than X itself, to which its limit of many data "
    "does not apply. Check it by Monte Carlo simulation, or use another method.",
    check=NOISE,
    phrase="this method's covariance may be too small",
    effect=3,
)
sentence(
    "propagation.curved",
    "The first-order covariance of method {method!r} may be wrong by a large factor. The rotation of X is so uncertain "
    "that the translation follows it along a curve, {bend:~2} standard deviations off a straight line. Add motions "
    "that rotate about other axes, or take the covariance that Monte Carlo samples (uq-handeye validate).",
    check=NOISE,
    phrase="first order is not enough for this method",
    effect=3,
)
