r"""Robust estimates of X and W: a consensus start, redescending weights, and a flag for every pose.

Model: most poses (or motions) obey ``G X C = W`` (``A X = X B``) with the Gaussian noise of `gauss_helmert`; the
others, at most 40 % (or half, where the good half stands out in `consensus`), hold anything. Frames, units and
residuals are those of `constraint` (rad, m).

*Distance* of a pose from its prediction by the others. With the residual e of pose i after the fit, whitened
by its own covariance ``S_i = L L^T``, its hat block ``H = L^-1 J P J^T L^-T`` (P the covariance of the unknowns) and
its weight w in that fit, the residual predicted *without* pose i and its covariance are, exactly for a linear model,

    (I - w H)^-1 e,    (I + (1 - w) H) (I - w H)^-1,    d^2 = e^T ((I + (1 - w) H) (I - w H))^-1 e

chi-square with 6 degrees of freedom if the pose is good (for w = 1: ``e^T (I - H)^-1 e``). With errors that are
correlated over the poses (T4b) the prediction uses the errors of the others too: with ``M = S^-1 - S^-1 J P J^T S^-1``
the predicted residual is ``M_ii^-1 (S^-1 r)_i`` with covariance ``M_ii^-1`` (S with the block of pose i divided by w,
of a `JointCovariance` its own part only, which is subtracted from that covariance).
A direction in which no other pose can predict pose i does not count.

*Weight.* It is 1 up to ``d^2 = a``, the 99.9 % quantile of chi-square(6), and falls from there linearly to 0 at b, its
1 - 1e-6 quantile. The fit is iteratively reweighted least squares: each step is the one of `graph.fit`. d^2
depends on the pose's own weight only through the linearisation, so that the iteration converges at once. Where the
noise comes from the residuals too, a and b are those quantiles of ``6 F(6, m/2)``, with one factor for both, that of
99.9 %: of the ``m = 6 n - p`` degrees of freedom, half determine the noise of rotation and half that of translation.

*Start.* With the noise given, all poses are first weighted alike: they count in full if the largest distance in their
fit is one that good poses exceed once in 1000 data sets. Otherwise the limit of the iteration from there is taken if it
keeps at least 80 % of the poses with noise that needs no scale: two such X share most of their poses and are the same
within the noise. Otherwise the iteration starts from `consensus`. Where the noise comes from the residuals several
outliers may hide each other, especially in few poses. From 25 poses on all count in full if, with the noise of all of
them, the largest distance is one that good poses exceed in one of twenty data sets, and the median distance is as
expected, which the noise of outliers would reduce.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, chdtri, fdtri, gammaincinv

from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED, UNUSUAL
from ...core.limits import MAJORITY
from ...core.read_only import ReadOnlyArrays
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...model.errors.models import Noise, with_prior
from ...model.errors.pose_prior import PosePrior
from ...model.errors.square_roots import LEAST_WEIGHT, inverse_blocks, is_joint, pulled, weighed_blocks, whiten
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from .consensus import NO_WEIGHT, Consensus, consensus, misfit, robust_variance
from .constraint import Constraint, Unknowns, constraint_of
from .gauss_helmert import CLOSED_FORM_STEPS, MAX_ML_STEPS, MAX_ROUNDS, STEP_SD, Fit, fit
from .starts import isotropic_residuals, leaves_open, sound_start

# The 99.9 % quantile of chi-square(6), below which a pose counts in full; above NO_WEIGHT it does not count at all.
FULL = CONTRADICTED.chi_square(6)
# The scale is held and the weights are damped after the first half of the rounds.
UNDAMPED_STEPS = MAX_ROUNDS // 2
# Weights that converge slowly have converged when none changes by more than this; and noise and weights have when no
# larger share of the poses changes between kept and flagged: as many good poses are flagged by chance.
BORDER_SHARE = CONTRADICTED.probability
# The iteration that starts from all poses alike is relied on if it keeps this share of them: two such sets of poses
# share `MAJORITY` of all.
MIN_KEPT_SHARE = 0.5 * (1.0 + MAJORITY)
# Where most poses are rejected, the others prove nothing if there are fewer.
MIN_KEPT_OF_MINORITY = 8
# Where the noise is not known, all rows count in full if their median distance is at least this many times that of
# chi-square.
MIN_MEDIAN_RATIO = 0.75
# All rows may agree if their mean squares, of rotation times translation, exceed the medians of the consensus by no
# more than this factor; of good rows it is 1.6.
MAX_ALIKE_RATIO = 50.0
# Among fewer rows than these a few outliers make most of the noise.
MIN_POSES_FOR_ALL_ALIKE = 25

Found = TypeVar("Found")
# The noise of the constraint near the unknowns, whose rows count with weights (n,); None: the data are exact.
Estimator = Callable[[Constraint, Unknowns, Array], Noise | None]


@dataclass(frozen=True, eq=False)
class RobustFit(ReadOnlyArrays):
    """The fit and what became of each of the n poses (or motions)."""

    fit: Fit
    noise: Noise | None  # given or estimated; None: the poses kept fit exactly
    weights: Array  # (n,) in [0, 1]
    distances: Array  # (n,) d^2, chi-square(6) for good poses and true noise
    leverage: Array  # (n,) share of each pose in the estimate; the sum is 1
    flags: tuple[str, ...]  # "kept", "downweighted" or "rejected"
    scale: float  # factor from the given noise to that of most poses; 1 unless it is surely larger
    limit: float  # poses with d^2 above it are flagged
    begun: Unknowns | None = None  # where the steps of the fit began

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
    p = fit.covariance.shape[-1]
    weights = np.ones(fit.residual.shape[:-1]) if fit.weights is None else fit.weights
    P = fit.covariance[..., None, :, :]
    if not is_joint(fit.S):
        e, J = fit.white
        h, V = np.linalg.eigh(J @ P @ J.mT)
        along = (V.mT @ e[..., None])[..., 0]
        w = weights[..., None]
        left = 1.0 - w * h
        variance = (1.0 + (1.0 - w) * h) * left
        leverage = weights * h.sum(axis=-1) / p
        squares = np.where(left > 1e-9, along**2 / np.where(left > 1e-9, variance, 1.0), 0.0)
        return np.asarray(squares.sum(axis=-1)), leverage
    factor = fit.weighted_factor
    white = whiten(factor, np.concatenate([fit.linear.J, fit.residual[..., None]], axis=-1))
    pulled_back = pulled(factor, white)  # S^-1 J and S^-1 r, pose by pose
    del white
    Q, pull = pulled_back[..., :-1], pulled_back[..., -1:]
    L = np.linalg.cholesky(weighed_blocks(fit.S))
    information = L.mT @ (inverse_blocks(factor) - Q @ P @ Q.mT) @ L
    leverage = np.einsum("...ij,...ij->...", Q @ P, fit.linear.J) / p
    return left_out(information, L.mT @ pull, np.maximum(weights, LEAST_WEIGHT)), leverage  # as `weighted` has it


def left_out(information: Array, pull: Array, w: Array) -> Array:
    """Return d^2 (...) of what has the weight w (...) in the fit, predicted without it; see the module.

    ``information`` (..., 6, 6): ``L^T M_ii L``, ``pull`` (..., 6, 1): ``L^T (S^-1 r)_i``, where w divides ``L L^T``.
    """
    mu, V = np.linalg.eigh(information)
    along, w = (V.mT @ pull)[..., 0], w[..., None]
    variance = mu * (1.0 - mu * (1.0 / w - 1.0))
    told = (mu > 1e-9 * w) & (variance > 0)
    return np.asarray(np.where(told, along**2 / np.where(told, variance, 1.0), 0.0).sum(axis=-1))


def robust_weights(distances: Array) -> Array:
    """The weight of each d^2 (...): 1 up to FULL, linearly to 0 at NO_WEIGHT."""
    return np.clip((NO_WEIGHT - distances) / (NO_WEIGHT - FULL), 0.0, 1.0)


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
    estimate : function ``(constraint, unknowns, weights) -> noise``
        Needed where ``noise`` is None: the noise of data whose rows count with weights (n,), near the unknowns.
    seed : int or numpy Generator
        Of the random subsets.

    Raises
    ------
    InputError
        Fewer than 4 poses (3 motions); noise that is none or does not fit; or fewer than half of the poses agree.
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
    if constraint.first.ndim != 3:
        raise InputError(f"Expected one data set, got leading axes {constraint.first.shape[:-3]}.")
    require_enough(constraint)
    search = None if estimate is None else NoiseSearch(estimate)
    return fit_robustly(constraint, noise, sound_start(data, constraint, noise), method, search, seed)


def require_enough(constraint: Constraint) -> None:
    """Raise `InputError` where there are too few rows to identify outliers."""
    if constraint.n <= constraint.fewest:
        raise InputError(
            f"Expected more than {constraint.fewest} {constraint.item}s to identify outliers, got {constraint.n}."
        )


class NoiseSearch(NamedTuple):
    """Way to noise that is not known."""

    estimate: Estimator
    prior: PosePrior | None = None  # of X and W
    slack: float = 1.0  # multiplies the limits of distances
    all_alike: bool = False  # starts from all rows, not from `consensus`


def fit_robustly(
    constraint: Constraint,
    noise: Noise | None,
    start: Unknowns,
    method: str = "efficient",
    search: NoiseSearch | None = None,
    seed: int | np.random.Generator = 0,
) -> RobustFit:
    """Run `robust_fit` on one constraint, from the unknowns that all rows together give.

    ``search`` is needed where the noise is not known.
    """
    require_enough(constraint)
    given = noise is not None
    if noise is not None:
        settled, begun = _begin_with_all(constraint, noise, start, method), None
    else:
        assert search is not None
        settled, begun = None, None
        if not search.all_alike and constraint.n >= MIN_POSES_FOR_ALL_ALIKE:
            begun = _begin(constraint, noise, start, seed)
            if _may_all_agree(constraint, start, begun):
                noise, settled = _all_agree(constraint, start, search.estimate, method)
    if settled is None:
        if begun is None:
            alike = noise is None and search is not None and search.all_alike
            begun = _from_all(constraint, start) if alike else _begin(constraint, noise, start, seed)
        if noise is not None:
            settled = _settle(constraint, noise, begun.unknowns, begun.inside, method)
        else:
            assert search is not None
            begun = begun._replace(noise=with_prior(begun.noise, search.prior))
            noise, settled = _alternate(constraint, begun, search.estimate, method, search.slack)
    fitted, distances, leverage, scale, limit, plain, begun_at = settled
    assert fitted.weights is not None
    weights, n = fitted.weights, constraint.n
    kept = int((weights > 0).sum())
    # of a half that stands out, a few may lie in the tails of its own noise
    least = max(MIN_KEPT_OF_MINORITY, 0.4 * n) if begun is not None and begun.half else 0.5 * n
    if kept < max(constraint.fewest, least):
        raise InputError(
            f"Only {kept} of {n} {constraint.item}s agree with one X within the noise; at least half of them must. "
            "Look at the pairing of the rows, the setup (eye-in-hand or eye-to-hand) and the units"
            f"{', and at the noise given' if given else ''}; if the robot moved and the clocks differ, "
            "synchronise the streams (--pair async)."
        )
    flags = _flags(distances, weights, limit)
    if noise is not None and (weights == 1).all():  # the plain fit, to the last digit
        steps = CLOSED_FORM_STEPS if method == "efficient" else MAX_ML_STEPS
        fitted, begun_at = replace(fitted, weights=None) if plain else fit(constraint, noise, start, steps), start
    return RobustFit(fitted, noise, weights, distances, leverage, flags, scale, limit, begun_at)


def _flags(distances: Array, weights: Array, limit: float) -> tuple[str, ...]:
    return tuple(
        "kept" if d <= limit else "rejected" if w == 0 else "downweighted"
        for d, w in zip(distances.tolist(), weights.tolist(), strict=True)
    )


def is_weak_minority(kept: int, count: int) -> bool:
    """Return whether the poses that were kept, of ``count``, are too few to prove that the rejected ones are wrong."""
    return 2 * kept < count and kept < MIN_KEPT_OF_MINORITY


def judged_by(robust: RobustFit, fit: Fit, noise: Noise) -> RobustFit:
    """Return distances, weights and flags by another fit and its noise; the weights of that fit are the new ones."""
    distances, leverage = pose_distances(fit)
    weights = robust_weights(distances * FULL / robust.limit)
    flags = _flags(distances, weights, robust.limit)
    if flags == robust.flags:
        weights = robust.weights
    taken = replace(fit, weights=None if (weights == 1).all() else weights)
    return replace(robust, fit=taken, noise=noise, weights=weights, distances=distances, leverage=leverage, flags=flags)


def _begin(constraint: Constraint, noise: Noise | None, start: Unknowns, seed: int | np.random.Generator) -> Consensus:
    """`consensus`; where the motions leave a part of X open, the rows that agree best with the start."""
    if not (constraint.one_axis.all() and leaves_open(constraint, noise, start)):
        return consensus(constraint, noise, seed)
    squares = misfit(constraint, start)
    squares = (squares / np.maximum(np.median(squares, axis=0), 1e-24)).sum(axis=-1)
    inside = (squares <= np.quantile(squares, MAJORITY)).astype(float)
    return Consensus(start, inside, isotropic_residuals(constraint, start) if noise is None else noise)


def _from_all(constraint: Constraint, start: Unknowns) -> Consensus:
    return Consensus(start, np.ones(constraint.n), isotropic_residuals(constraint, start))


def _begin_with_all(constraint: Constraint, noise: Noise, start: Unknowns, method: str) -> _Settled | None:
    """Return the result to which the iteration converges from all rows alike, if it can be relied on (module); else
    None.
    """
    try:
        plain = _settle_clean(constraint, noise, start, method)
        settled = plain or _settle(constraint, noise, start, np.ones(constraint.n), method, most=UNDAMPED_STEPS)
    except (NotConvergedError, DegenerateMotionError):
        return None
    kept = settled.distances <= settled.limit
    return settled if settled.scale == 1.0 and kept.mean() >= MIN_KEPT_SHARE else None


def _may_all_agree(constraint: Constraint, start: Unknowns, begun: Consensus) -> bool:
    """Return whether the residuals of all rows are about as large as those of the consensus.

    Where half of the rows are wrong, their noise explains all residuals, and their median too.
    """
    of_all, of_most = misfit(constraint, start).mean(axis=0), np.median(misfit(constraint, begun.unknowns), axis=0)
    if begun.half:
        return False
    return bool(np.log(np.maximum(of_all, 1e-24) / np.maximum(of_most, 1e-24)).sum() < np.log(MAX_ALIKE_RATIO))


def _all_agree(
    constraint: Constraint, start: Unknowns, estimate: Estimator, method: str
) -> tuple[Noise | None, _Settled | None]:
    """Return the noise of all rows and the plain fit with it, if no row is an outlier for that noise; else None.

    Wrong rows make the noise larger: then the distances of the others are too small, their median among them.
    """
    try:
        noise = estimate(constraint, start, np.ones(constraint.n))
        settled = None if noise is None else _settle_clean(constraint, noise, start, method, UNUSUAL.probability)
    except (InputError, NotConvergedError, DegenerateMotionError):
        return None, None
    agree = settled is not None and robust_variance(settled.distances, 6) > MIN_MEDIAN_RATIO
    return (noise, settled) if agree else (None, None)


def _settle_clean(
    constraint: Constraint, noise: Noise, start: Unknowns, method: str, level: float = CONTRADICTED.probability
) -> _Settled | None:
    """The plain fit, if its largest distance is no surprise at that level; else None."""
    fitted = fit(constraint, noise, start, CLOSED_FORM_STEPS if method == "efficient" else MAX_ML_STEPS)
    if not fitted.converged.all():
        return None
    distances, leverage = pose_distances(fitted)
    limit = largest_by_chance(constraint.n, level)
    if (distances > limit).any():
        return None
    return _Settled(replace(fitted, weights=np.ones(constraint.n)), distances, leverage, 1.0, limit, True, start)


def largest_by_chance(n: int, level: float = CONTRADICTED.probability) -> float:
    """The d^2 that the largest of n good poses exceeds in a share ``level`` of data sets."""
    return float(chdtri(6, level / max(n, 1)))


def _margin(constraint: Constraint) -> float:
    """Return the factor by which the limits of distances grow where the noise comes from the residuals (module)."""
    return 6.0 * float(fdtri(6, 0.5 * (6 * constraint.n - constraint.p), 0.999)) / FULL


def in_turns(
    fitted: Callable[[Array, bool], tuple[Found, Array]], weights: Array, still: Callable[[int], float], most: int
) -> tuple[Found, Array]:
    """Fit and weights in turn until they converge: the fit, and the weights (n,) that it was made with.

    Two poses that predict each other, or a scale, may take turns: the mean of the weights ends it from half of the
    rounds of a fit on, and later weights only fall. A mean that has come near 0 is 0 where that is asked for: a small
    weight would keep what is rejected among what counts.

    Parameters
    ----------
    fitted : function
        Of the weights, and whether they are taken as they are, without their mean: the fit, and the weights by it.
    still : function
        Of the rounds done: the change of a weight that counts as none.

    Raises
    ------
    NotConvergedError
        Weights that still change after ``most`` rounds.
    """
    for k in range(most):
        found, wanted = fitted(weights, k < UNDAMPED_STEPS)
        if k >= MAX_ROUNDS:
            wanted = np.minimum(wanted, weights)
        if np.abs(wanted - weights).max(initial=0.0) < still(k):
            return found, weights
        mean = np.where((wanted == 0) & (weights < 2.0 * still(k)), 0.0, 0.5 * (wanted + weights))
        weights = wanted if k < UNDAMPED_STEPS else mean
    raise NotConvergedError("The weights of the robust fit did not settle: poses contradict each other.", found)


class _Settled(NamedTuple):
    fit: Fit
    distances: Array
    leverage: Array
    scale: float
    limit: float
    plain: bool  # all rows counted in full all the time
    begun: Unknowns  # where the steps of the fit began


def _settle(
    constraint: Constraint,
    noise: Noise,
    begin: Unknowns,
    weights: Array,
    method: str,
    margin: float = 1.0,
    most: int = 5 * MAX_ROUNDS,
    still_at: float | None = None,
) -> _Settled:
    """Fit and weights in turn until they converge; with ``ml``, full maximisations in turn after that.

    ``still_at``: the change of a weight that counts as none (default: `STEP_SD`, and `BORDER_SHARE` of many or slow
    ones).
    """
    steps, scale2, at, plain = CLOSED_FORM_STEPS, 1.0, begin, True

    def fitted(weights: Array, undamped: bool) -> tuple[_Settled, Array]:
        nonlocal scale2, at, plain
        plain = plain and bool((weights == 1).all())
        found, begun = fit(constraint, noise, at, steps, weights), at
        if not found.converged.all():
            raise NotConvergedError(
                f"Method 'ml' did not converge within {found.iterations} iterations with robust weights.",
                found,
            )
        at = found.unknowns
        distances, leverage = pose_distances(found)
        if undamped:
            scale2 = scale_guard(distances)
        limit, scale = FULL * scale2 * margin, float(np.sqrt(scale2))
        settled = _Settled(found, distances, leverage, scale, limit, plain, begun)
        return settled, robust_weights(distances / (scale2 * margin))

    def still(done: int) -> float:
        quick = done >= MAX_ROUNDS or constraint.n * BORDER_SHARE >= 1.0  # or one of more than a thousand poses
        return still_at or (BORDER_SHARE if quick else STEP_SD)

    settled, weights = in_turns(fitted, weights, still, most)
    if method == "efficient":
        return settled
    steps, at = MAX_ML_STEPS, begin
    return in_turns(fitted, weights, still, most)[0]


def _alternate(
    constraint: Constraint, begun: Consensus, estimate: Estimator, method: str, slack: float
) -> tuple[Noise | None, _Settled]:
    """Noise from the residuals of the poses kept, then weights by that noise, until the same poses are flagged.

    The noise is None where ``estimate`` finds none: the poses kept fit exactly.
    """
    noise, at, weights = begun.noise, begun.unknowns, begun.inside
    seen: list[NDArray[np.bool_]] = []
    margin = slack * _margin(constraint)
    for _ in range(MAX_ROUNDS):
        # The noise changes again: which poses are flagged is all that counts, for which rough weights are enough.
        settled = _settle(constraint, noise, at, weights, "efficient", margin, still_at=10.0 * BORDER_SHARE)
        assert settled.fit.weights is not None
        at, weights = settled.fit.unknowns, settled.fit.weights
        good = settled.distances <= settled.limit
        # The noise is theirs; or a circle of poses on the border, or one or two of very many: any of it will do.
        if any((good != before).sum() <= BORDER_SHARE * len(good) for before in seen):
            break
        seen.append(good)
        # Flagged poses would hide themselves in the noise; leaving out a good one in 1000 makes it 0.4 % smaller.
        by_residuals = estimate(constraint, at, good.astype(float))
        if by_residuals is None:  # the poses kept fit exactly: rounding tells them from the others
            return None, _settle(constraint, begun.noise, at, good.astype(float), "efficient")
        noise = by_residuals
    return noise, _settle(constraint, noise, at, weights, method, margin)


def scale_guard(distances: Array) -> float:
    """s^2 >= 1: the noise of most poses in units of the noise given, 1 unless the excess is beyond chance (0.1 %)."""
    scale2 = robust_variance(distances, 6)
    m = int((distances <= NO_WEIGHT * max(scale2, 1.0)).sum())
    u = float(betaincinv(0.5 * (m + 1), 0.5 * (m + 1), 0.999))  # how high the median of m good poses may lie
    return scale2 if scale2 > gammaincinv(3.0, u) / gammaincinv(3.0, 0.5) else 1.0
