"""The two printed pages of a report: the answer with what it rests on, then cautions, ellipses, budget and rig."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..calibration.report.analysis import budget_table
from ..calibration.report.first_screen import STATUS_OF, status_of, suited_to
from ..calibration.statement.accuracy import combined_parts
from ..calibration.statement.headline import two_numbers
from ..core.files.about import ABOUT, OF_CERTIFICATE
from ..core.formatting.numbers import digits, fixed
from ..core.geometry.se3 import Array
from ..core.presentation.document import Answer, Badge, Block, Checks, Drawing, Paragraph, Points, Section, Table
from ..findings import Finding
from .sections_data import needs

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..calibration.statement.accuracy import Accuracy
    from ..calibration.statement.tolerance import Verdict

# Characters of cautions that fit on the second page; the others are in a section of their own.
MOST_OF_CAUTIONS = 1500
# Distances of the small table of points, in distances of the target.
_STEPS = (0.5, 1.0, 1.5, 2.0)
# Sources of the budget on the second page; the smallest beyond are one row.
MOST_SOURCES = 6
_DEG, _MM = 180 / np.pi, 1e3


def title_fields(result: Calibration) -> list[tuple[str, str]]:
    """Return the names and texts of the title block; those without text are room to write on paper."""
    shown = [key for key in ABOUT if key not in OF_CERTIFICATE and (key != "note" or key in result.about)]
    return [(ABOUT[key], result.about.get(key, "")) for key in shown]


def colour_of(result: Calibration, verdict: Verdict | None = None) -> str:
    """Return the status of the headline, as everywhere, or that of the verdict on a tolerance where it is worse."""
    found = status_of(result)
    of_verdict = "ok" if verdict is None else STATUS_OF[verdict.word]
    return max(found, of_verdict, key=("ok", "caution", "failed").index)


def first_sheet(result: Calibration, verdict: Verdict | None, drawings: Mapping[str, Drawing]) -> list[Section]:
    """Return the sections of page one: number, verdict, checks, a picture, X, and points ahead of the camera."""
    number: list[Block] = [Answer(result.headline, colour_of(result))]
    if verdict is not None:
        number.append(Badge(verdict.word, verdict.sentence, colour_of(result, verdict)))
    elif (suits := suited_to(result)) is not None:
        number.append(Paragraph(suits))
    if not result.reasons:
        number += [Paragraph(text) for text in _contents_of(result.accuracy)]
    elif also := list({re.sub(r"[\d.]+", "", text): text for text in reversed(result.reasons[1:])}.values()):
        number.append(Paragraph(f"Also: {'; '.join(reversed(also))}."))  # those that differ by more than numbers
    checks = Checks([(check.status, check.name, check.text) for check in result.checks])
    return [
        Section("answer", "Result", number, wide=True),
        Section("checks", "Checks", [checks]),
        _picture(result, drawings),
        Section("x", _title_of_x(result), _x_blocks(result)),
        Section("ahead", "A point in front of the camera", _point_blocks(result)),
    ]


def _contents_of(accuracy: Accuracy | None) -> list[str]:
    """Return what the number is made of, what it includes, and what it does not."""
    if accuracy is None:
        return []
    shown = combined_parts(accuracy.parts, MOST_SOURCES)
    parts = [f"{one.name} {digits(_MM * one.translation, 2)} mm, {digits(_DEG * one.rotation, 2)} deg" for one in shown]
    return [
        *([f"Made of: {'; '.join(parts)}."] if parts else []),
        *([text] if (text := two_numbers(accuracy)) else []),
        f"Includes {', '.join(accuracy.included)}. Does not include {', '.join(accuracy.not_included)}.",
    ]


def _picture(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """Return the residuals by pose; the rig where there are none."""
    table = result.table
    if table is not None and "residuals-small" in drawings:
        return Section("by-pose", f"Residuals by {table.item}", [drawings["residuals-small"]])
    if "rig" in drawings:
        return Section("by-pose", "The rig", [replace(drawings["rig"], small=True)])
    text = needs("Residuals of each pose are found", result)
    return Section("by-pose", "Residuals", [Paragraph(text, empty=True)])


def _title_of_x(result: Calibration) -> str:
    if "_T_" not in result.frame:
        return "X of AX = XB"
    parent, child = result.frame.split("_T_")
    return f"X: the {child} in the {parent} frame"


def _x_blocks(result: Calibration) -> list[Block]:
    """Return X as a table with its standard deviations."""
    rows = [[one.name, *one.parts, one.unit] for one in result.facts.X]
    caption = "Value and standard deviation (1 sigma)" + ("" if result.std is not None else "; ? is not determined")
    return [Table(f"{caption}.", [result.frame, "value", "\N{PLUS-MINUS SIGN} 1 sigma", "unit"], rows, frozenset({3}))]


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
    for step in _STEPS:
        z = step * accuracy.distance
        one, expanded = (accuracy.point, accuracy.point_95) if step == 1 else _point_at(result, accuracy, z)
        name = f"{fixed(z)} m" + (" (target)" if step == 1 and accuracy.distance_known else "")
        rows.append([name, fixed(_MM * one, 2), fixed(_MM * expanded, 2)])
    caption = (
        f"Uncertainty that X gives a point on the optical axis, in the worst direction, in the {result.facts.parent}. "
        "The camera's own error of the point is not part of it."
    )
    return [Table(caption, ["distance", "1 sigma (mm)", "95 % (mm)"], rows)]


def _point_at(result: Calibration, accuracy: Accuracy, z: float) -> tuple[float, float]:
    """Return the standard and the expanded uncertainty (m) of a point z (m) ahead, in the worst direction."""
    point: Array = np.array([0.0, 0.0, z])
    if result.has_budget and result.covariance_kind in ("model", "sigma-points"):
        k = result.budget.budget_at(point).expanded(worst=True)["point"].k
    else:
        k = accuracy.translation_95 / accuracy.translation
    one = float(np.sqrt(np.linalg.eigvalsh(result.uncertainty_at(point).covariance)[-1]))
    return one, k * one


# ------------------------------------------------------------------------------------------------------- page two


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
    """Return cautions as a list in which each stands out."""
    return Points([str(finding) for finding in cautions], frozenset(range(len(cautions))))


def split_cautions(cautions: Sequence[Finding]) -> tuple[list[Finding], list[Finding]]:
    """Return the cautions that fit on page two, and the others."""
    shown: list[Finding] = []
    size = 0
    for finding in cautions:
        size += len(str(finding)) + 60
        if size > MOST_OF_CAUTIONS and shown:
            break
        shown.append(finding)
    return shown, list(cautions[len(shown) :])


def _budget(result: Calibration) -> list[Block]:
    table = budget_table(result, MOST_SOURCES)
    if table is None:
        return [Paragraph(needs("The budget is computed", result), empty=True)]
    columns = [0, 2, 3, 4, 5]
    rows: list[Any] = [[row[k] for k in columns] if row else row for row in table.rows]
    head = [table.head[k] for k in columns]
    caption = (
        "Standard uncertainties u of translation and rotation per axis (root mean square), and shares of the variance "
        "(JCGM 100)."
    )
    return [replace(table, caption=caption, head=head, rows=rows, text_columns=frozenset())]
