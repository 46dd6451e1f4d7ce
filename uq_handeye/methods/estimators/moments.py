"""Rotation axes of motions with consistent signs, and what quaternion methods make of them.

A rotation by nearly 180 degrees has two unit quaternions, ``(w, v)`` and ``(-w, -v)`` with w near 0, of which noise
chooses; if it chooses differently for A and B, the pair contradicts all others. The publications leave this open. Here
the quaternion of A has ``w >= 0``, and so has that of B, except that for motions beyond 170 degrees the sign of B's is
the one for which ``v_A . R v_B > 0``, R the rotation that fits the vectors ``sin(angle) axis``, which have no such
ambiguity. The pair of quaternions then is a smooth function of the data, up to a common sign, which products of the
two do not see.

Quaternions are ``(w, x, y, z)``.

Estimators that see the motions through sums over pairs only: estimate and covariance in O(N).

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
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.geometry.checks import CHUNK
from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array, left_jacobian, pose, skew, vee
from ...model.noise.models import PairNoise
from ..procrustes.pairs import pair_blocks, trial_blocks
from .method import Derivatives, Estimate, require

# cos(170 / 2 degrees): below this scalar part a quaternion's sign needs the other motions.
HALF_TURN = float(np.cos(np.radians(170.0 / 2.0)))

NO_AXIS = 1e-9


class Signs(NamedTuple):
    """Data that decide the signs of axes near half turns."""

    R: Array  # (T, 3, 3): the rotation that they must fit
    like: tuple[Array, Array] | None = None  # quaternions of A and B to be continuous with, when differentiating

    def of(self, trials: slice) -> Signs:
        return Signs(self.R[trials])


def axis_signs(A: Array, B: Array) -> Signs | None:
    """The `Signs` for motions (T, N, 4, 4), or None if no motion of A is near a half turn."""
    trace = np.trace(A[..., :3, :3], axis1=-2, axis2=-1)
    if trace.min() > 4.0 * HALF_TURN**2 - 1.0:  # tr R = 4 w^2 - 1
        return None
    u, v = vee(A[..., :3, :3]), vee(B[..., :3, :3])
    H = u.mT @ v
    s = np.linalg.svd(H, compute_uv=False)
    require(
        s[:, 1] > 1e-8 * A.shape[1],
        "some motions rotate by 180 degrees, where the sign of an axis is open, and the others do not determine it.",
    )
    return Signs(orthonormalise(H))


def quaternions(A: Array, B: Array, signs: Signs | None) -> tuple[Array, Array]:
    """Unit quaternions (..., m, 4) of the rotations of A and B (..., m, 4, 4), with consistent signs."""
    q_A, q_B = (
        Rotation.from_matrix(T[..., :3, :3], assume_valid=True).as_quat(canonical=True, scalar_first=True)
        for T in (A, B)
    )
    if signs is None:
        return q_A, q_B
    if signs.like is not None:
        for q, base in zip((q_A, q_B), signs.like, strict=True):
            q *= np.where(np.einsum("...i,...i->...", q, base) < 0, -1.0, 1.0)[..., None]
        return q_A, q_B
    aligned = np.einsum("...mi,...ij,...mj->...m", q_A[..., 1:], signs.R, q_B[..., 1:])
    q_B *= np.where((q_A[..., 0] < HALF_TURN) & (aligned < 0), -1.0, 1.0)[..., None]
    return q_A, q_B


def rotation_vectors(q: Array) -> Array:
    """``angle axis`` (..., 3) of unit quaternions, of an angle beyond 180 degrees where w < 0."""
    sine = np.sqrt(np.einsum("...i,...i->...", q[..., 1:], q[..., 1:]))
    angle = 2.0 * np.arctan2(sine, q[..., 0])
    factor = np.where(sine > NO_AXIS, angle / np.where(sine > NO_AXIS, sine, 1.0), 2.0)
    return np.asarray(factor[..., None] * q[..., 1:])


def unit_axes(q: Array, name: str) -> Array:
    """``axis`` (..., 3) of unit quaternions; a rotation by less than 1e-9 rad has none."""
    sine = np.sqrt(np.einsum("...i,...i->...", q[..., 1:], q[..., 1:]))
    flat = (sine > NO_AXIS).reshape(-1, sine.shape[-1]).all(axis=-1)
    require(flat, f"a motion in `{name}` does not rotate, so that its axis is open; leave such pairs out.")
    return np.asarray(q[..., 1:] / sine[..., None])


def dual_quaternions(T: Array, q: Array) -> Array:
    """``(q, q')`` (..., 8) with the dual part ``q' = t q / 2`` of poses with the rotations q."""
    t, w, v = T[..., :3, 3], q[..., :1], q[..., 1:]
    scalar = -np.einsum("...i,...i->...", t, v)[..., None]
    return np.concatenate([q, 0.5 * scalar, 0.5 * (w * t + np.cross(t, v))], axis=-1)


def pose_of(dual: Array) -> Array:
    """The pose (..., 4, 4) of ``(q, q')`` (..., 8) with |q| = 1: ``t = 2 q' q*``."""
    q, p = dual[..., :4], dual[..., 4:]
    t = 2.0 * (q[..., :1] * p[..., 1:] - p[..., :1] * q[..., 1:] - np.cross(p[..., 1:], q[..., 1:]))
    return pose(Rotation.from_quat(q, scalar_first=True).as_matrix(), t)


def twists(T: Array, rotvec: Array) -> Array:
    """The logarithm (..., 6) of poses: rotation vector alpha, and ``J_l(alpha)^-1 t``."""
    moment = np.linalg.solve(left_jacobian(rotvec), T[..., :3, 3:])[..., 0]
    return np.concatenate([rotvec, moment], axis=-1)


def left_matrix(q: Array) -> Array:
    """``q x = L(q) x``, (..., 4) -> (..., 4, 4)."""
    return _product_matrix(q, 1.0)


def right_matrix(q: Array) -> Array:
    """``x q = R(q) x``, (..., 4) -> (..., 4, 4)."""
    return _product_matrix(q, -1.0)


def _product_matrix(q: Array, sign: float) -> Array:
    M = np.zeros((*q.shape, 4))
    M[..., 0, 0] = q[..., 0]
    M[..., 0, 1:], M[..., 1:, 0] = -q[..., 1:], q[..., 1:]
    M[..., 1:, 1:] = q[..., :1, None] * np.eye(3) + sign * skew(q[..., 1:])
    return M


# (left (..., m, p), right (..., m, q)) for pairs m: the moment is sum_m left right^T
Factors = Sequence[tuple[Array, Array]]
Moments = list[Array]  # (T, p, q) each

# Steps of the central differences: of the data in rad and in typical translations (the factors are linear in
# these), and of the moments relative to what a pair's data error of that size does to them.
ANGLE_STEP = 1e-5
LENGTH_STEP = 1e-2
MOMENT_STEP = 1e-7
# Problems in moments that are solved in one batch when differentiating.
PROBLEMS = 4096


@dataclass(frozen=True)
class MomentSolver:
    """A method by its factors and its solution of the moments."""

    factors: Callable[[Array, Array, Signs | None], Factors]  # of A, B (..., m, 4, 4)
    solution: Callable[[Moments, int], Estimate]  # of the moments of N pairs
    nearby: Callable[[Moments, int, Array], Array] | None = None  # X (T, 4, 4) by a short way from a neighbour
    slopes: Callable[[Moments, int], list[Array]] | None = None  # d xi_X / d M (T, 6, p, q), where it is known exactly
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
        return self.solution(self.moments(A, B, signs), A.shape[1])

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
        steps = [np.repeat([ANGLE_STEP, length * LENGTH_STEP], 3)[:, None, None, None] for length in self.lengths]
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
        for start in range(0, len(used), PROBLEMS // 2):
            which = used[start : start + PROBLEMS // 2]
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


def _moment_steps(solver: MomentSolver, A: Array, B: Array, signs: Signs | None) -> Moments:
    """Steps of each moment: MOMENT_STEP sqrt(N) times the root mean squares of its two factors."""
    T, N = A.shape[:2]
    squares: list[list[Array]] = []
    for trials, pairs in product(trial_blocks(T, N), pair_blocks(N)):
        of = None if signs is None else signs.of(trials)
        for k, sides in enumerate(solver.factors(A[trials, pairs], B[trials, pairs], of)):
            if k == len(squares):
                squares.append([np.zeros((T, side.shape[-1])) for side in sides])
            for total, side in zip(squares[k], sides, strict=True):
                total[trials] += np.einsum("tmp,tmp->tp", side, side)
    return [MOMENT_STEP * np.sqrt(left[:, :, None] * right[:, None, :] / N) for left, right in squares]


def _difference(T: Array, reference: Array) -> Array:
    """``xi`` (..., 6) between two neighbouring poses: ``vee(R R_0^T) / 2`` and the difference of translations."""
    turn = T[..., :3, :3] @ reference[..., :3, :3].mT
    return np.concatenate([0.5 * vee(turn), T[..., :3, 3] - reference[..., :3, 3]], axis=-1)


def _typical_length(T: Array) -> float:
    """Root mean square of the translations, or 1 where there are none."""
    return float(np.sqrt(np.mean(T[..., :3, 3] ** 2))) or 1.0


_TURNS = Rotation.from_rotvec(ANGLE_STEP * np.concatenate([np.eye(3), -np.eye(3)])).as_matrix()


def _shifted(T: Array, length: float) -> Array:
    """T moved by plus the step along each of its six errors, then by minus: (12, ..., 4, 4)."""
    copies = np.broadcast_to(T, (12, *T.shape)).copy()
    for sign, first in ((1.0, 0), (-1.0, 6)):
        turns = _TURNS[first // 2 : first // 2 + 3].reshape(3, *[1] * (T.ndim - 2), 3, 3)
        copies[first : first + 3, ..., :3, :3] = turns @ T[..., :3, :3]
        for j in range(3):
            copies[first + 3 + j, ..., j, 3] += sign * LENGTH_STEP * length
    return copies
