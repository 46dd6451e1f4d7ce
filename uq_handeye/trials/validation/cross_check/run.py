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
from contextlib import closing
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ....core.files.records import attributes
from ....core.formatting.numbers import digits
from ....core.geometry.se3 import Array
from ....core.presentation.document import Answer, Block, Cell, Document, Heading, Paragraph, Table, document_of
from ....errors import InputError, keywords_of, require_integer, require_known
from ....findings import Finding
from ....model.noise.models import Noise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from ...simulation.experiment import Experiment, Fitted, experiment, motions_of, problem_of
from ..monte_carlo.run import MonteCarlo, Running
from ..monte_carlo.sums import UNITS
from ..outcome import NoiseOfData, Outcome, limit, limit_blocks, noise_of_data, one_of, place_of
from ..resumable import identity_of
from .relations import TOLERANCE, Evidence, Relation, relations
from .rows import FEWEST_TRIALS, METHODS, Row, all_sampled, effective_samples, formulas, judged, of_posterior

if TYPE_CHECKING:
    import pandas as pd

    from ..posterior.result import Posterior


@dataclass(frozen=True, eq=False)
class CrossCheck(Outcome):
    """Every covariance of one problem and what they have to do with each other; see `cross_check`."""

    title: ClassVar[str] = "Cross-check"
    kind: ClassVar[str] = "cross-check"

    rows: tuple[Row, ...]
    relations: tuple[Relation, ...]
    runs: dict[str, MonteCarlo]  # by method
    posterior: Posterior | None
    X: Array  # (4, 4) around which noise is drawn
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
    noise_of_data: NoiseOfData | None = None  # checks of the noise against the data
    ended: Finding | None = None  # how, if not all trials that were wanted, or not the posterior, were done

    @property
    def complete(self) -> bool:
        """True if all trials that were wanted, and the posterior, were done."""
        return self.ended is None

    @property
    def reason(self) -> str:
        """Reason in words why it is not complete; empty if it is."""
        return "" if self.ended is None else str(self.ended)

    @property
    def broken(self) -> tuple[str, ...]:
        """Names of the relations that must hold and do not; claims are not among them."""
        return tuple(relation.name for relation in self.relations if relation.law and relation.holds is False)

    def row(self, key: str) -> Row:
        """Return a row by its key. Raises `InputError` with the keys there are."""
        return one_of({row.key: row for row in self.rows}, key, "the key of a row, one of")

    def relation(self, name: str) -> Relation:
        """Return a relation by its name. Raises `InputError` with the names there are."""
        return one_of({relation.name: relation for relation in self.relations}, name, "the name of a relation, one of")

    def __repr__(self) -> str:
        state = f"broken: {', '.join(self.broken)}" if self.broken else "no relation broken"
        state += "" if self.complete else f"; not complete: {self.reason}"
        return f"CrossCheck({len(self.rows)} rows, {self.trials:,} trials, {state})"

    def to_text(self, verbose: bool = False) -> str:
        """Return the same as `summary`."""
        return self.summary(verbose)

    def to_dict(self) -> dict[str, Any]:
        """Everything but single trials and samples as plain numbers, lists and text, with units and convention."""
        return self.head(time="s") | attributes(
            self,
            "frame setup origin noise noise_estimated noise_of_data n pairs trials seed seconds complete reason ended "
            "broken rows relations",
        )

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


WHO = "The cross-check"
# Broken relations that are on the first screen.
MOST_BROKEN = 3


@document_of.register(CrossCheck)
def cross_check_document(check: CrossCheck, verbose: bool = False) -> Document:
    """Return the verdict, its limits and a line per covariance; ``verbose``: also the relations with their numbers."""
    noise = "estimated from the data" if check.noise_estimated else "as given"
    of = f"{check.n:,} motions"
    if check.noise.ITEM == "pose":
        of = f"{check.n:,} poses, {check.pairs:,} pairs"
    notes: dict[str, list[str]] = {}
    for row in check.rows:
        if row.note:
            notes.setdefault(row.note, []).append(row.label)
    start: list[Block] = [
        *([] if check.complete else [Paragraph(_cut_short(check))]),
        Answer(answer(check, verbose), _status(check)),
        *limit_blocks(WHO, check.noise_of_data, verbose),
    ]
    broken = [relation for relation in check.relations if relation.name in check.broken]
    facts = (
        f"{check.frame}: {of}; noise {noise}, drawn around the {check.origin}; {_trials(check)}, "
        f"seed {check.seed}; {digits(check.seconds)} s in all"
    )
    if not verbose:
        start += [Paragraph(f"- {r.statement}: NOT SO. {r.advice}", hang="  ") for r in broken[:MOST_BROKEN]]
        if len(broken) > MOST_BROKEN:
            start.append(Paragraph(f"- and {len(broken) - MOST_BROKEN} more"))
        return [start, _short_table(check.rows), [Paragraph(_short_legend(check.rows)), Paragraph(f"{facts}.")]]
    relations: list[Block] = [Heading("Relations")]
    for relation in check.relations:
        relations.append(Paragraph(f"[{state(relation)}] {relation.statement}."))
        relations.append(Paragraph(_sentence(relation.text), indent="    "))
        if relation.advice and relation.name not in check.broken:
            relations.append(Paragraph(f"-> {relation.advice}", indent="    ", hang="       "))
    numbers = [Paragraph(f"- {r.statement}: NOT SO. {_sentence(r.text)} {r.advice}", hang="  ") for r in broken]
    return [
        [*start, *numbers],
        Paragraph(facts),
        _table(check.rows),
        [
            *(Paragraph(f"{'; '.join(labels)}: {note}", indent="  ", hang="    ") for note, labels in notes.items()),
            Paragraph(_legend(check.rows)),
        ],
        relations,
    ]


def _status(check: CrossCheck) -> str:
    """Return the status of the verdict, for its colour."""
    doubts = check.noise_of_data is not None and bool(check.noise_of_data.doubtful)
    return "failed" if check.broken else "caution" if doubts or not check.complete else "ok"


def _cut_short(check: CrossCheck) -> str:
    """Say that it ended early, and how many trials each method has."""
    done = [f"{row.method} {row.trials or 0:,}" for row in check.rows if row.kind == "sampled"]
    text = f"NOT COMPLETE ({check.reason}). Trials, of {check.trials:,} asked: {', '.join(done)}."
    if any(row.kind == "posterior" and row.covariance is None for row in check.rows):
        text += " No posterior."
    return f"{text} What follows is of these."


def _trials(check: CrossCheck) -> str:
    """Say how many trials there were, of each method where they differ."""
    done = {row.method: row.trials for row in check.rows if row.kind == "sampled" and row.trials}
    if len(set(done.values())) == 1 and (check.complete or len(done) == len(METHODS)):
        return f"{next(iter(done.values())):,} trials"
    return f"trials: {', '.join(f'{method} {count:,}' for method, count in done.items())}" if done else "no trials"


def verdict(check: CrossCheck) -> str:
    """Return whether all relations hold, and what the cross-check cannot tell."""
    return f"{answer(check)} {limit(WHO, check.noise_of_data)}"


def answer(check: CrossCheck, named: bool = True) -> str:
    """Return whether all relations hold, or how many do not; ``named``: also claims, and what cannot be judged."""
    laws = [relation for relation in check.relations if relation.law]
    told = [relation for relation in laws if relation.holds is not None]
    agree = "the covariances are those that theory predicts for this noise"
    if not told:
        text = "No relation could be judged."
    elif check.broken:
        text = f"BROKEN: {len(check.broken)} of {len(told)} relations between the covariances."
    elif len(told) == 1:
        text = "The only relation that could be judged holds."
    else:
        text = (
            f"All {len(told)} relations {'hold' if len(told) == len(laws) else 'that could be judged hold'}: {agree}."
        )
    if not named:
        count = len(laws) - len(told)
        return f"{text} {count} could not be judged." if count and told else text
    if untold := [relation.statement for relation in laws if relation.holds is None]:
        text += f" Not judged: {'; '.join(untold)}."
    if failed := [relation.statement for relation in check.relations if not relation.law and relation.holds is False]:
        text += f" Claimed, but not so here: {'; '.join(failed)}."
    return text


def _short_table(rows: tuple[Row, ...]) -> Table:
    """Return the largest standard deviation of rotation and of translation in any direction, and the mean NEES."""
    lines: list[list[Cell]] = []
    for row in rows:
        if row.covariance is None:
            lines.append([row.label, ("none" + (f": {row.note}" if row.note else ""), 3)])
            continue
        worst = [
            np.sqrt(np.linalg.eigvalsh(row.covariance[part, part])[-1]) * UNITS[part][0]
            for part in (slice(0, 3), slice(3, 6))
        ]
        lines.append([row.label, *map(_figures, worst), _nees(row)])
    head = ["1 sigma, worst direction", "rotation", "translation", "mean NEES"]
    return Table("", head, lines, units=["", "deg", "mm", ""])


def _short_legend(rows: tuple[Row, ...]) -> str:
    marks = {_mark(row) for row in rows}
    text = "Mean NEES in Monte Carlo: 6 if the covariance is consistent with the errors."
    text += " ! marks one that is not." if "!" in marks else ""
    return text + (f" ~ marks one that is off by less than {100 * TOLERANCE:g} %." if "~" in marks else "")


def _table(rows: tuple[Row, ...]) -> Table:
    groups = [("", 1), ("1 sigma, rotation (deg)", 3), ("1 sigma, translation (mm)", 3)]
    head = ["", *"xyz", *"xyz", "trace R", "trace t", "ln", "mean", "time"]
    units = [*[""] * 7, "deg^2", "mm^2", "det", "NEES", "s"]
    lines: list[list[Cell]] = []
    for _, same in groupby(rows, lambda row: row.kind):
        lines += [[], *([row.label, *_cells(row)] for row in same)]
    return Table("", head, lines, units=units, groups=groups)


def _cells(row: Row) -> list[Cell]:
    seconds = f"{row.seconds:.2f}" if row.seconds >= 0.01 else "< 0.01"
    if row.std is None or row.trace_rotation is None or row.trace_translation is None:
        return [(f"none, see below ({seconds} s)", 11)]
    determinant = "-" if row.log_determinant is None else f"{row.log_determinant:.1f}"
    squares = row.trace_rotation * UNITS[0] ** 2, row.trace_translation * UNITS[3] ** 2
    return [*map(_figures, (*row.std * UNITS, *squares)), determinant, _nees(row), seconds]


def _nees(row: Row) -> str:
    """Return the mean NEES of a row with its mark."""
    nees = "-" if row.nees is None else f"{row.nees:.2f}" if row.nees < 1e4 else f"{row.nees:.1e}"
    return nees + _mark(row)


def _mark(row: Row) -> str:
    """Return the mark of a NEES that a consistent covariance does not have."""
    if row.nees is None or row.consistent is not False:
        return " "
    return "~" if abs(np.sqrt(row.nees / 6) - 1) < TOLERANCE else "!"


def _figures(value: float) -> str:
    """Three figures in at most seven characters, two where the exponent is long."""
    if 0.001 <= value < 999.5:
        return f"{value:#.3g}".rstrip(".")
    if value == 0:
        return "0"
    texts = (f"{value:.{n}e}".replace("e-0", "e-").replace("e+0", "e") for n in (2, 1))
    return next(text for text in texts if len(text) <= 7)


def _legend(rows: tuple[Row, ...]) -> str:
    intervals = sorted({row.nees_interval for row in rows if row.nees_interval is not None})
    where = ""
    if intervals:
        low, high = intervals[-1]  # of the most trials
        where = f" (99 %: {low:.2f} to {high:.2f}" + (", wider for fewer trials)" if len(intervals) > 1 else ")")
    return (
        "NEES: of the Monte Carlo errors of the same method (of ml for bound and posterior), 6 if the covariance is "
        f"consistent{where}; ! marks another, ~ one where this is less than {100 * TOLERANCE:g} % of a standard "
        "deviation. det: in rad and m. Formulas are to first order at the truth around which noise is drawn; efficient "
        "and ml are what these report at the data. Axes are those of the frame of X."
    )


def state(relation: Relation) -> str:
    """Say whether a relation holds, in a word or two."""
    if relation.holds is None:
        return "not judged"
    if relation.law:
        return "holds" if relation.holds else "BROKEN"
    return "claim, so here" if relation.holds else "claim, not so here"


def _sentence(text: str) -> str:
    """Add a capital and a full stop; names of methods stay as they are."""
    named = any(text.startswith((f"{name} ", f"{name},")) for name in METHODS)
    start = text[:1] if named else text[:1].upper()
    return f"{start}{text[1:]}{'' if text.endswith('.') else '.'}"


def cross_check(
    data: PosePairs | Motions | Fitted,
    *,
    noise: Noise | None = None,
    pairs: str | ArrayLike = "all",
    trials: int = 10_000,
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
    for name, value, least in (("trials", trials, FEWEST_TRIALS), ("seed", seed, 0)):
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


def _evidence(problem: Experiment, rows: tuple[Row, ...], runs: Any, effective: Any) -> Evidence:
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
