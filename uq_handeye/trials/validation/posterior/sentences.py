"""Sentences about why a chain has not converged; None is "unknown"."""

from __future__ import annotations

from ....findings import sentence


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
