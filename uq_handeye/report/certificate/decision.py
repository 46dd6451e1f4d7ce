"""Object of a certificate: a result, why nothing is certified where that is so, the decision on a tolerance.

The decision has a guard band, in the terms of JCGM 106.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...calibration.result import Calibration
from ...calibration.statement.headline import NOT_USABLE
from ...calibration.statement.tolerance import MET, Tolerance, Verdict, percent, probability_of
from ...core.files.atomic import json_text
from ...core.formatting.numbers import digits
from ...core.presentation.pdf import PAPERS, page_path, write_page

RULE = (
    f"Decision rule (JCGM 106): PASS if the probability of conformity is at least {percent(MET)}, FAIL if it is at "
    f"most {percent(1 - MET)}, else NOT SHOWN. Never PASS where a check failed or the uncertainty is a lower limit."
)
_STEPS = 40


@dataclass(frozen=True)
class Decision:
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

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and text, in m and rad."""
        band = None
        if self.guard_band is not None:
            band = {"translation": self.guard_band.translation, "rotation": self.guard_band.rotation}
        return self.verdict.to_dict() | {"rule": RULE, "guard_band": band, "margin": self.margin}


def decide(result: Calibration, verdict: Verdict) -> Decision:
    """Return the verdict with its guard band."""
    if verdict.probability is None or result.covariance is None:
        return Decision(verdict, None)
    wanted = verdict.tolerance

    def scaled(factor: float) -> Tolerance:
        move, turn = wanted.translation, wanted.rotation
        return Tolerance(None if move is None else factor * move, None if turn is None else factor * turn, wanted.at)

    low, high = -9.0, 9.0  # powers of 10
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if probability_of(result, scaled(float(10.0**middle))) >= MET:
            high = middle
        else:
            low = middle
    return Decision(verdict, scaled(float(np.power(10.0, high))))


SUFFIXES = (".html", ".pdf", ".json")


class Written:
    """A certificate that is written as a page or as data."""

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain numbers and text."""
        raise NotImplementedError

    def to_html(self) -> str:
        """Return the page as one self-contained HTML text."""
        raise NotImplementedError

    def to_json(self, path: str | Path | None = None) -> str:
        """Return JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def write(self, path: str | Path, *, paper: str = PAPERS[0]) -> Path:
        """Write the certificate; the suffix says which form: .html, .pdf or .json.

        Parameters
        ----------
        path : str or Path
        paper : str
            Of the PDF: "a4" or "letter".

        Raises
        ------
        InputError
            A path with another suffix or that cannot be written.
        MissingExtraError
            A PDF where neither WeasyPrint (extra ``pdf``) nor a Chromium browser is installed.
        """
        target = page_path(path, paper, SUFFIXES)
        if target.suffix.lower() != ".json":
            return write_page(target, self.to_html(), paper)
        self.to_json(target)
        return target


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
