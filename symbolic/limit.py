"""Theory T2: the limit of F2(T, d) in Problem 2 as d goes to infinity, u(T) and w(T).

Problem 2 sees E = F2(T, d) only through the vector parts of a_left(E) and c_right(E) (T1; the scalar parts
enter F11 and F22 as multiples of the identity). Both are affine in 1/d:

    vector part of a = N_a (u - w/d),   vector part of c = N_c (u + w/d),

N_a, N_c half of a signed permutation each. Their values, the signs, u and w are derived here, not stated.
"""

from __future__ import annotations

from typing import NamedTuple

from sympy import Matrix, Symbol, eye, zeros

from .octonion import coordinates
from .procrustes import a_left, c_right
from .so4 import F2, perturbed, pose


def at_pose(expression: Matrix, R: Matrix, t: Matrix) -> Matrix:
    """The expression in the general pose (`so4.pose`) at another pose (R, t)."""
    general_R, general_t = pose()
    return expression.subs(dict(zip([*general_R, *general_t], [*R, *t], strict=True)), simultaneous=True)


class IsoclinicPart(NamedTuple):
    """Vector part of a_left or c_right of F2(T, d) = normaliser * (u + sign * w/d)."""

    normaliser: Matrix
    sign: int
    u: Matrix
    w: Matrix


def isoclinic_part(side: str) -> IsoclinicPart:
    """Derive u, w and the constants from a_left (side "L") or c_right (side "R") of F2(T, d).

    Two conventions fix what the limit alone leaves free: u is the rotation vector theta to first order at
    R = I (this gives the normaliser), and w is t at R = I (this gives the sign).
    """
    R, t = pose()
    epsilon = Symbol("epsilon")  # 1/d
    read = a_left if side == "L" else c_right
    vector = read(F2(R, t, 1 / epsilon))[1:, :].expand()
    at_infinity = vector.subs(epsilon, 0)
    slope = vector.diff(epsilon)
    if slope.has(epsilon):
        raise ArithmeticError("the isoclinic parts of F2 are not affine in 1/d")

    xi = coordinates("xi", 6)
    R_small, t_small = perturbed(eye(3), zeros(3, 1), xi)
    small = at_pose(at_infinity, R_small, t_small)
    normaliser = small.jacobian(xi[:3, :])
    u = (normaliser.inv() * at_infinity).expand()
    signed_w = (normaliser.inv() * slope).expand()
    orientation = at_pose(signed_w, eye(3), t).jacobian(t)
    if orientation not in (eye(3), -eye(3)):
        raise ArithmeticError("the 1/d term of F2 at R = I is not +t or -t")
    sign = int(orientation[0, 0])
    return IsoclinicPart(normaliser, sign, u, (sign * signed_w).expand())


def u() -> Matrix:
    """u(T) = vee(R)/2 = sin(angle) axis, (3,), the limit of the isoclinic vector parts (T2)."""
    return isoclinic_part("L").u


def w() -> Matrix:
    """w(T) = (t + R^T t)/2, (3,), the 1/d term of the isoclinic vector parts; length unit of t (T2)."""
    return isoclinic_part("L").w
