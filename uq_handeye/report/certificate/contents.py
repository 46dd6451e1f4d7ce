"""The result that a certificate is of, and why nothing can be certified where that is so."""

from __future__ import annotations

from dataclasses import dataclass

from ...calibration.result import Calibration
from ...calibration.statement.headline import NOT_USABLE
from .decision import Decision


@dataclass(frozen=True, eq=False)
class Contents:
    """A result with its title block, the decision on a tolerance, and the date of the certificate."""

    result: Calibration
    decision: Decision | None
    issued: str

    @property
    def refusals(self) -> tuple[str, ...]:
        """Reasons why nothing is certified: X is not usable, or has no uncertainty; empty where it is."""
        reasons = [f"{NOT_USABLE}: {reason}" for reason in self.result.reasons]
        if not reasons and self.result.covariance is None:
            reasons = ["the uncertainty of X is not known: no noise was given, and none could be estimated"]
        return tuple(reasons)

    @property
    def certified(self) -> bool:
        """True if X is usable and its uncertainty is known; else the page and the data say why not."""
        return not self.refusals
