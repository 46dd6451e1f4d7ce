"""Estimators that see the motions through sums over pairs only: estimate and covariance in O(N).

Model: each pair contributes factors ``l_i, r_i`` (vectors, known functions of A_i and B_i), and

    X = g( sum_i l_i r_i^T, ... )

depends on them through one or a few such moment matrices only. To first order

    xi_X = sum_i D_i xi_i,    D_i xi = (dg/dM) : ( (dl_i xi) r_i^T + l_i (dr_i xi)^T )

The derivatives of g by the few entries of M (unless they are known) and of the factors by the twelve errors of a pair
are central differences (T7), each in one batched call, so that the cost is linear in the number of pairs. Errors are
``xi = (theta, tau)``: left rotation, additive translation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from ..core.geometry.checks import CHUNK
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array, vee
from ..core.rounding import THIRD_DIGITS
from ..model.errors.models import PairNoise
from .method import Derivatives, Estimate
from .pairs import pair_blocks, trial_blocks
from .quaternions import Signs, axis_signs, quaternions

# (left (..., m, p), right (..., m, q)) for pairs m: the moment is sum_m left right^T
Factors = Sequence[tuple[Array, Array]]
Moments = list[Array]  # (T, p, q) each


class MomentSolver(NamedTuple):
    """A method by its factors and its solution of the moments."""

    factors: Callable[[Array, Array, Signs | None], Factors]  # of A, B (..., m, 4, 4)
    solution: Callable[[Moments, int], Estimate]  # of the moments of N pairs
    nearby: Callable[[Moments, int, Array], Array] | None = None  # X (T, 4, 4) by a short way from a neighbour
    slopes: Callable[[Moments, int], list[Array]] | None = None  # d xi_X / d M (T, 6, p, q), where it is known exactly
    refined: Callable[[Array, Array, Moments], Estimate] | None = None  # by the motions themselves, after the moments
    axes: bool = True  # whether it needs to know the signs of rotation axes

    def moments(self, A: Array, B: Array, signs: Signs | None) -> Moments:
        """The moment matrices of motions (T, N, 4, 4)."""
        T, N = A.shape[:2]
        if T * N <= CHUNK:
            return [left.mT @ right for left, right in self.factors(A, B, signs)]
        sums: Moments = []
        for trials, pairs in product(trial_blocks(T, N), pair_blocks(N)):
            of = None if signs is None else signs.of(trials)
            for k, (left, right) in enumerate(self.factors(A[trials, pairs], B[trials, pairs], of)):
                part = left.mT @ right
                if k == len(sums):
                    sums.append(np.zeros((T, *part.shape[1:])))
                sums[k][trials] += part
        return sums

    def estimate(self, A: Array, B: Array, noise: PairNoise | None) -> Estimate:
        signs = axis_signs(A, B) if self.axes else None
        moments = self.moments(A, B, signs)
        return self.solution(moments, A.shape[1]) if self.refined is None else self.refined(A, B, moments)

    def derivatives(self, A: Array, B: Array, noise: PairNoise | None, X: Array) -> Callable[[slice], Derivatives]:
        signs = axis_signs(A, B) if self.axes else None
        return lambda trials: MomentDerivatives(
            self, A[trials], B[trials], None if signs is None else signs.of(trials), X[trials]
        )

    def solve_near(self, moments: Moments, N: int, X: Array) -> Array:
        return self.solution(moments, N).X if self.nearby is None else self.nearby(moments, N, X)


class MomentDerivatives:
    """`Derivatives` of a `MomentSolver` at the data."""

    def __init__(self, solver: MomentSolver, A: Array, B: Array, signs: Signs | None, X: Array) -> None:
        self.solver, self.signs = solver, signs
        self.lengths = _typical_length(A), _typical_length(B)
        if solver.slopes is None:
            self.by_moments = _by_moments(solver, A, B, signs, X)
        else:
            self.by_moments = solver.slopes(solver.moments(A, B, signs), A.shape[1])

    def block(self, A: Array, B: Array, pairs: slice) -> Array:
        T, m = A.shape[:2]
        F = np.zeros((6, 12, T, m))
        # the shifted motions keep the signs of the unshifted, which may lie right at a half turn
        signs = None if self.signs is None else Signs(self.signs.R, quaternions(A, B, self.signs))
        shifted = []
        for moved, other, length, first in ((A, B, self.lengths[0], 0), (B, A, self.lengths[1], 6)):
            copies = _shifted(moved, length)  # (12, T, m, 4, 4): +, - of the six errors
            others = np.broadcast_to(other, copies.shape)
            pair = (copies, others) if first == 0 else (others, copies)
            shifted.append(self.solver.factors(*pair, signs))
        steps = [np.repeat([THIRD_DIGITS, length], 3)[:, None, None, None] for length in self.lengths]
        for k, (left, right) in enumerate(self.solver.factors(A, B, self.signs)):
            J = self.by_moments[k]  # (T, 6, p, q)
            J_right = np.einsum("tapq,tmq->tamp", J, right, optimize=True)
            J_left = np.einsum("tapq,tmp->tamq", J, left, optimize=True)
            for first, side, step in zip((0, 6), shifted, steps, strict=True):
                for by, values in zip((J_right, J_left), side[k], strict=True):
                    slope = (values[:6] - values[6:]) / (2.0 * step)
                    F[:, first : first + 6] += np.einsum("stmp,tamp->astm", slope, by, optimize=True)
        return F.reshape(6, 2, 6, T, m).transpose(1, 0, 2, 3, 4)

    def weight(self, N: int) -> Array:
        return np.broadcast_to(np.eye(6), (len(self.by_moments[0]), 6, 6))


def _by_moments(solver: MomentSolver, A: Array, B: Array, signs: Signs | None, X: Array) -> list[Array]:
    """``d xi_X / d M`` (T, 6, p, q) of each moment matrix, by central differences of the solution."""
    T, N = A.shape[:2]
    at = solver.moments(A, B, signs)
    sizes = [m[0].size for m in at]
    flat = np.concatenate([m.reshape(T, -1) for m in at], axis=1)
    step = np.concatenate([s.reshape(T, -1) for s in _moment_steps(solver, A, B, signs)], axis=1)
    k = flat.shape[1]
    result = np.zeros((T, 6, k))
    for t in range(T):
        used = np.flatnonzero(step[t] > 0)
        for start in range(0, len(used), CHUNK // 2):
            which = used[start : start + CHUNK // 2]
            probes = np.broadcast_to(flat[t], (2, len(which), k)).copy()
            row = np.arange(len(which))
            probes[0, row, which] += step[t, which]
            probes[1, row, which] -= step[t, which]
            width = probes[0, row, which] - probes[1, row, which]  # what rounding left of twice the step
            parts = np.split(probes.reshape(-1, k), np.cumsum(sizes)[:-1], axis=1)
            problems = [part.reshape(-1, *m.shape[1:]) for part, m in zip(parts, at, strict=True)]
            found = solver.solve_near(problems, N, np.broadcast_to(X[t], (2 * len(which), 4, 4)))
            plus, minus = found.reshape(2, len(which), 4, 4)
            result[t][:, which] = _difference(plus, minus).T / width
    bounds = np.cumsum(sizes)[:-1]
    return [part.reshape(T, 6, *m.shape[1:]) for part, m in zip(np.split(result, bounds, axis=2), at, strict=True)]


def _moment_steps(
    solver: MomentSolver, A: Array, B: Array, signs: Signs | None, relative_step: float = 1e-7
) -> Moments:
    """Return steps of each moment: the relative step times sqrt(N) and the root mean squares of its two factors."""
    T, N = A.shape[:2]
    squares: list[list[Array]] = []
    for trials, pairs in product(trial_blocks(T, N), pair_blocks(N)):
        of = None if signs is None else signs.of(trials)
        for k, sides in enumerate(solver.factors(A[trials, pairs], B[trials, pairs], of)):
            if k == len(squares):
                squares.append([np.zeros((T, side.shape[-1])) for side in sides])
            for total, side in zip(squares[k], sides, strict=True):
                total[trials] += np.einsum("tmp,tmp->tp", side, side)
    return [relative_step * np.sqrt(left[:, :, None] * right[:, None, :] / N) for left, right in squares]


def _difference(T: Array, reference: Array) -> Array:
    """``xi`` (..., 6) between two neighbouring poses: ``vee(R R_0^T) / 2`` and the difference of translations."""
    turn = T[..., :3, :3] @ reference[..., :3, :3].mT
    return np.concatenate([0.5 * vee(turn), T[..., :3, 3] - reference[..., :3, 3]], axis=-1)


def _typical_length(T: Array) -> float:
    """Root mean square of the translations, or 1 where there are none."""
    return float(np.sqrt(np.mean(T[..., :3, 3] ** 2))) or 1.0


def _shifted(T: Array, length: float) -> Array:
    """T moved by plus the step along each of its six errors, then by minus: (12, ..., 4, 4)."""
    copies = np.broadcast_to(T, (12, *T.shape)).copy()
    for sign, first in ((1.0, 0), (-1.0, 6)):
        turns = Rotation.from_rotvec(sign * THIRD_DIGITS * np.eye(3)).as_matrix().reshape(3, *[1] * (T.ndim - 2), 3, 3)
        copies[first : first + 3, ..., :3, :3] = turns @ T[..., :3, :3]
        for j in range(3):
            copies[first + 3 + j, ..., j, 3] += sign * length
    return copies
