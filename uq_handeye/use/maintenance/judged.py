"""Test new measurements of a rig, of one camera or several, for what has changed and what moved among them.

All new rows are tested together (`graph.rows`), a move of each unknown pose before them by its own chi-square, and
a step of each among them, from one moment on (`graph.steps_in_time`): the change of a single pose is lost among
the residuals of many others. Of the probability of a false alarm the first test has half, the moves and the steps a
quarter each, divided by their number (Bonferroni). Whatever the answer, the smallest move of each pose that these
measurements would have shown is given.

Errors that change slowly, such as those of an arm along its path, are no step: a step leaves nothing. It counts only
where every other one that is left is below `MAX_REMAINING_SHARE` of its chi-square, and where it stands out of the
residuals that it leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.levels import POWER
from ...errors import InputError
from ...fit.diagnostics.paths import MAX_REMAINING_SHARE
from ...fit.graph.rows import NewRows, PredictiveReference, smallest_change
from ...fit.graph.steps_in_time import MIN_MOMENTS, Moments, Step, largest_step, sums_of
from ...model.errors.cholesky import checked_cholesky, substitute
from .causes import Candidate, Causes, compare_candidates
from .check_result import Move

# A move among the new poses explains more than one before all of them by this (chi-square), in addition to what the
# choice of the pose gains by chance.
MIN_GAIN_OF_LATER_MOVE = 10.0


class Compared(NamedTuple):
    """New measurements compared with a calibration: rows, columns of the moves of unknown poses, and causes."""

    rows: NewRows
    dof: int  # of d^2
    # distribution of d^2 of the directions of columns, or of all rows
    reference: Callable[[Array | None], PredictiveReference]
    moved: Mapping[str, Array]  # (m, k, 6) columns of each unknown pose by name
    causes: Callable[[], Sequence[Candidate]]
    moment: NDArray[np.intp]  # (m,) place in time of each row


class Judged(NamedTuple):
    """The outcome of the tests of new measurements."""

    p_value: float
    contradicted: bool
    moves: tuple[Move, ...]
    causes: Causes
    later: tuple[str, Step] | None  # what moved among them, and the step


def judged(of: Compared, level: float) -> Judged:
    """Test new measurements against the calibration, at a probability of a false alarm."""
    if not 0 < level < 0.5:
        raise InputError(f"Expected `level` to lie between 0 and 0.5, got {level!r}.")
    reference = of.reference(None)
    p = reference.p_value(of.rows.d2)
    of_all, of_one = level / 2, level / 4 / len(of.moved)
    least = reference.noncentrality(POWER.probability, of_all)
    moves = sorted((_move(of, name, least, of_one) for name in of.moved), key=lambda one: -one.chi_square)
    later = max(_steps(of), key=lambda one: one[1].chi_square, default=None)
    if later is not None and not _is_step(of, *later, of_one):
        later = None
    by_step = later is not None and later[1].p < of_one
    contradicted = p < of_all or min(one.p for one in moves) < of_one or by_step
    if later is not None:
        chance = MIN_GAIN_OF_LATER_MOVE + 2.0 * float(np.log(2 * len(np.unique(of.moment))))
        later = later if contradicted and later[1].chi_square > moves[0].chi_square + chance else None
    return Judged(p, contradicted, tuple(moves), compare_candidates(of.rows, of.causes(), reference, of.dof), later)


def _move(of: Compared, name: str, least: float, level: float) -> Move:
    """Return the move of one unknown pose; ``least``: noncentrality that shows in all rows together."""
    columns = of.moved[name]
    by = of.rows.explained_by(columns)
    rank = int(np.linalg.matrix_rank(by.covariance, hermitian=True)) if by.gain > 0 else 0
    reference = of.reference(columns)
    left = of.reference(None).p_value(max(of.rows.d2 - by.gain, 0.0), max(of.dof - rank, 1))
    needed = min(least, reference.noncentrality(POWER.probability, level))
    shift, angle = smallest_change(of.rows.information(columns), needed)
    return Move(name, by.gain, reference.p_value(by.gain), left, angle, shift, by.estimate, by.covariance)


def _is_step(of: Compared, name: str, step: Step, level: float) -> bool:
    """Return whether a step leaves no other one, and stands out of the residuals that it leaves."""
    columns = of.moved[name]
    left = (of.rows.d2 - step.chi_square) / max(of.dof - step.dof, 1)
    if left > 1.0:
        tried = len(np.unique(of.moment)) + 1 - 2 * MIN_MOMENTS
        if tried * of.reference(columns).p_value(step.chi_square / left) > level:
            return False
    others = _steps(of, columns * (of.moment >= step.begin)[:, None, None])
    largest = max((one.chi_square for _, one in others), default=0.0)
    return largest <= MAX_REMAINING_SHARE * step.chi_square


def _steps(of: Compared, given: Array | None = None) -> list[tuple[str, Step]]:
    """Return the step of each unknown pose among the new rows of the largest chi-square.

    The errors of the posterior are the other unknowns, and the numbers of the columns ``given`` (m, k, 6).
    """
    rows, found = of.rows, list[tuple[str, Step]]()
    B = checked_cholesky(rows.own)
    V, r = substitute(B, rows.by_unit), substitute(B, rows.r[..., None])
    prior = np.ones(V.shape[-1])
    if given is not None:
        V, prior = np.concatenate([V, substitute(B, given)], axis=-1), np.append(prior, np.zeros(given.shape[-1]))
    flat = V.reshape(-1, V.shape[-1])
    inverse = np.asarray(np.linalg.pinv(np.diag(prior) + flat.T @ flat, hermitian=True), dtype=float)
    e = r - (V @ (inverse @ (flat.T @ r.reshape(-1))))[..., None]
    rest = np.concatenate([V, e], axis=-1)
    for name, columns in of.moved.items():
        some = np.abs(columns).max(axis=(1, 2)) > 0.0  # a pose is not seen at every moment
        moments, place = np.unique(of.moment[some], return_inverse=True)
        each = sums_of(-substitute(B, columns)[some], rest[some])
        sums = np.zeros((len(moments), *each.shape[1:]))
        np.add.at(sums, place, each)
        bins, reference = Moments.of(np.arange(len(moments))), of.reference(columns)
        step = largest_step(inverse, np.add.reduceat(sums, bins.first), bins)
        if step is not None:
            tried = len(moments) + 1 - 2 * MIN_MOMENTS
            p = step.p if reference.noise_given else min(1.0, tried * reference.p_value(step.chi_square))
            found.append((name, step._replace(begin=int(moments[step.begin]), p=p)))
    return found
