"""Sentences about properties of pose data that a computation leaves out."""

from __future__ import annotations

from ..findings import sentence


@sentence("poses.offset_taken_as_exact")
def _(function: str, std: float) -> str:
    return (
        f"The time offset of these poses is known to {1e3 * std:.2g} ms; {function} takes it as exact. calibrate() "
        "with method 'efficient' or 'ml' takes its uncertainty in."
    )
