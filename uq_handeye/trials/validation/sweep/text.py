"""A sweep over the noise in words: per method whether the noise is inside, how far it may grow, and a table."""

from __future__ import annotations

import math
from collections.abc import Callable

from ....core.formatting.numbers import digits, rough
from ....core.presentation.document import Answer, Block, Cell, Document, Paragraph, Table, document_of
from ..noise_of_data import limit_blocks
from .level import KINDS, Level, Limit, MethodSweep, Verdict
from .run import Sweep

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
        return [start, said, _limits(result), Paragraph(end)]
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
        said = [f"{found.method}: first order is valid {_reach(found, first)}; {_margin(first)}."]
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


def _limits(result: Sweep) -> Table:
    """Return per method how many times the standard deviations of the noise may grow."""
    rows: list[list[Cell]] = [
        [found.method, *(_short_limit(found.limit(kind)) for kind in KINDS)] for found in result.methods
    ]
    return Table("", ["valid up to, times your sd", *KINDS], rows)


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


def _margin(limit: Limit) -> str:
    assert limit.holds is not None
    if math.sqrt(limit.holds) >= WELL:
        return "your own noise is well inside"
    return "your own noise is inside" if limit.fails is None else "your own noise is inside, but near the end"


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
