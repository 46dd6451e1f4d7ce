"""Quaternion pairs ("octonions") and SO(4): equations (16)-(18), (20), (28) of the paper.

Model: every R in SO(4) is x -> q_L * x * q_R, with the Hamilton product, scalar first, of x = (x_0, .., x_3).
Only the product rule is written down; the matrices R_L, R_R, P_i and Q_i are all derived from it.

Paper: J. Wu, Y. Sun, M. Wang, M. Liu, "Hand-eye Calibration: 4D Procrustes Analysis Approach", 2019.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sympy import Expr, LeviCivita, Matrix, Symbol, eye, sqrt

Vector = Sequence[Expr]


def entries(prefix: str, size: int = 4) -> Matrix:
    """General square matrix of symbols `prefix11 .. prefix44`, numbered from one as in the paper."""
    return Matrix(size, size, lambda i, j: Symbol(f"{prefix}{i + 1}{j + 1}"))


def coordinates(prefix: str, count: int, first: int = 1) -> Matrix:
    """General column vector of symbols `prefix1, prefix2, ..`."""
    return Matrix([Symbol(f"{prefix}{k}") for k in range(first, first + count)])


def hamilton(x: Vector, y: Vector) -> Matrix:
    """Hamilton product x * y of two quaternions, scalar first: the rule everything else follows from.

    (x_0 + x)(y_0 + y) = x_0 y_0 - x . y + x_0 y + y_0 x + x cross y
    """
    scalar = x[0] * y[0] - sum(x[k] * y[k] for k in (1, 2, 3))
    vector = [
        x[0] * y[k] + y[0] * x[k] + sum(LeviCivita(k, i, j) * x[i] * y[j] for i in (1, 2, 3) for j in (1, 2, 3))
        for k in (1, 2, 3)
    ]
    return Matrix([scalar, *vector])


def basis(k: int) -> Matrix:
    """Quaternion e_k, k = 0..3: 1, i, j, k."""
    return eye(4)[:, k]


def R_L(q: Vector) -> Matrix:
    """4x4 matrix of the left product: q * x = R_L(q) x, (17)."""
    return Matrix.hstack(*(hamilton(q, basis(k)) for k in range(4)))


def R_R(q: Vector) -> Matrix:
    """4x4 matrix of the right product: x * q = R_R(q) x, (17)."""
    return Matrix.hstack(*(hamilton(basis(k), q) for k in range(4)))


def rotation(sigma: Vector) -> Matrix:
    """R = R_L(q_L) R_R(q_R), 4x4, of the octonion sigma = (q_L, q_R)/sqrt(2): (16), (18).

    R is in SO(4) if q_L and q_R have unit norm, which is the same as |sigma| = 1 and |q_L| = |q_R|.
    """
    q = sqrt(2) * Matrix(sigma)
    return (R_L(q[:4]) * R_R(q[4:])).expand()


def _half_jacobian(line: Callable[[Matrix], Matrix], sigma: Matrix) -> Matrix:
    """Linear map A(sigma) with line = A(sigma) sigma.

    Each line of R is quadratic in sigma, so Euler's theorem gives line = (1/2) (d line/d sigma) sigma. Of the
    many A with this property, this is the one with A(x) y = A(y) x, which is what makes (54) true.
    """
    return line(rotation(sigma)).jacobian(sigma) / 2


def P(i: int, sigma: Matrix) -> Matrix:
    """P_i(sigma), 4x8, with column i of R equal to P_i(sigma) sigma, i = 1..4: (20)."""
    return _half_jacobian(lambda R: R[:, i - 1], sigma)


def Q(i: int, sigma: Matrix) -> Matrix:
    """Q_i(sigma), 4x8, with row i of R, as a column, equal to Q_i(sigma) sigma, i = 1..4: (28) transposed."""
    return _half_jacobian(lambda R: R[i - 1, :].T, sigma)
