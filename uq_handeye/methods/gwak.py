"""The method `gwak`: numerical optimisation of the linear equations on the Euclidean group."""

from __future__ import annotations

import numpy as np

from ..core.geometry.se3 import Array, perturb, pose, skew
from ..core.iterations import MAX_STEPS
from ..core.rounding import PRODUCT_ROUNDING, SOLUTION_ROUNDING
from .kronecker import kronecker_factors, normal_equations, rotation_equations
from .linear import require_axes, right_handed
from .method import Estimate, Method, published
from .moments import Moments, MomentSolver

_TURNS = skew(np.eye(3))
# Second derivatives of exp([theta]x) at zero.
_PAIRS = 0.5 * (_TURNS[:, None] @ _TURNS[None] + _TURNS[None] @ _TURNS[:, None])


def _gwak(moments: Moments, N: int) -> Estimate:
    r"""Gwak, Kim and Park (2003): numerical optimisation on the Euclidean group.

    Minimises ``sum |A X - X B|^2`` (Frobenius: nine rotation and three translation equations per pair, as they come)
    over X in SE(3). By the module this is a quadratic function of the entries of X, so that one pass over the pairs
    serves all iterations:

        f(X) = x^T G x - 2 g^T x,    x = (vec R, t),    R -> exp([theta]x) R,  t -> t + tau

    The publication descends along exponentials by gradient and Newton steps. Here: Newton's method with the exact
    Hessian in (theta, tau), started at the X that fits the rotations first. Where the Hessian is not positive definite,
    or a step does not lower f, it is damped as in Levenberg's method. Converged means that the next step is below 1e-12
    rad and 1e-12 typical translations, or that f no longer falls within rounding at an undamped step below 1e-7. The
    minimum is a local one; the result depends on the unit of length.
    """
    G, g = normal_equations(moments[0])
    require_axes(G[:, 9:, 9:], N)
    return _descend(G, g, _start(G, g, rotation_equations(moments[0])))


def _start(G: Array, g: Array, of_rotations: Array) -> Array:
    """The rotation equations only, solved by their smallest eigenvector and projected; then the best translation."""
    R = right_handed(np.linalg.eigh(of_rotations)[1][..., 0])
    rhs = g[:, 9:, None] - G[:, 9:, :9] @ R.reshape(-1, 9, 1)
    return pose(R, np.linalg.solve(G[:, 9:, 9:], rhs)[..., 0])


def _nearby(moments: Moments, N: int, X: Array) -> Array:
    return _descend(*normal_equations(moments[0]), X).X


def _descend(G: Array, g: Array, start: Array) -> Estimate:
    """Take damped Newton steps for each problem (T, ...), until each has converged."""
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
    # the step whose effect on f, which is quadratic, is rounding
    rounded_step = np.sqrt(PRODUCT_ROUNDING)
    active = np.arange(T)
    for count in range(1, MAX_STEPS + 1):
        gradient, hessian = _gwak_slopes(G[active], g[active], X[active])
        s = scale[active]
        gradient, hessian = gradient * s, hessian * s[:, :, None] * s[:, None, :]
        curvature, axes = np.linalg.eigh(hessian)
        # damped by the negative curvature, if any, and more after steps that failed
        floor = np.maximum(damping[active], np.maximum(0.0, -1.5 * curvature[:, 0]))
        denominator = np.maximum(
            curvature + floor[:, None], PRODUCT_ROUNDING * np.abs(curvature).max(axis=1, keepdims=True)
        )
        step = -(axes @ ((axes.mT @ gradient[..., None])[..., 0] / denominator)[..., None])[..., 0]
        length = np.abs(step).max(axis=1)
        moved = perturb(X[active], step * s)
        trial = _value(G[active], g[active], moved)
        rounding = PRODUCT_ROUNDING * size[active]
        better = trial <= value[active] + rounding
        iterations[active] = count
        ends = (
            better
            & (floor == 0.0)
            & ((length < SOLUTION_ROUNDING) | ((length < rounded_step) & (value[active] - trial < rounding)))
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


def _gwak_slopes(G: Array, g: Array, X: Array) -> tuple[Array, Array]:
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


GWAK = Method(
    **published("gwak"),
    solver=MomentSolver(kronecker_factors, _gwak, _nearby, axes=False),
    mathematics=_gwak.__doc__,
)
