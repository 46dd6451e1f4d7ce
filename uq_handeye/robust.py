r"""Estimates that wrong detections do not spoil: a consensus start, redescending weights, and a flag for every pose.

Model: most poses (or motions) obey ``G X C = W`` (``A X = X B``) with the Gaussian noise of `likelihood`; the others,
at most 40 %, hold anything. Frames, units and residuals are those of `constraint` (rad, m).

*Distance.* How far a pose lies from where the others predict it. With the residual e of pose i after the fit, whitened
by its own covariance ``S_i = L L^T``, its hat block ``H = L^-1 J P J^T L^-T`` (P the covariance of the unknowns) and
its weight w in that fit, the residual predicted *without* pose i and its covariance are, exactly for a linear model,

    (I - w H)^-1 e,    (I + (1 - w) H) (I - w H)^-1,    d^2 = e^T ((I + (1 - w) H) (I - w H))^-1 e

chi-square with 6 degrees of freedom if the pose is good (for w = 1: ``e^T (I - H)^-1 e``). With errors that are
correlated over the poses (T4b) the prediction uses the errors of the others too: with ``M = S^-1 - S^-1 J P J^T S^-1``
the predicted residual is ``M_ii^-1 (S^-1 r)_i`` with covariance ``M_ii^-1`` (S with the block of pose i divided by w,
which is taken back from that covariance). A direction in which no other pose can predict pose i does not count.

*Weight.* 1 up to ``d^2 = a``, the 99.9 % quantile of chi-square(6); from there linearly down to 0 at b, its 1 - 1e-6
quantile. Iteratively reweighted least squares: each step is the one of `likelihood.fit`. d^2 does not depend on the
pose's own weight but through the linearisation, so that the iteration settles at once. Where the noise comes from the
residuals too, a and b are those quantiles of ``6 F(6, m/2)``, with one factor for both, that of 99.9 %: of the
``m = 6 n - p`` degrees of freedom, half tell the noise of rotation and half that of translation.

*Start.* Random smallest subsets (3 poses, 2 motions), 4DPA on each; the subsets under which 60 % of the poses have the
smallest rotation and translation residuals (least quantile of squares, Rousseeuw, J. Am. Stat. Assoc. 79, 1984) are
improved on those 60 % (concentration steps of Rousseeuw and van Driessen, Data Min. Knowl. Disc. 12, 2006), and the one
with the smallest trimmed sum of squares is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import betaincinv, fdtri, gammaincinv

from .constraint import OnMotions, OnPoses, Unknowns, constraint_of
from .errors import DegenerateMotionError, InputError, NotConvergedError
from .likelihood import MOST_STEPS, Fit, cholesky_of, fit, weighted
from .motions import Motions
from .noise import Noise, PairNoise, PoseNoise, marginals
from .poses import PosePairs
from .procrustes import orthonormalise, solve_limit
from .se3 import CHUNK, Array, inverse, vee

# Quantiles of chi-square(6): 99.9 %, below which a pose counts in full, and 1 - 1e-6, above which not at all.
FULL, NOTHING = 22.457744, 38.258336
# Share of the poses that the start relies on.
MAJORITY = 0.6
# Random subsets: with 40 % wrong poses 0.6^3 of them are clean, 65 on average, and fewer than 20 of them with a
# probability below 1e-9. Many clean ones matter, as a subset amplifies the noise of its poses.
SUBSETS = 300
# Subsets that are improved, and the steps of it.
BEST, CONCENTRATION = 10, 3
# A subset determines X if M of 4DPA (T2) has eigenvalues (rad^2) above this, and above this share of the largest.
LITTLE_ROTATION, ONE_AXIS = 1e-8, 1e-4
# Weights stand still below this change; and the largest number of steps.
STILL, MOST_REWEIGHTED = 1e-6, 100
# Steps before the scale is held and the weights are damped.
FREE = 10
# Rounds of noise from the residuals and weights from the noise.
MOST_ROUNDS = 20

Estimator = Callable[[PosePairs | Motions, Array, Array], Noise | None]


@dataclass(frozen=True, eq=False)
class RobustFit:
    """The fit and what became of each of the n poses (or motions)."""

    fit: Fit
    noise: Noise  # given or estimated
    weights: Array  # (n,) in [0, 1]
    distances: Array  # (n,) d^2, chi-square(6) for good poses and true noise
    leverage: Array  # (n,) share of each pose in the estimate; the sum is 1
    flags: tuple[str, ...]  # "kept", "downweighted (0.40)" or "rejected"
    scale: float  # the noise of most poses is so many times the one given; 1 unless it is surely larger
    limit: float  # poses with d^2 above it are flagged
    subsets: int  # that were tried for the start

    @property
    def rejected(self) -> NDArray[np.intp]:
        """Rows with weight 0."""
        return np.flatnonzero(self.weights == 0)


def pose_distances(fit: Fit) -> tuple[Array, Array]:
    """d^2 of each pose, predicted without it, and its leverage; see the module.

    Returns
    -------
    distances : (..., n)
        Chi-square with 6 degrees of freedom for good poses, if the noise is true.
    leverage : (..., n)
        ``w tr(H) / p``: the share of the pose in the information on the p unknowns. The sum over the poses is 1.
    """
    n, p = fit.residual.shape[-2], fit.covariance.shape[-1]
    weights = np.ones(fit.residual.shape[:-1]) if fit.weights is None else fit.weights
    P = fit.covariance[..., None, :, :]
    if fit.S.shape[-1] == 6:
        e, J = fit.white
        h, V = np.linalg.eigh(J @ P @ J.mT)
        along = (V.mT @ e[..., None])[..., 0]
        w = weights[..., None]
        left = 1.0 - w * h
        variance = (1.0 + (1.0 - w) * h) * left
        leverage = weights * h.sum(axis=-1) / p
        squares = np.where(left > 1e-9, along**2 / np.where(left > 1e-9, variance, 1.0), 0.0)
        return np.asarray(squares.sum(axis=-1)), leverage
    w = np.maximum(weights, 1e-12)[..., None]  # as `weighted` does
    half = np.asarray(solve_triangular(cholesky_of(weighted(fit.S, weights)), np.eye(6 * n), lower=True))
    columns = half.reshape(*half.shape[:-1], n, 6)
    own = np.moveaxis(columns, -2, -3)  # L^-1 by the columns of pose i: (..., n, 6n, 6)
    Q = own.mT @ (half @ fit.linear.J.reshape(*fit.linear.J.shape[:-3], 6 * n, p))[..., None, :, :]
    pull = own.mT @ (half @ fit.residual.reshape(*fit.residual.shape[:-2], 6 * n, 1))[..., None, :, :]
    index = np.arange(n)
    blocks = fit.S.reshape(*fit.S.shape[:-2], n, 6, n, 6)
    L = np.linalg.cholesky(np.moveaxis(blocks[..., index, :, index, :], 0, -3))
    mu, V = np.linalg.eigh(L.mT @ (own.mT @ own - Q @ P @ Q.mT) @ L)
    g = (V.mT @ L.mT @ pull)[..., 0]
    predictable = mu > 1e-9 * w
    variance = np.where(predictable, mu * (1.0 - mu * (1.0 / w - 1.0)), 1.0)
    leverage = np.einsum("...ij,...ij->...", Q @ P, fit.linear.J) / p
    return np.asarray(np.where(predictable, g**2 / variance, 0.0).sum(axis=-1)), leverage


def robust_weights(distances: Array) -> Array:
    """The weight of each d^2 (...): 1 up to FULL, linearly to 0 at NOTHING."""
    return np.clip((NOTHING - distances) / (NOTHING - FULL), 0.0, 1.0)


def robust_fit(
    data: PosePairs | Motions,
    noise: Noise | None,
    *,
    method: str = "efficient",
    estimate: Estimator | None = None,
    seed: int | np.random.Generator = 0,
) -> RobustFit:
    """X, W and their covariance from the poses that agree, with a flag for each pose.

    Parameters
    ----------
    data : PosePairs or Motions
        n poses, or n motions that come without poses; no leading axes.
    noise : PoseNoise, PairNoise or None
        None: from the residuals of the poses kept, by ``estimate``.
    method : "efficient" or "ml"
    estimate : function ``(data, X, weights) -> noise``
        Needed where ``noise`` is None: the noise of data whose poses count with weights (n,), near X (4, 4).
    seed : int or numpy Generator
        Of the random subsets.

    Raises
    ------
    InputError
        Fewer than 4 poses (3 motions); the noise cannot be estimated; or fewer than half of the poses agree.
    DegenerateMotionError
        The poses that agree do not determine X.
    NotConvergedError
        Weights, or ``ml``, that do not settle.
    """
    if method not in ("efficient", "ml"):
        raise InputError(f"Expected `method` to be 'efficient' or 'ml', got {method!r}.")
    if noise is None and estimate is None:
        raise InputError("Expected `noise`, or a function `estimate` that finds it from the residuals.")
    constraint = constraint_of(data, noise)
    kind, fewest = ("poses", 3) if isinstance(constraint, OnPoses) else ("motions", 2)
    n = constraint.first.shape[-3]
    if constraint.first.ndim != 3 or n <= fewest:
        raise InputError(
            f"Expected more than {fewest} {kind} of one data set to tell wrong ones from good ones, got "
            f"{constraint.first.shape[:-2]}."
        )
    start = consensus(constraint, noise, seed)
    if noise is not None:
        settled = _settle(constraint, noise, start.unknowns, start.inside, method)
    else:
        assert estimate is not None
        noise, settled = _alternate(data, constraint, start, estimate, method)
    found, distances, leverage, scale, limit = settled
    assert found.weights is not None
    weights = found.weights
    kept = int((weights > 0).sum())
    if kept < fewest or 2 * kept < n:
        raise InputError(
            f"Only {kept} of {n} {kind} agree with one X within the noise; at least half of them must. Look at the "
            "pairing of the rows, the setup (eye-in-hand or eye-to-hand), the units and the noise given."
        )
    flags = tuple(
        "kept" if d <= limit else "rejected" if w == 0 else f"downweighted ({w:.2f})"
        for d, w in zip(distances.tolist(), weights.tolist(), strict=True)
    )
    return RobustFit(found, noise, weights, distances, leverage, flags, scale, limit, start.subsets)


# ------------------------------------------------------------------------------------------------------- the start


class Consensus(NamedTuple):
    """What most poses agree on."""

    unknowns: Unknowns
    inside: Array  # (n,) 1 for the poses that it was fitted to, else 0
    noise: Noise  # as given, or isotropic with robust scales of the residuals
    subsets: int  # tried


def consensus(constraint: OnPoses | OnMotions, noise: Noise | None, seed: int | np.random.Generator) -> Consensus:
    """X and W that at least 60 % of the poses fit best; raises `DegenerateMotionError` if no subset determines X."""
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
        noise = _isotropic(np.array([_variance(column, 3) for column in squares.T]), on_poses)
    return Consensus(at, inside, noise, len(hypotheses.X))


def _hypotheses(constraint: OnPoses | OnMotions, rng: np.random.Generator) -> Unknowns:
    """X (T, 4, 4) and W of smallest subsets, without those that do not determine X."""
    on_poses = isinstance(constraint, OnPoses)
    n, size = constraint.first.shape[-3], 3 if on_poses else 2
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
        X = solve_limit(*_all_motions(constraint))  # raises and says why, if all together do not determine X either
        raise DegenerateMotionError(
            f"No {size} {'poses' if on_poses else 'motions'} determine X by themselves, so that wrong ones "
            "cannot be told from good ones. Turn the robot about two different axes, by 30 degrees and more.",
            np.eye(6),
            X,
        )
    X = solve_limit(A[usable], B[usable])
    if not on_poses:
        return Unknowns(X, None)
    measured = G[usable] @ X[:, None] @ second[usable]
    W = measured.mean(axis=1)
    W[:, :3, :3] = orthonormalise(W[:, :3, :3])
    return Unknowns(X, W)


def _all_motions(constraint: OnPoses | OnMotions) -> tuple[Array, Array]:
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


def misfit(constraint: OnPoses | OnMotions, at: Unknowns) -> Array:
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


def _misfits(constraint: OnPoses | OnMotions, at: Unknowns, majority: int) -> tuple[Array, Array]:
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


# ----------------------------------------------------------------------------------------------------- the weights


class _Settled(NamedTuple):
    fit: Fit
    distances: Array
    leverage: Array
    scale: float
    limit: float


def _settle(
    constraint: OnPoses | OnMotions, noise: Noise, at: Unknowns, weights: Array, method: str, margin: float = 1.0
) -> _Settled:
    """Fit and weights in turn until they stand still; with ``ml``, full maximisations in turn after that."""
    steps, scale2 = 1, 1.0
    for k in range(MOST_REWEIGHTED):
        found = fit(constraint, noise, at, steps, weights)
        if not found.converged.all():
            raise NotConvergedError(
                f"Method 'ml' did not converge within {found.iterations} iterations with robust weights.",
                found,
            )
        at = found.unknowns
        distances, leverage = pose_distances(found)
        if k < FREE:
            scale2 = _scale_guard(distances)
        wanted = robust_weights(distances / (scale2 * margin))
        still = bool(np.abs(wanted - weights).max() < STILL)
        if still and (method == "efficient" or steps > 1):
            return _Settled(found, distances, leverage, float(np.sqrt(scale2)), FULL * scale2 * margin)
        if still:
            steps = MOST_STEPS
        # Two poses that predict each other, or the scale, may take turns: the mean of the weights and one scale end it.
        weights = wanted if k < FREE else 0.5 * (wanted + weights)
    raise NotConvergedError("The weights of the robust fit did not settle: poses contradict each other.", found)


def _alternate(
    data: PosePairs | Motions, constraint: OnPoses | OnMotions, start: Consensus, estimate: Estimator, method: str
) -> tuple[Noise, _Settled]:
    """Noise from the residuals of the poses kept, then weights by that noise, until the same poses are flagged."""
    noise, at, weights = start.noise, start.unknowns, start.inside
    freedom = 0.5 * (6 * len(weights) - (12 if isinstance(constraint, OnPoses) else 6))
    margin = 6.0 * float(fdtri(6, freedom, 0.999)) / FULL
    seen: list[bytes] = []
    for _ in range(MOST_ROUNDS):
        settled = _settle(constraint, noise, at, weights, "efficient", margin)
        assert settled.fit.weights is not None
        at, weights = settled.fit.unknowns, settled.fit.weights
        good = settled.distances <= settled.limit
        if len(seen) > 1 and good.tobytes() in seen:  # stable, or in a circle of poses on the border: any of it will do
            break
        seen.append(good.tobytes())
        # Flagged poses would hide themselves in the noise; leaving out a good one in 1000 makes it 0.4 % smaller.
        by_residuals = estimate(data, at.X, good.astype(float))
        if by_residuals is None:
            raise InputError("The noise cannot be estimated from these residuals: give `noise`.")
        noise = by_residuals
    if method == "ml":
        settled = _settle(constraint, noise, at, weights, method, margin)
    return noise, settled


def _scale_guard(distances: Array) -> float:
    """s^2 >= 1: the noise of most poses in units of the noise given, 1 unless the excess is beyond chance (0.1 %)."""
    scale2 = _variance(distances, 6)
    m = int((distances <= NOTHING * max(scale2, 1.0)).sum())
    u = float(betaincinv(0.5 * (m + 1), 0.5 * (m + 1), 0.999))  # how high the median of m good poses may lie
    return scale2 if scale2 > gammaincinv(3.0, u) / gammaincinv(3.0, 0.5) else 1.0


def _variance(squares: Array, freedom: int) -> float:
    """Robust variance per axis of squared lengths (n,) of Gaussian vectors: their median, without the gross ones."""
    middle, gross = (2.0 * float(gammaincinv(0.5 * freedom, q)) for q in (0.5, 1.0 - 1e-6))
    variance = float(np.median(squares)) / middle
    for _ in range(20):
        smaller = float(np.median(squares[squares <= gross * variance])) / middle
        if smaller == variance:
            break
        variance = smaller
    return variance
