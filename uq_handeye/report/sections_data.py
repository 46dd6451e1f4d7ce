"""Sections of the report about the data: rig, residuals, budget, methods, observability, noise, other covariances."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..calibration.report.analysis import (
    budget_table,
    covariance_table,
    noise_blocks,
    pair_table,
    pose_table,
    tests_not_run,
    worst_words,
)
from ..calibration.report.shared_errors import included_words, shared_blocks
from ..core.formatting.numbers import fixed
from ..core.presentation.document import Block, Drawing, Paragraph, Points, Section, Table
from .comparison.text import methods_table

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from .comparison.result import Comparison

# A table lists all poses up to so many; of more those that are flagged, and the worst.
MOST_LISTED, MOST_FLAGGED, WORST = 40, 30, 12
_DEG, _MM = 180 / np.pi, 1e3


def needs(what: str, result: Calibration) -> str:
    """Say why ``what``, e.g. "Diagnostics are known", is missing from a result without analysis."""
    if result.covariance is None:
        return f"{what} where the noise of the poses is given or can be estimated; here it is not."
    return f"{what} by the methods efficient and ml, not by {result.method}."


def residuals_section(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """Residuals of the poses and of the pairs."""
    blocks: list[Block] = []
    table = result.table
    if table is None or "residuals" not in drawings:
        item = "motion" if result.setup is None else "pose"
        blocks.append(Paragraph(needs(f"Residuals of each {item} are found", result), empty=True))
    else:
        blocks.append(drawings["residuals"])
        if not table.flagged:
            blocks.append(Paragraph(f"No {table.item} is flagged: none of the {len(table.counted):,} stands out."))
        blocks += [Paragraph(str(one)) for one in result.findings if one.code == "calibration.excluded"]
        order = np.argsort(-table.distance2, kind="stable").tolist()
        if len(table) <= MOST_LISTED:
            shown, which = list(range(len(table))), f"All {len(table)} {table.item}s"
        else:
            flagged = [k for k in order if table.flag[k] not in ("kept", "excluded")][:MOST_FLAGGED]
            excluded = [k for k in order if table.flag[k] == "excluded"][:MOST_FLAGGED]
            shown = sorted({*flagged, *excluded, *order[:WORST]}, key=order.index)
            also = "flagged ones, excluded ones" if excluded else "flagged ones"
            which = f"{len(shown)} of {len(table):,} {table.item}s: {also} and those of largest d², worst first"
            if len(flagged) < len(table.flagged):
                which += f" ({len(table.flagged) - len(flagged)} more are flagged)"
        blocks.append(pose_table(table, shown, f"{which}. Numbers count from 0."))
    blocks.append(pair_table(result))
    return Section("residuals", "Residuals in full", blocks, folded=True)


def budget_section(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """Section of the shares of the variance by noise."""
    title = "Uncertainty budget in full"
    table = budget_table(result)
    if table is None or "budget" not in drawings:
        text = needs("The budget is computed", result)
        return Section("full-budget", title, [Paragraph(text, empty=True)], folded=True)
    return Section("full-budget", title, [drawings["budget"], table, Paragraph(worst_words(result))], folded=True)


def shared_section(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """Errors that all poses share: what was assumed, what was found."""
    blocks: list[Block] = [drawings[stem] for stem in ("shared",) if stem in drawings]
    return Section(
        "shared",
        "Errors that all poses share",
        [Paragraph(included_words(result)), *blocks, *shared_blocks(result)],
        folded=True,
    )


def methods_section(comparison: Comparison | None, reason: str, note: str, drawing: Drawing | None) -> Section:
    """The published methods on the same data; ``reason`` says why there is none."""
    title = "Other methods on the same data"
    if comparison is None:
        return Section("methods", title, [Paragraph(reason, empty=True)], folded=True)
    table = methods_table(comparison)
    text = f"{comparison.verdict} All on the same {comparison.origin}.{note} Methods that agree may be wrong together."
    blocks: list[Block] = [Paragraph(text)]
    if drawing is not None:
        blocks.append(drawing)
    blocks.append(table)
    if comparison.own_warnings:
        blocks.append(Points(_gathered(comparison)))
    return Section("methods", title, blocks, folded=True)


def _gathered(comparison: Comparison) -> list[str]:
    """The warnings of single methods; what several say is said once."""
    said: dict[str, list[str]] = {}
    for line in comparison.own_warnings:
        method, _, text = line.partition(": ")  # or methods, which then say the same
        said.setdefault(text.replace(f"method '{method}'", "the method"), []).append(method)
    return [f"{', '.join(methods)}: {text}" for text, methods in said.items()]


def observability_section(result: Calibration) -> Section:
    """Section of what the data can tell about X, in numbers and in words."""
    title = "Observability and tests of the residuals"
    not_run = tests_not_run(result)
    skipped: list[Block] = [Paragraph("Tests that were not run:"), Points(not_run)] if not_run else []
    if result.analysis is None:
        text = needs("Observability, influence and tests of the residuals are computed", result)
        return Section("observability", title, [Paragraph(text, empty=True), *skipped], folded=True)
    found = result.analysis.diagnostics
    s = found.spectrum
    rows = []
    for name, unit, sd, axes in (
        ("translation", "mm", s.sd_translation_mm, s.axes_translation),
        ("rotation", "deg", s.sd_rotation_deg, s.axes_rotation),
    ):
        for k, word in enumerate(("least certain", "middle", "most certain")):
            axis = ", ".join(f"{x:+.2f}" for x in axes[k])
            rows.append([f"{name}, {word}", f"{fixed(sd[k])} {unit}", f"({axis})"])
    frame = s.frame if "frame" in s.frame else f"{s.frame} frame"
    table = Table(
        f"Principal directions of X, in the {frame}{_of_noise_alone(result)}",
        ["direction", "1 sigma", "unit vector"],
        rows,
    )
    sentences = Points.of_findings(found.findings)
    return Section("observability", title, [table, sentences, *skipped], folded=True)


def _of_noise_alone(result: Calibration) -> str:
    """Say what the covariance of the result includes and the diagnostics, which are those of the noise model, do
    not.
    """
    offset = result.time_offset
    if offset is not None and offset.share > 0:
        return (
            f"; by the noise alone: the time offset, which the answer contains, adds to it (share {offset.share:.0%})"
        )
    if result.covariance_kind not in ("model", "sigma-points"):
        return "; by the model of the noise, not by the covariance of the answer"
    return ""


def noise_section(result: Calibration) -> Section:
    """The noise given or estimated, and what the residuals say of it."""
    blocks = noise_blocks(result)
    if result.fit is None and result.noise is not None:
        blocks.append(Paragraph(needs("The chi-square test of the residuals is made", result), empty=True))
    return Section("noise", "The noise", blocks, folded=True)


def covariances_section(result: Calibration) -> Section:
    """The covariances that need no noise model, and X of two halves of the data."""
    title = "Covariances without a noise model, and two halves of the data"
    analysis, table = result.analysis, covariance_table(result)
    if analysis is None or table is None:
        text = needs("Other covariances and tests of two halves are computed", result)
        return Section("covariances", title, [Paragraph(text, empty=True)], folded=True)
    halves = (analysis.split_half.finding, analysis.split_in_time.finding)
    points = Points.of_findings(halves)
    return Section("covariances", title, [table, points], folded=True)
