"""Map from SE(3) to SO(4) with the scaling factor d: equations (49)-(51), and the perturbation of a pose.

T = (R, t) in SE(3); t and d in the same length unit. F2 is orthogonal up to terms in 1/d^2. F1 is not, even
in the dual numbers of (49): F1 F1^T = I + [[0, 2 t], [2 t^T, 0]]/d + O(1/d^2). Both respect products up to
1/d^2.
Perturbation: xi = (theta, tau), rotation first, R' = exp([theta]x) R (left), t' = t + tau (additive).
"""

from __future__ import annotations

from sympy import Expr, LeviCivita, Matrix, eye

from .octonion import coordinates, entries


def skew(v: Matrix) -> Matrix:
    """[v]x, 3x3, with [v]x y = v cross y: (3)."""
    return Matrix(3, 3, lambda i, j: sum(LeviCivita(i, k, j) * v[k] for k in range(3)))


def pose() -> tuple[Matrix, Matrix]:
    """General R (3x3) and t (3) of a pose T, symbols r11..r33 and t1..t3; nothing assumes R orthogonal."""
    return entries("r", 3), coordinates("t", 3)


def F1(R: Matrix, t: Matrix, d: Expr) -> Matrix:
    """F1(T) = [[R, t/d], [t^T R/d, 1]], 4x4: (49), (50)."""
    return _embed(R, t, t.T * R, d)


def F2(R: Matrix, t: Matrix, d: Expr) -> Matrix:
    """F2(T) = [[R, t/d], [-t^T R/d, 1]], 4x4: (51)."""
    return _embed(R, t, -t.T * R, d)


def _embed(R: Matrix, t: Matrix, row: Matrix, d: Expr) -> Matrix:
    return Matrix.vstack(Matrix.hstack(R, t / d), Matrix.hstack(row / d, eye(1)))


def perturbed(R: Matrix, t: Matrix, xi: Matrix) -> tuple[Matrix, Matrix]:
    """The pose moved by a small xi = (theta, tau), to first order: exp([theta]x) = I + [theta]x."""
    return (eye(3) + skew(xi[:3, :])) * R, t + xi[3:, :]
