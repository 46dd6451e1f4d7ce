r"""Covariances that need no noise model, of every estimator: `resampled`; and the jackknife and bootstrap over poses.

Each pose is one draw from an unknown distribution of errors, independent of the others (`sandwich.hac` is for those
that are not). Motions that came without poses take the place of poses. Units and conventions: ``xi = (theta, tau)``,
left rotation, additive translation, rad and m.

Jackknife: with the estimate x_(i) without pose i, ``Cov = (n - 1)/n sum_i (x_(i) - mean)(x_(i) - mean)^T``
(J. W. Tukey, Ann. Math. Stat. 29 (1958) 614; B. Efron and C. Stein, Ann. Statist. 9 (1981) 586-596: it errs on the safe
side, by the leverage of the poses). For weighted least squares the matrix inversion lemma gives, exactly,

    x_(i) - x = M J_i^T (1 - H_ii)^-1 e_i,        H_ii = J_i M J_i^T

in units in which the covariance of e_i is 1, e_i the residual after the fit. Other estimators are solved again.

Bootstrap: n poses drawn with replacement, that is counts m_i, multinomial. One weighted step from x (exact for the
linearised problem; W is estimated again, being among the unknowns):

    x* - x = -(sum m_i J_i^T J_i)^-1 sum_i m_i J_i^T e_i

(B. Efron, Ann. Statist. 7 (1979) 1-26; pairs bootstrap.) A draw may hold too few different poses to determine X; such
draws are counted and the covariance is that of the others.

On 30 simulated poses with the true noise model (tests/empirical_covariance) the sandwich is on average the sampling
covariance, the variances of the jackknife are 2 to 10 % larger, those of the bootstrap between 8 % smaller and 2 %
larger, each on average over all directions. With fewer poses, of more leverage each, the jackknife's are larger still.
`studies.real_cell` prints how often the 95 % ellipsoid of each kind holds the truth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import DegenerateMotionError, InputError, require_integer
from ...methods.estimators.registry import METHODS, ROBOT_WORLD_METHODS
from ...model.noise.models import Noise
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ..likelihood.gauss_helmert import ESTIMATORS, Fit
from .replicates import Counts, Problem, Solved
from .sandwich import (
    DISPENSABLE,
    Influence,
    hac_freedom,
    influence_of,
    of_declared,
    require_dispensable,
    times,
)

KINDS = ("sandwich", "hac", "jackknife", "bootstrap")

# A draw whose information is below this share of that of all poses, in some direction, is near singular.
NEAR_SINGULAR = 1e-6
# Numbers held at once while draws are solved.
AT_ONCE = 1_000_000


class Bootstrap(NamedTuple):
    """The covariance, and how many draws it is made of."""

    covariance: Array  # (..., p, p)
    replicates: int
    singular: NDArray[np.intp]  # (...) of the replicates that determined no X and are not in the covariance


@dataclass(frozen=True, eq=False)
class Resampled(ReadOnlyArrays):
    """A covariance of X and W from the data only; see the module."""

    kind: str  # one of KINDS
    # (p, p) of (xi_X, xi_W), p = 12; of xi_X, p = 6, where there is no W. Regular on the whole if clusters > p.
    covariance: Array
    clusters: int
    cluster: str = "poses"  # or "motions": what was taken as independent
    freedom: float | None = None  # nu of `reference`, Hotelling; None: not known
    details: dict[str, int] = field(default_factory=dict)  # "lags", or "replicates" and "singular" ones among them

    @property
    def covariance_X(self) -> Array:
        """(6, 6)"""
        return self.covariance[:6, :6]

    @property
    def covariance_W(self) -> Array | None:
        """(6, 6); None for motions without poses."""
        return None if len(self.covariance) == 6 else self.covariance[6:, 6:]


def deletions(influence: Influence) -> Array:
    """``x_(i) - x`` (..., n, p) of weighted least squares. Of motions, which must not share poses, one is left out."""
    kept = influence.J @ influence.B
    kept += np.eye(6)
    try:
        inverse = np.linalg.inv(kept)
    except np.linalg.LinAlgError:  # say which one is exactly singular
        require_dispensable(np.linalg.matrix_rank(kept) == 6)
        raise
    require_dispensable(np.abs(inverse).max(axis=(-2, -1)) < 1.0 / DISPENSABLE)
    return np.asarray(-(influence.B @ (inverse @ influence.residual[..., None]))[..., 0])


def spread_of_deletions(moves: Array) -> Array:
    """``(n - 1)/n`` times the sum of squares about the mean, moves (..., n, p)."""
    n = moves.shape[-2]
    about = moves - moves.mean(axis=-2, keepdims=True)
    return np.asarray((about.mT @ about) * ((n - 1) / n))


def bootstrap(fit: Fit, replicates: int = 2000, seed: int | np.random.Generator = 0) -> Bootstrap:
    """The covariance (..., p, p) over poses drawn with replacement; all leading axes see the same draws.

    On motions it draws motions, which must not share poses.

    Raises
    ------
    InputError
        As for `sandwich`; fewer than 2 replicates.
    DegenerateMotionError
        More than half of the draws do not determine X and W.
    """
    influence = influence_of(fit)
    n, p = influence.n, influence.J.shape[-1]
    bread = influence.covariance
    if influence.known is not None:  # a part of the unknowns is known beforehand: M
        flat = influence.J.reshape(-1, p)
        bread = np.asarray(np.linalg.inv(flat.T @ flat + influence.known), dtype=float)
    # in these units the information of all poses, and of what is known, is 1
    half = np.asarray(np.linalg.cholesky(bread), dtype=float)
    J = times(influence.J, half)
    known = np.zeros((p, p)) if influence.known is None else half.mT @ influence.known @ half
    pull = np.zeros(p) if influence.known is None else -(J.mT @ influence.residual[..., None]).sum(axis=-3)[..., 0]
    # Only where the data say more than half, no prior keeps a draw from being singular: its inverse is large there.
    share, directions = np.linalg.eigh(known)
    free = directions[..., share < 0.5]
    upper = np.triu_indices(p)
    features = np.concatenate(
        [(J.mT @ J)[..., upper[0], upper[1]], (J.mT @ influence.residual[..., None])[..., 0]], axis=-1
    )
    batch = features.shape[:-2]
    total, square = np.zeros((*batch, p)), np.zeros((*batch, p, p))
    used = np.zeros(batch, dtype=np.intp)
    for counts in draws(n, replicates, seed, max(1, AT_ONCE // (math.prod(batch) * 3 * p * p + n))):
        sums = counts.astype(float) @ features
        information = np.empty((*sums.shape[:-1], p, p))
        information[..., upper[0], upper[1]] = information[..., upper[1], upper[0]] = sums[..., :-p]
        # far below what counts as singular, and enough for a singular matrix to have an inverse
        information += known + 1e-6 * NEAR_SINGULAR * np.eye(p)
        right = np.concatenate(
            [-(sums[..., -p:] + pull)[..., None], np.broadcast_to(free, (*sums.shape[:-1], *free.shape))], axis=-1
        )
        solved = np.linalg.solve(information, right)
        ok = np.linalg.norm(solved[..., 1:], axis=(-2, -1)) < 1.0 / NEAR_SINGULAR
        moves = np.where(ok[..., None], solved[..., 0], 0.0)
        total += moves.sum(axis=-2)
        square += moves.mT @ moves
        used += ok.sum(axis=-1)
    _require_most(used, replicates)
    mean = total / used[..., None]
    about = (square - used[..., None, None] * mean[..., :, None] * mean[..., None, :]) / (used - 1)[..., None, None]
    covariance = half @ about @ half.mT
    return Bootstrap(0.5 * (covariance + covariance.mT), replicates, np.asarray(replicates - used, dtype=np.intp))


def draws(n: int, replicates: int, seed: int | np.random.Generator, size: int) -> Iterator[Counts]:
    """Multinomial counts (at most ``size``, n); the same numbers whatever the size."""
    require_integer("replicates", replicates, 2)
    rng = np.random.default_rng(seed)
    for start in range(0, replicates, size):
        yield rng.multinomial(n, np.full(n, 1.0 / n), size=min(size, replicates - start)).astype(np.intp)


def _require_most(used: NDArray[np.intp], replicates: int) -> None:
    if (fewest := int(used.min())) <= replicates // 2:
        raise DegenerateMotionError(
            f"Only {fewest} of {replicates} draws from the poses determine X and W: there are too few poses to draw "
            "from. Use the jackknife, the sandwich or a noise model.",
            np.eye(6),
        )


def resampled(
    data: PosePairs | Motions,
    method: str = "efficient",
    kind: str = "sandwich",
    *,
    X: Array | None = None,
    fit: Fit | None = None,
    noise: Noise | None = None,
    replicates: int = 2000,
    seed: int | np.random.Generator = 0,
) -> Resampled:
    """The covariance of any method's X and W from the data only, clustered by pose.

    Parameters
    ----------
    data : PosePairs or Motions
        One data set. Of PosePairs the methods on pairs use all. Motions that were made from poses are clustered by
        pose, other motions by motion.
    method : str
        "efficient", "ml", or a name in `METHODS` or `ROBOT_WORLD_METHODS`.
    kind : "sandwich", "hac", "jackknife" or "bootstrap"
    X : (4, 4) or None
        The estimate of this method; None solves for it. Of no use to "efficient", "ml" and the methods with a W of
        their own.
    fit : Fit or None
        Of "efficient" and "ml", where it is at hand; None makes it with ``noise``.
    noise : PoseNoise, PairNoise or None
        What "efficient", "ml" and ``nguyen`` weight by.
    replicates, seed
        Of "bootstrap".

    Raises
    ------
    InputError
        An unknown method or kind; a kind that the method does not allow, with those it does; fewer than 7 clusters;
        poses whose noise is joint.
    DegenerateMotionError
        The data, or the data without one pose, do not determine X; or most bootstrap draws do not.
    NotConvergedError
        An iterative method did not converge.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> from uq_handeye.fit.empirical_covariance.resampled import resampled
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    >>> found = resampled(uq.simulate(n_poses=40, noise=noise, seed=1), "4dpa", "jackknife")
    >>> found.clusters, found.covariance_X.shape
    (40, (6, 6))
    """
    if kind not in KINDS:
        raise InputError(f"Expected `kind` to be one of {', '.join(KINDS)}, got {kind!r}.")
    known = (*ESTIMATORS, *METHODS, *ROBOT_WORLD_METHODS)
    if not isinstance(method, str) or method not in known:
        raise InputError(f"Expected `method` to be one of {', '.join(known)}, got {method!r}.")
    if not isinstance(data, PosePairs | Motions):
        raise InputError(f"Expected `data` to be PosePairs or Motions, got {type(data).__name__}.")
    first = data.robot if isinstance(data, PosePairs) else data.A
    if first.ndim != 3:
        raise InputError(f"Expected one data set, got leading axes {first.shape[:-3]}.")
    if method in ESTIMATORS:
        if fit is None:
            if noise is None:
                raise InputError(f"Method {method!r} weights by the noise: give `noise`, or the `fit`.")
            fit = ESTIMATORS[method](data, noise)
        return _of_fit(data, fit, kind, replicates, seed)
    at = None if X is None else as_transforms(X, "X", stack=False)
    return _of_method(Problem(data, method, at, noise), kind, replicates, seed)


def _of_fit(
    data: PosePairs | Motions, fit: Fit, kind: str, replicates: int, seed: int | np.random.Generator
) -> Resampled:
    if fit.W is None and isinstance(data, Motions) and data.poses is not None:
        raise InputError(
            "The fit was made on motions that share poses, so that no two of them are independent. Fit on the poses: "
            "give PoseNoise."
        )
    influence = influence_of(fit)
    if kind in ("sandwich", "hac"):
        result = _by_influence(influence, kind)
    elif kind == "jackknife":
        result = Resampled(
            kind, spread_of_deletions(deletions(influence)), influence.n, freedom=float(influence.freedom)
        )
    else:
        found = bootstrap(fit, replicates, seed)
        details = {"replicates": replicates, "singular": int(found.singular)}
        result = Resampled(kind, found.covariance, influence.n, freedom=float(influence.freedom), details=details)
    p = fit.covariance.shape[-1]
    cluster = "motions" if fit.W is None else "poses"
    return replace(result, cluster=cluster, covariance=result.covariance[:p, :p] + of_declared(fit))


def _of_method(problem: Problem, kind: str, replicates: int, seed: int | np.random.Generator) -> Resampled:
    cluster = "motions" if problem.poses is None else "poses"
    if kind in ("sandwich", "hac"):
        return replace(_by_influence(problem.influence(), kind), cluster=cluster)
    unknown_weights = problem.both is None and METHODS[problem.method].weighted and problem.noise is None
    freedom = None if unknown_weights else float(problem.influence().freedom)
    if kind == "jackknife":
        problem.require_all_pairs()
        moves, ok = _solved(problem, problem.deletions())
        require_dispensable(ok)
        return Resampled(kind, spread_of_deletions(moves), problem.n, cluster, freedom)
    problem.require_repeatable()
    moves, ok = _solved(problem, draws(problem.n, replicates, seed, problem.rows_at_once))
    moves = moves[ok]
    _require_most(np.asarray(len(moves)), replicates)
    details = {"replicates": replicates, "singular": replicates - len(moves)}
    return Resampled(kind, np.cov(moves.T), problem.n, cluster, freedom, details)


def _by_influence(influence: Influence, kind: str) -> Resampled:
    if kind == "sandwich":
        return Resampled(kind, influence.sandwich(), influence.n, freedom=float(influence.freedom))
    lags = influence.automatic_lags()
    freedom = float(hac_freedom(influence.freedom, lags))
    return Resampled(kind, influence.hac(lags), influence.n, freedom=freedom, details={"lags": int(lags)})


def _solved(problem: Problem, resampled_counts: Iterator[Counts]) -> tuple[Array, NDArray[np.bool_]]:
    """The moves (T, p) of X and W from the estimate, and which of them are determined."""
    moves, determined = [], []
    for counts in resampled_counts:
        found, ok = problem.solve_each(counts)
        moves.append(_moves(found, problem.at))
        determined.append(ok)
    return np.concatenate(moves), np.concatenate(determined)


def _moves(found: Solved, at: Solved) -> Array:
    """The errors (T, p) by which X and W differ from the estimate."""
    parts = []
    for T, reference in zip(found, at, strict=True):
        if T is not None and reference is not None:
            parts.append(Rotation.from_matrix(T[:, :3, :3] @ reference[:3, :3].T).as_rotvec())
            parts.append(T[:, :3, 3] - reference[:3, 3])
    return np.concatenate(parts, axis=1)
