"""Sentences about properties of pose data that a computation leaves out."""

from __future__ import annotations

from ..findings import sentence


@sentence("poses.offset_taken_as_exact")
def _(function: str, std: float) -> str:
    return (
        f"The time offset of these poses is known to {1e3 * std:.2g} ms, but {function} takes it as exact. Use "
        "calibrate() with method 'efficient' or 'ml' to include its uncertainty."
    )
