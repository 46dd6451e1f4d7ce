"""The certificate as a page: two sheets, the result with its conditions, then budget, traceability and validity."""

from __future__ import annotations

import numpy as np

from ...calibration.report.analysis import freedom
from ...calibration.statement.accuracy import Accuracy
from ...calibration.statement.tolerance import percent
from ...core.formatting.numbers import digits, fixed
from ...core.presentation.document import Answer, Badge, Block, Cell, Checks, Paragraph, Points, Section, Table
from ..page import colour_of
from .budget import LEVEL, OTHERS, BudgetRow, Stated, budget_rows, components_of, correlation_of, worst_of
from .contents import NOT_CERTIFIED, RULE, Contents
from .statements import (
    VALIDITY,
    conditions_of,
    coverage_of,
    fields_of,
    hashes_of,
    lengths_of,
    measurand_of,
    method_of,
    noise_source,
    robot_words,
    versions_of,
)

LOWER_LIMIT = "LOWER LIMIT"
# Rows of the budget on the page; the data have all of them.
MOST_SOURCES = 12
_FACTORS = {"m": (1e3, "mm"), "rad": (180 / np.pi, "deg")}


def certificate_html(of: Contents) -> str:
    """Return the certificate as one self-contained HTML text; nothing in it looks like a result where none is
    certified.
    """
    sheets = [_first(of), _second(of)] if of.certified else [[*_refused(of), *_origin(of)]]
    result = of.result
    facts = [result.setup or "motions without poses", f"method {result.method}"]
    return of.page("Hand-eye calibration", result.frame, facts, sheets, fields_of(result))


# -------------------------------------------------------------------------------------------------------- page one


def _refused(of: Contents) -> list[Section]:
    """Return why nothing is certified; no X, no uncertainty."""
    more = [Points(of.refusals[1:])] if len(of.refusals) > 1 else []
    answer = Answer(f"{NOT_CERTIFIED}. {of.result.headline}", "failed")
    return [of.refused(answer, *more), *_measured(of)]


def _first(of: Contents) -> list[Section]:
    result = of.result
    answer: list[Block] = [
        Answer(result.headline, colour_of(result, None if of.decision is None else of.decision.verdict))
    ]
    if of.decision is not None:
        verdict = of.decision.verdict
        answer.append(Badge(verdict.word, verdict.sentence, colour_of(result, verdict)))
        answer.append(Paragraph(f"{of.decision.sentence} {RULE}".strip()))
    if _accuracy(of).lower_limit:
        answer.append(Badge(LOWER_LIMIT, _why_lower(of), "caution"))
    answer.append(Paragraph(measurand_of(result)))
    return [
        Section("answer", "Result", answer, wide=True),
        Section("x", _lower("Result", of), _numbers(of)),
        Section("worst", _lower("In the least certain direction", of), _worst(of)),
        *_measured(of),
        Section("scope", "What the uncertainty includes", _scope(of), wide=True),
    ]


def _accuracy(of: Contents) -> Accuracy:
    assert of.result.accuracy is not None  # of a certified result
    return of.result.accuracy


def _scope(of: Contents) -> list[Block]:
    accuracy = _accuracy(of)
    return [
        Paragraph(f"Included: {', '.join(accuracy.included)}."),
        Paragraph(f"Not included: {', '.join(accuracy.not_included)}."),
    ]


def _measured(of: Contents) -> list[Section]:
    """Return the conditions of the measurement and the checks."""
    rows = [[name, text] for name, text in conditions_of(of.result)]
    return [
        Section("conditions", "Conditions", [Table("", ["", ""], rows, frozenset({1}))]),
        Section("checks", "Checks", [Checks.of(of.result.checks)]),
    ]


def _worst(of: Contents) -> list[Block]:
    accuracy = _accuracy(of)
    ahead = f"point {digits(accuracy.distance, 3)} m ahead of the camera"
    names = {"point": ahead + (" (distance of the target)" if accuracy.distance_known else "")}
    rows = [[names.get(one.name, one.name), *_sizes(one)] for one in worst_of(of.result)]
    blocks: list[Block] = [Table("Uncertainty in the worst direction.", ["", *_HEAD], rows, frozenset({5}))]
    if of.result.open_words:
        blocks.append(Paragraph(f"Not determined, and in no number: {'; '.join(of.result.open_words)}."))
    return [*blocks, _correlation(of)]


_HEAD = ("u", "nu", "k", f"U ({percent(LEVEL)})", "unit")


def _numbers(of: Contents) -> list[Block]:
    """Return X in its six numbers, and the rotation as a quaternion."""
    stated = zip(of.result.facts.X, components_of(of.result), strict=True)
    rows: list[list[Cell]] = [[shown.name, shown.parts[0], *_sizes(one)] for shown, one in stated]
    caption = "Value, standard uncertainty u, degrees of freedom nu, coverage factor k, expanded uncertainty U."
    quaternion = ", ".join(f"{x:.7f}" for x in of.result.quaternion)
    return [
        Table(caption, ["", "value", *_HEAD], rows, frozenset({6})),
        Paragraph(f"As quaternion (x, y, z, w): {quaternion}."),
    ]


def _correlation(of: Contents) -> Table:
    """Return the correlation of the six numbers, below the diagonal."""
    matrix = correlation_of(of.result)
    names = ["x", "y", "z", "rx", "ry", "rz"]
    rows = [
        [
            name,
            *("" if np.isnan(matrix[k, m]) else f"{matrix[k, m].round(2) + 0.0:.2f}" for m in range(k)),
            *[""] * (5 - k),
        ]
        for k, name in enumerate(names)
        if k
    ]
    return Table("Correlation of translation x, y, z and rotation vector rx, ry, rz.", ["", *names[:5]], rows)


def _lower(title: str, of: Contents) -> str:
    return f"{title} (lower limit)" if _accuracy(of).lower_limit else title


def _why_lower(of: Contents) -> str:
    """Return why the uncertainty is a lower limit."""
    failed = [check for check in of.result.checks if check.status == "failed"]
    why = (
        "; ".join(f"{check.name}: {check.text}" for check in failed[:2]) or "no error that all poses share is included"
    )
    return f"The uncertainty is at least what is stated. {why[0].upper()}{why[1:]}."


def _sizes(one: Stated) -> list[str]:
    factor, unit = _FACTORS[one.unit]
    if not np.isfinite(one.u):
        return ["not determined", "", "", "", unit]
    return [fixed(factor * one.u, 2), freedom(one.dof), f"{one.k:.2f}", fixed(factor * one.U, 2), unit]


# -------------------------------------------------------------------------------------------------------- page two


def _second(of: Contents) -> list[Section]:
    return [
        Section(
            "coverage", "Uncertainty", [Paragraph(coverage_of(of.result)), Paragraph(method_of(of.result))], wide=True
        ),
        Section("budget", "Uncertainty budget", [_budget(of)], wide=True),
        *_origin(of),
        Section("robot", "In the terms of ISO 9283:1998", [Points(robot_words(of.result))], wide=True),
        Section("validity", "Validity", [Paragraph(VALIDITY)], wide=True),
    ]


def _origin(of: Contents) -> list[Section]:
    """Return where the numbers come from: hashes, noise, lengths, versions."""
    result = of.result
    rows = [[name, digest] for name, digest in hashes_of(result)]
    blocks: list[Block] = []
    if rows:
        blocks.append(Table("", ["input", "SHA-256"], rows, frozenset({1}), verbatim=True))
    blocks.append(Paragraph(f"Noise: {noise_source(result)}. {lengths_of(result)} Versions: {versions_of(result)}."))
    return [Section("traceability", "Traceability", blocks, wide=True)]


def _budget(of: Contents) -> Table:
    found = sorted(budget_rows(of.result, MOST_SOURCES), key=lambda row: row.name.endswith(OTHERS))
    rows: list[list[Cell]] = [_source(row) for row in found]
    move, turn, _ = worst_of(of.result)
    rows.append([])
    factors = [_FACTORS["m"][0], _FACTORS["rad"][0]]
    for title, cells in (
        (_lower("combined, u_c", of), [fixed(f * one.u, 3) for f, one in zip(factors, (move, turn), strict=True)]),
        ("effective degrees of freedom", [freedom(one.dof) for one in (move, turn)]),
        (f"coverage factor k for {percent(LEVEL)}", [f"{one.k:.2f}" for one in (move, turn)]),
        (
            _lower("expanded, U = k u_c", of),
            [fixed(f * one.U, 3) for f, one in zip(factors, (move, turn), strict=True)],
        ),
    ):
        rows.append([title, "", "", "", "", *cells, "", ""])
    head = ["source", "type", "input: u", "distribution, origin", "nu", "u (mm)", "u (deg)", "% of mm", "% of deg"]
    caption = (
        "JCGM 100. Effect of each source on translation (mm) and rotation (deg) of X, in the direction in which each "
        "is least certain, and share of the variance; the effect divided by u of the input is its sensitivity "
        "coefficient. The sources are independent: squares add. nu: degrees of freedom. Type A: evaluated from the "
        "data, B: declared."
    )
    return Table(caption, head, rows, frozenset({1, 2, 3}))


def _source(row: BudgetRow) -> list[Cell]:
    words = ", ".join(text for text in (row.input.distribution, row.input.origin) if text)
    sizes = [
        fixed(factor * size, 2) if factor * size >= 1e-6 else "0"
        for (factor, _), size in zip(_FACTORS.values(), (row.translation, row.rotation), strict=True)
    ]
    shares = [f"{100 * share:.1f}" for share in (row.share_translation, row.share_rotation)]
    return [row.name, row.type, row.input.uncertainty, words, freedom(row.dof), *sizes, *shares]
