"""Result of `sample_posterior`: samples of X, and the mean, covariance and regions of highest density made of them."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ....core.files.atomic import write_atomically
from ....core.files.json_values import JsonObject
from ....core.files.records import attributes
from ....core.geometry.checks import is_number
from ....core.geometry.conventions import CONVENTION
from ....core.geometry.se3 import Array
from ....core.levels import INTERVAL
from ....core.presentation.document import to_text
from ....core.read_only import ReadOnlyArrays
from ....errors import InputError, MissingExtraError, NotConvergedError
from ....model.errors.models import Noise
from ..monte_carlo.sums import LEVELS
from ..outcome import Outcome
from .convergence import PosteriorDiagnostics
from .density import ScalePrior


def inference_data(chain: Array, names: tuple[str, ...], log_density: Array | None = None) -> Any:
    """ArviZ's ``InferenceData`` (before 1.0) or ``DataTree``: a variable per coordinate, a chain per walker."""
    az = arviz()
    by_walker = np.swapaxes(chain, 0, 1)
    groups: dict[str, dict[str, Array]] = {"posterior": {name: by_walker[..., k] for k, name in enumerate(names)}}
    if log_density is not None:
        groups["sample_stats"] = {"lp": log_density.T}
    with warnings.catch_warnings():  # more chains than draws: so it is with many walkers
        warnings.simplefilter("ignore", UserWarning)
        return az.from_dict(**groups) if int(az.__version__.partition(".")[0]) < 1 else az.from_dict(groups)


def arviz() -> ModuleType:
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
        """True if every coordinate has the requested number of effective samples, by all criteria."""
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

    def hpd(self, level: float = INTERVAL.probability) -> HighestDensity:
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

    def to_dict(self) -> JsonObject:
        """Plain values for JSON: what the samples say, not the samples, which are in the file and `to_arviz`."""
        result: JsonObject = {
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
