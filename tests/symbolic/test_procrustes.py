"""Symbolic proofs: K, W, J_jk, F11, F22 and their collapse T1. Equations (19)-(26), (29)-(35)."""

from functools import cache
from itertools import product

import pytest
from sympy import Matrix, Symbol, eye, kronecker_product, randMatrix, trace, zeros

from uq_handeye.symbolic import derivatives
from uq_handeye.symbolic.octonion import R_L, R_R, P, coordinates, entries, rotation
from uq_handeye.symbolic.polynomials import identical, over_ring, symbols_of
from uq_handeye.symbolic.procrustes import INDICES, F, J, K, W, a_left, c_right, squared_norm, sum_of_squares

SIGMA = coordinates("s", 8)
Q_LEFT, Q_RIGHT = coordinates("l", 4), coordinates("r", 4)
E, Z, H = entries("e"), entries("z"), entries("H")
RING = symbols_of(E, Z)


@cache
def definition():
    """F11, F22 of one pair as (35) defines them, from the sixteen J."""
    return sum_of_squares(E, Z, RING)


def sym(X):
    return (X + X.T) / 2


@pytest.mark.slow
def test_W_is_the_objective_of_problem_1():
    """(13): sigma^T W sigma = tr(R H), which R minimising (13) maximises; W symmetric."""
    assert identical(Matrix([SIGMA.dot(W(H) * SIGMA)]), Matrix([trace(rotation(SIGMA) * H)]))
    assert W(H) == W(H).T


@pytest.mark.slow
def test_W_is_the_left_side_of_22():
    left = zeros(8, 1)
    for i in range(1, 5):
        left += P(i, SIGMA).T * H[i - 1, :].T
    assert identical(W(H) * SIGMA, left)


@pytest.mark.slow
def test_blocks_of_W():
    """(25): W = [[0, K], [K^T, 0]], and q_L^T K q_R = tr(R H)."""
    zero = zeros(4, 4)
    assert W(H) == Matrix.vstack(Matrix.hstack(zero, K(H)), Matrix.hstack(K(H).T, zero))
    R = R_L(Q_LEFT) * R_R(Q_RIGHT)
    assert identical(Q_LEFT.T * K(H) * Q_RIGHT, Matrix([trace(R * H)]))


@pytest.mark.slow
def test_determinant_of_W():
    """(26): det(lambda I - W) = det(lambda^2 I - K^T K), for every K and lambda.

    (lambda I - W) [[I, K], [0, lambda I]] is block triangular with lambda I and lambda^2 I - K^T K on its
    diagonal. Determinants: det(lambda I - W) lambda^4 = lambda^4 det(lambda^2 I - K^T K); both sides are
    polynomials in lambda, so lambda^4 cancels. The factorisation is checked for a general K.
    """
    general, x, one, zero = entries("k"), Symbol("lambda"), eye(4), zeros(4, 4)
    left = Matrix([[x * one, -general], [-general.T, x * one]])
    right = Matrix([[one, general], [zero, x * one]])
    triangular = Matrix([[x * one, zero], [-general.T, x**2 * one - general.T * general]])
    assert identical(left * right, triangular)

    numbers = randMatrix(4, 4, min=-9, max=9, seed=5)  # and (26) itself at an integer H
    of_W = (x * eye(8) - W(numbers)).det(method="berkowitz")
    of_K = (x**2 * one - K(numbers).T * K(numbers)).det(method="berkowitz")
    assert of_W.expand() == of_K.expand()


@pytest.mark.slow
@pytest.mark.parametrize(("j", "k"), INDICES)
def test_J_is_the_residual(j, k):
    """(29)-(31): (E R - R Z)[k, j] = q_L^T J_jk q_R for all E, Z, q_L, q_R."""
    R = R_L(Q_LEFT) * R_R(Q_RIGHT)
    residual = (E[k - 1, :] * R[:, j - 1] - R[k - 1, :] * Z[:, j - 1])[0]
    assert identical(Q_LEFT.T * J(j, k, E, Z) * Q_RIGHT, Matrix([residual]))


@pytest.mark.slow
@pytest.mark.parametrize(("side", "number"), [("L", 0), ("R", 1)])
def test_collapsed_form_is_the_sum_over_J(side, number):
    """The printed collapsed form of F11 and F22 equals (35) for all E, Z."""
    assert over_ring(F(side, E, Z), RING) == definition()[number]


@pytest.mark.slow
def test_collapse_T1():
    """T1 as stated, for all E and Z, orthogonal or not.

    F11 = 4 (|E|^2 + |Z|^2) I - 32 sym(R_L(a)^T R_R(b)),  F22 = .. - 32 sym(R_R(c)^T R_L(e)).
    """
    norms = 4 * (squared_norm(E) + squared_norm(Z)) * eye(4)
    F11 = norms - 32 * sym(R_L(a_left(E)).T * R_R(a_left(Z)))
    F22 = norms - 32 * sym(R_R(c_right(E)).T * R_L(c_right(Z)))
    assert (over_ring(F11, RING), over_ring(F22, RING)) == definition()


@pytest.mark.slow
@pytest.mark.parametrize(("side", "number"), [("L", 0), ("R", 1)])
def test_derivatives_by_the_data(side, number):
    """(43), (45): d vec(F)/d b from the J by the product rule, and its contraction with q."""
    D = derivatives.dF_db(side, E, Z)
    total = definition()[number]
    found = over_ring(D, RING)
    for column, symbol in enumerate(derivatives.data(E, Z)):
        generator = total.domain(symbol)
        for row, (j, i) in enumerate(product(range(4), repeat=2)):  # vec, column-major
            assert found.rep.getitem(row, column) == total.rep.getitem(i, j).diff(generator)
    q = coordinates("q", 4, first=0)
    assert identical(kronecker_product(q.T, eye(4)) * D, derivatives.dFq_db(side, E, Z, q))


def test_order_of_the_data():
    """b stacks vec E over vec Z, column by column."""
    assert [s.name for s in derivatives.data(E, Z)][:5] == ["e11", "e21", "e31", "e41", "e12"]
    assert derivatives.data(E, Z)[16:20] == list(Z[:, 0])
