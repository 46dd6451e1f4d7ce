"""Result of a Monte Carlo run: its errors, the covariance that was tested, and their text, figure and file."""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ....core.files.json_values import JsonObject
from ....core.files.records import attributes, plain
from ....core.geometry.se3 import Array
from ....core.presentation.document import Answer, Block, Document, Paragraph, document_of
from ....core.presentation.numbers import digits
from ....core.read_only import ReadOnlyArrays
from ....findings import Finding
from ....model.errors.models import Noise
from ...simulation.experiment import Experiment
from ..outcome import NoiseOfData, Outcome, limit, limit_blocks
from ..sentences import ALL
from .consistency import LEVELS, PARTS, Consistency
from .stopping import Summary
from .text import SECTIONS, WHO, answer, details, failures, few_axes, few_numbers, verdict

if TYPE_CHECKING:
    import pandas as pd


def _statistic(name: str, text: str) -> Any:
    """Return the property of a run that is one of its `Consistency`."""
    return property(attrgetter(f"consistency.{name}"), doc=text)


@dataclass(frozen=True, eq=False)
class MonteCarlo(Outcome, ReadOnlyArrays):
    """Errors of many simulated estimates of X, and the covariance that was put to the test; see `monte_carlo`."""

    title: ClassVar[str] = "Monte Carlo"
    kind: ClassVar[str] = "monte carlo"

    experiment: Experiment  # true data, noise and method
    frame: str  # of X, e.g. gripper_T_camera
    setup: str | None  # None for motions
    origin: str  # "truth of the simulation" or "fit to the data"
    noise_estimated: bool
    seed: int
    chunk: int  # trials that share a seed sequence
    asked: int  # trials, at most
    tested: str  # "first order": of the method at the truth; "each": of every trial by itself; "given"
    errors: Array  # (kept, 6) of the first trials that gave an estimate
    consistency: Consistency
    stability: Summary | None  # where digits were asked for
    ended: Finding  # how: all trials done, stable, interrupted, or workers lost (`sentences`)
    seconds: float  # of this call
    resumed: int = 0  # trials that were there already
    notes: tuple[str, ...] = field(default=())  # what else happened, e.g. chunks that were damaged
    noise_of_data: NoiseOfData | None = None  # checks of the noise that was drawn against the data

    @property
    def method(self) -> str:
        """Method that was run on every trial."""
        return self.experiment.method

    @property
    def noise(self) -> Noise:
        """Noise that was drawn."""
        return self.experiment.noise

    @property
    def complete(self) -> bool:
        """True if all trials are done, or the result is as stable as requested."""
        return self.ended.code == ALL if self.stability is None else self.stability.stable

    @property
    def reason(self) -> str:
        """Reason in words why it ended."""
        if self.ended.code == ALL and not self.complete and self.stability is not None:
            return f"{self.ended}, but not stable: {self.stability.reason}"
        return str(self.ended)

    @property
    def ended_early(self) -> bool:
        """True if workers were lost, or the user ended it, before all trials were done."""
        return not self.complete and self.trials < self.asked

    @property
    def rate(self) -> float:
        """Trials per second of this call."""
        return float((self.trials - self.resumed) / max(self.seconds, 1e-9))

    trials = _statistic("trials", "Trials done, with those that failed.")
    failures = _statistic("failures", "Trials without an estimate: not converged, or degenerate.")
    covariance = _statistic("covariance", "Sampling covariance (6, 6) of xi, of all trials; None with fewer than two.")
    std = _statistic("std", "Sampled standard deviations (6,), rad and m.")
    predicted = _statistic("predicted", "Covariance (6, 6) tested; the mean over the trials where each had its own.")
    bias = _statistic("bias", "Mean error (6,), of second order in the noise.")
    bias_error = _statistic("bias_error", "Standard error (6,) of the bias.")
    eigenvalues = _statistic("eigenvalues", "(6,) of sampled against predicted covariance, ascending: variance ratios.")
    consistent = _statistic("consistent", "True if the covariance passes all tests; None if no trial gave an estimate.")

    @property
    def kept(self) -> int:
        """Rows of `errors`: all trials with an estimate up to 1,000,000 trials, whatever the number of trials."""
        return len(self.errors)

    @property
    def mean_nees(self) -> float | None:
        """Mean of ``xi^T P^-1 xi``, P the covariance tested; 6 if that is true."""
        return None if self.consistency.mean_nees is None else float(self.consistency.mean_nees[0])

    @property
    def nees(self) -> dict[str, tuple[float, float, float]]:
        """Mean NEES by part (joint, rotation, translation), and the interval in which a consistent covariance
        has it.
        """
        mean, interval = self.consistency.mean_nees, self.consistency.nees_interval
        if mean is None or interval is None:
            return {}
        return {
            part: (float(value), float(low), float(high))
            for part, value, (low, high) in zip(PARTS, mean, interval, strict=True)
        }

    @property
    def coverage(self) -> dict[float, float]:
        """Share of trials, by level, whose error lies in the ellipsoid of that level, all six components."""
        shares = self.consistency.coverage
        return {} if shares is None else dict(zip(LEVELS, map(float, shares[0]), strict=True))

    @property
    def verdict(self) -> str:
        """Verdict: consistency of the covariance with the noise, by how much it is wrong, and the limits of the run."""
        with np.errstate(over="ignore"):  # the ratio to a direction without any error is infinite
            return f"{verdict(self.consistency, self.method)} {limit(WHO, self.noise_of_data)}"

    def __repr__(self) -> str:
        what = {True: "consistent", False: "not consistent", None: "undecided"}[self.consistent]
        return f"MonteCarlo({self.method}, {self.trials:,} trials, {what}{'' if self.complete else ', incomplete'})"

    def to_dict(self) -> JsonObject:
        """Everything but the single errors as plain numbers, lists and text, with units and convention."""
        c = self.consistency
        return {
            **self.head(time="s"),
            **attributes(
                self,
                "method frame setup origin noise noise_estimated n=experiment.count seed chunk asked trials failures "
                "kept complete reason ended seconds resumed notes tested",
            ),
            **attributes(c, "confidence"),
            **attributes(self, "consistent verdict noise_of_data"),
            **attributes(c, "rejected p_values"),
            **attributes(self, "predicted covariance std bias bias_error"),
            **attributes(c, "bias_p_value"),
            "parts": list(PARTS),
            **attributes(c, "mean_nees nees_interval"),
            "levels": list(LEVELS),
            **attributes(c, "coverage coverage_interval eigenvalues eigenvalue_interval likelihood_ratio kurtosis"),
            "stability": None if self.stability is None else {**plain(self.stability), "reason": self.stability.reason},
        }

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one row per axis, in rad and m: what was predicted and what came."""
        import pandas as pd

        c = self.consistency
        columns: dict[str, Array | list[str] | None] = {
            "axis": [f"{part}_{axis}" for part in ("rotation", "translation") for axis in "xyz"],
            "unit": ["rad"] * 3 + ["m"] * 3,
            "std_predicted": c.predicted_std,
            "std_sampled": c.std,
        }
        if c.std_ratio_interval is not None:
            columns |= {"ratio": c.std / c.predicted_std}  # type: ignore[operator]
            columns |= {"ratio_low": c.std_ratio_interval[:, 0], "ratio_high": c.std_ratio_interval[:, 1]}
        columns |= {"bias": c.bias, "bias_error": c.bias_error}
        return pd.DataFrame(columns)


@document_of.register(MonteCarlo)
def monte_carlo_document(result: MonteCarlo, verbose: bool = False) -> Document:
    """Return the verdict, its limits and the table of the axes; ``verbose``: everything that is known."""
    c = result.consistency
    start: list[Block] = []
    if not result.complete:
        reason = f"NOT COMPLETE: {result.reason}".rstrip(" :")
        start.append(Paragraph(f"{reason}. The numbers are those of the trials so far."))
    start.append(Answer(answer(c, result.experiment.method), _status(result)))
    start += [Paragraph(text) for text in details(c, verbose)]
    start += limit_blocks(WHO, result.noise_of_data, verbose)
    how = f"{heading(result)}. Noise was drawn around the {result.origin}. {failures(c)} {digits(result.seconds)} s"
    how += f", {result.rate:,.0f} trials/s." if result.rate else "."
    how += f" Ended: {result.reason}." if verbose and result.complete and result.reason else ""
    end: list[Block] = [Paragraph(how), *(Paragraph(f"Note: {note}") for note in result.notes)]
    if not verbose:
        return [start, few_axes(c), [*few_numbers(c), *end]]
    return [start, *(section(c) for section in SECTIONS), end]


def _status(result: MonteCarlo) -> str:
    """Return the status of the verdict, for its colour."""
    c, found = result.consistency, result.noise_of_data
    if c.rejected and not c.harmless:
        return "failed"
    return "caution" if c.consistent is not True or not result.complete or (found and found.doubtful) else "ok"


def heading(result: MonteCarlo) -> str:
    """Describe what was run."""
    count = result.consistency.trials
    trials = f"{count:,} {'trial' if count == 1 else 'trials'}"
    return f"Monte Carlo of {result.frame} by {result.experiment.method}: {trials}, seed {result.seed}"
