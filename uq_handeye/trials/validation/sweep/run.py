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

Levels are computed one after the other, in this process; a folder keeps them (`resumable`).

Result of `sweep`.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ....core.files.records import attributes
from ....core.formatting.numbers import digits, rough
from ....core.geometry.checks import is_number
from ....core.presentation.document import Answer, Block, Cell, Document, Paragraph, Table, document_of
from ....core.runtime.progress import progress_bar
from ....core.runtime.threads import one_thread
from ....errors import InputError, InputWarning, keywords_of, require_integer, require_known
from ....model.noise.models import Noise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from ....model.poses.timing import warn_left_out
from ...simulation.experiment import Experiment, Fitted, experiment, problem_of
from ..monte_carlo.consistency import PARTS
from ..outcome import NoiseOfData, Outcome, limit_blocks, noise_of_data, one_of, place_of
from ..resumable import Kept, identity_of
from .level import (
    CONFIDENCE,
    KINDS,
    Level,
    Limit,
    MethodSweep,
    Task,
    Verdict,
    _ends,
    drawn,
    level_dict,
    level_of,
    limit_of,
)

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Sweep(Outcome):
    """Limits of first order and sigma points for some methods; see `sweep`."""

    title: ClassVar[str] = "Sweep of the noise"
    kind: ClassVar[str] = "sweep"

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
        return one_of({found.method: found for found in self.methods}, method, "`method` to be one of")

    def __repr__(self) -> str:
        ends = ", ".join(f"{found.method} {_ends(found.limit(KINDS[0]))}" for found in self.methods)
        return f"Sweep({self.trials:,} trials per level, covariance of the noise times a factor; first order: {ends})"

    @property
    def unfolded(self) -> int:
        """Number of blocks that notebooks show unfolded: the verdict and the sentences of the methods."""
        return 2 + len(self.methods)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and text, with units and convention."""
        found = self.head() | attributes(
            self, "frame around count item noise noise_estimated factors trials seed tolerance"
        )
        found |= {"confidence": CONFIDENCE, **attributes(self, "noise_of_data")}
        return found | {
            "methods": [
                {
                    "method": of.method,
                    "limits": {
                        kind: {"holds": (end := of.limit(kind)).holds, "fails": end.fails, "heavy_tails": end.heavy}
                        for kind in KINDS
                    },
                    "levels": [level_dict(level) for level in of.levels],
                }
                for of in self.methods
            ]
        }

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
# Bytes of a level that is kept, at most: of each trial, and of all else.
PER_TRIAL, BYTES = 6 * 8 + 1, 8192
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
    **kept: Any,
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
    directory : path or None
        Folder for the levels.
    resume : bool
        Go on with the levels in the folder after whatever ended the program, also with other methods and factors.
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
    require_known("sweep", kept, Kept)
    given, how = data, Kept(**kept)
    data, noise, estimated = problem_of(data, noise)
    warn_left_out("sweep()", data)
    names, grid = _checked(methods, factors, trials, seed, tolerance)
    trials, seed, tolerance = int(trials), int(seed), float(tolerance)
    problems: dict[str, Experiment] = {}
    for name in names:
        problems[name] = experiment(data, noise, name, pairs=pairs)
        noise = problems[name].noise  # estimated once, so that all methods see the same
    levels, notes = _levels(problems, grid, how, {"trials": trials, "seed": seed, "tolerance": tolerance})
    for note in notes:
        warnings.warn(note, InputWarning, stacklevel=2)
    problem, place = problems[names[0]], place_of(data)
    return Sweep(
        methods=tuple(MethodSweep(name, _ordered(levels[name])) for name in names),
        factors=grid,
        noise=problem.noise,
        noise_estimated=estimated,
        frame=place["frame"],
        count=problem.count,
        item="poses" if problem.on_poses else "motions",
        around=place["origin"],
        trials=trials,
        seed=seed,
        tolerance=tolerance,
        noise_of_data=noise_of_data(given, data, problem.noise, estimated),
    )


sweep.__signature__ = keywords_of(sweep, Kept)  # type: ignore[attr-defined]


def _levels(
    problems: dict[str, Experiment], grid: tuple[float, ...], how: Kept, of: dict[str, Any]
) -> tuple[dict[str, dict[float, Level]], tuple[str, ...]]:
    """Return the levels of each method by factor, those of the bisection among them, and notes on what was kept.

    ``of``: trials, seed and tolerance.
    """
    levels: dict[str, dict[float, Level]] = {name: {} for name in problems}
    wanted = [(name, factor) for name in problems for factor in grid]
    e = next(iter(problems.values()))
    identity = identity_of(
        e.truth, e.noise, {"X": e.X, "W": e.W, "pairs": e.pairs}, trials=of["trials"], seed=of["seed"]
    )
    with (
        one_thread(),
        closing(how.kept(identity, "sweep", pieces="levels")) as run,
        progress_bar("noise levels", None, "levels", how.progress) as advance,
    ):
        while wanted:
            for name, factor in wanted:
                task = Task(problems[name], factor, **of)
                found = run.piece(f"{name} {factor!r}", partial(drawn, task), BYTES + PER_TRIAL * task.trials)
                levels[name][factor] = level_of(task, found)
                advance(1)
            wanted = [(name, factor) for name in problems for factor in _next(levels[name])]
    return levels, run.notes


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
    if not (is_number(tolerance) and 0 < tolerance < 1):
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


# Deviations of the noise may grow by so much before a covariance fails: then the noise is well inside.
WELL = 2.0
# Methods that have a paragraph each on the first screen; of more there is the table.
FEW = 2
WHO = "A sweep"
# Mean errors from here on, in standard deviations, are worth a word.
BIASED = 0.5


@document_of.register(Sweep)
def sweep_document(result: Sweep, verbose: bool = False) -> Document:
    """Return the verdict, its limits and the noise each covariance is valid for; ``verbose``: all levels, too."""
    whose = "estimated from the data" if result.noise_estimated else "given"
    percent = f"{100 * result.tolerance:g} %"
    outside = any(not found.own.first_order.holds for found in result.methods)
    doubts = result.noise_of_data is not None and bool(result.noise_of_data.doubtful)
    start: list[Block] = [
        Answer(answer(result), "failed" if outside else "caution" if doubts else "ok"),
        *limit_blocks(WHO, result.noise_of_data, verbose),
    ]
    how = (
        f"The noise {whose}, its covariances times a factor, drawn {result.trials:,} times on {result.count} "
        f"{result.item} around the {result.around}, seed {result.seed}."
    )
    if not verbose:
        said = [Paragraph(verdict(found)) for found in result.methods] if len(result.methods) <= FEW else []
        end = f"{how} A covariance is valid while it describes the errors to within {percent}."
        limits: list[list[Cell]] = [
            [of.method, *(_short_limit(of.limit(kind)) for kind in KINDS)] for of in result.methods
        ]
        return [start, said, Table("", ["valid up to, times your sd", *KINDS], limits), Paragraph(end)]
    return [
        start,
        Paragraph(how),
        *([Paragraph(verdict(found)), _table(found)] for found in result.methods),
        Paragraph(
            "cov x, sd x: the noise, its covariances and its standard deviations as multiples of yours; all levels "
            "share their draws. bias: of the worst component, in standard deviations. NEES: mean, 6 if the covariance "
            "is consistent; of rotation (rot.) and translation (tr.) 3. errors: root mean square error over predicted "
            "standard deviation, smallest and largest in any direction. in 95 %: share of the errors in the 95 % "
            f"ellipsoid. A covariance fails where the errors differ from it by more than {percent} over all "
            "directions, in rotation or in translation, or where its 95 % ellipsoid holds as few (many) of them as if "
            f"it was wrong by {percent}, and chance does not explain it (99 %). The covariances are those at the true "
            "data; that of one data set scatters about them."
        ),
    ]


def answer(result: Sweep) -> str:
    """Return for which methods the first-order covariance is valid at the noise as it is."""
    inside = [found.method for found in result.methods if found.own.first_order.holds]
    outside = [found.method for found in result.methods if not found.own.first_order.holds]
    if not outside:
        return f"At this noise the first-order covariance is valid: {', '.join(inside)}."
    text = f"At this noise the first-order covariance is NOT valid: {', '.join(outside)}."
    return f"{text} It is valid for {', '.join(inside)}." if inside else text


def verdict(found: MethodSweep) -> str:
    """Return whether the noise is inside, what to do if not, and what goes wrong where."""
    first, second = (found.limit(kind) for kind in KINDS)
    own = found.own
    if own.first_order.holds:
        inside = "well inside" if math.sqrt(first.holds or 0.0) >= WELL else "inside"
        inside += ", but near the end" if inside == "inside" and first.fails is not None else ""
        said = [f"{found.method}: first order is valid {_reach(found, first)}; your own noise is {inside}."]
        if first.fails is not None:
            said.append(f"Beyond, it fails. {found.at(first.fails).first_order.failure}")
    else:
        said = [f"{found.method}: first order is not valid at your noise. {own.first_order.failure}"]
        if first.holds is not None:
            said.append(f"First order is valid {_reach(found, first)}.")
    if own.sigma_points.holds and first.fails is not None:
        use = "Sigma points are valid" if own.first_order.holds else "Use covariance='sigma-points', which is valid"
        said.append(f"{use} {_reach(found, second)}.")
        if second.fails is not None:
            level = found.at(second.fails)
            said.append(f"Beyond, both fail. {level.sigma_points.failure} {_why(level)}".rstrip())
    elif not own.sigma_points.holds:
        said.append(f"Sigma points are not valid at your noise. {own.sigma_points.failure} {_why(own)}".rstrip())
        if not own.first_order.holds:
            said.append("Reduce the noise, take more data, or use another method.")
    if own.heavy and own.sigma_points.holds and own.sigma_points.coverage is not None:
        said.append(
            f"At your noise the errors have heavy tails: {100 * own.sigma_points.coverage:.1f} % of them lie in the "
            "95 % ellipsoid of sigma points."
        )
    if own.bias is not None and own.bias > BIASED:
        said.append(
            f"At your noise X is biased by {own.bias:.2f} standard deviations; a mean square error includes that."
        )
    return " ".join(said)


def _short_limit(limit: Limit) -> str:
    if limit.holds is None:
        return "at no level"
    reach = digits(math.sqrt(limit.holds), 2)
    return f"{reach} (all tried)" if limit.fails is None else f"about {reach}" if limit.heavy else reach


def _reach(found: MethodSweep, limit: Limit) -> str:
    if limit.holds is None:
        return "at no level tried"
    if limit.fails is None:
        return f"at all levels tried, up to {_times(limit.holds)}"
    if limit.heavy:
        tails = rough(min(level.deviations for level in found.levels if level.heavy))
        return (
            f"up to about {_times(limit.holds, rough)}; from about {tails} times on errors have heavy tails, where it "
            "is chance whether a level passes"
        )
    return f"up to {_times(limit.holds)}"


def _times(factor: float, number: Callable[[float], str] | None = None) -> str:
    if factor == 1:
        return "your noise"
    deviations, covariances = (
        (digits(math.sqrt(factor), 2), digits(factor))
        if number is None
        else (number(math.sqrt(factor)), number(factor))
    )
    return f"{deviations} times your standard deviations ({covariances} times your covariances)"


def _why(level: Level) -> str:
    """Say what kind of errors these are."""
    if level.heavy:
        return (
            "The errors have heavy tails: rare large ones make up much of their spread, and no covariance says how "
            "often they occur."
        )
    if level.bias is not None and level.bias > BIASED:
        return f"X is biased by {level.bias:.2f} standard deviations."
    return ""


def _table(found: MethodSweep) -> Table:
    names = ["NEES", "rot.", "tr.", "errors", "in 95 %", ""]
    rows = []
    for level in found.levels:
        bias = "" if level.bias is None else f"{level.bias:.2f}"
        start = [digits(level.factor), digits(level.deviations), bias, f"{100 * level.failed:.2g} %"]
        rows.append([*start, *_cells(level.first_order), *_cells(level.sigma_points)])
    groups = [("noise times", 4), ("first order", 6), ("sigma points", 6)]
    return Table("", ["cov x", "sd x", "bias", "no X", *names, *names], rows, groups=groups, named=False)


def _cells(tested: Verdict) -> list[str]:
    word = "valid" if tested.holds else "FAILS"
    if tested.mean_nees is None or tested.worst is None or tested.coverage is None:
        return ["", "", "", "", "", word]
    least, largest = tested.worst
    return [
        *(_number(value) for value in tested.mean_nees),
        f"{_number(least)} {_number(largest)}",
        f"{100 * tested.coverage:.1f} %",
        word,
    ]


def _number(value: float) -> str:
    if value >= 1e4:
        return f"{value:.1e}".replace("e+0", "e")
    return f"{value:.2f}" if value < 100 else f"{value:.0f}"
