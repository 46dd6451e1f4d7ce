r"""Gwak, Kim and Park (2003): numerical optimisation on the Euclidean group.

Minimises ``sum |A X - X B|^2`` (Frobenius: nine rotation and three translation equations per pair, as they come) over X
in SE(3). By `kronecker` this is a quadratic function of the entries of X, so that one pass over the pairs serves all
iterations:

    f(X) = x^T G x - 2 g^T x,    x = (vec R, t),    R -> exp([theta]x) R,  t -> t + tau

The publication descends along exponentials by gradient and Newton steps. Here: Newton's method with the exact Hessian
in (theta, tau), started at the X that fits the rotations first. Where the Hessian is not positive definite, or a step
does not lower f, it is damped as in Levenberg's method. Converged means that the next step is below 1e-12 rad and 1e-12
typical translations, or that f no longer falls within rounding at an undamped step below 1e-7. The minimum is a local
one; the result depends on the unit of length.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.geometry.se3 import Array, skew
from .common.linear import kronecker_factors, normal_equations, require_axes, right_handed, rotation_equations
from .common.method import Estimate, Method
from .common.moments import Moments, MomentSolver

ITERATIONS = 100
STEP = 1e-12
ROUNDED_STEP = 1e-7

_TURNS = skew(np.eye(3))
_PAIRS = 0.5 * (_TURNS[:, None] @ _TURNS[None] + _TURNS[None] @ _TURNS[:, None])  # second derivatives of exp


def _solution(moments: Moments, N: int) -> Estimate:
    G, g = normal_equations(moments[0])
    require_axes(G[:, 9:, 9:], N)
    return _descend(G, g, _start(G, g, rotation_equations(moments[0])))


def _start(G: Array, g: Array, of_rotations: Array) -> Array:
    """The rotation equations only, solved by their smallest eigenvector and projected; then the best translation."""
    R = right_handed(np.linalg.eigh(of_rotations)[1][..., 0])
    X = np.zeros((len(R), 4, 4))
    X[:, :3, :3] = R
    X[:, 3, 3] = 1.0
    rhs = g[:, 9:, None] - G[:, 9:, :9] @ R.reshape(-1, 9, 1)
    X[:, :3, 3:] = np.linalg.solve(G[:, 9:, 9:], rhs)
    return X


def _nearby(moments: Moments, N: int, X: Array) -> Array:
    return _descend(*normal_equations(moments[0]), X).X


def _descend(G: Array, g: Array, start: Array) -> Estimate:
    """Damped Newton steps for each problem (T, ...), until each has converged."""
    T = len(G)
    X = np.array(start)
    # lengths in units in which the translation is seen as well as the rotation
    unit = np.sqrt(np.trace(G[:, :9, :9], axis1=1, axis2=2) / 9 / (np.trace(G[:, 9:, 9:], axis1=1, axis2=2) / 3))
    scale = np.concatenate([np.ones((T, 3)), np.repeat(unit[:, None], 3, axis=1)], axis=1)
    converged = np.zeros(T, dtype=bool)
    iterations = np.zeros(T, dtype=np.intp)
    damping = np.zeros(T)
    value = _value(G, g, X)
    x = np.abs(_entries(X))
    size = np.einsum("ti,tij,tj->t", x, np.abs(G), x) + 2.0 * np.einsum(
        "ti,ti->t", np.abs(g), x
    )  # of what cancels in f
    active = np.arange(T)
    for count in range(1, ITERATIONS + 1):
        gradient, hessian = _slopes(G[active], g[active], X[active])
        s = scale[active]
        gradient, hessian = gradient * s, hessian * s[:, :, None] * s[:, None, :]
        curvature, axes = np.linalg.eigh(hessian)
        # damped by the negative curvature, if any, and by what failed steps asked for
        floor = np.maximum(damping[active], np.maximum(0.0, -1.5 * curvature[:, 0]))
        denominator = np.maximum(curvature + floor[:, None], 1e-14 * np.abs(curvature).max(axis=1, keepdims=True))
        step = -(axes @ ((axes.mT @ gradient[..., None])[..., 0] / denominator)[..., None])[..., 0]
        length = np.abs(step).max(axis=1)
        moved = _move(X[active], step * s)
        trial = _value(G[active], g[active], moved)
        rounding = 1e-14 * size[active]
        better = trial <= value[active] + rounding
        iterations[active] = count
        ends = (
            better & (floor == 0.0) & ((length < STEP) | ((length < ROUNDED_STEP) & (value[active] - trial < rounding)))
        )
        ends &= curvature[:, 0] > 0
        X[active[better]], value[active[better]] = moved[better], trial[better]
        damping[active] = np.where(better, damping[active] / 10.0, np.maximum(4.0 * floor, 1e-3 * curvature[:, -1]))
        damping[active[better & (damping[active] < 1e-6 * curvature[:, -1])]] = 0.0
        converged[active[ends]] = True
        active = active[~ends]
        if not active.size:
            break
    return Estimate(X, converged, iterations)


def _entries(X: Array) -> Array:
    return np.concatenate([X[:, :3, :3].reshape(-1, 9), X[:, :3, 3]], axis=1)


def _value(G: Array, g: Array, X: Array) -> Array:
    x = _entries(X)
    return np.asarray(np.einsum("ti,tij,tj->t", x, G, x) - 2.0 * np.einsum("ti,ti->t", g, x))


def _slopes(G: Array, g: Array, X: Array) -> tuple[Array, Array]:
    """Gradient (T, 6) and Hessian (T, 6, 6) of f by (theta, tau)."""
    T, R = len(X), X[:, None, :3, :3]
    slope = 2.0 * ((G @ _entries(X)[..., None])[..., 0] - g)
    by_xi = np.zeros((T, 6, 12))
    by_xi[:, :3, :9] = (_TURNS @ R).reshape(T, 3, 9)
    by_xi[:, 3:, 9:] = np.eye(3)
    hessian = 2.0 * by_xi @ G @ by_xi.mT
    second = (_PAIRS.reshape(9, 3, 3) @ R).reshape(T, 9, 9)
    hessian[:, :3, :3] += (second @ slope[:, :9, None]).reshape(T, 3, 3)
    return (by_xi @ slope[..., None])[..., 0], 0.5 * (hessian + hessian.mT)


def _move(X: Array, xi: Array) -> Array:
    moved = X.copy()
    moved[:, :3, :3] = Rotation.from_rotvec(xi[:, :3]).as_matrix() @ X[:, :3, :3]
    moved[:, :3, 3] += xi[:, 3:]
    return moved


METHOD = Method(
    name="gwak",
    authors="S. Gwak, J. Kim and F. C. Park",
    year=2003,
    title="Numerical Optimization on the Euclidean Group with Applications to Camera Calibration. "
    "IEEE Trans. Robotics and Automation 19(1), 65-74",
    doi="10.1109/TRA.2002.807530",
    structure="simultaneous",
    form="iterative",
    minimises="sum |A X - X B|^2 (Frobenius) over SE(3): the error metric (62) of 4DPA's paper",
    singular="none beyond parallel rotation axes",
    solver=MomentSolver(kronecker_factors, _solution, _nearby, axes=False),
)
