r"""What most poses (or motions) agree on: a start that wrong detections do not spoil.

Model: most poses obey ``G X C = W`` (motions: ``A X = X B``) with Gaussian noise; the others, at most 40 %, hold
anything.

Random smallest subsets (3 poses, 2 motions), 4DPA on each; the subsets under which 60 % of the poses have the
smallest rotation and translation residuals (least quantile of squares, Rousseeuw, J. Am. Stat. Assoc. 79, 1984) are
improved on those 60 % (concentration steps of Rousseeuw and van Driessen, Data Min. Knowl. Disc. 12, 2006), and the one
with the smallest trimmed sum of squares is taken. Exact copies of a row fit each other, whatever X is: only the first
of them is looked at.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, gammaincinv

from ..errors import DegenerateMotionError
from ..geometry.checks import CHUNK
from ..geometry.nearest_rotation import orthonormalise
from ..geometry.se3 import Array, inverse, vee
from ..noise.models import Noise, PairNoise, PoseNoise, marginals
from ..procrustes.limit import solve_limit
from .constraint import Constraint, OnMotions, OnPoses, Unknowns
from .gauss_helmert import fit

# The 1 - 1e-6 quantile of chi-square(6).
NOTHING = float(chdtri(6, 1e-6))
# Share of the poses that the start relies on.
MAJORITY = 0.6
# Random subsets: with 40 % wrong poses 0.6^3 of them are clean, 65 on average, and fewer than 20 of them with a
# probability below 1e-9. Many clean ones matter, as a subset amplifies the noise of its poses.
SUBSETS = 300
# Subsets that are improved, and the steps of it.
BEST, CONCENTRATION = 10, 3
# A subset determines X if M of 4DPA (T2) has eigenvalues (rad^2) above this, and above this share of the largest.
LITTLE_ROTATION, ONE_AXIS = 1e-8, 1e-4


class Consensus(NamedTuple):
    """What most poses agree on."""

    unknowns: Unknowns
    inside: Array  # (n,) 1 for the poses that it was fitted to, else 0
    noise: Noise  # as given, or isotropic with robust scales of the residuals
    subsets: int  # tried


def consensus(constraint: Constraint, noise: Noise | None, seed: int | np.random.Generator) -> Consensus:
    """X and W that at least 60 % of the poses fit best; raises `DegenerateMotionError` if no subset determines X."""
    first, copy_of = _distinct(constraint)
    if len(first) < len(copy_of):
        rows = replace(constraint, first=constraint.first[first], second=constraint.second[first])
        found = consensus(rows, None if noise is None else _independent(noise).rows(first), seed)
        return found._replace(inside=found.inside[copy_of], noise=found.noise if noise is None else noise)
    n = constraint.first.shape[-3]
    on_poses = isinstance(constraint, OnPoses)
    majority = min(n, max(4 if on_poses else 3, int(np.ceil(MAJORITY * n))))
    hypotheses = _hypotheses(constraint, np.random.default_rng(seed))
    squares, scales = _misfits(constraint, hypotheses, majority)
    order = np.argsort(np.log(scales).sum(axis=-1), kind="stable")[:BEST]
    metric = _isotropic(scales[order[0]] / 3.0, on_poses) if noise is None else _independent(noise)
    best: tuple[float, Unknowns, Array] | None = None
    for k in order:
        at = Unknowns(hypotheses.X[k], None if hypotheses.W is None else hypotheses.W[k])
        inside = _smallest((misfit(constraint, at) / scales[k]).sum(axis=-1), majority)
        try:
            for _ in range(CONCENTRATION):
                step = fit(constraint, metric, at, 1, inside)
                d2 = (step.white[0] ** 2).sum(axis=-1)
                at, inside = step.unknowns, _smallest(d2, majority)
        except DegenerateMotionError:
            continue  # those 60 % do not determine X
        trimmed = float(d2 @ inside)
        if best is None or trimmed < best[0]:
            best = trimmed, at, inside
    if best is None:  # only few poses turn enough: rely on the best subset
        k = int(order[0])
        at = Unknowns(hypotheses.X[k], None if hypotheses.W is None else hypotheses.W[k])
        best = 0.0, at, np.ones(n)
    _, at, inside = best
    if noise is None:
        squares = misfit(constraint, at)
        noise = _isotropic(np.array([robust_variance(column, 3) for column in squares.T]), on_poses)
    return Consensus(at, inside, noise, len(hypotheses.X))


def _distinct(constraint: Constraint) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The rows that are no copies of one before, and for each of the n rows which of them it equals."""
    both = np.stack([constraint.first[:, :3], constraint.second[:, :3]], axis=1).reshape(-1, 24)
    order = np.lexsort(both.T)
    new = np.append(True, (both[order[1:]] != both[order[:-1]]).any(axis=1))
    number = np.empty(len(both), dtype=np.intp)
    number[order] = np.cumsum(new) - 1
    first = np.full(int(new.sum()), len(both))
    np.minimum.at(first, number, np.arange(len(both)))
    rank = np.argsort(np.argsort(first))
    return np.sort(first), rank[number]


def _hypotheses(constraint: Constraint, rng: np.random.Generator) -> Unknowns:
    """X (T, 4, 4) and W of smallest subsets, without those that do not determine X."""
    on_poses = isinstance(constraint, OnPoses)
    n, size = constraint.first.shape[-3], 3 if on_poses else 2
    if n < size:
        raise DegenerateMotionError(
            f"Only {n} of the rows differ: {size} different {'poses' if on_poses else 'motions'} are needed.",
            np.eye(6),
        )
    few = n <= (13 if on_poses else 25)  # no more than about SUBSETS subsets in all
    if few:
        index = np.array(list(combinations(range(n), size)))
    else:
        index = rng.integers(n, size=(2 * SUBSETS, size))
        index = np.sort(index, axis=1)
        index = index[(np.diff(index, axis=1) > 0).all(axis=1)][:SUBSETS]
    first, second = constraint.first[index], constraint.second[index]
    if isinstance(constraint, OnPoses):
        G = inverse(first) if constraint.inverted else first
        i, j = np.array([0, 0, 1]), np.array([1, 2, 2])
        A, B = inverse(G[:, j]) @ G[:, i], second[:, j] @ inverse(second[:, i])
    else:
        A, B = first, second
    usable = _determined(A, B)
    if not usable.any():
        solve_limit(*_all_motions(constraint))  # raises and says why, if all together do not determine X either
        raise DegenerateMotionError(
            f"No {size} {'poses' if on_poses else 'motions'} determine X by themselves, so that wrong ones "
            "cannot be told from good ones. Turn the robot about two different axes, by 30 degrees and more.",
            np.eye(6),
        )
    X = solve_limit(A[usable], B[usable])
    if not on_poses:
        return Unknowns(X, None)
    measured = G[usable] @ X[:, None] @ second[usable]
    W = measured.mean(axis=1)
    W[:, :3, :3] = orthonormalise(W[:, :3, :3])
    return Unknowns(X, W)


def _all_motions(constraint: Constraint) -> tuple[Array, Array]:
    """Motions from the first pose to each other one."""
    if isinstance(constraint, OnMotions):
        return constraint.first, constraint.second
    G, C = inverse(constraint.first) if constraint.inverted else constraint.first, constraint.second
    return inverse(G[1:]) @ G[:1], C[1:] @ inverse(C[:1])


def _determined(A: Array, B: Array) -> NDArray[np.bool_]:
    """Whether the motions (T, m, 4, 4) of each subset turn about two axes, by the eigenvalues of M (T2)."""
    H = (0.25 * vee(A[..., :3, :3])).mT @ vee(B[..., :3, :3])
    U, s, Vt = np.linalg.svd(H)
    s[..., 2] *= np.linalg.det(U @ Vt)
    smallest, largest = s[..., 1] + s[..., 2], s[..., 0] + s[..., 1]
    return np.asarray((smallest > LITTLE_ROTATION) & (smallest > ONE_AXIS * largest))


def misfit(constraint: Constraint, at: Unknowns) -> Array:
    """Squared lengths (..., n, 2) of the rotation residual (chord, rad^2) and the translation residual."""
    X = at.X[..., None, :, :]
    if isinstance(constraint, OnPoses):
        assert at.W is not None
        G = inverse(constraint.first) if constraint.inverted else constraint.first
        D = G @ X @ constraint.second - at.W[..., None, :, :]
    else:
        D = constraint.first @ X - X @ constraint.second
    rotation = 0.5 * (D[..., :3, :3] ** 2).sum(axis=(-2, -1))
    return np.stack([rotation, (D[..., :3, 3] ** 2).sum(axis=-1)], axis=-1)


def _misfits(constraint: Constraint, at: Unknowns, majority: int) -> tuple[Array, Array]:
    """`misfit` of the last hypotheses, and of all (T, 2) the value that the majority of the poses stays below."""
    T, n = len(at.X), constraint.first.shape[-3]
    scales = np.empty((T, 2))
    step = max(1, CHUNK // n)
    for k in range(0, T, step):
        part = slice(k, k + step)
        squares = misfit(constraint, Unknowns(at.X[part], None if at.W is None else at.W[part]))
        scales[part] = np.partition(squares, majority - 1, axis=-2)[..., majority - 1, :]
    return squares, np.maximum(scales, 1e-24)


def _smallest(values: Array, count: int) -> Array:
    """1 for that many smallest of the values (n,), else 0."""
    result = np.zeros(len(values))
    result[np.argpartition(values, count - 1)[:count]] = 1.0
    return result


def _isotropic(variances: Array, on_poses: bool) -> Noise:
    """Noise (rotation, translation) of the residuals, put on the camera; below 1e-12 rad or m nothing is told apart."""
    S = np.diag(np.repeat(np.maximum(variances, 1e-24), 3))
    return PoseNoise(camera=S) if on_poses else PairNoise(B=S)


def _independent(noise: Noise) -> Noise:
    """Without correlations between poses."""
    if isinstance(noise, PairNoise):
        return noise
    robot, camera = (None if S is None else marginals(S) for S in (noise.robot, noise.camera))
    return PoseNoise(robot, camera)


def robust_variance(squares: Array, freedom: int) -> float:
    """Robust variance per axis of squared lengths (n,) of Gaussian vectors: their median, without the gross ones."""
    middle, gross = (2.0 * float(gammaincinv(0.5 * freedom, q)) for q in (0.5, 1.0 - 1e-6))
    variance = float(np.median(squares)) / middle
    for _ in range(20):
        smaller = float(np.median(squares[squares <= gross * variance])) / middle
        if smaller == variance:
            break
        variance = smaller
    return variance
