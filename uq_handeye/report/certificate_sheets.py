"""The certificate as a page: two sheets, the result with its conditions, then budget, traceability and validity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..calibration.accuracy import Accuracy
from ..calibration.parts import Provenance
from ..calibration.report.answer import badges_of, status_with
from ..calibration.result import Calibration
from ..calibration.tolerance import percent
from ..core.limits import MAX_LISTED
from ..core.presentation.document import Answer, Badge, Block, Cell, Checks, Paragraph, Points, Section, Table
from ..core.presentation.numbers import digits
from .budget import LEVEL, components_of, correlation_of, gum_table, lower, sizes_of_stated, worst_of
from .decision import RULE, Decision
from .statements import (
    VALIDITY,
    conditions_of,
    coverage_of,
    hashes_of,
    lengths_of,
    measurand_of,
    method_of,
    noise_source,
    robot_words,
    versions_of,
)

NOT_CERTIFIED = "NOT CERTIFIED"
LOWER_LIMIT = "LOWER LIMIT"


def sheets_of(result: Calibration, decision: Decision | None, refusals: Sequence[str]) -> list[list[Section]]:
    """Return the two sheets; one that states no X where there are reasons to refuse."""
    if refusals:
        more = [Points(refusals[1:])] if len(refusals) > 1 else []
        answer = Answer(f"{NOT_CERTIFIED}. {result.headline}", "failed")
        return [[refused(answer, *more), *_measured(result), *_origin(result)]]
    return [_first(result, decision), _second(result)]


def _first(result: Calibration, decision: Decision | None) -> list[Section]:
    answer: list[Block] = [Answer(result.headline, status_with(result, None if decision is None else decision.verdict))]
    if decision is not None:
        answer += badges_of(result, {result.names.camera: decision.verdict})
        answer.append(Paragraph(f"{decision.sentence} {RULE}".strip()))
    if _accuracy(result).lower_limit:
        answer.append(Badge(LOWER_LIMIT, _why_lower(result), "caution"))
    answer.append(Paragraph(measurand_of(result)))
    return [
        Section("answer", "Result", answer, wide=True),
        Section("x", lower("Result", result), _numbers(result)),
        Section("worst", lower("Length of the error", result), _worst(result)),
        *_measured(result),
        Section("scope", "What the uncertainty includes", _scope(result), wide=True),
    ]


def _accuracy(result: Calibration) -> Accuracy:
    assert result.accuracy is not None  # of a certified result
    return result.accuracy


def _scope(result: Calibration) -> list[Block]:
    accuracy = _accuracy(result)
    return [
        Paragraph(f"Included: {', '.join(accuracy.included)}."),
        Paragraph(f"Not included: {', '.join(accuracy.not_included)}."),
    ]


def _measured(result: Calibration) -> list[Section]:
    """Return the conditions of the measurement and the checks."""
    rows = [[name, text] for name, text in conditions_of(result)]
    return [
        Section("conditions", "Conditions", [Table("", ["", ""], rows, frozenset({1}))]),
        Section("checks", "Checks", [Checks.of(result.checks)]),
    ]


def _worst(result: Calibration) -> list[Block]:
    accuracy = _accuracy(result)
    ahead = f"point {digits(accuracy.distance, 3)} m ahead of the camera"
    names = {"point": ahead + (" (distance of the target)" if accuracy.distance_known else "")}
    rows = [[names.get(one.name, one.name), *sizes_of_stated(one)] for one in worst_of(result)]
    blocks: list[Block] = [
        Table(
            f"u in the worst direction; U: {percent(LEVEL)} of the errors are within, k = U / u.",
            ["", *_HEAD],
            rows,
            frozenset({5}),
        )
    ]
    if result.open_words:
        blocks.append(Paragraph(f"Not determined, and in no number: {'; '.join(result.open_words)}."))
    return [*blocks, _correlation(result)]


_HEAD = ("u", "nu", "k", f"U ({percent(LEVEL)})", "unit")


def _numbers(result: Calibration) -> list[Block]:
    """Return X in its six numbers, and the rotation as a quaternion."""
    stated = zip(result.facts.X, components_of(result), strict=True)
    rows: list[list[Cell]] = [[shown.name, shown.parts[0], *sizes_of_stated(one)] for shown, one in stated]
    caption = "Value, standard uncertainty u, degrees of freedom nu, coverage factor k, expanded uncertainty U."
    quaternion = ", ".join(f"{x:.7f}" for x in result.quaternion)
    return [
        Table(caption, ["", "value", *_HEAD], rows, frozenset({6})),
        Paragraph(f"As quaternion (x, y, z, w): {quaternion}."),
    ]


def _correlation(result: Calibration) -> Table:
    """Return the correlation of the six numbers, below the diagonal."""
    matrix = correlation_of(result)
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


def _why_lower(result: Calibration) -> str:
    """Return why the uncertainty is a lower limit."""
    failed = [check for check in result.checks if check.status == "failed"]
    why = (
        "; ".join(f"{check.name}: {check.text}" for check in failed[:2]) or "no error that all poses share is included"
    )
    return f"The uncertainty is at least what is stated. {why[0].upper()}{why[1:]}."


# -------------------------------------------------------------------------------------------------------- page two


def _second(result: Calibration) -> list[Section]:
    return [
        Section("coverage", "Uncertainty", [Paragraph(coverage_of(result)), Paragraph(method_of(result))], wide=True),
        Section("budget", "Uncertainty budget", [gum_table(result, MAX_LISTED)], wide=True),
        *_origin(result),
        Section("robot", "In the terms of ISO 9283:1998", [Points(robot_words(result))], wide=True),
        Section("validity", "Validity", [Paragraph(VALIDITY)], wide=True),
    ]


def _origin(result: Calibration) -> list[Section]:
    """Return where the numbers come from: hashes, noise, lengths, versions."""
    words = f"Noise: {noise_source(result)}. {lengths_of(result)}"
    return [origin_section(hashes_of(result), words, result.provenance)]


def origin_section(hashes: Sequence[tuple[str, str]], words: str, provenance: Provenance | None) -> Section:
    """Return where the numbers come from: hashes of the input, further words, versions."""
    blocks: list[Block] = []
    if hashes:
        rows = [[name, digest] for name, digest in hashes]
        blocks.append(Table("", ["input", "SHA-256"], rows, frozenset({1}), verbatim=True))
    blocks.append(Paragraph(f"{words} Versions: {versions_of(provenance)}.".strip()))
    return Section("traceability", "Traceability", blocks, wide=True)


def refused(*why: Block) -> Section:
    """Return the section that says that nothing is certified, and why."""
    last = Paragraph("This page states no result. It must not be used as evidence of a calibration.")
    return Section("answer", NOT_CERTIFIED, [*why, last], wide=True)
