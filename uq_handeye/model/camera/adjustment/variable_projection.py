r"""Least squares over few global values and a small block of numbers for each picture (variable projection).

The objective ``sum_i |r_i(v, p_i)|^2 + |R (v - v_0)|^2`` is minimised over the values v (f) and the blocks p_i (6
numbers each) of n pictures. With the derivatives A_i by v and B_i by p_i, and

    G_i = d p_i / d v = -(B_i^T B_i)^-1 B_i^T A_i,      d r_i / d v = A_i + B_i G_i  with the blocks at their minima,

the normal matrix is block diagonal in the coordinates v and ``q_i = p_i - G_i v``: the Schur complement over the blocks

    S = sum_i (A_i + B_i G_i)^T (A_i + B_i G_i) + R^T R       for v,        V_i = B_i^T B_i       for q_i

Pictures are taken a few at a time, so that time grows with the number of residuals, and memory with that of pictures.
Levenberg-Marquardt in these coordinates, each damped by its own diagonal (D. Marquardt, J. SIAM 11 (1963)); the damping
follows the decrease found over that predicted (H. Nielsen, IMM-REP-1999-05, Technical University of Denmark).

The distance of a point above the minimum is predicted by the decrease of the sum of squares by the undamped step. The
step is the last one where that is less than NEAR_SHARE of the sum, and where after a gain like that of the step before
less than CONVERGED_SHARE would remain: for N residuals within ``sqrt(CONVERGED_SHARE N)`` standard deviations of the
minimum. That step needs no further evaluation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ....core.geometry.se3 import Array
from ....core.iterations import MAX_STEPS
from ....core.rounding import HALF_DIGITS, PRODUCT_ROUNDING

# The last step leaves less than this share of the sum of squares; it is undamped, and predicts a fall below NEAR_SHARE.
CONVERGED_SHARE, NEAR_SHARE = 1e-11, 1e-7
# Numbers in the rows of the pictures that are evaluated together, so that they stay in the cache.
MAX_NUMBERS_TOGETHER = 2**18
Rows = tuple[Array, Array, Array]  # r (n, m), A (n, m, f), B (n, m, 6)


class Problem(NamedTuple):
    """Minimisation problem over values (f,) and a block of each picture, such as its pose."""

    m: int  # rows of a picture
    # residuals and derivatives of a part of the pictures, with its poses; rows that do not count are 0
    rows: Callable[[Array, Array, slice], Rows]
    moved: Callable[[Array, Array], Array]  # the poses after a step (n, 6)


class Minimum(NamedTuple):
    """Minimum: values, and the derivatives at the start of the last step."""

    values: Array  # (f,)
    blocks: Array  # (n, ...)
    squares: float  # the sum of squares, with that of the prior
    information: Array  # (f, f) S without the prior
    V: Array  # (n, 6, 6)
    G: Array  # (n, 6, f)
    converged: bool
    steps: int  # evaluations of the rows


class Blocks(NamedTuple):
    """Each picture by itself, the others and the values held: coordinates ``Q_i^-1 q_i`` are diagonal."""

    V: Array  # (n, 6, 6) B^T B
    h: Array  # (n, 6) B^T r
    G: Array  # (n, 6, f)
    e: Array  # (n, 6)
    Q: Array  # (n, 6, 6)

    @classmethod
    def of(cls, V: Array, h: Array, mixed: Array) -> Blocks:
        """Return them for normal matrices, gradients, and ``mixed`` (n, 6, f), B^T A."""
        e, Q = diagonal(V)
        return cls(V, h, -Q @ ((Q.mT @ mixed) / e[..., None]), e, Q)

    @property
    def covariance(self) -> Array:
        """(n, 6, 6) of the blocks, given the values, V^-1."""
        inverse = (self.Q / self.e[:, None]) @ self.Q.mT
        return 0.5 * (inverse + inverse.mT)


class Normal(NamedTuple):
    """Normal equations about a point, diagonal in coordinates ``Q_0^-1 v`` and ``Q_i^-1 q_i``."""

    squares: float  # with that of the prior
    information: Array  # (f, f) S without the prior
    g: Array  # (f,) half the gradient by v, with that of the prior
    blocks: Blocks
    e: Array  # (f,)
    Q: Array  # (f, f) Q_0

    @classmethod
    def of_sums(cls, squares: float, S: Array, g: Array, blocks: Blocks, R: Array) -> Normal:
        """Return them for the Schur complement S and the root R of the prior."""
        return cls(squares, S, g, blocks, *diagonal(S + R.T @ R))

    @classmethod
    def of(cls, problem: Problem, values: Array, poses: Array, prior: tuple[Array, Array]) -> Normal | None:
        """None where the residuals are not finite."""
        n, f = len(poses), len(values)
        off = prior[1] @ (values - prior[0])
        squares, S, g = float(off @ off), np.zeros((f, f)), prior[1].T @ off
        step = max(1, MAX_NUMBERS_TOGETHER // (problem.m * (f + 6)))
        found = []
        for part in (slice(first, first + step) for first in range(0, n, step)):
            r, A, B = problem.rows(values, poses[part], part)
            squares += float(np.vdot(r, r))
            if not np.isfinite(squares):
                return None
            own = Blocks.of(B.mT @ B, (B.mT @ r[..., None])[..., 0], B.mT @ A)
            J = A.mT + own.G.mT @ B.mT  # (n, f, m)
            S += (J @ J.mT).sum(axis=0)
            g += (J @ r[..., None]).sum(axis=0)[:, 0]
            found.append(own)
        return cls.of_sums(squares, S, g, Blocks(*map(np.concatenate, zip(*found, strict=True))), prior[1])

    @property
    def least(self) -> float:
        """Smallest entry of the normal matrix in these coordinates."""
        return float(min(self.e.min(initial=np.inf), self.blocks.e.min()))

    def step(self, damping: float) -> tuple[Array, Array, float]:
        """Return the steps of the values and of the blocks, and the predicted decrease of the sum of squares."""
        fall, moves = 0.0, []
        for e, Q, gradient in ((self.e, self.Q, self.g), (self.blocks.e, self.blocks.Q, self.blocks.h)):
            c = (Q.mT @ gradient[..., None])[..., 0]
            y = -c / (e + damping)
            fall += float(np.sum(-y * c * (1.0 + damping / (e + damping))))
            moves.append((Q @ y[..., None])[..., 0])
        return moves[0], moves[1] + self.blocks.G @ moves[0], fall


def minimised(problem: Problem, values: Array, blocks: Array, prior: tuple[Array, Array] | None = None) -> Minimum:
    """The minimum from a start; ``prior`` is v_0 (f,) and R (f, f).

    Raises `LinAlgError` where the start has residuals that are not finite.
    """
    prior = (values, np.zeros((0, len(values)))) if prior is None else prior
    here = Normal.of(problem, values, blocks, prior)
    if here is None:
        raise np.linalg.LinAlgError("The residuals of the start are not finite.")
    damping, growth, steps, before = 1e-6, 4.0, 1, 0.0
    while True:
        move, step, above = here.step(0.0)
        rate = min(1.0, above / before) if before else 1.0
        stuck = damping * HALF_DIGITS > 1.0  # so damped a step is rounding error
        near = above <= NEAR_SHARE * here.squares and rate * above <= CONVERGED_SHARE * here.squares
        if near:
            values, blocks = values + move, problem.moved(blocks, step)
            here = here._replace(squares=here.squares - above)
        if near or stuck or steps == MAX_STEPS:
            of = here.blocks
            return Minimum(values, blocks, here.squares, here.information, of.V, of.G, near or stuck, steps)
        move, step, fall = here.step(damping)
        there = values + move, problem.moved(blocks, step)
        found = Normal.of(problem, *there, prior)
        steps += 1
        if found is not None and found.squares < here.squares:
            damping *= max(0.1, 1.0 - (2.0 * (here.squares - found.squares) / fall - 1.0) ** 3)
            growth, before, here = 4.0, above, found
            values, blocks = there
        else:
            damping, growth = growth * max(damping, here.least), 2 * growth


def reduced(A: Array, B: Array) -> tuple[Array, Array]:
    """``A + B G`` (n, m, f) and G (n, 6, f)."""
    G = Blocks.of(B.mT @ B, np.zeros((len(B), 6)), B.mT @ A).G
    return A + B @ G, G


def diagonal(H: Array) -> tuple[Array, Array]:
    """e (..., d), Q (..., d, d) with ``(H + l diag(H))^-1 = Q diag(1 / (e + l)) Q^T`` of normal matrices (..., d, d).

    e is infinite where H is singular: no step goes there.
    """
    size = np.einsum("...ii->...i", H)
    unit = 1.0 / np.sqrt(np.where(size > 0, size, np.inf))
    e, Q = np.linalg.eigh(H * unit[..., :, None] * unit[..., None, :])
    return np.where(e > PRODUCT_ROUNDING * e[..., -1:], e, np.inf), unit[..., :, None] * Q
