"""Checks of the noise that a validation draws, against its data.

A validation draws the noise that is given or estimated and tests whether a covariance follows from it. It cannot tell
whether that noise is the noise of these data; their residuals can. A calibration has tested them (its ``checks``). For
poses or motions alone, the residuals of maximum likelihood are compared with the noise (`goodness_of_fit`).
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from math import log
from typing import Any, Protocol

import numpy as np

from ...core.formatting.numbers import digits, probability
from ...core.presentation.document import Block, Checks, Paragraph
from ...errors import InputError, NotConvergedError
from ...findings import GROSS
from ...fit.likelihood.gauss_helmert import maximum_likelihood
from ...fit.likelihood.goodness_of_fit import GoodnessOfFit, goodness_of_fit
from ...model.noise.models import Noise
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs

# A ratio of residuals to noise that chance hardly ever makes, and one that matters.
UNLIKELY, MATTERS = 1e-3, 1.1
# Ratio below which the residuals are rounding.
EXACT = 1e-6


@dataclass(frozen=True)
class NoiseCheck:
    """One check of data and noise: name, status ("ok", "caution", "failed", "not run"), short phrase."""

    name: str
    status: str
    text: str


class AnyCheck(Protocol):
    """A check of a calibration (`statement.Check`), which stands above this package."""

    @property
    def name(self) -> str: ...
    @property
    def status(self) -> str: ...
    @property
    def text(self) -> str: ...


@dataclass(frozen=True)
class NoiseOfData:
    """Checks of the data of a validation, and of the noise against them."""

    checks: tuple[NoiseCheck, ...]
    by: str  # "calibrate", or "residuals" where there is no calibration
    stated: tuple[float, float] | None = None  # m, rad: sd in the worst direction by a calibration with open sizes

    @property
    def part(self) -> str:
        """Return which part of what calibrate states a validation speaks of, as a sentence; empty where it is all."""
        return part_of("noise of known sizes", self.stated)

    @property
    def doubtful(self) -> tuple[NoiseCheck, ...]:
        """Checks that contradict the noise, failed ones first."""
        return tuple(check for status in ("failed", "caution") for check in self.checks if check.status == status)

    def __str__(self) -> str:
        """Return one sentence: what contradicts the noise on these data, or that nothing does."""
        doubtful = self.doubtful
        if doubtful:
            listed = "; ".join(f"{check.text} ({check.name}: {check.status})" for check in doubtful[:2])
            more = f"; and {len(doubtful) - 2} more" if len(doubtful) > 2 else ""
            return f"{self.warns} {listed}{more}."
        if any(check.status == "ok" for check in self.checks):
            whose = "calibrate found nothing against it" if self.by == "calibrate" else "the residuals agree with it"
            return f"On these data {whose}."
        return f"On these data it was not checked: {self.checks[0].text}."

    @property
    def warns(self) -> str:
        """Words before the checks that warn."""
        return f"On these data {'calibrate warns' if self.by == 'calibrate' else 'the residuals contradict it'}:"

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        stated = {} if self.stated is None else {"stated": list(self.stated)}
        return {"by": self.by, "sentence": str(self), "checks": [asdict(check) for check in self.checks]} | stated


def part_of(what: str, stated: tuple[float, float] | None) -> str:
    """Return a sentence with what is spoken of, beside what a calibration with open sizes states; empty without it."""
    if stated is None:
        return ""
    move, turn = digits(1e3 * stated[0], 2), digits(float(np.degrees(stated[1])), 2)
    return (
        f" It speaks of {what}; calibrate, which does not know them, states {move} mm and {turn} deg in all (1 sigma, "
        "worst direction)."
    )


def noise_of_data(data: object, used: PosePairs | Motions, noise: Noise | None, estimated: bool) -> NoiseOfData:
    """Return what the data say about the noise.

    Parameters
    ----------
    data : PosePairs, Motions or Calibration
        As the validation was given it; a calibration brings its own checks.
    used : PosePairs or Motions
        The data themselves.
    noise : PoseNoise, PairNoise or None
        The noise that is drawn; None is not checked.
    estimated : bool
        Whether it was estimated from the same data.
    """
    found: Iterable[AnyCheck] | None = getattr(data, "checks", None)
    if found is not None:
        checks = tuple(NoiseCheck(check.name, check.status, check.text) for check in found)
        return NoiseOfData(checks, "calibrate", stated_of(data) if estimated else None)
    return NoiseOfData((_level(used, None if estimated else noise),), "residuals")


def stated_of(result: Any) -> tuple[float, float] | None:
    """Return what a calibration with open sizes states of X (m, rad), where that is more than noise of known sizes
    makes; None also for data without one.
    """
    S, known = getattr(result, "covariance", None), getattr(result, "bound", None)
    if S is None or known is None or np.allclose(S, known, rtol=1e-6):
        return None
    turn, move = (float(np.sqrt(np.linalg.eigvalsh(S[part, part])[-1])) for part in (slice(0, 3), slice(3, 6)))
    return move, turn


def _level(data: PosePairs | Motions, noise: Noise | None) -> NoiseCheck:
    """Return whether the residuals have the size that the noise explains."""
    fit: GoodnessOfFit | None = None
    if noise is None:
        return NoiseCheck("noise level", "not run", "the noise was estimated from the same residuals")
    with suppress(InputError, NotConvergedError, np.linalg.LinAlgError):
        fit = goodness_of_fit(maximum_likelihood(data, noise))
    if fit is None:
        return NoiseCheck("noise level", "not run", "these data have no residuals to compare it with")
    if fit.sigma0 < EXACT:
        return NoiseCheck("noise level", "not run", "the data are exact, simulated without noise")
    p = 1.0 if fit.p_value is None else fit.p_value
    if p > UNLIKELY or abs(log(fit.sigma0)) < log(MATTERS):
        return NoiseCheck("noise level", "ok", f"the residuals agree with it ({probability(p, 2)})")
    larger = fit.sigma0 > 1
    ratio = digits(fit.sigma0 if larger else 1 / fit.sigma0, 2)
    text = f"residuals {ratio} times {'larger' if larger else 'smaller'} than this noise"
    return NoiseCheck("noise level", "failed" if fit.sigma0 > GROSS else "caution", text)


def limit(who: str, found: NoiseOfData | None) -> str:
    """Return what a validation cannot tell, and what the data say about it, in one paragraph."""
    text = f"{who} cannot tell whether the noise is right."
    return text if found is None else f"{text}{found.part} {found}"


def limit_blocks(who: str, found: NoiseOfData | None, verbose: bool) -> list[Block]:
    """Return the same with one line for each check that warns; ``verbose``: for each check."""
    if found is None or not (verbose or found.doubtful):
        return [Paragraph(limit(who, found))]
    shown = found.checks if verbose else found.doubtful
    said = found.warns if found.doubtful else str(found)
    return [
        Paragraph(f"{who} cannot tell whether the noise is right.{found.part} {said}"),
        Checks([(check.status, check.name, check.text) for check in shown]),
    ]
