r"""Trials of `efficient` on motions with noise of their own, at a few times the cost of 4DPA's trials.

Model, unknowns and steps are those of `likelihood` and `constraint`: ``A X = X B``, independent errors
``xi = (theta, tau)`` of the motions (left rotation, additive translation, rad and m) of known covariance, X by two
Gauss-Helmert steps from 4DPA (T5), and ``I_F^-1`` where the second was taken. Nothing is approximated; only the
arithmetic differs. Neither serves both: of 60 motions this one takes 1.6 times as long as `efficient` for one problem,
0.3 times for a thousand, and it knows no poses, no joint noise and no weights.

- Arrays are (component, pairs, trials) in blocks that stay in the cache; rotations are quaternions ``(w, x, y, z)``.
- B is seen in the frame of A: rotated by the true X to begin with, then by each estimate. X is then a rotation near 1,
  and its left error is the same in both frames.
- With ``l = R_A t_X``, ``L = [l]x`` and the covariances A and B (rotated) of a pair's two motions, its residual has

      S_11 = A_11 + B_11,    S_21 = C - L A_11,    S_22 = Q - L A_12 - (L A_12)^T + L A_11 L^T
      C = A_21 + B_21,       Q = A_22 + B_22

  The Cholesky factor ``[[U, 0], [G, V]]`` of S follows from

      U U^T = S_11,    G = Gamma - L Lambda,    Gamma = C U^-T,    Lambda = A_11 U^-T
      V V^T = S_22 - G G^T = K - L F - (L F)^T,    K = Q - Gamma Gamma^T
      F = (A_12 - Lambda Gamma^T) + (A_11 - Lambda Lambda^T) L / 2

  If the noise is common to all pairs, only L differs from pair to pair.
- The errors v of both sides satisfy ``D v = e = rho + J xi``. So A is corrected by ``v_A = A D_A^T S^-1 e``, and B, as
  seen in the frame of A, by ``e - D_A v_A``.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.component_rows import (
    Side,
    Triangle,
    composed,
    cross,
    halves,
    logarithm,
    matrix,
    matrix_less_one,
    quaternion,
    rotated,
    rows_of,
    skew_product,
    times,
    turned,
)
from ...core.geometry.se3 import Array
from ...fit.likelihood.constraint import OnMotions, Unknowns, residual_covariance
from ...fit.likelihood.gauss_helmert import SINGULAR, efficient
from ...fit.likelihood.starts import start_of
from ...model.noise.models import PairNoise, require_count
from ...model.noise.square_roots import cholesky_of
from ...model.poses.motions import Motions
from .fourdpa_pairs import errors_by_moments

# Pairs times trials that are worked on at once, trials that make a fast inner loop, and the most pairs times trials
# that are kept between the steps (75 numbers each).
ELEMENTS, TRIALS, KEEP = 5120, 256, 32_768

Found = tuple[Array, Array, NDArray[np.bool_]]


def efficient_on_drawn(A: Array, B: Array, X: Array, noise: PairNoise, rng: np.random.Generator, trials: int) -> Found:
    """`efficient` on so many draws of the noise about true motions.

    Numbers depend on the generator, on the number of pairs N and on ``trials`` only.

    Parameters
    ----------
    A, B : (N, 4, 4)
        True motions with ``A X = X B``.
    X : (4, 4)
    noise : PairNoise
    rng : numpy Generator
    trials : int

    Returns
    -------
    errors : (trials, 6)
        ``(log(R_hat R^T), t_hat - t)``, 0 where not ok.
    covariances : (trials, 6, 6)
        ``I_F^-1`` of each, the identity where not ok.
    ok : (trials,) bool
        False where the draw does not determine X.

    Raises
    ------
    InputError
        What `efficient` says of this noise or, if no trial is ok, 4DPA and `efficient` of the true motions.
    """
    N = len(A)
    model = _Model.of(noise, X, N)
    linear = OnMotions(A, B).linearise(Unknowns(X, None), A, B)
    cholesky_of(residual_covariance(linear.sides, noise))  # raises where noise leaves a part of the residuals exact
    true_A, true_B = Side.of(A, None, noise.factors[0]), Side.of(B, X[:3, :3], noise.factors[1])
    errors, covariances, ok = _empty(trials)
    for some, data in _blocks(trials, N):
        for part in data:
            part.a, part.t_A = true_A.drawn(part.pairs, part.m, rng, np.empty((7, part.n, part.m)))
            part.b, part.t_B = true_B.drawn(part.pairs, part.m, rng, np.empty((7, part.n, part.m)))
        _estimate(model, data, errors[some], covariances[some], ok[some])
    if not ok.any():
        motions = Motions(A, B)  # what is no matter of the draw raises
        start_of(motions, OnMotions(A, B), None)
        efficient(motions, noise)
    return errors, covariances, ok


def efficient_on_motions(A: Array, B: Array, X: Array, noise: PairNoise) -> Found:
    """The same on measured motions (trials, N, 4, 4); errors are relative to X (4, 4)."""
    trials, N = A.shape[:2]
    model = _Model.of(noise, X, N)
    errors, covariances, ok = _empty(trials)
    for some, data in _blocks(trials, N):
        for part in data:
            part.a, part.t_A = rows_of(A[some, part.pairs].swapaxes(0, 1), None)
            part.b, part.t_B = rows_of(B[some, part.pairs].swapaxes(0, 1), X[:3, :3])
        _estimate(model, data, errors[some], covariances[some], ok[some])
    return errors, covariances, ok


def _empty(trials: int) -> Found:
    return np.zeros((trials, 6)), np.tile(np.eye(6), (trials, 1, 1)), np.zeros(trials, dtype=bool)


def _blocks(trials: int, N: int) -> Iterator[tuple[slice, list[_Part]]]:
    """Trials that are estimated together, with the work space of their pairs."""
    size = max(1, min(KEEP // N, max(ELEMENTS // N, TRIALS)))
    data: list[_Part] = []
    for first in range(0, trials, size):
        some = slice(first, min(first + size, trials))
        m = some.stop - some.start
        if not data or data[0].m != m:
            count = -(-N * m // ELEMENTS)
            edges = [N * k // count for k in range(count + 1)]
            data = [_Part(slice(i, j), m) for i, j in pairwise(edges) if j > i]
        yield some, data


class _Part:
    """Some of the pairs in a block of trials: their motions, and what one step leaves to the next."""

    a: Array  # (4, n, m), as all below: quaternion of A
    t_A: Array
    b: Array  # of B in the frame of A
    t_B: Array
    U: Triangle
    V: Triangle

    def __init__(self, pairs: slice, m: int) -> None:
        n = pairs.stop - pairs.start
        self.pairs, self.n, self.m = pairs, n, m
        # Whitened columns: residual, derivatives by theta, and (lower rows only) by tau.
        self.upper, self.lower = np.empty((3, 4, n, m)), np.empty((3, 7, n, m))
        self.work = np.empty((3, 4, n, m))
        self.G, self.lever = np.empty((3, 3, n, m)), np.empty((3, n, m))
        self.v_A: Array | None = None  # the error found of A, and D_B v_B of B's
        self.of_B = np.empty((6, n, m))

    def turn_B(self, R: Array, corrected: bool) -> None:
        """B, and the error found of it, into the frame rotated by R (3, 3, m)."""
        self.b[1:], self.t_B = rotated(R, self.b[1:]), rotated(R, self.t_B)
        if corrected:
            self.of_B[:3], self.of_B[3:] = rotated(R, self.of_B[:3]), rotated(R, self.of_B[3:])


class _Model(NamedTuple):
    """Noise in the frame of A, and the true translation of X."""

    A: Array | None  # (6, 6) or (N, 6, 6)
    blocks: tuple[Array, Array]  # of A and B, (3, p, 3, 3): the blocks 11, 21 and 22; p is 1 or N
    t_X: Array

    @property
    def per_pair(self) -> bool:
        return any(S.shape[1] > 1 for S in self.blocks)

    @classmethod
    def of(cls, noise: PairNoise, X: Array, N: int) -> _Model:
        require_count(noise.A, N, "A", "motions")
        require_count(noise.B, N, "B", "motions")
        R = X[:3, :3]
        A, B = (np.zeros((1, 6, 6)) if S is None else S.reshape(-1, 6, 6) for S in (noise.A, noise.B))
        of_A, of_B = (np.stack([S[:, :3, :3], S[:, 3:, :3], S[:, 3:, 3:]]) for S in (A, B))
        return cls(noise.A, (of_A, R @ of_B @ R.T), X[:3, 3])


class _Coefficients(NamedTuple):
    """Coefficients of the factor of S, in the notation of the module: (3, 3, p, m) with p = 1 for common noise."""

    U: Triangle
    Gamma: Array
    Lambda: Array
    K: Array
    F_0: Array
    F_L: Array  # F is F_0 + F_L L

    @classmethod
    def of(cls, model: _Model, R: Array, pairs: slice) -> _Coefficients:
        """Return the coefficients with B rotated by R (3, 3, m)."""
        m = R.shape[-1]
        A, B = (S[:, pairs] if S.shape[1] > 1 else S for S in model.blocks)
        twice = np.einsum("iam,jbm->abijm", R, R).reshape(9, 9 * m)
        # pair by pair: of one large product OpenBLAS would make threads
        of_B = (B.swapaxes(0, 1).reshape(-1, 3, 9) @ twice).reshape(-1, 3, 3, 3, m).transpose(1, 2, 3, 0, 4)
        A = A.transpose(0, 2, 3, 1)[..., None]
        S_11, C, Q = A + of_B
        U = Triangle.of(S_11)
        Gamma, Lambda = C.swapaxes(0, 1).copy(), np.array(np.broadcast_to(A[0], C.shape))  # transposed
        U.solve(Gamma)
        U.solve(Lambda)
        K = Q - np.einsum("kinm,kjnm->ijnm", Gamma, Gamma)
        F_0 = A[1].swapaxes(0, 1) - np.einsum("kinm,kjnm->ijnm", Lambda, Gamma)
        F_L = 0.5 * (A[0] - np.einsum("kinm,kjnm->ijnm", Lambda, Lambda))
        return cls(U, Gamma.swapaxes(0, 1), Lambda.swapaxes(0, 1), K, F_0, F_L)


# -------------------------------------------------------------------------------------------- the estimate


def _estimate(model: _Model, data: list[_Part], errors: Array, covariances: Array, ok: NDArray[np.bool_]) -> None:
    """Both steps on a block of trials; writes the results that are ok."""
    with np.errstate(all="ignore"):
        turn, t, good = _start(model, data)
        q, R = turn, np.eye(3)[..., None]
        for step in (1, 2):
            dR = matrix(turn)
            R = np.einsum("ikm,kjm->ijm", dR, R)
            common = None if model.per_pair else _Coefficients.of(model, R, slice(1))
            total = np.zeros((7, 7, t.shape[-1]))
            for part in data:
                part.turn_B(dR, step == 2)
                _whiten(part, t, common or _Coefficients.of(model, R, part.pairs), step == 2)
                _add_gram(part, total)
            xi, covariance, determined = _solved(total)
            good &= determined
            if step == 1:
                for part in data:
                    _correct(model, part, xi)
            turn = quaternion(xi[:3])
            q = composed(turn, q)
            t = t + xi[3:]
        theta = np.empty((3, *q.shape[1:]))
        logarithm(q, theta)
    found = np.concatenate([theta[:, 0], t - model.t_X[:, None]])
    good &= np.isfinite(found).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1))
    ok[:] = good
    errors[good] = found.T[good]
    covariances[good] = covariance.transpose(2, 0, 1)[good]


def _start(model: _Model, data: list[_Part]) -> tuple[Array, Array, NDArray[np.bool_]]:
    """4DPA from the moments of u and w (T2): quaternions (4, 1, m), t (3, m), and ok."""
    moments = np.zeros((2, 3, 3, data[0].m))
    H, K = moments
    for part in data:
        u, w = halves(part.a, part.t_A)
        v, z = halves(part.b, part.t_B)
        H += np.einsum("inm,jnm->ijm", u, v)
        K += np.einsum("inm,jnm->ijm", u, z)
        K += np.einsum("inm,jnm->ijm", w, v)
    xi, ok = errors_by_moments(moments, sum(part.n for part in data), model.t_X)
    return quaternion(xi[:, :3].T), xi[:, 3:].T + model.t_X[:, None], ok


def _whiten(part: _Part, t: Array, c: _Coefficients, corrected: bool) -> None:
    """rho and J of both rows of the constraint, whitened, and the factor of S; X is 1 and t (3, m)."""
    a, b, lever, arm, G = part.a, part.b, part.lever, part.t_B, part.G
    upper, lower = part.upper, part.lower
    relative = np.empty_like(a)  # a conj(b)
    np.multiply(a[0], b[0], out=relative[0])
    for k in (1, 2, 3):
        relative[0] += a[k] * b[k]
    relative[1:] = cross(b[1:], a[1:])
    relative[1:] += a[1:] * b[0]
    relative[1:] -= b[1:] * a[0]
    logarithm(relative, upper[:, 0])
    T = lower[:, 4:]
    matrix_less_one(a, T)
    upper[:, 1:] = T
    np.einsum("ijnm,jm->inm", T, t, out=lever)
    np.subtract(part.t_A, arm, out=lower[:, 0])
    lower[:, 0] += lever
    lever += t[:, None]
    if corrected:  # rho = r + D_B v_B + (theta, tau - l x theta) of v_A
        upper[:, 0] += part.of_B[:3]
        lower[:, 0] += part.of_B[3:]
        if part.v_A is not None:
            upper[:, 0] += part.v_A[:3]
            lower[:, 0] += part.v_A[3:]
            lower[:, 0] -= cross(lever, part.v_A[:3])
    F = G  # F_L L column by column
    for j, p, x, r, s in ((0, 1, 2, 2, 1), (1, 2, 0, 0, 2), (2, 0, 1, 1, 0)):
        np.multiply(c.F_L[:, p], lever[x], out=F[:, j])
        F[:, j] -= c.F_L[:, r] * lever[s]
    F += c.F_0
    product = part.work[:, :3]
    skew_product(lever, F, product)
    for i in range(3):
        for j in range(i + 1):
            np.add(product[i, j], product[j, i], out=F[i, j])
            np.subtract(c.K[i, j], F[i, j], out=F[i, j])
    part.U, part.V = c.U, Triangle.of(F)
    skew_product(lever, c.Lambda, G)
    np.subtract(c.Gamma, G, out=G)
    part.U.solve(upper)
    by_G = np.einsum("iknm,kjnm->ijnm", G, upper, out=part.work)
    lower[:, 0] -= by_G[:, 0]
    M = lower[:, 1:4]
    np.negative(by_G[:, 1:], out=M)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # [R_X t_B]x
        M[j, i] += arm[k]
        M[i, j] -= arm[k]
    part.V.solve(lower)


def _add_gram(part: _Part, total: Array) -> None:
    """Sums over the pairs of products of the whitened columns, to the upper triangle (7, 7, m)."""
    for rows in (part.upper, part.lower):
        columns = rows.shape[1]
        for j in range(columns):
            total[j, j:columns] += np.einsum("rnm,rknm->km", rows[:, j], rows[:, j:])


def _solved(total: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """The step xi (6, m), its covariance (6, 6, m), and whether all of X is determined.

    Gauss-Jordan elimination of ``(I_F, sum J^T S^-1 rho)``: the pivots of a positive matrix need no search.
    """
    for j in range(2, 7):
        total[j, 1:j] = total[1:j, j]
    information, diagonal = total[1:, 1:], np.einsum("iim->im", total)[1:].copy()
    g = total[1:, 0]
    g[:] = total[0, 1:]
    table = total[1:]  # the right-hand side first
    ok = (diagonal > 0).all(axis=0)
    for k in range(6):
        pivot = 1.0 / information[k, k]
        ok &= information[k, k] > 0
        row = table[k] * pivot
        column = information[:, k].copy()
        column[k] = 0.0
        table -= column[:, None] * row
        np.multiply(column, -pivot, out=information[:, k])
        table[k] = row
        information[k, k] = pivot
    # the trace of the inverse, scaled to a unit diagonal before, is 1 to 6 times that of its largest eigenvalue
    ok &= np.einsum("im,iim->m", diagonal, information) * SINGULAR < 1.0
    return -g, information, ok


def _correct(model: _Model, part: _Part, xi: Array) -> None:
    """The motions less the errors that the step ascribes to them; B is still in the frame before it."""
    with_one = np.concatenate([np.ones_like(xi[:1]), xi])
    above = np.einsum("rknm,km->rnm", part.upper, with_one[:4])
    below = np.einsum("rknm,km->rnm", part.lower, with_one)
    e = part.of_B
    part.U.times(above, e[:3])
    part.V.times(below, e[3:])
    e[3:] += np.einsum("iknm,knm->inm", part.G, above)
    if model.A is not None:
        part.V.solve_transposed(below)
        above -= np.einsum("kinm,knm->inm", part.G, below)
        part.U.solve_transposed(above)
        above += cross(part.lever, below)
        v = part.v_A = times(model.A, part.pairs, np.concatenate([above, below]))
        e -= v
        e[3:] += cross(part.lever, v[:3])
        part.a = turned(part.a, -v[:3])
        part.t_A -= v[3:]
    part.b = turned(part.b, e[:3])
    part.t_B += e[3:]
