"""Stopping rule of a Monte Carlo run: the adaptive procedure of JCGM 102:2011, 7.8 (JCGM 101:2008, 7.9).

Trials come in blocks of M. Each block r = 1 .. h gives the mean error ``y_r`` (6,), its standard deviations ``u_r``
(6,), the largest eigenvalue ``lambda_r`` of its correlation matrix, and the coverage factor ``k_r`` of the 95 %
ellipsoid,

    d^2 = (xi - y_r)^T U_r^-1 (xi - y_r),   U_r the covariance of the block;   a share 0.95 of its trials has d < k_r.

For each of these numbers z, with ``s`` the standard deviation of its mean over the blocks,

    s^2 = sum (z_r - z)^2 / (h (h - 1))      and the result is stable once  2 s <= delta  for all of them,

with ``delta = 10^l / 2`` where the number is ``c 10^l`` and c an integer of ``digits`` digits: half a unit of the last
digit that is wanted. For ``y`` the number is ``u``: an estimate is wanted to the digits of its uncertainty.

From the standard: blocks of ``max(10^4, 100 / (1 - p))`` = 10,000 trials for p = 95 % (step b; the caller makes them),
no test before h exceeds 10 (step f; JCGM 101 tests from h = 2, with a standard deviation of two numbers, which is often
small by chance), the four kinds of numbers and their tolerances (steps g to m), results from all h M trials (step i).

Differences from the standard: the coverage factor of the whole run is the mean of those of the blocks, so that no trial
is kept (bias of the order of 1/M, and it only sets a tolerance); trials without an estimate are left out of their
block; the "estimate" is the error of X, which has mean zero to first order, where the standard has the quantity
itself: the tolerance of y comes from u in both.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ....core.geometry.se3 import Array
from ....core.levels import INTERVAL
from ....errors import InputError, require_integer
from ....findings import Finding
from .consistency import MIN_TRIALS
from .sums import COMPONENTS, Sums, lower_factor, squares

# Trials of a block, M, and blocks before the first test: those of the standard.
BLOCK_TRIALS, MIN_BLOCKS = 10_000, 11
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
        if sums.count < MIN_TRIALS:
            self._sparse += 1
            return
        mean, L, u, eigenvalue = _moments(sums.count, sums.error, sums.outer)
        around = squares(L, np.ascontiguousarray((e[good] - mean).T))[1]
        place = math.ceil(INTERVAL.probability * sums.count)  # so many lie below
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
                "monte_carlo.few_estimates", "caution", {"sparse": self._sparse, "blocks": h, "least": MIN_TRIALS}
            )
        elif h < MIN_BLOCKS:
            missing = Finding("monte_carlo.few_blocks", "caution", {"blocks": h, "needed": MIN_BLOCKS})
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
        expected = max(MIN_BLOCKS, math.ceil(n * float(((spread / tolerance) ** 2).max())))
        if missing is None and unstable:
            missing = Finding("monte_carlo.not_stable", "caution", {"digits": self.digits, "numbers": list(unstable)})
        return Summary(h, self.digits, missing is None, values, spread, tolerance, unstable, expected, missing)


def numerical_tolerance(value: float, digits: int) -> float:
    """Return half a unit of the last of ``digits`` significant digits (JCGM 102, 7.8.2): 0.5 for 12.3 with two.

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
