"""The posterior of a calibration that new measurements are held against."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..errors import InputError, SingularNoiseError
from ..geometry.se3 import Array
from ..likelihood.constraint import Unknowns, constraint_of
from ..likelihood.gauss_helmert import Fit, fit
from ..likelihood.shared_estimates import SharedEstimate
from ..noise.models import PoseNoise
from ..poses.motions import Motions
from ..poses.pose_pairs import PosePairs
from ..posterior.posterior import Posterior
from ..prediction.predict import Predicting


class Weighted(Protocol):
    """Interface of a pose table, as far as evidence needs it."""

    @property
    def weight(self) -> Array: ...
    @property
    def counted(self) -> list[int]: ...


class Calibrated(Predicting, Protocol):
    """Interface of a calibration, as far as evidence needs it."""

    @property
    def method(self) -> str: ...
    @property
    def shared(self) -> tuple[SharedEstimate, ...]: ...
    @property
    def table(self) -> Weighted | None: ...


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


def refitted(result: Calibrated) -> Fit | None:
    """Return the fit again at the stored estimate, with stored noise and weights; None where the result lacks these."""
    data = result.counted
    if not isinstance(data, PosePairs) or not isinstance(result.noise, PoseNoise) or result.W is None:
        return None
    constraint = constraint_of(data, result.noise)
    weights = None if result.table is None else np.asarray(result.table.weight)[result.table.counted]
    try:
        return fit(constraint, result.noise, Unknowns(result.X, result.W), 1, weights)
    except SingularNoiseError:
        return None
