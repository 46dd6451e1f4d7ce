"""Relations between the covariances of one problem: those that must hold (T8), and those that a publication claims.

Model: sampled covariances S of T trials of an estimator, covariances P from formulas, and the Cramer-Rao bound C, all
of ``xi = (theta, tau)`` (rad and m) in one convention. To first order in the noise, and for an unbiased estimator,

    S = P of that estimator;   S = C for `efficient` and `ml`, and for the posterior;   S >= C for every estimator

A relation is broken where the ratios of standard deviations are outside the range that chance and the tolerance explain
(`ratios`).

(45) of the paper takes one error for all pairs and the mean derivative; by Jensen's inequality it is then smaller than
the true covariance of N pairs with equal noise by sqrt(N) in standard deviation or more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from ....core.files.json_values import JsonObject
from ....core.geometry.se3 import Array
from ..monte_carlo.consistency import HARMLESS_SD_ERROR, MIN_TRIALS_FOR_SPREAD, heavy_from
from ..monte_carlo.run import MonteCarlo
from .ratios import WIDE_RATIO, Ratios, chance, number, ratios

# Standard deviations up to this multiple of those of the bound count as near.
NEAR_BOUND_RATIO = 1.5


class Relation(NamedTuple):
    """One thing that must be so, or is claimed to be, and whether it is."""

    name: str
    statement: str
    law: bool  # False: a claim, which may fail without anything being wrong
    holds: bool | None  # None: undecided, or without meaning here; the text says why
    text: str  # with numbers
    advice: str = ""  # where it does not hold: what that means and what to do

    def to_dict(self) -> JsonObject:
        """Plain values for JSON."""
        return self._asdict()


class Evidence(NamedTuple):
    """Evidence by which relations are judged; covariances by the keys of the rows, runs by method."""

    covariances: Mapping[str, Array]
    missing: Mapping[str, str]  # what rows there are not, and why
    runs: Mapping[str, MonteCarlo]
    effective: int | None  # independent samples that the posterior is worth
    on_poses: bool  # noise on poses
    shared: bool  # pairs that share poses
    all_pairs: bool  # every two poses make a pair
    pairs: int

    @property
    def own(self) -> str:
        """Key of the covariance of 4DPA for this noise."""
        return "4dpa-poses" if self.on_poses else "4dpa-pairs"


Judgement = tuple[bool | None, str, str]  # whether it holds, text with numbers, advice


_LAWS: list[tuple[str, str, bool, tuple[str, ...], tuple[str, ...], Callable[[Evidence], Judgement]]] = []


def _relation(
    name: str, statement: str, keys: str = "", methods: str = "", law: bool = True
) -> Callable[[Callable[[Evidence], Judgement]], Callable[[Evidence], Judgement]]:
    """Put a judge into the table, with the rows and the runs that it needs; ``{own}``: 4DPA's row for this noise."""

    def put(judge: Callable[[Evidence], Judgement]) -> Callable[[Evidence], Judgement]:
        _LAWS.append((name, statement, law, tuple(keys.split()), tuple(methods.split()), judge))
        return judge

    return put


def relations(e: Evidence) -> tuple[Relation, ...]:
    """All relations that apply to the problem, in the order of T8."""
    return tuple(_judged(e, *row) for row in _LAWS if e.on_poses or row[0] != "shared-poses")


def _judged(
    e: Evidence,
    name: str,
    statement: str,
    law: bool,
    keys: tuple[str, ...],
    methods: tuple[str, ...],
    judge: Callable[[Evidence], Judgement],
) -> Relation:
    """Return the relation with its verdict, or with the reason why there is none."""
    needed = [key.format(own=e.own) for key in keys]
    reasons = [e.missing.get(key, f"{key} was not asked for") for key in needed if key not in e.covariances]
    for method in methods:
        if method not in e.runs:
            reasons.append(e.missing.get(f"{method}-sampled", f"{method} has no trials"))
        elif e.runs[method].consistency.sums.count < MIN_TRIALS_FOR_SPREAD:
            reasons.append(f"{MIN_TRIALS_FOR_SPREAD} trials of {method} with an estimate are needed at least")
    if reasons:
        return Relation(name, statement, law, None, "; ".join(reason.rstrip(".") for reason in reasons))
    try:
        holds, text, advice = judge(e)
    except np.linalg.LinAlgError:
        return Relation(name, statement, law, None, "a covariance is singular: some direction of X has no error")
    return Relation(name, statement, law, holds, text, advice if holds is False else "")


_FIRST_ORDER = "The errors of {} in Monte Carlo have the covariance that first order predicts for it"


_BOUND = "The errors of `{}` in Monte Carlo have the covariance of the Cramer-Rao bound"


def _sampled_equals(e: Evidence, method: str, key: str, what: str) -> Judgement:
    """(1) to (4)"""
    r = _of_run(e, method, key.format(own=e.own))
    text = f"standard deviations sampled are {r.text} those of {what}; {r.margin}{_left_out(e, method)}"
    worst, where = r.farthest
    beyond = "the noise is beyond first order for this method on these motions."
    advice = (
        f"The errors are really {number(worst)} times what is reported in {where}: {beyond} Report the sampled "
        "covariance in its place, reduce the noise, or add motions that rotate about other axes."
    )
    if r.shapeless:
        advice = (
            f"The errors are really {number(r.overall)} times what is reported over all directions, and rare "
            f"large ones make up much of that: {beyond} Use another method, reduce the noise, or add motions that "
            "rotate about other axes; no covariance in its place would do."
        )
    return r.equal, text, advice


for _name, _method, _row, _statement, _what in (
    ("4dpa-first-order", "4dpa", "{own}", _FIRST_ORDER.format("4DPA"), "the first-order covariance of 4DPA"),
    (
        "nguyen-first-order",
        "nguyen",
        "nguyen-first-order",
        _FIRST_ORDER.format("Nguyen and Pham"),
        "the first-order covariance of Nguyen and Pham",
    ),
    ("efficient-bound", "efficient", "bound", _BOUND.format("efficient"), "the bound"),
    ("ml-bound", "ml", "bound", _BOUND.format("ml"), "the bound"),
):
    _relation(_name, _statement, _row, _method)(partial(_sampled_equals, method=_method, key=_row, what=_what))


@_relation(
    "posterior-bound", "The posterior has the covariance of the Cramer-Rao bound, not that of 4DPA", "bound posterior"
)
def _posterior(e: Evidence) -> Judgement:
    """(5)"""
    C, P = e.covariances["bound"], e.covariances["posterior"]
    r = ratios(P, C, e.effective)
    text = f"standard deviations of the posterior are {r.text} the bound's; {r.margin}"
    if e.own in e.covariances:
        beside = _per_axis(e.covariances[e.own], P)
        text += f". 4DPA's own are {_range(beside)} times those of the posterior per axis: what 4DPA does not use"
    advice = (
        "What these data say of X is not a Gaussian with the covariance of the bound: the noise is beyond first "
        "order, or there are few data. Report the posterior (its intervals) in place of a covariance."
    )
    return r.equal, text, advice


@_relation("none-below-bound", "No method has a smaller covariance than the Cramer-Rao bound", "bound")
def _none_below(e: Evidence) -> Judgement:
    """(6)"""
    told = [method for method, run in e.runs.items() if run.consistency.sums.count >= MIN_TRIALS_FOR_SPREAD]
    found = {method: _of_run(e, method, "bound") for method in told}
    if not found:
        return None, f"fewer than {MIN_TRIALS_FOR_SPREAD} trials of every method", ""
    text = "least standard deviation over that of the bound: "
    text += ", ".join(f"{method} {r.least:.3f} (chance alone {r.low:.3f})" for method, r in found.items())
    below = [method for method, r in found.items() if not r.not_below]
    untold = [m for m, r in found.items() if m not in below and r.shapeless and r.least < 1 - HARMLESS_SD_ERROR]
    failed = [method for method in below if e.runs[method].failures]
    advice = f"{_and(below)} would be better than any unbiased estimator can be. "
    if failed:
        advice += f"Trials of {_and(failed)} that gave no estimate are left out, which flatters the rest. "
    advice += "Else the estimate is biased, or the bound is not valid: the noise is beyond first order."
    text = f"{text}; {100 * HARMLESS_SD_ERROR:g} % below it are tolerated"
    if untold and not below:
        return None, f"{text}. It cannot be told of {_and(untold)}: the errors have heavy tails", ""
    return not below, text, advice


_UNKNOWING = "That has no meaning here: pairs share poses, and their covariances take them as independent"


_PARTS = {"rotation": slice(0, 3), "translation": slice(3, 6)}


@_relation(
    "nguyen-not-below-bound",
    "Nguyen and Pham's own covariance of the rotation is not below the Cramer-Rao bound",
    "nguyen-own bound",
)
def _nguyen_not_below(e: Evidence) -> Judgement:
    """(7): their rotation uses a part of the data, so that it cannot be better than all of them."""
    r = ratios(e.covariances["nguyen-own"], e.covariances["bound"], part=_PARTS["rotation"])
    text = f"standard deviations are {r.text} the bound's"
    if e.shared:
        return None, f"{text}. {_UNKNOWING}", ""
    advice = "It promises more than any estimator can keep: the noise is beyond first order."
    return r.not_below, f"{text}; {100 * HARMLESS_SD_ERROR:g} % below are tolerated", advice


@_relation(
    "nguyen-near-bound",
    "Nguyen and Pham's own covariances are near the Cramer-Rao bound",
    "nguyen-own bound",
    law=False,
)
def _nguyen_near(e: Evidence) -> Judgement:
    """(7), a claim: their translation leaves out what it shares with the rotation, and may be too small."""
    S, C = e.covariances["nguyen-own"], e.covariances["bound"]
    found = {name: ratios(S, C, part=part) for name, part in _PARTS.items()}
    parts = [f"{number(r.least)} to {number(r.largest)} times in {name}" for name, r in found.items()]
    text = f"standard deviations are those of the bound {' and '.join(parts)}"
    if e.shared:
        return None, f"{text}. {_UNKNOWING}", ""
    advice = []
    if below := [name for name, r in found.items() if not r.not_below]:
        advice.append(
            f"Their covariance of the {_and(below)} promises more than any estimator can keep: it leaves out that "
            "all pairs share the error of the rotation, and correlations of rotation and translation noise. Use "
            "the first-order covariance of their estimator (propagate(..., method='nguyen'))."
        )
    if far := [name for name, r in found.items() if r.largest > NEAR_BOUND_RATIO]:
        advice.append(f"Their estimate of the {_and(far)} leaves much of the data unused: prefer `efficient`.")
    return not advice, f"{text}; near is {1 - HARMLESS_SD_ERROR:g} to {NEAR_BOUND_RATIO:g} times", " ".join(advice)


@_relation(
    "nguyen-below-4dpa",
    "Nguyen and Pham's own covariances are smaller than 4DPA's sampling covariance (the paper's Fig. 5)",
    "nguyen-own",
    "4dpa",
    law=False,
)
def _nguyen_below_4dpa(e: Evidence) -> Judgement:
    """(7), a claim: that of the paper's Fig. 5."""
    P, S, T, kurtosis = e.covariances["nguyen-own"], *_sampled(e)
    per_axis = _per_axis(P, S)
    text = f"their standard deviations are {_range(per_axis)} times those of 4DPA sampled, per axis"
    if e.shared:
        return None, f"{text}. {_UNKNOWING}", ""
    if not all(ratios(S, P, T, kurtosis, part).not_below for part in _PARTS.values()):
        return (False, text, "Theirs is the larger one in some direction: the claim is of one experiment.")
    if per_axis.max() > 1:
        return None, f"{text}: about the same in some direction", ""
    return (
        True,
        f"{text}: {'smaller, not slightly' if per_axis.min() < 1 - 4 * HARMLESS_SD_ERROR else 'slightly smaller'}",
        "",
    )


@_relation(
    "literal-too-small", "The covariance of the paper's (45) as printed is far too small", "4dpa-literal", "4dpa"
)
def _literal(e: Evidence) -> Judgement:
    """(8)"""
    S, T, kurtosis = _sampled(e)
    per_axis = _per_axis(S, e.covariances["4dpa-literal"])  # by axes: (45) may be singular
    high = chance(T, kurtosis)[1]
    small = per_axis.min() > high * (1 + HARMLESS_SD_ERROR)
    text = (
        f"its standard deviations are {_range(per_axis)} times too small per axis; with {e.pairs:,} pairs it is at "
        f"least about {number(np.sqrt(e.pairs))}"
    )
    if not small and high > WIDE_RATIO and (kurtosis or 0.0) > heavy_from(T):
        return None, f"{text}. It cannot be told: the errors have heavy tails", ""
    advice = "For these few motions (45) happens not to be too small. It is wrong all the same; do not use it."
    return bool(small), text, advice


@_relation(
    "shared-poses",
    "Pairs that share poses: the covariance with pairs taken as independent is too small, the pose-aware right",
    "4dpa-pairs 4dpa-poses",
    "4dpa",
)
def _shared(e: Evidence) -> Judgement:
    """(9), of noise on poses."""
    if not e.shared:
        return None, "no two pairs share a pose: both covariances are the same", ""
    independent, aware = (_of_run(e, "4dpa", key) for key in ("4dpa-pairs", "4dpa-poses"))
    small, right = not independent.not_above, aware.equal
    text = (
        f"standard deviations sampled are {independent.text} those with pairs taken as independent, and "
        f"{aware.text} the pose-aware ones"
    )
    if aware.shapeless:
        text += f"; {aware.margin}"
    if right is None:
        return None, text, ""
    if not e.all_pairs and not small and right:
        return None, f"{text}. For the pairs chosen it makes no difference", ""
    advice = "What pairs share does not show as it should. "
    if not right:
        advice += "The pose-aware covariance is wrong: the noise is beyond first order."
    return small and right, text, advice


def _sampled(e: Evidence) -> tuple[Array, int, float | None]:
    """Covariance of the errors of 4DPA in its trials, their number and kurtosis."""
    run = e.runs["4dpa"]
    assert run.covariance is not None
    return run.covariance, run.consistency.sums.count, run.consistency.kurtosis


def _of_run(e: Evidence, method: str, key: str) -> Ratios:
    """Sampled standard deviations of a method over those of a row."""
    run = e.runs[method]
    assert run.covariance is not None
    c = run.consistency
    return ratios(run.covariance, e.covariances[key], c.sums.count, c.kurtosis, rejected=bool(c.rejected))


def _per_axis(S: Array, P: Array) -> Array:
    """Standard deviations (6,) of S over those of P; infinite where P has no error at all."""
    above, below = np.diag(S), np.diag(P)
    return np.asarray(np.sqrt(np.divide(above, below, out=np.full(6, np.inf), where=below > 0)))


def _left_out(e: Evidence, method: str) -> str:
    failures = e.runs[method].failures
    return f". {failures:,} of {e.runs[method].trials:,} trials gave no estimate and are left out" if failures else ""


def _range(values: Array) -> str:
    return f"{number(values.min())} to {number(values.max())}"


def _and(names: list[str]) -> str:
    return " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)
