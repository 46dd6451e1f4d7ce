r"""Least squares over few global values and a small block of numbers for each picture (variable projection).

Minimised is ``sum_i |r_i(v, p_i)|^2 + |R (v - v_0)|^2`` over the values v (f) and the blocks p_i (6 numbers each) of n
pictures. For every v each block is at its own minimum, found by a batch of small Levenberg-Marquardt problems, and
`scipy.optimize.least_squares` moves v alone. With the derivatives A_i by v and B_i by p_i,

    G_i = d p_i / d v = -(B_i^T B_i)^-1 B_i^T A_i,      d r_i / d v = A_i + B_i G_i

so that its normal matrix is the Schur complement over the blocks: time and memory grow with the number of residuals.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..geometry.se3 import Array

# Blocks stand still when a step lowers the sum of squares by less than this share of it.
STILL = 1e-12
MOST_BLOCK_STEPS, MOST_STEPS = 30, 100
# Damping beyond which a block cannot be improved.
STUCK = 1e8

Rows = tuple[Array, Array, Array]  # r (n, m), A (n, m, f), B (n, m, 6)


class Problem(Protocol):
    """What is minimised."""

    def rows(self, values: Array, blocks: Array) -> Rows:
        """Residuals and derivatives; rows that do not count are 0."""

    def residuals(self, values: Array, blocks: Array) -> Array:
        """r alone."""

    def moved(self, blocks: Array, step: Array) -> Array:
        """The blocks (n, ...) after a step (n, 6)."""


class Minimum(NamedTuple):
    """Where everything is at its minimum, and the derivatives there."""

    values: Array  # (f,)
    blocks: Array  # (n, ...)
    r: Array  # (n, m)
    B: Array  # (n, m, 6)
    G: Array  # (n, 6, f)
    J: Array  # (n, m, f) A + B G
    converged: bool
    steps: int


def settled(problem: Problem, values: Array, blocks: Array) -> tuple[Array, Array, Array, Array]:
    """The blocks at their minima for these values, and r, A, B there."""
    r, A, B = problem.rows(values, blocks)
    cost = np.einsum("ni,ni->n", r, r)
    damping = np.full(len(blocks), 1e-6)
    for _ in range(MOST_BLOCK_STEPS):
        V = B.mT @ B
        g = (B.mT @ r[..., None])[..., 0]
        np.einsum("nii->ni", V)[:] *= 1.0 + damping[:, None]
        np.einsum("nii->ni", V)[:] += np.finfo(float).tiny
        step = -np.linalg.solve(V, g[..., None])[..., 0]
        active = (-np.einsum("ni,ni->n", g, step) > STILL * cost) & (damping < STUCK)
        if not active.any():
            break
        moved = problem.moved(blocks, np.where(active[:, None], step, 0.0))
        there = problem.rows(values, moved)
        new = np.einsum("ni,ni->n", there[0], there[0])
        better = active & (new <= cost)
        if better.all():
            blocks, (r, A, B) = moved, there
        else:
            blocks, r, A, B = (
                np.where(better.reshape(-1, *[1] * (a.ndim - 1)), b, a)
                for a, b in zip((blocks, r, A, B), (moved, *there), strict=True)
            )
        cost = np.where(better, new, cost)
        damping = np.where(better, 0.1 * damping, np.where(active, 100.0 * damping, damping))
    return blocks, r, A, B


def reduced(A: Array, B: Array) -> tuple[Array, Array]:
    """``A + B G`` (n, m, f) and G (n, 6, f)."""
    G = -np.linalg.pinv(B.mT @ B, hermitian=True) @ (B.mT @ A)
    return A + B @ G, G


def minimised(problem: Problem, values: Array, blocks: Array, prior: tuple[Array, Array] | None = None) -> Minimum:
    """The minimum from a start; ``prior`` is v_0 (f,) and R (f, f)."""
    from scipy.optimize import least_squares  # slow to import and needed here only

    near = blocks, np.zeros((len(blocks), 6, len(values))), values
    memory: dict[bytes, tuple[Array, Array]] = {}

    def guess(values: Array) -> Array:
        """Where the blocks are to first order, or as they were where that is worse."""
        blocks, G, before = near
        moved = problem.moved(blocks, G @ (values - before))
        old, new = (np.einsum("ni,ni->n", r, r) for r in (problem.residuals(values, p) for p in (blocks, moved)))
        return np.where((new < old).reshape(-1, *[1] * (blocks.ndim - 1)), moved, blocks)

    def at(values: Array) -> tuple[Array, Array]:
        nonlocal near
        key = values.tobytes()
        if key not in memory:
            blocks, r, A, B = settled(problem, values, guess(values))
            J, G = reduced(A, B)
            J = J.reshape(r.size, -1)
            near = blocks, G, values.copy()
            r = r.ravel()
            if prior is not None:
                r = np.concatenate([r, prior[1] @ (values - prior[0])])
                J = np.concatenate([J, prior[1]])
            # Orthogonal compression: the same sum of squares, gradient and normal matrix in a few rows.
            R = np.asarray(np.linalg.qr(np.column_stack([J, r]), mode="r"))
            memory.clear()
            memory[key] = R[:, :-1], R[:, -1]
        return memory[key]

    def residual(values: Array) -> Array:
        return at(values)[1]

    def jacobian(values: Array) -> Array:
        return at(values)[0]

    converged, steps = True, 0
    if len(values):
        found = least_squares(
            residual, values, jacobian, x_scale="jac", xtol=1e-12, ftol=1e-10, gtol=1e-12, max_nfev=MOST_STEPS
        )
        values, converged, steps = np.asarray(found.x), bool(found.success), int(found.nfev)
    blocks, r, A, B = settled(problem, values, near[0])
    J, G = reduced(A, B)
    return Minimum(values, blocks, r, B, G, J, converged, steps)
