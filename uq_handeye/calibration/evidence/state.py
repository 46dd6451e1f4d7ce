"""The posterior of a calibration that new measurements are held against."""

from __future__ import annotations

from typing import Protocol

from ...errors import InputError
from ...fit.likelihood.shared_estimates import SharedEstimate
from ...model.poses.motions import Motions
from ...model.posterior.posterior import Posterior
from ..prediction.predict import Predicting


class Calibrated(Predicting, Protocol):
    """Interface of a calibration, as far as evidence needs it."""

    @property
    def method(self) -> str: ...
    @property
    def shared(self) -> tuple[SharedEstimate, ...]: ...


def posterior_of(result: Calibrated) -> Posterior:
    """Return the joint posterior of X and W; raises `InputError` where there is none, with the reason."""
    if result.opened is not None:
        raise InputError("The motions of this calibration leave a part of X or W open: nothing can be held against it.")
    if result.posterior is None or result.W is None:
        what = "of motions without poses" if isinstance(result.counted, Motions) else f"by method {result.method!r}"
        raise InputError(
            f"Expected a calibration with the joint covariance of X and W, got one {what} without it. Calibrate poses "
            "by method efficient or ml."
        )
    return result.posterior
