r"""Monte Carlo test of a covariance: noise is drawn many times, and X estimated from each draw.

Model: true poses (or motions), those of a simulation or, around real data, the maximum likelihood estimates; to them
errors ``xi = (theta, tau)`` drawn from the noise are added (`trials.experiment`). Each trial gives the error of its X,

    xi = ( log(R_hat R_true^T), t_hat - t_true )                    rotation first; rad and m; parent frame of X

and the covariance that is tested should equal the sampling covariance of these errors. The latter is exact in the
noise, apart from its own relative standard deviation of ``1 / sqrt(2 T)`` per standard deviation with T trials (JCGM
101 and 102). The tests are in `consistency`.

Trials run in chunks whose random numbers depend on the seed and their number only, added up in their order: the result
is the same, bit by bit, for any number of workers, for a run that was ended and resumed, and on a cluster (`chunks`).
"""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, closing
from dataclasses import dataclass
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ....core.files.json_values import Json
from ....core.geometry.checks import checked_covariance
from ....core.geometry.se3 import Array
from ....core.progress import progress_bar
from ....core.rounding import TINY
from ....core.threads import one_thread
from ....errors import InputError, InputWarning, keywords_of, require_integer, require_known, require_type
from ....findings import Finding
from ....model.errors.models import Noise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from ....model.poses.timing import warn_left_out
from ...simulation.experiment import Fitted, experiment, problem_of
from ..outcome import noise_of_data, place_of
from ..resumable import MAX_TRIALS, Run
from ..sentences import ALL, INTERRUPTED, STABLE, WORKERS_LOST
from .chunks import Chunk, Work, chunk_size, from_bytes, to_bytes
from .consistency import Sums, consistency
from .crew import Crew, WorkersLostError
from .result import MonteCarlo
from .stopping import BLOCK_TRIALS, Stability

__all__ = ["MonteCarlo", "monte_carlo"]

# Errors that are kept, trial by trial (48 MB), and trials where only the digits are given.
KEPT = 1_000_000
# More processes than any cluster has.
MAX_WORKERS = 10_000


@dataclass(frozen=True, kw_only=True)
class Running:
    """Workers of the trials of `monte_carlo`, the folder that stores them, and the display of progress.

    Nothing of it changes a number.
    """

    directory: str | os.PathLike[str] | None = None
    resume: bool = False
    progress: bool = False
    workers: int = 1
    executor: Executor | None = None

    def __post_init__(self) -> None:
        require_integer("workers", self.workers, 1)
        if self.workers > MAX_WORKERS:
            raise InputError(f"Expected `workers` to be at most {MAX_WORKERS:,}, got {self.workers:,}.")
        known = "a concurrent.futures.Executor, such as ProcessPoolExecutor() or distributed.Client().get_executor()"
        require_type("executor", self.executor, (Executor, NoneType), known)

    def kept(self, identity: Mapping[str, Json], kind: str, **more: Any) -> Run:
        """Return the run of that identity in the folder; parameters as for `Run`."""
        return Run(self.directory, identity, self.resume, kind, **more)


@dataclass(frozen=True, kw_only=True)
class Trials(Running):
    """Number of the trials of `monte_carlo`, and how they are run."""

    trials: int | None = None
    digits: int | None = None

    def __post_init__(self) -> None:
        trials = (BLOCK_TRIALS if self.digits is None else KEPT) if self.trials is None else self.trials
        require_integer("trials", trials, 2)
        if trials > MAX_TRIALS:
            raise InputError(f"Expected `trials` to be at most {MAX_TRIALS:,}, got {trials:,}.")
        if self.digits is not None and trials < BLOCK_TRIALS:
            raise InputError(f"Expected `trials` to be at least {BLOCK_TRIALS:,} with `digits`, got {trials:,}.")
        object.__setattr__(self, "trials", int(trials))
        super().__post_init__()


def monte_carlo(
    data: PosePairs | Motions | Fitted,
    *,
    noise: Noise | None = None,
    method: str = "4dpa",
    seed: int = 0,
    pairs: str | ArrayLike = "all",
    scale: float | None = None,
    covariance: str | ArrayLike | None = None,
    **how: Any,
) -> MonteCarlo:
    """The sampling covariance of a method, and whether a covariance predicts it.

    Ctrl-C ends it early: the result is then that of the trials so far, with ``complete=False``.

    Parameters
    ----------
    data : PosePairs, Motions or Calibration
        Simulated poses carry the truth around which noise is drawn; of others it is what maximum likelihood finds. A
        calibration gives the poses and the noise that it used (`Calibration.used`), in place of ``noise``.
    noise : PoseNoise, PairNoise or None
        None estimates it from the data.
    method : str
        ``efficient``, ``ml`` or a name in `METHODS` or `ROBOT_WORLD_METHODS`.
    trials : int or None
        At least 2; None is 10,000. With ``digits``, the most that are run; None is then 1,000,000.
    seed : int
        The same seed gives the same numbers, whatever the workers.
    workers : int
        Processes at most, this one among them; a run of about a second is done in this one alone. With ``executor``,
        the number of workers it has, which matters above 32.
    pairs, scale : as in `calibrate`
    covariance : None, "each" or (6, 6)
        What is tested: the first-order covariance of the method at the truth; that which every trial would report of
        itself; or one that is given.
    digits : int or None
        Stop when the result is stable to ``digits`` significant digits (1 to 4), after JCGM 102 (`stopping`).
    directory : path or None
        Folder for the chunks.
    resume : bool
        Go on with the chunks in the folder after whatever ended the program (`resumable`). With more ``trials`` than
        before it extends the run.
    executor : concurrent.futures.Executor or None
        Where to run in place of worker processes of its own: any executor, such as that of ``loky``, of
        ``mpi4py.futures``, or ``distributed.Client(...).get_executor()``. The first chunk is still done here. It is
        left open, with nothing more to do.
    progress : bool
        Show a bar on stderr if that is a terminal.

    Returns
    -------
    MonteCarlo
        ``errors`` (T, 6) of the trials that gave an estimate, in their order; of a longer run those among the first
        1,000,000 trials. Everything else is of all trials.

    Raises
    ------
    InputError
        Arguments that do not fit each other; a covariance that is singular, or out of all proportion; a folder that
        holds something else; workers that cannot be started or have other versions.
    DegenerateMotionError
        The data do not determine X.
    NotConvergedError
        The fit to real data did not converge.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> from uq_handeye.trials.validation.monte_carlo.run import monte_carlo
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> result = monte_carlo(uq.simulate(n_poses=20, noise=noise), noise=noise, trials=2000)
    >>> result.errors.shape, result.consistent
    ((2000, 6), True)
    """
    require_known("monte_carlo", how, Trials)
    run = Trials(**how)
    require_integer("seed", seed, 0)
    given, (data, noise, estimated) = data, problem_of(data, noise)
    warn_left_out("monte_carlo()", data)
    started = time.monotonic()
    with ExitStack() as stack:
        stack.enter_context(one_thread())
        problem = experiment(data, noise, method, pairs=pairs, scale=scale)
        tested, kind = _tested(covariance, problem.predicted)
        message = to_bytes(Work(problem, int(seed), run.trials or 0, chunk_size(problem), tested))
        work = from_bytes(message)
        kept = stack.enter_context(
            closing(run.kept(work.identity, "Monte Carlo run", asked=work.trials, size=work.chunk))
        )
        tally = Tally(work, run.digits)
        ended = _run(tally, message, kept, run)
        seconds = time.monotonic() - started
        checked = noise_of_data(given, data, problem.noise, estimated)
        said = {"noise_estimated": estimated, "noise_of_data": checked, "tested": kind, "seconds": seconds}
        result = _result(data, tally, kept, ended, **said)
        if kept.path is not None:
            kept.write("result.json", result.to_json().encode())
    for note in result.notes:
        warnings.warn(note, InputWarning, stacklevel=2)
    return result


monte_carlo.__signature__ = keywords_of(monte_carlo, Trials)  # type: ignore[attr-defined]


def _result(data: PosePairs | Motions, tally: Tally, kept: Run, ended: Finding, **said: Any) -> MonteCarlo:
    """Everything that is known of the trials in the end."""
    work, sums = tally.work, tally.sums
    if sums is None:
        raise InputError(f"No trial was done: {ended}.")
    own_mean = tally.own / sums.count if work.tested is None and sums.count else None
    judged = consistency(sums, own_mean if work.tested is None else work.tested, own=work.tested is None)
    stability = None if tally.stability is None else tally.stability.summary()
    return MonteCarlo(
        experiment=work.experiment,
        **place_of(data),
        seed=work.seed,
        chunk=work.chunk,
        asked=work.trials,
        errors=tally.errors,
        consistency=judged,
        stability=stability,
        ended=ended,
        resumed=tally.resumed,
        notes=kept.notes,
        **said,
    )


class Tally:
    """Tally of the chunks so far, taken in their order."""

    def __init__(self, work: Work, digits: int | None) -> None:
        self.work, self.stability = work, None if digits is None else Stability(digits)
        self.stable = False
        self.resumed = 0  # trials that were kept already
        self._errors = np.empty((min(work.trials, KEPT), 6))
        self._block: list[Chunk] = []
        # One object, so that an interrupt leaves the old one or the new one: sums, of own covariances, rows, trials.
        self._state: tuple[Sums | None, Array, int, int] = (None, np.zeros((6, 6)), 0, 0)

    @property
    def sums(self) -> Sums | None:
        return self._state[0]

    @property
    def own(self) -> Array:
        return self._state[1]

    @property
    def errors(self) -> Array:
        """Errors of those of the first `KEPT` trials that gave an estimate."""
        return self._errors[: self._state[2]].copy()

    def add(self, chunk: Chunk) -> None:
        sums, own, rows, trials = self._state
        among = slice(max(0, min(len(chunk.errors), len(self._errors) - trials)))
        kept = chunk.errors[among][chunk.ok[among]]
        self._errors[rows : rows + len(kept)] = kept
        total = chunk.sums if sums is None else sums + chunk.sums
        self._state = (total, own + chunk.own, rows + len(kept), trials + len(chunk.errors))
        if self.stability is not None:
            self._block.append(chunk)
            if len(self._block) * self.work.chunk == BLOCK_TRIALS:
                block, self._block = self._block, []
                if len(block[-1].errors) == self.work.chunk:  # not the last one, cut short
                    errors, ok = (
                        np.concatenate(parts) for parts in zip(*((c.errors, c.ok) for c in block), strict=True)
                    )
                    self.stability.add(errors, ok)
                    self.stable = self.stability.stable


def _run(tally: Tally, message: bytes, kept: Run, run: Trials) -> Finding:
    """Chunk after chunk into the tally, until it is enough; how it ended."""
    work = tally.work

    def stored(index: int) -> Chunk | None:
        chunk = kept.load(f"{index:06d}", Chunk.from_bytes, work.most_bytes)
        if chunk is None or len(chunk.errors) != work.size(index):  # the last one, before more trials were asked for
            return None
        tally.resumed += len(chunk.errors)
        return chunk

    def arrived(index: int, chunk: Chunk) -> None:
        if kept.path is not None:
            kept.save(f"{index:06d}", chunk.to_bytes())

    try:
        with ExitStack() as stack:
            crew = Crew(work, message, stored, arrived, int(run.workers), run.executor)
            chunks = stack.enter_context(closing(crew.chunks()))
            advance = stack.enter_context(progress_bar(work.experiment.method, work.trials, "trials", run.progress))
            for chunk in chunks:
                tally.add(chunk)
                advance(len(chunk.errors))
                if tally.stable:
                    assert tally.stability is not None
                    return Finding(STABLE, "note", {"digits": tally.stability.digits})
    except KeyboardInterrupt:
        if tally.sums is None:
            raise
        return Finding(INTERRUPTED, "caution")
    except WorkersLostError as error:
        return Finding(WORKERS_LOST, "failure", {"how": str(error)})
    return Finding(ALL, "note")


def _tested(covariance: str | ArrayLike | None, predicted: Callable[[], Array]) -> tuple[Array | None, str]:
    """The covariance that is tested, None where each trial has its own, and which it is."""
    if covariance is None:
        return np.ascontiguousarray(predicted()), "first order"
    if isinstance(covariance, str):
        if covariance != "each":
            raise InputError(f"Expected `covariance` to be None, 'each' or a (6, 6) array, got {covariance!r}.")
        return None, "each"
    S = checked_covariance(covariance, "covariance", joint=False)
    if S.shape != (6, 6):
        raise InputError(f"Expected `covariance` to be None, 'each' or a (6, 6) array, got shape {S.shape}.")
    variances, least = np.diag(S), TINY**0.2  # its fourth power is a number, and so is that of its inverse
    for name, wrong, limit in (
        ("small", variances[(variances > 0) & (variances < least)], least),
        ("large", variances[variances > 1 / least], 1 / least),
    ):
        if wrong.size:
            raise InputError(
                f"Expected the variances of `covariance` in rad^2 and m^2, got {wrong[0]:.3g}, which is too {name} "
                f"({'below' if name == 'small' else 'above'} {limit:.0e}) to weigh errors by."
            )
    return np.ascontiguousarray(S), "given"
