"""Sentences of validations: how a Monte Carlo run ended, why a chain has not converged, why a covariance fails."""

from __future__ import annotations

from ...core.formatting.numbers import multiple
from ...findings import sentence

ALL = "monte_carlo.all_trials"
STABLE = "monte_carlo.stable"
INTERRUPTED = "monte_carlo.interrupted"
WORKERS_LOST = "monte_carlo.workers_lost"

sentence(ALL, "all trials done")
sentence(STABLE, "stable to {digits} {digits:?digit|digits}")
sentence(INTERRUPTED, "interrupted")
sentence(WORKERS_LOST, "{how}")
sentence("monte_carlo.few_estimates", "{sparse} of {blocks} blocks gave fewer than {least} estimates")
sentence("monte_carlo.few_blocks", "{blocks} {blocks:?block|blocks} of trials, {needed} are needed")


@sentence("monte_carlo.not_stable")
def _(digits: int, numbers: list[str]) -> str:
    more = f" and {len(numbers) - 1} more" if len(numbers) > 1 else ""
    return f"not to {digits} digit{'' if digits == 1 else 's'} yet: {numbers[0]}{more}"


@sentence("posterior.short_chain")
def _(steps: int, lengths: int, autocorrelation_time: float | None) -> str:
    longest = "unknown" if autocorrelation_time is None else f"{autocorrelation_time:.3g} steps"
    return f"the chain of {steps} steps is shorter than {lengths} autocorrelation times ({longest})"


@sentence("posterior.r_hat")
def _(name: str, r_hat: float | None, limit: float) -> str:
    return f"split R-hat is {_number(r_hat)} ({name}), not below {limit}"


@sentence("posterior.few_samples")
def _(part: str, name: str, effective: float | None, asked: int) -> str:
    return f"there are {_number(effective)} effective samples in the {part} of {name}, not {asked}"


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.4g}"


sentence("sweep.no_estimate", "{failures} of {trials} trials give no X.")


@sentence("sweep.no_sigma_points")
def _(failures: int | None, evaluations: int | None) -> str:
    return f"{'All' if failures is None else f'{failures} of {evaluations}'} sigma points give no X."


@sentence("sweep.size")
def _(part: str, ratio: float) -> str:
    return f"The {_of(part)}errors are {multiple(ratio)} times as large as predicted."


@sentence("sweep.coverage")
def _(part: str, share: float) -> str:
    return f"The 95 % ellipsoid holds {100 * share:.3g} % of the {_of(part)}errors."


def _of(part: str) -> str:
    return "" if part == "joint" else f"{part} "
