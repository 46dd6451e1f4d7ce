"""Sentences about why a covariance fails at a level of noise."""

from __future__ import annotations

from ....core.formatting.numbers import multiple
from ....findings import sentence


@sentence("sweep.no_estimate")
def _(failures: int, trials: int) -> str:
    return f"{failures} of {trials} trials give no X."


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
