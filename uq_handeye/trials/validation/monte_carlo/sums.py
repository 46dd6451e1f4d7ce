r"""Sums of the errors of trials from which every statistic follows, so that ten million trials need no memory.

Of the errors ``xi = (theta, tau)`` (rad and m, rotation first) of trials with covariance ``P``: their number, sum and
sum of outer products; and for the parts joint (``xi``), rotation (``theta``) and translation (``tau``), each with its
own block of ``P``, of the squared Mahalanobis distance

    d^2 = |L^-1 xi|^2,   P = L L^T   (Cholesky)

sum, sum of squares and a histogram whose edges are quantiles of chi-square: 20 per decade in both tails, from 1e-8
to 0.01 and from 0.99 to 1 - 1e-8, and every 0.005 between, among them the levels of `LEVELS`.

Only elementwise products and NumPy's pairwise sums are used, no threaded matrix product: the same errors give the
same bits with any number of threads.

**When to stop**: the adaptive procedure of JCGM 102:2011, 7.8 (JCGM 101:2008, 7.9).

Trials come in blocks of M. Of each block r = 1 .. h: the mean error ``y_r`` (6,), its standard deviations ``u_r`` (6,),
the largest eigenvalue ``lambda_r`` of its correlation matrix, and the coverage factor ``k_r`` of the 95 % ellipsoid,

    d^2 = (xi - y_r)^T U_r^-1 (xi - y_r),   U_r the covariance of the block;   a share 0.95 of its trials has d < k_r.

For each of these numbers z, with ``s`` the standard deviation of its mean over the blocks,

    s^2 = sum (z_r - z)^2 / (h (h - 1))      and the result is stable once  2 s <= delta  for all of them,

with ``delta = 10^l / 2`` where the number is ``c 10^l`` and c an integer of ``digits`` digits: half a unit of the last
digit that is wanted. For ``y`` the number is ``u``: an estimate is wanted to the digits of its uncertainty.

From the standard: blocks of ``max(10^4, 100 / (1 - p))`` = 10,000 trials for p = 95 % (step b; the caller makes them),
no test before h exceeds 10 (step f; JCGM 101 tests from h = 2, with a standard deviation of two numbers, which is often
small by chance), the four kinds of numbers and their tolerances (steps g to m), results from all h M trials (step i).

What differs: the coverage factor of the whole run is the mean of those of the blocks, so that no trial is kept (bias of
the order of 1/M, and it only sets a tolerance); trials without an estimate are left out of their block; the "estimate"
is the error of X, which has mean zero to first order, where the standard has the quantity itself: the tolerance of y
comes from u in both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammainccinv, gammaincinv

from ....core.geometry.se3 import Array
from ....core.runtime.read_only import ReadOnlyArrays
from ....errors import InputError, require_integer
from ....findings import Finding

PARTS = ("joint", "rotation", "translation")
SIZES = (6, 3, 3)  # components of each part
LEVELS = (0.5, 0.68, 0.9, 0.95, 0.99)
COMPONENTS = tuple(f"{what} {axis}" for what in ("rotation about", "translation along") for axis in "xyz")
UNITS = np.repeat([180 / np.pi, 1e3], 3)  # shown in deg and mm

_TAIL = 10.0 ** (np.arange(-160, -39) / 20)  # 1e-8 to 0.01
_MIDDLE = np.arange(3, 198) / 200  # 0.015 to 0.985
# The probabilities at the edges of the histogram, and their complements, exact in both tails.
BELOW: Array = np.concatenate([_TAIL, _MIDDLE, 1 - _TAIL[::-1]])
ABOVE: Array = np.concatenate([1 - _TAIL, 1 - _MIDDLE, _TAIL[::-1]])
_SINGULAR = 1e-12  # share of a variance that the components before leave open


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

    def to_arrays(self) -> dict[str, NDArray[Any]]:
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
        if (np.diagonal(L, axis1=-2, axis2=-1) ** 2 > _SINGULAR * variances).all():
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


BLOCK = 10_000  # trials of a block, M
FIRST = 11  # blocks before the first test
LEVEL = 0.95  # of the ellipsoid
LEAST = 100  # estimates without which a block says nothing
# The numbers that must be stable, in this order: y (6), u (6), lambda, k.
NAMES = (
    *(f"mean error, {name}" for name in COMPONENTS),
    *(f"standard deviation, {name}" for name in COMPONENTS),
    "largest eigenvalue of the correlation matrix",
    "coverage factor of the 95 % ellipsoid",
)


class Summary(NamedTuple):
    """Stability of the numbers of `NAMES`, each (14,); None before two blocks with estimates."""

    blocks: int
    digits: int
    stable: bool
    values: Array | None  # from all trials; the coverage factor is the mean over blocks
    spread: Array | None  # 2 s
    tolerance: Array | None  # delta
    unstable: tuple[str, ...]  # names of those with 2 s > delta
    blocks_expected: int | None  # at which all would be stable if s falls as 1 / sqrt(h)
    missing: Finding | None  # why it is not stable; None if it is

    @property
    def reason(self) -> str:
        """Reason in words why it is not stable; empty if it is."""
        return "" if self.missing is None else str(self.missing)


class Stability:
    """Stopping rule of a run; see the module.

    Blocks are taken in their order; the same ones in the same order give the same bits.

    Parameters
    ----------
    digits : int
        Significant digits that are to be stable, 1 to 4. Trials grow by 100 with each digit.
    """

    def __init__(self, digits: int) -> None:
        require_integer("digits", digits, 1)
        if digits > 4:
            raise InputError(f"Expected `digits` to be a whole number from 1 to 4, got {digits!r}.")
        self.digits = int(digits)
        self._size: int | None = None
        self._sparse = 0
        self._blocks: list[Array] = []
        self._count, self._error, self._outer = 0, np.zeros(6), np.zeros((6, 6))

    def add(self, errors: ArrayLike, ok: ArrayLike) -> None:
        """Take the next block: errors (m, 6) in rad and m, ``ok`` (m,) False for trials without an estimate.

        Raises `InputError` for wrong shapes, a block of another size than the first, and errors that do not vary in
        some direction.
        """
        e, good = np.asarray(errors, dtype=float), np.asarray(ok)
        sums = Sums.of(e, good, np.eye(6))  # checks shapes and numbers
        if self._size is not None and len(e) != self._size:
            raise InputError(f"Expected blocks of {self._size} trials like the first, got one of {len(e)}.")
        self._size = len(e)
        self._count, self._error, self._outer = (
            self._count + sums.count,
            self._error + sums.error,
            self._outer + sums.outer,
        )
        if sums.count < LEAST:
            self._sparse += 1
            return
        mean, L, u, eigenvalue = _moments(sums.count, sums.error, sums.outer)
        around = squares(L, np.ascontiguousarray((e[good] - mean).T))[1]
        place = math.ceil(LEVEL * sums.count)  # so many lie below
        factor = math.sqrt(float(np.partition(around, place)[place]))
        self._blocks.append(np.concatenate([mean, u, [eigenvalue, factor]]))

    @property
    def stable(self) -> bool:
        """True if the blocks so far are enough."""
        return self.summary().stable

    def summary(self) -> Summary:
        """Values, their spread over the blocks, tolerances, and what is not stable yet."""
        h = len(self._blocks) + self._sparse
        missing: Finding | None = None
        if self._sparse:
            missing = Finding(
                "monte_carlo.few_estimates", "caution", {"sparse": self._sparse, "blocks": h, "least": LEAST}
            )
        elif h < FIRST:
            missing = Finding("monte_carlo.few_blocks", "caution", {"blocks": h, "needed": FIRST})
        if len(self._blocks) < 2:
            return Summary(h, self.digits, False, None, None, None, (), None, missing)
        table = np.array(self._blocks)
        n = len(table)
        spread = 2 * table.std(axis=0, ddof=1) / math.sqrt(n)
        mean, _, u, eigenvalue = _moments(self._count, self._error, self._outer)
        values = np.concatenate([mean, u, [eigenvalue, table[:, 13].mean()]])
        wanted = np.concatenate([u, values[6:]])
        tolerance = np.array([numerical_tolerance(float(z), self.digits) for z in wanted])
        over = spread > tolerance
        unstable = tuple(name for name, late in zip(NAMES, over, strict=True) if late)
        expected = max(FIRST, math.ceil(n * float(((spread / tolerance) ** 2).max())))
        if missing is None and unstable:
            missing = Finding("monte_carlo.not_stable", "caution", {"digits": self.digits, "numbers": list(unstable)})
        return Summary(h, self.digits, missing is None, values, spread, tolerance, unstable, expected, missing)


def numerical_tolerance(value: float, digits: int) -> float:
    """Half a unit of the last of so many significant digits (JCGM 102, 7.8.2): 0.5 for 12 and 12.3 with two digits.

    Raises `InputError` for zero, which has no significant digits.
    """
    if value == 0 or not math.isfinite(value):
        raise InputError(f"Expected a finite number other than 0 for a tolerance, got {value!r}.")
    exponent = int(f"{value:.{digits - 1}e}".split("e")[1])
    return 0.5 * 10.0 ** (exponent - digits + 1)


def _moments(count: int, error: Array, outer: Array) -> tuple[Array, Array, Array, float]:
    """Mean, Cholesky factor of the covariance, standard deviations, largest eigenvalue of the correlation matrix."""
    mean = error / count
    U = (outer - count * np.outer(mean, mean)) / (count - 1)
    L = lower_factor(U, "errors of a block")
    u = np.sqrt(np.diag(U))
    return mean, L, u, float(np.linalg.eigvalsh(U / np.outer(u, u))[-1])
