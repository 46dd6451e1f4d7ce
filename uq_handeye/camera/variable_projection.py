r"""Least squares over few global values and a small block of numbers for each picture (variable projection).

Minimised is ``sum_i |r_i(v, p_i)|^2 + |R (v - v_0)|^2`` over the values v (f) and the blocks p_i (6 numbers each) of n
pictures. With the derivatives A_i by v and B_i by p_i, and

    G_i = d p_i / d v = -(B_i^T B_i)^-1 B_i^T A_i,      d r_i / d v = A_i + B_i G_i  with the blocks at their minima,

the normal matrix is block diagonal in the coordinates v and ``q_i = p_i - G_i v``: the Schur complement over the blocks

    S = sum_i (A_i^T A_i + A_i^T B_i G_i) + R^T R       for v,        V_i = B_i^T B_i       for q_i

so that time and memory grow with the number of residuals. Levenberg-Marquardt in these coordinates, each damped by its
own diagonal (D. Marquardt, J. SIAM 11 (1963)); the damping follows the decrease found over that predicted (H. Nielsen,
IMM-REP-1999-05, Technical University of Denmark). It ends where the undamped step is predicted to lower the sum of
squares by less than the share STILL of it: for N residuals within ``sqrt(STILL N)`` standard deviations of the minimum.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..geometry.se3 import Array

STILL = 1e-11
MOST_STEPS = 100
# Damping of the first step, by how much it falls at most, and that beyond which nothing can be improved.
DAMPING, FALL, STUCK = 1e-6, 0.1, 1e8
# What a normal matrix of unit diagonal has for eigenvalues where it is singular.
RANK = 1e-14

Rows = tuple[Array, Array, Array]  # r (n, m), A (n, m, f), B (n, m, 6)


class Problem(Protocol):
    """What is minimised."""

    def rows(self, values: Array, blocks: Array) -> Rows:
        """Residuals and derivatives; rows that do not count are 0."""

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
    steps: int  # evaluations of the rows


def minimised(problem: Problem, values: Array, blocks: Array, prior: tuple[Array, Array] | None = None) -> Minimum:
    """The minimum from a start; ``prior`` is v_0 (f,) and R (f, f)."""
    middle, R = (values, np.zeros((0, len(values)))) if prior is None else prior

    def sum_of_squares(r: Array, values: Array) -> float:
        return float(np.vdot(r, r) + np.sum((R @ (values - middle)) ** 2))

    r, A, B = problem.rows(values, blocks)
    cost, damping, steps = sum_of_squares(r, values), DAMPING, 1
    while True:
        h = (B.mT @ r[..., None])[..., 0]
        own, to_blocks = diagonal(B.mT @ B)
        W = B.mT @ A
        G = -to_blocks @ ((to_blocks.mT @ W) / own[..., None])
        shared, to_values = diagonal((A.mT @ A + W.mT @ G).sum(axis=0) + R.T @ R)
        g = (A.mT @ r[..., None] + G.mT @ h[..., None]).sum(axis=0)[:, 0] + R.T @ (R @ (values - middle))
        # Eigenvalues and gradient of the whole normal matrix, which is diagonal after a rotation of v and of each q_i.
        e = np.concatenate([shared, own.ravel()])
        c = np.concatenate([to_values.T @ g, (to_blocks.mT @ h[..., None]).ravel()])
        converged, growth = bool(np.sum(c**2 / e) <= STILL * cost), 4.0
        while not converged and steps < MOST_STEPS:
            y = -c / (e + damping)
            move = to_values @ y[: len(values)]
            step = (to_blocks @ y[len(values) :].reshape(-1, 6, 1))[..., 0] + G @ move
            there = values + move, problem.moved(blocks, step)
            rows = problem.rows(*there)
            new, steps = sum_of_squares(rows[0], there[0]), steps + 1
            if new < cost:
                gain = (cost - new) / np.sum(-y * c * (1.0 + damping / (e + damping)))
                damping *= max(FALL, 1.0 - (2.0 * gain - 1.0) ** 3)
                break
            damping, growth = growth * max(damping, e.min()), 2 * growth
            converged = damping > STUCK
        if converged or steps >= MOST_STEPS:
            return Minimum(values, blocks, r, B, G, A + B @ G, converged, steps)
        (values, blocks), (r, A, B), cost = there, rows, new


def reduced(A: Array, B: Array) -> tuple[Array, Array]:
    """``A + B G`` (n, m, f) and G (n, 6, f)."""
    own, to_blocks = diagonal(B.mT @ B)
    G = -to_blocks @ ((to_blocks.mT @ (B.mT @ A)) / own[..., None])
    return A + B @ G, G


def diagonal(H: Array) -> tuple[Array, Array]:
    """e (..., d), Q (..., d, d) with ``(H + l diag(H))^-1 = Q diag(1 / (e + l)) Q^T`` of normal matrices (..., d, d).

    e is infinite where H is singular: no step goes there.
    """
    size = np.einsum("...ii->...i", H)
    unit = 1.0 / np.sqrt(np.where(size > 0, size, np.inf))
    e, Q = np.linalg.eigh(H * unit[..., :, None] * unit[..., None, :])
    return np.where(e > RANK * e[..., -1:], e, np.inf), unit[..., :, None] * Q
