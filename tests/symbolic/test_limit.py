"""Symbolic proofs of theory T2: what Problem 2 becomes as d goes to infinity.

Chain of statements, each one test, with epsilon = 1/d:

1. The isoclinic parts of F2(T, d) are, in a fixed frame, u - epsilon w (left) and u + epsilon w (right),
   exactly.
2. q^T F11 q and q^T F22 q are, for every q, a constant minus 32 times the objective of a Wahba problem in
   the vector parts of a and c; the scalar parts contribute constants.
3. If X4 = F2(X, d), conjugation with X4 moves the left and right parts by R_left = (I - epsilon [t]x) R and
   R_right = (I + epsilon [t]x) R, up to epsilon^2.
4. With these rotations the stationarity conditions of the two Wahba problems are g -+ epsilon h up to
   epsilon^2, g = sum u x R v, h = sum(u x (t x R v) + w x R v + u x R z). So both hold in the limit if and
   only if g = 0 and h = 0.
5. g = 0 says that H R^T is symmetric, H = sum u v^T, and then h = 0 is M t = -sum(w x R v + u x R z).

Not proved by symbols: that the minimiser at finite d tends to this stationary point. That follows where the
smallest eigenvalues are simple (eigenvectors are then analytic in epsilon; the left problem at epsilon is the
right problem at -epsilon) and is measured in `test_closed_form.py`.
"""

import pytest
from sympy import Matrix, Rational, Symbol, eye, trace, zeros

from uq_handeye.symbolic.limit import at_pose, isoclinic_part
from uq_handeye.symbolic.octonion import R_L, R_R, coordinates, entries, hamilton
from uq_handeye.symbolic.polynomials import identical
from uq_handeye.symbolic.procrustes import F, a_left, c_right, squared_norm
from uq_handeye.symbolic.so4 import F1, F2, pose, skew

EPSILON = Symbol("epsilon")
SIDES = pytest.mark.parametrize(("side", "read", "sign"), [("L", a_left, -1), ("R", c_right, 1)])


def quaternion_rotation(q):
    """|q|^2 times the rotation matrix of q * x * conj(q): a polynomial stand-in for every R in SO(3)."""
    return (R_L(q) * R_R(q).T)[1:, 1:]


def up_to_first_order(matrix):
    """Drop the terms in epsilon^2 and above."""
    return (matrix.subs(EPSILON, 0) + EPSILON * matrix.diff(EPSILON).subs(EPSILON, 0)).applyfunc(lambda x: x.expand())


@SIDES
def test_isoclinic_parts_of_F2(side, read, sign):
    """1: vector part of a = N (u - w/d), of c = N (u + w/d), exactly, with 2 N a signed permutation."""
    R, t = pose()
    part = isoclinic_part(side)
    u = Matrix([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2  # vee(R)/2
    w = (t + R.T * t) / 2
    assert part.sign == sign
    assert identical(part.u, u)
    assert identical(part.w, w)
    assert 4 * part.normaliser.T * part.normaliser == eye(3)
    assert {abs(x) for x in part.normaliser} == {0, Rational(1, 2)}
    vector = read(F2(R, t, 1 / EPSILON))[1:, :]
    assert identical(vector, part.normaliser * (u + sign * EPSILON * w))
    assert identical(Matrix([read(F2(R, t, 1 / EPSILON))[0]]), Matrix([(trace(R) + 1) / 4]))


@pytest.mark.slow
def test_problem_2_is_two_wahba_problems():
    """2: q^T F11 q = 4 (|E|^2 + |Z|^2)|q|^2 - 32 (a_0 b_0 |q|^2 + a . Rot(q) b) for all E, Z, q.

    F22 likewise with c, e and the inverse rotation Rot(conj q); Rot(q) b = q * b * conj(q).
    """
    E, Z, q = entries("e"), entries("z"), coordinates("q", 4, first=0)
    for side, read, unit in (("L", a_left, q), ("R", c_right, Matrix([q[0], *(-q[1:, :])]))):
        a, b = read(E), read(Z)
        conjugate = Matrix([unit[0], *(-unit[1:, :])])
        moved = hamilton(hamilton(unit, Matrix([0, *b[1:, :]])), conjugate)
        assert moved[0].expand() == 0
        wahba = a[1:, :].dot(moved[1:, :]) + a[0] * b[0] * q.dot(q)
        norms = 4 * (squared_norm(E) + squared_norm(Z)) * q.dot(q)
        assert identical(q.T * F(side, E, Z) * q, Matrix([norms - 32 * wahba]))


def test_stationarity_of_a_wahba_problem():
    """d/d theta of u . exp([theta]x) R v at 0 is (R v) x u: the condition is sum u x R v = 0."""
    u, y, theta = coordinates("u", 3), coordinates("y", 3), coordinates("theta", 3)
    slope = Matrix([u.dot((eye(3) + skew(theta)) * y)]).jacobian(theta)
    assert identical(slope.T, y.cross(u))


@pytest.mark.slow
@SIDES
def test_rotations_of_the_isoclinic_parts(side, read, sign):
    """3: conjugation with F2(X, d) acts on them as (I + sign epsilon [t]x) R, up to epsilon^2.

    R of X stands for |q|^2 times a rotation, R of B is any 3x3 matrix; both sides carry the factor |q|^4.
    """
    part = isoclinic_part(side)
    R_B, t_B = pose()
    t, q = coordinates("tau", 3), coordinates("q", 4, first=0)
    R, n = quaternion_rotation(q), q.dot(q)
    X4 = Matrix.vstack(Matrix.hstack(R, EPSILON * n * t), Matrix.hstack(-EPSILON * t.T * R, n * eye(1)))
    B4 = F2(R_B, t_B, 1 / EPSILON)
    conjugated = up_to_first_order(part.normaliser.inv() * read(X4 * B4 * X4.T)[1:, :])
    v, z = part.u, part.w
    rotated = n * (eye(3) + sign * EPSILON * skew(t)) * R * (v + sign * EPSILON * z)
    assert identical(conjugated, up_to_first_order(rotated))


@pytest.mark.slow
@pytest.mark.parametrize("sign", [-1, 1])
def test_stationarity_in_the_limit(sign):
    """4: the condition of either Wahba problem is g + sign epsilon h + O(epsilon^2), any R, t, u, w, v, z."""
    u, w, v, z, t = (coordinates(name, 3) for name in "uwvzt")
    R = entries("r", 3)
    e = sign * EPSILON
    condition = (u + e * w).cross((eye(3) + e * skew(t)) * R * (v + e * z))
    g = u.cross(R * v)
    h = u.cross(t.cross(R * v)) + w.cross(R * v) + u.cross(R * z)
    assert identical(up_to_first_order(condition), g + e * h)


def test_closed_form_of_the_translation():
    """5, for y = R v, H R^T = u y^T: u x y is its skew part, u x (t x y) = (tr(H R^T) I - (H R^T)^T) t."""
    u, y, t = (coordinates(name, 3) for name in "uyt")
    HRt = u * y.T
    assert identical(HRt - HRt.T, -skew(u.cross(y)))
    assert identical(u.cross(t.cross(y)), (trace(HRt) * eye(3) - HRt.T) * t)


@pytest.mark.slow
def test_orthogonality_of_the_maps():
    """(49)-(51): F2 F2^T = I + O(1/d^2), but F1 F1^T = I + [[0, 2 t], [2 t^T, 0]]/d + O(1/d^2)."""
    q, t = coordinates("q", 4, first=0), coordinates("tau", 3)
    n = q.dot(q)
    R = quaternion_rotation(q) / n
    off = Matrix.vstack(Matrix.hstack(zeros(3, 3), 2 * t), Matrix.hstack(2 * t.T, zeros(1, 1)))
    for embed, slope in ((F2, zeros(4, 4)), (F1, off)):
        image = embed(R, t, 1 / EPSILON)
        product = (image * image.T).applyfunc(lambda x: x.together().as_numer_denom()[0].expand())
        scale = (image * image.T).applyfunc(lambda x: x.together().as_numer_denom()[1])
        wanted = (eye(4) + EPSILON * slope).multiply_elementwise(scale)
        assert identical(up_to_first_order(product), up_to_first_order(wanted.expand()))


def test_at_pose_is_simultaneous():
    R, t = pose()
    assert at_pose(Matrix([R[0, 1]]), R.T, t)[0] == R[1, 0]
