r"""Consensus of most poses (or motions): a start that outliers do not affect.

Model: most poses obey ``G X C = W`` (motions: ``A X = X B``) with Gaussian noise; the others, at most 40 %, may be
arbitrary; or half of them, if the good half stands out.

4DPA is solved on smallest subsets (3 poses, 2 motions); the subsets under which 60 % of the poses have the smallest
rotation and translation residuals (least quantile of squares, Rousseeuw, J. Am. Stat. Assoc. 79, 1984) are improved on
those 60 % (concentration steps of Rousseeuw and van Driessen, Data Min. Knowl. Disc. 12, 2006), and the one with the
smallest trimmed sum of squares is taken. Exact copies of a row fit each other, whatever X is: only the first of them
is used.

The result depends neither on the order of the rows nor on the choice of the frames. The subsets are drawn from rows
sorted by numbers that no choice of frames changes (`_canonical_order`), and translation residuals are measured at a
point of the target that the data define, not at the origin of its frame: the point that moves least in the camera
frame (`poses.target_views`), near the point at which the cameras look.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from ...core.geometry.checks import CHUNK
from ...core.geometry.se3 import Array, skew, vee
from ...core.levels import IMPOSSIBLE
from ...core.limits import MAJORITY
from ...core.rounding import SOLUTION_ROUNDING
from ...errors import DegenerateMotionError
from ...methods.limit import solve_limit
from ...model.errors.models import Noise, PoseNoise, marginals
from ...model.errors.square_roots import cholesky_of, gram, whiten
from ...model.poses.target_views import pivot_of
from .constraint import MIN_RESOLVED_SHARE, Constraint, Unknowns, covariances_of, residual_covariance

# The squared distance from which on a pose has no weight: chi-square(6) of a good one exceeds it once in a million.
NO_WEIGHT = IMPOSSIBLE.chi_square(6)
# The least share that is relied on, where the squares of its residuals, rotation times translation, are smaller than
# those of the majority by this factor: of good rows they are 1.5 times as small, and others are not as alike.
HALF, HALF_RATIO, MIN_POSES_FOR_HALF = 0.5, 30.0, 12
# Number of random subsets. With 40 % outliers 0.6^3 of them are clean, 65 on average, and fewer than 20 of them with
# a probability below 1e-9. Many clean ones matter, as a subset amplifies the noise of its poses.
N_SUBSETS = 300


class Consensus(NamedTuple):
    """Estimate that most poses agree on."""

    unknowns: Unknowns
    inside: Array  # (n,) 1 for the poses that it was fitted to, else 0
    noise: Noise  # as given, or isotropic about the pivot with robust scales of the residuals
    half: bool = False  # only half of the poses was relied on


def consensus(constraint: Constraint, noise: Noise | None, seed: int | np.random.Generator) -> Consensus:
    """X and W that at least 60 % of the poses fit best; raises `DegenerateMotionError` if no subset determines X."""
    first, copy_of = _distinct(constraint)
    if len(first) < len(copy_of):
        found = consensus(constraint.rows(first), None if noise is None else _drop_joint(noise).rows(first), seed)
        return found._replace(inside=found.inside[copy_of], noise=found.noise.rows(copy_of) if noise is None else noise)
    majority, half = (
        min(constraint.n, max(constraint.fewest + 1, int(np.ceil(share * constraint.n)))) for share in (MAJORITY, HALF)
    )
    pivot = pivot_of(constraint.second) if constraint.item == "pose" else None
    pivoted = constraint if pivot is None else replace(constraint, second=_move_origin(constraint.second, pivot))
    hypotheses = _hypotheses(pivoted, np.random.default_rng(seed))
    scales, of_half = _scales(pivoted, hypotheses, (majority, half))
    if by_half := constraint.n >= MIN_POSES_FOR_HALF and _stands_out(of_half, scales):
        scales, majority = of_half, half
    order = np.argsort(np.log(scales).sum(axis=-1), kind="stable")[: N_SUBSETS // 30]
    best = Unknowns(hypotheses.X[order], None if hypotheses.W is None else hypotheses.W[order])
    squares = misfit(pivoted, best)
    inside = _smallest((squares / scales[order, None]).sum(axis=-1), majority)
    if noise is None:
        improved = _concentrate(pivoted, _isotropic(scales[order[0]] / 3.0, pivoted), best, inside)
    else:
        given = best if pivot is None else _back_to_origin(best, pivot)
        improved = _concentrate(constraint, _drop_joint(noise), given, inside)
    if improved is None:  # only few poses turn enough: rely on the best subset
        at, kept = Unknowns(best.X[0], None if best.W is None else best.W[0]), np.ones(constraint.n)
    else:
        at, kept = improved
    if noise is not None:
        moved = pivot is not None and improved is None
        return Consensus(_back_to_origin(at, pivot) if moved else at, kept, noise, by_half)
    noise = _isotropic(_variances(misfit(pivoted, at)), pivoted)
    if pivot is None:
        return Consensus(at, kept, noise, by_half)
    lever = np.broadcast_to(np.eye(6), (constraint.n, 6, 6)).copy()  # of errors about the pivot to those at the origin
    lever[:, 3:, :3] = skew(constraint.second[:, :3, :3] @ pivot)
    noise = PoseNoise(camera=lever @ np.asarray(covariances_of(noise)[1]) @ lever.mT)
    return Consensus(_back_to_origin(at, pivot), kept, noise, by_half)


def residual_noise(constraint: Constraint, at: Unknowns) -> Noise:
    """Isotropic noise with robust scales of the residuals, put on the camera."""
    return _isotropic(_variances(misfit(constraint, at)), constraint)


def _distinct(constraint: Constraint) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The rows that are no copies of one before, and for each of the n rows which of them it equals."""
    both = np.stack([constraint.first[:, :3], constraint.second[:, :3]], axis=1).reshape(-1, 24)
    _, first, number = np.unique(both, axis=0, return_index=True, return_inverse=True)
    return np.sort(first), np.argsort(np.argsort(first))[number.reshape(-1)]


def _canonical_order(constraint: Constraint) -> NDArray[np.intp]:
    """An order of the rows that depends neither on the order given nor on the frames.

    By ``sum_j tr(R_i^T R_j)`` of poses and ``tr R_i`` of motions, which no rigid change of a frame on either side
    alters; robot and camera together, so that symmetric robot poses do not tie.
    """
    keys = np.zeros(constraint.n)
    for T, share in ((constraint.first, 1.0), (constraint.second, np.sqrt(2.0))):
        R = T[:, :3, :3]
        other = R.mean(axis=0) if constraint.item == "pose" else np.eye(3)
        keys += share * (R * other).sum(axis=(1, 2))
    return np.argsort(keys, kind="stable")


def _move_origin(T: Array, point: Array) -> Array:
    """Poses (..., 4, 4) of a frame with its origin moved to a point (3,) of it."""
    moved = T.copy()
    moved[..., :3, 3] += T[..., :3, :3] @ point
    return moved


def _back_to_origin(at: Unknowns, pivot: Array | None) -> Unknowns:
    return at if pivot is None or at.W is None else Unknowns(at.X, _move_origin(at.W, -pivot))


@cache
def _all_subsets(n: int, size: int) -> NDArray[np.intp]:
    return np.array(list(combinations(range(n), size)), dtype=np.intp)


def _hypotheses(constraint: Constraint, rng: np.random.Generator) -> Unknowns:
    """X (T, 4, 4) and W of smallest subsets, without those that do not determine X."""
    n, size = constraint.n, constraint.fewest
    if n < size:
        raise DegenerateMotionError(
            f"Only {n} of the rows differ: {size} different {constraint.item}s are needed.", np.eye(6)
        )
    if n <= (13 if size == 3 else 25):  # no more than about N_SUBSETS subsets in all
        index = _all_subsets(n, size)
    else:
        index = rng.integers(n, size=(2 * N_SUBSETS, size))
        index = np.sort(index, axis=1)
        index = index[(index[:, 1:] > index[:, :-1]).all(axis=1)][:N_SUBSETS]
    subsets = constraint.rows(_canonical_order(constraint)[index])
    A, B = subsets.motions()
    usable = determined(A, B)
    if not usable.any():
        i, j = (np.zeros(n - 1, dtype=np.intp), np.arange(1, n))
        every = constraint.rows(np.stack([i, j], axis=1)) if constraint.item == "pose" else constraint
        solve_limit(*(T.reshape(-1, 4, 4) for T in every.motions()))  # raises where all together do not determine X
        raise DegenerateMotionError(
            f"No {size} {constraint.item}s determine X by themselves, so outliers cannot be identified. Rotate the "
            "robot about two different axes, by 30 degrees and more.",
            np.eye(6),
        )
    if usable.all():
        return subsets.complete(solve_limit(A, B))
    chosen = replace(subsets, first=subsets.first[usable], second=subsets.second[usable])
    return chosen.complete(solve_limit(A[usable], B[usable]))


def determined(A: Array, B: Array) -> NDArray[np.bool_]:
    """Return whether the motions (T, m, 4, 4) of each subset rotate about two axes.

    The smallest eigenvalue of M of 4DPA (T2, rad^2) must be above `MIN_RESOLVED_SHARE` of the largest one, or of that
    share itself where the robot hardly rotates.
    """
    H = (0.25 * vee(A[..., :3, :3])).mT @ vee(B[..., :3, :3])
    s = np.linalg.svd(H, compute_uv=False)
    sign = np.sign(np.linalg.det(H))
    smallest, largest = s[..., 1] + sign * s[..., 2], s[..., 0] + s[..., 1]
    return np.asarray(smallest > MIN_RESOLVED_SHARE * np.maximum(largest, MIN_RESOLVED_SHARE))


def misfit(constraint: Constraint, at: Unknowns) -> Array:
    """Squared lengths (..., n, 2) of the rotation residual (chord, rad^2) and the translation residual."""
    return np.moveaxis(_misfits(constraint.closure(), at), 0, -1)


def _misfits(closure: tuple[Array, Array], at: Unknowns) -> Array:
    """(2, ..., n) for unknowns (..., 4, 4), by one product for all of them."""
    by_X, constant = closure
    D = at.X[..., :3, :].reshape(-1, 12) @ by_X.reshape(-1, 12).T
    D = D.reshape(*at.X.shape[:-2], *constant.shape)
    D += constant
    if at.W is not None:
        D -= at.W[..., None, :3, :]
    D *= D
    columns = D.sum(axis=-2)
    return np.stack([0.5 * columns[..., :3].sum(axis=-1), columns[..., 3]])


def _scales(constraint: Constraint, at: Unknowns, counts: Sequence[int]) -> Array:
    """Return the `misfit` of all hypotheses (len(counts), T, 2) that so many of the poses stay below."""
    T, closure, ranks = len(at.X), constraint.closure(), [count - 1 for count in counts]
    scales = np.empty((len(ranks), T, 2))
    step = max(1, CHUNK // constraint.n)
    for k in range(0, T, step):
        part = slice(k, k + step)
        squares = _misfits(closure, Unknowns(at.X[part], None if at.W is None else at.W[part]))
        scales[:, part] = np.partition(squares, ranks, axis=-1)[..., ranks].T
    return np.maximum(scales, 1e-24)


def _stands_out(of_half: Array, of_majority: Array) -> bool:
    """Return whether half of the rows agree far better with one hypothesis (T, 2) than the majority with any."""
    half, most = (float(np.log(scales).sum(axis=-1).min()) for scales in (of_half, of_majority))
    return half < most - float(np.log(HALF_RATIO))


def _smallest(values: Array, count: int) -> Array:
    """1 for that many smallest of the values (..., n), else 0."""
    result = np.zeros(values.shape)
    np.put_along_axis(result, np.argpartition(values, count - 1, axis=-1)[..., :count], 1.0, axis=-1)
    return result


def _concentrate(
    constraint: Constraint, noise: Noise, at: Unknowns, inside: Array, rows_together: int = 20_000
) -> tuple[Unknowns, Array] | None:
    """The best of the unknowns (k, 4, 4), each fitted to the rows inside (k, n) and those chosen again, in turn.

    So many rows are held at once, of as many of the unknowns; None where no set of rows inside determines X.
    """
    together, found = max(1, rows_together // constraint.n), []
    for start in range(0, len(at.X), together):
        part = slice(start, start + together)
        some = Unknowns(at.X[part], None if at.W is None else at.W[part])
        if (one := _concentrated(constraint, noise, some, inside[part])) is not None:
            found.append(one)
    return min(found, key=lambda one: one[0])[1:] if found else None


def _concentrated(
    constraint: Constraint, noise: Noise, at: Unknowns, inside: Array
) -> tuple[float, Unknowns, Array] | None:
    """`_concentrate` of some unknowns, with the squares that the best leaves; the model is linearised once."""
    linear = constraint.linearise(at, constraint.first, constraint.second)
    S = np.asarray(residual_covariance(linear.sides, noise))
    white = whiten(cholesky_of(S), np.concatenate([linear.J, linear.r[..., None]], axis=-1))
    majority = int(inside[0].sum())
    for _ in range(3):
        sums = gram(white * inside[..., None, None])
        unit = 1.0 / np.sqrt(np.maximum(np.diagonal(sums[..., :-1, :-1], axis1=-2, axis2=-1), 1e-300))
        values, vectors = np.linalg.eigh(sums[..., :-1, :-1] * unit[..., :, None] * unit[..., None, :])
        usable = values[..., 0] > SOLUTION_ROUNDING
        if not usable.any():
            return None
        if not usable.all():
            at = Unknowns(at.X[usable], None if at.W is None else at.W[usable])
            white, inside, sums, unit, values, vectors = (
                part[usable] for part in (white, inside, sums, unit, values, vectors)
            )
        load = vectors.mT @ (unit[..., None] * sums[..., :-1, -1:])
        step = -unit[..., None] * (vectors @ (load / values[..., None]))
        residual = white[..., -1] + (white[..., :-1] @ step[..., None, :, :])[..., 0]
        d2 = (residual * residual).sum(axis=-1)
        inside = _smallest(d2, majority)
    left = (d2 * inside).sum(axis=-1)
    k = int(np.argmin(left))
    best = Unknowns(at.X[k], None if at.W is None else at.W[k])
    return float(left[k]), best.moved(step[k, :, 0]), inside[k]


def _isotropic(variances: Array, constraint: Constraint) -> Noise:
    """Noise (rotation, translation) of the residuals, put on the camera; below 1e-12 rad or m nothing is separated."""
    S = np.diag(np.repeat(np.maximum(variances, 1e-24), 3))
    return constraint.noise(None, S)


def _drop_joint(noise: Noise) -> Noise:
    """Without correlations between poses."""
    first, second = (None if S is None else marginals(S) for S in covariances_of(noise))
    return type(noise)(first, second)


def _variances(squares: Array) -> Array:
    """Robust variances per axis (2,) of `misfit` (n, 2)."""
    return np.array([robust_variance(column, 3) for column in squares.T])


def robust_variance(squares: Array, freedom: int) -> float:
    """Robust variance per axis of squared lengths (n,) of Gaussian vectors: their median, without the gross ones."""
    middle, gross = _levels(freedom)
    ordered = np.sort(squares)
    count = 0
    while count != len(ordered):  # poses once left out stay out, so that the count falls until it no longer changes
        count = len(ordered)
        variance = 0.5 * float(ordered[(count - 1) // 2] + ordered[count // 2]) / middle
        ordered = ordered[: np.searchsorted(ordered, gross * variance, side="right")]
    return variance


@cache
def _levels(freedom: int) -> tuple[float, float]:
    """The median and the 1 - 1e-6 quantile of chi-square."""
    middle, gross = (2.0 * float(gammaincinv(0.5 * freedom, q)) for q in (0.5, 1.0 - 1e-6))
    return middle, gross
