"""Derivatives that the covariances need: of F11, F22 by the data (43), (45), of the data by the pose.

b = (vec E, vec Z) in R^32, vec column-major as in the paper. xi = (theta, tau) in R^6 (see `so4`).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

from sympy import Add, Expr, Matrix, Mul, zeros

from .octonion import coordinates
from .procrustes import F, L, M, collapsed
from .so4 import perturbed, pose


def vec(X: Matrix) -> Matrix:
    """Column-major vec of a matrix, as a column."""
    return X.T.reshape(X.rows * X.cols, 1)


def data(E: Matrix, Z: Matrix) -> Matrix:
    """b = (vec E, vec Z), 32 entries: (45)."""
    return Matrix.vstack(vec(E), vec(Z))


def dF_db(side: str, E: Matrix, Z: Matrix) -> Matrix:
    """d vec(F)/d b, 16x32, for F = F11 (side "L") or F22 (side "R") of one pair: (43), (45)."""
    return vec(F(side, E, Z)).jacobian(data(E, Z))


def dFq_db(side: str, E: Matrix, Z: Matrix, q: Matrix) -> Matrix:
    """(q^T kron I) d vec(F)/d b = d(F q)/d b at constant q, 4x32: the part of (42) that varies with the pair.

    F q = weight (|E|^2 + |Z|^2) q + sum_mn <X_m, E><X_n, Z> C_mn q with X = L or M and constant C_mn (T1). By
    the chain rule each entry needs one of 4x4 sums, which are written once each instead of expanded.
    """
    left, right, weight = collapsed()
    table, unit = (left, L) if side == "L" else (right, M)

    def contracted(i: int, k: int, other: Matrix, of: int) -> Expr:
        """Coefficient of <X_k, E> (of = 0) or <X_k, Z> (of = 1) in row i of F q."""
        terms = []
        for j in range(4):
            for pair, c in table[i][j].items():
                if pair[of] == k:
                    X = unit(pair[1 - of])
                    terms.append(Mul(c, Add(*(x * y for x, y in zip(X, other, strict=True))), q[j]))
        return Add(*terms)

    result = zeros(4, 32)
    for of, (own, other) in enumerate(((E, Z), (Z, E))):
        for i, k in product(range(4), repeat=2):
            sums = contracted(i, k, other, of)
            # <X_k, own> depends on own[row, column] through the sign X_k[row, column]
            for column, row in product(range(4), repeat=2):
                if (sign := unit(k)[row, column]) != 0:
                    result[i, 16 * of + 4 * column + row] += sign * sums
        for i, column, row in product(range(4), repeat=3):
            result[i, 16 * of + 4 * column + row] += 2 * weight * own[row, column] * q[i]
    return result


def by_pose(function: Callable[[Matrix, Matrix], Matrix]) -> Matrix:
    """d vec(function(T'))/d xi at xi = 0, n x 6, T' the perturbed general pose."""
    xi = coordinates("xi", 6)
    R, t = pose()
    moved = vec(function(*perturbed(R, t, xi)))
    return moved.jacobian(xi).subs(dict.fromkeys(xi, 0)).expand()
