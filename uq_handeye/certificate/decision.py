"""The decision on a tolerance with its guard band, in the terms of JCGM 106."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..calibration.result import Calibration
from ..formatting.numbers import digits
from ..statement.tolerance import MET, PASS, Tolerance, Verdict, percent, probability_within

RULE = (
    f"Decision rule (JCGM 106): PASS if the probability of conformity is at least {MET:.0%}, FAIL if it is at most "
    f"{1 - MET:.0%}, else NOT SHOWN. Never PASS where a check failed or the uncertainty is a lower limit."
)
_STEPS = 40


@dataclass(frozen=True)
class Decision:
    """A verdict with the smallest tolerance, in the same proportion, at which the probability reaches 95 %."""

    verdict: Verdict
    smallest: Tolerance | None  # None: the probability is not known

    @property
    def guard(self) -> float | None:
        """Share of the tolerance that the uncertainty leaves; below 0 where it takes more than there is."""
        if self.smallest is None:
            return None
        wanted = self.verdict.tolerance
        if wanted.translation is not None and self.smallest.translation is not None:
            return 1.0 - self.smallest.translation / wanted.translation
        assert wanted.rotation is not None and self.smallest.rotation is not None
        return 1.0 - self.smallest.rotation / wanted.rotation

    @property
    def sentence(self) -> str:
        """Smallest tolerance that is met, and the margin to it."""
        if self.smallest is None or self.guard is None:
            return ""
        text = f"A probability of {percent(MET)} is reached at a tolerance of {self.smallest}"
        if self.guard > 0:
            margin = "margin (guard band)" if self.verdict.word == PASS else "margin"
            return f"{text}: a {margin} of {digits(100 * self.guard, 2)} % of the tolerance."
        return f"{text}, {digits(1.0 - self.guard, 2)} times what is asked for."

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and text, in m and rad."""
        smallest = None
        if self.smallest is not None:
            smallest = {"translation": self.smallest.translation, "rotation": self.smallest.rotation}
        return self.verdict.to_dict() | {"rule": RULE, "smallest_tolerance": smallest, "guard": self.guard}


def decide(result: Calibration, verdict: Verdict) -> Decision:
    """Return the verdict with the smallest tolerance that is met."""
    if verdict.probability is None or result.covariance is None:
        return Decision(verdict, None)
    wanted, S, R = verdict.tolerance, result.covariance, result.X[:3, :3]

    def scaled(factor: float) -> Tolerance:
        move, turn = wanted.translation, wanted.rotation
        return Tolerance(None if move is None else factor * move, None if turn is None else factor * turn, wanted.at)

    low, high = -9.0, 9.0  # powers of 10
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if probability_within(S, result.reference, scaled(float(10.0**middle)), R) >= MET:
            high = middle
        else:
            low = middle
    return Decision(verdict, scaled(float(np.power(10.0, high))))
