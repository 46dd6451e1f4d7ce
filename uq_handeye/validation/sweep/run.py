r"""The noise at which first order ends, and how much farther sigma points reach.

Model: the covariance of the noise times a factor f (its standard deviations times the root of f), drawn on the same
true data; everywhere the same random numbers, scaled, so that levels are not independent of each other. At each f the
errors ``xi`` of T trials of a method are held against two covariances at the true data: first order, ``f P`` with P
that of the noise as it is, and sigma points (`sigma_points`), the mean square about the truth.
With ``M = mean of xi xi^T`` (about the truth: a bias counts, as it does for whoever uses X)

    mean NEES = tr(P^-1 M),  6 if P is true;    of rotation and translation with their blocks, 3

so that ``sqrt(mean NEES / 6)`` is by how much errors are larger than predicted, over all directions, and the square
roots of the eigenvalues of ``P^-1 M`` are the least and the largest such ratio in a single direction.

A covariance *fails* at f if, for the joint error, rotation or translation,

- that ratio is above ``1 + tolerance`` or below ``1 / (1 + tolerance)``, which matters, and the mean NEES lies outside
  the interval of the chi-square distribution (99 %), which is no chance;
- or the 95 % ellipsoid holds fewer (more) of the errors than if standard deviations were so much too small (large) and
  errors Gaussian, 89.1 % to 98.2 % of the joint errors with a tolerance of 0.1, and 95 % is outside the interval of
  Clopper and Pearson: where tails are heavy, no covariance tells what happens, though the mean square be right;
- or more than `consistency.MOST_FAILED` of the trials, or any sigma point, give no X.

Where it fails first is found by bisection on a logarithmic scale between the last factor given at which it holds and
the first at which it does not, to 5 % of the standard deviation. Where tails are heavy there, it is chance whether a
level near it passes, and the limit has that precision no more (`Limit.heavy`).

A sweep takes seconds: levels are computed one after the other, in this process.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError, require_integer
from ...geometry.frames import SETUPS
from ...noise.models import Noise
from ...poses.motions import Motions
from ...poses.pose_pairs import PosePairs
from ...poses.timing import warn_left_out
from ...runtime.progress import progress_bar
from ...runtime.threads import one_thread
from ...simulation.experiment import Experiment, Fitted, experiment, problem_of
from ..noise_of_data import noise_of_data
from .level import KINDS, Level, Task, level_at
from .limits import MethodSweep, limit_of
from .result import Sweep

FACTORS = (1.0, 3.0, 10.0, 30.0, 100.0)
# Ratio of two factors between which no third is looked at.
CLOSE = 1.1


def sweep(
    data: PosePairs | Motions | Fitted,
    *,
    noise: Noise | None = None,
    methods: str | Iterable[str] = ("4dpa", "efficient"),
    factors: ArrayLike = FACTORS,
    trials: int = 2_000,
    seed: int = 0,
    tolerance: float = 0.1,
    pairs: str | ArrayLike = "all",
    progress: bool = False,
) -> Sweep:
    """Find the noise at which each covariance of each method fails its test, and whether the noise given is inside.

    Parameters
    ----------
    data : PosePairs, Motions or Calibration
        Noise is drawn around the truth where poses carry one, else around the data as maximum likelihood fits them. A
        calibration gives the poses and the noise that it used, in place of ``noise``.
    noise : PoseNoise, PairNoise or None
        Factor 1. None estimates it from the data.
    methods : a name or names as for `calibrate`
    factors : numbers above 0
        Of the covariance of the noise: 100 is 10 times the standard deviations. 1 is added if it is not there.
    trials : int
        At each level, at least 100.
    seed : int
        The same seed gives the same numbers; at factor 1 the trials are those of `monte_carlo`.
    tolerance : float
        Relative error of standard deviations that matters.
    pairs : as for `calibrate`
    progress : bool
        Show a bar on stderr if that is a terminal.

    Returns
    -------
    Sweep

    Raises
    ------
    InputError
        Arguments that do not fit each other; a method without a covariance for this noise.
    DegenerateMotionError
        The data do not determine X.
    NotConvergedError
        The fit to real data did not converge.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> from uq_handeye.validation.sweep.run import sweep
    >>> noise = uq.PoseNoise.isotropic(camera=("1deg", "1mm"))
    >>> found = sweep(uq.simulate(n_poses=10, noise=noise), noise=noise, methods=["4dpa"], factors=[1, 900], trials=500)
    >>> found["4dpa"].own.first_order.holds, found["4dpa"].at(900).first_order.holds
    (True, False)
    """
    given = data
    data, noise, estimated = problem_of(data, noise)
    warn_left_out("sweep()", data)
    names, grid = _checked(methods, factors, trials, seed, tolerance)
    trials, seed, tolerance = int(trials), int(seed), float(tolerance)
    problems: dict[str, Experiment] = {}
    for name in names:
        problems[name] = experiment(data, noise, name, pairs=pairs)
        noise = problems[name].noise  # estimated once, so that all methods see the same
    levels: dict[str, dict[float, Level]] = {name: {} for name in names}
    wanted = [(name, factor) for name in names for factor in grid]
    with one_thread(), progress_bar("noise levels", None, "levels", progress) as advance:
        while wanted:
            for name, factor in wanted:
                levels[name][factor] = level_at(Task(problems[name], factor, trials, seed, tolerance))
                advance(1)
            wanted = [(name, factor) for name in names for factor in _next(levels[name])]
    poses = data if isinstance(data, PosePairs) else data.poses
    problem = problems[names[0]]
    return Sweep(
        methods=tuple(MethodSweep(name, _ordered(levels[name])) for name in names),
        factors=grid,
        noise=problem.noise,
        noise_estimated=estimated,
        frame="X" if poses is None else SETUPS[poses.setup],
        count=problem.count,
        item="poses" if isinstance(problem.truth, PosePairs) else "motions",
        around="fit to the data" if poses is None or poses.truth is None else "truth of the simulation",
        trials=trials,
        seed=seed,
        tolerance=tolerance,
        noise_of_data=noise_of_data(given, data, problem.noise, estimated),
    )


def _checked(methods: Any, factors: Any, trials: Any, seed: Any, tolerance: Any) -> tuple[list[str], tuple[float, ...]]:
    names = [methods] if isinstance(methods, str) else list(methods) if isinstance(methods, Iterable) else [methods]
    if not all(isinstance(name, str) for name in names):
        raise InputError(f"Expected `methods` to be a name or names of methods such as '4dpa', got {methods!r}.")
    names = list(dict.fromkeys(names))
    if not names:
        raise InputError("Expected `methods` to name at least one method, got none.")
    require_integer("trials", trials, 100)
    require_integer("seed", seed, 0)
    try:
        grid = np.unique(np.append(np.asarray(factors, dtype=float).ravel(), 1.0))
    except (TypeError, ValueError):
        raise InputError(f"Expected `factors` to be numbers, got {factors!r}.") from None
    if not (np.isfinite(grid).all() and grid[0] > 0):
        raise InputError(f"Expected `factors` to be finite and above 0, got {factors!r}.")
    number = isinstance(tolerance, float | int | np.floating) and not isinstance(tolerance, bool)
    if not (number and 0 < tolerance < 1):
        raise InputError(f"Expected `tolerance` to be a number between 0 and 1 such as 0.1, got {tolerance!r}.")
    return names, tuple(grid.tolist())


def _ordered(levels: dict[float, Level]) -> tuple[Level, ...]:
    return tuple(levels[factor] for factor in sorted(levels))


def _next(levels: dict[float, Level]) -> list[float]:
    """Return the factors at which bisection looks next, for either kind."""
    found = set()
    for kind in KINDS:
        limit = limit_of(_ordered(levels), kind)
        if limit.holds is not None and limit.fails is not None and limit.fails / limit.holds > CLOSE:
            found.add(math.sqrt(limit.holds * limit.fails))
    return sorted(found)
