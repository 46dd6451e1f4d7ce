r"""The rows of a cross-check: each covariance with its computing time, its judgement, or the reason why it is missing.

Model: as in `cross_check`. Formulas are to first order at the truth of the `Experiment`; (45) and Nguyen and Pham's own
covariances take the noise of each pair only, which follows from the noise on poses to first order (`noise_of_pairs`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import block_diag

from ....core.files.json_values import JsonObject
from ....core.files.records import attributes
from ....core.geometry.se3 import Array
from ....core.levels import DOUBTFUL
from ....core.read_only import ReadOnlyArrays
from ....core.rounding import HALF_DIGITS
from ....errors import InputError, NotConvergedError
from ....findings import Finding
from ....fit.graph.gauss_helmert import ESTIMATORS
from ....methods.nguyen import nguyen
from ....methods.noise_transport import noise_of_pairs
from ....methods.paper_covariances import PAPER_SCALE, literal_covariance
from ....model.errors.models import Noise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from ...simulation.experiment import Experiment
from ..monte_carlo.consistency import MIN_TRIALS, nees_interval
from ..monte_carlo.run import MonteCarlo, Running, monte_carlo
from ..resumable import NotKeptError, Run
from ..sentences import INTERRUPTED

if TYPE_CHECKING:
    from ..posterior.result import Posterior

NAMES = {"4dpa": "4DPA", "nguyen": "Nguyen and Pham", "efficient": "efficient", "ml": "ml"}
METHODS = tuple(NAMES)
# Poses or pairs of all trials of one method together, which take about a minute; beyond it there are fewer trials.
MAX_POSES_OF_TRIALS = 5_000_000
# Pairs that trials of Nguyen and Pham take, all of them in each; and pairs that are formed at all.
MAX_PAIRS_OF_NGUYEN, MAX_PAIRS = 20_000, 200_000
TOO_MANY = "{:,} pairs are too many for it: give Motions of fewer."


@dataclass(frozen=True, eq=False)
class Row(ReadOnlyArrays):
    """One covariance of X."""

    key: str
    label: str
    kind: str  # "analytic", "sampled" or "posterior"
    method: str  # by whose trials it is judged
    covariance: Array | None  # (6, 6); None: see `note`
    seconds: float
    trials: int | None = None  # of a sampled row
    failures: int | None = None
    nees: float | None = None  # mean over the trials of the method; None of a sampled row, which is made of them
    nees_interval: tuple[float, float] | None = None  # where that of a consistent covariance lies, 99 %
    note: str = ""  # why there is none, or what to know about it

    @property
    def std(self) -> Array | None:
        """(6,) in rad and m."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance))

    @property
    def trace_rotation(self) -> float | None:
        """Sum of the variances of rotation, rad^2."""
        return None if self.covariance is None else float(np.trace(self.covariance[:3, :3]))

    @property
    def trace_translation(self) -> float | None:
        """Sum of the variances of translation, m^2."""
        return None if self.covariance is None else float(np.trace(self.covariance[3:, 3:]))

    @property
    def log_determinant(self) -> float | None:
        """Natural logarithm, in rad and m; None of a covariance that is singular (to rounding)."""
        if self.covariance is None or self.singular:
            return None
        return float(np.linalg.slogdet(self.covariance)[1])

    @property
    def singular(self) -> bool:
        """True if it leaves no error in some direction of X, up to rounding."""
        if self.covariance is None or self.std is None:
            return False
        if not (self.std > 0).all():
            return True
        return is_singular(self.covariance)

    @property
    def consistent(self) -> bool | None:
        """True if the mean NEES lies where that of a consistent covariance does."""
        if self.nees is None or self.nees_interval is None:
            return None
        low, high = self.nees_interval
        return low <= self.nees <= high

    def to_dict(self) -> JsonObject:
        """Plain values in rad, m and s."""
        return attributes(
            self,
            "key label kind method covariance std trace_rotation trace_translation log_determinant nees nees_interval "
            "consistent trials failures seconds note",
        )


def is_singular(covariance: Array) -> bool:
    """Return whether the correlation matrix of a covariance is singular up to rounding.

    (45) is computed to about ``eps d^2``, the square root of eps; eight times that is rounding.
    """
    std = np.sqrt(np.diag(covariance))
    return bool(np.linalg.eigvalsh(covariance / np.outer(std, std))[0] < 8 * HALF_DIGITS)


def formulas(data: PosePairs | Motions, problem: Experiment) -> list[Row]:
    """Return the formulas at the truth, and of `efficient` and `ml` at the data."""
    noise, theirs = problem.noise, replace(problem, method="nguyen")
    N = problem.number_of_pairs
    too_many = TOO_MANY.format(N) if N > MAX_PAIRS else ""
    rows = [_row("4dpa-pairs", "4DPA, pairs independent", "4dpa", lambda: problem.predicted("pairs"), too_many)]
    if problem.on_poses:
        rows.append(_row("4dpa-poses", "4DPA, pose-aware", "4dpa", lambda: problem.predicted("poses")))
    own = "Sigma_R and Sigma_t as they give them: no cross-covariance, pairs taken as independent."
    rows += [
        _row("4dpa-literal", "4DPA, (45) as printed", "4dpa", lambda: _literal(problem), too_many),
        _row("nguyen-own", "Nguyen and Pham, own", "nguyen", lambda: _own(theirs), too_many, own),
        _row("nguyen-first-order", "Nguyen and Pham, first order", "nguyen", theirs.predicted, too_many),
    ]
    for name, estimator in ESTIMATORS.items():
        fit = partial(lambda of: of(data, noise).covariance_X, estimator)
        rows.append(_row(name, f"{name}, at the data", name, fit))
    return [*rows, _row("bound", "Cramer-Rao bound", "ml", replace(problem, method="ml").predicted)]


def _row(
    key: str, label: str, method: str, work: Callable[[], Array | None], too_many: str = "", note: str = ""
) -> Row:
    """Return the row of the work's result, or of the reason why there is none."""
    started = time.perf_counter()
    covariance: Array | None = None
    try:
        covariance, note = (None, too_many) if too_many else (work(), note)
    except (InputError, NotConvergedError, np.linalg.LinAlgError) as error:
        if isinstance(error, NotKeptError):
            raise
        note = str(error)
    return Row(key, label, "analytic", method, covariance, time.perf_counter() - started, note=note)


def _literal(problem: Experiment) -> Array:
    """(45) needs the noise of each pair; at the true X."""
    motions = problem.motions
    noise = noise_of_pairs(motions, problem.noise)
    S = literal_covariance(motions.A, motions.B, noise, problem.X[None], PAPER_SCALE)[0]
    return np.asarray(0.5 * (S + S.T))


def _own(problem: Experiment) -> Array:
    """Nguyen and Pham's Sigma_R and Sigma_t at the true motions, zeros between them."""
    found = nguyen(problem.motions.A, problem.motions.B, problem.weights)
    if not found.converged:
        raise NotConvergedError("Nguyen and Pham's iteration did not converge on the true motions.", found)
    return block_diag(found.Sigma_R, found.Sigma_t)


def all_sampled(
    data: PosePairs | Motions, problem: Experiment, trials: int, seed: int, running: Running, run: Run
) -> tuple[list[Row], dict[str, MonteCarlo], Finding | None]:
    """A row of trials of each method, the runs, and how they ended if that was early.

    Ctrl-C leaves out what comes after it; before the first trial it passes through.
    """
    rows: list[Row] = []
    runs: dict[str, MonteCarlo] = {}
    ended: Finding | None = None
    options = {"workers": running.workers, "executor": running.executor, "progress": running.progress, "seed": seed}
    for method, name in NAMES.items():
        options |= run.within(method)
        empty = Row(f"{method}-sampled", f"{name}, Monte Carlo", "sampled", method, None, 0.0)
        if ended is None:
            try:
                rows.append(_sampled(data, replace(problem, method=method), trials, empty, runs, options))
            except KeyboardInterrupt:
                if not runs:
                    raise
                ended = Finding(INTERRUPTED, "caution")
            else:
                ended = next((run.ended for run in runs.values() if not run.complete), None)
                continue
        rows.append(replace(empty, note=_NOT_RUN.format(ended)))
    return rows, runs, ended


_NOT_RUN = "Not run: the trials ended before ({})."


def _sampled(
    data: PosePairs | Motions,
    problem: Experiment,
    trials: int,
    empty: Row,
    runs: dict[str, MonteCarlo],
    options: dict[str, Any],
) -> Row:
    """Trials of one method, which are kept in ``runs``."""
    method, size = problem.method, problem.size
    if method == "nguyen" and size > MAX_PAIRS_OF_NGUYEN:
        return replace(empty, note=TOO_MANY.format(size))
    affordable = min(trials, max(MIN_TRIALS, MAX_POSES_OF_TRIALS // size))

    def work() -> Array | None:
        runs[method] = monte_carlo(data, noise=problem.noise, method=method, trials=affordable, **options)
        covariance: Array | None = runs[method].covariance
        return covariance

    row = replace(_row(empty.key, empty.label, method, work), kind="sampled")
    if (run := runs.get(method)) is None:
        return row
    note = ""
    if not run.complete:
        note = f"Ended early: {run.reason}."
    elif affordable < trials:
        what = "pairs" if problem.forms_pairs else "poses" if problem.truth.poses is problem.truth else "motions"
        note = f"{affordable:,} trials in place of {trials:,}, as there are {size:,} {what} in each."
    if run.covariance is None:
        note = f"{note} Fewer than two trials gave an estimate.".strip()
    return replace(row, seconds=run.seconds, trials=run.trials, failures=run.failures, note=note)


def of_posterior(
    data: PosePairs | Motions, noise: Noise, seed: int, run: Run, progress: bool, ended: Finding | None
) -> tuple[Row, Posterior | None, Finding | None]:
    """Sample the posterior of the measured data; return also how the whole ended if that was early; ``ended``: before
    this.
    """
    empty = Row("posterior", "posterior (emcee)", "posterior", "ml", None, 0.0)
    if ended is not None:
        return replace(empty, note=_NOT_RUN.format(ended)), None, ended
    from ..posterior.sample import sample_posterior

    chains: list[Posterior] = []

    def work() -> Array:
        chain = run.within("chain.h5", "file")
        chains.append(sample_posterior(data, noise=noise, seed=seed, progress=progress, **chain))
        return chains[0].covariance

    try:
        row = _row(empty.key, empty.label, "ml", work, note="Of the measured data; flat prior on X.")
    except KeyboardInterrupt:
        ended = Finding(INTERRUPTED, "caution")
        row = replace(empty, note=f"Ended early: {ended}.")
    return replace(row, kind="posterior"), chains[0] if chains else None, ended


def effective_samples(chain: Posterior) -> int:
    """Effective samples of the worst coordinate of X, bulk or tail."""
    d = chain.diagnostics
    return int(min(d.ess_bulk[:6].min(), d.ess_tail[:6].min()))


def judged(row: Row, runs: dict[str, MonteCarlo], effective: int | None) -> Row:
    """Judged by the trials of its method; a covariance that is itself of ``effective`` samples adds their error."""
    run = runs.get(row.method)
    if row.covariance is None or row.kind == "sampled" or run is None or run.consistency.second_moment is None:
        return row
    if row.singular:
        note = f"{row.note} Singular: it leaves no error at all in some direction, which no NEES can judge.".strip()
        return replace(row, note=note)
    unit = np.sqrt(np.diag(row.covariance))
    both = (row.covariance, run.consistency.second_moment)
    P, moment = (M / np.outer(unit, unit) for M in both)
    T = float(run.consistency.sums.count)
    if effective is not None:
        T = 1 / (1 / T + 1 / effective)
    low, high = nees_interval(T, 6, 1 - DOUBTFUL.probability)
    return replace(row, nees=float(np.trace(np.linalg.solve(P, moment))), nees_interval=(float(low), float(high)))
