"""Sentences of validations: how a Monte Carlo run ended, and why a chain has not converged."""

from __future__ import annotations

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
