"""Verdict of a comparison in one sentence: the methods that agree with the reference."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .row import Row

_MM, _DEG = 1e3, 180 / np.pi


def verdict(rows: Sequence[Row], reference: str | None, noise_known: bool, most: int | None = None) -> str:
    """State which methods agree with the reference, which differ, and which failed."""
    if reference is None:
        if len(rows) == 1:
            return f"{rows[0].method} gave no result{to_rely_on(rows[0])}."
        rely = next((to_rely_on(row) for row in rows if row.X is not None), "")
        return f"None of the {len(rows)} methods gave a result{rely}."
    others = [row for row in rows if row.method != reference and row.failure is None]
    judged = [row for row in others if row.agrees is not None]
    differ = [row.method for row in judged if not row.agrees]
    if len(judged) == 1:
        parts = [f"{judged[0].method} {'differs from' if differ else 'agrees with'} {reference} at 95 %"]
        differ = []
    elif judged:
        agree = len(judged) - len(differ)
        parts = [f"{agree} of {len(judged)} methods {'agrees' if agree == 1 else 'agree'} with {reference} at 95 %"]
    elif others:
        rotation = max(row.difference_rotation or 0.0 for row in others)
        translation = max(row.difference_translation or 0.0 for row in others)
        parts = [f"Up to {apart(rotation, _DEG)} deg and {apart(translation, _MM)} mm from {reference}"]
        if not noise_known:
            parts[0] += "; whether that is much cannot be said without noise"
    elif len(rows) == 1:
        parts = [f"{reference} alone, with nothing to compare"]
    else:
        parts = [f"Only {reference} gave a result"]
    silent = [row.method for row in others if row.agrees is None and noise_known]
    by_status = {status: [row.method for row in rows if row.status == status] for status in _STATUS}
    for names, words in (
        (differ, "differs" if len(differ) == 1 else "differ"),
        (silent, "without covariance"),
        *((by_status[status], words) for status, words in _STATUS.items()),
    ):
        if names:
            listed = "" if most is not None and len(names) > most else f": {', '.join(names)}"
            parts.append(f"{len(names)} {words}{listed}")
    return "; ".join(parts) + "."


# What the verdict calls the rows without a result to rely on.
_STATUS = {
    "undetermined": "undetermined",
    "unconverged": "did not converge",
    "failed": "failed",
    "not run": "not run",
}


def to_rely_on(row: Row) -> str:
    return "" if row.X is None else " to rely on"


def apart(value: float | None, factor: float = 1.0) -> str:
    """A difference: as `digits`, and what is rounding as such."""
    return "<1e-9" if value is not None and 0 < value * factor < 1e-9 else digits(value, factor)


def digits(value: float | None, factor: float = 1.0) -> str:
    """Three significant digits, all digits of larger numbers; ``-`` for what is not there."""
    if value is None:
        return "-"
    value *= factor
    if not math.isfinite(value):
        return "inf"
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.1e}"
    exponent = math.floor(math.log10(abs(float(f"{value:.2e}"))))
    return f"{value:.{min(max(0, 2 - exponent), 5)}f}"
