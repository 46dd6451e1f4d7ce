"""Numbers as people read them: few digits, no exponent where that is short, deviations beside values."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..se3 import Array, left_jacobian

# Smaller p-values are not told apart.
SMALLEST_P = 1e-15


def digits(value: float | np.floating[Any], significant: int = 3) -> str:
    """So many significant digits, without an exponent where that is short."""
    value = float(value)
    if value == 0 or 1e-4 <= abs(value) < 1e6:
        whole = value != 0 and abs(value) >= 10 ** (significant - 1)
        return f"{value:.0f}" if whole else f"{value:.{significant}g}"
    return f"{value:.{significant - 1}e}"


def probability(p: float, significant: int = 1) -> str:
    """``p = 0.02``, or a bound where it is all but 0."""
    return f"p < {SMALLEST_P:g}" if p < SMALLEST_P else f"p = {p:.{significant}g}"


def row(label: str, names: str, values: Array | None, std: Array | None, decimals: int, width: int = 22) -> str:
    """A line of named values with their standard deviations."""
    parts = []
    for k, name in enumerate(names):
        value = "" if values is None else f" {values[k] + 0.0:.{decimals}f}"
        deviation = "" if std is None else f" +- {digits(std[k])}"
        parts.append(f"{name}{value}{deviation}")
    return f"{label:{width}s} " + "   ".join(parts)


def std_of(covariance: Array | None, J: Array) -> Array | None:
    """Standard deviations of ``J xi``."""
    return None if covariance is None else np.sqrt(np.clip(np.diag(J @ covariance @ J.T), 0.0, None))


def rotvec_jacobian(rotvec: Array) -> Array:
    """Degrees of the rotation vector per rad of left rotation: ``J_l(rotvec)^-1``."""
    return np.asarray(np.degrees(np.linalg.inv(left_jacobian(rotvec))))
