"""Constrained minimum of the dual-quaternion equations, certified by a semidefinite relaxation: the method `heller`."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from threading import Lock
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array
from ..core.iterations import MAX_STEPS
from ..core.rounding import EPS, HALF_DIGITS, PRODUCT_ROUNDING, SOLUTION_ROUNDING, THIRD_DIGITS
from ..errors import MissingExtraError
from .degeneracy import MIN_SPREAD_RATIO
from .dual_quaternions import dual_factors, dual_gram
from .method import Estimate, Method, published, require
from .moments import Moments, MomentSolver
from .quaternions import dual_quaternions, left_matrix, pose_of

# The constraints of s = (q, q') as quadratic forms: s^T E1 s = |q|^2 and s^T E2 s = q . q'.
E1 = np.diag([1.0] * 4 + [0.0] * 4)
E2 = 0.5 * np.eye(8)[[4, 5, 6, 7, 0, 1, 2, 3]]


def _heller(moments: Moments, N: int) -> Estimate:
    r"""Heller, Henrion and Pajdla (2014): global polynomial optimisation by linear matrix inequalities.

    With dual quaternions, ``s = (q, q')`` and the Gram matrix ``G = sum M^T M`` of the 8x8 equations of `lu`,

        minimise  s^T G s   subject to  s^T E1 s = |q|^2 = 1,   s^T E2 s = q . q' = 0

    The publication relaxes this to a semidefinite program. Of lowest order, that is Shor's relaxation, ``min tr(G W)``
    with W (8x8, positive semidefinite) for ``s s^T``, and its dual

        maximise  lambda  subject to  G - lambda E1 - mu E2  positive semidefinite

    With two quadratic equations it is exact: some optimal W has rank r with r (r + 1) / 2 <= 2, hence rank 1.

    Chosen here are the unit and the way back from W. Lengths are measured such that both diagonal blocks of G have the
    same trace. Without noise ``(0, q)`` is an unbounded direction of W, and close minima share W: so it is cut to its
    two largest eigenvalues and split, ``W = s1 s1^T + s2 s2^T``, such that each part has ``q . q' = 0`` (the quadratic
    equation of `daniilidis`). Newton's method on the conditions of stationarity

        (G - lambda E1 - mu E2) s = 0,   |q|^2 = 1,   q . q' = 0

    takes both from the tolerance of the solver to rounding, and the lower one is X. Converged means that the solver
    reports an optimum, that Newton's method has ended, and that ``G - lambda E1 - mu E2`` is positive semidefinite to
    rounding: so lambda is a lower bound of the minimum, and as s attains it, X is the global one. It depends on the
    unit of length.
    """
    G, unit = scaled_gram(moments[0], N)
    T = len(G)
    program, lock = _program()
    starts, optimal = np.empty((T, 2, 8)), np.zeros(T, dtype=bool)
    with lock:
        for t in range(T):
            starts[t], optimal[t] = _relaxed(program, G[t])
    twice = np.repeat(G, 2, axis=0)
    s, multipliers, ended, iterations = stationary(twice, starts.reshape(-1, 8))
    value = np.where(ended, np.einsum("ti,tij,tj->t", s, twice, s), np.inf)
    best = np.arange(T) * 2 + np.argmin(value.reshape(T, 2), axis=1)
    s, multipliers, ended, iterations = s[best], multipliers[best], ended[best], iterations[best]
    slack = np.linalg.eigvalsh(G - np.einsum("tk,kab->tab", multipliers, np.stack([E1, E2])))
    converged = optimal & ended & (slack[:, 0] >= -SOLUTION_ROUNDING * slack[:, -1])
    # besides s, and (0, q) without noise, nothing may solve the equations as well
    require(~converged | (slack[:, 2] > MIN_SPREAD_RATIO * slack[:, -1]), "two poses fit equally well.")
    return Estimate(in_units(s, unit), converged, iterations)


def nearby(moments: Moments, N: int, X: Array) -> Array:
    """The stationary point (T, 4, 4) of s^T G s next to X."""
    G, unit = scaled_gram(moments[0], N)
    q = Rotation.from_matrix(X[:, :3, :3], assume_valid=True).as_quat(scalar_first=True)
    s = dual_quaternions(X, q)
    s[:, 4:] /= unit[:, None]
    return in_units(stationary(G, s)[0], unit)


def scaled_gram(moments: Array, N: int) -> tuple[Array, Array]:
    """G (T, 8, 8), its diagonal blocks of trace 1, for q' in the unit of length (T,) returned too."""
    G = dual_gram(moments)
    real, dual = (np.trace(G[:, k : k + 4, k : k + 4], axis1=1, axis2=2) for k in (0, 4))
    spread = np.linalg.eigvalsh(G[:, 4:, 4:])
    require(
        (spread[:, 1] > MIN_SPREAD_RATIO * spread[:, 3]) & (dual > PRODUCT_ROUNDING * N),
        "the rotation axes are parallel.",
    )
    scale = np.repeat(1.0 / np.sqrt(np.stack([real, dual], axis=1)), 4, axis=1)
    return G * scale[:, :, None] * scale[:, None, :], np.sqrt(real / dual)


def in_units(s: Array, unit: Array) -> Array:
    """The poses (T, 4, 4) of ``(q, q' / unit)`` (T, 8)."""
    return pose_of(np.concatenate([s[:, :4], s[:, 4:] * unit[:, None]], axis=1))


def stationary(G: Array, start: Array) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.intp]]:
    """Apply Newton's method from ``start`` (T, 8): s, (lambda, mu) (T, 2), whether it ended, and after how many steps.

    The steps are those of the ten conditions of stationarity at an s that meets the constraints, solved in the six
    directions that keep them, ``s -> (1 + eps theta/2) s`` for dual vectors theta. A step in rad and in typical lengths
    that is as short as rounding ends it, or one of half as many digits that no longer shrinks.
    """
    s = _feasible(start)
    T = len(G)
    converged, iterations = np.zeros(T, dtype=bool), np.zeros(T, dtype=np.intp)
    previous, active = np.full(T, np.inf), np.arange(T)
    for count in range(1, MAX_STEPS + 1):
        x = s[active]
        tangent = np.einsum("kab,tb->tka", _TANGENTS, x)
        S, _ = _lagrangian(G[active], x)
        hessian = tangent @ S @ tangent.mT
        ridge = EPS * np.trace(hessian, axis1=1, axis2=2)  # keeps a singular matrix from raising
        step = np.linalg.solve(hessian + ridge[:, None, None] * np.eye(6), -tangent @ S @ x[..., None])
        s[active] = _feasible(x + (tangent.mT @ step)[..., 0])
        length = np.abs(step[..., 0]).max(axis=1)
        ends = (length < PRODUCT_ROUNDING) | ((length < HALF_DIGITS) & (length >= 0.25 * previous[active]))
        previous[active], iterations[active] = length, count
        converged[active[ends]] = True
        active = active[~ends]
        if not active.size:
            break
    return s, _lagrangian(G, s)[1], converged, iterations


def _lagrangian(G: Array, s: Array) -> tuple[Array, Array]:
    """``G - lambda E1 - mu E2`` with the multipliers that leave no gradient along (q, 0) and (0, q); (lambda, mu)."""
    slope = (G @ s[..., None])[..., 0]
    multipliers = np.einsum("ti,tki->tk", s[:, :4], np.stack([slope[:, :4], 2.0 * slope[:, 4:]], axis=1))
    return G - np.einsum("tk,kab->tab", multipliers, np.stack([E1, E2])), multipliers


def _feasible(s: Array) -> Array:
    """s (T, 8) with |q| = 1 and q . q' = 0."""
    s = s / np.linalg.norm(s[:, :4], axis=1, keepdims=True)
    s[:, 4:] -= np.einsum("ti,ti->t", s[:, :4], s[:, 4:])[:, None] * s[:, :4]
    return s


def _tangents() -> Array:
    """The matrices (6, 8, 8) of ``s -> theta/2 s`` and ``s -> eps theta/2 s`` for the unit vectors theta."""
    half = 0.5 * left_matrix(np.eye(4)[1:])
    tangents = np.zeros((6, 8, 8))
    tangents[:3, :4, :4] = tangents[:3, 4:, 4:] = tangents[3:, 4:, :4] = half
    return tangents


_TANGENTS = _tangents()


@cache
def _program() -> tuple[Any, Lock]:
    """The dual program in CVXPY, compiled once for all G; and what keeps two threads from sharing it."""
    try:
        cp = import_module("cvxpy")
        import_module("clarabel")
    except ImportError as error:
        raise MissingExtraError(
            "Method 'heller' needs CVXPY and Clarabel: pip install '.[sdp]' in the clone of uq-handeye."
        ) from error
    G = cp.Parameter((8, 8), symmetric=True, name="G")
    lam, mu = cp.Variable(name="lambda"), cp.Variable(name="mu")
    return cp.Problem(cp.Maximize(lam), [G - lam * E1 - mu * E2 >> 0]), Lock()


def _relaxed(program: Any, G: Array) -> tuple[Array, bool]:
    """Two candidates (2, 8) from the solution W of the relaxation, and whether the solver says that it is optimal.

    An inaccurate optimum will do: Newton's method makes it accurate, and the certificate proves it.
    """
    cp = import_module("cvxpy")
    program.param_dict["G"].value = G
    with catch_warnings():
        simplefilter("ignore", UserWarning)  # of inaccurate solutions, which the status tells too
        try:
            program.solve(solver=cp.CLARABEL)
        except cp.error.SolverError:
            return np.tile([0.5] * 4 + [0.0] * 4, (2, 1)), False
    W = np.asarray(program.constraints[0].dual_value)
    values, vectors = np.linalg.eigh(0.5 * (W + W.T))
    U = vectors[:, -2:] * np.sqrt(np.maximum(values[-2:], 0.0))
    signs, axes = np.linalg.eigh(U.T @ E2 @ U)
    weights = np.sqrt(np.abs(signs[::-1]))
    roots = np.stack([weights, weights * [1.0, -1.0]]) @ (U @ axes).T
    sizes = np.linalg.norm(roots[:, :4], axis=1)
    roots = np.where((sizes > THIRD_DIGITS * sizes.max())[:, None], roots, roots[np.argmax(sizes)])
    return roots, program.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)


HELLER = Method(
    **published("heller"),
    solver=MomentSolver(dual_factors, _heller, nearby),
    mathematics=_heller.__doc__,
    extra="sdp",
)
