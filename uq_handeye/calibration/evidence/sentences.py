"""Sentences of the findings about new poses and touches that update a calibration. Values are in m."""

from __future__ import annotations

from ...core.presentation.numbers import digits, probability
from ...findings import INPUT, sentence


@sentence(
    "evidence.touches_used",
    check=INPUT,
    phrase=lambda v: f"{v['count']} touched points contradict the poses ({probability(v['p_value'])})",
    effect=3.0,
    rejects=True,
)
def _(count: int, d2: float, dof: int, p_value: float, rms: float) -> str:
    touches = "1 touched point is" if count == 1 else f"{count} touched points are"
    agree, they, contradict = ("agrees", "it", "contradicts") if count == 1 else ("agree", "they", "contradict")
    fit = f"d^2 {digits(d2)} of {dof}, {probability(p_value, 2)}; {digits(1e3 * rms, 2)} mm RMS before"
    if p_value < 0.05:
        return (
            f"{touches} part of the result, and {they} {contradict} the poses ({fit}). Find the cause with uq-handeye "
            f"verify, or calibrate without {'it' if count == 1 else 'them'}."
        )
    return (
        f"{touches} part of the result and {agree} with the poses ({fit}). Residuals and diagnostics are those of the "
        "poses alone."
    )
