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

Result of `sweep`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...._version import __version__
from ....core.files.atomic import json_text
from ....core.files.records import attributes
from ....core.geometry.conventions import CONVENTION
from ....core.geometry.frames import SETUPS
from ....core.presentation.document import COLUMNS, WIDTH, document_of, to_text
from ....core.presentation.notebook import to_html
from ....core.runtime.progress import progress_bar
from ....core.runtime.threads import one_thread
from ....errors import InputError, require_integer
from ....model.noise.models import Noise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from ....model.poses.timing import warn_left_out
from ...simulation.experiment import Experiment, Fitted, experiment, problem_of
from ..monte_carlo.consistency import PARTS
from ..noise_of_data import NoiseOfData, noise_of_data
from .level import CONFIDENCE, KINDS, Level, MethodSweep, Task, _ends, level_at, level_dict, limit_of

if TYPE_CHECKING:
    import pandas as pd

_FORMAT = "uq-handeye sweep 1"


@dataclass(frozen=True, eq=False)
class Sweep:
    """Limits of first order and sigma points for some methods; see `sweep`."""

    methods: tuple[MethodSweep, ...]
    factors: tuple[float, ...]  # as asked for, and 1
    noise: Noise  # as it is, factor 1
    noise_estimated: bool
    frame: str  # of X
    count: int  # poses or motions
    item: str  # "poses" or "motions"
    around: str  # "truth of the simulation" or "fit to the data"
    trials: int
    seed: int
    tolerance: float
    noise_of_data: NoiseOfData | None = None  # checks of the noise against the data

    def __getitem__(self, method: str) -> MethodSweep:
        for found in self.methods:
            if found.method == method:
                return found
        known = ", ".join(found.method for found in self.methods)
        raise InputError(f"Expected `method` to be one of {known}, got {method!r}.")

    def __repr__(self) -> str:
        ends = ", ".join(f"{found.method} {_ends(found.limit(KINDS[0]))}" for found in self.methods)
        return f"Sweep({self.trials:,} trials per level, covariance of the noise times a factor; first order: {ends})"

    def _repr_html_(self) -> str:
        """Return the verdict and the sentences of the methods, with their levels folded, for notebooks."""
        return to_html("Sweep of the noise", document_of(self, verbose=True), seen=2 + len(self.methods))

    def summary(self, verbose: bool = False) -> str:
        """Return the noise that each covariance is valid for as text of 80 columns; ``verbose``: all levels, too."""
        return to_text(document_of(self, verbose=verbose), WIDTH if verbose else COLUMNS)

    def __str__(self) -> str:
        return self.summary()

    def figure(self, path: str | Path) -> Path:
        """Write the mean NEES against the noise as ``.png`` or ``.svg``."""
        from .figure import figure

        return figure(self, path)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and text, with units and convention."""
        return {
            "format": _FORMAT,
            "version": __version__,
            "convention": CONVENTION,
            "units": {"rotation": "rad", "translation": "m"},
            **attributes(self, "frame around count item noise noise_estimated factors trials seed tolerance"),
            "confidence": CONFIDENCE,
            **attributes(self, "noise_of_data"),
            "methods": [
                {
                    "method": found.method,
                    "limits": {
                        kind: {"holds": (end := found.limit(kind)).holds, "fails": end.fails, "heavy_tails": end.heavy}
                        for kind in KINDS
                    },
                    "levels": [level_dict(level) for level in found.levels],
                }
                for found in self.methods
            ],
        }

    def to_json(self, path: str | Path | None = None) -> str:
        """JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one row per method, level and kind of covariance; factors are of the noise covariance."""
        import pandas as pd

        rows = []
        for found in self.methods:
            for level in found.levels:
                row = level_dict(level)
                for kind in KINDS:
                    tested = row[kind]
                    nees = tested["mean_nees"] or [None] * len(PARTS)
                    worst = tested["worst"] or [None, None]
                    rows.append(
                        {
                            "method": found.method,
                            "factor": level.factor,
                            "sd_factor": level.deviations,
                            "kind": kind,
                            "holds": tested["holds"],
                            **{f"mean_nees_{part}": value for part, value in zip(PARTS, nees, strict=True)},
                            "least_ratio": worst[0],
                            "largest_ratio": worst[1],
                            "coverage_95": tested["coverage_95"],
                            "bias_sd": level.bias,
                            "failed": level.failed,
                            "heavy_tails": level.heavy,
                            "reason": tested["reason"],
                        }
                    )
        return pd.DataFrame(rows)


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
    >>> from uq_handeye.trials.validation.sweep.run import sweep
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
    poses = data.poses
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
