r"""Constrained minima of the dual-quaternion equations: certified (`heller`), and by two steps in turn (`zhang`)."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from threading import Lock
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...core.geometry.se3 import Array
from ...errors import MissingExtraError
from ..procrustes.degeneracy import DEGENERATE
from .dual_quaternions import dual_factors, dual_gram
from .method import Estimate, Method, published, require
from .moments import Moments, MomentSolver, dual_quaternions, left_matrix, pose_of

ITERATIONS = 50
# Steps of Newton's method in rad and in typical lengths: converged below STEP, or where rounding stops it.
STEP = 1e-14
ROUNDED_STEP = 1e-8
# How negative an eigenvalue rounding may make, relative to the largest.
ROUNDING = 1e-12

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
    converged = optimal & ended & (slack[:, 0] >= -ROUNDING * slack[:, -1])
    # besides s, and (0, q) without noise, nothing may solve the equations as well
    require(~converged | (slack[:, 2] > DEGENERATE * slack[:, -1]), "two poses fit equally well.")
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
    require((spread[:, 1] > DEGENERATE * spread[:, 3]) & (dual > 1e-14 * N), "the rotation axes are parallel.")
    scale = np.repeat(1.0 / np.sqrt(np.stack([real, dual], axis=1)), 4, axis=1)
    return G * scale[:, :, None] * scale[:, None, :], np.sqrt(real / dual)


def in_units(s: Array, unit: Array) -> Array:
    """The poses (T, 4, 4) of ``(q, q' / unit)`` (T, 8)."""
    return pose_of(np.concatenate([s[:, :4], s[:, 4:] * unit[:, None]], axis=1))


def stationary(G: Array, start: Array) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.intp]]:
    """Newton's method from ``start`` (T, 8): s, (lambda, mu) (T, 2), whether it ended, and after how many steps.

    The steps are those of the ten conditions of stationarity at an s that meets the constraints, solved in the six
    directions that keep them, ``s -> (1 + eps theta/2) s`` for dual vectors theta.
    """
    s = _feasible(start)
    T = len(G)
    converged, iterations = np.zeros(T, dtype=bool), np.zeros(T, dtype=np.intp)
    previous, active = np.full(T, np.inf), np.arange(T)
    for count in range(1, ITERATIONS + 1):
        x = s[active]
        tangent = np.einsum("kab,tb->tka", _TANGENTS, x)
        S, _ = _lagrangian(G[active], x)
        hessian = tangent @ S @ tangent.mT
        ridge = 1e-15 * np.trace(hessian, axis1=1, axis2=2)  # keeps a singular matrix from raising
        step = np.linalg.solve(hessian + ridge[:, None, None] * np.eye(6), -tangent @ S @ x[..., None])
        s[active] = _feasible(x + (tangent.mT @ step)[..., 0])
        length = np.abs(step[..., 0]).max(axis=1)
        ends = (length < STEP) | ((length < ROUNDED_STEP) & (length >= 0.25 * previous[active]))
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
    roots = np.where((sizes > 1e-6 * sizes.max())[:, None], roots, roots[np.argmax(sizes)])
    return roots, program.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)


HELLER = Method(
    **published("heller"),
    solver=MomentSolver(dual_factors, _heller, nearby),
    mathematics=_heller.__doc__,
    extra="sdp",
)


STEPS_IN_TURN = 500


def _zhang(moments: Moments, N: int) -> Estimate:
    r"""Zhang, Zhang and Yang (2017): dual quaternions, their real and dual parts by two steps in turn.

    With the equations of `lu`, ``E q = 0`` and ``F q + E q' = 0``, and the blocks ``N = sum E^T E``, ``K = sum E^T F``
    and ``C = sum (E^T E + F^T F)`` of their Gram matrix, stationary points of

        q^T C q + 2 q'^T K q + q'^T N q'    subject to  |q| = 1,  q . q' = 0

    satisfy, with multipliers lambda and mu,

        (i)   N q' + K q + mu q = 0,  q . q' = 0         (ii)  C q + K^T q' + mu q' = lambda q

    The publication recovers the two parts by iteration, in two steps and with a pseudo-inverse. Chosen here, as one
    reading of that:

    (i)  q' given q, by the pseudo-inverse of ``P N P``, ``P = I - q q^T``:  ``q' = H q``,  ``H = -(P N P)^+ K``, and
         ``mu = -q . (N q' + K q)``.
    (ii) q given H and mu: the eigenvector of the smallest eigenvalue of ``C + K^T H + mu (H + H^T)``, which is (ii)
         because ``H^T q = 0``.

    It starts from the rotation only, the eigenvector of the smallest eigenvalue of N. Without noise one iteration ends
    it, as mu is 0 whatever q; else the error shrinks by a constant factor that grows with the noise. (Minimising over
    q' and then over q for fixed q' would not do: the constraint joins them, and the steps would rest where (i) and (ii)
    hold with different mu.) The fixed point is a constrained minimum of the sum of squares, the one that `heller`
    certifies on all but wild data: the two then agree. Converged means that a step is below 1e-14, or below 1e-8 where
    rounding keeps it from shrinking further. The result depends on the unit of length.
    """
    G, unit = scaled_gram(moments[0], N)
    T = len(G)
    q = np.linalg.eigh(G[:, 4:, 4:])[1][..., 0]
    dual = np.empty((T, 4))
    gap, previous = np.empty(T), np.full(T, np.inf)
    converged, iterations, active = np.zeros(T, dtype=bool), np.zeros(T, dtype=np.intp), np.arange(T)
    for count in range(1, STEPS_IN_TURN + 1):
        g, at = G[active], q[active]
        H, mu = _dual_step(g, at)
        spectrum, axes = np.linalg.eigh(_reduced(g, H, mu))
        found = axes[..., 0] * np.where(np.einsum("ti,ti->t", axes[..., 0], at) < 0, -1.0, 1.0)[:, None]
        length = np.abs(found - at).max(axis=1)
        q[active], gap[active] = found, (spectrum[:, 1] - spectrum[:, 0]) / spectrum[:, -1]
        ends = (length < STEP) | ((length < ROUNDED_STEP) & (length >= previous[active]))
        previous[active], iterations[active] = length, count
        converged[active[ends]] = True
        active = active[~ends]
        if not active.size:
            break
    require(~converged | (gap > DEGENERATE), "two rotations fit equally well.")
    dual = (_dual_step(G, q)[0] @ q[..., None])[..., 0]
    return Estimate(in_units(np.concatenate([q, dual], axis=1), unit), converged, iterations)


def _dual_step(G: Array, q: Array) -> tuple[Array, Array]:
    """H (T, 4, 4) with ``q' = H q``, and mu (T,)."""
    N, K = G[:, 4:, 4:], G[:, 4:, :4]
    P = np.eye(4) - q[:, :, None] * q[:, None, :]
    # P N P has the eigenvalue 0 along q; with one there instead, the pseudo-inverse is an inverse
    size = np.trace(N, axis1=1, axis2=2)[:, None, None]
    H = -P @ np.linalg.solve(P @ N @ P + size * (np.eye(4) - P), P @ K)
    mu = -np.einsum("ti,tij,tj->t", q, N @ H + K, q)
    return H, mu


def _reduced(G: Array, H: Array, mu: Array) -> Array:
    S = G[:, :4, :4] + G[:, :4, 4:] @ H + mu[:, None, None] * (H + H.mT)
    return np.asarray(0.5 * (S + S.mT))


ZHANG = Method(
    **published("zhang"),
    solver=MomentSolver(dual_factors, _zhang, nearby),
    mathematics=_zhang.__doc__,
)
