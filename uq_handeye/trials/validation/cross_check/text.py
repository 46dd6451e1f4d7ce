"""Text of a cross-check: the verdict, its limits, a line for each covariance, and the relations with their numbers."""

from __future__ import annotations

from itertools import groupby

import numpy as np

from ....core.limits import MAX_NAMED
from ....core.presentation.document import Answer, Block, Cell, Document, Heading, Paragraph, Table, document_of
from ....core.presentation.numbers import digits
from ..monte_carlo.consistency import HARMLESS_SD_ERROR
from ..monte_carlo.sums import UNITS
from ..outcome import limit, limit_blocks
from .relations import Relation
from .result import CrossCheck
from .rows import METHODS, Row

WHO = "The cross-check"


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
        start += [Paragraph(f"- {r.statement}: NOT SO. {r.advice}", hang="  ") for r in broken[: MAX_NAMED // 2]]
        if len(broken) > MAX_NAMED // 2:
            start.append(Paragraph(f"- and {len(broken) - MAX_NAMED // 2} more"))
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
    return text + (f" ~ marks one that is off by less than {100 * HARMLESS_SD_ERROR:g} %." if "~" in marks else "")


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
    return "~" if abs(np.sqrt(row.nees / 6) - 1) < HARMLESS_SD_ERROR else "!"


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
        f"consistent{where}; ! marks another, ~ one where this is less than {100 * HARMLESS_SD_ERROR:g} % of a "
        "standard deviation. det: in rad and m. Formulas are to first order at the truth around which noise is drawn; "
        "efficient and ml are what these report at the data. Axes are those of the frame of X."
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
