r"""One problem, every covariance: formulas, Monte Carlo and posterior side by side, and whether they agree.

Model: true poses (or motions) with Gaussian errors ``xi = (theta, tau)`` (left rotation, additive translation, rad and
m) of known covariance; every covariance here is of the error of X in the same convention, in its parent frame. The
truth is that of a simulation where the poses carry it; around real data it is what maximum likelihood finds
(`trials.experiment`).

Rows from formulas are taken at that truth, to first order: 4DPA with pairs taken as independent (T3), pose-aware (T4)
and by (45) of the paper as printed; Nguyen and Pham's Sigma_R and Sigma_t as they give them, and the first-order
covariance of their estimator; the Cramer-Rao bound (T5). Those of `efficient` and `ml` are what these report at the
measured data. Sampled rows are the covariance of the errors of Monte Carlo trials about their mean (`monte_carlo`); the
posterior is that of the measured data (`posterior`). The mean NEES of a row with the covariance P is

    tr( P^-1 E[xi xi^T] )

over the trials of the method it belongs to: 6 if P is true, with the interval of chi-square for their number. How the
rows must relate: `relations`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import __version__
from ...calibration.result_file import noise_to_dict
from ...errors import InputError, require_integer
from ...files.atomic import json_text
from ...geometry.conventions import CONVENTION
from ...noise.models import Noise, PairNoise, PoseNoise
from ...poses.motions import Motions, relative_motions
from ...poses.pose_pairs import SETUPS, PosePairs
from ...simulation.experiment import experiment
from ..monte_carlo.run import MonteCarlo
from .relations import Evidence, Relation, relations
from .rows import FEWEST_TRIALS, Row, all_sampled, effective_samples, formulas, judged, of_posterior

if TYPE_CHECKING:
    import pandas as pd

    from ..posterior.sample import Posterior

_FORMAT = "uq-handeye cross-check 1"


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """Every covariance of one problem and what they have to do with each other; see `cross_check`."""

    rows: tuple[Row, ...]
    relations: tuple[Relation, ...]
    runs: dict[str, MonteCarlo]  # by method
    posterior: Posterior | None
    frame: str  # of X, e.g. gripper_T_camera
    setup: str | None  # None for motions
    origin: str  # "truth of the simulation" or "fit to the data"
    noise: Noise
    noise_estimated: bool
    n: int  # poses, or motions
    pairs: int
    trials: int  # asked of every method
    seed: int
    seconds: float
    complete: bool = True  # whether all trials that were wanted, and the posterior, were done
    reason: str = ""  # why not, e.g. "interrupted"

    @property
    def broken(self) -> tuple[str, ...]:
        """Names of the relations that must hold and do not; claims are not among them."""
        return tuple(relation.name for relation in self.relations if relation.law and relation.holds is False)

    def row(self, key: str) -> Row:
        """By its key. Raises `InputError` with the keys there are."""
        for row in self.rows:
            if row.key == key:
                return row
        raise InputError(f"Expected the key of a row, one of {', '.join(row.key for row in self.rows)}, got {key!r}.")

    def relation(self, name: str) -> Relation:
        """By its name. Raises `InputError` with the names there are."""
        for relation in self.relations:
            if relation.name == name:
                return relation
        names = ", ".join(relation.name for relation in self.relations)
        raise InputError(f"Expected the name of a relation, one of {names}, got {name!r}.")

    def __repr__(self) -> str:
        state = f"broken: {', '.join(self.broken)}" if self.broken else "no relation broken"
        state += "" if self.complete else f"; not complete: {self.reason}"
        return f"CrossCheck({len(self.rows)} rows, {self.trials:,} trials, {state})"

    def _repr_html_(self) -> str:
        """For notebooks."""
        from ...presentation.notebook import text_html

        return text_html("Cross-check", repr(self), self.to_text())

    def to_text(self) -> str:
        """Which relations hold, the table, and what is behind it."""
        from .text import to_text

        return to_text(self)

    summary = to_text

    def figure(self, path: str | Path) -> None:
        """Write the ellipses of all 15 pairs of components as PNG or SVG, by the ending of the name."""
        from .figure import save

        save(self, path)

    def to_dict(self) -> dict[str, Any]:
        """Everything but single trials and samples as plain numbers, lists and text, with units and convention."""
        return {
            "format": _FORMAT,
            "version": __version__,
            "convention": CONVENTION,
            "units": {"rotation": "rad", "translation": "m", "time": "s"},
            "frame": self.frame,
            "setup": self.setup,
            "origin": self.origin,
            "noise": noise_to_dict(self.noise),
            "noise_estimated": self.noise_estimated,
            "n": self.n,
            "pairs": self.pairs,
            "trials": self.trials,
            "seed": self.seed,
            "seconds": self.seconds,
            "complete": self.complete,
            "reason": self.reason,
            "broken": list(self.broken),
            "rows": [row.to_dict() for row in self.rows],
            "relations": [relation.to_dict() for relation in self.relations],
        }

    def to_json(self, path: str | Path | None = None) -> str:
        """JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one line per row, in rad, m and s; what there is not is missing."""
        import pandas as pd

        names = [f"std_{part}_{axis}" for part in ("rotation", "translation") for axis in "xyz"]
        lines = []
        for row in self.rows:
            plain = row.to_dict()
            std, interval = plain.pop("std"), plain.pop("nees_interval")
            del plain["covariance"]
            plain |= dict(zip(names, std or [None] * 6, strict=True))
            plain |= dict(zip(("nees_low", "nees_high"), interval or (None, None), strict=True))
            lines.append(plain)
        return pd.DataFrame(lines).set_index("key")


def cross_check(
    data: PosePairs | Motions,
    *,
    noise: Noise | None = None,
    trials: int = 10_000,
    seed: int = 0,
    workers: int = 1,
    posterior: bool = True,
    progress: bool = False,
) -> CrossCheck:
    """Every covariance of X for one problem, and whether they agree as theory says they must.

    Parameters
    ----------
    data : PosePairs or Motions
        Simulated poses carry the truth around which noise is drawn; of others it is what maximum likelihood finds. All
        pairs of poses are used; Motions come with theirs.
    noise : PoseNoise, PairNoise or None
        None estimates it from the data.
    trials : int
        Of each method, at least 100. Where there are very many poses or pairs, the slower methods get fewer; their rows
        say so.
    seed : int
        Of trials and posterior.
    workers : int
        Processes for the trials.
    posterior : bool
        Sample the posterior too, which needs the extra ``posterior``.
    progress : bool
        Show bars on stderr if that is a terminal.

    Returns
    -------
    CrossCheck
        What cannot be worked out for the data has a row that says why. Ctrl-C during the trials or the posterior ends
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
    >>> from uq_handeye.validation.cross_check.run import cross_check
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> check = cross_check(uq.simulate(n_poses=12, noise=noise), noise=noise, trials=1000, posterior=False)
    >>> check.broken
    ()
    """
    started = time.monotonic()
    for name, value, least in (("trials", trials, FEWEST_TRIALS), ("seed", seed, 0), ("workers", workers, 1)):
        require_integer(name, value, least)
    if isinstance(noise, PairNoise) and isinstance(data, PosePairs):
        data = relative_motions(data, "all")
    estimated = noise is None
    problem = experiment(data, noise)
    noise, poses = problem.noise, data if isinstance(data, PosePairs) else data.poses
    problem.predicted()  # raises where the data do not determine X
    rows = formulas(data, problem)
    trial_rows, runs, ended = all_sampled(data, problem, int(trials), int(seed), int(workers), progress)
    rows += trial_rows
    chain: Posterior | None = None
    if posterior:
        row, chain, ended = of_posterior(data, noise, int(seed), progress, ended)
        rows.append(row)
    effective = None if chain is None else effective_samples(chain)
    rows_judged = tuple(judged(row, runs, effective if row.key == "posterior" else None) for row in rows)
    N = problem.number_of_pairs
    evidence = Evidence(
        covariances={row.key: row.covariance for row in rows_judged if row.covariance is not None},
        missing={row.key: f"{row.label}: none. {row.note}" for row in rows_judged if row.covariance is None},
        runs=runs,
        effective=effective,
        on_poses=isinstance(noise, PoseNoise),
        shared=isinstance(noise, PoseNoise)
        and (problem.pairs is None or len(np.unique(problem.pairs)) < problem.pairs.size),
        all_pairs=problem.pairs is None,
        pairs=N,
    )
    return CrossCheck(
        rows=rows_judged,
        relations=relations(evidence),
        runs=runs,
        posterior=chain,
        frame="X" if poses is None else SETUPS[poses.setup],
        setup=None if poses is None else poses.setup,
        origin="fit to the data" if poses is None or poses.truth is None else "truth of the simulation",
        noise=noise,
        noise_estimated=estimated,
        n=problem.count,
        pairs=N,
        trials=int(trials),
        seed=int(seed),
        seconds=time.monotonic() - started,
        complete=not ended,
        reason=ended,
    )
