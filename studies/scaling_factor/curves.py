"""Measurements of `scaling_factor`, and its curves over d / length: slopes, best d, the limit beside them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import linregress

from uq_handeye.core.geometry.se3 import Array

LENGTHS = (0.001, 1.0, 10.0, 100.0)  # m
SCALES = 10.0 ** np.arange(1.0, 8.25, 0.5)  # m
PRECISIONS: dict[str, type[np.floating[Any]]] = {"double": np.float64, "single": np.float32}
NOISE = 1e-3  # rad, and lengths
CLAIMED = 2.0**-12  # m: III-D, single precision
CLAIM_SCALES = (1e5, 1e6)
QUANTITIES = {
    "rotation": "rotation_from_limit_rad",
    "translation": "translation_from_limit",
    "covariance": "covariance_from_limit",
    "covariance as printed": "printed_covariance_from_limit",
}
OF_LIMIT = QUANTITIES | {"rotation": "rotation_error_median_rad", "translation": "translation_error_median"}
SLOPES = {
    "rotation": (-2, 0),
    "translation": (-2, 1),
    "covariance": (-2, 1),
    "covariance as printed": (-2, 2),
}  # truncation, rounding
SMALLEST_RATIO = 10.0  # of d to length, from which on the truncation is fitted
LARGEST = 0.3  # deviation up to which the rounding is fitted
CLEAR = 5.0  # how far a deviation must stand out of the other kind to be fitted


def with_ratios(accuracy: pd.DataFrame) -> pd.DataFrame:
    """Also d and the distances in lengths; ``decade`` is log10(d / length), rounded."""
    table = accuracy.copy()
    for column in ("translation_from_limit", "translation_error_median"):
        table[column] = table[f"{column}_m"] / table.length_m
    table["decade"] = np.log10(table.d_m / table.length_m).round(2)
    return table


def chosen(table: pd.DataFrame, **values: object) -> pd.DataFrame:
    for column, value in values.items():
        table = table[table[column] == value]
    return table


class Curve(NamedTuple):
    """One quantity in one precision without noise, over all lengths, against d / length."""

    decades: Array  # log10
    values: Array
    lengths: Array
    best: float  # d / length of the least value
    least: float
    slopes: tuple[float, float]  # truncation, rounding; NaN where there are too few points
    uncertain: tuple[float, float]  # standard errors
    factors: tuple[float, float]  # a, b of a (length / d)^2 + b d / length
    limit: float  # error of the limit in this precision: of X from the truth, of the covariance from the reference
    ratio: float  # largest ratio of values at the same d / length, where the length differs

    @property
    def balanced(self) -> float:
        """Value of d at which ``a (length / d)^2 + b d / length`` is least: ``(2 a / b)^(1/3)``."""
        a, b = self.factors
        return float((2 * a / b) ** (1 / 3))


def curve(table: pd.DataFrame, precision: str, quantity: str) -> Curve:
    column = QUANTITIES[quantity]
    rows = chosen(table, precision=precision, noise="none")
    at_d = rows[rows.d_m.notna()]
    mean = np.exp(np.log(at_d[column]).groupby(at_d.decade).mean())
    best = float(mean.index[mean.argmin()])
    x, y = at_d.decade.to_numpy(), at_d[column].to_numpy()
    least = float(mean.min())
    truncated = (x >= math.log10(SMALLEST_RATIO)) & (x < best) & (y >= CLEAR * least)
    a = float(np.exp(np.mean(np.log(y[truncated] * 10 ** (2 * x[truncated]))))) if truncated.any() else math.nan
    rounded = (x > 0) & (CLEAR * a * 10 ** (-2 * x) <= y) & (y <= LARGEST)
    lines = [_line(x[region], np.log10(y[region])) for region in (truncated, rounded)]
    power_of_d = SLOPES[quantity][1]
    b = (
        float(np.exp(np.mean(np.log(y[rounded]) - power_of_d * x[rounded] * math.log(10))))
        if rounded.any()
        else math.nan
    )
    near = at_d[at_d.decade >= math.log10(SMALLEST_RATIO)].groupby("decade")[column]
    ratio = float((near.max() / near.min()).max())
    limit = float(rows[rows.d_m.isna()][OF_LIMIT[quantity]].median())
    (slope, other), (error, other_error) = zip(*lines, strict=True)
    return Curve(
        x, y, at_d.length_m.to_numpy(), 10.0**best, least, (slope, other), (error, other_error), (a, b), limit, ratio
    )


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and its standard error; NaN of fewer than three points or a single x."""
    if len(x) < 3 or np.ptp(x) == 0:
        return math.nan, math.nan
    fit = linregress(x, y)
    return float(fit.slope), float(fit.stderr)


def power(value: float) -> str:
    """1e5, 3e4, 2.4e-4: short."""
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa.removesuffix('.0')}e{int(exponent)}"
