"""Symbolic proofs: the quaternion product, R_L, R_R, P_i, Q_i. Equations (16)-(21), (28), (54)."""

import pytest
from sympy import Matrix, Rational, Symbol, eye, zeros

from uq_handeye.symbolic.octonion import R_L, R_R, P, Q, basis, coordinates, hamilton, rotation
from uq_handeye.symbolic.polynomials import identical, over_ring, symbols_of

SIGMA, OTHER = coordinates("s", 8), coordinates("y", 8)
X, Y, Z = (coordinates(name, 4, first=0) for name in "xyz")
LINES = pytest.mark.parametrize("i", [1, 2, 3, 4])


def test_hamilton_product_is_the_quaternion_algebra():
    one, i, j, k = (basis(n) for n in range(4))
    assert hamilton(i, j) == k
    assert hamilton(j, k) == i
    assert hamilton(k, i) == j
    assert all(hamilton(unit, unit) == -one for unit in (i, j, k))
    assert identical(hamilton(hamilton(X, Y), Z), hamilton(X, hamilton(Y, Z)))


def test_left_and_right_matrices_are_the_products():
    """(17): q * x = R_L(q) x, x * q = R_R(q) x; the two commute; R^T R = |q|^2 I."""
    assert identical(R_L(X) * Y, hamilton(X, Y))
    assert identical(R_R(X) * Y, hamilton(Y, X))
    assert identical(R_L(X) * R_R(Y), R_R(Y) * R_L(X))
    norm = X.dot(X) * eye(4)
    assert identical(R_L(X).T * R_L(X), norm)
    assert identical(R_R(X).T * R_R(X), norm)


@pytest.mark.slow
def test_rotation_is_in_so4():
    """(16), (18): R^T R = |q_L|^2 |q_R|^2 I with q = sqrt(2) sigma; det R = (|q_L| |q_R|)^4 at a point."""
    R = rotation(SIGMA)
    scale = 4 * SIGMA[:4, :].dot(SIGMA[:4, :]) * SIGMA[4:, :].dot(SIGMA[4:, :])
    assert identical(R.T * R, scale * eye(4))
    point = dict(zip(SIGMA, [Rational(n, 7) for n in (1, -2, 3, 5, 4, 1, -6, 2)], strict=True))
    assert R.subs(point).det() == scale.subs(point) ** 2


@pytest.mark.slow
@LINES
def test_columns_factor(i):
    """(20): column i of R is P_i(sigma) sigma."""
    assert identical(P(i, SIGMA) * SIGMA, rotation(SIGMA)[:, i - 1])


@LINES
def test_rows_factor(i):
    """(28), transposed: row i of R is Q_i(sigma) sigma."""
    assert identical(Q(i, SIGMA) * SIGMA, rotation(SIGMA)[i - 1, :].T)


@LINES
@pytest.mark.parametrize("factor", [P, Q])
def test_factors_are_orthonormal(factor, i):
    """(21): P_i P_i^T = |sigma|^2 I = (|q_L|^2 + |q_R|^2)/2 I, likewise Q_i; the four agree."""
    assert identical(factor(i, SIGMA) * factor(i, SIGMA).T, SIGMA.dot(SIGMA) * eye(4))


@pytest.mark.slow
@LINES
@pytest.mark.parametrize("factor", [P, Q])
def test_factors_are_symmetric_maps(factor, i):
    """(54): P_i(x) y = Y_i(y) x with Y_i = P_i, for any x and y."""
    assert identical(factor(i, SIGMA) * OTHER, factor(i, OTHER) * SIGMA)


@LINES
def test_derivative_of_a_column(i):
    """(55): d c_i / d sigma = 2 P_i(sigma)."""
    column = rotation(SIGMA)[:, i - 1]
    assert identical(column.jacobian(SIGMA), 2 * P(i, SIGMA))


def test_identical_sees_a_difference():
    a = Symbol("a")
    assert not identical(Matrix([a + 1]), Matrix([a]))
    assert not identical(Matrix([1]), Matrix([2]))
    assert identical(Matrix([(a + 1) ** 2]), Matrix([a**2 + 2 * a + 1]))
    assert over_ring(zeros(1, 1), symbols_of(Matrix([a]))).to_Matrix() == zeros(1, 1)
