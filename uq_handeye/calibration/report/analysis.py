"""Analysis of a calibration beyond X, as blocks of text and page.

4DPA and its efficiency, standard deviations by every covariance, and the tests of the residuals.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.geometry.pose_numbers import pose_numbers
from ...core.presentation.document import Block, Cell, Code, Heading, Points, Table
from ...core.presentation.numbers import fixed, pose_rows
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...findings import Finding
from ..estimated import deviations_of
from ..result import Calibration


def beside_blocks(result: Calibration) -> list[Block]:
    """Blocks on the result of 4DPA and its efficiency."""
    beside, efficiency = result.fourdpa, result.efficiency
    if beside is None or beside.covariance is None or efficiency is None or not np.isfinite(efficiency).all():
        return []
    numbers = [
        *pose_rows(*pose_numbers(beside.X, beside.covariance)),
        f"standard deviations    {efficiency.min():.2f} to {efficiency.max():.2f} times the Cramer-Rao bound, which "
        f"{result.method} attains",
    ]
    text = "\n".join(f"  {line}" for line in numbers)
    return [Heading("4DPA only, on the same data:"), Code("", text, "")]


def covariance_table(result: Calibration) -> Table | None:
    """Standard deviations by every covariance, side by side; None where there is only one."""
    analysis = result.analysis
    if analysis is None:
        return None
    meaning = {
        "model": "model (the noise)",
        "sandwich": f"sandwich, by {'pose' if result.table is None else result.table.item}",
    }
    rows: list[list[Cell]] = []
    without: dict[str, list[str]] = {}  # kinds by the reason
    for kind, S in analysis.covariances.items():
        if S is None:
            without.setdefault(analysis.reasons[kind], []).append(kind)
            continue
        sd = deviations_of(S, result.opened, "X")
        name = meaning.get(kind, kind) + (" *" if kind == result.covariance_kind else "")
        shown = ("open" if np.isinf(x) else fixed(x) for x in sd * np.repeat([DEG_PER_RAD, MM_PER_M], 3))
        rows.append([name, *shown])
    rows += [[", ".join(kinds), (f"not determined: {reason}", 6)] for reason, kinds in without.items()]
    caption = (
        "Standard deviations of X by every covariance (* that of the result). All but the first are "
        "computed from the residuals, without a noise model. Where they are much larger, the noise model is wrong."
    )
    groups = [("", 1), ("rotation (deg)", 3), ("translation (mm)", 3)]
    return Table(caption, ["covariance", *"xyz", *"xyz"], rows, groups=groups)


# The directions are part of the numbers of the summary.
_SAID_ELSEWHERE = {"diagnostics.direction"}


def diagnosis_blocks(result: Calibration) -> list[Block]:
    """Text on the diagnostics and on the split halves."""
    analysis = result.analysis
    if analysis is None:
        return [Heading("Diagnostics:"), Points(tests_not_run(result))]
    found = [f for f in analysis.diagnostics.findings if f.code not in _SAID_ELSEWHERE]
    found.sort(key=lambda f: f.code != "diagnostics.joint_spectrum")  # that one first
    found += [analysis.split_half.finding, analysis.split_in_time.finding]
    below = not_shown_yet(result, found)
    title = f"Diagnostics{' (see the cautions above)' if len(below) < len(found) else ''}:"
    return [Heading(title), Points([str(f) for f in below])]


def tests_not_run(result: Calibration) -> list[str]:
    """Sentences that name the tests of the residuals and of halves that were not run, and why."""
    analysis = result.analysis
    if analysis is None:
        why = f"they are made by the methods efficient and ml, not by {result.method}"
        if result.covariance is None:
            why = "there is no noise, given or estimated"
        return [f"The tests of the residuals and of two halves of the data were not run, because {why}."]
    reasons = list(analysis.diagnostics.not_run)
    reasons += [half.reason for half in (analysis.split_half, analysis.split_in_time) if half.reason is not None]
    return [str(reason) for reason in reasons]


def not_shown_yet(result: Calibration, findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings that are not among those of the calibration, which stand before all others."""
    said = (*result.findings, *result.cautions)
    return [one for one in findings if one not in said]
