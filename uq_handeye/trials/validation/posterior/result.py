"""Convergence of a chain: autocorrelation time, split R-hat and effective sample size, all of them.

For each coordinate, over the walkers and the steps kept:

- *autocorrelation time* tau (steps): emcee's estimate, averaged over walkers (Goodman and Weare 2010); the chain must
  be 50 tau long for it to be trusted;
- *split R-hat*, rank-normalised, bulk and folded (Vehtari et al. 2021, doi:10.1214/20-BA1221), by ArviZ: below 1.01;
- *effective sample size*, bulk and tail (the smaller of the 5 % and the 95 % quantile), by ArviZ: at least as many as
  asked.

The walkers of an ensemble move depend on each other through it; that they are taken as chains is customary, and tau is
the check that does not need it.

The sampled posterior.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ....core.files.atomic import write_atomically
from ....core.files.records import attributes
from ....core.formatting.numbers import digits
from ....core.geometry.checks import is_number
from ....core.geometry.conventions import CONVENTION
from ....core.geometry.se3 import Array
from ....core.presentation.document import Block, Document, Paragraph, Table, document_of, to_text
from ....core.runtime.read_only import ReadOnlyArrays
from ....errors import InputError, MissingExtraError, NotConvergedError
from ....findings import Finding
from ....model.noise.models import Noise
from ..monte_carlo.sums import LEVELS, UNITS
from ..outcome import Outcome, part_of
from .density import ScalePrior

LONGEST_R_HAT = 1.01
LENGTHS = 50  # of the autocorrelation time


@dataclass(frozen=True, eq=False)
class PosteriorDiagnostics(ReadOnlyArrays):
    """Diagnostics of how well a chain represents its posterior; arrays (d,) follow ``names``. NaN is "not known"."""

    names: tuple[str, ...]
    autocorrelation_time: Array  # steps
    r_hat: Array
    ess_bulk: Array
    ess_tail: Array
    acceptance: float  # share of proposals accepted
    walkers: int
    steps: int  # kept, of each walker
    burn_in: int  # steps before
    asked: int  # effective samples

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Criteria that are not fulfilled; empty if the chain has converged."""
        found = []
        values: dict[str, Any]
        longest = float(self.autocorrelation_time.max())  # NaN if any is
        if not self.steps >= LENGTHS * longest:
            values = {"steps": self.steps, "lengths": LENGTHS, "autocorrelation_time": _known(longest)}
            found.append(Finding("posterior.short_chain", "failure", values))
        if not (self.r_hat < LONGEST_R_HAT).all():
            k = int(np.argmax(self.r_hat))  # that of a NaN if there is one
            values = {"name": self.names[k], "r_hat": _known(self.r_hat[k]), "limit": LONGEST_R_HAT}
            found.append(Finding("posterior.r_hat", "failure", values))
        for effective, part in ((self.ess_bulk, "bulk"), (self.ess_tail, "tail")):
            if not (effective >= self.asked).all():
                k = int(np.argmin(effective))
                values = {"part": part, "name": self.names[k], "effective": _known(effective[k]), "asked": self.asked}
                found.append(Finding("posterior.few_samples", "failure", values))
        return tuple(found)

    @property
    def faults(self) -> tuple[str, ...]:
        """The same in words."""
        return tuple(map(str, self.findings))

    @property
    def converged(self) -> bool:
        return not self.findings

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; None for what is not known."""
        return attributes(
            self,
            "names autocorrelation_time r_hat ess_bulk ess_tail acceptance walkers steps burn_in asked converged "
            "faults findings",
        )


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def autocorrelation_time(chain: Array) -> Array:
    """tau (d,) in steps of a chain (steps, walkers, d); NaN where a walker never moved or there are too few steps."""
    from emcee.autocorr import integrated_time

    if len(chain) < 4 or (np.ptp(chain, axis=0) == 0).any():
        return np.full(chain.shape[-1], np.nan)
    return np.asarray(integrated_time(chain, tol=0, quiet=True))


def diagnose(chain: Array, names: tuple[str, ...], acceptance: float, burn_in: int, asked: int) -> PosteriorDiagnostics:
    """All of them, of a chain (steps, walkers, d)."""
    steps, walkers, d = chain.shape
    tau = autocorrelation_time(chain)
    r_hat, bulk, tail = (np.full(d, np.nan) for _ in range(3))
    if steps >= 4:
        r_hat, bulk, tail = by_arviz(chain)
    return PosteriorDiagnostics(names, tau, r_hat, bulk, tail, acceptance, walkers, steps, burn_in, asked)


def by_arviz(chain: Array) -> tuple[Array, Array, Array]:
    """Split R-hat, bulk and tail ESS (d,)."""
    from arviz_stats import base

    stats: Any = base.array_stats  # type: ignore[attr-defined]
    of_walkers = {"chain_axis": 1, "draw_axis": 0}
    return (
        stats.rhat(chain, method="rank", **of_walkers),
        stats.ess(chain, method="bulk", **of_walkers),
        stats.ess(chain, method="tail", prob=(0.05, 0.95), **of_walkers),
    )


def inference_data(chain: Array, names: tuple[str, ...], log_density: Array | None = None) -> Any:
    """ArviZ's ``InferenceData`` (before 1.0) or ``DataTree``: a variable per coordinate, a chain per walker."""
    az = arviz()
    by_walker = np.swapaxes(chain, 0, 1)
    groups: dict[str, Any] = {"posterior": {name: by_walker[..., k] for k, name in enumerate(names)}}
    if log_density is not None:
        groups["sample_stats"] = {"lp": log_density.T}
    with warnings.catch_warnings():  # more chains than draws: so it is with many walkers
        warnings.simplefilter("ignore", UserWarning)
        return az.from_dict(**groups) if int(az.__version__.partition(".")[0]) < 1 else az.from_dict(groups)


def arviz() -> Any:
    """ArviZ, or `MissingExtraError`."""
    try:
        with warnings.catch_warnings():  # it announces its next major version
            warnings.simplefilter("ignore")
            import arviz as az
    except ImportError as error:
        raise MissingExtraError("ArviZ is not installed; to_arviz() needs it: pip install arviz.") from error
    return az


class HighestDensity(NamedTuple):
    """The region of highest density that holds ``level`` of the posterior, by two descriptions.

    ``(xi - centre)^T covariance^-1 (xi - centre) <= radius^2`` is that of the Gaussian with the samples' mean and
    covariance; ``content`` is the share of the samples in it, ``content_error`` its Monte Carlo standard deviation: if
    content is not level within it, the posterior is no Gaussian. ``intervals`` are the shortest of each axis alone.
    """

    level: float
    centre: Array  # (6,)
    covariance: Array  # (6, 6)
    radius: float
    content: float
    content_error: float
    intervals: Array  # (6, 2)

    @property
    def gaussian(self) -> bool:
        """True if the content is that of a Gaussian, within 3.3 standard deviations (99.9 %) of its error."""
        return abs(self.content - self.level) <= 3.3 * self.content_error


@dataclass(frozen=True, eq=False)
class Posterior(Outcome, ReadOnlyArrays):
    """Samples of the posterior of X.

    The samples are errors ``xi = (theta, tau)`` about ``X``, the estimate of `ml`: left rotation, additive translation,
    rad and m, parent frame of X. What is made of them (`samples`, `mean`, `covariance`, `hpd`, `figure`, ...) raises
    `NotConvergedError` where the chain has not converged; ``chain`` and ``diagnostics`` are there to see why.
    """

    title: ClassVar[str] = "Posterior"

    X: Array  # (4, 4), by maximum likelihood
    bound: Array  # (6, 6): covariance of X by `ml`
    frame: str | None  # what X is called; None for motions that came without poses
    chain: Array  # (steps, walkers, d): errors of X, then those of W if it was sampled, then log-scales
    log_density: Array  # (steps, walkers), up to a constant
    diagnostics: PosteriorDiagnostics
    noise: Noise
    noise_estimated: bool
    scales: ScalePrior | None
    student_t: float | None
    seed: int
    seconds: float
    maxima: int = 1  # of the density, as the chain's proposal has them; above 1 only where `student_t` is set
    stated: tuple[float, float] | None = None  # m, rad: sd in the worst direction by the calibration that gave the data

    def __repr__(self) -> str:
        kept = f"{self.chain.shape[0] * self.chain.shape[1]:,} samples"
        state = "" if self.converged else ", not converged"
        modes = "" if self.maxima == 1 else f", {self.maxima} maxima"
        return f"Posterior({self.frame or 'X'}, {kept}{modes}{state})"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the d coordinates: theta_x to tau_z, W_theta_x ..., log_scale_..."""
        return self.diagnostics.names

    @property
    def converged(self) -> bool:
        """True if there are as many effective samples as asked, of every coordinate, by all criteria."""
        return self.diagnostics.converged

    def require_converged(self) -> None:
        """Raise `NotConvergedError`, which says what to do, unless the chain has converged."""
        if not self.converged:
            raise NotConvergedError(f"The posterior has not converged: {self._advice()}", self)

    def _advice(self) -> str:
        faults = self.diagnostics.faults
        return (
            f"{'; '.join(faults)}. Raise max_steps (with a file, --resume or resume=True goes on where it ended) or "
            "ask for fewer samples. If the autocorrelation time is above 100 steps, look for directions of X that the "
            "data hardly determine, and for scales that only their prior determines."
        )

    @cached_property
    def _all(self) -> Array:
        self.require_converged()
        return self.chain.reshape(-1, self.chain.shape[-1])

    @property
    def samples(self) -> Array:
        """(S, 6) errors xi of X about `X`; neighbours in the chain of a walker are correlated."""
        return self._all[:, :6]

    @property
    def scale_samples(self) -> dict[str, Array]:
        """The factors (S,) on the standard deviations of the noise, of each side whose scale was sampled."""
        self.require_converged()
        first = len("log_scale_")
        return {
            name[first:]: np.exp(self._all[:, k]) for k, name in enumerate(self.names) if name.startswith("log_scale_")
        }

    @cached_property
    def mean(self) -> Array:
        """(6,) of the samples; near 0 for small noise."""
        return np.asarray(self.samples.mean(axis=0))

    @cached_property
    def covariance(self) -> Array:
        """(6, 6) of the samples."""
        return np.asarray(np.cov(self.samples.T))

    @property
    def std(self) -> Array:
        """(6,)"""
        return np.sqrt(np.diag(self.covariance))

    def hpd(self, level: float = 0.95) -> HighestDensity:
        """Highest-density ellipsoid of the Gaussian of the samples with its content, and intervals of each axis."""
        from scipy.stats import chi2

        if not is_number(level) or not 0 < level < 1:
            raise InputError(f"Expected `level` to be a probability between 0 and 1, got {level!r}.")
        level = float(level)
        x = self.samples
        z = np.linalg.solve(np.linalg.cholesky(self.covariance), (x - self.mean).T)
        radius = float(np.sqrt(chi2.ppf(level, 6)))
        inside = (z * z).sum(axis=0) <= radius**2
        worth = min(float(self.diagnostics.ess_bulk[:6].min()), float(len(x)))
        return HighestDensity(
            level,
            self.mean,
            self.covariance,
            radius,
            float(inside.mean()),
            float(np.sqrt(level * (1 - level) / worth)),
            shortest(x, level),
        )

    def to_arviz(self) -> Any:
        """ArviZ's ``InferenceData``, or its ``DataTree`` from 1.0 on: a variable per coordinate, a chain per walker.

        Also of a chain that has not converged, to look into it; the attribute ``converged`` says which (0 or 1).
        """
        data = inference_data(self.chain, self.names, self.log_density)
        attributes = {"converged": int(self.converged), "convention": CONVENTION}
        data["posterior"].attrs.update(attributes)
        return data

    def summary(self, verbose: bool = False) -> str:
        """Return the result as text, with units on every number."""
        return to_text(self.document())

    def figure(self, path: str | os.PathLike[str] | None = None) -> Any:
        """The corner plot as a Matplotlib figure; written to ``path`` (.png or .svg) if given."""
        from ....core.presentation.ellipses import render  # Matplotlib is slow to import

        figure = self.drawn()
        if path is not None:
            write_atomically(path, render(figure, Path(path).suffix.lstrip(".").lower()))
        return figure

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: what the samples say, not the samples, which are in the file and `to_arviz`."""
        result: dict[str, Any] = {
            "format": "uq-handeye posterior 1",
            "converged": self.converged,
            "convention": CONVENTION,
            **attributes(self, "frame X bound noise noise_estimated"),
            "scale_prior": None if self.scales is None else {"robot": self.scales.robot, "camera": self.scales.camera},
            **attributes(self, "student_t maxima seed diagnostics seconds"),
        }
        if self.converged:
            result |= {
                "samples": len(self.samples),
                "mean": self.mean.tolist(),
                "covariance": self.covariance.tolist(),
                "standard_deviations": self.std.tolist(),
                "intervals_95": shortest(self.samples, 0.95).tolist(),
                "content": {f"{level:g}": self.hpd(level).content for level in LEVELS},
                "scales": {
                    name: {"median": float(np.median(s)), "interval_95": shortest(s[:, None], 0.95)[0].tolist()}
                    for name, s in self.scale_samples.items()
                },
            }
        return result


def shortest(samples: Array, level: float) -> Array:
    """The shortest interval (d, 2) that holds ``level`` of the samples (S, d), of each coordinate by itself."""
    ordered = np.sort(samples, axis=0)
    count = min(int(np.ceil(level * len(ordered))), len(ordered) - 1)
    first = np.argmin(ordered[count:] - ordered[:-count], axis=0)
    columns = np.arange(samples.shape[1])
    return np.stack([ordered[first, columns], ordered[first + count, columns]], axis=1)


SHAPE_LEVELS = (0.5, 0.68, 0.9, 0.95, 0.99)


@document_of.register(Posterior)
def posterior_document(posterior: Posterior, verbose: bool = False) -> Document:
    """A headline, a table of the six axes, the shape, the scales and the diagnostics; or what is missing."""
    part = part_of("noise whose sizes are known but for these scales" if posterior.scales else "noise of known sizes",
                   posterior.stated)  # fmt: skip
    about = f"Posterior of {posterior.frame or 'X'}, {_model(posterior)}.{part}"
    start: list[Block | list[Block]] = [Paragraph(about)]
    diagnostics = Paragraph(_diagnostics(posterior))
    if not posterior.converged:
        faults = "; ".join(posterior.diagnostics.faults)
        return [*start, Paragraph(f"NOT CONVERGED, so that there are no numbers to report: {faults}."), diagnostics]
    if posterior.maxima > 1:
        start.append(Paragraph(_maxima(posterior)))
    shape: list[Block] = [Paragraph(_shape(posterior))]
    for side, s in posterior.scale_samples.items():
        low, middle, high = np.quantile(s, [0.025, 0.5, 0.975])
        text = f"Noise of {side}: {digits(middle)} times the standard deviations given "
        shape.append(Paragraph(f"{text}({digits(low)} to {digits(high)} with 95 %)."))
    return [*start, _table(posterior), shape, [diagnostics, Paragraph(_not_covered(posterior))]]


def _maxima(posterior: Posterior) -> str:
    """Say that no ellipsoid describes the posterior."""
    which = "neither" if posterior.maxima == 2 else "none of them"
    return (
        f"The posterior has {posterior.maxima} separate maxima: the data contradict each other. Mean and covariance "
        f"describe {which}; look at the corner plot and the samples."
    )


def _model(posterior: Posterior) -> str:
    likelihood = (
        "Gaussian" if posterior.student_t is None else f"Student-t ({posterior.student_t:g} degrees of freedom)"
    )
    noise = "noise estimated from the data" if posterior.noise_estimated else "noise given"
    scales = "" if posterior.scales is None else ", its scales free"
    return f"{likelihood} likelihood, flat prior on X, {noise}{scales}"


def _table(posterior: Posterior) -> Table:
    intervals = posterior.hpd(0.95).intervals
    bound = np.sqrt(np.diag(posterior.bound))
    head = ["", "unit", "mean - ml", "sd", "sd of ml", "ratio", "95 % from", "to", "R-hat", "ESS bulk", "ESS tail"]
    rows = []
    found = posterior.diagnostics
    for k, axis in enumerate(posterior.names[:6]):
        values: Array = np.array([posterior.mean[k], posterior.std[k], bound[k]]) * UNITS[k]
        low, high = intervals[k] * UNITS[k]
        rows.append(
            [
                axis,
                "deg" if k < 3 else "mm",
                f"{values[0]:+.2g}",
                digits(values[1]),
                digits(values[2]),
                f"{values[1] / values[2]:.3f}",
                f"{low:+.3g}",
                f"{high:+.3g}",
                f"{found.r_hat[k]:.4f}",
                f"{found.ess_bulk[k]:.0f}",
                f"{found.ess_tail[k]:.0f}",
            ]
        )
    return Table("", head, rows)


def _shape(posterior: Posterior) -> str:
    regions = [posterior.hpd(level) for level in SHAPE_LEVELS]
    contents = ", ".join(f"{100 * region.content:.1f} %" for region in regions)
    levels = ", ".join(f"{100 * level:g} %" for level in SHAPE_LEVELS)
    verdict = (
        "as those of a Gaussian do"
        if all(region.gaussian for region in regions)
        else "which is not what those of a Gaussian do: rely on the samples and intervals, not on the covariance alone"
    )
    return f"The {levels} ellipsoids of the samples' mean and covariance hold {contents} of the samples, {verdict}."


def _diagnostics(posterior: Posterior) -> str:
    found = posterior.diagnostics
    tau = found.autocorrelation_time
    longest = "unknown" if np.isnan(tau).any() else f"{tau.max():.1f} steps"
    return (
        f"{found.walkers} walkers, {found.steps} steps each after {found.burn_in} of burn-in; longest autocorrelation "
        f"time {longest}; {100 * found.acceptance:.0f} % of the proposals accepted; seed {posterior.seed}; "
        f"{posterior.seconds:.1f} s."
    )


def _not_covered(posterior: Posterior) -> str:
    student = "" if posterior.student_t is None else " Standard deviations given are the scale of the Student-t."
    return (
        "theta: left rotation, tau: translation, in the parent frame of X. Errors that poses share and the noise does "
        f"not say (wrong intrinsics, wrong robot kinematics) are not covered.{student}"
    )
