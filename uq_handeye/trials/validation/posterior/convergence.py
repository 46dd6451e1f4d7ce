"""Convergence of a chain: autocorrelation time, split R-hat and effective sample size.

For each coordinate, over the walkers and the steps kept:

- *autocorrelation time* tau (steps): emcee's estimate, averaged over walkers (Goodman and Weare 2010); the chain must
  be 50 tau long for it to be trusted;
- *split R-hat*, rank-normalised, bulk and folded (Vehtari et al. 2021, doi:10.1214/20-BA1221), by ArviZ: below 1.01;
- *effective sample size*, bulk and tail (the smaller of the 5 % and the 95 % quantile), by ArviZ: at least as many as
  requested.

The walkers of an ensemble move depend on each other; to treat them as independent chains is customary, and tau is the
check that does not rely on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ....core.files.json_values import Json, JsonObject
from ....core.files.records import attributes
from ....core.geometry.se3 import Array
from ....core.read_only import ReadOnlyArrays
from ....findings import Finding

# A chain has converged below this split R-hat (Vehtari et al. 2021), ...
MAX_R_HAT = 1.01
# ... and where it is this number of autocorrelation times long (emcee).
MIN_AUTOCORRELATION_TIMES = 50


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
        values: dict[str, Json]
        longest = float(self.autocorrelation_time.max())  # NaN if any is
        if not self.steps >= MIN_AUTOCORRELATION_TIMES * longest:
            values = {
                "steps": self.steps,
                "lengths": MIN_AUTOCORRELATION_TIMES,
                "autocorrelation_time": _known(longest),
            }
            found.append(Finding("posterior.short_chain", "failure", values))
        if not (self.r_hat < MAX_R_HAT).all():
            k = int(np.argmax(self.r_hat))  # that of a NaN if there is one
            values = {"name": self.names[k], "r_hat": _known(self.r_hat[k]), "limit": MAX_R_HAT}
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

    def to_dict(self) -> JsonObject:
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
