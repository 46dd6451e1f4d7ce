r"""Proof that an estimate is the global minimum: a dual bound with a Cholesky factor (T18).

With isotropic weights of the rows of each view, one for rotation and one for translation,

    f = sum_e w_r |R_P R_X R_C - R_Q R_W|_F^2 + w_t |t_L - t_Q|^2

is quadratic in the rotations once the translations are eliminated, for one arm or arms whose bases are known. About a
local minimum ``R_a* (I + D_a)``, with ``d = (vec D_1, ..., vec D_m, 1)``, f is ``d^T Q d`` with the minimum's value as
the last entry of Q, and ``I + D_a`` is a rotation if its columns and rows are orthonormal and right-handed: 20
independent quadratic equations ``d^T A_aj d = 0``. For any multipliers with

    M = Q - gamma e e^T - sum_aj lambda_aj A_aj >= 0

gamma is a lower bound of f over all rotations. The largest one is found by a barrier, Newton's method for
``t gamma + log det M`` in 20 m + 1 numbers, t growing; a Cholesky factor of M, with room for its rounding, proves the
last one (Higham 2002, section 10.1). As f is written about the minimum, M keeps the digits that the gap needs.

The bound is on the isotropic objective; the estimate weighs rows as their covariance says, and its distance from that
minimum in its standard deviations is stated. Where the bound is below the minimum, ``M^-1 e`` leads to a better one.
Reference: Briales and Gonzalez-Jimenez (2017), CVPR, doi:10.1109/CVPR.2017.595, for the redundant constraints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cholesky

from ...core.files.records import Record
from ...core.geometry.nearest_rotation import nearest_rotation
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, logarithm
from ...model.rig.description import Rig
from ..graph.fit import Prior, RigFit, Weights, fit
from ..graph.graph import VIEWS_TOGETHER, Graph

# A minimum is proven global where the relative gap to its lower bound is below this.
PROVEN = 1e-5
# Standard deviation (rad, m) presumed of every view before its noise is known.
ROUGH_SD = 2e-3
# An estimate belongs to the global minimum of the isotropic problem up to this distance, RMS in standard
# deviations;
MAX_APART_SD = 5.0
# beyond it, where the fit that starts at that minimum ends nearer to the estimate than this.
MAX_SAME_DISTANCE_SD = 0.5


@dataclass(frozen=True, eq=False)
class Optimality(Record):
    """Proof that the estimate belongs to the global minimum, or its absence.

    Attributes
    ----------
    proven : bool
    gap : float or None
        (value of the minimum - lower bound) / value; None where there is no bound.
    distance : float or None
        Of the estimate from the minimum, root mean square in its standard deviations.
    rejected : int
        Local minima that the bound rejected before this estimate.
    reason : str
        Why there is no proof.
    """

    proven: bool = False
    gap: float | None = None
    distance: float | None = None
    rejected: int = 0
    reason: str = ""

    @property
    def words(self) -> str:
        """The proof in a phrase."""
        minima = "minimum" if self.rejected == 1 else "minima"
        before = f"; {self.rejected} local {minima} left before it" if self.rejected else ""
        if not self.proven:
            return f"not proven: {self.reason}{before}"
        return (
            f"proven (relative gap {self.gap:.0e}; the estimate is {self.distance:.2g} standard deviations from the "
            f"minimum of the isotropic problem){before}"
        )


def prove(rig: Rig, found: RigFit, prior: Prior | None = None) -> tuple[Optimality, Array | None]:
    """Return the proof for an estimate, and a better minimum (m, 4, 4) where it rejects that of the estimate."""
    if bases := _open_bases(rig, found.graph):
        return Optimality(
            False, reason=f"the bound needs known bases, and that of {', '.join(bases)} is estimated; other minima "
            "were looked for by random starts only"
        ), None  # fmt: skip
    problem = Isotropic.of_fit(found)
    if len(problem.others) < found.graph.m - len(rig.arms) + 1:
        return Optimality(False, reason="of a camera or a target no view counts"), None
    at, gap, better = problem.globally(found.at)
    if better is not None:
        return Optimality(False, gap, reason="the bound rejects this minimum, there is a better one"), better
    if gap > PROVEN:
        return Optimality(
            False, gap, reason=f"the lower bound is {gap:.1e} of the value below the minimum, and no better one was "
            "found"
        ), None  # fmt: skip
    far = _distance(found, at, problem.others)
    if far > MAX_APART_SD:  # equal weights represent different noise badly: is the minimum reached from there?
        again = fit(found.graph, found.noise, at, "efficient", Weights(found.edge_weights, found.pose_weights), prior)
        if (apart := _distance(found, again.at, problem.others)) > MAX_SAME_DISTANCE_SD:
            return Optimality(
                False, gap, far, reason=f"the estimate is {far:.2g} standard deviations from the global minimum of the "
                f"isotropic problem, from which one is reached that is {apart:.2g} away"
            ), again.at  # fmt: skip
    return Optimality(True, gap, far), None


def better_start(rig: Rig, graph: Graph, at: Array, kept: NDArray[np.bool_]) -> Array | None:
    """Return a better minimum than that of a start, by rough weights; None if there is none, or no bound."""
    if _open_bases(rig, graph):
        return None
    problem = Isotropic.of(graph, at, np.full((graph.E, 2), ROUGH_SD**2), kept)
    return problem.globally(at)[2] if len(problem.others) else None


def _open_bases(rig: Rig, graph: Graph) -> list[str]:
    bases = {u for base in graph.base for u in np.unique(base).tolist() if u < graph.m}
    return [name for u, name in enumerate(graph.names) if u in bases and name not in (rig.known or {})]


def _distance(found: RigFit, at: Array, others: NDArray[np.intp]) -> float:
    xi = np.concatenate([logarithm(at[:, :3, :3] @ found.at[:, :3, :3].mT), at[:, :3, 3] - found.at[:, :3, 3]], axis=-1)
    of = np.repeat(np.isin(np.arange(found.graph.m), others), 6)
    S = found.covariance[np.ix_(of, of)]
    d2, rank, *_ = _solved(S, xi.reshape(-1)[of])
    return float(np.sqrt(max(d2, 0.0) / max(rank, 1)))


def _solved(S: Array, xi: Array) -> tuple[float, int]:
    unit = 1.0 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    values, vectors = np.linalg.eigh(S * np.outer(unit, unit))
    along, told = vectors.T @ (unit * xi), values > 1e-9 * values[-1]
    return float((along[told] ** 2 / values[told]).sum()), int(told.sum())


class Rows(NamedTuple):
    """Views that count: poses before X and W, weights, and the numbers of both."""

    G: Array  # (n, 4, 4)
    H: Array
    C: Array
    X: NDArray[np.intp]
    W: NDArray[np.intp]
    w_r: Array  # (n,)
    w_t: Array

    def of(self, some: NDArray[np.intp]) -> Rows:
        """Those of some views."""
        G, H, C, X, W, w_r, w_t = self
        return Rows(G[some], H[some], C[some], X[some], W[some], w_r[some], w_t[some])


@dataclass(frozen=True, eq=False)
class Isotropic:
    """Objective f of the module for the views that count."""

    graph: Graph
    rows: Rows
    others: NDArray[np.intp]  # numbers of the unknown poses, without bases

    @classmethod
    def of_fit(cls, found: RigFit) -> Isotropic:
        """Weigh each view by the mean variances of its rows."""
        graph = found.graph
        variances = np.ones((graph.E, 2))
        for part in found.rows:
            b, e = part.batch.edges.shape
            diagonal = (part.L**2).sum(axis=-1).reshape(b, e, 2, 3)
            variances[part.batch.edges] = np.maximum(diagonal.mean(axis=-1), 1e-24)
        poses = np.concatenate([found.pose_weights, [1.0]])
        return cls.of(
            graph, found.at, variances, found.edge_weights * poses[graph.side[0]] * poses[graph.side[1]] > 1e-3
        )

    @classmethod
    def of(cls, graph: Graph, at: Array, variances: Array, counts: NDArray[np.bool_]) -> Isotropic:
        """Build f by variances (E, 2) of rotation and translation, of the views that count, at the bases of a start."""
        T, G = np.concatenate([at, np.eye(4)[None]]), np.concatenate([graph.robot, np.eye(4)[None]])
        K = [(T[base] @ G[side])[counts] for base, side in zip(graph.base, graph.side, strict=True)]
        w_r, w_t = 0.5 / variances[counts, 0], 1.0 / variances[counts, 1]
        rows = Rows(K[0], K[1], graph.C[counts], graph.X[counts], graph.W[counts], w_r, w_t)
        return cls(graph, rows, np.unique(np.concatenate([rows.X, rows.W])))

    def globally(self, start: Array) -> tuple[Array, float, Array | None]:
        """Return the minimum next to a start, its relative gap, and a better minimum if the bound leads to one."""
        at, Q = self._minimum(start)
        value = float(Q[-1, -1])
        bound, towards = self._bound(at, Q)
        scale = max(value, 1e-6 * self.count)
        gap = max(0.0, (value - bound) / scale)
        if gap <= PROVEN:
            return at, gap, None
        other, Q = self._minimum(towards)
        return at, gap, other if Q[-1, -1] < value - 1e-6 * scale else None  # lower by more than rounding

    @property
    def count(self) -> int:
        """Number of rows."""
        return 6 * len(self.rows.X)

    def value(self, at: Array) -> float:
        """Value of f at poses (m, 4, 4), whose translations are replaced by the best ones."""
        return float(self.quadratic(at)[0][-1, -1])

    def quadratic(self, at: Array) -> tuple[Array, Array]:
        """Q (9k + 1, 9k + 1) about the rotations of (m, 4, 4), and the derivatives (3k, 9k + 1) of the translations."""
        k = len(self.others)
        size, shifts = 9 * k + 1, []
        Q, AA, AB = np.zeros((size, size)), np.zeros((3 * k, 3 * k)), np.zeros((3 * k, size))
        for rows, pair in self.parts:
            turns = (9 * pair[:, None] + np.arange(9)).reshape(-1)
            turn, moved, shift = _rows_of(rows, at)
            of = np.append(turns, size - 1)
            Q[np.ix_(of, of)] += turn.T @ turn
            translations, of = (3 * pair[:, None] + np.arange(3)).reshape(-1), np.append(turns[:9], size - 1)
            AA[np.ix_(translations, translations)] += moved.T @ moved
            AB[np.ix_(translations, of)] += moved.T @ shift
            shifts.append((translations, of, moved, shift))
        by = -np.linalg.lstsq(AA, AB, rcond=1e-12)[0]
        for translations, of, moved, shift in shifts:
            B = moved @ by[translations]
            B[:, of] += shift
            Q += B.T @ B
        return Q, np.asarray(by, dtype=float)

    @cached_property
    def parts(self) -> list[tuple[Rows, NDArray[np.intp]]]:
        """Views of the same camera and target, a thousand at once, and the places (2,) of the two among `others`."""
        both = np.searchsorted(self.others, np.stack([self.rows.X, self.rows.W], axis=-1))
        pairs, kind = np.unique(both, axis=0, return_inverse=True)
        found = []
        for k, pair in enumerate(pairs):
            edges = np.flatnonzero(kind.reshape(-1) == k)
            for start in range(0, len(edges), VIEWS_TOGETHER):
                some = edges[start : start + VIEWS_TOGETHER]
                found.append((self.rows.of(some), pair))
        return found

    def minimum(self, start: Array) -> Array:
        """Return the local minimum (m, 4, 4) next to rotations of a start."""
        return self._minimum(start)[0]

    def _minimum(self, start: Array) -> tuple[Array, Array]:
        """Local minimum and Q about it, by damped Gauss-Newton steps."""
        at, damping = start.copy(), 1e-9
        Q, by = self.quadratic(at)
        k = len(self.others)
        tangent = np.kron(np.eye(k), _generators())  # (9k, 3k)
        for _ in range(100):
            H, g = tangent.T @ Q[:-1, :-1] @ tangent, tangent.T @ Q[:-1, -1]
            step = -np.linalg.solve(H + damping * np.diag(np.diag(H)) + 1e-300, g)
            tried = at.copy()
            turn = Rotation.from_rotvec(step.reshape(k, 3)).as_matrix()
            tried[self.others, :3, :3] = nearest_rotation(at[self.others, :3, :3] @ turn)[0]
            Q_tried, by_tried = self.quadratic(tried)
            gain = Q[-1, -1] - Q_tried[-1, -1]
            if gain > 0:
                at, Q, by, damping = tried, Q_tried, by_tried, max(1e-9, 0.1 * damping)
            else:
                damping = max(10.0 * damping, 1e-6)
            if -g @ step < 1e-12 * Q[-1, -1] or damping > 1e8:
                break
        at[self.others, :3, 3] = by[:, -1].reshape(k, 3)
        return at, Q

    def _bound(self, at: Array, Q: Array) -> tuple[float, Array]:
        """A lower bound of f over all rotations, and rotations (m, 4, 4) that the bound leads to."""
        scale = max(float(Q[-1, -1]), 1e-6 * self.count)
        gamma, M = largest_bound(Q / scale)
        D = np.linalg.solve(M, np.eye(len(M))[-1])
        towards = at.copy()
        turned = np.eye(3) + (D[:-1] / D[-1]).reshape(-1, 3, 3)
        towards[self.others, :3, :3] = at[self.others, :3, :3] @ nearest_rotation(turned)[0]
        return scale * gamma, towards


def _rows_of(rows: Rows, at: Array) -> tuple[Array, Array, Array]:
    """Rows of n views of one camera and one target, times the roots of their weights.

    Those of the rotation (9n, 19) by both rotations and the residual; those of the translation by both translations
    (3n, 6), and by the rotation of the camera and the residual (3n, 10).
    """
    n = len(rows.X)
    R_X, R_W = at[rows.X, :3, :3], at[rows.W, :3, :3]
    left, right, R_C = rows.G[:, :3, :3] @ R_X, rows.H[:, :3, :3] @ R_W, rows.C[:, :3, :3]
    t_C = rows.C[:, :3, 3]
    turn = np.empty((n, 9, 19))
    turn[..., :9] = (left[:, :, None, :, None] * R_C.mT[:, None, :, None, :]).reshape(n, 9, 9)
    turn[..., 9:18] = -(right[:, :, None, :, None] * np.eye(3)[:, None, :]).reshape(n, 9, 9)
    turn[..., 18] = (left @ R_C - right).reshape(n, 9)
    turn *= np.sqrt(rows.w_r)[:, None, None]
    moved, shift, root = np.empty((n, 3, 6)), np.empty((n, 3, 10)), np.sqrt(rows.w_t)[:, None, None]
    moved[..., :3], moved[..., 3:] = root * rows.G[:, :3, :3], -root * rows.H[:, :3, :3]
    shift[..., :9] = (left[..., None] * t_C[:, None, None, :]).reshape(n, 3, 9)
    shift[..., 9] = (left @ t_C[..., None])[..., 0] + rows.G[:, :3, 3] - rows.H[:, :3, 3]
    shift *= root
    return turn.reshape(9 * n, 19), moved.reshape(3 * n, 6), shift.reshape(3 * n, 10)


def largest_bound(Q: Array) -> tuple[float, Array]:
    """Return the largest gamma, proven by a Cholesky factor, and its M; Q in units of the value at the minimum."""
    A, n = _constraints(), len(Q)
    m, q = (n - 1) // 9, len(_constraints())
    unit = 1.0 / np.sqrt(np.maximum(np.diag(Q), 1e-12 * np.diag(Q).max()))
    place = np.concatenate([np.arange(9 * m).reshape(m, 9), np.full((m, 1), n - 1)], axis=1)
    # R^T R = I three times, which is I in M
    eye = np.diag([*[1.0] * 9, 0.0])
    eye[[0, 4, 8], 9] = eye[9, [0, 4, 8]] = 1.0
    of_eye = np.linalg.lstsq(A.reshape(q, -1).T, eye.reshape(-1), rcond=None)[0]
    multipliers = np.tile(-0.1 * np.diag(Q)[:-1].mean() * of_eye, (m, 1))

    def matrix(gamma: float, multipliers: Array) -> Array:
        M = Q.copy()
        for a in range(m):
            M[np.ix_(place[a], place[a])] -= np.tensordot(multipliers[a], A, axes=1)
        M[-1, -1] -= gamma
        return M

    M = matrix(0.0, multipliers)
    gamma = float(M[-1, -1] - 2.0 * M[-1, :-1] @ np.linalg.solve(M[:-1, :-1], M[:-1, -1]) - 1e-3)
    best, t = (-np.inf, matrix(gamma, multipliers)), n / max(float(Q[-1, -1]) - gamma, 1e-3)
    for _ in range(400):
        M = matrix(gamma, multipliers)
        S = _inverse(M)
        g = np.append(-np.einsum("jpq,apq->aj", A, S[place[:, :, None], place[:, None, :]]).reshape(-1), t - S[-1, -1])
        H = _curvature(A, S, place)
        scaled = 1.0 / np.sqrt(np.diagonal(H))
        try:
            step = scaled * cho_solve(cho_factor(H * np.outer(scaled, scaled) + 1e-13 * np.eye(len(H))), scaled * g)
        except LinAlgError:  # far from a local minimum digits run out: the proven bound remains valid
            break
        decrement = max(float(g @ step), 0.0) ** 0.5
        share = 1.0
        if decrement > 0.5:
            change = matrix(0.0, step[:-1].reshape(m, q)) - Q
            change[-1, -1] -= step[-1]
            share = _longest(M, change)
        gamma, multipliers = gamma + share * float(step[-1]), multipliers + share * step[:-1].reshape(m, q)
        if decrement < 0.5:
            M = matrix(gamma, multipliers)
            if gamma > best[0] and _is_proven(M, unit):
                best = gamma, M
            if n / t < 1e-2 * PROVEN or decrement < 1e-12:
                break
            t *= 10.0
    return best


def _longest(M: Array, change: Array) -> float:
    """Share of a change up to which M stays positive definite, with some room."""
    root = np.linalg.inv(cholesky(M, lower=True))
    least = float(np.linalg.eigvalsh(root @ change @ root.T)[0])
    return 1.0 if least > -0.5 else -0.5 / least


def _inverse(M: Array) -> Array:
    """M^-1, scaled to a unit diagonal meanwhile."""
    unit = 1.0 / np.sqrt(np.diag(M))
    root = np.linalg.inv(cholesky(M * np.outer(unit, unit), lower=True)) * unit
    return np.asarray(root.T @ root)


def _is_proven(M: Array, unit: Array) -> bool:
    """Return whether M is positive semidefinite whatever the rounding of its Cholesky factor."""
    scaled = M / np.sqrt(np.outer(np.diag(M), np.diag(M))) if (np.diag(M) > 0).all() else None
    if scaled is None:
        return False
    n = len(M)
    try:
        cholesky(scaled - 2.0 * n * (n + 1) * np.finfo(float).eps * np.eye(n), lower=True)
    except LinAlgError:
        return False
    return True


def _curvature(A: Array, S: Array, place: NDArray[np.intp]) -> Array:
    """Matrix (m q + 1, m q + 1) of tr(S A_i S A_j) of all multipliers, and gamma last."""
    m, q = len(place), len(A)
    S_ab = S[place[:, None, :, None], place[None, :, None, :]]  # (m, m, 10, 10)
    left = np.einsum("ipq,abqr->abipr", A, S_ab, optimize=True).reshape(m, m, q, 100)
    right = np.einsum("jrs,abps->abjpr", A, S_ab, optimize=True).reshape(m, m, q, 100)
    H = np.empty((m * q + 1, m * q + 1))
    H[:-1, :-1] = (left @ right.mT).transpose(0, 2, 1, 3).reshape(m * q, m * q)
    s = S[place, -1]  # (m, 10)
    H[-1, :-1] = H[:-1, -1] = np.einsum("ap,jpq,aq->aj", s, A, s).reshape(-1)
    H[-1, -1] = S[-1, -1] ** 2
    return H


def _generators() -> Array:
    """(9, 3) derivatives of vec exp([w]x), row by row."""
    E = np.zeros((3, 3, 3))
    for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        E[k, i, j], E[k, j, i] = 1.0, -1.0
    return E.reshape(3, 9).T


@cache
def _constraints() -> Array:
    """(20, 10, 10) quadratic forms in (vec D, h) that vanish where ``h I + D`` is h times a rotation, D row by row."""

    def column(k: int) -> Array:
        """(3, 10) column k of h I + D."""
        found = np.zeros((3, 10))
        found[range(3), [3 * i + k for i in range(3)]] = 1.0
        found[k, 9] = 1.0
        return found

    def row(k: int) -> Array:
        found = np.zeros((3, 10))
        found[range(3), [3 * k + i for i in range(3)]] = 1.0
        found[k, 9] = 1.0
        return found

    h = np.zeros(10)
    h[9] = 1.0
    pairs = sorted(combinations_with_replacement(range(3), 2), key=lambda pair: pair[0] != pair[1])
    found = [of(i).T @ of(j) - (i == j) * np.outer(h, h) for of in (column, row) for i, j in pairs]
    del found[6]  # the trace of R^T R is that of R R^T
    for k in range(3):
        one, two, three = (column((k + s) % 3) for s in range(3))
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            found.append(np.outer(one[a], two[b]) - np.outer(one[b], two[a]) - np.outer(three[i], h))
    A = np.array([0.5 * (F + F.T) for F in found])
    # combinations without terms in h last: these weigh little compared with the others, and rounding must not mix them
    U = np.linalg.svd(A[:, -1, :9])[0]
    return np.asarray(np.tensordot(U.T, A, axes=1))
