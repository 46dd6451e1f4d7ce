"""Linear least squares in the entries of X, and rotations from 3x3 matrices, for `andreff`, `gwak`, `li` and `shah`.

The normal equations ``G x = g`` are linear in the moments m of the data,

    G = N G_0 + sum_k m_k G_k,    g = sum_k m_k g_k,    hence exactly    dx/dm_k = G^-1 (g_k - G_k x)

A 3x3 block M of x is replaced by the nearest rotation R; with
``M = R S``, S symmetric, and ``dM``

    theta = R (tr(S) I - S)^-1 vee(R^T dM),    vee(W) = (W32 - W23, W13 - W31, W21 - W12)

is the left rotation by which R moves.

``A X = X B`` as linear equations in the twelve entries of X: what `andreff` and `gwak` sum over the pairs.

With r the entries of R_X row by row, a pair gives

    (R_A kron R_B - I) r = 0,     (I kron t_B^T) r + (I - R_A) t = t_A

whose sum of squares ``sum |R_A R R_B^T - R|^2 + |R t_B + (I - R_A) t - t_A|^2 = x^T G x - 2 g^T x + const``, x = (r,
t), is that of ``|A X - X B|^2``, and needs only products of entries of A with entries of B, summed. They are summed for
``D = R - I``, so that small rotations do not drown in the rounding of large sums.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array, perturb, pose, skew, vee
from ...model.noise.models import PairNoise
from ..procrustes.degeneracy import DEGENERATE
from ..procrustes.pairs import pair_blocks, trial_blocks
from .method import Estimate, Method, closed_form, published, require
from .moments import Factors, Moments, MomentSolver, Signs

# Ratio of the eigenvalues of the normal equations, scaled to equal diagonals, below which the least is rounding.
SINGULAR = 1e-13
# How far the singular values of a matrix that ought to be a rotation may be from their mean, relative to it.
DEFORMED = 0.5

_EYE = np.eye(3)


class Normal(NamedTuple):
    """Normal equations scaled to a unit diagonal: columns of translations to the size of those of rotations."""

    scaled: Array  # (T, n, n): diag(d) G diag(d)
    d: Array  # (T, n)

    def solve(self, rhs: Array) -> Array:
        """``G^-1 rhs``, (T, n) or (T, n, k)."""
        if rhs.ndim == 2:
            return self.solve(rhs[..., None])[..., 0]
        return np.asarray(np.linalg.solve(self.scaled, rhs * self.d[..., None]) * self.d[..., None])


def normal(G: Array) -> Normal:
    """Raise `Singular` where G (T, n, n) has no inverse."""
    diagonal = np.diagonal(G, axis1=-2, axis2=-1)
    require(diagonal.min(axis=-1) > 0, "its linear equations are singular.")
    d = 1.0 / np.sqrt(diagonal)
    scaled = G * d[:, :, None] * d[:, None, :]
    values = np.linalg.eigvalsh(scaled)
    require(values[:, 0] > SINGULAR * values[:, -1], "its linear equations are singular.")
    return Normal(scaled, d)


def require_axes(M: Array, N: int) -> None:
    """Raise `Singular` unless ``sum (I - R_A)^T (I - R_A)`` (T, 3, 3) of N pairs sees all directions.

    This comes before any scaling, which would lift a sum that is nothing but rounding.
    """
    values = np.linalg.eigvalsh(M)
    require(values[:, 0] > DEGENERATE * np.maximum(values[:, 2], 1e-4 * N), "the rotation axes are parallel.")


def require_rotation(M: Array) -> None:
    """Raise `Singular` where M (T, 3, 3) is no multiple of a rotation, hardly deformed."""
    s = np.linalg.svd(M, compute_uv=False)
    mean = s.mean(axis=1)
    require(
        (s[:, 2] > (1.0 - DEFORMED) * mean) & (mean > 0),
        "noise deforms its unconstrained matrix too far from any rotation.",
    )


def require_scale(M: Array) -> None:
    """Raise `Singular` where M (T, 3, 3), not scaled, has shrunk: translations too small to fix its size."""
    require_rotation(M)
    size = np.cbrt(np.abs(np.linalg.det(M)))
    require(
        np.abs(size - 1.0) < DEFORMED,
        "the translations are too small against the noise to fix the scale of its unconstrained matrix.",
    )


def slopes(
    assemble: Callable[[Array], tuple[Array, Array]], shape: tuple[int, int], equations: Normal, x: Array
) -> Array:
    """``dx/dm`` (T, n, p q) at the solution x (T, n), for moments of ``shape`` (p, q).

    ``assemble`` gives what of G and g is linear in the moments.
    """
    unit = np.eye(shape[0] * shape[1]).reshape(-1, *shape)
    G, g = assemble(unit)
    return equations.solve(g.T - np.einsum("kij,tj->tik", G, x))


def turn_of(M: Array, R: Array, dM: Array) -> Array:
    """theta (T, 3, k) of the rotation R (T, 3, 3) nearest to M, for changes dM (T, 9, k) of M."""
    S = R.mT @ M
    S = 0.5 * (S + S.mT)
    W = np.einsum("tji,tjck->tkic", R, dM.reshape(len(M), 3, 3, -1))
    Z = np.trace(S, axis1=-2, axis2=-1)[:, None, None] * _EYE - S
    return np.asarray(R @ np.linalg.solve(Z, vee(W).mT))


def right_handed(x: Array) -> Array:
    """The rotation (T, 3, 3) nearest to a 3x3 matrix given up to its sign, row by row (T, 9)."""
    M = x.reshape(-1, 3, 3)
    return orthonormalise(np.where(np.linalg.det(M) < 0, -1.0, 1.0)[:, None, None] * M)


SHAPE = (16, 16)  # of the moments


def kronecker_factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    """``(D_A, t_A, 1, t_B)`` and ``(D_B, t_B, 1, D_A^T t_A)``, each (..., 16)."""
    D_A, D_B, t_A, t_B = A[..., :3, :3] - _EYE, B[..., :3, :3] - _EYE, A[..., :3, 3], B[..., :3, 3]
    one = np.ones((*t_A.shape[:-1], 1))
    turned = (D_A.mT @ t_A[..., None])[..., 0]
    left = np.concatenate([D_A.reshape(*one.shape[:-1], 9), t_A, one, t_B], axis=-1)
    right = np.concatenate([D_B.reshape(*one.shape[:-1], 9), t_B, one, turned], axis=-1)
    return ((left, right),)


def normal_equations(moments: Array) -> tuple[Array, Array]:
    """G (T, 12, 12) and g (T, 12) from the moments (T, 16, 16)."""
    T = len(moments)
    D_A, t_A, one, t_B = moments[:, :9], moments[:, 9:12], moments[:, 12], moments[:, 13:]
    sum_A = D_A[:, :, 12].reshape(T, 3, 3)
    G = np.zeros((T, 12, 12))
    G[:, :9, :9] = rotation_equations(moments)
    G[:, :9, :9] += (_EYE[:, None, :, None] * t_B[:, None, :, None, 9:12]).reshape(T, 9, 9)
    # (I kron t_B)(I - R_A): rows (a, c), columns b
    G[:, :9, 9:] = -D_A[:, :, 9:12].reshape(T, 3, 3, 3).swapaxes(2, 3).reshape(T, 9, 3)
    G[:, 9:, :9] = G[:, :9, 9:].mT
    G[:, 9:, 9:] = -sum_A - sum_A.mT  # sum (I - R_A)^T (I - R_A)
    g = np.concatenate([t_A[:, :, 9:12].reshape(T, 9), -one[:, 13:]], axis=1)
    return G, g


def rotation_equations(moments: Array) -> Array:
    """The part (T, 9, 9) of G by the rotations only, ``sum |R_A R R_B^T - R|^2``."""
    T = len(moments)
    sum_A, sum_B = moments[:, :9, 12].reshape(T, 3, 3), moments[:, 12, :9].reshape(T, 3, 3)
    kron = moments[:, :9, :9].reshape(T, 3, 3, 3, 3).transpose(0, 1, 3, 2, 4)  # rows (a, c), columns (b, d)
    kron = kron + sum_A[:, :, None, :, None] * _EYE[:, None, :] + _EYE[:, None, :, None] * sum_B[:, None, :, None, :]
    kron = kron.reshape(T, 9, 9)  # sum (R_A kron R_B - I)
    return np.asarray(-kron - kron.mT)


def residual_gradient(A: Array, B: Array, x: Array) -> Array:
    """Half the gradient (T, 12) of the sum of squares at x, from the residuals of motions (T, m, 4, 4) themselves."""
    R, t = x[:, None, :9].reshape(-1, 1, 3, 3), x[:, None, 9:, None]
    D_A, R_B, t_B = A[..., :3, :3] - _EYE, B[..., :3, :3], B[..., :3, 3:]
    turned = R @ R_B.mT
    of_R = D_A @ turned + turned - R  # R_A R R_B^T - R
    of_t = R @ t_B - D_A @ t - A[..., :3, 3:]
    by_R = (D_A.mT @ of_R @ R_B + of_R @ R_B - of_R + of_t @ t_B.mT).sum(axis=1)
    return np.concatenate([by_R.reshape(-1, 9), -(D_A.mT @ of_t).sum(axis=1)[..., 0]], axis=1)


def _andreff_linear(moments: Moments, N: int) -> tuple[Normal, Array]:
    G, g = normal_equations(moments[0])
    require_axes(G[:, 9:, 9:], N)
    equations = normal(G)
    return equations, equations.solve(g)


def _andreff_projected(x: Array) -> Estimate:
    M = x[:, :9].reshape(-1, 3, 3)
    require_scale(M)
    return closed_form(pose(orthonormalise(M), x[:, 9:]))


def _andreff(moments: Moments, N: int) -> Estimate:
    r"""Andreff, Horaud and Espiau (2001): all twelve entries of X by one linear least-squares problem.

    The equations of the module are solved for x = (r, t) without the constraint that r be a rotation; the 3x3 block is
    then replaced by the nearest rotation, and t is kept. (The publication also estimates an unknown scale of camera
    translations from structure from motion; camera poses here are metric.) The result depends on the unit of length,
    which weighs translation against rotation equations. Nothing but the translations fixes the scale of r: where they
    are small against the noise it shrinks, and t with it.

    The normal equations square the condition of the problem; one step of iterative refinement with the residuals of the
    data themselves makes up for it.
    """
    return _andreff_projected(_andreff_linear(moments, N)[1])


def _andreff_slopes(moments: Moments, N: int) -> list[Array]:
    equations, x = _andreff_linear(moments, N)
    M = x[:, :9].reshape(-1, 3, 3)
    dx = slopes(normal_equations, SHAPE, equations, x)
    by_moments = np.concatenate([turn_of(M, orthonormalise(M), dx[:, :9]), dx[:, 9:]], axis=1)
    return [by_moments.reshape(-1, 6, *SHAPE)]


class _Refined(MomentSolver):
    def estimate(self, A: Array, B: Array, noise: PairNoise | None) -> Estimate:
        equations, x = _andreff_linear(self.moments(A, B, None), A.shape[1])
        gradient = np.zeros_like(x)
        for trials, pairs in product(trial_blocks(*A.shape[:2]), pair_blocks(A.shape[1])):
            gradient[trials] += residual_gradient(A[trials, pairs], B[trials, pairs], x[trials])
        return _andreff_projected(x - equations.solve(gradient))


ANDREFF = Method(
    **published("andreff"),
    solver=_Refined(kronecker_factors, _andreff, slopes=_andreff_slopes, axes=False),
    mathematics=_andreff.__doc__,
)


ITERATIONS = 100
STEP = 1e-12
ROUNDED_STEP = 1e-7

_TURNS = skew(np.eye(3))
_PAIRS = 0.5 * (_TURNS[:, None] @ _TURNS[None] + _TURNS[None] @ _TURNS[:, None])  # second derivatives of exp


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
        gradient, hessian = _gwak_slopes(G[active], g[active], X[active])
        s = scale[active]
        gradient, hessian = gradient * s, hessian * s[:, :, None] * s[:, None, :]
        curvature, axes = np.linalg.eigh(hessian)
        # damped by the negative curvature, if any, and by what failed steps asked for
        floor = np.maximum(damping[active], np.maximum(0.0, -1.5 * curvature[:, 0]))
        denominator = np.maximum(curvature + floor[:, None], 1e-14 * np.abs(curvature).max(axis=1, keepdims=True))
        step = -(axes @ ((axes.mT @ gradient[..., None])[..., 0] / denominator)[..., None])[..., 0]
        length = np.abs(step).max(axis=1)
        moved = perturb(X[active], step * s)
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
