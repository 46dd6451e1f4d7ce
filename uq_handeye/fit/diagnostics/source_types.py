"""Types of the sources of a budget: type A, evaluated from the data, and how well their variances are known (JCGM
100).

Type A: noise that was estimated from residuals or corners, with the correlation of neighbouring poses, and a clock
offset that two streams gave. Type B: noise as given or fixed by a data sheet, shared errors with what is assumed of
them. Type A, B: errors of an arm whose standard deviation comes from both, that of the population of such arms and the
residuals. Degrees of freedom are known where the noise was estimated; elsewhere they count as infinite: the variance of
an arm's errors is its mean over what remains open of it, and needs no wider factor (JCGM 101, 6.4.9).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.geometry.se3 import Array
from ...model.noise.estimate import NoiseEstimate
from ...model.noise.models import INTRINSICS, TARGET_SHAPE, Noise
from ...model.shared_errors.shared_error import CLOCK_OFFSET
from .budget import EACH, SHARED, Budget

_PIXELS = "pixel noise"


def with_types(budget: Budget, noise: Noise, estimate: NoiseEstimate | None, from_corners: bool) -> Budget:
    """The budget of a fit with the types of its sources; ``from_corners``: they gave the covariance of camera poses."""
    index: dict[str, int] = {}  # of the variance of a source, among those of the estimate
    data = {CLOCK_OFFSET}
    views = {*_of_side("camera"), f"camera {EACH}", f"camera {SHARED}", INTRINSICS, TARGET_SHAPE}
    if from_corners:
        data |= views
    if estimate is not None:
        given = {part.name for part in estimate.components if part.status in ("fixed", "given")}
        for k, names in enumerate(_variances_of(estimate)):
            index |= {name: k for name in names if name not in given}
        if _PIXELS in index:
            index |= dict.fromkeys(views, index[_PIXELS])
        data |= set(index)
    both = set()
    if estimate is not None:
        both = {part.name for part in estimate.components if part.status == "population"}
    types = tuple("A" if name in data else "A, B" if name in both else "B" for name in budget.sources)
    return replace(budget, types=types, relative=_relative(budget.sources, index, estimate))


def _of_side(side: str) -> list[str]:
    return [f"{side} rotation", f"{side} translation", f"{side} coupling"]


def _variances_of(estimate: NoiseEstimate) -> list[list[str]]:
    """The sources that each of the estimated variances is that of."""
    if estimate.names:
        return [[name] for name in estimate.names]
    if estimate.camera_known or estimate.by_geometry:
        own = ("robot rotation", "robot translation", _PIXELS)
        return [[part.name] for part in estimate.components if part.name in own][: len(estimate.variances)]
    first, second = (part.name.removesuffix(" rotation") for part in estimate.components[1:3])
    return [[f"{first} rotation"], [f"{second} rotation"], [f"{first} translation", f"{second} translation"]]


def _relative(sources: tuple[str, ...], index: dict[str, int], estimate: NoiseEstimate | None) -> Array:
    """Covariances of the variances of the sources, relative to them."""
    R = np.zeros((len(sources), len(sources)))
    if estimate is None:
        return R
    rows_of = [(k, index[name]) for k, name in enumerate(sources) if name in index]
    known = [(k, of) for k, of in rows_of if estimate.variances[of] > 0]
    if known:
        rows, of = np.array(known).T
        v = estimate.variances[of]
        R[np.ix_(rows, rows)] = estimate.covariance[np.ix_(of, of)] / np.outer(v, v)
    return R
