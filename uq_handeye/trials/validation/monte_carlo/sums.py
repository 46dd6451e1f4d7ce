"""Sums of the errors of trials from which every statistic follows, so that ten million trials need no memory.

Kept of the errors ``xi = (theta, tau)`` (rad and m, rotation first) of trials with covariance ``P`` are their number,
sum and sum of outer products. For each of the parts joint (``xi``), rotation (``theta``) and translation (``tau``),
with its own block of ``P``, the squared Mahalanobis distance is

    d^2 = |L^-1 xi|^2,   P = L L^T   (Cholesky)

of which sum, sum of squares and a histogram are kept. The edges of the histogram are quantiles of chi-square: 20 per
decade in both tails, from 1e-8 to 0.01 and from 0.99 to 1 - 1e-8, and every 0.005 between, among them the levels of
`LEVELS`.

Only elementwise products and NumPy's pairwise sums are used, no threaded matrix product: the same errors give the
same bits with any number of threads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammainccinv, gammaincinv

from ....core.geometry.se3 import Array
from ....core.levels import INTERVAL
from ....core.presentation.units import DEG_PER_RAD, MM_PER_M
from ....core.read_only import ReadOnlyArrays
from ....core.rounding import SOLUTION_ROUNDING
from ....errors import InputError

PARTS = ("joint", "rotation", "translation")
# Probabilities of the ellipsoids whose content is reported.
LEVELS = (0.5, 0.68, 0.9, INTERVAL.probability, 0.99)
COMPONENTS = tuple(f"{what} {axis}" for what in ("rotation about", "translation along") for axis in "xyz")
# Numbers of components of the parts.
SIZES = (len(COMPONENTS), len(COMPONENTS[:3]), len(COMPONENTS[3:]))
UNITS = np.repeat([DEG_PER_RAD, MM_PER_M], 3)  # shown in deg and mm
_TAIL = 10.0 ** (np.arange(-160, -39) / 20)  # 1e-8 to 0.01
_MIDDLE = np.arange(3, 198) / 200  # 0.015 to 0.985
# The probabilities at the edges of the histogram, and their complements, exact in both tails.
BELOW: Array = np.concatenate([_TAIL, _MIDDLE, 1 - _TAIL[::-1]])
ABOVE: Array = np.concatenate([1 - _TAIL, 1 - _MIDDLE, _TAIL[::-1]])


@cache
def edges(size: int) -> Array:
    """The edges (B,) of the histogram as values of d^2: quantiles of chi-square with ``size`` degrees of freedom."""
    lower, upper = gammaincinv(size / 2, BELOW), gammainccinv(size / 2, ABOVE)
    values = np.asarray(2 * np.where(BELOW < 0.5, lower, upper))
    values.flags.writeable = False
    return values


@dataclass(frozen=True, eq=False)
class Sums(ReadOnlyArrays):
    """Sums over trials; the rows of ``nees``, ``nees_squared`` and ``histogram`` are the `PARTS`.

    Sums of parts of a run are added with ``+``, in the same order for the same bits.
    """

    count: int  # trials with an estimate
    failures: int  # trials without
    error: Array  # (6,) sum of xi
    outer: Array  # (6, 6) sum of xi xi^T
    nees: Array  # (3,) sum of d^2
    nees_squared: Array  # (3,) sum of d^4
    histogram: NDArray[np.int64]  # (3, B + 1) trials below, between and above the edges

    @classmethod
    def of(cls, errors: ArrayLike, ok: ArrayLike, covariance: ArrayLike) -> Sums:
        """The sums of trials.

        Parameters
        ----------
        errors : (m, 6)
            ``xi``, in rad and m; the rows of failed trials are not looked at.
        ok : (m,) bool
            False for trials without an estimate.
        covariance : (6, 6) or (m, 6, 6)
            Common to all trials, or of each.

        Raises `InputError` for wrong shapes, errors that are not finite, a covariance that is not positive definite
        (the message names the direction), and one so small beside the errors that d^4 overflows.
        """
        e, good, P = np.asarray(errors, dtype=float), np.asarray(ok), np.asarray(covariance, dtype=float)
        m = len(e) if e.ndim else 0
        if e.shape != (m, 6) or good.shape != (m,) or good.dtype != bool:
            raise InputError(
                f"Expected `errors` of shape (m, 6) and `ok` of m truth values, got {e.shape} and {good.shape} "
                f"of {good.dtype}."
            )
        if P.shape not in ((6, 6), (m, 6, 6)):
            raise InputError(f"Expected `covariance` to have shape (6, 6) or ({m}, 6, 6), got {P.shape}.")
        if not good.all():
            e, P = e[good], P if P.ndim == 2 else P[good]
        if not np.isfinite(e).all():
            raise InputError("Expected `errors` of trials that are ok to be finite, got NaN or infinity.")
        count = len(e)
        e = np.ascontiguousarray(e.T)
        L = lower_factor(P, "covariance")
        with np.errstate(over="ignore", invalid="ignore"):
            turn, joint = squares(L, e)
            distances = np.stack([joint, turn, squares(lower_factor(P[..., 3:, 3:], "covariance"), e[3:])[1]])
            squared = (distances * distances).sum(axis=1)
        if not np.isfinite(squared).all():
            size = float(np.sqrt(np.diagonal(P, axis1=-2, axis2=-1).min()))
            raise InputError(
                "Expected the covariance `covariance` to be of the size of the errors, got standard deviations down to "
                f"{size:.2g} where errors are up to {np.abs(e).max():.2g}: their squared distances are too large for "
                "a number. Is it in rad and m?"
            )
        outer = np.empty((6, 6))
        for i in range(6):
            outer[i, i:] = outer[i:, i] = (e[i] * e[i:]).sum(axis=1)
        # How many lie at or below each edge: of sorted distances these are few searches.
        ranked = np.sort(distances, axis=1)
        below = [np.searchsorted(row, edges(k), side="right") for row, k in zip(ranked, SIZES, strict=True)]
        histogram = np.diff(below, axis=1, prepend=0, append=count).astype(np.int64)
        return cls(count, m - count, e.sum(axis=1), outer, distances.sum(axis=1), squared, histogram)

    def __add__(self, other: Sums) -> Sums:
        return Sums(*(getattr(self, field.name) + getattr(other, field.name) for field in fields(Sums)))

    @property
    def trials(self) -> int:
        """Number of trials with and without an estimate."""
        return self.count + self.failures

    @property
    def inside(self) -> NDArray[np.int64]:
        """Trials inside the ellipsoids: (3, 5), of each part at each of `LEVELS`."""
        index = [int(np.abs(BELOW - level).argmin()) for level in LEVELS]
        return np.asarray(np.cumsum(self.histogram, axis=1)[:, index])

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Arrays by name, for an npz file."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(Sums)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ArrayLike]) -> Sums:
        """The sums that `to_arrays` gave, to the bit. Raises `InputError` where an array is missing or does not fit."""
        values: dict[str, Any] = {}
        for name, like in cls.of(np.empty((0, 6)), np.empty(0, bool), np.eye(6)).to_arrays().items():
            value = np.asarray(arrays.get(name))
            if value.shape != like.shape or value.dtype.kind != like.dtype.kind:
                raise InputError(
                    f"Expected `{name}` of the sums of trials to have shape {like.shape} and kind {like.dtype.kind}, "
                    f"got {value.shape} of {value.dtype}."
                )
            values[name] = value if value.ndim else int(value)
        result = cls(**values)
        counted = np.array(result.histogram.sum(axis=1))
        if result.count < 0 or result.failures < 0 or (counted != result.count).any():
            raise InputError(f"Expected histograms of {result.count} trials, got {', '.join(map(str, counted))}.")
        return result


def squares(L: Array, e: Array) -> tuple[Array, Array]:
    """``|w|^2`` of the first three and of all components of ``w = L^-1 e``, by substitution; e is (k, m)."""
    w: list[Array] = []
    first = total = np.zeros(e.shape[1])
    for i, row in enumerate(e):
        value = row
        for j, known in enumerate(w):
            value = value - L[..., i, j] * known
        w.append(value / L[..., i, i])
        total = total + w[-1] * w[-1]
        first = total if i == 2 else first
    return first, total


def lower_factor(covariance: Array, name: str) -> Array:
    """Cholesky factor of covariances (..., k, k); `InputError` that names the direction if one is singular."""
    P = np.asarray(covariance)
    try:
        L = np.linalg.cholesky(P)
        variances = np.diagonal(P, axis1=-2, axis2=-1)
        if (np.diagonal(L, axis1=-2, axis2=-1) ** 2 > SOLUTION_ROUNDING * variances).all():
            return np.asarray(L)
    except np.linalg.LinAlgError:
        pass
    k = P.shape[-1]
    stack = P.reshape(-1, k, k)
    if not np.isfinite(stack).all():
        raise InputError(f"Expected the covariance `{name}` to be finite, got NaN or infinity.")
    variances = np.diagonal(stack, axis1=-2, axis2=-1)
    unit = np.sqrt(np.where(variances > 0, variances, 1.0))
    values, vectors = np.linalg.eigh(stack / (unit[:, :, None] * unit[:, None, :]))
    row = int(values[:, 0].argmin())
    of = "" if P.ndim == 2 else f" of trial {row}"
    where = in_words(vectors[row, :, 0], COMPONENTS[-k:])
    raise InputError(
        f"Expected the covariance `{name}`{of} to be positive definite: it leaves no error in {where} (eigenvalue "
        f"{values[row, 0]:.2g} of the correlation matrix), so that no error can be weighed by it. Give noise to what "
        "it leaves exact, or judge another covariance."
    )


def in_words(direction: ArrayLike, names: tuple[str, ...] = COMPONENTS) -> str:
    """A direction in standard deviations by its components: the largest three of at least 0.3, or the one above 0.9."""
    a = np.asarray(direction, dtype=float)
    a = a / np.linalg.norm(a)
    order = [int(k) for k in np.argsort(-np.abs(a), kind="stable")[:3] if abs(a[k]) >= 0.3]
    if abs(a[order[0]]) > 0.9:
        return names[order[0]]
    sign = np.sign(a[order[0]])
    return "the mixture of " + ", ".join(f"{names[k]} ({sign * a[k]:+.1f})" for k in order)
