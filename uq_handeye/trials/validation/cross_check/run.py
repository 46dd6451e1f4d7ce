"""Cross-check of all covariances of one problem: formulas, Monte Carlo and posterior, and whether they agree.

Model: true poses (or motions) with Gaussian errors ``xi = (theta, tau)`` (left rotation, additive translation, rad and
m) of known covariance; every covariance here is of the error of X in the same convention, in its parent frame. The
truth is that of a simulation where the poses carry it; around real data it is the maximum likelihood estimate
(`trials.experiment`).

Rows from formulas are taken at that truth, to first order: 4DPA with pairs taken as independent (T3), pose-aware (T4)
and by (45) of the paper as printed; Nguyen and Pham's Sigma_R and Sigma_t as they give them, and the first-order
covariance of their estimator; the Cramer-Rao bound (T5). Those of `efficient` and `ml` are what these report at the
measured data. Sampled rows are the covariance of the errors of Monte Carlo trials about their mean (`monte_carlo`); the
posterior is that of the measured data (`posterior`). The mean NEES of a row with the covariance P is

    tr( P^-1 E[xi xi^T] )

over the trials of the method it belongs to: 6 if P is consistent, with the interval of chi-square for their number. The
relations that must hold between the rows are in `relations`.
"""

from __future__ import annotations

import time
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ....errors import InputError, keywords_of, require_integer, require_known
from ....model.errors.models import Noise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from ...simulation.experiment import Experiment, Fitted, experiment, motions_of, problem_of
from ..monte_carlo.consistency import MIN_TRIALS
from ..monte_carlo.run import MonteCarlo, Running
from ..monte_carlo.stopping import BLOCK_TRIALS
from ..outcome import noise_of_data, place_of
from ..resumable import identity_of
from .relations import Evidence, relations
from .rows import Row, all_sampled, effective_samples, formulas, judged, of_posterior

if TYPE_CHECKING:
    from ..posterior.result import Posterior
from . import text as text  # registers the text of a result
from .result import CrossCheck


def cross_check(
    data: PosePairs | Motions | Fitted,
    *,
    noise: Noise | None = None,
    pairs: str | ArrayLike = "all",
    trials: int = BLOCK_TRIALS,
    seed: int = 0,
    posterior: bool = True,
    **how: Any,
) -> CrossCheck:
    """Every covariance of X for one problem, and whether they agree as theory says they must.

    Parameters
    ----------
    data : PosePairs, Motions or Calibration
        Simulated poses carry the truth around which noise is drawn; of others it is what maximum likelihood finds. A
        calibration gives the poses and the noise that it used, in place of ``noise``.
    noise : PoseNoise, PairNoise or None
        None estimates it from the data.
    pairs : "all", "consecutive", "disjoint" or (N, 2) integers
        Pairs to make of the poses; Motions come with theirs.
    trials : int
        Of each method, at least 100. Where there are very many poses or pairs, the slower methods get fewer; their rows
        say so.
    seed : int
        Of trials and posterior.
    workers, executor : as in `monte_carlo`
    posterior : bool
        Sample the posterior too, which needs the extra ``posterior``.
    directory : path or None
        Folder for the trials of each method and the chain.
    resume : bool
        Go on with what is in the folder after whatever ended the program, with as many trials or more.
    progress : bool
        Show bars on stderr if that is a terminal.

    Returns
    -------
    CrossCheck
        What cannot be computed for the data has a row that says why. Ctrl-C during the trials or the posterior ends
        it early, and ``complete`` is False; before the first trial it raises ``KeyboardInterrupt``.

    Raises
    ------
    InputError
        Data and noise that do not fit each other; a wrong number of trials.
    DegenerateMotionError
        The data do not determine X.
    NotConvergedError
        The fit to real data, around which noise is drawn, did not converge.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> from uq_handeye.trials.validation.cross_check.run import cross_check
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> check = cross_check(uq.simulate(n_poses=12, noise=noise), noise=noise, trials=1000, posterior=False)
    >>> check.broken
    ()
    """
    require_known("cross_check", how, Running)
    started = time.monotonic()
    for name, value, least in (("trials", trials, MIN_TRIALS), ("seed", seed, 0)):
        require_integer(name, value, least)
    given, running = data, Running(**how)
    data, noise, estimated = problem_of(data, noise)
    measured = data
    if (noise is not None and noise.ITEM == "motion") or not np.array_equal(pairs, "all"):
        data = motions_of(data, pairs)
    problem = _problem(data, noise)
    noise = problem.noise
    problem.predicted()  # raises where the data do not determine X
    rows = formulas(data, problem)
    identity = identity_of(data, noise, {"pairs": problem.pairs, "X": problem.X}, seed=int(seed))
    with closing(running.kept(identity, "cross-check", pieces="", asked=int(trials))) as run:
        trial_rows, runs, ended = all_sampled(data, problem, int(trials), int(seed), running, run)
        rows += trial_rows
        chain: Posterior | None = None
        if posterior:
            row, chain, ended = of_posterior(data, noise, int(seed), run, running.progress, ended)
            rows.append(row)
    effective = None if chain is None else effective_samples(chain)
    rows_judged = tuple(judged(row, runs, effective if row.key == "posterior" else None) for row in rows)
    return CrossCheck(
        rows=rows_judged,
        relations=relations(_evidence(problem, rows_judged, runs, effective)),
        runs=runs,
        posterior=chain,
        X=problem.X,
        **place_of(data),
        noise=noise,
        noise_estimated=estimated,
        n=problem.count,
        pairs=problem.number_of_pairs,
        trials=int(trials),
        seed=int(seed),
        seconds=time.monotonic() - started,
        noise_of_data=noise_of_data(given, measured, noise, estimated),
        ended=ended,
    )


cross_check.__signature__ = keywords_of(cross_check, Running)  # type: ignore[attr-defined]


def _problem(data: PosePairs | Motions, noise: Noise | None) -> Experiment:
    """Return the exact data and the noise that is drawn on them; raises `InputError` for a prior."""
    if noise is not None and noise.prior is not None:
        raise InputError(
            "The cross-check compares methods that take no prior of X or W, which the noise has. Test efficient or ml "
            "by monte_carlo() (validate), or see the posterior."
        )
    return experiment(data, noise)


def _evidence(
    problem: Experiment, rows: tuple[Row, ...], runs: dict[str, MonteCarlo], effective: int | None
) -> Evidence:
    """Return what the relations are judged by."""
    of_poses = problem.on_poses
    return Evidence(
        covariances={row.key: row.covariance for row in rows if row.covariance is not None},
        missing={row.key: f"{row.label}: none. {row.note}" for row in rows if row.covariance is None},
        runs=runs,
        effective=effective,
        on_poses=of_poses,
        shared=of_poses and (problem.pairs is None or len(np.unique(problem.pairs)) < problem.pairs.size),
        all_pairs=problem.pairs is None,
        pairs=problem.number_of_pairs,
    )
