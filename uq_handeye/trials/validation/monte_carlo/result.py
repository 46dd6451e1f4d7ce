"""Result of a Monte Carlo run: its errors, the covariance that was tested, and the words, figure and file of both."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...._version import __version__
from ....core.files.atomic import json_text, write_atomically
from ....core.files.records import attributes, plain
from ....core.geometry.conventions import CONVENTION
from ....core.geometry.se3 import Array
from ....core.presentation.document import COLUMNS, WIDTH, Document, to_text
from ....core.presentation.notebook import to_html
from ....core.runtime.read_only import ReadOnlyArrays
from ....errors import InputError
from ....findings import Finding
from ....model.noise.models import Noise
from ...simulation.experiment import Experiment
from ..noise_of_data import NoiseOfData, limit
from .consistency import LEVELS, PARTS, Consistency
from .sentences import ALL
from .stopping import Summary
from .text import WHO, monte_carlo_document, verdict

if TYPE_CHECKING:
    import pandas as pd

_FORMAT = "uq-handeye monte carlo 1"


@dataclass(frozen=True, eq=False)
class MonteCarlo(ReadOnlyArrays):
    """Errors of many simulated estimates of X, and the covariance that was put to the test; see `monte_carlo`."""

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
    ended: Finding  # how: all trials done, stable, interrupted, or workers lost (`monte_carlo_sentences`)
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
        """True if it is all that was asked for: all trials, or as stable as wanted."""
        return self.ended.code == ALL if self.stability is None else self.stability.stable

    @property
    def reason(self) -> str:
        """Reason in words why it ended."""
        if self.ended.code == ALL and not self.complete and self.stability is not None:
            return f"{self.ended}, but not stable: {self.stability.reason}"
        return str(self.ended)

    @property
    def ended_early(self) -> bool:
        """True if workers were lost, or the user ended it, before as many trials were done as were asked for."""
        return not self.complete and self.trials < self.asked

    @property
    def rate(self) -> float:
        """Trials per second of this call."""
        return (self.trials - self.resumed) / max(self.seconds, 1e-9)

    @property
    def trials(self) -> int:
        """Trials done, with those that failed."""
        return self.consistency.trials

    @property
    def failures(self) -> int:
        """Trials without an estimate: not converged, or degenerate."""
        return self.consistency.failures

    @property
    def kept(self) -> int:
        """Rows of `errors`: all trials with an estimate up to 1,000,000 trials, whatever the number of trials."""
        return len(self.errors)

    @property
    def covariance(self) -> Array | None:
        """The sampling covariance (6, 6) of xi, from all trials; None with fewer than two."""
        return self.consistency.covariance

    @property
    def std(self) -> Array | None:
        """Sampled standard deviations (6,), rad and m."""
        return self.consistency.std

    @property
    def predicted(self) -> Array | None:
        """The covariance (6, 6) that was tested; the mean over the trials where each had its own."""
        return self.consistency.predicted

    @property
    def bias(self) -> Array | None:
        """Mean error (6,), of second order in the noise."""
        return self.consistency.bias

    @property
    def bias_error(self) -> Array | None:
        """Its standard error (6,)."""
        return self.consistency.bias_error

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
    def eigenvalues(self) -> Array | None:
        """(6,) of sampled against predicted covariance, ascending: ratios of variances."""
        return self.consistency.eigenvalues

    @property
    def consistent(self) -> bool | None:
        """True if the covariance passes all tests; None if no trial gave an estimate."""
        return self.consistency.consistent

    @property
    def verdict(self) -> str:
        """Verdict: consistency of the covariance with the noise, by how much it is wrong, and the limits of the run."""
        with np.errstate(over="ignore"):  # the ratio to a direction without any error is infinite
            return f"{verdict(self.consistency, self.method)} {limit(WHO, self.noise_of_data)}"

    def document(self, verbose: bool = False) -> Document:
        """Return the verdict, its limits and the table of the axes; ``verbose``: everything that is known."""
        with np.errstate(over="ignore"):  # as above
            return monte_carlo_document(self, verbose)

    def __repr__(self) -> str:
        what = {True: "consistent", False: "not consistent", None: "undecided"}[self.consistent]
        return f"MonteCarlo({self.method}, {self.trials:,} trials, {what}{'' if self.complete else ', incomplete'})"

    def _repr_html_(self) -> str:
        """Return the verdict, with everything else folded, for notebooks."""
        return to_html("Monte Carlo", self.document(True))

    def summary(self, verbose: bool = False) -> str:
        """Return the verdict and the table of the axes as text of 80 columns; ``verbose``: everything that is known."""
        return to_text(self.document(verbose), WIDTH if verbose else COLUMNS)

    def __str__(self) -> str:
        return self.summary()

    def figure(self, path: str | Path) -> None:
        """Write a figure, .png or .svg: quantiles of the NEES, standard deviations, coverage.

        Raises `InputError` for another kind of file, or one that cannot be written.
        """
        kind = Path(path).suffix.lower().removeprefix(".")
        if kind not in ("png", "svg"):
            raise InputError(f"Expected a figure to be named .png or .svg, got {str(path)!r}.")
        from ....core.presentation.ellipses import render  # Matplotlib is slow to import
        from .figure import validation_figure

        with np.errstate(over="ignore"):  # as above
            image = render(validation_figure(self), kind)
        write_atomically(path, image)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the single errors as plain numbers, lists and text, with units and convention."""
        c = self.consistency
        return {
            "format": _FORMAT,
            "version": __version__,
            "convention": CONVENTION,
            "units": {"rotation": "rad", "translation": "m", "time": "s"},
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

    def to_json(self, path: str | Path | None = None) -> str:
        """JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one row per axis, in rad and m: what was predicted and what came."""
        import pandas as pd

        c = self.consistency
        columns: dict[str, Any] = {
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
