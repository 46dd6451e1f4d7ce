"""The decision on a tolerance in the terms of JCGM 106, with its guard band, of each camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from ..calibration.load import Result
from ..calibration.tolerance import MET, NO_VERDICTS, Tolerance, Verdict, Verdicts, percent
from ..core.files.json_values import JsonObject
from ..core.presentation.numbers import digits
from ..core.rounding import SOLUTION_ROUNDING

RULE = (
    f"Decision rule (JCGM 106): PASS if the probability of conformity is at least {percent(MET)}, FAIL if it is at "
    f"most {percent(1 - MET)}, else NOT SHOWN. Never PASS where a check failed or the uncertainty is a lower limit."
)


class Decision(NamedTuple):
    """A verdict with its guard band: the part of the tolerance that the uncertainty takes.

    X is used as estimated, so that the estimate of its error is 0: it is accepted where the tolerance is at least the
    guard band, at which the probability of conformity is 95 %. Length and angle are in the proportion of the tolerance.
    """

    verdict: Verdict
    guard_band: Tolerance | None  # None: the probability is not known

    @property
    def margin(self) -> float | None:
        """Share of the tolerance beyond the guard band; below 0 where the guard band is larger."""
        if self.guard_band is None:
            return None
        wanted = self.verdict.tolerance
        if wanted.translation is not None and self.guard_band.translation is not None:
            return 1.0 - self.guard_band.translation / wanted.translation
        assert wanted.rotation is not None and self.guard_band.rotation is not None
        return 1.0 - self.guard_band.rotation / wanted.rotation

    @property
    def sentence(self) -> str:
        """Guard band, and how it compares with the tolerance."""
        if self.guard_band is None or self.margin is None:
            return ""
        share = 1.0 - self.margin
        compared = f"{digits(share, 2)} times" if share > 1 else f"{digits(100 * share, 2)} % of"
        return f"Guard band: the probability reaches {percent(MET)} at {self.guard_band}, {compared} the tolerance."

    def to_dict(self) -> JsonObject:
        """Return plain numbers and text, in m and rad."""
        band = None
        if self.guard_band is not None:
            band = {"translation": self.guard_band.translation, "rotation": self.guard_band.rotation}
        return self.verdict.to_dict() | {"rule": RULE, "guard_band": band, "margin": self.margin}


def verdicts_by_name(result: Result, verdict: Verdicts | None) -> Mapping[str, Verdict]:
    """Return verdicts by the names of cameras; a single one is of the first."""
    if verdict is None:
        return NO_VERDICTS
    return {result.camera_names[0]: verdict} if isinstance(verdict, Verdict) else verdict


def decide(verdict: Verdict, probability: Callable[[Tolerance], float]) -> Decision:
    """Return the verdict with its guard band; ``probability``: that X lies within a tolerance."""
    if verdict.probability is None:
        return Decision(verdict, None)
    wanted = verdict.tolerance

    def scaled(factor: float) -> Tolerance:
        move, turn = wanted.translation, wanted.rotation
        return Tolerance(None if move is None else factor * move, None if turn is None else factor * turn, wanted.at)

    low, high = -9.0, 9.0  # powers of 10
    while high - low > SOLUTION_ROUNDING:
        middle = 0.5 * (low + high)
        if probability(scaled(float(10.0**middle))) >= MET:
            high = middle
        else:
            low = middle
    return Decision(verdict, scaled(float(np.power(10.0, high))))
