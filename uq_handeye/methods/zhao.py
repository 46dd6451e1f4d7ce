r"""Zhao (2018): alternating linear programs on dual quaternions.

Minimises the sum of absolute values (L1) of the eight dual-quaternion residuals per pair (`lu`),

    f(X) = sum |E q|_1 + |F q + E q'|_1,     (q, q') the unit dual quaternion of X

The publication alternates linear programs to solve AX = YB in dual quaternions; what is in the open leaves its
residuals, its norm and AX = XB open. Chosen here: the L1 norm of the residuals above as they come, and from the X of
`lu` one linear program after another in the six errors ``xi = (theta, tau)`` of X,

    minimise  |r + J xi|_1   subject to  |xi|_inf <= trust  (rad and typical lengths)

with the trust region shrunk where a step does not lower f. A minimum generally is a vertex, where six residuals vanish
and the steps shrink quadratically. HiGHS solves the dual program, ``max r^T y - trust |J^T y|_1`` with ``|y| <= 1``:
six equations however many the pairs, so that time is about linear in N. Converged means that a step, or the trust
region, is below 1e-12 (in rad and typical lengths), or a step below 1.5e-8 where f no longer falls. The minimum is a
local one; it depends on the unit of length.

Covariance. X is no differentiable function of the data, so that it has no first-order sensitivities; but the
expectation of f is smooth. With residuals ``r ~ N(0, C)``, ``s_i^2 = C_ii``, and x_i the rows of J, least absolute
deviations obey in the limit of many pairs

    xi = -H^-1 sum x_i sign(r_i),    H = 2 sum p_i(0) x_i x_i^T,    p_i(0) = 1 / (sqrt(2 pi) s_i)
    Sigma_X = H^-1 ( sum_ij x_i x_j^T (2/pi) arcsin(C_ij / (s_i s_j)) ) H^-1

A residual that is better known than X lets through, ``s_i^2 < x_i^T Sigma_X x_i``, has no such density over the spread
of ``x_i^T xi``; in `lad_covariance`, that spread takes the place of s_i^2 in p_i(0) there. Sigma_X is then a fixed
point, and where a part of the residuals is nearly exact there may be two: one where these residuals hold X (exact
residuals would make X exact), one where the others outweigh them. `_solve_limited` comes down from above and finds the
larger, which is what sampled data show. The share of the information that such residuals carry tells how far the
limit may be trusted: `LimitedCovariance.share`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from ..core.geometry.checks import CHUNK
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array, perturb
from ..core.iterations import MAX_STEPS
from ..core.rounding import CHAIN_ROUNDING, EPS, HALF_DIGITS, SOLUTION_ROUNDING
from ..errors import InputError, NotConvergedError
from ..model.errors.models import PairNoise
from .dual_quaternions import LU
from .method import (
    Derivatives,
    ErrorFactors,
    Estimate,
    Functions,
    LimitedCovariance,
    Method,
    PoseFactors,
    published,
)
from .quaternions import Signs, axis_signs, dual_quaternions, left_matrix, quaternions, right_matrix

# Number of motions above which a linear program takes too long.
MAX_PAIRS_OF_PROGRAM = 50_000
# Number of residuals whose correlations are held at once.
ROWS = CHUNK // 8


class Residuals:
    """The residuals of motions A, B (N, 4, 4) as functions of X: ``q_A s - s q_B``, eight per pair."""

    def __init__(self, A: Array, B: Array, signs: Signs | None) -> None:
        self.poses = A, B
        self.duals = [dual_quaternions(T, q) for T, q in zip((A, B), quaternions(A, B, signs), strict=True)]
        self.system = _dual(left_matrix, self.duals[0]) - _dual(right_matrix, self.duals[1])  # (N, 8, 8)

    def at(self, X: Array) -> tuple[Array, Array]:
        """r (8N,) and J = dr / d xi (8N, 6)."""
        s = _dual_of(X)
        return (self.system @ s).reshape(-1), (self.system @ _by_errors(X, s)).reshape(-1, 6)

    def by_data(self, X: Array, pairs: slice) -> Array:
        """dr / d(xi_A, xi_B) (m, 8, 12) of some pairs."""
        s = _dual_of(X)
        a, b = (_by_errors(T[pairs], dual[pairs]) for T, dual in zip(self.poses, self.duals, strict=True))
        return np.concatenate([_dual(right_matrix, s) @ a, -_dual(left_matrix, s) @ b], axis=-1)


def _dual(matrix: Callable[[Array], Array], s: Array) -> Array:
    """The 8x8 matrix of multiplication by dual quaternions (..., 8) from one side."""
    M = np.zeros((*s.shape[:-1], 8, 8))
    M[..., :4, :4] = M[..., 4:, 4:] = matrix(s[..., :4])
    M[..., 4:, :4] = matrix(s[..., 4:])
    return M


def _dual_of(X: Array) -> Array:
    return dual_quaternions(X, Rotation.from_matrix(X[:3, :3], assume_valid=True).as_quat(scalar_first=True))


def _by_errors(T: Array, dual: Array) -> Array:
    """d (q, q') / d(theta, tau) (..., 8, 6): ``dq = theta q / 2``, ``dq' = (tau q + t dq) / 2``."""
    D = np.zeros((*dual.shape, 6))
    half = 0.5 * right_matrix(dual[..., :4])[..., 1:]
    t = np.concatenate([np.zeros((*dual.shape[:-1], 1)), T[..., :3, 3]], axis=-1)
    D[..., :4, :3] = D[..., 4:, 3:] = half
    D[..., 4:, :3] = 0.5 * left_matrix(t) @ half
    return D


def _by_linear_programs(A: Array, B: Array, noise: PairNoise | None) -> Estimate:
    if A.shape[1] > MAX_PAIRS_OF_PROGRAM:
        raise InputError(
            f"Expected at most {MAX_PAIRS_OF_PROGRAM} motions with method 'zhao', whose linear programs grow with "
            f"them; got {A.shape[1]}. Leave some out, or use another method."
        )
    start = LU.solver.estimate(A, B, None).X
    found = [_descend(Residuals(A[t], B[t], signs), start[t]) for t, signs in enumerate(_references(A, B))]
    X, converged, iterations = zip(*found, strict=True) if found else ((), (), ())
    return Estimate(np.array(X).reshape(-1, 4, 4), np.array(converged, dtype=bool), np.array(iterations, dtype=np.intp))


def _on_average(A: Array, B: Array, noise: PairNoise | None, X: Array) -> Callable[[slice], Derivatives]:
    if noise is None:
        raise InputError("Method 'zhao' has no derivatives but those of a noise model.")
    return lambda trials: Regression(A[trials], B[trials], X[trials], noise)


class Regression:
    """`Derivatives`: the part of the error of X that is linear in the errors of the data, for Gaussian noise.

    ``Cov(sign(r_i), z) = sqrt(2/pi) (dr_i/dz) / s_i`` for ``r_i = (dr_i/dz) z``. What it leaves out of
    `lad_covariance`, the ``arcsin(rho) - rho`` of the signs, is uncorrelated with the data.
    """

    def __init__(self, A: Array, B: Array, X: Array, noise: PairNoise) -> None:
        self.X = X
        self.residuals, self.scores = [], []
        for k, signs in enumerate(_references(A, B)):
            residuals = Residuals(A[k], B[k], signs)
            J = residuals.at(X[k])[1]
            rows = _independent_rows(residuals, X[k], noise)
            variance = np.einsum("mrk,mrk->mr", rows, rows)
            x = J.reshape(len(A[k]), 8, 6)
            scores = _independent_scores(x, _unit_rows(rows, variance))
            inverse = _solve_limited(J, variance.reshape(-1), scores).inverse
            seen = variance > SOLUTION_ROUNDING**2 * variance.max()
            weights = np.sqrt(2.0 / np.pi / np.where(seen, variance, np.inf))
            self.residuals.append(residuals)
            self.scores.append(-inverse @ x.mT * weights[:, None, :])  # (N, 6, 8)

    def block(self, A: Array, B: Array, pairs: slice) -> Array:
        found = [
            scores[pairs] @ residuals.by_data(X, pairs)
            for scores, residuals, X in zip(self.scores, self.residuals, self.X, strict=True)
        ]
        F = np.stack(found).reshape(len(self.X), -1, 6, 2, 6)
        return F.transpose(3, 2, 4, 0, 1)

    def weight(self, N: int) -> Array:
        return np.broadcast_to(np.eye(6), (len(self.X), 6, 6))


def _references(A: Array, B: Array) -> list[Signs | None]:
    signs = axis_signs(A, B)
    return [None] * len(A) if signs is None else [Signs(R) for R in signs.R]


def _descend(residuals: Residuals, X: Array, trust: float = 0.5) -> tuple[Array, bool, int]:
    """Solve linear programs from X until the step vanishes: X, whether it did, and how many there were."""
    r, J = residuals.at(X)
    value = np.abs(r).sum()
    # the length at which a translation is seen as well as a rotation
    unit = float(np.sqrt(np.sum(J[:, :3] ** 2) / np.sum(J[:, 3:] ** 2)))
    scale = np.repeat([1.0, unit], 3)
    rounding = EPS * float(np.abs(residuals.system).sum()) * (1.0 + float(np.abs(_dual_of(X)).max()))
    converged = False
    for count in range(1, MAX_STEPS + 1):
        step = _linear_program(r, J * scale, trust)
        if step is None:
            return X, False, count
        length = float(np.abs(step).max())
        moved = perturb(X, step * scale)
        r_moved, J_moved = residuals.at(moved)
        reached = float(np.abs(r_moved).sum())
        converged = length < SOLUTION_ROUNDING or (length < HALF_DIGITS and abs(value - reached) <= rounding)
        if reached <= value:
            X, r, J, value = moved, r_moved, J_moved, reached
        else:
            trust = 0.25 * min(length, trust)
        if converged:
            break
    return X, converged, count


def _linear_program(r: Array, J: Array, trust: float, highest_cost: float = 1e6) -> Array | None:
    """Return xi (6,) that minimises ``|r + J xi|_1`` with ``|xi|_inf <= trust``, or None without an optimum.

    The cost of the trust region has a limit, because a higher one is beyond the solver. It is reached where the
    residuals are tiny against the step.
    """
    from scipy.optimize import linprog  # slow to import

    size = float(np.abs(r).max())
    if size == 0.0:
        return np.zeros(6)
    column = np.abs(J).sum(axis=0)
    # y in [-1, 1], and the parts z >= 0 of J^T y that the trust region pays for; r and J in units of their own
    cost = np.concatenate([-r / size, np.tile(np.minimum(trust * column / size, highest_cost), 2)])
    equations = np.hstack([(J / column).T, -np.eye(6), np.eye(6)])
    bounds = [(-1.0, 1.0)] * len(r) + [(0.0, None)] * 12
    # the tightest tolerances that HiGHS accepts
    found = linprog(
        cost,
        A_eq=equations,
        b_eq=np.zeros(6),
        bounds=bounds,
        method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10, "presolve": False},
    )
    if found.status != 0:
        return None
    return np.asarray(found.eqlin.marginals * size / column)


def lad_covariance(A: Array, B: Array, X: Array, noise: PairNoise | ErrorFactors | PoseFactors) -> LimitedCovariance:
    """The covariance (6, 6) of X (4, 4) by least absolute deviations, as above.

    ``noise`` is a `PairNoise`, whose pairs are independent, in time linear in the pairs; or a function that for a slice
    of the pairs gives the factors ``d (xi_A, xi_B) / dz`` (m, 12, k) of their errors, z being k independent standard
    normal variables that all pairs may share, in quadratic time (64 arcsines per two pairs); or `PoseFactors`, with 64
    arcsines per two pairs that share a pose.

    Residuals without variance have no sign to vary, but hold X all the same; where they fix it, its variance is zero
    up to rounding.

    Raises
    ------
    NotConvergedError
        The limit of the densities has no fixed point: too few residuals determine X.
    """
    residuals = Residuals(A, B, *_references(A[None], B[None]))
    _, J = residuals.at(X)
    x = J.reshape(len(A), 8, 6)
    if isinstance(noise, PairNoise):
        rows = _independent_rows(residuals, X, noise)
        variance = np.einsum("mrk,mrk->mr", rows, rows)
        scores = _independent_scores(x, _unit_rows(rows, variance))
    elif isinstance(noise, PoseFactors):
        blocks = [slice(k, k + ROWS) for k in range(0, len(A), ROWS)]
        both = np.concatenate([residuals.by_data(X, pairs) @ noise.of(pairs) for pairs in blocks], axis=1)
        variance = np.einsum("smrk,smrk->mr", both, both)
        unit = np.stack([_unit_rows(rows, variance) for rows in both])
        scores = _independent_scores(x, np.concatenate(unit, axis=-1)) + _scores_across(x, unit, noise.pairs)
    else:
        blocks = [slice(k, k + ROWS // 8) for k in range(0, len(A), ROWS // 8)]
        rows = np.concatenate([residuals.by_data(X, pairs) @ noise(pairs) for pairs in blocks])
        variance = np.einsum("mrk,mrk->mr", rows, rows)
        scores = _shared_scores(J, _unit_rows(rows, variance).reshape(len(J), -1))
    return _solve_limited(J, variance.reshape(-1), scores)


def _independent_rows(residuals: Residuals, X: Array, noise: PairNoise) -> Array:
    """The factors (N, 8, 12) of the residuals of each pair by its own errors."""
    D = residuals.by_data(X, slice(None))
    factors = [np.zeros((6, 6)) if L is None else L for L in noise.factors]
    return np.concatenate([D[..., :6] @ factors[0], D[..., 6:] @ factors[1]], axis=-1)


def _unit_rows(rows: Array, variance: Array) -> Array:
    """Rows of length one, or zero where the variance is below rounding."""
    seen = variance > SOLUTION_ROUNDING**2 * variance.max()
    return np.asarray(rows / np.sqrt(np.where(seen, variance, np.inf))[..., None])


def _independent_scores(x: Array, rows: Array) -> Array:
    """``sum_ij x_i x_j^T (2/pi) arcsin(rho_ij)`` over the pairs of x (N, 8, 6), rows (N, 8, k) of length one."""
    signs = np.arcsin(np.clip(rows @ rows.mT, -1.0, 1.0))
    return np.asarray(2.0 / np.pi * np.einsum("mra,mrs,msb->ab", x, signs, x, optimize=True))


def _scores_across(x: Array, rows: Array, index: NDArray[np.intp]) -> Array:
    """The same over two different pairs that share one pose: x (N, 8, 6), rows (2, N, 8, k) by the one and the other.

    ``index`` (N, 2) holds the poses of each pair.
    """
    scores = np.zeros((6, 6))
    order = np.argsort(index.T.ravel(), kind="stable")
    bounds = np.searchsorted(index.T.ravel()[order], np.arange(index.max() + 2))
    for start, stop in pairwise(bounds):
        side, pair = np.divmod(order[start:stop], len(x))
        here, x_here = rows[side, pair], x[pair]
        own = np.arcsin(np.clip(here @ here.mT, -1.0, 1.0))
        scores -= np.einsum("mra,mrs,msb->ab", x_here, own, x_here, optimize=True) * (2.0 / np.pi)
        scores += _shared_scores(x_here.reshape(-1, 6), here.reshape(-1, here.shape[-1]))
    return scores


def _shared_scores(x: Array, rows: Array) -> Array:
    """The same over all two rows: x (n, 6), rows (n, k)."""
    scores = np.zeros((6, 6))
    for start in range(0, len(x), ROWS):
        signs = np.clip(rows[start : start + ROWS] @ rows[start:].T, -1.0, 1.0)
        part = x[start : start + ROWS].T @ np.arcsin(signs, out=signs)
        first = part[:, :ROWS] @ x[start : start + ROWS]
        rest = part[:, ROWS:] @ x[start + ROWS :]
        scores += 0.5 * (first + first.T) + rest + rest.T
    return np.asarray(2.0 / np.pi * scores)


def _solve_limited(x: Array, variance: Array, scores: Array, start: float = 100.0) -> LimitedCovariance:
    """Return ``H^-1 S H^-1``, the densities in H limited by the result.

    It is the largest fixed point, by iteration from above: ``start`` times the largest variance of a residual.
    """
    largest = float(variance.max())
    if largest == 0.0:
        return LimitedCovariance(np.zeros((6, 6)), np.zeros((6, 6)), 0.0)
    size = np.sqrt(np.mean(x**2, axis=0))
    x, scores = x / size, scores / np.outer(size, size)
    limited = np.full(len(x), start * largest)
    for _ in range(MAX_STEPS):
        weights = 2.0 / np.sqrt(2.0 * np.pi * limited)
        inverse = np.linalg.inv((x.T * weights) @ x)
        covariance = inverse @ scores @ inverse
        spread = np.einsum("ni,ij,nj->n", x, covariance, x)
        previous, limited = limited, np.maximum(np.maximum(variance, spread), EPS * largest)
        if (np.abs(limited - previous) <= CHAIN_ROUNDING * limited).all():
            break
    else:
        raise NotConvergedError(
            f"The covariance of method 'zhao' did not converge within {MAX_STEPS} iterations: too few residuals "
            "determine X. Add motions, or use another method."
        )
    # what is exact up to rounding does hold X
    better = (spread > variance) & (spread > EPS * largest)
    held = (x[better].T * weights[better]) @ x[better]
    share = float(eigh(held, (x.T * weights) @ x, eigvals_only=True)[-1])
    return LimitedCovariance(covariance / np.outer(size, size), inverse / np.outer(size, size), share)


METHOD = Method(
    **published("zhao"),
    solver=Functions(_by_linear_programs, _on_average),
    mathematics=__doc__,
    covariance=lad_covariance,
)
