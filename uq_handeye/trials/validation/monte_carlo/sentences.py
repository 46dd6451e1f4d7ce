"""Sentences about how a Monte Carlo run ended, and why its result is not stable."""

from __future__ import annotations

from ....findings import sentence

ALL = "monte_carlo.all_trials"
STABLE = "monte_carlo.stable"
INTERRUPTED = "monte_carlo.interrupted"
WORKERS_LOST = "monte_carlo.workers_lost"


@sentence(ALL)
def _() -> str:
    return "all trials done"


@sentence(STABLE)
def _(digits: int) -> str:
    return f"stable to {in_digits(digits)}"


@sentence(INTERRUPTED)
def _() -> str:
    return "interrupted"


@sentence(WORKERS_LOST)
def _(how: str) -> str:
    return how


@sentence("monte_carlo.few_estimates")
def _(sparse: int, blocks: int, least: int) -> str:
    return f"{sparse} of {blocks} blocks gave fewer than {least} estimates"


@sentence("monte_carlo.few_blocks")
def _(blocks: int, needed: int) -> str:
    return f"{blocks} {'block' if blocks == 1 else 'blocks'} of trials, {needed} are needed"


@sentence("monte_carlo.not_stable")
def _(digits: int, numbers: list[str]) -> str:
    more = f" and {len(numbers) - 1} more" if len(numbers) > 1 else ""
    return f"not to {in_digits(digits)} yet: {numbers[0]}{more}"


def in_digits(digits: int) -> str:
    """``1 digit``, ``2 digits``."""
    return f"{digits} digit{'' if digits == 1 else 's'}"
