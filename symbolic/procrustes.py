"""Problems 1 and 2 on SO(4): K, W, the sixteen J_jk, and F11, F22. Equations (19)-(35) and theory T1.

Model of Problem 1, (13): v_i = R u_i + t, H = sum (u_i - mean u)(v_i - mean v)^T; R maximises tr(R H).
Model of Problem 2, (27): E_i R = R Z_i with E_i, Z_i, R in SO(4), R = R_L(q_L) R_R(q_R).
"""

from __future__ import annotations

from functools import cache
from itertools import product

from sympy import Add, Expr, ImmutableMatrix, Matrix, Mul, Rational, diag, zeros
from sympy.polys.matrices import DomainMatrix

from .octonion import R_L, R_R, P, basis, coordinates, entries
from .polynomials import over_ring

Pair = tuple[int, int]
INDICES: tuple[Pair, ...] = tuple(product(range(1, 5), range(1, 5)))


@cache
def L(k: int) -> ImmutableMatrix:
    """Basis matrix L_k = R_L(e_k), k = 0..3 (T1)."""
    return R_L(basis(k)).as_immutable()


@cache
def M(k: int) -> ImmutableMatrix:
    """Basis matrix M_k = R_R(e_k), k = 0..3 (T1)."""
    return R_R(basis(k)).as_immutable()


# Problem 1 --------------------------------------------------------------------------------------------------


def W(H: Matrix) -> Matrix:
    """W, 8x8 symmetric, with sigma^T W sigma = tr(R H) for R = R(sigma): (22)-(25).

    tr(R H) = sum_i (row i of H) c_i and c_i = P_i(sigma) sigma, hence W sigma = sum_i P_i(sigma)^T H_i, which
    is linear in sigma; W is its matrix. Its eigenvector of the largest eigenvalue is the sigma of (24).
    """
    sigma = coordinates("s", 8)
    gradient = zeros(8, 1)
    for i in range(1, 5):
        gradient += P(i, sigma).T * H[i - 1, :].T  # (22)
    return gradient.jacobian(sigma)


def K(H: Matrix) -> Matrix:
    """K, 4x4, the upper right block of W, with q_L^T K q_R = tr(R H): (19), (25)."""
    return W(H)[:4, 4:]


# Problem 2 --------------------------------------------------------------------------------------------------


def J(j: int, k: int, E: Matrix, Z: Matrix) -> Matrix:
    """J_jk, 4x4, with (E R - R Z)[k, j] = q_L^T J_jk q_R; j is the column, k the row, both 1..4: (29)-(31).

    R is bilinear in (q_L, q_R), so entry (m, n) of J_jk is what the left side becomes for R = L_m M_n.
    """
    J_jk = zeros(4, 4)
    for m, n in product(range(4), repeat=2):
        R = L(m) * M(n)
        J_jk[m, n] = (E[k - 1, :] * R[:, j - 1] - R[k - 1, :] * Z[:, j - 1])[0]
    return J_jk


def sum_of_squares(E: Matrix, Z: Matrix, symbols: list[Expr]) -> tuple[DomainMatrix, DomainMatrix]:
    """F11 = sum_jk J J^T and F22 = sum_jk J^T J of one pair, 4x4, by definition (35), over Q[symbols]."""
    all_J = [over_ring(J(j, k, E, Z), symbols) for j, k in INDICES]
    F11, F22 = (all_J[0] - all_J[0] for _ in range(2))
    for J_jk in all_J:
        F11 += J_jk * J_jk.transpose()
        F22 += J_jk.transpose() * J_jk
    return F11, F22


# T1: the collapse -------------------------------------------------------------------------------------------


def inner(X: Matrix, Y: Matrix) -> Expr:
    """Frobenius product <X, Y> = tr(X^T Y)."""
    return Add(*(x * y for x, y in zip(X, Y, strict=True)))


def a_left(E: Matrix) -> Matrix:
    """Left coordinates a_k = <L_k, E>/4, k = 0..3 (T1)."""
    return Matrix([inner(L(k), E) / 4 for k in range(4)])


def c_right(E: Matrix) -> Matrix:
    """Right coordinates c_k = <M_k, E>/4, k = 0..3 (T1)."""
    return Matrix([inner(M(k), E) / 4 for k in range(4)])


Table = list[list[dict[Pair, Rational]]]


@cache
def collapsed() -> tuple[Table, Table, int]:
    """F11 and F22 in the coordinates in which the 16 J_jk collapse, found from the J_jk.

    The sixteen L_m M_n are an orthogonal basis of the 4x4 matrices, |L_m M_n|^2 = 4. Write E = sum alpha_mn
    L_m M_n, Z = sum beta_mn L_m M_n and expand (35). What is left, and this function raises if it is not so:

    - on the diagonals, weight * (|E|^2 + |Z|^2), the same for F11 and F22;
    - products alpha_m0 beta_n0 in F11, alpha_0m beta_0n in F22.

    Returns, for F11 and F22, entry by entry, the coefficients {(m, n): c} of <L_m, E><L_n, Z>, respectively
    <M_m, E><M_n, Z>, and the weight.
    """
    alpha, beta = entries("alpha"), entries("beta")
    E, Z = zeros(4, 4), zeros(4, 4)
    for m, n in product(range(4), repeat=2):
        E += alpha[m, n] * L(m) * M(n)
        Z += beta[m, n] * L(m) * M(n)
    generators = [*alpha, *beta]
    weights: set[Expr] = set()
    result = []
    for side, F in enumerate(sum_of_squares(E, Z, generators)):
        table: Table = [[{} for _ in range(4)] for _ in range(4)]
        for i, j in product(range(4), repeat=2):
            squares = {}
            for monomial, coefficient in F.rep.getitem(i, j).terms():
                at = [g for g, power in enumerate(monomial) for _ in range(power)]
                if at[0] == at[1]:
                    squares[at[0]] = coefficient
                    continue
                # generator 4 m + n is alpha_mn, 16 + 4 m + n is beta_mn
                (m, n), (m2, n2) = divmod(at[0], 4), divmod(at[1] - 16, 4)
                kept, dropped = ((m, m2), (n, n2)) if side == 0 else ((n, n2), (m, m2))
                if not (at[0] < 16 <= at[1] and dropped == (0, 0)):
                    raise ArithmeticError(f"no collapse: {generators[at[0]]} * {generators[at[1]]} in F")
                table[i][j][kept] = Rational(int(coefficient.numerator), int(coefficient.denominator)) / 16
            if i == j:
                weights.update(squares.get(g) for g in range(32))
            elif squares:
                raise ArithmeticError(f"no collapse: squares in entry {i}, {j} of F")
        result.append(table)
    (weight,) = weights  # a single weight, or the collapse does not hold
    return result[0], result[1], int(weight) // 4  # |E|^2 = 4 sum alpha^2


def F(side: str, E: Matrix, Z: Matrix) -> Matrix:
    """F11 (side "L") or F22 (side "R") of one pair, 4x4, in collapsed form (35), T1.

    Written with the linear forms <L_k, E>, <L_k, Z> (or M_k) left unexpanded, so that elimination of common
    subexpressions finds them. q_L (q_R) is the eigenvector of the smallest eigenvalue of the sum over pairs.
    """
    left, right, weight = collapsed()
    table, unit = (left, L) if side == "L" else (right, M)
    of_E = [inner(unit(k), E) for k in range(4)]
    of_Z = [inner(unit(k), Z) for k in range(4)]
    norm = weight * squared_norm(E) + weight * squared_norm(Z)
    form = Matrix(4, 4, lambda i, j: Add(*(Mul(c, of_E[m], of_Z[n]) for (m, n), c in table[i][j].items())))
    return form + diag(*[norm] * 4)


def squared_norm(E: Matrix) -> Expr:
    """|E|^2, the sum of the squared entries."""
    return Add(*(x**2 for x in E))
