"""The two printed pages of a report: the answer with the checks and X, and the evidence for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ..calibration.accuracy import limit_of, suits_of
from ..calibration.report.answer import badges_of
from ..calibration.report.budget import budget_table
from ..calibration.report.facts import STEPS_AHEAD
from ..calibration.report.first_screen import split_blocks
from ..calibration.result import Calibration
from ..calibration.tolerance import Verdict
from ..core.limits import MAX_NAMED
from ..core.presentation.document import Answer, Block, Cell, Checks, Drawing, Paragraph, Points, Section, Table
from ..core.presentation.numbers import fixed
from ..findings import Finding
from .sections import needs

if TYPE_CHECKING:
    from ..calibration.accuracy import Accuracy
    from ..calibration.result import Calibration
    from ..calibration.tolerance import Verdict

# Characters of cautions that fit on the second page; the others are in a section of their own.
MAX_CAUTION_CHARACTERS = 1500


def first_sheet(result: Calibration, verdicts: Mapping[str, Verdict], drawings: Mapping[str, Drawing]) -> list[Section]:
    """Return the sections of page one: number, verdict, checks, a picture, X, and points ahead of the camera."""
    number: list[Block] = [Answer(result.headline, result.status)]
    if verdicts:
        number += badges_of(result, verdicts)
    elif (suits := suits_of(result)) is not None:
        number.append(Paragraph(suits))
    if (limit := limit_of(result)) is not None:
        number.append(Paragraph(limit))
    if also := _further_reasons(result):
        number.append(Paragraph(f"Also: {'; '.join(also)}."))
    if (step := result.advice) is not None:
        number.append(Paragraph(f"Next: {step}."))
    checks, subject = Checks.of(result.checks), result.facts.subject
    rows = [[one.name, *one.parts, one.unit] for one in result.facts.X]
    caption = "Value and standard deviation (1 sigma)" + ("" if result.std is not None else "; ? is not determined")
    head = [result.frame, "value", "\N{PLUS-MINUS SIGN} 1 sigma", "unit"]
    X = Table(f"{caption}.", head, rows, frozenset({3}))
    title = f"X: the {subject}" if subject else "X of AX = XB"
    return [
        Section("answer", "Result", number, wide=True),
        Section("checks", "Checks", [checks]),
        _picture(result, drawings),
        _before_and_after(result) if result.split else Section("x", title, [X]),
        Section("ahead", "A point in front of the camera", _point_blocks(result)),
    ]


def _further_reasons(result: Calibration) -> list[str]:
    """Return the reasons beside that of the headline, of findings of one kind the first."""
    firsts: dict[str, str] = {}
    for one in result.refuting:
        firsts.setdefault(one.code, one.phrase)
    of_findings = {one.phrase for one in result.refuting}
    others = [reason for reason in result.reasons if reason not in of_findings]
    return [*firsts.values(), *others][1:]


def _before_and_after(result: Calibration) -> Section:
    """Return X, or the target, before and after a move: X of all poses together is neither."""
    return Section("x", "X before and after the move", split_blocks(result))


def _contents_of(accuracy: Accuracy | None) -> list[Block]:
    """Return what the number includes, and what it does not."""
    if accuracy is None:
        return []
    text = f"Includes {', '.join(accuracy.included)}. Does not include {', '.join(accuracy.not_included)}."
    return [Paragraph(text)]


def _picture(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """Return the residuals by pose; the rig where there are none."""
    table = result.table
    if table is not None and "residuals-small" in drawings:
        return Section("by-pose", f"Residuals by {table.item}", [drawings["residuals-small"]])
    if "rig" in drawings:
        return Section("by-pose", "The rig", [replace(drawings["rig"], small=True)])
    text = needs("Residuals of each pose are found", result)
    return Section("by-pose", "Residuals", [Paragraph(text, empty=True)])


def _point_blocks(result: Calibration) -> list[Block]:
    """Return the uncertainty of points straight ahead of the camera, by their distance."""
    accuracy = result.accuracy
    if accuracy is None:
        return [Paragraph("Not known: the noise of the poses was not given and could not be estimated.", empty=True)]
    if result.reasons:
        return [Paragraph("Not stated, because X is not usable.", empty=True)]
    if result.opened is not None:
        return [Paragraph(f"Not determined: {'; '.join(result.open_words)}.", empty=True)]
    rows = []
    for step, fact in zip(STEPS_AHEAD, result.facts.select("point ahead"), strict=True):
        name = fact.of + (" (target)" if step == 1 and accuracy.distance_known else "")
        rows.append([name, fixed(fact.value, 2), fixed(fact.within_95 or 0.0, 2)])
    caption = (
        f"Uncertainty that X gives a point on the optical axis, in the {result.facts.parent}: 1 sigma in the worst "
        "direction, and the length that 95 % of its errors are within. "
        "The camera's own error of the point is not part of it."
    )
    return [Table(caption, ["distance", "1 sigma (mm)", "95 % (mm)"], rows)]


def second_sheet(result: Calibration, drawings: Mapping[str, Drawing], cautions: Sequence[Finding]) -> list[Section]:
    """Return the sections of page two: cautions in full, ellipses, budget, rig."""
    sections = []
    if cautions:
        sections.append(Section("cautions", "Cautions", [caution_points(cautions)], wide=True))
    ellipses = drawings.get("ellipses-small")
    if ellipses is None:
        why = Paragraph("Not known, because the accuracy of X is not known.", empty=True)
        sections += [Section("error", "Error of X", [why]), Section("budget", "Uncertainty budget", [why])]
    else:
        sections += [
            Section("error", "Error of X", [ellipses]),
            Section("budget", "Uncertainty budget", _budget(result)),
        ]
    if "rig" in drawings and result.table is not None:
        sections.append(Section("rig", "The rig", [drawings["rig"]], wide=True))
    elif "rig" not in drawings:
        text = "Not drawn: the motions came without poses."
        if result.setup is not None:
            text = "Not drawn: the stored result holds no poses. Calibrate again and store the result."
        sections.append(Section("rig", "The rig", [Paragraph(text, empty=True)], wide=True))
    return sections


def caution_points(cautions: Sequence[Finding]) -> Points:
    """Return cautions as a highlighted list."""
    return Points([str(finding) for finding in cautions], frozenset(range(len(cautions))))


def split_cautions(cautions: Sequence[Finding]) -> tuple[list[Finding], list[Finding]]:
    """Return the cautions that fit on page two, and the others."""
    shown: list[Finding] = []
    size = 0
    for finding in cautions:
        size += len(str(finding)) + 60
        if size > MAX_CAUTION_CHARACTERS and shown:
            break
        shown.append(finding)
    return shown, list(cautions[len(shown) :])


def _budget(result: Calibration) -> list[Block]:
    table = budget_table(result, MAX_NAMED)
    if table is None:
        return [Paragraph(needs("The budget is computed", result), empty=True)]
    columns = [0, 2, 3, 4, 5]
    rows: list[Sequence[Cell]] = [[row[k] for k in columns] if row else row for row in table.rows]
    head = [table.head[k] for k in columns]
    caption = (
        "Standard uncertainties u of translation and rotation per axis (root mean square), and shares of the variance "
        "(JCGM 100)."
    )
    table = replace(table, caption=caption, head=head, rows=rows, text_columns=frozenset())
    return [table, *([] if result.reasons else _contents_of(result.accuracy))]
