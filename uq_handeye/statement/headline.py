"""The headline: how accurate X is in one sentence, or that it cannot be used and why."""

from __future__ import annotations

import numpy as np

from ..formatting.numbers import digits
from .accuracy import Accuracy, accuracy_of, amounts
from .checks import reasons_of
from .stated import Stated

NOT_USABLE = "NOT USABLE"


def headline_of(result: Stated) -> str:
    """Return the headline of a calibration."""
    if reasons := reasons_of(result):
        return f"{NOT_USABLE}: {reasons[0]}."
    accuracy = accuracy_of(result)
    if accuracy is None:
        return f"The accuracy of {result.frame} is not known: no noise was given, and none could be estimated."
    if result.opened is not None and result.opened.of_X.size:
        known = f"{amounts(accuracy.translation, accuracy.rotation)} (1 sigma, worst direction that is known)"
        return f"{result.frame} is known to {known}. Not determined: {'; '.join(result.open_words)}."
    known = f"{amounts(accuracy.translation, accuracy.rotation)} (1 sigma, worst direction)"
    return f"{result.frame} is known to {known}; {_ahead(accuracy)}."


def _ahead(accuracy: Accuracy) -> str:
    """Return how well a point at the distance of the target is known."""
    far = f"{digits(accuracy.distance, 3)} m"
    point = f"{digits(1e3 * accuracy.point, 2)} mm" if np.isfinite(accuracy.point) else "not determined"
    if accuracy.distance_known:
        return f"a point at the target's distance, {far}, to {point}"
    return f"a point {far} ahead of the camera to {point}"
