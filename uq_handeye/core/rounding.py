"""Thresholds of floating-point rounding, all derived from the machine epsilon of float64.

Model: a computation of n roundings is exact to about ``n * eps`` relative to its largest term. Below such a
threshold a number is rounding error, not information. No module has a threshold of its own for this.
"""

from __future__ import annotations

import numpy as np

# Relative spacing of float64 numbers, 2.2e-16.
EPS = float(np.finfo(float).eps)
# Smallest number that keeps all its digits, 2.2e-308: it keeps a logarithm or a quotient finite.
TINY = float(np.finfo(float).tiny)


def rounding(operations: int) -> float:
    """Return the relative rounding error of a result after ``operations`` roundings, ``operations * eps``."""
    return operations * EPS


# A sum or product of a few matrices, 1.4e-14.
PRODUCT_ROUNDING = rounding(2**6)
# The solution of a small linear system or eigenvalue problem, 9.1e-13: a relative eigenvalue below it is zero.
SOLUTION_ROUNDING = rounding(2**12)
# The fit of a model to many rows, 1.5e-11: residuals and relative eigenvalues of the information below it are zero.
FIT_ROUNDING = rounding(2**16)
# A result of a long chain of solutions (an iteration, numbers that went through a file), 9.3e-10.
CHAIN_ROUNDING = rounding(2**22)
# The square root of eps, 1.5e-8: a length whose square is exact to eps; the best step of a one-sided derivative.
HALF_DIGITS = float(np.sqrt(EPS))
# The cube root of eps, 6.1e-6: the best step of a central difference.
THIRD_DIGITS = float(np.cbrt(EPS))
